"""Directions, and distances of centrelines, measured apart from the solver's own contact search."""

import numpy as np

_TINY = np.finfo(float).tiny


def unit(vector) -> np.ndarray:
    """The direction of a vector that is not zero."""
    return vector / np.linalg.norm(vector)


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
    return _shortest(one, other, np.ones((len(one) - 1, len(other) - 1), dtype=bool))


def with_itself(line, aside: float, rest=None) -> float:
    """Shortest distance [m] of a polyline (n, 3) to itself, apart from neighbours.

    Two segments are neighbours where less than `aside` [m] of the line lies between the end of one and
    the start of the other; rest: (n-1,) lengths [m] that this is counted by (None: the segments' own).
    Infinite where all are neighbours.
    """
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1) if rest is None else rest
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    apart = arc[None, :-1] - arc[1:, None] >= aside  # from the end of one to the start of a later one
    return _shortest(line, line, apart)


def rest_lengths(tendon) -> np.ndarray:
    """(n-1,) lengths of a tendon's segments without load [m], from their strains."""
    return np.linalg.norm(np.diff(tendon.positions, axis=0), axis=1) / (1 + tendon.strain)


def to_triangles(point, triangles) -> float:
    """Distance [m] of a point (3,) from the nearest of triangles (t, 3, 3).

    Of their edges and, where the point is above a triangle, its plane.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    above = np.ones(len(a), bool)
    best = np.inf
    for start, end in ((a, b), (b, c), (c, a)):
        best = min(best, _point_distances(point, start, end).min())
        above &= _dot(np.cross(end - start, point - start), normal) >= 0
    height = np.abs(_dot(point - a, normal)) / np.maximum(np.linalg.norm(normal, axis=1), _TINY)
    return float(min(best, height[above].min(initial=np.inf)))


def _shortest(one, other, wanted) -> float:
    """Shortest distance between those segments of two polylines that are wanted, (n-1, m-1) bool.

    Middles of segments bound their distance from above, and less half of both lengths from below.
    """
    one, other = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    i, j = np.nonzero(wanted)
    if not len(i):
        return np.inf
    middles = (0.5 * (line[1:] + line[:-1]) for line in (one, other))
    halves = [0.5 * np.linalg.norm(np.diff(line, axis=0), axis=1) for line in (one, other)]
    apart = _all_distances(*middles)[i, j]
    near = apart - halves[0][i] - halves[1][j] <= apart.min()
    i, j = i[near], j[near]
    return float(segment_distances(one[i], one[i + 1], other[j], other[j + 1]).min())


def _all_distances(a, b) -> np.ndarray:
    return np.sqrt(sum((a[:, None, axis] - b[None, :, axis]) ** 2 for axis in range(3)))


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
