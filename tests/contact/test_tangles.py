"""Tangles: tendons whose particles are put at random far from their neighbours, and that contract."""

import numpy as np
import pytest

import bullet_tendon as bt


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("particles", [25, 40, 60])
def test_a_random_tangle_untangles_itself(make_world, particles, seed):
    """No step exhausts its budget, though segments turn around each other; taut, it is cheap."""
    world = make_world(gravity=(0, 0, -9.81))
    t = world.add_tendon([[0, 0, 0], [0.3, 0, 0]], 1e-3, bt.Material(stiffness=3e5, exponent=2.0), particles)
    t.grip(0)
    t.grip(-1)
    t.set_positions(t.positions + 0.05 * np.random.default_rng(seed).normal(size=(particles, 3)))
    for k in range(20):
        world.step()
        assert not world.report.over_budget
        if k >= 5:
            assert world.report.converged
            assert world.report.counts["linear_solves"] <= 60
