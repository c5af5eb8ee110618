"""Jaws on motors, whose limits pybullet does not report, close on a cord and lift it."""

import numpy as np
import pybullet as p
import pybullet_data
import pytest

import bullet_tendon as bt

CENTRE, HALF = 0.045, 0.005  # of a jaw, from the middle, at joint position 0; half of its thickness [m]
CLOSED = 0.04  # way of a jaw to the middle, where its joint ends [m]
HEIGHT, LIFT = 0.27, 0.2  # of the cord before it is lifted; how far it is lifted [m]


def jaws(client, mass, base_mass):
    """A base with two jaws on slides. It hangs on a fixed constraint, or stands still without mass."""
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, HALF, 0.02], physicsClientId=client)
    body = p.createMultiBody(
        base_mass, basePosition=(0, 0, HEIGHT + 0.03), linkMasses=[mass, mass],
        linkCollisionShapeIndices=[box, box], linkVisualShapeIndices=[-1, -1],
        linkPositions=[[0, CENTRE, -0.03], [0, -CENTRE, -0.03]], linkOrientations=[[0, 0, 0, 1]] * 2,
        linkInertialFramePositions=[[0, 0, 0]] * 2, linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
        linkParentIndices=[0, 0], linkJointTypes=[p.JOINT_PRISMATIC] * 2,
        linkJointAxis=[[0, 1, 0], [0, -1, 0]], physicsClientId=client,
    )  # fmt: skip
    for joint in (0, 1):
        limits = {"jointLowerLimit": -CLOSED, "jointUpperLimit": 0.01}
        p.changeDynamics(body, joint, lateralFriction=1.0, **limits, physicsClientId=client)
    if base_mass == 0:
        return body, None
    held = p.createConstraint(
        body, -1, -1, -1, p.JOINT_FIXED, (0, 0, 0), (0, 0, 0), (0, 0, HEIGHT + 0.03), physicsClientId=client
    )
    return body, held


def step(world, links):
    """Normal forces on these links in a step, and whether its stops go in circles, which it tells."""
    world.step()
    assert world.report.converged or world.report.ended_by == "stops"
    contacts = world.contacts
    forces = [contacts["normal_force"][contacts["linkIndex"] == link].sum() for link in links]
    return forces, not world.report.converged


@pytest.mark.parametrize(
    ("mass", "base_mass", "force", "radius", "speed", "dt"),
    [
        (0.1, 1.0, 20.0, 0.006, 0.1, 1 / 240),
        (0.5, 1.0, 20.0, 0.006, 0.1, 1 / 240),  # what holds the base is no hold that was found to be released
        (0.3, 1.0, 100.0, 0.006, 0.1, 1 / 240),
        (2.0, 1.0, 20.0, 0.006, 0.1, 1 / 240),  # pybullet's sweeps over jaws heavier than their base diverge
        (2.0, 1.0, 13.8, 0.002, 0.5, 1 / 240),
        (2.0, 0.5, 60.0, 0.006, 0.5, 1 / 120),
        (2.0, 0.5, 30.0, 0.002, 0.5, 1 / 120),  # a limit is nearer than what the motors aim at
        (2.0, 0.5, 30.0, 0.002, 5.0, 1 / 120),
        (
            2.8,
            0.43,
            300.0,
            0.004,
            0.5,
            1 / 120,
        ),  # forces of held jaws would throw them onto their other limit
        (0.05, 0.0, 50.0, 0.004, 0.1, 1 / 500),
    ],
)
def test_jaws_press_on_a_cord_with_what_their_motors_give(
    make_world, client, mass, base_mass, force, radius, speed, dt
):
    """Statics: each jaw presses with the force of its motor, and friction carries the cord."""
    world = make_world(dt, (0, 0, -9.81))
    body, held = jaws(client, mass, base_mass)
    for joint in (0, 1):
        world.add_obstacle(body, joint)
    material = bt.Material.from_modulus(2e8, radius, friction=0.9)
    cord = world.add_tendon([(-0.25, 0.002, HEIGHT), (0.25, 0.002, HEIGHT)], radius, material, 40)
    hands = [cord.grip(0), cord.grip(-1)]
    unsettled = 0

    def run(seconds, lift=0.0):
        """The largest rate of a jaw [m/s], and the last forces on both [N]."""
        nonlocal unsettled
        fastest, steps = 0.0, round(seconds / dt)
        for k in range(steps):
            for joint in (0, 1):
                p.setJointMotorControl2(
                    body,
                    joint,
                    p.VELOCITY_CONTROL,
                    targetVelocity=-speed,
                    force=force,
                    physicsClientId=client,
                )
            if lift and held is not None:
                at = (0, 0, HEIGHT + 0.03 + lift * (k + 1) / steps)
                p.changeConstraint(held, at, maxForce=1e4, physicsClientId=client)
            forces, circles = step(world, (0, 1))
            unsettled += circles
            fastest = max(fastest, *(abs(p.getJointState(body, j, client)[1]) for j in (0, 1)))
        return fastest, forces

    fastest, forces = run(0.8)
    closing = min(speed, np.sqrt(2 * force * CLOSED / mass))
    assert fastest < 1.1 * closing + 0.3  # thrown off, they reach 100 m/s
    assert forces == pytest.approx([force, force], rel=0.02)
    positions = [p.getJointState(body, joint, client)[0] for joint in (0, 1)]
    assert sum(positions) == pytest.approx(2 * (radius + HALF - CENTRE), abs=0.05 * radius)
    for hand in hands:
        hand.release()
    assert run(1.0, LIFT)[0] < 1.0
    assert unsettled <= 1
    lifted = LIFT if held is not None else 0
    assert cord.positions[:, 2].max() == pytest.approx(HEIGHT + lifted, abs=0.02)


@pytest.mark.parametrize(("force", "dt"), [(20.0, 1 / 240), (200.0, 1 / 240), (20.0, 1 / 1000)])
def test_a_panda_picks_up_a_cord(make_world, client, force, dt):
    """Position motors in all joints. The fingers close on a cord on the floor, and the hand goes up.

    The cord may rock between the facets of the fingers from step to step: forces are those of 20 steps.
    """
    world = make_world(dt, (0, 0, -9.81))
    p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
    floor = p.loadURDF("plane.urdf", physicsClientId=client)
    arm = p.loadURDF("franka_panda/panda.urdf", useFixedBase=True, physicsClientId=client)
    fingers, tip = (9, 10), 11
    for joint, angle in enumerate((0, -0.215, 0, -2.57, 0, 2.356, 2.356)):
        p.resetJointState(arm, joint, angle, physicsClientId=client)
    for joint in fingers:
        p.resetJointState(arm, joint, 0.04, physicsClientId=client)
    world.add_obstacle(floor)
    for link in (8, *fingers):
        world.add_obstacle(arm, link)
    radius = 0.006
    material = bt.Material.from_modulus(5e6, radius, friction=0.6)
    cord = world.add_tendon([(0.25, 0, radius), (0.75, 0, radius)], radius, material, 40)
    down = p.getQuaternionFromEuler((np.pi, 0, 0))

    def lead(seconds, low, high, width):
        """The mean forces on both fingers in the last 20 steps [N]."""
        steps, forces = round(seconds / dt), []
        for k in range(steps):
            height = low + (high - low) * (k + 1) / steps
            angles = p.calculateInverseKinematics(
                arm, tip, (0.5, 0, height), down, maxNumIterations=100, residualThreshold=1e-6,
                physicsClientId=client,
            )  # fmt: skip
            for joint in range(7):
                p.setJointMotorControl2(
                    arm, joint, p.POSITION_CONTROL, angles[joint], force=240, physicsClientId=client
                )
            for joint in fingers:
                motor = {"force": force, "maxVelocity": 0.1, "physicsClientId": client}
                p.setJointMotorControl2(arm, joint, p.POSITION_CONTROL, width, **motor)
            pressed, circles = step(world, fingers)
            assert not circles
            forces.append(pressed)
        return np.mean(forces[-20:], axis=0)

    lead(1.0, 0.0115, 0.0115, 0.04)
    assert lead(0.8, 0.0115, 0.0115, 0.0) == pytest.approx([force, force], rel=0.02)
    lead(1.0, 0.0115, 0.3, 0.0)
    assert lead(0.5, 0.3, 0.3, 0.0) == pytest.approx([force, force], rel=0.05)
    assert cord.positions[20, 2] == pytest.approx(0.3, abs=0.03)
