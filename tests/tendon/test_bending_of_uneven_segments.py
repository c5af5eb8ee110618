"""Bending with segments of different lengths, and clamps at either end, against the beam's formula."""

import numpy as np
import pytest

import bullet_tendon as bt

EI, LENGTH = 1e-3, 0.3
BEAM = bt.Material(stiffness=3e6, bending_stiffness=EI)


def tip_deflection(make_world, points, clamped, free, reeled=0.0) -> float:
    """Deflection of the free end under a small load, over P L^3/(3 EI) [-]."""
    world = make_world()
    t = world.add_tendon(points, 0.004, BEAM)
    if reeled:
        t.shorten(reeled, end=1 if free == -1 else 0)
    t.grip(clamped, direction=(1, 0, 0))
    load = 1e-3 * EI / LENGTH**2
    t.set_force(free, (0, 0, -load))
    world.relax(1e-10)
    assert world.report.converged
    exact = load * t.rest_length**3 / (3 * EI)
    return -t.positions[free, 2] / exact


def along_x(lengths):
    """Points of a line along x with the given segments, LENGTH long in all."""
    x = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.column_stack([x * LENGTH / x[-1], np.zeros((len(x), 2))])


UNEVEN = {
    "growing": np.linspace(1, 4, 60),
    "shrinking": np.linspace(4, 1, 60),
    "alternating": np.tile([1.0, 3.0], 30),
}


@pytest.mark.parametrize("clamped", [0, -1])
@pytest.mark.parametrize("lengths", UNEVEN.values(), ids=UNEVEN)
def test_cantilever_of_uneven_segments(make_world, lengths, clamped):
    """The deflection is the trapezoidal rule's value of P L^3/(3 EI), off by the square of a segment."""
    ratio = tip_deflection(make_world, along_x(lengths), clamped, -1 - clamped)
    assert ratio == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("clamped", [0, -1])
def test_cantilever_with_one_long_segment_at_its_end(make_world, clamped):
    """The free end is paid out: its segment is four times as long as the others."""
    segment = LENGTH / 40
    points = along_x(np.ones(40))
    ratio = tip_deflection(make_world, points, clamped, -1 - clamped, -3 * segment)
    assert ratio == pytest.approx(1, abs=2e-3)


def test_a_clamp_is_the_same_at_both_ends(make_world):
    """A beam's shape does not depend on the order of its particles."""
    points = along_x(np.ones(12))
    first = tip_deflection(make_world, points, 0, -1)
    last = tip_deflection(make_world, points, -1, 0)
    assert last == pytest.approx(first, rel=1e-5)
    # Discrete beam: the moment P (L - x) turns each joint, the clamp over half a segment, by M l/EI.
    x = np.linspace(0, 1, 13)[:-1]
    share = np.where(x == 0, 0.5, 1.0) / 12
    assert first == pytest.approx(3 * (share * (1 - x) ** 2).sum(), rel=1e-4)
