"""BDF2 of tendons on articulated bodies: order, momentum, joint limits.

pybullet starts a body at rest with the velocity after a whole step: paths are those half a step later. The
vibration along the tendons is damped: no step would resolve it.
"""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import bullet_tendon as bt

G = 9.81
HALF = (0.1, 0.01, 0.02)  # m, half extents of a link
LENGTH, MASS = 0.2, 0.5  # of a link [m], [kg]
STIFFNESS, DAMPING = 3e3, 30.0
MATERIAL = bt.Material(stiffness=STIFFNESS, damping=DAMPING, density=1e-3)
NO_MOTOR = {"positionGain": 0, "velocityGain": 0, "force": [0, 0, 0]}


def chain(client, joints, axes, base_mass=0.0):
    """A base and two links along x, on joints at its end; without motors, damping and collisions."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=HALF, physicsClientId=client)
    body = p.createMultiBody(
        base_mass,
        shape,
        linkMasses=[MASS] * 2,
        linkCollisionShapeIndices=[shape] * 2,
        linkVisualShapeIndices=[-1] * 2,
        linkPositions=[(LENGTH / 2, 0, 0), (LENGTH, 0, 0)],
        linkOrientations=[(0, 0, 0, 1)] * 2,
        linkInertialFramePositions=[(LENGTH / 2, 0, 0)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=joints,
        linkJointAxis=axes,
        physicsClientId=client,
    )
    for link in range(-1, 2):
        p.changeDynamics(body, link, **UNDAMPED, physicsClientId=client)
        p.setCollisionFilterGroupMask(body, link, 0, 0, client)
    for joint, kind in enumerate(joints):
        if kind == p.JOINT_SPHERICAL:
            p.setJointMotorControlMultiDof(
                body, joint, p.POSITION_CONTROL, [0, 0, 0, 1], **NO_MOTOR, physicsClientId=client
            )
        else:
            p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


def tie(world, top, end, body, link, particles=2, material=MATERIAL):
    """A tendon from a hand to a link, taut by a thousandth."""
    rest = np.linalg.norm(np.subtract(top, end)) / 1.001
    tendon = world.add_tendon([top, end], 1e-4, material, particles, rest_length=rest)
    return tendon, tendon.grip(0), tendon.attach(-1, body, link)


def centre(client, body, link=1):
    return np.array(p.getLinkState(body, link, 0, 1, client)[0])


# An arm of two hinges, against Lagrange's equations in the angles of its links from x towards -z


ANGLES, ANCHOR = np.array([0.2, 0.7]), np.array([0.45, 0.2])  # rad; x and z of the hand [m]


def direction(angle):
    return np.array([np.cos(angle), -np.sin(angle)])


def across(angle):
    return np.array([-np.sin(angle), -np.cos(angle)])


def arm_rates(state, rest):
    """Rates of the angles and of their rates: a double pendulum of rods whose tip a spring pulls."""
    inertia = MASS * (HALF[0] ** 2 + HALF[2] ** 2) / 3
    angles, spins = state[:2], state[2:]
    tip = LENGTH * (direction(angles[0]) + direction(angles[1]))
    speed = LENGTH * (spins[0] * across(angles[0]) + spins[1] * across(angles[1]))
    far = np.linalg.norm(tip - ANCHOR)
    along = (tip - ANCHOR) / far
    pull = -(STIFFNESS * (far - rest) + DAMPING * speed @ along) / rest * along
    both = MASS * LENGTH**2 / 2
    quarter = inertia + MASS * LENGTH**2 / 4
    coupled = both * np.cos(angles[0] - angles[1])
    matrix = [[quarter + MASS * LENGTH**2, coupled], [coupled, quarter]]
    turning = both * np.sin(angles[0] - angles[1]) * np.array([-(spins[1] ** 2), spins[0] ** 2])
    weight = MASS * G * LENGTH * np.array([1.5, 0.5]) * np.cos(angles)
    by_tip = LENGTH * np.array([pull @ across(a) for a in angles])
    return np.concatenate([spins, np.linalg.solve(matrix, turning + weight + by_tip)])


def arm_error(make_world, client, dt, integrator, seconds=1.0):
    """RMS over the length, of the second link's centre."""
    world = make_world(dt, (0, 0, -G), integrator=integrator, sleep=False)
    body = chain(client, [p.JOINT_REVOLUTE] * 2, [(0, 1, 0)] * 2)
    p.resetJointState(body, 0, ANGLES[0], 0, client)
    p.resetJointState(body, 1, ANGLES[1] - ANGLES[0], 0, client)
    hinge = np.array([LENGTH / 2, 0.0])
    tip = hinge + LENGTH * (direction(ANGLES[0]) + direction(ANGLES[1]))
    top = hinge + ANCHOR
    tendon, *_ = tie(world, (top[0], 0, top[1]), (tip[0], 0, tip[1]), body, 1)
    found = []
    for _ in range(round(seconds / dt)):
        world.step()
        found.append(centre(client, body)[[0, 2]] - hinge)
    times = dt * (1.5 + np.arange(len(found)))
    start = [*ANGLES, 0, 0]
    exact = solve_ivp(
        lambda _, y: arm_rates(y, tendon.rest_length),
        (0, times[-1]),
        start,
        "DOP853",
        times,
        rtol=1e-10,
        atol=1e-12,
    ).y
    path = LENGTH * (direction(exact[0]) + direction(exact[1]) / 2).T
    return np.sqrt(np.mean(np.sum((found - path) ** 2, 1))) / LENGTH


def test_an_arm_swings_with_second_order(make_world, client):
    coarse, fine = (arm_error(make_world, client, dt, "bdf2") for dt in (1 / 480, 1 / 960))
    first = arm_error(make_world, client, 1 / 960, "implicit_euler")
    assert 1.9 <= np.log2(coarse / fine) <= 2.1
    assert fine < first / 30


# Other joints, against a short step

SLANTED = [(0, 1, 0), (0, 0.6, 0.8)]
ROBOTS = {
    "hinges": ([p.JOINT_REVOLUTE] * 2, SLANTED, 0.0),
    "slider": ([p.JOINT_REVOLUTE, p.JOINT_PRISMATIC], [(0, 1, 0), (1, 0, 0)], 0.0),
    "balls": ([p.JOINT_SPHERICAL] * 2, SLANTED, 0.0),
    "floating hinges": ([p.JOINT_REVOLUTE] * 2, SLANTED, 0.4),
    "floating balls": ([p.JOINT_SPHERICAL] * 2, SLANTED, 0.4),
}


def robot_path(make_world, client, dt, robot, seconds):
    p.resetSimulation(client)
    world = make_world(dt, (0, 0, -G), integrator="bdf2", sleep=False)
    joints, axes, base_mass = ROBOTS[robot]
    body = chain(client, joints, axes, base_mass)
    tie(world, (0.4, 0.2, 0.3), (0.5, 0.02, 0), body, 1)
    if base_mass:
        tie(world, (-0.1, 0.1, 0.3), (-0.05, 0, 0.01), body, -1)
    found = []
    for _ in range(round(seconds / dt)):
        world.step()
        found.append(centre(client, body))
    return dt * (1.5 + np.arange(len(found))), np.array(found)


@pytest.mark.parametrize("robot", ROBOTS)
def test_robots_swing_with_second_order(make_world, client, robot):
    exact = CubicSpline(*robot_path(make_world, client, 1 / 8000, robot, 0.31))
    errors = []
    for dt in (1 / 480, 1 / 960):
        times, found = robot_path(make_world, client, dt, robot, 0.3)
        errors.append(np.sqrt(np.mean(np.sum((found - exact(times)) ** 2, 1))))
    assert np.log2(errors[0] / errors[1]) >= 1.9


def plate_path(make_world, client, dt, seconds):
    """Of a corner of a free plate that tumbles on a tendon at its opposite corner."""
    p.resetSimulation(client)
    world = make_world(dt, (0, 0, -G), integrator="bdf2", sleep=False)
    half = np.array([0.1, 0.05, 0.01])
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half.tolist(), physicsClientId=client)
    body = p.createMultiBody(MASS, shape, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    tendon = world.add_tendon([(0.1, 0.2, 0.3), (0.09, 0.04, 0.01)], 1e-4, MATERIAL, 2)
    tendon.grip(0), tendon.attach(-1, body)
    found = []
    for _ in range(round(seconds / dt)):
        world.step()
        at, turned = p.getBasePositionAndOrientation(body, client)
        found.append(at + np.reshape(p.getMatrixFromQuaternion(turned), (3, 3)) @ half)
    return dt * (1.5 + np.arange(len(found))), np.array(found)


def test_a_free_body_tumbles_with_second_order(make_world, client):
    """Its spin and the torque on it are not parallel."""
    exact = CubicSpline(*plate_path(make_world, client, 1 / 8000, 1.01))
    errors = []
    for dt in (1 / 480, 1 / 960):
        times, found = plate_path(make_world, client, dt, 1.0)
        errors.append(np.sqrt(np.mean(np.sum((found - exact(times)) ** 2, 1))))
    assert errors[1] <= 2e-4
    assert np.log2(errors[0] / errors[1]) >= 1.9


# Momentum


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_wrenches_on_links_are_what_the_tendons_lack(make_world, client, integrator):
    world = make_world(1 / 240, (0, 0, -G), integrator=integrator, tolerance=1e-12)
    body = chain(client, *ROBOTS["hinges"][:2])
    heavy = bt.Material(stiffness=STIFFNESS, density=1e7)
    tendons, hands, _ = zip(
        tie(world, (0.4, 0.2, 0.3), (0.5, 0.02, 0), body, 1, 8, heavy),
        tie(world, (0.1, 0.1, 0.2), (0.2, 0, 0), body, 0, 8, heavy),
        strict=True,
    )
    for _ in range(120):
        before = [t.velocities for t in tendons]
        world.step()
        lack = sum(
            t.masses @ (t.velocities - v) * 240 - t.masses.sum() * np.array([0, 0, -G])
            for t, v in zip(tendons, before, strict=True)
        )
        given = sum(h.force for h in hands) + world.wrench(body, 0)[:3] + world.wrench(body, 1)[:3]
        np.testing.assert_allclose(lack + given, 0, atol=1e-9)


# Joint limits


def test_a_limit_that_stops_an_arm_begins_anew(make_world, client):
    """A link of 0.5 kg is drawn against its limit at some rad/s: it stays behind it by less than 2e-3 rad."""
    world = make_world(1 / 240, (0, 0, -G), integrator="bdf2")
    body = chain(client, [p.JOINT_REVOLUTE] * 2, [(0, 1, 0)] * 2)
    p.changeDynamics(body, 0, jointLowerLimit=-0.3, jointUpperLimit=0.3, physicsClientId=client)
    p.changeDynamics(body, 1, jointLowerLimit=-0.3, jointUpperLimit=0.3, physicsClientId=client)
    p.syncBodyInfo(client)
    tendon, hand, hold = tie(world, (0.4, 0, 0.5), (0.5, 0, 0), body, 1)
    hand.target = (0.4, 0, 0.8)
    fastest, farthest = 0.0, 0.0
    for _ in range(240):
        world.step()
        angles, rates = np.transpose([p.getJointState(body, k, client)[:2] for k in range(2)])
        fastest, farthest = max(fastest, np.abs(rates).max()), max(farthest, np.abs(angles).max())
    assert fastest > 2
    assert farthest <= 0.3 + 2e-3
    assert np.abs(rates).max() < 1e-2
    assert hold.force[2] == pytest.approx(tendon.tension[0], rel=0.05)


# State


def test_a_saved_state_of_a_swinging_arm_continues_with_the_same_bits(make_world, client):
    world = make_world(1 / 240, (0, 0, -G), integrator="bdf2")
    body = chain(client, *ROBOTS["floating hinges"][:2], 0.4)
    tendon, *_ = tie(world, (0.4, 0.2, 0.3), (0.5, 0.02, 0), body, 1, 8)
    tie(world, (-0.1, 0.1, 0.3), (-0.05, 0, 0.01), body, -1)
    world.step(20)
    ours, bullets = world.save_state(), p.saveState(client)
    world.step(20)
    right, hashed = tendon.positions, world.state_hash()
    world.restore_state(ours)
    p.restoreState(bullets, physicsClientId=client)
    world.step(20)
    assert np.array_equal(tendon.positions, right)
    assert world.state_hash() == hashed
