"""Where nearly parallel segments touch: the ends of the stretch that they have in common."""

import numpy as np
import pytest
from brute_force import segment_segments

from bullet_tendon import _core

SAG = 1e-5  # m


def rod(angle, slope=0.0, height=4e-3, length=0.01, shift=0.0):
    """A segment (2, 3) above the origin, along x but turned about z and (slope) about y [m, rad]."""
    half = 0.5 * length * np.array([np.cos(angle), np.sin(angle), np.sin(slope)])
    middle = np.array([shift, 0.0, height])
    return np.array([middle - half, middle + half])


def stretch(p, q, sag=SAG):
    """Parameters (k, 2), and the distance (k,) of both points there."""
    found = _core.testing.touching_parameters(np.concatenate([p, q]), sag)
    on = [x[0] + found[:, k, None] * (x[1] - x[0]) for k, x in enumerate((p, q))]
    return found, np.linalg.norm(on[0] - on[1], axis=1)


def test_parallel_segments_touch_at_both_ends_of_their_overlap():
    base = rod(0.0, height=0.0)
    found, distance = stretch(rod(0.0, shift=0.004), base)
    np.testing.assert_allclose(found, [[0.0, 0.4], [0.6, 1.0]], atol=1e-12)
    np.testing.assert_allclose(distance, 4e-3, rtol=1e-12)
    found, _ = stretch(rod(np.pi, shift=0.004), base)  # the other way round
    np.testing.assert_allclose(found, [[0.4, 1.0], [1.0, 0.4]], atol=1e-12)
    found, _ = stretch(rod(0.0, shift=0.02), base)  # one behind the other
    np.testing.assert_allclose(found, [[0.0, 1.0]], atol=1e-12)


def test_segments_that_cross_at_a_wide_angle_touch_at_one_point():
    base = rod(0.0, height=0.0)
    assert len(stretch(rod(0.2), base)[0]) == 2
    assert len(stretch(rod(0.5), base)[0]) == len(stretch(rod(np.pi - 0.5), base)[0]) == 0


@pytest.mark.parametrize("length", [0.0, 1e-12, 2e-4])
def test_a_segment_much_shorter_than_the_distance_touches_at_both_ends(length):
    """In any direction, also where its own nearest point jumps from end to end; in either order."""
    rng = np.random.default_rng(1)
    base = rod(0.0, height=0.0)
    for _ in range(200):
        middle = np.array([rng.uniform(-8e-3, 8e-3), rng.uniform(-1e-3, 1e-3), 4e-3])
        way = rng.normal(size=3)
        half = 0.5 * length / np.linalg.norm(way) * way
        p = np.array([middle - half, middle + half])
        found, distance = stretch(p, base)
        np.testing.assert_array_equal(found[:, 0], [0.0, 1.0])
        np.testing.assert_allclose(distance, [segment_segments(x, x, *base) for x in p], rtol=1e-9)
        swapped, _ = stretch(base, p)
        np.testing.assert_allclose(swapped, found[:, ::-1], atol=1e-12)


@pytest.mark.parametrize("slope", [0.0, 0.01, 0.1])
def test_between_its_ends_nothing_is_nearer_than_by_the_sag(slope):
    """At random places and angles: one of both points is about as near as the segments are."""
    rng = np.random.default_rng(2)
    base, checked = rod(0.0, height=0.0), 0
    for _ in range(300):
        p = rod(rng.uniform(-0.32, 0.32), slope, shift=rng.uniform(-8e-3, 8e-3))
        p[:, 1] += rng.uniform(-1e-3, 1e-3)
        nearest = segment_segments(*(x[None] for x in (*p, *base))).min()
        found, distance = stretch(p, base)
        assert len(found) > 0
        assert np.all((found >= 0) & (found <= 1))
        assert nearest - 1e-12 <= distance.min() <= nearest + 2 * SAG
        checked += len(found) == 2
    assert checked > 100


def test_its_ends_move_continuously_as_segments_turn():
    """From parallel to the widest angle, crossing beside the middle: no end jumps, and both come together."""
    base = rod(0.0, height=0.0)
    angles = np.linspace(0.0, 0.34, 3401)
    ends = []
    for angle in angles:
        p = rod(angle)
        p += 0.2 * (p[1] - p[0])
        ends.append(stretch(p, base)[0])
    ends = np.array(ends)
    assert np.abs(np.diff(ends, axis=0)).max() < 0.02
    width = np.ptp(ends[:, :, 0], axis=1)
    assert width[0] > 0.75 and width[-1] < 0.3 * width[0]
