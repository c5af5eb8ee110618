"""Wrenches whose squares underflow, as of what has been damped for long, leave bodies finite."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt


@pytest.mark.parametrize("speed", 10.0 ** np.arange(-163, -147, 3))
def test_a_body_stays_finite(client, make_world, speed):
    """A light sphere that moves off a strand beside its centre, by almost nothing."""
    world = make_world(1 / 60, sleep=False)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=client)
    body = p.createMultiBody(0.003, shape, -1, [0, 0, 0], physicsClientId=client)
    knot = np.array([0, 1 / 128, 0])  # exact numbers: rounding would make larger forces
    material = bt.Material(stiffness=3500, tension_only=False, damping=5)
    t = world.add_tendon([knot + [1 / 8, 0, 0], knot], 1e-4, material, 2, collides=False)
    t.grip(0)
    t.attach(-1, body)
    p.resetBaseVelocity(body, [-speed, 0, 0], [0, 0, 0], physicsClientId=client)
    world.step()
    assert 0 < np.abs(world.wrench(body)[:3]).max() < 1e-140
    assert np.isfinite([p.getBaseVelocity(body, client)]).all()
