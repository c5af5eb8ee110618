"""The sparse solver of tendons that touch, against dense solutions on random patterns."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bullet_tendon import _core

RANDOM = settings(max_examples=60, deadline=None)
SEEDS = st.integers(0, 2**32 - 1)


def chains(random, count, n, reach, touching):
    """Edges of `count` chains of n blocks, joined up to `reach`, with pairs of segments that touch."""
    edges = [
        (c * n + i, c * n + i + r) for c in range(count) for r in range(1, reach + 1) for i in range(n - r)
    ]
    for _ in range(touching):
        a, b = random.integers(0, count * n - 1, 2)
        edges += [(a + i, b + j) for i in (0, 1) for j in (0, 1) if a + i != b + j]
    return np.array(edges, dtype=np.int32).reshape(-1, 2)


def system(random, n, edges):
    """A definite matrix with blocks at those edges, and a right-hand side."""
    diagonal = np.tile(np.eye(3), (n, 1, 1)) * random.uniform(0.1, 10, (n, 1, 1))
    beside = random.standard_normal((len(edges), 3, 3))
    for (i, j), b in zip(edges, beside, strict=True):
        diagonal[i] += b @ b.T
        diagonal[j] += np.eye(3)
    return edges, diagonal, beside, random.standard_normal((n, 3))


def dense(edges, diagonal, beside):
    n = len(diagonal)
    matrix = np.zeros((n, 3, n, 3))
    for i, d in enumerate(diagonal):
        matrix[i, :, i] += d
    for (i, j), b in zip(edges, beside, strict=True):
        matrix[i, :, j] += b
        matrix[j, :, i] += b.T
    return matrix.reshape(3 * n, 3 * n)


def agree(one, **options):
    """The solution is the dense one, to the condition of the matrix."""
    ((found, _),) = _core.testing.sparse_solutions([one], **options)
    expected = np.linalg.solve(dense(*one[:3]), one[3].ravel())
    np.testing.assert_allclose(found.ravel(), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@RANDOM
@given(seed=SEEDS, count=st.integers(1, 6), reach=st.integers(1, 2), touching=st.integers(0, 60))
def test_chains_that_touch(seed, count, reach, touching):
    random = np.random.default_rng(seed)
    n = int(random.integers(3, 20))
    agree(system(random, count * n, chains(random, count, n, reach, touching)))


@RANDOM
@given(seed=SEEDS, share=st.floats(0, 1))
def test_any_pattern(seed, share):
    """From nothing that is joined to everything with everything, edges in any direction and some twice."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 30))
    one, other = np.nonzero(np.triu(random.random((n, n)) < share, 1))
    edges = np.stack([one, other], axis=1).astype(np.int32)
    turned = random.random(len(edges)) < 0.5
    edges[turned] = edges[turned, ::-1]
    again = edges[random.random(len(edges)) < 0.2]
    agree(system(random, n, np.concatenate([edges, again])))


@pytest.mark.parametrize("n", [2, 16, 17, 32, 33, 50])
@pytest.mark.parametrize("apart", [0, 1, 4])
def test_all_joined(n, apart):
    """Panels of one width and the next, with nothing, an odd and an even number of blocks below."""
    random = np.random.default_rng(n)
    joined = np.stack(np.triu_indices(n, 1), axis=1)
    rest = np.array([(i, n + k) for k in range(apart) for i in (0, 1)], dtype=int).reshape(-1, 2)
    agree(system(random, n + apart, np.concatenate([joined, rest]).astype(np.int32)))


@RANDOM
@given(seed=SEEDS, touching=st.integers(0, 60))
def test_eight_right_hand_sides_at_once_have_the_bits_of_one_after_the_other(seed, touching):
    random = np.random.default_rng(seed)
    edges, diagonal, beside, _ = system(random, 40, chains(random, 4, 10, 1, touching))
    right = random.standard_normal((40, 3, 8))
    together = _core.testing.sparse_columns(edges, diagonal, beside, right).reshape(40, 3, 8)
    alone = _core.testing.sparse_solutions([(edges, diagonal, beside, right[..., k]) for k in range(8)])
    assert np.array_equal(together, np.stack([x for x, _ in alone], axis=-1))
    expected = np.linalg.solve(dense(edges, diagonal, beside), right.reshape(120, 8)).reshape(40, 3, 8)
    np.testing.assert_allclose(together, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_a_factor_forgets_what_it_solved_before():
    """To the bit: a state that is restored into a world goes on as it did where it came from."""
    random = np.random.default_rng(4)
    systems = [
        system(random, 5 * n, chains(random, 5, n, 1, touching))
        for n, touching in [(12, 30), (8, 50), (12, 5)]
    ]
    systems += systems[::-1]
    together = _core.testing.sparse_solutions(systems)
    for one, (found, below) in zip(systems, together, strict=True):
        ((alone, below_alone),) = _core.testing.sparse_solutions([one])
        assert np.array_equal(found, alone) and below == below_alone


def test_the_order_of_edges_does_not_matter():
    random = np.random.default_rng(5)
    edges, diagonal, beside, right = system(random, 60, chains(random, 3, 20, 1, 0))
    shuffled = random.permutation(len(edges))
    (one, below), (other, below_other) = _core.testing.sparse_solutions(
        [(edges, diagonal, beside, right), (edges[shuffled], diagonal, beside[shuffled], right)]
    )
    assert np.array_equal(one, other) and below == below_other


def test_what_is_not_definite_is_told():
    random = np.random.default_rng(6)
    edges, diagonal, beside, right = system(random, 30, chains(random, 3, 10, 2, 8))
    diagonal[17] -= 2 * np.trace(diagonal[17]) * np.eye(3)
    indefinite = edges, diagonal, beside, right
    ((found, _),) = _core.testing.sparse_solutions([indefinite])
    assert found is None
    agree(indefinite, through=True)


@pytest.mark.parametrize(("reach", "blocks"), [(1, 1.0), (2, 2.0)])
def test_chains_that_do_not_touch_fill_nothing_in(reach, blocks):
    random = np.random.default_rng(7)
    edges = chains(random, 4, 50, reach, 0)
    ((_, below),) = _core.testing.sparse_solutions([system(random, 200, edges)])
    assert below <= blocks * len(edges) / reach


def fill_by_least_degree(n, edges):
    """Blocks below the diagonal where the block with the fewest neighbours is always next."""
    neighbours = [set() for _ in range(n)]
    for i, j in edges:
        neighbours[i].add(j)
        neighbours[j].add(i)
    left, below = set(range(n)), 0
    while left:
        next_one = min(left, key=lambda i: (len(neighbours[i]), i))
        left.remove(next_one)
        around = neighbours[next_one]
        below += len(around)
        for i in around:
            neighbours[i] |= around
            neighbours[i] -= {i, next_one}
    return below


def lattice(m):
    at = np.arange(m * m).reshape(m, m)
    across, along = (at[:-1].ravel(), at[1:].ravel()), (at[:, :-1].ravel(), at[:, 1:].ravel())
    return np.concatenate([np.stack(across, 1), np.stack(along, 1)]).astype(np.int32)


@pytest.mark.parametrize("touching", [20, 100, 300, None])
def test_fill(touching):
    """As with exact degrees, and the first of several blocks with the fewest neighbours."""
    random = np.random.default_rng(8)
    n = 400
    edges = lattice(20) if touching is None else chains(random, 8, 50, 1, touching)
    ((_, below),) = _core.testing.sparse_solutions([system(random, n, edges)])
    assert below == fill_by_least_degree(n, edges)


@RANDOM
@given(seed=SEEDS, shift=st.floats(0, 100), touching=st.integers(0, 20))
def test_a_direction_of_negative_curvature_is_found_where_there_is_one(seed, shift, touching):
    """x = A_-^-1 b by the negative pivots alone: x A x = x b < 0. It is zero where there are none."""
    random = np.random.default_rng(seed)
    n = int(random.integers(3, 20))
    edges, diagonal, beside, right = system(random, 2 * n, chains(random, 2, n, 2, touching))
    diagonal[random.integers(0, 2 * n)] -= shift * np.eye(3)
    whole = dense(edges, diagonal, beside)
    least, largest = np.linalg.eigvalsh(whole)[[0, -1]]
    assume(abs(least) > 1e-9 * largest)
    x = np.array(_core.testing.sparse_negative(edges, diagonal, beside, right)).ravel()
    if least > 0:
        assert not x.any()
    else:
        assert x @ whole @ x < 0
        assert x @ whole @ x == pytest.approx(x @ right.ravel(), rel=1e-4)
