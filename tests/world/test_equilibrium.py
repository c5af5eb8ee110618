"""relax(bodies=...): bodies and joints put where ligaments, cartilage, gravity and told forces balance."""

import math

import numpy as np
import pybullet as p
import pytest
from link_scenes import block, links_on_joints
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import bullet_tendon as bt
from bullet_tendon.equilibrium import Equilibrium, HeldTendons

G = 9.81


def place(body, client):
    return np.concatenate(p.getBasePositionAndOrientation(body, client))


def hung(world, client):
    """A block in six strands, and the block."""
    stand, body = block(client, 0), block(client, 2.0, (0.01, -0.02, -0.15))
    rng = np.random.default_rng(7)
    for _ in range(6):
        above, below = rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.02, 0.02, 3)
        path = [(stand, -1, (above[0], above[1], 0)), (body, -1, (*below[:2], 0.05))]
        world.add_ligament(path, bt.Material.ligament(2e3, damping=60.0), rest_length=0.09)
    return body


def test_what_is_put_there_does_not_move(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    start = place(body, client)
    world.relax(bodies=[body], tolerance=1e-9)
    assert world.report.converged and world.report.residual <= 1e-9
    found, forces = place(body, client), [ligament.force for ligament in world.ligaments]
    assert np.abs(found - start).max() > 1e-3
    world.step(5)
    np.testing.assert_allclose(place(body, client), found, atol=1e-8)
    np.testing.assert_allclose([ligament.force for ligament in world.ligaments], forces, atol=1e-5)


def test_a_told_force_is_balanced(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    world.relax(bodies=[body], tolerance=1e-9)
    before = place(body, client)
    pull = np.array([5.0, 3.0, 0.0])
    world.apply_external_force(body, -1, pull, before[:3], p.WORLD_FRAME)
    world.relax(bodies=[body], tolerance=1e-9)
    assert np.abs(place(body, client) - before).max() > 1e-3
    total, torque = np.zeros(3), np.zeros(3)
    for ligament in world.ligaments:
        upper, lower = ligament.points
        force = ligament.force * (upper - lower) / np.linalg.norm(upper - lower)
        total += force
        torque += np.cross(lower - place(body, client)[:3], force)
    np.testing.assert_allclose(total, [-5, -3, 2 * G], atol=1e-6)
    np.testing.assert_allclose(torque, 0, atol=1e-7)


@pytest.mark.parametrize("flags", [p.WORLD_FRAME, p.LINK_FRAME])
def test_forces_of_the_call_are_balanced_and_those_of_the_link_follow_it(make_world, client, flags):
    """Three forces, as a couple and a pull; pybullet is given none of them."""
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    world.relax(bodies=[body], tolerance=1e-9)
    centre, turn = p.getBasePositionAndOrientation(body, client)
    axes = np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))
    couple = ((0, 0.5, 0), (0.02, 0, 0)), ((0, -0.5, 0), (-0.02, 0, 0))
    given = [((4.0, 3.0, -2.0), (0.01, 0.0, -0.05)), *couple]
    forces = []
    for force, point in given:
        if flags == p.WORLD_FRAME:
            point = centre + axes @ point
        forces.append((body, -1, force, tuple(point), flags))
    world.relax(bodies=[body], tolerance=1e-9, forces=forces)
    assert world.report.converged
    found, turned = p.getBasePositionAndOrientation(body, client)
    now = np.reshape(p.getMatrixFromQuaternion(turned), (3, 3))
    assert np.abs(now - axes).max() > 0.02
    total, torque = np.array([0, 0, -2 * G]), np.zeros(3)
    for force, point in given:
        along = now @ force if flags == p.LINK_FRAME else np.array(force)
        total += along
        torque += np.cross(now @ point, along)
    for ligament in world.ligaments:
        upper, lower = ligament.points
        force = ligament.force * (upper - lower) / np.linalg.norm(upper - lower)
        total += force
        torque += np.cross(lower - found, force)
    np.testing.assert_allclose(total, 0, atol=1e-6)
    np.testing.assert_allclose(torque, 0, atol=1e-7)
    world.relax(bodies=[body], tolerance=1e-9)
    before = place(body, client)
    world.step(3)
    np.testing.assert_allclose(place(body, client), before, atol=1e-8)


def test_a_joint_is_free_and_the_others_stay(make_world, client):
    """Two links on hinges; a line of constant tension turns the first one until the torques balance."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.01, 0.1], physicsClientId=client)
    arm = p.createMultiBody(
        0,
        -1,
        -1,
        (0, 0, 0),
        linkMasses=[1.0, 1.0],
        linkCollisionShapeIndices=[shape] * 2,
        linkVisualShapeIndices=[-1] * 2,
        linkPositions=[(0, 0, 0), (0, 0, -0.2)],
        linkOrientations=[(0, 0, 0, 1)] * 2,
        linkInertialFramePositions=[(0, 0, -0.1)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_REVOLUTE] * 2,
        linkJointAxis=[(0, 1, 0)] * 2,
        physicsClientId=client,
    )
    p.resetJointState(arm, 1, 0.3, 0, client)
    stand = block(client, 0, (1.0, 0, -0.2))
    line = world.add_ligament([(stand, -1, (0, 0, 0)), (arm, 0, (0, 0, -0.2))], bt.Material(stiffness=1.0))
    line.set_tension(10.0)
    world.relax(bodies=[(arm, [0])], tolerance=1e-8)
    assert world.report.converged
    angle, other = (p.getJointState(arm, joint, client)[0] for joint in (0, 1))
    assert other == 0.3
    tip = 0.2 * np.array([-math.sin(angle), 0, -math.cos(angle)])
    along = np.array([1.0, 0, -0.2]) - tip
    pull = 10.0 * along / np.linalg.norm(along)
    centres = tip / 2, tip + 0.1 * np.array([-math.sin(angle + 0.3), 0, -math.cos(angle + 0.3)])
    torque = np.cross(tip, pull) + sum(np.cross(centre, [0, 0, -G]) for centre in centres)
    assert abs(torque[1]) <= 1e-6


def pendulum(client):
    """1 kg on a hinge, at 0.1 m below it."""
    return p.createMultiBody(
        0,
        linkMasses=[1.0],
        linkCollisionShapeIndices=[-1],
        linkVisualShapeIndices=[-1],
        linkPositions=[(0, 0, 0)],
        linkOrientations=[(0, 0, 0, 1)],
        linkInertialFramePositions=[(0, 0, -0.1)],
        linkInertialFrameOrientations=[(0, 0, 0, 1)],
        linkParentIndices=[0],
        linkJointTypes=[p.JOINT_REVOLUTE],
        linkJointAxis=[(0, -1, 0)],
        physicsClientId=client,
    )


def test_a_load_that_nothing_holds_is_told(make_world, client, recwarn):
    """A force F across a pendulum of weight W, which follows it: F = W sin(angle), up to W."""
    world = make_world(1 / 240, (0, 0, -G))
    bob = pendulum(client)

    def relax(share, **kwargs):
        across = [(bob, 0, (share * G, 0.0, 0.0), (0, 0, 0), p.LINK_FRAME)]
        world.relax(bodies=[bob], tolerance=1e-9, max_steps=60, forces=across, **kwargs)
        return p.getJointState(bob, 0, client)[0]

    for share in (0.5, 0.9, 0.99, 0.999):
        assert relax(share) == pytest.approx(math.asin(share), abs=1e-6)
        assert world.report.converged
    assert not recwarn
    held = p.getJointState(bob, 0, client)[0]
    with pytest.warns(bt.EquilibriumWarning, match=rf"bodies \[{bob}\] was found in 60 steps.*put back"):
        assert relax(1.001) == held
    assert not world.report.converged
    with pytest.warns(bt.EquilibriumWarning, match="`within`.*last place"):
        assert relax(1.1, within=lambda: p.getJointState(bob, 0, client)[0] < 2.0) > held
    recwarn.clear()
    relax(1.1, quiet=True)
    assert not world.report.converged and not recwarn


def chain(client, mass):
    """A base with two links on hinges and one on a slider between them."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.02, 0.03], physicsClientId=client)
    hinge, slider = p.JOINT_REVOLUTE, p.JOINT_PRISMATIC
    made = p.createMultiBody(
        mass,
        shape,
        -1,
        (0.01, 0.02, 0.0),
        (0.1, 0.2, 0.3, 0.9),
        linkMasses=[1.0, 0.5, 0.7],
        linkCollisionShapeIndices=[shape] * 3,
        linkVisualShapeIndices=[-1] * 3,
        linkPositions=[(0, 0, -0.1), (0.02, 0, -0.1), (0, 0.03, -0.1)],
        linkOrientations=[(0, 0, 0, 1)] * 3,
        linkInertialFramePositions=[(0.01, 0, -0.05)] * 3,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 3,
        linkParentIndices=[0, 1, 2],
        linkJointTypes=[hinge, slider, hinge],
        linkJointAxis=[(0, 1, 0), (0.6, 0, 0.8), (1, 0, 0)],
        physicsClientId=client,
    )
    for link in range(-1, 3):
        p.setCollisionFilterGroupMask(made, link, 0, 0, client)
    for joint, angle in enumerate((0.4, 0.03, -0.7)):
        p.resetJointState(made, joint, angle, 0, client)
    return made


@pytest.mark.parametrize("base", ["fixed", "floating"])
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0)])
@pytest.mark.parametrize("loads", ["in the world", "on the link"])
def test_the_matrix_is_the_derivative_of_the_forces(make_world, client, base, order, loads):
    """By central differences, away from equilibrium, with gravity, forces and ligaments."""
    world = make_world(1 / 240, (0, 0, -G))
    made, stand = chain(client, 0.0 if base == "fixed" else 2.0), block(client, 0, (0.05, 0.1, 0.1))
    for link, end in ((-1, (0.01, 0.0, 0.02)), (0, (0, 0.01, 0)), (2, (0.01, 0.02, -0.03))):
        path = [(stand, -1, (0, 0, 0.01 * link)), (made, link, end)]
        world.add_ligament(path, bt.Material.ligament(3e2), rest_length=0.1)
    free = made if base == "floating" and len(order) == 3 else (made, list(order))
    forces = [((3.0, 2.0, -1.0), (0.01, 0.02, 0.03)), ((0.0, -4.0, 1.0), (-0.02, 0.0, 0.01))]
    follows = loads == "on the link"
    told = [(made, 2, *forces[0], follows), (made, 1, *forces[1], follows)]
    found = Equilibrium(world._bodies, world._core, world._obstacles.measure, [free], (0, 0, -G), told)
    place, size = found._place(), len(found._scales())
    found._put(place, np.zeros(size))
    matrix = found._terms().matrix
    slopes = np.zeros((size, size))
    for k in range(size):
        ends = []
        for side in (1e-6, -1e-6):
            step = side * np.eye(size)[k]
            found._put(place, step)
            ends.append(found._terms().force)
            if size == 9 and len(order) == 3:  # by components of one rotation vector of the base
                ends[-1][3:6] += np.cross(ends[-1][3:6], step[3:6]) / 2
        slopes[:, k] = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(matrix, -slopes, atol=1e-6 * np.abs(matrix).max())
    assert np.abs(matrix - matrix.T).max() > 1e-3 or not follows


def test_it_converges_as_newtons_method_does(make_world, client):
    """Under a force that follows, whose matrix is not symmetric: in the end right digits double."""
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    world.relax(bodies=[body], tolerance=1e-9)
    force = (body, -1, (4.0, 3.0, -2.0), (0.01, 0.0, -0.05), p.LINK_FRAME)
    kept = world.save_state()
    residuals = []
    for most in range(1, 25):
        world.restore_state(kept)
        world.relax(bodies=[body], tolerance=1e-11, max_steps=most, forces=[force], quiet=True)
        residuals.append(world.report.residual)
        if world.report.converged:
            break
    assert world.report.converged
    near = [residual for residual in residuals if residual < 1e-4]
    assert len(near) <= 3 and residuals[-2] <= 0.01 * residuals[-3]


@pytest.mark.parametrize("pull", [0.0, 3.0])
@pytest.mark.parametrize("start", [0.001, 0.005, 0.013, 0.03, 0.077])
def test_a_bead_on_a_rod_is_where_its_cord_is_balanced(make_world, client, start, pull):
    """A cord of constant tension from beside the rod. Beyond its distance h from the rod Newton's steps are
    too long: from x to -x^3/h^2 without a pull. So they could lead to and fro between two places for ever.
    """
    world = make_world(1 / 240, (0, 0, 0))
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.001, physicsClientId=client)
    rod = links_on_joints(client, p.JOINT_PRISMATIC, [0.1], [(1, 0, 0)], shape)
    stand, h, tension = block(client, 0), 0.005, 10.0
    line = world.add_ligament([(stand, -1, (0, 0, h)), (rod, 0, (0, 0, 0))], bt.Material(stiffness=1.0))
    line.set_tension(tension)
    p.resetJointState(rod, 0, start, 0, client)
    force = (rod, 0, (pull, 0, 0), (start, 0, 0), p.WORLD_FRAME)
    world.relax(bodies=[rod], tolerance=1e-9, max_steps=20, forces=[force])
    assert world.report.converged
    exact = h * pull / math.sqrt(tension**2 - pull**2)
    assert p.getJointState(rod, 0, client)[0] == pytest.approx(exact, abs=1e-9)


def test_a_body_whose_ligament_gets_slack_is_found(make_world, client):
    """In its toe the force falls to a quarter with each step. It is the only force."""
    world = make_world(1 / 240, (0, 0, 0))
    stand, body = block(client, 0), block(client, 0.5, (0, 0, -0.103))
    material = bt.Material.ligament(2e3, 0.06)
    line = world.add_ligament([(stand, -1, (0, 0, 0)), (body, -1, (0, 0, 0))], material, rest_length=0.1)
    world.relax(bodies=[body], tolerance=1e-6, max_steps=20)
    assert world.report.converged
    assert line.force <= 1e-6 * 0.5 * G
    assert place(body, client)[2] == pytest.approx(-0.1, abs=1e-5)


def test_what_hangs_on_nothing_is_put_back(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, body = block(client, 0), block(client, 1.0, (0, 0, -0.1))
    with pytest.warns(bt.SlackWarning):
        world.add_ligament([(stand, -1, (0, 0, 0)), (body, -1, (0, 0, 0))], bt.Material.ligament(1e3), 1e3)
    before = place(body, client)
    with pytest.warns(bt.EquilibriumWarning, match=f"20 steps: `max_steps` are used up. {G:.3g} N"):
        world.relax(bodies=[body], max_steps=20)
    assert not world.report.converged
    np.testing.assert_allclose(place(body, client), before, atol=1e-12)


def test_a_matrix_that_is_not_finite_finds_nothing_and_moves_nothing(make_world, client, monkeypatch):
    """Such as that of contacts that held particles contradict."""
    world = make_world(1 / 240, (0, 0, -G))
    _, *bodies = slung(world, client)
    stiffness = HeldTendons.stiffness
    monkeypatch.setattr(HeldTendons, "stiffness", lambda self: math.nan * stiffness(self))
    before = [place(body, client) for body in bodies]
    with pytest.warns(bt.EquilibriumWarning, match="not finite"):
        world.relax(bodies=bodies, max_steps=20)
    assert not world.report.converged
    np.testing.assert_allclose([place(body, client) for body in bodies], before, atol=1e-12)


def test_bad_calls_change_nothing(make_world, client):
    world = make_world()
    stand, body = block(client, 0), block(client, 1.0, (0, 0, -0.1))
    world.add_ligament([(stand, -1, (0, 0, 0)), (body, -1, (0, 0, 0))], bt.Material.ligament(1e3))
    for bodies, error in (
        (body, bt.InvalidType),
        ([stand], bt.InvalidValue),
        ([body, body], bt.InvalidValue),
        ([77], bt.UnknownId),
        ([(body, [0])], bt.InvalidValue),
    ):
        with pytest.raises(error):
            world.relax(bodies=bodies)
    for forces, error in (
        (3, bt.InvalidType),
        ([(body, -1, (1, 0, 0))], bt.InvalidType),
        ([(body, -1, (1, 0, math.nan), (0, 0, 0), p.WORLD_FRAME)], bt.InvalidValue),
        ([(body, -1, (1, 0, 0), (0, 0, 0), 7)], bt.InvalidValue),
        ([(body, 3, (1, 0, 0), (0, 0, 0), p.WORLD_FRAME)], bt.UnknownId),
        ([(stand, -1, (1, 0, 0), (0, 0, 0), p.WORLD_FRAME)], bt.InvalidValue),
    ):
        with pytest.raises(error):
            world.relax(bodies=[body], forces=forces)
    with pytest.raises(bt.InvalidValue):
        world.relax(forces=[(body, -1, (1, 0, 0), (0, 0, 0), p.WORLD_FRAME)])


def at_rest(world, bodies, client, steps=24, most=1e-7):
    """Whether nothing moves in steps."""
    before = [place(body, client) for body in bodies]
    world.step(steps)
    return max(np.abs(place(body, client) - x).max() for body, x in zip(bodies, before, strict=True)) <= most


def test_a_plate_on_four_tendons(make_world, client):
    """Of two stiffnesses; it tilts until the forces balance."""
    world = make_world(1 / 240, (0, 0, -G))
    body = block(client, 3.0, (0.0, 0.01, -0.12), (0.1, 0.08, 0.01))
    ropes, knots = [], []
    for x in (-0.1, 0.1):
        for y in (-0.08, 0.08):
            material = bt.Material(stiffness=5e3 * (1 + 3 * x), damping=10)
            rope = world.add_tendon([(x, y, 0), (x, y, -0.11)], 0.002, material, particles=15)
            rope.grip(0)
            ropes.append(rope)
            knots.append(rope.attach(-1, body, position=(x, y, 0.01)))
    world.relax(bodies=[body], tolerance=1e-9)
    assert world.report.converged and world.report.iterations <= 40
    weight = 3.0 * G + sum(rope.masses[-1] for rope in ropes) * G
    assert sum(rope.tension[-1] for rope in ropes) == pytest.approx(weight, rel=1e-3)
    assert sum(knot.force[2] for knot in knots) == pytest.approx(3.0 * G, rel=1e-6)
    assert at_rest(world, [body], client)


def over_a_drum(world, client, friction=0.0, particles=80):
    """Two weights on a tendon over a fixed drum; the lighter one is held back by a ligament."""
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.02, height=0.1, physicsClientId=client)
    lying = p.getQuaternionFromEuler((math.pi / 2, 0, 0))
    drum = p.createMultiBody(0, shape, -1, (0, 0, 0), lying, physicsClientId=client)
    world.add_obstacle(drum, friction=1.0)
    light = block(client, 1.0, (-0.0225, 0, -0.15), (0.01, 0.01, 0.01))
    heavy = block(client, 2.0, (0.0225, 0, -0.12), (0.01, 0.01, 0.01))
    turn = np.linspace(math.pi, 0, 30)
    arc = np.stack([0.0225 * np.cos(turn), 0 * turn, 0.0225 * np.sin(turn)], axis=1)
    points = [(-0.0225, 0, -0.14), *arc, (0.0225, 0, -0.11)]
    material = bt.Material(stiffness=2e4, damping=10, friction=friction)
    tendon = world.add_tendon(points, 0.002, material, particles)
    tendon.attach(0, light)
    tendon.attach(-1, heavy)
    stand = block(client, 0, (-0.0225, 0, -0.5))
    path = [(stand, -1, (0, 0, 0)), (light, -1, (0, 0, 0))]
    line = world.add_ligament(path, bt.Material.ligament(2e3), rest_length=0.345)
    return tendon, line, light, heavy


@pytest.mark.parametrize("particles", [60, 80, 140])
def test_two_weights_over_a_drum(make_world, client, particles):
    """Without friction the tension is the same all along, and the ligament bears the difference.

    The tendon begins straight beside the drum, without a strain, and buckles under its own weight.
    """
    world = make_world(1 / 240, (0, 0, -G))
    tendon, line, light, heavy = over_a_drum(world, client, particles=particles)
    world.relax(bodies=[light, heavy], tolerance=1e-8)
    assert world.report.converged
    np.testing.assert_allclose(tendon.tension[[0, -1]], 2 * G, rtol=3e-3)
    assert line.force == pytest.approx(1.0 * G, rel=5e-3)
    assert at_rest(world, [light, heavy], client, most=2e-8)


@pytest.mark.parametrize("particles", [40, 80])
@pytest.mark.parametrize("friction", [0.2, 0.3, 0.5])
def test_two_weights_over_a_rough_drum(make_world, client, friction, particles):
    """Friction holds what it can; the ligament bears the rest. No contact gives way from place to place."""
    world = make_world(1 / 240, (0, 0, -G))
    tendon, line, light, heavy = over_a_drum(world, client, friction, particles)
    world.relax(bodies=[light, heavy])
    assert world.report.converged
    assert world.report.iterations <= 80
    below, above = sorted(tendon.tension[[0, -1]])
    assert above == pytest.approx(2 * G, rel=3e-3)
    assert below == pytest.approx(1.0 * G + line.force, rel=3e-3)
    assert above <= 1.01 * math.exp(friction * math.pi) * below
    assert at_rest(world, [light, heavy], client, most=1e-6)


@pytest.mark.parametrize("damping, exponent", [(3.0, 1.0), (250.0, 1.0), (250.0, 2.0)])
def test_what_damping_alone_holds_is_not_at_rest(make_world, client, damping, exponent):
    """A light bead on a stiff cord between two hands: in a short step, damping holds it wherever it is."""
    world = make_world(1 / 240, (0, 0, -G), sleep=False)
    material = bt.Material(
        stiffness=1.4e6,
        exponent=2.0,
        toe_strain=0.03,
        tension_only=True,
        damping=damping,
        damping_exponent=exponent,
    )
    cord = world.add_tendon([(0, 0, 0), (0.24, 0, -0.028), (0.48, 0, 0)], 5e-4, material, particles=25)
    cord.grip(0), cord.grip(-1)
    cord.set_point_mass(14, 0.002)
    world.relax()
    assert world.report.converged
    world.step(10)
    assert np.abs(cord.velocities).max() <= 1e-6


def test_a_damped_tendon_is_followed_as_fast_as_one_without_damping(make_world, client):
    """Newton's matrix is that of tendons at rest: steps in which they are damped would mislead it."""
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    material = bt.Material(stiffness=1e5, damping=1e5)
    tendon = world.add_tendon([(0.06, 0, 0), (0.02, 0, -0.1)], 0.002, material, particles=20)
    tendon.attach(0, 0)
    tendon.attach(-1, body)
    world.relax(bodies=[body], tolerance=1e-9)
    for force, without in (((5, 3, 0), 13), ((5, -3, -10), 13), ((0, 0, -20), 7)):
        centre = p.getBasePositionAndOrientation(body, client)[0]
        world.relax(bodies=[body], tolerance=1e-9, forces=[(body, -1, force, centre, p.WORLD_FRAME)])
        assert world.report.converged and world.report.iterations <= without + 4


ON_A_CYLINDER = [  # N, coefficient, particles, mass [kg], radius of the cylinder, of the tendon, lengths [m]
    (3e3, 0.08, 53, 0.08, 0.0135, 2.5e-3, 0.03, 0.095),
    (5e4, 0.11, 64, 1.2, 0.012, 8e-4, 0.14, 0.072),
    (8e4, 0.4, 31, 0.12, 0.0105, 1.4e-3, 0.046, 0.14),
]


@pytest.mark.parametrize("stiffness, friction, particles, mass, big, small, held, hanging", ON_A_CYLINDER)
def test_a_weight_over_a_cylinder_with_friction(
    make_world, client, stiffness, friction, particles, mass, big, small, held, hanging
):
    """While the tendon is slack, contacts as stiff as in other steps would leave solutions unconverged."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=big, height=0.1, physicsClientId=client)
    lying = p.getQuaternionFromEuler((math.pi / 2, 0, 0))
    drum = p.createMultiBody(0, shape, -1, (0, 0, 0), lying, physicsClientId=client)
    world.add_obstacle(drum, friction=1.0)
    side, turn = big + small + 5e-4, np.linspace(math.pi, 0, 30)
    arc = np.stack([side * np.cos(turn), 0 * turn, side * np.sin(turn)], axis=1)
    points = [(-side, 0, -held), *arc, (side, 0, -hanging)]
    material = bt.Material(stiffness=stiffness, damping=1, friction=friction)
    tendon = world.add_tendon(points, small, material, particles)
    weight = block(client, mass, (side, 0, -hanging - 0.01), (0.005, 0.005, 0.005))
    tendon.grip(0)
    tendon.attach(-1, weight)
    world.relax(bodies=[weight])
    assert world.report.converged
    assert tendon.tension[-1] == pytest.approx(mass * G, rel=0.01)


@pytest.mark.parametrize(
    ("tilt", "width", "friction"),
    [(0.3, 0.8, 0), (0.45, 1.06, 0), (0.5, 0.95, 1), (0.8, 1.1, 1), (0.96, 0.56, 1), (1.0, 0.96, 5)],
)
def test_a_weight_hung_by_its_own_oblique_bore(make_world, client, tilt, width, friction):
    """Tied within the bore; width: of the tendon, over that of the mouths' narrow ends.

    About the vertical nothing resists: a torque that is not there would spin it for ever.
    """
    world = make_world(1 / 240, (0, 0, -G))
    mass, radius, height = 0.5, 0.005, 0.02
    body = block(client, mass, half=(0.03, 0.03, height))
    world.add_obstacle(body, friction=friction)
    way = np.array([height * math.tan(tilt), 0, height])
    world.add_tunnel(body, -1, -way, way, radius)
    points = np.vstack([np.linspace(-0.5 * way, way, 9), np.linspace(way, [0, 0, 0.15], 16)[1:]])
    tendon = world.add_tendon(points, width * radius * math.cos(tilt), bt.Material(stiffness=2e3))
    tendon.attach(0, body), tendon.grip(-1)
    world.relax(bodies=[body])
    assert world.report.converged
    assert tendon.tension[-1] == pytest.approx((mass + tendon.masses[:-1].sum()) * G, rel=1e-6)
    below = mass * place(body, client)[:2] + tendon.masses[:-1] @ tendon.positions[:-1, :2]
    np.testing.assert_allclose(below / mass, 0, atol=1e-7)  # of both together, from the line through the grip
    last = tendon.positions[-1] - tendon.positions[-2]
    forces = np.outer(tendon.masses, [0, 0, -G])
    forces[-1] = tendon.tension[-1] * last / np.linalg.norm(last)
    torque = np.cross(tendon.positions - place(body, client)[:3], forces).sum(axis=0)
    np.testing.assert_allclose(world.wrench(body)[3:], torque, atol=1e-9)


def slung(world, client):
    """Two weights on one tendon, which sags between two grips."""
    bodies = [
        block(client, mass, (x, 0.02, -0.06), (0.01, 0.01, 0.01)) for x, mass in ((-0.03, 1.0), (0.04, 2.0))
    ]
    points = [(-0.1, 0, 0), (-0.03, 0, -0.05), (0.04, 0, -0.05), (0.1, 0.03, 0)]
    material = bt.Material(stiffness=2e4, exponent=1.5, damping=10, bending_stiffness=1e-5)
    tendon = world.add_tendon(points, 0.002, material, particles=31)
    tendon.grip(0), tendon.grip(-1)
    arc = np.linalg.norm(tendon.positions - [[-0.03, 0, -0.05]], axis=1).argmin()
    other = np.linalg.norm(tendon.positions - [[0.04, 0, -0.05]], axis=1).argmin()
    for particle, body in ((arc, bodies[0]), (other, bodies[1])):
        tendon.attach(int(particle), body, position=(0, 0, 0.01))
    return tendon, *bodies


@pytest.mark.parametrize(("scene", "share"), [("slung", 1e-4), ("drum", 0.2)])
def test_the_stiffness_of_tendons_is_the_derivative_of_their_wrenches(make_world, client, scene, share):
    """And their motion by the links that of the particles. By central differences of tendons at rest.

    Contacts are softer in the matrix.
    """
    world = make_world(1 / 240, (0, 0, -G))
    if scene == "slung":
        tendon, *bodies = slung(world, client)
    else:
        tendon, _, *bodies = over_a_drum(world, client)
    world.relax(bodies=bodies)
    assert world.report.converged
    slots = [world._bodies.find_slot(body, -1) for body in bodies]
    start = [p.getBasePositionAndOrientation(body, client) for body in bodies]
    particles: list[np.ndarray] = []

    def wrenches(k, twist):
        centre, turn = start[k]
        turned = (Rotation.from_rotvec(twist[3:]) * Rotation.from_quat(turn)).as_quat()
        p.resetBasePositionAndOrientation(bodies[k], np.add(centre, twist[:3]), turned, client)
        kept = world.save_state()
        world._bodies.read()
        for _ in range(12):
            world._stepper.hold(1e4 if scene == "slung" else 1.0, (0, 0, -G))
            tendon._core.stop(tendon._slot)
        found = world._core.wrenches()[slots].reshape(-1)
        particles.append(tendon.positions.reshape(-1))
        world.restore_state(kept)
        world.remove_state(kept)
        p.resetBasePositionAndOrientation(bodies[k], centre, turn, client)
        return found

    world._core.want_tendon_stiffness(slots)
    wrenches(0, np.zeros(6))
    stiffness, motion = world._core.tendon_stiffness(), world._core.tendon_motion()
    world._core.want_tendon_stiffness([])
    size = np.abs(stiffness).max()
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-9 * size)
    for body, column in ((0, 2), (1, 2), (1, 0), (1, 4)):
        twist = 1e-6 * np.eye(6)[column]
        slope = (wrenches(body, twist) - wrenches(body, -twist)) / 2e-6
        exact = stiffness[:, 6 * body + column]
        if scene == "slung" and column > 2:  # of a rotation the matrix has the symmetric part
            exact, slope = exact[:3], slope[:3]
        np.testing.assert_allclose(slope, -exact, atol=share * max(np.abs(exact).max(), 1e-2 * size))
        moved = (particles[-2] - particles[-1]) / 2e-6
        np.testing.assert_allclose(moved, motion[6 * body + column], atol=share * np.abs(motion).max())


def through_a_moved_mouth(world, client, friction):
    """A tendon that is fixed in a tunnel of a body, and leaves it over the edge of the mouth."""
    centre = np.array([0.03, 0.02, -0.05])
    bone, top = block(client, 1.0, tuple(centre)), block(client, 0, (0.02, 0.0, 0.05))
    world.add_tunnel(bone, -1, -centre, np.array([0, 0, -0.06]) - centre, radius=4.5e-3, friction=friction)
    material = bt.Material(stiffness=8.5e3, damping=20.0)
    points = [(0, 0, -0.06), (0, 0, 0), (0.02, 0, 0.04)]
    tendon = world.add_tendon(points, 3.5e-3, material, particles=60, rest_length=0.1016)
    tendon.attach(0, bone)
    tendon.attach(-1, top)
    world.relax()
    assert world.report.converged and (world.contacts["kind"] == "mouth").any()
    return bone


@pytest.mark.parametrize("friction", [0.0, 0.2], ids=["slides", "sticks"])
def test_the_stiffness_of_tendons_knows_that_mouths_move_and_turn(make_world, client, friction):
    """By central differences; the steps that hold the body are short, and their inertia no part of it."""
    world = make_world(1 / 240, (0, 0, 0))
    bone = through_a_moved_mouth(world, client, friction)
    slots, rest = [world._bodies.find_slot(bone, -1)], world._relaxation()
    centre, turn = p.getBasePositionAndOrientation(bone, client)

    def wrench(twist):
        turned = (Rotation.from_rotvec(twist[3:]) * Rotation.from_quat(turn)).as_quat()
        p.resetBasePositionAndOrientation(bone, np.add(centre, twist[:3]), turned, client)
        world._bodies.read()
        for _ in range(6):
            assert rest.follow((0, 0, 0), 1e-9, 60)
        found = world._core.wrenches()[slots[0]].copy()
        found[3:] += np.cross(found[3:], twist[3:]) / 2  # by components of one rotation vector
        return found

    world._core.want_tendon_stiffness(slots)
    for back in (-3e-5, 0.0):  # from the limit of friction
        wrench(back * np.eye(6)[2])
    stiffness = world._core.tendon_stiffness()
    scale = np.array([1, 1, 1, 30, 30, 30])
    stiffness *= np.outer(scale, scale)
    for column in range(6):
        twist = 1e-6 * np.eye(6)[column]
        slope = scale * scale[column] * (wrench(twist) - wrench(-twist)) / 2e-6
        wrench(np.zeros(6))
        np.testing.assert_allclose(slope, -stiffness[:, column], atol=0.005 * np.abs(stiffness).max())
    world._core.want_tendon_stiffness([])


def test_a_body_on_a_loose_tendon_is_put_back(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    body = block(client, 1.0, (0, 0, -0.1))
    tendon = world.add_tendon([(0, 0, -0.2), (0, 0, -0.1)], 0.001, bt.Material(stiffness=1e3), particles=5)
    tendon.attach(-1, body)
    before, positions = place(body, client), tendon.positions
    with pytest.warns(bt.EquilibriumWarning, match="no equilibrium"):
        world.relax(bodies=[body], max_steps=20)
    assert not world.report.converged
    np.testing.assert_allclose(place(body, client), before, atol=1e-12)
    np.testing.assert_array_equal(tendon.positions, positions)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_slack_tendons_over_a_ball_come_to_rest(make_world, client, seed):
    """They come down by steps that are long, and not all solved."""
    rng = np.random.default_rng(seed)
    world = make_world(gravity=(0, 0, -9.81))
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, physicsClientId=client), friction=rng.uniform(0, 0.5))
    for _ in range(4):
        a, b = rng.uniform(-0.15, 0.15, (2, 3))
        a[2], b[2] = abs(a[2]) + 0.06, abs(b[2]) + 0.06
        line = [a, (a + b) / 2 + [0, 0, 0.1], b]
        t = world.add_tendon(line, 2e-3, bt.Material(stiffness=1e4, friction=0.2), 40)
        t.grip(0)
        t.grip(-1)
    world.relax()
    assert world.report.converged
    heights = [t.positions[:, 2].copy() for t in world.tendons]
    world.step(50)
    for t, z in zip(world.tendons, heights, strict=True):
        assert np.abs(t.positions[:, 2] - z).max() < 1e-4


def limited_chain(path, client, limits):
    """A chain of hinges and a slider with these limits, each link 0.1 m long and 0.2 kg."""
    inertia = '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>'
    text = '<robot name="chain"><link name="l0"/>'
    for k, (low, high) in enumerate(limits):
        kind, axis = ("prismatic", "0 0 1") if k == 2 else ("revolute", "0 1 0" if k % 2 else "1 0 0")
        text += (
            f'<link name="l{k + 1}"><inertial><origin xyz="0 0 -0.05"/><mass value="0.2"/>{inertia}'
            f'</inertial></link><joint name="j{k}" type="{kind}">'
            f'<parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<origin xyz="0 0 {-0.1 if k else 0}"/><axis xyz="{axis}"/>'
            f'<limit lower="{low}" upper="{high}" effort="1e3" velocity="1e3"/></joint>'
        )
    path.write_text(text + "</robot>", encoding="utf-8")
    flags = p.URDF_USE_INERTIA_FROM_FILE
    return p.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)


@pytest.mark.parametrize("seed", range(6))
def test_joints_stay_within_their_limits(make_world, client, tmp_path, seed):
    """The potential is that which a bounded minimiser finds, and the next steps stay there."""
    world, rng = make_world(1 / 240, (0, 0, -G)), np.random.default_rng(seed)
    limits = np.array([(-rng.uniform(0.05, 0.4), rng.uniform(0.05, 0.4)) for _ in range(4)])
    limits[2] *= 0.05
    arm = limited_chain(tmp_path / "chain.urdf", client, limits)
    joints = list(range(4))
    for joint in joints:
        p.setJointMotorControl2(arm, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    pulled = []
    for link, force in zip(joints, rng.uniform(0, 8, 4), strict=True):
        at = rng.uniform(-0.4, 0.4, 3)
        line = world.add_ligament([(arm, -1, tuple(at)), (arm, link, (0, 0, -0.1))], bt.Material(stiffness=1))
        line.set_tension(force)
        pulled.append((line, force))

    def potential(places):
        for joint, place in zip(joints, places, strict=True):
            p.resetJointState(arm, joint, place, 0, client)
        states = p.getLinkStates(arm, joints, 0, 1, client)
        return sum(0.2 * G * state[0][2] for state in states) + sum(f * line.length for line, f in pulled)

    best = minimize(potential, np.zeros(4), method="L-BFGS-B", bounds=limits, options={"ftol": 1e-15})
    stopped = (best.x <= limits[:, 0] + 1e-6) | (best.x >= limits[:, 1] - 1e-6)
    assert stopped.any()
    for joint in joints:
        p.resetJointState(arm, joint, 2 * limits[joint, 1], 0, client)  # beyond them
    world.relax(bodies=[arm])
    assert world.report.converged and world.report.iterations < 40
    found = np.array([state[0] for state in p.getJointStates(arm, joints, client)])
    assert (found >= limits[:, 0] - 1e-9).all() and (found <= limits[:, 1] + 1e-9).all()
    np.testing.assert_allclose(found, best.x, atol=1e-4)
    world.step(20)
    after = np.array([state[0] for state in p.getJointStates(arm, joints, client)])
    np.testing.assert_allclose(after, found, atol=1e-4)


def test_a_search_ends_at_the_last_place_that_is_allowed(make_world, client):
    """A block that hangs is pulled aside, and not so far where it may not go there."""
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    world.relax(bodies=[body], tolerance=1e-9)
    start = place(body, client)
    pull = [(body, -1, (60.0, 0.0, 0.0), start[:3], p.WORLD_FRAME)]

    def is_near() -> bool:
        return abs(place(body, client)[0] - start[0]) < 0.01

    world.relax(bodies=[body], tolerance=1e-9, forces=pull, within=is_near, quiet=True)
    moved = place(body, client)
    assert not world.report.converged and is_near() and moved[0] > start[0]
    world.relax(bodies=[body], tolerance=1e-9, forces=pull, within=lambda: True)
    found = place(body, client)
    assert world.report.converged and not is_near()
    world.relax(bodies=[body], tolerance=1e-9, within=lambda: False, quiet=True)
    assert not world.report.converged
    # pybullet does not return a rotation to the last bit as it was set.
    np.testing.assert_allclose(place(body, client), found, rtol=0, atol=1e-15)
    with pytest.raises(bt.InvalidType, match="within"):
        world.relax(bodies=[body], within=3)
    for wrong in (1, np.array([])):
        with pytest.raises(bt.InvalidType, match="quiet"):
            world.relax(bodies=[body], quiet=wrong)


def test_tendons_stay_with_a_body_that_a_search_has_led_to_the_last_place(make_world, client):
    world = make_world(1 / 240, (0, 0, 0))
    body = block(client, 1.0, (0.1, 0, 0))
    cord = world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, bt.Material(stiffness=100.0), particles=6)
    cord.grip(0)
    cord.attach(-1, body, position=(0, 0, 0))
    pull = [(body, -1, (200.0, 0.0, 0.0), (0.1, 0, 0), p.WORLD_FRAME)]
    world.relax(bodies=[body], forces=pull, within=lambda: place(body, client)[0] < 0.18, quiet=True)
    x = place(body, client)[0]
    assert not world.report.converged and 0.1 < x < 0.18
    np.testing.assert_allclose(cord.positions[-1], place(body, client)[:3], atol=1e-9)
    np.testing.assert_allclose(cord.tension, 100.0 * (x / 0.1 - 1), rtol=1e-4)
