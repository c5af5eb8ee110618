"""Force and torque of contacts on bodies, against the balance of the tendon's momentum."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import cube, mesh_obstacle

import bullet_tendon as bt

G, HALF, R = 9.81, 0.05, 0.003
ROPE = bt.Material(stiffness=2e3, damping=1.0, friction=1.0)


def box(client, at=(0, 0, 0), turn=(0, 0, 0, 1)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[HALF] * 3, physicsClientId=client)
    return p.createMultiBody(0, shape, -1, at, turn, physicsClientId=client)


def about(point, wrench):
    """(6,) a wrench about the point that it is told about, taken about the origin."""
    return np.concatenate([wrench[:3], wrench[3:] + np.cross(point, wrench[:3])])


def sum_of(points, forces):
    """(6,) forces (k, 3) at points (k, 3), about the origin."""
    return np.concatenate([np.sum(forces, axis=0), np.cross(points, forces).sum(axis=0)])


def momentum(t):
    """(6,) linear and angular, about the origin."""
    return sum_of(t.positions, t.masses[:, None] * t.velocities)


@pytest.mark.parametrize("options", [{}, {"integrator": "bdf2"}], ids=["euler", "bdf2"])
def test_what_sticks_turns_a_body_about_its_own_height(make_world, client, options):
    """A tendon at rest: what its weight and a pull along it are, the body feels, by force and by torque.

    Particles do not spin, so friction acts on the centreline, r above the surface.
    """
    world = make_world(1 / 240, (0, 0, -G), sleep=False, **options)
    centre = np.array([0.01, -0.02, 0.03])
    body = box(client, centre)
    world.add_obstacle(body, friction=0.8)
    top = centre[2] + HALF + R
    t = world.add_tendon([[-0.03, 0.01, top], [0.03, 0.015, top]], R, ROPE, 13)
    pull = np.array([0.5 * t.masses.sum() * G, 0, 0])
    t.set_force(6, pull)
    world.step(400)
    assert np.abs(t.velocities).max() <= 1e-8
    weights = np.outer(t.masses, [0, 0, -G])
    expected = sum_of(t.positions, weights) + sum_of(t.positions[6:7], pull[None])
    felt = about(centre, world.wrench(body))
    np.testing.assert_allclose(felt[:3], expected[:3], atol=1e-6 * np.abs(expected[:3]).max())
    np.testing.assert_allclose(felt[3:], expected[3:], atol=1e-6 * np.abs(expected[3:]).max())
    assert R * pull[0] > 1e-3 * np.abs(expected[3:]).max()  # at the surface it would be another torque


def test_the_torque_on_a_drum_has_the_arm_of_the_centreline(make_world, client):
    """(T1 - T0)(R + r), of a tendon that friction holds around a cylinder."""
    drum, low, high = 0.04, 2.0, 3.0
    world = make_world(1 / 240, sleep=False)
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=drum, height=0.1, physicsClientId=client)
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    body = p.createMultiBody(0, shape, -1, (0, 0, 0), turn, physicsClientId=client)
    world.add_obstacle(body, friction=0.5)
    phi = np.linspace(np.pi, 0, 40)
    arc = (drum + R) * np.column_stack([np.cos(phi), 0 * phi, np.sin(phi)])
    hang = [[-drum - R, 0, -0.05]], [[drum + R, 0, -0.05]]
    t = world.add_tendon(np.vstack([hang[0], arc, hang[1]]), R, ROPE, 60)
    t.set_force(0, (0, 0, -low)), t.set_force(-1, (0, 0, -low))
    world.step(100)
    t.set_force(-1, (0, 0, -high))
    world.step(500)
    assert np.abs(t.velocities).max() <= 1e-6
    np.testing.assert_allclose(world.wrench(body)[:3], [0, 0, -low - high], atol=1e-4)
    turning = (high - low) * (drum + R)
    assert world.wrench(body)[4] == pytest.approx(turning, rel=1e-3)


@pytest.mark.parametrize("speed", [1.0, 12.0, 30.0])
@pytest.mark.parametrize("mesh", [False, True])
def test_what_is_stopped_in_a_step_gives_its_angular_momentum(make_world, client, mesh, speed):
    """A tendon flies square against a face beside the body's centre. Before a mesh, fast steps take parts.

    Each particle moves along one line: the body's wrench over the step is what the tendon's momentum lost.
    """
    dt = 1 / 240
    world = make_world(dt)
    if mesh:
        body = mesh_obstacle(world, client, *cube(HALF))
    else:
        body = box(client)
        world.add_obstacle(body, friction=0.0)
    t = world.add_tendon([[0.0, 0.02, 0.1], [0.03, 0.02, 0.1]], R, ROPE, 7)
    t.set_positions(t.positions, np.tile([0, 0, -speed], (7, 1)))
    met = parts = 0
    for _ in range(30):
        before = momentum(t)
        world.step()
        lost, felt = before - momentum(t), dt * world.wrench(body)
        scale = t.masses.sum() * speed
        np.testing.assert_allclose(felt[:3], lost[:3], atol=1e-9 * scale)
        np.testing.assert_allclose(felt[3:], lost[3:], atol=1e-9 * scale * HALF)
        if felt.any():
            met += 1
            parts = max(parts, world.report.counts["substeps"])
        if abs(momentum(t)[2]) < 1e-3 * scale:
            break
    assert met and abs(momentum(t)[2]) < 0.1 * scale
    assert parts > 1 or not mesh or speed == 1.0


def test_a_free_ball_and_a_rough_tendon_keep_their_angular_momentum(make_world, client):
    """A spinning ball is braked by a tendon that it touches: what it loses, the tendon gets.

    Implicit Euler loses angular momentum of a turning tendon, in proportion to the step; the steps are short.
    """
    dt, radius, steps = 1e-5, 0.02, 100
    heavy = bt.Material(stiffness=2e3, damping=1.0, density=2e4, friction=1.0)
    world = make_world(dt)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=radius, physicsClientId=client)
    ball = p.createMultiBody(0.05, shape, -1, (0, 0, 0), physicsClientId=client)
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.resetBaseVelocity(ball, [0, 0, 1.0], [0, 60.0, 0], client)
    world.add_obstacle(ball, friction=0.6)
    t = world.add_tendon([[-0.02, 0, radius + 1.02 * R], [0.02, 0, radius + 1.02 * R]], R, heavy, 9)
    inertia = p.getDynamicsInfo(ball, -1, client)[2][0]

    def whole():
        at = np.array(p.getBasePositionAndOrientation(ball, client)[0])
        velocity, spin = map(np.array, p.getBaseVelocity(ball, client))
        return momentum(t)[3:] + inertia * spin + 0.05 * np.cross(at, velocity)

    start, spin, gave = whole(), 60.0, 0.0
    for _ in range(steps):
        world.step()
        gave = max(gave, world.contacts["friction_force"].max(initial=0.0))
    exchanged = inertia * (spin - p.getBaseVelocity(ball, client)[1][1])
    assert gave > 0 and exchanged > 1e-2 * inertia * spin
    assert np.abs(whole() - start).max() <= 1e-3 * exchanged


SPIN = -2.0  # of a windlass about the y axis [rad/s]


def windlass(client, radius, driven):
    """A drum that its motor turns, or that has no mass; its body and link."""
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    shape = p.createCollisionShape(
        p.GEOM_CYLINDER, radius=radius, height=0.1, collisionFrameOrientation=turn, physicsClientId=client
    )
    if driven == "by hand":
        return p.createMultiBody(0, shape, physicsClientId=client), -1
    no_turn = [[0, 0, 0, 1]]
    one = {"linkMasses": [1.0], "linkCollisionShapeIndices": [shape], "linkVisualShapeIndices": [-1]}
    one |= {"linkPositions": [[0, 0, 0]], "linkOrientations": no_turn, "linkParentIndices": [0]}
    one |= {"linkInertialFramePositions": [[0, 0, 0]], "linkInertialFrameOrientations": no_turn}
    one |= {"linkJointTypes": [p.JOINT_REVOLUTE], "linkJointAxis": [[0, 1, 0]]}
    drum = p.createMultiBody(0, physicsClientId=client, **one)
    motor = {"targetVelocity": SPIN, "force": 1e5, "physicsClientId": client}
    p.setJointMotorControl2(drum, 0, p.VELOCITY_CONTROL, **motor)
    return drum, 0


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("particles", [60, 120])
@pytest.mark.parametrize("driven", ["by motor", "by hand"])
@pytest.mark.parametrize("apart", [0.0, 3e-4], ids=["flush", "apart"])
@pytest.mark.parametrize("load", ["weight", "force"])
def test_a_windlass_bears_the_torque_of_what_it_winds_up(
    make_world, client, load, apart, driven, particles, integrator
):
    """All that turns the tendon and the weight about the axis is gravity and the drum.

    Beside its attachment, at its surface or `apart` from it [m], the tendon is levered off the drum: both
    press, and turn it by nothing.
    """
    dt, radius, mass, r = 1 / 240, 0.024, 0.2, 0.0015
    world = make_world(dt, (0, 0, -G), sleep=False, integrator=integrator)
    drum, link = windlass(client, radius, driven)
    world.add_obstacle(drum, link, friction=1.0)
    law = bt.Material(stiffness=100 * mass * G, damping=2 * mass * G, friction=0.5, density=300)
    line = [(radius + r + apart, 0, 0), (radius + r, 0, -20 * radius)]
    t = world.add_tendon(line, r, law, particles)
    t.attach(0, drum, link, line[0])
    if load == "weight":
        weight = p.createMultiBody(mass, basePosition=line[1], physicsClientId=client)
        p.changeDynamics(weight, -1, linearDamping=0, physicsClientId=client)
        t.attach(-1, weight)
        world.relax(bodies=[weight])
    else:
        t.set_force(-1, [0, 0, -mass * G])
        world.relax()

    def place():
        if load == "force":
            return t.positions[-1]
        return np.array(p.getBasePositionAndOrientation(weight, client)[0])

    def turning():
        of_load = np.array(p.getBaseVelocity(weight, client)[0]) if load == "weight" else np.zeros(3)
        return momentum(t)[4] + mass * np.cross(place(), of_load)[1]

    for k in range(360):
        if driven == "by hand":
            p.resetBaseVelocity(drum, (0, 0, 0), (0, SPIN, 0), physicsClientId=client)
        if k == 120:
            begun, given = turning(), 0.0
        world.step()
        if k < 120:
            continue
        pulls = sum_of(t.positions, np.outer(t.masses, [0, 0, -G]))[4] + G * mass * place()[0]
        given += dt * (pulls - world.wrench(drum, link)[4])
    torque = mass * G * (radius + r)
    assert place()[2] > line[1][2] + 2.5 * (radius + r)
    assert turning() - begun == pytest.approx(given, abs=0.005 * torque)
