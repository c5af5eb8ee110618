"""Bodies without mass that a script puts elsewhere before each step: they push and carry tendons."""

import math

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G, R = 9.81, 0.002


def put(body, client, position, orientation=(0, 0, 0, 1)):
    p.resetBasePositionAndOrientation(body, position, orientation, client)


def solid(client, kind, **size):
    return p.createMultiBody(
        0, p.createCollisionShape(kind, **size, physicsClientId=client), physicsClientId=client
    )


@pytest.mark.parametrize("dt", [1 / 60, 1 / 240, 1 / 1000])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_a_plate_carries_along_what_sticks_to_it(make_world, client, dt, integrator):
    """Friction starts it by mu g, so that it lags by v^2/(2 mu g); and it comes to rest with the plate."""
    world = make_world(dt, (0, 0, -G), integrator=integrator)
    plate = solid(client, p.GEOM_BOX, halfExtents=(0.5, 0.5, 0.05))
    put(plate, client, (0, 0, -0.05))
    world.add_obstacle(plate, friction=1.0)
    t = world.add_tendon(
        [(-0.1, 0, R), (0.1, 0, R)], R, bt.Material(stiffness=1e4, damping=1, friction=0.6), 20
    )
    world.step(5)
    start, speed, steps = t.positions[:, 0].mean(), 0.2, round(0.4 / dt)
    for k in range(steps):
        put(plate, client, (speed * dt * (k + 1), 0, -0.05))
        world.step()
    assert t.velocities[:, 0] == pytest.approx(speed, rel=0.01)
    lag = speed**2 / (2 * 0.6 * G)
    assert t.positions[:, 0].mean() - start == pytest.approx(speed * dt * steps - lag, abs=speed * dt)
    np.testing.assert_allclose(t.positions[:, 2], R, atol=1e-3 * R)
    world.step(round(0.2 / dt))
    assert np.abs(t.velocities).max() < 1e-6


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
@pytest.mark.parametrize("dt", [1 / 60, 1 / 240])
def test_what_moves_by_less_than_a_radius_a_step_does_not_pass(make_world, client, dt, share):
    """A block is moved against a tendon between two hands, by a share of the radius before each step."""
    world = make_world(dt)
    block = solid(client, p.GEOM_BOX, halfExtents=(0.03, 0.1, 0.02))
    put(block, client, (0, 0, 0.02 + 2 * R))
    world.add_obstacle(block, friction=0.5)
    t = world.add_tendon(
        [(-0.1, 0, 0), (0.1, 0, 0)], R, bt.Material(stiffness=500, damping=1, friction=0.5), 60
    )
    hands = t.grip(0), t.grip(-1)
    face = 2 * R
    while face > -0.05:
        face -= share * R
        put(block, client, (0, 0, 0.02 + face))
        world.step()
        assert world.report.converged
        below = np.abs(t.positions[:, 0]) < 0.029
        assert t.positions[below, 2].max() < face - R + 0.05 * R
    force = sum(hand.force for hand in hands)
    assert world.wrench(block)[2] == pytest.approx(-force[2], rel=0.05)


def test_a_drum_that_is_turned_winds_a_tendon(make_world, client):
    """The weight rises by the angle times the centreline's radius."""
    dt, radius = 1 / 240, 0.02
    world = make_world(dt, (0, 0, -G))
    drum = solid(client, p.GEOM_CYLINDER, radius=radius, height=0.04)
    arm, lying = radius + R, (math.sqrt(0.5), 0, 0, math.sqrt(0.5))
    put(drum, client, (0, 0, 0), lying)
    world.add_obstacle(drum, friction=1.0)
    a = np.linspace(math.pi, 0, 60)
    arc = arm * np.c_[np.cos(a), 0 * a, np.sin(a)]
    material = bt.Material(stiffness=5e3, damping=5, density=100, friction=1.0)
    t = world.add_tendon([(-arm, 0, -0.1), *arc, (arm, 0, -0.2)], R, material, 100)
    for end, weight in ((0, 0.1), (-1, 0.3)):
        t.set_point_mass(end, weight)
    world.step(240)
    start, rate = t.positions[-1, 2], 1.5
    for k in range(240):
        turn = p.getQuaternionFromAxisAngle((0, 1, 0), -rate * dt * (k + 1))
        put(drum, client, (0, 0, 0), p.multiplyTransforms((0, 0, 0), turn, (0, 0, 0), lying)[1])
        world.step()
    assert t.positions[-1, 2] - start == pytest.approx(rate * 240 * dt * arm, rel=0.02)
