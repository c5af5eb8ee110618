"""Slow, exact distances to compare against (they share no code and no formula with the package), and scenes.

Segments are a -> b, rows of (k, 3) arrays; triangles are (t, 3, 3).
"""

import itertools

import numpy as np


def signed_distance(kind, sizes, x):
    """(...,) for points x (..., 3), by the shape's implicit function; sizes as in shapes.primitive."""
    x = np.asarray(x, float)
    rho, z = np.hypot(x[..., 0], x[..., 1]), np.abs(x[..., 2])
    if kind == "sphere":
        return np.linalg.norm(x, axis=-1) - sizes[0]
    if kind == "capsule":
        return np.hypot(rho, np.maximum(z - sizes[1] / 2, 0.0)) - sizes[0]
    if kind == "box":
        over = np.abs(x) - np.asarray(sizes) / 2
    else:
        over = np.stack([rho - sizes[0], z - sizes[1] / 2], axis=-1)
    return np.linalg.norm(np.maximum(over, 0.0), axis=-1) + np.minimum(over.max(-1), 0.0)


def segment_primitive(kind, sizes, a, b):
    """Smallest signed distance (k,) along each segment: it is convex along a line, so thirds find it."""
    low, high = np.zeros((len(a), 1)), np.ones((len(a), 1))

    def at(u):
        return signed_distance(kind, sizes, a + u * (b - a))

    for _ in range(120):
        third = (high - low) / 3
        rises = (at(low + third) <= at(high - third))[:, None]
        low, high = np.where(rises, low, low + third), np.where(rises, high - third, high)
    return np.minimum(at((low + high) / 2), np.minimum(at(0.0), at(1.0)))


def point_triangles(x, triangles):
    """Distance (t,) of one point (3,) to each triangle: its edges, and its plane within them."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    best = np.full(len(triangles), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        best = np.minimum(best, np.linalg.norm(x - p - _clamped(x - p, q - p) * (q - p), axis=1))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    within = size > 0
    for p, q in ((a, b), (b, c), (c, a)):
        within &= _dot(np.cross(q - p, x - p), normal) >= 0
    height = np.abs(_dot(x - a, normal)) / np.where(size > 0, size, 1.0)
    return np.where(within, np.minimum(height, best), best)


def segment_triangles(a, b, triangles):
    """Smallest distance of one segment a (3,) -> b (3,) to the triangles, 0 where it crosses one."""
    best = min(point_triangles(a, triangles).min(), point_triangles(b, triangles).min())
    p, q, r = np.moveaxis(triangles, 1, 0)
    for start, end in ((p, q), (q, r), (r, p)):
        best = min(best, segment_segments(a, b, start, end).min())
    return 0.0 if _crosses(a, b, p, q, r).any() else best


class Triangles:
    """segment_triangles for many segments: triangles whose circles are too far are left out."""

    def __init__(self, triangles):
        self.triangles = triangles
        self.centres = triangles.mean(1)
        self.radii = np.linalg.norm(triangles - self.centres[:, None], axis=2).max(1)

    def distance(self, a, b):
        way = np.broadcast_to(b - a, self.centres.shape)
        off = np.linalg.norm(a + _clamped(self.centres - a, way) * way - self.centres, axis=1)
        return segment_triangles(a, b, self.triangles[off - self.radii <= off.min() * (1 + 1e-9) + 1e-12])


def segment_segments(a, b, p, q):
    """Distance (...,) of segments a -> b to segments p -> q, of shapes (..., 3) that fit each other.

    Each end against the other segment, and the lines' common normal where its feet are within both.
    """
    best = np.inf
    for end in (a, b):
        best = np.minimum(best, np.linalg.norm(end - p - _clamped(end - p, q - p) * (q - p), axis=-1))
    for end in (p, q):
        best = np.minimum(best, np.linalg.norm(end - a - _clamped(end - a, b - a) * (b - a), axis=-1))
    normal = np.cross(b - a, q - p)
    square = _dot(normal, normal)
    safe = np.where(square > 0, square, 1.0)
    u = _dot(np.cross(p - a, q - p), normal) / safe
    v = _dot(np.cross(p - a, b - a), normal) / safe
    parallel = square <= 1e-24 * _dot(b - a, b - a) * _dot(q - p, q - p)  # then the ends speak for all
    within = ~parallel & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    apart = np.abs(_dot(p - a, normal)) / np.sqrt(safe)
    return np.where(within, np.minimum(apart, best), best)


def _crosses(a, b, p, q, r):
    """Whether the segment's ends are on both sides of each triangle, and its line runs round no edge."""
    volumes = np.stack([_volume(a, b, p, q), _volume(a, b, q, r), _volume(a, b, r, p)])
    same = (volumes >= 0).all(0) | (volumes <= 0).all(0)
    return same & (_volume(p, q, r, a) * _volume(p, q, r, b) < 0)


def _volume(a, b, c, d):
    return _dot(np.cross(b - a, c - a), d - a)


def _clamped(x, way):
    square = _dot(way, way) + 0.0 * x[..., 0]
    u = _dot(x, np.broadcast_to(way, x.shape)) / np.where(square > 0, square, 1.0)
    return np.clip(u, 0.0, 1.0)[..., None]


def _dot(a, b):
    return np.einsum("...i,...i->...", *np.broadcast_arrays(a, b))


def torus(big=0.2, small=0.07, around=12, along=9):
    """Vertices and triangles of a closed mesh with a hole and hollows."""
    s, t = np.meshgrid(*(2 * np.pi * np.arange(n) / n for n in (around, along)), indexing="ij")
    ring = big + small * np.cos(t)
    vertices = np.stack([ring * np.cos(s), ring * np.sin(s), small * np.sin(t)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(along), indexing="ij")
    at = lambda i, j: ((i % around) * along + j % along).ravel()  # noqa: E731
    first = np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], -1)
    return vertices, np.concatenate([first, np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], -1)])


def random_segments(rng, count, shape, tiny=0.2):
    """Segments around a shape: far, near and crossing; some along axes, a share `tiny` of them points."""
    size = np.ptp(shape.bounds, axis=0).max()
    a = shape.bounds.mean(0) + rng.normal(size=(count, 3)) * size * rng.choice([0.4, 0.7, 3.0], (count, 1))
    way = rng.normal(size=(count, 3)) * size * 10 ** rng.uniform(-4, 0, (count, 1))
    along = rng.random(count) < 0.2
    way[along] *= np.eye(3)[rng.integers(3, size=along.sum())]
    way[rng.random(count) < tiny] = 0.0
    return a, a + way


def check_pairs(a, b, distance, point, u, outside):
    """What must hold of every answer, and where `outside`, that the pair is as far apart as said."""
    assert np.isfinite(distance).all() and np.isfinite(point).all()
    assert (u >= 0).all() and (u <= 1).all()
    gap = np.linalg.norm(a + u[:, None] * (b - a) - point, axis=1)
    assert np.abs(gap - np.abs(distance))[outside].max() <= 1e-9


def subdivided(x, parts):
    """Points along a polyline, `parts` to each segment."""
    u = np.arange(parts) / parts
    return np.vstack([((1 - u)[:, None] * a + u[:, None] * b) for a, b in itertools.pairwise(x)] + [x[-1:]])
