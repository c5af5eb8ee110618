"""What sticks to a body that turns goes with it, and a body that rolls on a tendon goes on as it does."""

import math

import numpy as np
import pybullet as p
import pytest
from link_scenes import links_on_joints

import bullet_tendon as bt

R = 0.002
WHEEL = 0.03
ARM = WHEEL + R  # particles do not spin: friction acts on the centreline


def wheel(client, mass):
    """A cylinder on a hinge along y, without damping or motor; returns its body."""
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=WHEEL, height=0.02, physicsClientId=client)
    turned = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
    body = links_on_joints(client, p.JOINT_REVOLUTE, [mass], [(0, 0, 1)], shape, turned=turned)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


def hung_over(world):
    """The hand at the last end of a tendon over the wheel, with half a kilogram at its first end."""
    turned = np.linspace(0, math.pi, 25)
    arc = ARM * np.c_[-np.cos(turned), 0 * turned, np.sin(turned)]
    points = np.vstack([[[-ARM, 0, -0.15]], arc, [[ARM, 0, -0.15]]])
    material = bt.Material(stiffness=2e4, damping=2.0, density=1100, friction=1.0)
    tendon = world.add_tendon(points, R, material, 60)
    tendon.set_point_mass(0, 0.5)
    return tendon.grip(-1)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("dt", [1 / 60, 1 / 240, 1 / 1000])
@pytest.mark.parametrize("mass", [0.02, 0.5, 3.0])
def test_a_sticking_tendon_turns_a_wheel_as_fast_as_it_runs(make_world, client, mass, dt, integrator):
    world = make_world(dt, (0, 0, -9.81), integrator=integrator)
    body = wheel(client, mass)
    world.add_obstacle(body, 0, friction=1.0)
    hand = hung_over(world)
    world.step(round(0.3 / dt))
    start, speed, rates = np.array(hand.target), 0.06, []
    for k in range(round(0.6 / dt)):
        hand.target = start - (0, 0, speed * dt * (k + 1))
        world.step()
        rates.append(abs(p.getJointState(body, 0, client)[1]))
    assert np.mean(rates[len(rates) // 2 :]) == pytest.approx(speed / ARM, rel=0.01)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("dt", [1 / 60, 1 / 120, 1 / 480])
@pytest.mark.parametrize("mass", [0.03, 0.5])
def test_a_wheel_is_driven_by_the_difference_of_two_weights(make_world, client, mass, dt, integrator):
    """Atwood's machine with the inertia I of its wheel: a = g (m1 - m2)/(m1 + m2 + I/ARM^2)."""
    world = make_world(dt, (0, 0, -9.81), integrator=integrator)
    body = wheel(client, mass)
    world.add_obstacle(body, 0, friction=1.0)
    turned = np.linspace(0, math.pi, 60)
    arc = ARM * np.c_[-np.cos(turned), 0 * turned, np.sin(turned)]
    points = np.vstack([[[-ARM, 0, -0.25]], arc, [[ARM, 0, -0.05]]])
    tendon = world.add_tendon(points, R, bt.Material(stiffness=2e4, density=10, friction=1.0), 120)
    weights = 0.4, 0.5
    for end, weight in zip((0, -1), weights, strict=True):
        tendon.set_point_mass(end, weight)
    inertia = p.getDynamicsInfo(body, 0, client)[2][2]
    fall = 9.81 * (weights[1] - weights[0]) / (sum(weights) + inertia / ARM**2)
    world.step(round(0.1 / dt))  # until the weights have stretched it
    steps, speeds = round(0.3 / dt), []
    for _ in range(steps):
        world.step()
        speeds.append(-tendon.velocities[-1, 2])
    assert np.polyfit(dt * np.arange(steps), speeds, 1)[0] == pytest.approx(fall, rel=0.01)


@pytest.mark.parametrize("dt", [1 / 60, 1 / 240, 1 / 1000])
@pytest.mark.parametrize("mass", [0.005, 0.02, 0.5])
@pytest.mark.parametrize("rate", [0.0, 10.0])
def test_a_smooth_tendon_does_not_turn_a_wheel(make_world, client, mass, dt, rate):
    """At rest or while it is drawn: the force of every contact goes through the axis of the wheel."""
    world = make_world(dt, (0, 0, -9.81))
    body = wheel(client, mass)
    p.resetJointState(body, 0, 0.0, rate, physicsClientId=client)
    world.add_obstacle(body, 0, friction=0.0)
    hand = hung_over(world)
    world.step(round(0.5 / dt))
    start, speed = np.array(hand.target), 0.06
    for k in range(round(0.3 / dt)):
        hand.target = start - (0, 0, speed * dt * (k + 1))
        world.step()
    assert p.getJointState(body, 0, client)[1] == pytest.approx(rate, abs=1e-4)


def ball_on_a_cord(world, client, particles, place, speed=0.0, radius=0.01):
    """A ball on a cord that lies on the ground; it rolls along the cord."""
    ground = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, ground, physicsClientId=client))
    material = bt.Material(stiffness=500.0, damping=0.5, friction=0.7)
    cord = world.add_tendon([[0, -0.2, R], [0, 0.2, R]], R, material, particles)
    cord.grip(0), cord.grip(-1)
    world.step(100)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=radius, physicsClientId=client)
    body = p.createMultiBody(0.01, shape, basePosition=(0, place, 2 * R + radius), physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    spin = (-speed / (radius + R), 0, 0)
    p.resetBaseVelocity(body, (0, speed, 0), spin, physicsClientId=client)
    world.add_obstacle(body)
    return body


@pytest.mark.parametrize(("particles", "place"), [(16, 0.03), (16, 0.011), (16, 0.005), (60, 0.03)])
def test_a_ball_stays_where_it_is_put_on_a_cord(make_world, client, particles, place):
    world = make_world(1 / 240, (0, 0, -9.81))
    body = ball_on_a_cord(world, client, particles, place)
    world.step(240)
    assert p.getBasePositionAndOrientation(body, client)[0][1] == pytest.approx(place, abs=1e-4)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("dt", [1 / 240, 1 / 1000])
@pytest.mark.parametrize("particles", [16, 60, 120])  # segments of 27, 7 and 3 mm
@pytest.mark.parametrize("speed", [0.1, 0.3, 1.0])  # 0.03 to 0.35 rad a step of 1/240 s
def test_a_ball_rolls_on_along_a_cord(make_world, client, speed, particles, dt, integrator):
    """The contact is measured where the ball is now. One that is left behind lets it sink, and pushes it.

    Its force acts below the ball, however far the ball turns, and passes on from segment to segment.
    """
    world = make_world(dt, (0, 0, -9.81), integrator=integrator)
    body = ball_on_a_cord(world, client, particles, -0.1, speed)
    world.step(round(0.15 / speed / dt))
    velocity, spin = p.getBaseVelocity(body, client)
    assert velocity[1] == pytest.approx(speed, rel=0.05)
    assert -spin[0] * 0.012 == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("particles", [30, 100])
@pytest.mark.parametrize("speed", [0.05, 0.2])
def test_a_smooth_box_slides_on_over_cords(make_world, client, speed, particles, integrator):
    """Its front edge comes from above over the particles that it reaches, and is not held back by them."""
    world = make_world(1 / 240, (0, 0, -9.81), integrator=integrator)
    ground = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, ground, physicsClientId=client))
    material = bt.Material(stiffness=500.0, damping=0.5, friction=0.7)
    for y in (-0.012, 0.012):
        cord = world.add_tendon([[-0.2, y, R], [0.2, y, R]], R, material, particles)
        cord.grip(0), cord.grip(-1)
    world.step(60)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.02, 0.01], physicsClientId=client)
    box = p.createMultiBody(0.01, shape, basePosition=(-0.12, 0, 2 * R + 0.01), physicsClientId=client)
    p.changeDynamics(box, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.resetBaseVelocity(box, (speed, 0, 0), physicsClientId=client)
    world.add_obstacle(box, friction=0.0)
    world.step(240)
    assert p.getBaseVelocity(box, client)[0][0] == pytest.approx(speed, rel=0.015)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("particles", [60, 120])
@pytest.mark.parametrize("speed", [0.05, 0.2])
def test_nothing_presses_across_a_gap_where_a_load_moves_on(make_world, client, speed, particles, integrator):
    """Neither the ball nor the ground lifts the cord behind the ball with the force of the last step."""
    world = make_world(1 / 240, (0, 0, -9.81), integrator=integrator)
    ball_on_a_cord(world, client, particles, -0.1, speed)
    weight, lifted = 0.01 * 9.81, 0.0
    for _ in range(120):
        world.step()
        pressed = world.contacts[world.contacts["normal_force"] > 0.02 * weight]
        assert pressed["normal_force"].sum() < 4 * weight
        assert pressed["distance"].max(initial=0.0) < 2e-3 * R
        lifted = max(lifted, world.tendons[0].positions[:, 2].max() - R)
    assert lifted < 2e-3 * R


@pytest.mark.parametrize(
    ("integrator", "dt"), [("implicit_euler", 1 / 240), ("bdf2", 1 / 240), ("bdf2", 1 / 1000)]
)
def test_a_drum_unwinds_from_a_tendon_as_a_rigid_one_would(make_world, client, dt, integrator):
    """Two turns of a tendon; in a step of 1/240 s the drum turns by up to 0.2 rad."""
    world = make_world(dt, (0, 0, -9.81), integrator=integrator)
    radius, mass, turns = 0.02, 0.1, 2
    lying = p.getQuaternionFromEuler((math.pi / 2, 0, 0))
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=0.04, physicsClientId=client)
    drum = p.createMultiBody(mass, shape, -1, (0, 0, 0), lying, physicsClientId=client)
    p.changeDynamics(drum, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    world.add_obstacle(drum, friction=0.5)
    arm, angle = radius + 1e-3, np.linspace(0, -2 * np.pi * turns, 40 * turns)
    wound = np.c_[arm * np.cos(angle), 0.003 * angle / (2 * np.pi), arm * np.sin(angle)]
    material = bt.Material(stiffness=5e3, damping=1.0, friction=0.5)
    t = world.add_tendon([(arm, 0, 0.3), *wound], 1e-3, material, 150)
    t.grip(0)
    there = p.invertTransform((0, 0, 0), lying)
    t.attach(-1, drum, -1, p.multiplyTransforms(*there, wound[-1], (0, 0, 0, 1))[0])
    time = 0.2
    world.step(round(time / dt))
    inertia = p.getDynamicsInfo(drum, -1, client)[2][2]
    fall = 9.81 / (1 + inertia / (mass * arm**2))
    (_, _, height), _ = p.getBasePositionAndOrientation(drum, client)
    assert height == pytest.approx(-0.5 * fall * time * (time + dt), rel=0.015)


@pytest.mark.parametrize("tension", [5.0, 50.0])
@pytest.mark.parametrize("shape", ["cylinder", "sphere"])
def test_a_taut_tendon_on_a_free_wheel_turns_with_it(make_world, client, tension, shape):
    """It presses on the wheel by tension over radius, which neither turns the wheel nor makes it unstable."""
    world = make_world()
    radius, spin, turn, stiffness, n = 0.02, np.array([0, 2.0, 0]), np.pi, 1e4, 20
    if shape == "sphere":
        solid = p.createCollisionShape(p.GEOM_SPHERE, radius=radius, physicsClientId=client)
    else:
        solid = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=0.02, physicsClientId=client)
    axle = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    wheel = p.createMultiBody(0.05, solid, -1, [0, 0, 0], axle, physicsClientId=client)
    p.changeDynamics(wheel, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    world.add_obstacle(wheel, friction=1.0)
    angle = np.linspace(-turn / 2, turn / 2, n)
    around = (radius + 0.001) / np.cos(0.5 * turn / (n - 1))  # its chords lie on the wheel
    line = around * np.c_[np.sin(angle), 0 * angle, np.cos(angle)]
    material = bt.Material(stiffness=stiffness, friction=0.3)
    t = world.add_tendon(line / (1 + tension / stiffness), 0.001, material, n)
    t.set_positions(line, np.cross(spin, line))
    t.attach(0, wheel), t.attach(-1, wheel)
    p.resetBaseVelocity(wheel, [0, 0, 0], spin.tolist(), physicsClientId=client)
    for _ in range(30):
        world.step()
        assert world.report.counts["substeps"] == 1
    velocity, found = p.getBaseVelocity(wheel, physicsClientId=client)
    np.testing.assert_allclose(found, spin, atol=1e-3 * spin[1])
    np.testing.assert_allclose(velocity, 0, atol=1e-3 * spin[1] * radius)
    np.testing.assert_allclose(t.tension, tension, rtol=2e-3)
