"""A law that begins flat: what is slack, and stretched only by the starting guess, unloads at once."""

import numpy as np
import pytest

import bullet_tendon as bt

DT = 1 / 240


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.3])
def test_a_slack_tendon_that_its_hands_move_is_solved_in_few_iterations(make_world, speed):
    """By the tangent of a quadratic toe, each iteration would leave a quarter of a force that is to end."""
    world = make_world(DT)
    tendon = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 0.0016, bt.Material.ligament(2e4, 0.06), 8)
    hands = tendon.grip(0), tendon.grip(-1)
    starts = [np.array(hand.target) for hand in hands]
    for k in range(20):
        for hand, start in zip(hands, starts, strict=True):
            hand.target = start + [speed * DT * k, 0, 0]
        world.step()
        assert world.report.converged
        assert world.report.counts["linear_solves"] <= 12
    inertia = 1e-3 * speed / DT  # of a gram, which is more than the tendon's mass [N]
    assert tendon.tension.max() < inertia
