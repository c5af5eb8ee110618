"""Frames along a centreline without twist, against closed forms, and on awkward curves."""

import numpy as np
import pytest

from bullet_tendon.errors import InvalidValue
from bullet_tendon.skin import twist_free_frames


def helix(n, turns=1.5, radius=0.02, rise=0.006):
    a = np.linspace(0.0, 2 * np.pi * turns, n)
    return np.stack([radius * np.cos(a), radius * np.sin(a), rise * a], axis=1)


def arc(n, angle, radius):
    a = np.linspace(0.0, angle, n)
    return radius * np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)


def line(n, length=0.1):
    return np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], n)


AWKWARD = {
    "coincident": np.zeros((4, 3)),
    "partly coincident": [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]],
    "hairpin": [[0, 0, 0], [1, 0, 0], [0, 0, 0]],
    "zigzag on a line": [[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0], [0.5, 0, 0]],
    "two points": [[0, 0, 0], [0, 0, 1]],
    "straight": line(7),
    "square turns": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]],
    "tiny": helix(8) * 1e-9,
}


def assert_frames(frames):
    assert np.isfinite(frames).all()
    np.testing.assert_allclose(
        np.swapaxes(frames, 1, 2) @ frames, np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-9)


def test_planar_curves_keep_their_binormal():
    a = np.linspace(0.0, 1.0, 30)
    for curve in (arc(25, 4.0, 0.03), np.stack([a, np.sin(6 * a), 0 * a], axis=1)):
        frames = twist_free_frames(curve, first_normal=[0.0, 0.0, 1.0])
        assert_frames(frames)
        np.testing.assert_allclose(frames[:, :, 1], np.tile([0.0, 0.0, 1.0], (len(curve), 1)), atol=1e-12)


def test_arc_tangents_are_exact_inside():
    frames = twist_free_frames(arc(9, 2.0, 0.03))
    a = np.linspace(0.0, 2.0, 9)
    exact = np.stack([-np.sin(a), np.cos(a), 0 * a], axis=1)
    np.testing.assert_allclose(frames[1:-1, :, 0], exact[1:-1], atol=1e-14)


@pytest.mark.parametrize("n", [60, 120])
def test_helix_turns_back_by_its_torsion(n):
    """Against the Frenet normal, a rotation-minimising normal turns by -(torsion * arc length)."""
    turns, radius, rise = 1.5, 0.02, 0.006
    a = np.linspace(0.0, 2 * np.pi * turns, n)
    speed2 = radius**2 + rise**2
    torsion_by_angle = rise / speed2 * np.sqrt(speed2)
    inward = -np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    frames = twist_free_frames(helix(n, turns, radius, rise), first_normal=inward[0])
    binormal = np.cross(frames[:, :, 0], inward)
    angle = np.unwrap(
        np.arctan2(*(np.einsum("ij,ij->i", frames[:, :, 1], axis) for axis in (binormal, inward)))
    )
    exact = -torsion_by_angle * a
    inner = slice(1, -1)  # the tangents at the ends are extrapolated
    assert abs((angle - exact)[inner] - (angle - exact)[1]).max() < 3.0 / n**2


def test_straight_line_keeps_its_normal():
    frames = twist_free_frames(line(7), first_normal=[5.0, 3.0, 4.0])
    np.testing.assert_allclose(frames[:, :, 1], np.tile([0.0, 0.6, 0.8], (7, 1)), atol=1e-15)


@pytest.mark.parametrize("points", AWKWARD.values(), ids=AWKWARD.keys())
def test_awkward_curves_have_frames(points):
    assert_frames(twist_free_frames(points))


def test_wild_points_never_give_nan():
    rng = np.random.default_rng(1)
    for _ in range(200):
        points = rng.integers(-1, 2, (rng.integers(2, 12), 3)).astype(float)
        assert_frames(twist_free_frames(points))


def test_refusals():
    with pytest.raises(InvalidValue, match="first_normal"):
        twist_free_frames(line(4), first_normal=[1.0, 0.0, 0.0])
    with pytest.raises(InvalidValue, match="first_normal"):
        twist_free_frames(line(4), first_normal=[0.0, 0.0, 0.0])
    with pytest.raises(InvalidValue, match="centreline"):
        twist_free_frames([[0.0, 0.0, 0.0]])
    with pytest.raises(InvalidValue, match="finite"):
        twist_free_frames([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
