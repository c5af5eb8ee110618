"""Islands of many bodies: what hangs below is what ropes carry."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import block

import bullet_tendon as bt

GAP, MASS, WEIGHT = 0.3, 0.5, 0.5 * 9.81
ROPE = bt.Material(stiffness=2e4, damping=200.0, density=1e-3)


def ladder(world, client, bars):
    """A rope ladder; the bars, and the ropes by pairs from the top."""
    damped = {"linearDamping": 0.9, "angularDamping": 0.9}
    below = []
    for k in range(bars):
        below.append(block(client, MASS, (0, 0, -GAP * (k + 1)), (0.2, 0.01, 0.01)))
        p.changeDynamics(below[-1], -1, **damped, physicsClientId=client)
    ropes = []
    for k, bar in enumerate(below):
        for x in (-0.2, 0.2):
            rope = world.add_tendon([[x, 0, -GAP * k], [x, 0, -GAP * (k + 1)]], 0.002, ROPE, 4)
            if k == 0:
                rope.grip(0)
            else:
                rope.attach(0, below[k - 1])
            rope.attach(-1, bar)
            ropes.append(rope)
    return below, ropes


@pytest.mark.parametrize("bars", [2, 13])
def test_every_rope_of_a_ladder_carries_half_of_what_hangs_below(make_world, client, bars):
    world = make_world(1 / 240, gravity=(0, 0, -9.81))
    below, ropes = ladder(world, client, bars)
    world.step(1200)
    assert world.report.converged
    load = 0.5 * WEIGHT * (bars - np.arange(2 * bars) // 2)
    assert [rope.tension.mean() for rope in ropes] == pytest.approx(load, rel=1e-4)
    pulls = [world.wrench(bar)[2] for bar in below]
    assert pulls == pytest.approx(np.full(bars, WEIGHT), rel=1e-4)
    stretched = GAP * np.cumsum(load[::2] / ROPE.stiffness)
    heights = [p.getBasePositionAndOrientation(bar, client)[0][2] for bar in below]
    assert heights == pytest.approx(-GAP * np.arange(1, bars + 1) - stretched, abs=1e-6)
