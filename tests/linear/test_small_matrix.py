"""Cholesky factors of the bodies' matrices: full, with many zeros, semidefinite."""

import numpy as np
import pytest

from bullet_tendon import _core


def root_of(a):
    return np.reshape(_core.testing.root(len(a), a.ravel().tolist()), a.shape)


def bordered(rng, n, border):
    """Definite: rows of neighbours, and a few rows that meet all."""
    a = np.diag(rng.uniform(4, 6, n)) + np.diag(rng.normal(size=n - 1), 1)
    a[:, n - border :] += 0.1 * rng.normal(size=(n, border))
    a = np.triu(a)
    return a + np.triu(a, 1).T


@pytest.mark.parametrize("n", [1, 5, 6, 7, 40])
def test_the_root_of_a_full_matrix(n):
    half = np.random.default_rng(n).normal(size=(n, 2 * n))
    a = half @ half.T
    assert root_of(a) == pytest.approx(np.linalg.cholesky(a), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("n", [6, 12, 60])
@pytest.mark.parametrize("border", [0, 3])
def test_the_root_of_a_matrix_with_many_zeros(n, border):
    a = bordered(np.random.default_rng(n + border), n, border)
    found = root_of(a)
    assert found == pytest.approx(np.linalg.cholesky(a), rel=1e-12, abs=1e-14)
    assert not np.triu(found, 1).any()
    if border == 0:
        assert not np.tril(found, -2).any()


@pytest.mark.parametrize("n", [6, 30])
def test_columns_without_a_pivot_are_zero(n):
    """Rows and columns that are zero, and one that depends on another."""
    rng = np.random.default_rng(n)
    half = rng.normal(size=(n, n))
    half[[1, 4]] = 0
    half[5] = 2 * half[2]
    a = half @ half.T
    found = root_of(a)
    assert found @ found.T == pytest.approx(a, abs=1e-9)
    assert not found[:, [1, 4, 5]].any()
