"""Impulses with bounds, of stops and motors: against all combinations of sides."""

from itertools import product

import numpy as np
import pytest

from bullet_tendon import _core


def by_trial(within, left, least, most):
    """The impulses (m,), found by trying every row within its bounds and at each of them."""
    m = len(left)
    for sides in product([-1, 0, 1], repeat=m):
        sides = np.array(sides)
        pushes = np.where(sides < 0, least, np.where(sides > 0, most, 0.0))
        if not np.isfinite(pushes).all():
            continue
        free = sides == 0
        pushes[free] = np.linalg.solve(within[np.ix_(free, free)], (left - within @ pushes)[free])
        lacks = left - within @ pushes
        inside = (pushes[free] >= least[free]) & (pushes[free] <= most[free])
        if inside.all() and (lacks[sides < 0] <= 1e-9).all() and (lacks[sides > 0] >= -1e-9).all():
            return pushes
    raise AssertionError("no combination fits")


def rows(rng, m):
    """W (m, m), left (m,), bounds (m,) of stops and motors at random."""
    root = rng.normal(size=(m, m + 2))
    motor = rng.random(m) < 0.5
    limit = rng.exponential(1.0, m)
    return root @ root.T, rng.normal(size=m), np.where(motor, -limit, 0.0), np.where(motor, limit, np.inf)


@pytest.mark.parametrize("seed", range(40))
def test_impulses_are_those_of_the_only_sides_that_fit(seed):
    """The problem has one solution where W is positive definite."""
    rng = np.random.default_rng(seed)
    within, left, least, most = rows(rng, rng.integers(1, 6))
    found = _core.bounded_impulses(within, left, least, most, False)
    np.testing.assert_allclose(found, by_trial(within, left, least, most), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_sweeps_end_near_the_solution_of_rows_that_hardly_depend_on_each_other(seed):
    """As pybullet's own sweeps: they end where no rate changes by more than 3e-4."""
    rng = np.random.default_rng(seed)
    within, left, least, most = rows(rng, 4)
    within = np.diag(np.diag(within)) + 0.1 * (within - np.diag(np.diag(within)))
    exact = _core.bounded_impulses(within, left, least, most, False)
    swept = _core.bounded_impulses(within, left, least, most, True)
    assert np.abs(within @ (swept - exact)).max() < 1e-3
