"""Jacobians, mass matrices and rates of random articulated bodies, against pybullet's own motion."""

import numpy as np
import pybullet as p
import pytest
from random_robots import KINDS, UNDAMPED, let_go, poses, robot, stop, velocities

import bullet_tendon as bt
from bullet_tendon import _core
from bullet_tendon.generalized_bodies import (
    exchange_wrench,
    jacobians_and_mass,
    movable_joints,
    product,
    rates,
    rotation_by,
    velocity_force,
)

H = 1e-3  # of finite differences of fourth order [m], [rad]
DT = 1e-4
ANY = (*KINDS, p.JOINT_SPHERICAL)
FEW_AND_MANY = pytest.mark.parametrize("count", [50, pytest.param(1000, marks=pytest.mark.slow)])


def robots(client, count, kinds=ANY):
    """(generator, body, J of every link, M, rates) of `count` random robots, every second one floating."""
    for seed in range(count):
        # After removeBody pybullet's mass matrix may be that of the body before.
        p.resetSimulation(client)
        p.setTimeStep(DT, client)
        rng = np.random.default_rng(seed)
        body = robot(client, rng, seed % 2 == 1, kinds)
        links = range(-1, p.getNumJoints(body, client))
        yield (rng, body, *jacobians_and_mass(body, links, client), rates(body, client))


def links_of(client, body):
    return p.getNumJoints(body, client) + 1


def displace(client, body, dof, step):
    """Move one degree of freedom by `step` from where the body is."""
    base = 6 if p.getDynamicsInfo(body, -1, client)[0] > 0 else 0
    by = np.zeros(3)
    if dof < base:
        centre, turn = p.getBasePositionAndOrientation(body, client)
        by[dof % 3] = step
        centre, turn = (np.add(centre, by), turn) if dof < 3 else (centre, product(rotation_by(by), turn))
        p.resetBasePositionAndOrientation(body, centre, turn, client)
        return
    axes = [(j, a) for j in movable_joints(body, client) for a in range(_width(client, body, j))]
    joint, axis = axes[dof - base]
    place = p.getJointStateMultiDof(body, joint, client)[0]
    by[axis] = step
    if len(place) == 1:
        p.resetJointState(body, joint, place[0] + step, 0, client)
    else:
        p.resetJointStateMultiDof(
            body, joint, product(place, rotation_by(by)), [0, 0, 0], physicsClientId=client
        )


def _width(client, body, joint):
    return 3 if p.getJointInfo(body, joint, client)[2] == p.JOINT_SPHERICAL else 1


def rotation_vectors(turns):
    """(links, 3) of small rotations (links, 3, 3)."""
    w = (turns - turns.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]].T
    sine = np.maximum(np.linalg.norm(w, axis=0) / 2, 1e-300)
    return (w / 2 * np.arcsin(sine) / sine).T


def slope(client, body, dof):
    """(links, 6) derivatives of positions and rotations by a degree of freedom, by finite differences."""
    state = p.saveState(client)
    turns = poses(client, body)[1]
    at = {}
    for k in (-2, -1, 1, 2):
        displace(client, body, dof, k * H)
        x, r = poses(client, body)
        at[k] = np.hstack([x, rotation_vectors(r @ turns.transpose(0, 2, 1))])
        p.restoreState(state, physicsClientId=client)
    p.removeState(state, client)
    return (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * H)


@FEW_AND_MANY
def test_torques_of_joints_are_the_virtual_work_of_wrenches(client, count):
    """J^T F of random wrenches on every link against finite differences of the poses, 1e-8."""
    for rng, body, jacobians, mass, _ in robots(client, count):
        wrenches = rng.normal(size=(links_of(client, body), 6))
        torques = np.einsum("lid,li->d", jacobians, wrenches)
        work = [(wrenches * slope(client, body, dof)).sum() for dof in range(len(mass))]
        np.testing.assert_allclose(torques, work, rtol=0, atol=1e-8)
        assert not len(mass) or np.abs(torques).max() > 1e-3


@FEW_AND_MANY
def test_rates_give_velocities_and_energy(client, count):
    """J u are pybullet's velocities of all links, and u^T M u / 2 is their kinetic energy."""
    for _, body, jacobians, mass, u in robots(client, count):
        seen = velocities(client, body)
        np.testing.assert_allclose(jacobians @ u, seen, rtol=0, atol=1e-12)
        energy = 0.0
        for link, (twist, turn) in enumerate(zip(seen, poses(client, body)[1], strict=True), start=-1):
            info = p.getDynamicsInfo(body, link, client)
            energy += info[0] * twist[:3] @ twist[:3] / 2 + (turn.T @ twist[3:]) ** 2 @ info[2] / 2
        fixed = p.getDynamicsInfo(body, -1, client)[0] == 0
        assert not (fixed and seen[0].any())
        assert u @ mass @ u / 2 == pytest.approx(energy, rel=1e-12)


@FEW_AND_MANY
def test_mass_matrix_is_that_of_pybullet(client, count):
    """pybullet's has the base's spin before its velocity, both in the base's inertial axes."""
    for _, body, jacobians, mass, _ in robots(client, count, KINDS):
        states = p.getJointStates(body, movable_joints(body, client), client) or ()
        theirs = np.array(p.calculateMassMatrix(body, [s[0] for s in states], physicsClientId=client) or ())
        if jacobians[0].any():
            order = [3, 4, 5, 0, 1, 2, *range(6, len(mass))]
            change, axes = np.eye(len(mass)), poses(client, body)[1][0]
            change[:3, :3] = change[3:6, 3:6] = axes.T
            theirs = change.T @ theirs[np.ix_(order, order)] @ change
        np.testing.assert_allclose(mass, theirs.reshape(mass.shape), rtol=1e-12, atol=1e-12)


def apply(client, body, link, wrench):
    centre = poses(client, body)[0][link + 1]
    p.applyExternalForce(body, link, wrench[:3], centre, p.WORLD_FRAME, client)
    p.applyExternalTorque(body, link, wrench[3:], p.WORLD_FRAME, client)


@FEW_AND_MANY
def test_a_step_of_pybullet_changes_rates_by_the_response(client, count):
    """From rest by DT M^-1 J^T F."""
    for rng, body, jacobians, mass, _ in robots(client, count):
        stop(client, body)
        link = int(rng.integers(-1 if jacobians[0].any() else 0, links_of(client, body) - 1))
        wrench = rng.normal(size=6)
        apply(client, body, link, wrench)
        p.stepSimulation(client)
        exact = DT * np.linalg.solve(mass, jacobians[link + 1].T @ wrench)
        atol = 1e-12 * np.abs(exact).max(initial=1e-9)
        np.testing.assert_allclose(rates(body, client), exact, rtol=0, atol=atol)


def assert_moves_by_itself(client, body):
    """A step without loads changes the rates by DT M^-1 (velocity terms and damping of joints)."""
    mass, before = jacobians_and_mass(body, [], client)[1], rates(body, client)
    exact = DT * np.linalg.solve(mass, velocity_force(body, client))
    p.stepSimulation(client)
    rounding = np.finfo(float).eps * np.abs(before).max(initial=0)
    atol = 1e-9 * np.abs(exact).max(initial=0) + rounding
    np.testing.assert_allclose(rates(body, client) - before, exact, rtol=0, atol=atol)


@FEW_AND_MANY
def test_a_step_of_pybullet_changes_rates_by_the_motion_itself(client, count):
    """By Coriolis, centrifugal and gyroscopic forces."""
    for _, body, _, mass, _ in robots(client, count):
        if len(mass):
            assert_moves_by_itself(client, body)


def test_damping_of_joints_is_that_of_pybullet(client):
    p.setTimeStep(DT, client)
    flags = p.URDF_USE_INERTIA_FROM_FILE
    body = p.loadURDF(
        bt.data_path("tendon_finger.urdf"), useFixedBase=True, flags=flags, physicsClientId=client
    )
    for link in range(-1, p.getNumJoints(body, client)):
        p.changeDynamics(body, link, linearDamping=0, angularDamping=0, physicsClientId=client)
    for joint, rate in enumerate((5.0, -20.0, 30.0)):
        let_go(client, body, joint)
        p.resetJointState(body, joint, 0.3, rate, client)
    assert_moves_by_itself(client, body)


@FEW_AND_MANY
def test_exchanged_wrenches_move_a_body_as_if_they_had_acted(client, count):
    for rng, body, jacobians, mass, _ in robots(client, count):
        if not len(mass):
            continue
        stop(client, body)
        state = p.saveState(client)
        link = int(rng.integers(-1 if jacobians[0].any() else 0, links_of(client, body) - 1))
        start = jacobians_and_mass(body, [link], client)[0][0], _core.answer(mass, np.eye(len(mass)))
        outcomes = []
        first, second = rng.normal(size=(2, 6))
        for wrenches in ((second,), (first, second)):
            apply(client, body, link, wrenches[0])
            p.stepSimulation(client)
            if len(wrenches) == 2:
                exchange_wrench([body], *start, *wrenches, DT, client)
            outcomes.append((*poses(client, body), rates(body, client)))
            p.restoreState(state, physicsClientId=client)
        *direct_poses, direct = outcomes[0]
        for exchanged, exact in zip(outcomes[1][:2], direct_poses, strict=True):
            np.testing.assert_allclose(exchanged, exact, rtol=0, atol=1e-12)
        np.testing.assert_allclose(outcomes[1][2], direct, rtol=0, atol=1e-9 * np.abs(direct).max())


def test_changed_masses_and_inertias_are_felt(client):
    """pybullet's own mass matrix keeps those that it was first asked with."""
    body = robot(client, np.random.default_rng(1), True)
    before = jacobians_and_mass(body, [0], client)[1]
    p.changeDynamics(body, 0, mass=30.0, physicsClientId=client)
    jacobians, mass = jacobians_and_mass(body, [0], client)
    added = 30.0 * jacobians[0, :3].T @ jacobians[0, :3]
    assert np.abs(mass - before).max() > 20
    assert np.linalg.eigvalsh(before + added - mass).min() >= -1e-12


def test_answers_are_those_of_the_matrix(client):
    rng = np.random.default_rng(0)
    for n in range(1, 15):
        root, forces = rng.normal(size=(n, n + 2)), rng.normal(size=(n, 3))
        mass = root @ root.T
        np.testing.assert_allclose(mass @ _core.answer(mass, forces), forces, rtol=0, atol=1e-9)


def test_what_has_no_mass_does_not_answer(client):
    """A point on the axis of its hinge: the hinge stays, the two masses go together, as in pybullet."""
    links = {"linkMasses": [0.5], "linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1]}
    links |= {"linkPositions": [[0.3, 0, 0]], "linkOrientations": [[0, 0, 0, 1]]}
    links |= {"linkInertialFramePositions": [[0.2, 0, 0]], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
    links |= {"linkParentIndices": [0], "linkJointTypes": [p.JOINT_REVOLUTE], "linkJointAxis": [[1, 0, 0]]}
    body = p.createMultiBody(1.5, physicsClientId=client, **links)
    for link, moment in ((-1, 0.01), (0, 0.0)):
        inertia = {"localInertiaDiagonal": [moment] * 3, "physicsClientId": client}
        p.changeDynamics(body, link, **inertia, **UNDAMPED)
    let_go(client, body, 0)
    (jacobian,), mass = jacobians_and_mass(body, [0], client)
    assert mass.shape == (7, 7)
    response = jacobian @ _core.answer(mass, jacobian.T)
    force = np.array([1.0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(response @ force, force / 2, rtol=0, atol=1e-12)
    assert np.abs(response).max() < 1e3
    p.setTimeStep(DT, client)
    apply(client, body, 0, np.array([0, 0, 1.0, 1.0, 0, 0]))
    p.stepSimulation(client)
    exact = DT * response @ [0, 0, 1.0, 1.0, 0, 0]
    np.testing.assert_allclose(velocities(client, body)[1], exact, rtol=0, atol=1e-9)


def test_planar_joints_are_not_known(client, tmp_path):
    link = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    joint = '<joint name="j" type="planar"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>'
    path = tmp_path / "planar.urdf"
    path.write_text(f'<robot name="r">{link.format("a")}{link.format("b")}{joint}</robot>')
    body = p.loadURDF(str(path), physicsClientId=client)
    p.resetBaseVelocity(body, [1, 2, 3], [4, 5, 6], physicsClientId=client)
    before = velocities(client, body)
    assert p.getJointInfo(body, 0, client)[2] == p.JOINT_PLANAR
    assert jacobians_and_mass(body, [0], client) is None
    exchange_wrench([body], np.eye(6), np.eye(6), np.ones(6), np.zeros(6), DT, client)
    np.testing.assert_array_equal(velocities(client, body), before)
