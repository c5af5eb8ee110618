"""Where a centreline is inside obstacles, and the near way out.

Owns: a view of all shapes and bores where they are at one moment (Surroundings). Pure geometry, in Python; no
step asks for it, and it goes with no room of the core.
"""

from itertools import compress
from typing import NamedTuple

import numpy as np

from .errors import InvalidValue
from .link_shapes import turned_box
from .shapes import Shape
from .tunnels import Bores

INSIDE = ("allow", "push_out", "error")  # what to do about a centreline that begins inside an obstacle
TOUCH = 1e-9  # share of a shape's or segment's size up to which depth is rounding
END = 1e-6  # share of a segment at its ends that may touch a surface: a particle set on a bone is not inside
SAMPLES = np.linspace(0.0, 1.0, 9)  # of a segment that crosses a mesh, to find how deep it goes
ROUNDS = 60  # of pushing out, after which there is no way out
CLOSE = 0.1  # share of its length below which a segment that is pushed out is too short
DEPARTING = 10  # radii from an attachment within which a tendon may be nearer than its radius
NEARLY = 1e-3  # share of its radius by which a tendon that is pushed out may still be too near
WAYS = 6  # directions tried for all that is inside together


class Penetrations(NamedTuple):
    """Segments that are inside or cross the surface: rows of one shape, in one frame.

    segment (k,); u (k,): where they are deepest, 0 ... 1; depth (k,) [m] of the centreline there; normal
    (k, 3): the near way out. Where a surface is crossed that has no inside, or hardly entered, depth and
    normal are nan.
    """

    segment: np.ndarray
    u: np.ndarray
    depth: np.ndarray
    normal: np.ndarray


class Obstacle(NamedTuple):
    """A shape in the world: origin (3,) [m] and axes (3, 3) of its frame, and the link it belongs to."""

    bodyUniqueId: int
    linkIndex: int
    shape: Shape
    origin: np.ndarray
    axes: np.ndarray

    def box(self) -> np.ndarray:
        """(2, 3) lowest and highest corner of a box around it along the world's axes [m]."""
        low, high = self.shape.bounds
        if np.isinf([low, high]).any():
            return np.array([[-np.inf] * 3, [np.inf] * 3])
        return turned_box(low, high, self.origin, self.axes)

    def penetrated(self, a, b) -> Penetrations:
        """By segments a -> b (k, 3), world frame; see Penetrations."""
        found = penetrations(self.shape, (a - self.origin) @ self.axes, (b - self.origin) @ self.axes)
        return found._replace(normal=found.normal @ self.axes.T)

    def overlapped(self, a, b, radius: float) -> Penetrations:
        """By tendons of a radius [m] around segments a -> b (k, 3), world frame, that are outside themselves.

        depth (k,) is that of the tendon's surface [m], and u (k,) where the segment is nearest.
        """
        a, b = (a - self.origin) @ self.axes, (b - self.origin) @ self.axes
        if self.shape.half_space is not None:
            near = np.arange(len(a))
            u, depth, normal = _below(self.shape.half_space, a, b)
            gap = -depth
        else:
            near = np.flatnonzero(self._beside(a, b) < radius)
            gap, point, u = _nearest(self.shape, a[near], b[near])
            out = a[near] + u[:, None] * (b - a)[near] - point
            normal = out / np.where(gap > 0.0, gap, 1.0)[:, None]
        over = (gap > TOUCH * radius) & (gap < radius)
        return Penetrations(near[over], u[over], radius - gap[over], normal[over] @ self.axes.T)

    def gaps(self, a, b, most: float) -> np.ndarray:
        """(k,) distances of segments a -> b (k, 3), world frame [m]: beyond `most`, bounds from below.

        What is inside has the distance 0.
        """
        a, b = (a - self.origin) @ self.axes, (b - self.origin) @ self.axes
        if self.shape.half_space is not None:
            return np.maximum(-_below(self.shape.half_space, a, b)[1], 0.0)
        found = self._beside(a, b)
        near = np.flatnonzero(found < most)
        found[near] = np.maximum(_nearest(self.shape, a[near], b[near])[0], 0.0)
        return found

    def _beside(self, a, b) -> np.ndarray:
        """(k,) bounds from below of the distances of segments a -> b (k, 3), its frame: by its box [m]."""
        low, high = self.shape.bounds
        beside = np.maximum(np.maximum(low - np.maximum(a, b), np.minimum(a, b) - high), 0.0)
        return np.linalg.norm(beside, axis=1)


def _nearest(shape: Shape, a, b):
    """As Shape.measure, but 0 where a segment crosses a mesh; the core searches that, not FCL."""
    if shape.interior is None or not len(a):
        return shape.measure(a, b)
    distance, u, *point = shape.measured.nearest(a, b).T
    return distance, np.transpose(point), u


def penetrations(shape: Shape, a, b) -> Penetrations:
    """By segments a -> b (k, 3) in the shape's frame [m]; a == b is a point.

    Where a segment begins with the end of the one before it, what was found of that one is used.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    low, high = shape.bounds
    near = np.flatnonzero((np.maximum(a, b) >= low).all(1) & (np.minimum(a, b) <= high).all(1))
    if not len(near):
        return Penetrations(near, np.empty(0), np.empty(0), np.empty((0, 3)))
    if shape.half_space is not None:
        u, depth, normal = _below(shape.half_space, a[near], b[near])
    elif shape.interior is None:
        u, depth, normal = _in_solid(shape, a[near], b[near])
    else:
        u, depth, normal = _in_mesh(shape, a[near], b[near])
    size = np.abs([a[near], b[near]]).max() if np.isinf(low).any() else np.ptp(shape.bounds, axis=0).max()
    inside = ~(depth <= TOUCH * size)  # nan counts
    return Penetrations(near[inside], u[inside], depth[inside], normal[inside])


def _below(half_space, a, b):
    normal = half_space[:3]
    heights = np.stack([a @ normal, b @ normal]) - half_space[3]
    return heights.argmin(0).astype(float), -heights.min(0), np.tile(normal, (len(a), 1))


def _in_solid(shape: Shape, a, b):
    """Of boxes, spheres, capsules, cylinders and convex hulls, whose distances are signed."""
    distance, point, u = shape.measure(a, b)
    out = point - (a + u[:, None] * (b - a))
    size = np.linalg.norm(out, axis=1)[:, None]
    return u, -distance, out / np.where(size > 0.0, size, 1.0)


def _in_mesh(shape: Shape, a, b):
    """Of triangles: segments that cross them are sampled; others are inside with both ends or not at all."""
    trim = END * (b - a)
    crossed = shape.measured.crossed(a + trim, b - trim)
    u, depth, normal = np.full(len(a), 0.5), np.full(len(a), np.nan), np.full((len(a), 3), np.nan)
    depth[~crossed] = 0.0
    if not shape.interior.closed:
        return u, depth, normal
    inside = ~crossed & _inside_runs(shape, a, b, crossed)
    for rows, places in ((np.flatnonzero(inside), SAMPLES[[0, -1]]), (np.flatnonzero(crossed), SAMPLES)):
        if len(rows):
            found = _deepest(shape, a[rows], b[rows], places, known=places.size == 2)
            u[rows], depth[rows], normal[rows] = found
    return u, depth, normal


def _inside_runs(shape: Shape, a, b, crossed) -> np.ndarray:
    """Inside or outside, of segments: asked once for all that hang together without crossing the surface."""
    joined = (a[1:] == b[:-1]).all(1) & ~crossed[1:] & ~crossed[:-1]
    run = np.concatenate([[0], np.cumsum(~joined)])
    first = np.unique(run, return_index=True)[1]
    return shape.interior.contains(0.5 * (a + b)[first])[run]


def _deepest(shape: Shape, a, b, places, known: bool):
    """u, depth and way out of each segment's deepest sample; nan where no sample is inside."""
    x = a[:, None] + places[:, None] * (b - a)[:, None]
    flat = x.reshape(-1, 3)
    inside = np.ones(len(flat), bool) if known else shape.interior.contains(flat)
    distance, point, _ = shape.measure(flat, flat)
    depth = np.where(inside, np.maximum(distance, 0.0), -1.0).reshape(x.shape[:2])
    pick = np.arange(len(a)), depth.argmax(1)
    depth, out = depth[pick], (point.reshape(x.shape) - x)[pick]
    none = depth <= 0.0
    normal = out / np.where(none, np.nan, depth)[:, None]
    return places[pick[1]], np.where(none, np.nan, depth), normal


class Surroundings:
    """All obstacles and bores, where they are now."""

    def __init__(self, obstacles: list[Obstacle], bores: Bores):
        self._obstacles = obstacles
        self._bores = bores
        self._boxes = np.array([obstacle.box() for obstacle in obstacles]).reshape(-1, 2, 3)

    def gaps(self, line, most: float) -> np.ndarray:
        """(n-1,) distances of a line's segments from obstacles and bores [m]: see Obstacle.gaps."""
        found = [obstacle.gaps(line[:-1], line[1:], most) for obstacle in self._obstacles]
        return np.min([np.full(len(line) - 1, np.inf), self._bores.gaps(line), *found], axis=0)

    def penetrated(self, a, b) -> list[tuple[Obstacle, Penetrations]]:
        """By segments a -> b (k, 3), world frame, of which no bore has a part, and of which obstacles."""
        return self._found(a, b, 0.0, lambda obstacle, a, b: obstacle.penetrated(a, b))

    def overlapped(self, a, b, radius: float) -> list[tuple[Obstacle, Penetrations]]:
        """The same by tendons of a radius [m] around them: see Obstacle.overlapped."""
        return self._found(a, b, radius, lambda obstacle, a, b: obstacle.overlapped(a, b, radius))

    def _found(self, a, b, reach: float, rows_of) -> list[tuple[Obstacle, Penetrations]]:
        found = []
        low, high = np.minimum(a, b).min(0) - reach, np.maximum(a, b).max(0) + reach
        near = ((self._boxes[:, 0] <= high) & (self._boxes[:, 1] >= low)).all(1)
        for obstacle in compress(self._obstacles, near):
            link = obstacle.bodyUniqueId, obstacle.linkIndex
            asked = np.flatnonzero(~self._bores.hold(*link, a, b))
            rows = rows_of(obstacle, a[asked], b[asked])
            if len(rows.segment):
                found.append((obstacle, rows._replace(segment=asked[rows.segment])))
        return found

    def without_overlap(self, line, radius: float, tied) -> np.ndarray:
        """A line (n, 3), outside, that is pushed a radius [m] away from obstacles.

        None is pushed beside the particles that are tied, which may be nearer.
        """
        line, (start, end) = np.array(line, float), np.zeros((2, len(line), 3))
        free = self.free(line, radius, tied)
        for _ in range(ROUNDS if len(free) else 0):
            found = self.overlapped(line[free], line[free + 1], radius)
            if max((rows.depth.max() for _, rows in found), default=0.0) <= NEARLY * radius:
                break
            start[free], end[free + 1] = _shifts(found, len(free), 0.0)
            line += _longer(start, end)
        return line

    @staticmethod
    def free(line, radius: float, tied) -> np.ndarray:
        """The segments of a line (n, 3) that keep a radius [m] from obstacles: far from what is tied."""
        arcs = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        away = np.min([np.full(len(arcs), np.inf), *(np.abs(arcs - arcs[k]) for k in tied)], axis=0)
        return np.flatnonzero(np.minimum(away[:-1], away[1:]) >= DEPARTING * radius)

    def cleared(self, line, radius: float, inside: str) -> np.ndarray:
        """The line (n, 3), pushed out if so wanted; InvalidValue where it is inside an obstacle."""
        if inside == "push_out":
            line = self.pushed_out(line, radius)
            inserted = [k for k in (0, -1) if self.gaps(line[[k, k]], radius)[0] < radius]
            line = self.without_overlap(line, radius, inserted)
        for obstacle, rows in self.penetrated(line[:-1], line[1:]):
            link = f"body {obstacle.bodyUniqueId}, link {obstacle.linkIndex}"
            way = ", or with a short way out of them" if inside == "push_out" else ""
            where = f"a centreline in {link} at segment {rows.segment[0]}"
            raise InvalidValue("points", where, f"outside all obstacles{way}")
        return line

    def pushed_out(self, line, radius: float) -> np.ndarray:
        """A centreline (n, 3) of which nothing is inside, by the near way out, where one is found.

        What is inside is put about a radius [m] outside the surface: each particle over its nearest point or,
        where that puts neighbours on opposite sides of a bone, all the same way.
        """
        pushed = self._over_nearest(line, radius)
        if not self.penetrated(pushed[:-1], pushed[1:]):
            return self._apart(pushed, line, radius)
        slid = [self._all_one_way(line, way, radius) for way in self._ways(line)]
        for other in sorted(slid, key=lambda x: np.abs(x - line).max()):
            other = self._over_nearest(other, radius)
            if not self.penetrated(other[:-1], other[1:]):
                return self._apart(other, line, radius)
        return pushed

    def _apart(self, pushed, line, radius: float) -> np.ndarray:
        """`pushed`, whose particles are spaced along it as they are along `line`, if some of them met.

        Particles inside an edge are put over both of its faces, and meet at what is nearest to them there.
        """
        before, after = (np.linalg.norm(np.diff(x, axis=0), axis=1) for x in (line, pushed))
        for _ in range(ROUNDS):
            if (after >= CLOSE * before).all():
                break
            along, places = (np.append(0.0, np.cumsum(h / h.sum())) for h in (after, before))
            pushed = np.column_stack([np.interp(places, along, pushed[:, k]) for k in range(3)])
            pushed = self._over_nearest(pushed, radius)
            after = np.linalg.norm(np.diff(pushed, axis=0), axis=1)
        return pushed

    def _over_nearest(self, line, radius: float) -> np.ndarray:
        """Particles first; then segments, which are inside only where they cut corners."""
        line = np.array(line, float)
        nothing = np.zeros((1, 3))
        for _ in range(ROUNDS):
            shift = _shifts(self.penetrated(line, line), len(line), radius)[0]
            if not shift.any():
                start, end = _shifts(self.penetrated(line[:-1], line[1:]), len(line) - 1, radius)
                shift = _longer(np.vstack([start, nothing]), np.vstack([nothing, end]))
            if not shift.any():
                break
            line += shift
        return line

    def _all_one_way(self, line, way, radius: float) -> np.ndarray:
        """Particles that are inside, moved along `way` by little more than their depth until they are out."""
        line = np.array(line, float)
        for _ in range(ROUNDS):
            shift = _shifts(self.penetrated(line, line), len(line), radius)[0]
            if not shift.any():
                break
            line += np.linalg.norm(shift, axis=1)[:, None] * way
        return line

    def _ways(self, line) -> np.ndarray:
        """(k, 3) a few of the directions in which particles that are inside find their nearest way out."""
        found = self.penetrated(line, line)
        ways = np.concatenate(
            [rows.normal[np.isfinite(rows.depth)] for _, rows in found] or [np.zeros((0, 3))]
        )
        return ways[np.unique(np.linspace(0, len(ways) - 1, WAYS).astype(int))] if len(ways) else ways


def _shifts(found, count: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """The largest shifts (count, 3) of segments' ends that bring their deepest point a radius outside."""
    start, end = np.zeros((count, 3)), np.zeros((count, 3))
    for _, rows in found:
        known = np.isfinite(rows.depth)
        k, u = rows.segment[known], rows.u[known, None]
        way = (rows.depth[known, None] + radius) * rows.normal[known] / ((1.0 - u) ** 2 + u**2)
        start[k], end[k] = _longer(start[k], (1.0 - u) * way), _longer(end[k], u * way)
    return start, end


def _longer(a, b) -> np.ndarray:
    """Row by row, the longer of two vectors."""
    longer = np.einsum("ij,ij->i", a, a) >= np.einsum("ij,ij->i", b, b)
    return np.where(longer[:, None], a, b)
