"""Coarse tendons on small wheels: their chords follow the round surface."""

import numpy as np
import pybullet as p
import pytest
from brute_force import subdivided

import bullet_tendon as bt

WHEEL, RADIUS = 0.0144, 0.0009  # m
LENGTH = 0.01  # of a segment [m]: it turns by 0.65 rad


def over_a_wheel(world, client, friction, force):
    """A tendon over half a wheel about the x axis, pulled down at one end [N]; the hand at the other one."""
    turn = p.getQuaternionFromEuler([0, np.pi / 2, 0])
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=WHEEL, height=0.03, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, -1, [0, 0, 0], turn, physicsClientId=client), friction=1.0)
    arc = WHEEL + 1.1 * RADIUS
    angle = np.linspace(0, np.pi, 40)
    line = np.c_[0 * angle, -arc * np.cos(angle), arc * np.sin(angle)]
    line = np.vstack([[0, -arc, -0.08], line, [0, arc, -0.08]])
    length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
    material = bt.Material(stiffness=2e4, damping=2.0, friction=friction)
    t = world.add_tendon(line, RADIUS, material, round(length / LENGTH) + 1)
    t.set_force(0, [0, 0, -force])
    return t, t.grip(-1)


def depth_of_chords(t):
    """How far the centreline is nearer to the wheel's surface than its radius, at most [m]."""
    fine = subdivided(t.positions, 32)
    return WHEEL + RADIUS - np.hypot(fine[:, 1], fine[:, 2]).min()


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("force", [1.0, 140.0])
@pytest.mark.parametrize("dt", [1 / 240, 1 / 85])
def test_chords_stay_on_the_wheel_while_they_slide(make_world, client, dt, force, friction):
    """In a step of 1/85 s they slide by a third of a segment, and new ones come to lie on the wheel."""
    world = make_world(dt, (0, 0, 0))
    t, hand = over_a_wheel(world, client, friction, force)
    world.step(40)
    speed = 0.25
    for k in range(120):
        back = k >= 60
        hand.target = hand.target + [0, 0, (speed if back else -speed) * dt]
        world.step()
        assert world.report.converged
        assert depth_of_chords(t) < (0.05 if dt < 0.005 else 0.2) * RADIUS
    if not friction:
        world.step(100)
        assert t.tension[[0, -1]] == pytest.approx([force, force], rel=0.06)


def test_chords_on_a_smooth_wheel_come_to_rest(make_world, client):
    """They do not turn to and fro for ever, each against its neighbours."""
    world = make_world(1 / 85, (0, 0, 0))
    t, _ = over_a_wheel(world, client, 0.0, 140.0)
    world.step(200)
    assert np.abs(t.velocities).max() < 1e-4
