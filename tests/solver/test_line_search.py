"""Steps that Newton's method does not solve in its iterations, and that cannot be cut any further."""

import numpy as np
import pytest

import bullet_tendon as bt


@pytest.mark.parametrize("seed", [0, 1])
def test_descent_from_a_tangled_start_takes_a_bounded_effort(make_world, seed):
    """Particles are put 50 mm (by standard deviation) from a line with 12.5 mm segments. A substep has 12
    iterations. Descent has to end each of the smallest substeps near a minimum, so that the next are easier.
    """
    random = np.random.default_rng(seed)
    world = make_world(1 / 240, (0, 0, -9.81), max_iterations=12)
    law = {"stiffness": 3e5, "exponent": 2.0, "tension_only": bool(seed), "bending_stiffness": 1e-3}
    t = world.add_tendon([[0, 0, 0], [0.3, 0, 0]], 0.002, bt.Material(**law), 25)
    t.grip(0), t.grip(-1)
    t.set_positions(t.positions + 0.05 * random.normal(size=(25, 3)))
    world.step()
    assert np.isfinite(t.positions).all()
    assert world.report.counts["substeps"] > 30
    assert not world.report.over_budget
