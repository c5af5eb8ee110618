"""The banded solver, for one right-hand side and for eight that are zero but for some blocks."""

import numpy as np
import pytest

from bullet_tendon import _core


def band(random, n, reach):
    """A definite matrix of blocks: its diagonal, what is below it, and all of it (3 n, 3 n)."""
    below = np.zeros((reach, n, 3, 3))
    diagonal = np.tile(np.eye(3), (n, 1, 1)) * random.uniform(0.1, 2, (n, 1, 1))
    whole = np.zeros((n, 3, n, 3))
    for r in range(1, reach + 1):
        for i in range(n - r):
            below[r - 1, i] = whole[i + r, :, i] = random.standard_normal((3, 3))
            whole[i, :, i + r] = below[r - 1, i].T
            diagonal[i] += below[r - 1, i].T @ below[r - 1, i]
            diagonal[i + r] += np.eye(3)
    for i in range(n):
        whole[i, :, i] = diagonal[i]
    return diagonal, below, whole.reshape(3 * n, 3 * n)


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
            assert np.abs(solved - exact[first : last + 1]).max() <= 1e-9 * np.abs(exact).max()
            assert np.abs(alone - exact[:, :, 0]).max() <= 1e-9 * np.abs(exact).max()
