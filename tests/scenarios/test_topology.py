"""The knot invariant of polylines against knots whose determinant is known."""

import numpy as np
import pytest
from bullet_tendon.scenarios import topology

ANGLE = np.linspace(0, 2 * np.pi, 160, endpoint=False)


def torus(p, q):
    """(n, 3) the torus knot T(p, q)."""
    r = 2 + np.cos(q * ANGLE)
    return np.c_[r * np.cos(p * ANGLE), r * np.sin(p * ANGLE), -np.sin(q * ANGLE)]


def figure_eight():
    r = 2 + np.cos(2 * ANGLE)
    return np.c_[r * np.cos(3 * ANGLE), r * np.sin(3 * ANGLE), np.sin(4 * ANGLE)]


CIRCLE = np.c_[np.cos(ANGLE), np.sin(ANGLE), 0 * ANGLE]
TREFOIL, SEPTAFOIL = torus(2, 3), torus(2, 7)
KNOTS = [(CIRCLE, 1), (TREFOIL, 3), (torus(3, 2), 3), (figure_eight(), 5), (SEPTAFOIL, 7), (torus(3, 4), 3)]


@pytest.mark.parametrize(("curve", "known"), KNOTS)
def test_determinants_of_known_knots_in_any_projection(curve, known):
    for direction in np.random.default_rng(0).normal(size=(12, 3)):
        assert topology.determinant(curve, direction) == known
        assert topology.determinant(curve[::-1] * (1, 1, -1), direction) == known


def test_a_passage_through_itself_changes_the_determinant():
    over, under = topology.crossings(TREFOIL, (0.01, 0.02, 1.0))
    assert len(over) == 3
    moved = TREFOIL.copy()
    there = np.abs(np.arange(len(TREFOIL)) - over[0]) < 8
    moved[there, 2] -= 4
    assert topology.determinant(moved, (0.01, 0.02, 1.0)) == 1


def test_open_lines_are_closed_far_away():
    straight = np.c_[np.linspace(-1, 1, 9), np.zeros((9, 2))]
    assert topology.determinant(topology.closed_far(straight)) == 1
    opened = TREFOIL[3:-3]  # cut where it is outermost
    assert topology.determinant(topology.closed_far(opened)) == 3
