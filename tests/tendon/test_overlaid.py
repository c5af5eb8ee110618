"""A tendon laid through itself: which side is right nobody knows, so it comes apart without a knot."""

import numpy as np
import pytest

import bullet_tendon as bt

RADIUS = 2e-3  # m


def loop(crossings):
    """A flat curve that crosses itself, its centrelines through each other, (m, 3)."""
    turns = np.linspace(-np.pi * crossings, np.pi * crossings, 60 * crossings)
    along = 0.012 * turns - 0.05 * np.sin(turns)
    return np.column_stack([along, 0.05 * np.cos(turns), 0 * turns])


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("crossings", [1, 2])
def test_a_flat_crossing_slides_along_and_comes_undone(make_world, crossings, friction):
    """The ends are drawn apart: crossings run over many segments before the tendon is straight."""
    world = make_world(1 / 240)
    material = bt.Material(stiffness=1e4, damping=10.0, friction=friction)
    t = world.add_tendon(loop(crossings), RADIUS, material, 60 * crossings)
    hands = [t.grip(0), t.grip(-1)]
    middle, span = t.positions.mean(0), t.rest_length * 1.001
    starts = [hand.target.copy() for hand in hands]
    for k in range(240):
        for hand, start, side in zip(hands, starts, (-0.5, 0.5), strict=True):
            goal = middle + [side * span, 0, 0]
            hand.target = start + min(1.0, k / 200) * (goal - start)
        world.step()
        assert world.report.converged
    world.step(240)
    assert np.abs(t.positions[:, 1:] - middle[1:]).max() < RADIUS
    assert t.length == pytest.approx(span, rel=1e-4)
    assert len(world.contacts) == 0
