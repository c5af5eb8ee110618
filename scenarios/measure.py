"""Distances between centrelines, measured apart from the solver's own contact search."""

import numpy as np

_TINY = np.finfo(float).tiny


def segment_distances(a0, a1, b0, b1) -> np.ndarray:
    """Shortest distances between segments a0-a1 and b0-b1, arrays (..., 3) that broadcast [m].

    The nearest pair of points is inside both segments, or one of them is an end: the four distances
    of an end to the other segment and, where it exists, that of the common perpendicular are
    candidates (Ericson, Real-Time Collision Detection, 2005, section 5.1.9, solved by cases instead
    of clamping, so that nearly parallel segments are exact).
    """
    ends = [
        _point_distances(a0, b0, b1),
        _point_distances(a1, b0, b1),
        _point_distances(b0, a0, a1),
        _point_distances(b1, a0, a1),
    ]
    return np.minimum.reduce([*ends, _inside_distances(a0, a1, b0, b1)])


def between(one, other) -> float:
    """Shortest distance [m] between two polylines (n, 3) and (m, 3) [m]."""
    return float(_table(one, other).min())


def with_itself(line, aside: float) -> float:
    """Shortest distance [m] of a polyline (n, 3) to itself, apart from neighbours.

    Two segments are neighbours where less than `aside` [m] of the line lies between them. Infinite
    where all are neighbours.
    """
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    apart = arc[None, :-1] - arc[1:, None] >= aside  # from the end of one to the start of a later one
    return float(np.where(apart, _table(line, line), np.inf).min())


def _table(one, other) -> np.ndarray:
    """(n-1, m-1) distances between all segments."""
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    return segment_distances(one[:-1, None], one[1:, None], other[None, :-1], other[None, 1:])


def _dot(a, b):
    return np.einsum("...i,...i->...", a, b)


def _point_distances(point, start, end) -> np.ndarray:
    along = end - start
    share = np.clip(_dot(point - start, along) / np.maximum(_dot(along, along), _TINY), 0.0, 1.0)
    return np.linalg.norm(point - start - share[..., None] * along, axis=-1)


def _inside_distances(a0, a1, b0, b1) -> np.ndarray:
    """Length of the common perpendicular where its feet lie inside both segments, else infinity."""
    u, v, w = a1 - a0, b1 - b0, b0 - a0
    normal = np.cross(u, v)
    square = _dot(normal, normal)
    safe = np.where(square > 0, square, 1.0)
    s, t = _dot(np.cross(w, v), normal) / safe, _dot(np.cross(w, u), normal) / safe
    inside = (square > 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return np.where(inside, np.abs(_dot(w, normal)) / np.sqrt(safe), np.inf)
