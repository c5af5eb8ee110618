"""Signed fields for modelling bones: < 0 inside, roughly a distance near the surface [mm].

Points are arrays (..., 3) [mm]; every function returns an array (...) of field values. "Roughly a distance"
is enough: the zero level is exact, and blends only need values that are comparable near the surface.
Smooth minimum after Inigo Quilez ("smooth minimum", quadratic polynomial), ellipsoid bound likewise.
"""

import functools

import numpy as np
from scipy.interpolate import PchipInterpolator


def union(a, b, k: float):
    """The smaller of two fields, joined by a fillet about k [mm] wide."""
    fillet = np.maximum(k - np.abs(a - b), 0.0)
    return np.minimum(a, b) - fillet * fillet / (4.0 * k)


def cut(a, b, k: float):
    """What is inside both fields, the common edge rounded over about k [mm]."""
    return -union(-a, -b, k)


def without(a, b, k: float):
    """Field a minus what is inside b, the edge rounded over about k [mm]."""
    return cut(a, -b, k)


def ellipsoid(points, centre, semi_axes):
    """An axis-aligned ellipsoid; a first-order distance."""
    offset = (points - np.asarray(centre, float)) / np.asarray(semi_axes, float)
    size = np.linalg.norm(offset, axis=-1)
    slope = np.linalg.norm(offset / np.asarray(semi_axes, float), axis=-1)
    return size * (size - 1.0) / np.maximum(slope, 1e-9)


def capsule(points, start, end, radius_start: float, radius_end: float):
    """A rod from start to end whose radius goes linearly from one to the other, with round ends."""
    start, axis = np.asarray(start, float), np.subtract(end, start).astype(float)
    share = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
    nearest = start + share[..., None] * axis
    radius = radius_start + share * (radius_end - radius_start)
    return np.linalg.norm(points - nearest, axis=-1) - radius


def rounded_bar(u, v, centre_a, radius_a, centre_b, radius_b):
    """The convex hull of two circles (almost: the flanks are linear in the radius) in the plane u, v."""
    axis = np.subtract(centre_b, centre_a).astype(float)
    share = ((u - centre_a[0]) * axis[0] + (v - centre_a[1]) * axis[1]) / (axis @ axis)
    share = np.clip(share, 0.0, 1.0)
    across = np.hypot(u - centre_a[0] - share * axis[0], v - centre_a[1] - share * axis[1])
    return across - (radius_a + share * (radius_b - radius_a))


def loft(points, table, power: float = 2.0):
    """A body of (super)elliptic cross-sections stacked along y.

    table: rows (y, centre x, centre z, half-width x, half-width z) [mm], y rising, monotone interpolation
    between rows, constant beyond the ends. power 2 is an ellipse, more is boxier.
    """
    level = np.clip(points[..., 1], table[0][0], table[-1][0])
    cx, cz, hx, hz = np.moveaxis(_sections(tuple(map(tuple, table)))(level), -1, 0)
    across_x, across_z = np.abs((points[..., 0] - cx) / hx), np.abs((points[..., 2] - cz) / hz)
    size = (across_x**power + across_z**power) ** (1.0 / power)
    return (size - 1.0) * np.minimum(hx, hz)


@functools.cache
def _sections(table: tuple) -> PchipInterpolator:
    """Of the level: centre and half-widths of the cross-section."""
    rows = np.array(table, float)
    return PchipInterpolator(rows[:, 0], rows[:, 1:])


def gradient(field, points, reach: float = 1e-3):
    """Central differences of the field at points (V, 3): (V, 3)."""
    offsets = reach * np.eye(3)
    return np.stack([field(points + o) - field(points - o) for o in offsets], axis=1) / (2 * reach)
