"""Bodies: attachments at a link's own points, wrenches, and momentum of bodies and tendons together."""

import warnings

import numpy as np
import pybullet as p
import pytest
from link_scenes import cube, links_on_joints, triangles_shape

import bullet_tendon as bt

LENGTH, RADIUS, G = 0.3, 0.004, 9.81
ROPE = bt.Material(stiffness=3e3, damping=1.0)


def matrix(quaternion):
    return np.array(p.getMatrixFromQuaternion(quaternion)).reshape(3, 3)


def ball(client, position, mass=0.0, velocity=(0, 0, 0), spin=(0, 0, 0), **inertial):
    """A body without joints or damping; mass 0: static."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.03, 0.04], physicsClientId=client)
    body = p.createMultiBody(mass, shape, basePosition=position, physicsClientId=client, **inertial)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.resetBaseVelocity(body, velocity, spin, physicsClientId=client)
    return body


def momentum(client, bodies, tendons):
    total = sum((t.masses[:, None] * t.velocities).sum(0) for t in tendons)
    for body in bodies:
        mass = p.getDynamicsInfo(body, -1, client)[0]
        total = total + mass * np.array(p.getBaseVelocity(body, client)[0])
    return total


@pytest.mark.parametrize("iteration", ["newton", "single"])
@pytest.mark.parametrize("n", [2, 20])
def test_two_free_bodies_keep_their_momentum(make_world, client, n, iteration):
    world = make_world(1 / 240, iteration=iteration)
    a = ball(client, [0, 0, 0], 0.5, (0.1, 0.4, -0.2), (1, 0, 2))
    b = ball(client, [LENGTH + 0.02, 0, 0], 0.2, (0.6, -0.5, 0.1), (0, 3, 0))
    t = world.add_tendon([[0.02, 0, 0], [LENGTH, 0, 0]], RADIUS, ROPE, n)
    t.attach(0, a), t.attach(-1, b)
    before = momentum(client, [a, b], [t])
    pulled = 0.0
    for _ in range(1000):
        world.step()
        pulled = max(pulled, t.tension.max())
        now = momentum(client, [a, b], [t])
        assert np.abs(now - before).max() <= 1e-9 * np.abs(before).max()
    assert pulled > 1.0


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_three_bodies_keep_their_momentum(make_world, client, integrator):
    """The middle one carries the ends of two tendons."""
    world = make_world(1 / 240, integrator=integrator)
    places = [[0, 0, 0], [LENGTH, 0, 0], [LENGTH, LENGTH, 0]]
    bodies = [
        ball(client, x, m, v) for x, m, v in zip(places, (0.3, 0.1, 0.4), -np.eye(3)[::-1], strict=True)
    ]
    tendons = []
    for k in (0, 1):
        ends = np.add(places[k : k + 2], [[0, 0, 0], [0, 0.01, 0]])
        t = world.add_tendon(ends, RADIUS, ROPE, 10)
        t.attach(0, bodies[k], -1, [0, 0, 0]), t.attach(-1, bodies[k + 1], -1, [0, 0.01, 0])
        tendons.append(t)
    before = momentum(client, bodies, tendons)
    for _ in range(1000):
        world.step()
        assert np.abs(momentum(client, bodies, tendons) - before).max() <= 1e-9 * np.abs(before).max()


def test_a_hanging_weight(make_world, client):
    """Grip force, tension and the force on the body are its weight (and the tendon's)."""
    world, mass = make_world(1 / 240, (0, 0, -G), tolerance=1e-10), 0.7
    body = ball(client, [0, 0, -LENGTH - 0.04], mass)
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], RADIUS, bt.Material(stiffness=3e3, damping=60.0), 10)
    grip, attached = t.grip(0), t.attach(-1, body)
    world.step(1500)
    below = G * (mass + t.masses.sum() - np.cumsum(t.masses)[:-1])
    np.testing.assert_allclose(t.tension, below, rtol=1e-5)
    np.testing.assert_allclose(attached.force, [0, 0, G * mass], atol=1e-5 * G * mass)
    np.testing.assert_allclose(grip.force, [0, 0, -G * (mass + t.masses.sum())], atol=1e-5 * G * mass)
    np.testing.assert_allclose(world.wrench(body), [0, 0, G * mass, 0, 0, 0], atol=1e-4)


OFFSET = {
    "baseInertialFramePosition": [0.05, -0.02, 0.03],
    "baseInertialFrameOrientation": p.getQuaternionFromEuler([0.4, 0.2, -0.7]),
}
TURN = p.getQuaternionFromEuler([0.3, -0.5, 1.1])
POINT = np.array([0.07, 0.01, -0.04])


def turned_body(client, mass):
    """A body whose inertial frame is neither at its link frame's origin nor along its axes."""
    origin = np.array([0.4, -0.1, 0.2])
    return ball(client, origin, mass, baseOrientation=TURN, **OFFSET), origin, matrix(TURN)


@pytest.mark.parametrize("mass", [0.0, 0.6])
def test_attachment_points_are_in_the_urdf_frame(make_world, client, mass):
    world = make_world(1 / 240)
    body, origin, axes = turned_body(client, mass)
    exact = origin + axes @ POINT
    t = world.add_tendon([exact, exact + [0, 0, LENGTH]], RADIUS, ROPE, 6)
    named = t.attach(0, body, -1, POINT)
    np.testing.assert_array_equal(named.position, POINT)
    named.release()
    found = t.attach(0, body)
    np.testing.assert_allclose(found.position, POINT, atol=1e-12)
    world.step(3)
    np.testing.assert_allclose(t.positions[0], exact, atol=1e-12)
    assert (found.bodyUniqueId, found.linkIndex, found.particle) == (body, -1, 0)


def test_wrench_is_about_the_centre_of_mass_and_static_points_hold_exactly(make_world, client):
    world = make_world(10.0, (0, 0, -G), tolerance=1e-12)
    body, origin, axes = turned_body(client, 0.0)
    where, centre = origin + axes @ POINT, origin + axes @ OFFSET["baseInertialFramePosition"]
    t = world.add_tendon([where, where - [0, 0, LENGTH]], RADIUS, ROPE, 6)
    attached = t.attach(0, body, -1, POINT)
    pull = np.array([0.3, -0.2, 0.4])
    t.set_force(-1, pull)
    world.step(40)
    np.testing.assert_allclose(t.positions[0], where, atol=1e-14)
    force = pull - [0, 0, G * t.masses.sum()]
    np.testing.assert_allclose(attached.force, force, atol=1e-7)
    exact = [*attached.force, *np.cross(where - centre, attached.force)]
    np.testing.assert_allclose(world.wrench(body), exact, atol=1e-12)
    assert (world.wrench(ball(client, [5, 0, 0])) == 0).all()


def nested(client, base_mass=0.0):
    """A base (mass 0: fixed) with two links on hinges, each with its own turned inertial frame."""
    links = {
        "linkMasses": [0.3, 0.2],
        "linkCollisionShapeIndices": [-1, -1],
        "linkVisualShapeIndices": [-1, -1],
        "linkPositions": [[0.1, 0, 0], [0, 0.2, 0]],
        "linkOrientations": [p.getQuaternionFromEuler([0.2, 0, 0.5]), p.getQuaternionFromEuler([0, 0.6, 0])],
        "linkInertialFramePositions": [[0.02, 0.01, 0], [0, -0.03, 0.01]],
        "linkInertialFrameOrientations": [p.getQuaternionFromEuler([0.5, 0, 0]), [0, 0, 0, 1]],
        "linkParentIndices": [0, 1],
        "linkJointTypes": [p.JOINT_REVOLUTE, p.JOINT_REVOLUTE],
        "linkJointAxis": [[0, 0, 1], [0, 1, 0]],
    }
    place = {"basePosition": [0.2, 0.1, 0.3], "baseOrientation": TURN}
    body = p.createMultiBody(base_mass, physicsClientId=client, **place, **links)
    for link in (-1, 0, 1):
        inertia = {} if base_mass == 0 else {"localInertiaDiagonal": [3e-4, 2e-4, 4e-4]}
        p.changeDynamics(body, link, linearDamping=0, angularDamping=0, physicsClientId=client, **inertia)
    for joint, angle in ((0, 0.4), (1, -0.7)):
        p.resetJointState(body, joint, angle, physicsClientId=client)
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        p.changeDynamics(
            body, joint, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=client
        )
    return body


def frame_by_hand(client, body, link):
    """Origin and axes of a link's URDF frame from its centre of mass, in double precision."""
    state = p.getLinkState(body, link, computeForwardKinematics=True, physicsClientId=client)
    info = p.getDynamicsInfo(body, link, client)
    axes = matrix(state[1]) @ matrix(info[4]).T
    return np.array(state[0]) - axes @ info[3], axes, np.array(state[0])


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("base_mass", [0.0, 0.4])
@pytest.mark.parametrize("link", [0, 1])
def test_points_of_nested_links(make_world, client, link, base_mass, integrator):
    """Their frames, their wrenches, and how far joints and a floating base let them yield in a step."""
    world = make_world(1 / 960, integrator=integrator)
    body = nested(client, base_mass)
    origin, axes, centre = frame_by_hand(client, body, link)
    where = origin + axes @ POINT
    t = world.add_tendon([where, where + [0, 0, LENGTH]], RADIUS, bt.Material(stiffness=300.0), 6)
    a = t.attach(0, body, link)
    np.testing.assert_allclose(a.position, POINT, atol=1e-9)
    t.grip(-1, where + [0.02, 0, LENGTH * 1.01])
    for step in range(30):
        before = where
        world.step()
        if step == 0:
            exact = [*a.force, *np.cross(where - centre, a.force)]
            np.testing.assert_allclose(world.wrench(body, link), exact, atol=1e-9)
        origin, axes, _ = frame_by_hand(client, body, link)
        where = origin + axes @ POINT
        yielded = np.linalg.norm(where - before)
        away = np.linalg.norm(t.positions[0] - where)
        assert away <= (0.01 * yielded if step == 0 else 2e-4)
        assert world.report.converged


@pytest.mark.parametrize("base_mass", [0.0, 9.0])
def test_links_on_fixed_joints_are_parts_of_their_base(make_world, client, base_mass):
    """They stay where a static base is, and yield with the whole body's mass where it is free."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client)
    links = {"linkCollisionShapeIndices": [shape], "linkVisualShapeIndices": [-1]}
    links |= dict.fromkeys(("linkOrientations", "linkInertialFrameOrientations"), [[0, 0, 0, 1]])
    links |= {"linkMasses": [1.0], "linkPositions": [[0.3, 0, 0]], "linkInertialFramePositions": [[0, 0, 0]]}
    links |= {"linkParentIndices": [0], "linkJointTypes": [p.JOINT_FIXED], "linkJointAxis": [[0, 0, 1]]}
    body = p.createMultiBody(base_mass, shape, physicsClientId=client, **links)
    for link in (-1, 0):
        p.changeDynamics(body, link, linearDamping=0, angularDamping=0, physicsClientId=client)
    world, pull = make_world(1 / 240), np.array([20.0, 0, 0])
    t = world.add_tendon([[0.3, 0, 0], [0.3 + LENGTH, 0, 0]], RADIUS, ROPE, 8)
    t.attach(0, body, 0)
    t.set_force(-1, pull)
    for _ in range(100):
        before = np.array(p.getLinkState(body, 0, 0, 1, client)[0])
        speed = np.array(p.getBaseVelocity(body, client)[0])
        world.step()
        drift = t.positions[0] - before - speed / 240
        yields = 0.0 if base_mass == 0 else world.wrench(body, 0)[0] / 10 / 240**2
        np.testing.assert_allclose(drift, [yields, 0, 0], atol=1e-9)
    if base_mass:
        speed = np.array(p.getBaseVelocity(body, client)[0])
        both = 10 * speed + (t.masses[:, None] * t.velocities).sum(0)
        np.testing.assert_allclose(both, pull * 100 / 240, rtol=1e-9, atol=1e-9)


def test_wrenches_move_a_body_as_newton_says(make_world, client):
    """Force and torque of one step change velocity and spin of a turned body by h F/m and h I^-1 tau."""
    h = 1e-3
    world = make_world(h)
    body, origin, axes = turned_body(client, 0.6)
    where = origin + axes @ POINT
    t = world.add_tendon([where, where + [LENGTH, 0, 0]], RADIUS, ROPE, 6)
    t.attach(0, body, -1, POINT)
    t.set_positions(t.positions + np.linspace(0, 0.01, 6)[:, None] * [1, 0, 0])
    world.step()
    wrench, info = world.wrench(body), p.getDynamicsInfo(body, -1, client)
    inertial = axes @ matrix(info[4])
    velocity, spin = p.getBaseVelocity(body, client)
    assert np.abs(wrench[3:]).max() > 1e-3
    np.testing.assert_allclose(velocity, h * wrench[:3] / 0.6, rtol=1e-6, atol=1e-9)
    expected = h * inertial @ ((inertial.T @ wrench[3:]) / info[2])
    np.testing.assert_allclose(spin, expected, rtol=1e-5, atol=1e-7)


def test_released_attachments_put_no_force_on_the_body(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    body = ball(client, [0, 0, 0])
    t = world.add_tendon([[0, 0, -0.04], [0, 0, -LENGTH]], RADIUS, ROPE, 6)
    a = t.attach(0, body)
    world.step(20)
    assert world.wrench(body)[2] < -1e-3
    a.release()
    world.step()
    assert (world.wrench(body) == 0).all()
    assert (a.force == 0).all()


def test_bodies_are_listed_anew_once_after_one_was_removed(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, ROPE, 4).grip(0)
    bodies = [ball(client, (0, y, 0)) for y in (1.0, 2.0)]
    for body in bodies:
        world.add_obstacle(body)
    world.step()
    world.remove_obstacle(bodies[0])
    p.removeBody(bodies[0], client)
    world.step()
    listed = world._bodies._generalized()
    world.step()
    assert world._bodies._generalized() is listed


@pytest.mark.parametrize("joint", [None, p.JOINT_REVOLUTE, p.JOINT_PRISMATIC])
@pytest.mark.parametrize("mass", [0.0, 1.0])
@pytest.mark.parametrize("kind", ["triangles", "with inertia", "hull", "no shape"])
def test_a_link_that_pybullet_does_not_turn_is_told(make_world, client, kind, mass, joint):
    world = make_world()
    vertices, faces = cube(0.1)
    shape = triangles_shape(client, vertices, faces)
    if kind == "hull":
        shape = p.createCollisionShape(p.GEOM_MESH, vertices=vertices.tolist(), physicsClientId=client)
    shape = -1 if kind == "no shape" else shape
    if joint is None:
        body, link = p.createMultiBody(mass, shape, physicsClientId=client), -1
    else:
        body, link = links_on_joints(client, joint, [mass], [(0, 0, 1)], shape, [(0, 0, 0)]), 0
    if kind == "with inertia":
        p.changeDynamics(body, link, localInertiaDiagonal=[0.01] * 3, physicsClientId=client)
    t = world.add_tendon([(0, 0, 0.1), (0, 0, 0.3)], 0.001, bt.Material(stiffness=100.0), 5)
    t.attach(0, body, link)
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        world.step(3)
    told = [str(warning.message) for warning in given if warning.category is bt.InertiaWarning]
    assert len(told) == (kind == "triangles" and mass > 0 and joint != p.JOINT_PRISMATIC)
    assert all(f"body {body}, link {link} has a mass of 1 kg and no inertia" in message for message in told)
