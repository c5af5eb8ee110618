"""The banded solver, for one right-hand side and for eight that are zero but for some blocks."""

import numpy as np
import pytest

from bullet_tendon import _core


def band(random, n, reach):
    """A definite matrix of blocks: its diagonal, what is below it, and all of it (3 n, 3 n)."""
    below = np.zeros((reach, n, 3, 3))
    diagonal = np.tile(np.eye(3), (n, 1, 1)) * random.uniform(0.1, 2, (n, 1, 1))
    for r in range(1, reach + 1):
        for i in range(n - r):
            below[r - 1, i] = random.standard_normal((3, 3))
            diagonal[i] += below[r - 1, i].T @ below[r - 1, i]
            diagonal[i + r] += np.eye(3)
    return diagonal, below, whole_of(diagonal, below)


def whole_of(diagonal, below):
    n = len(diagonal)
    whole = np.zeros((n, 3, n, 3))
    for i in range(n):
        whole[i, :, i] = diagonal[i]
        for r, blocks in enumerate(below, 1):
            if i + r < n:
                whole[i + r, :, i] = blocks[i]
                whole[i, :, i + r] = blocks[i].T
    return whole.reshape(3 * n, 3 * n)


@pytest.mark.parametrize("reach", [1, 2])
def test_eight_right_hand_sides_are_solved_for_where_they_are_not_zero(reach):
    random = np.random.default_rng(reach)
    for n in [*range(2, 12), 40, 41]:
        diagonal, below, whole = band(random, n, min(reach, n - 1))
        for _ in range(8):
            first, last = np.sort(random.integers(0, n, 2))
            right = np.zeros((n, 3, 8))
            right[first : last + 1] = random.standard_normal((last + 1 - first, 3, 8))
            solved, alone = _core.testing.band_solutions(diagonal, below, right, first, last)
            exact = np.linalg.solve(whole, right.reshape(3 * n, 8)).reshape(n, 3, 8)
            solved = solved.reshape(-1, 3, 8)
            assert np.abs(solved - exact[first : last + 1]).max() <= 1e-9 * np.abs(exact).max()
            assert np.abs(alone - exact[:, :, 0]).max() <= 1e-9 * np.abs(exact).max()


@pytest.mark.parametrize("reach", [1, 2])
def test_a_direction_of_negative_curvature_is_found_where_there_is_one(reach):
    """x = A_-^-1 b by the negative pivots alone: x A x = x b < 0. It is zero where there are none."""
    random = np.random.default_rng(reach)
    for n in [*range(2, 12), 40, 41]:
        for shift in (0.0, 0.5, 3.0, 100.0):
            diagonal, below, _ = band(random, n, min(reach, n - 1))
            where = random.integers(0, n)
            diagonal[where] -= shift * np.eye(3)
            whole = whole_of(diagonal, below)
            b = random.standard_normal((n, 3))
            x = np.array(_core.testing.band_negative(diagonal, below, b)).ravel()
            if np.linalg.eigvalsh(whole)[0] > 0:
                assert not x.any()
            else:
                assert x @ whole @ x < 0
                assert x @ whole @ x == pytest.approx(x @ b.ravel(), rel=1e-6)
