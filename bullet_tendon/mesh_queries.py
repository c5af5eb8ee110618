"""Distances from a segment to triangles and to convex hulls: the only file that talks to FCL.

Owns: FCL's objects, those of one mesh by one MeshQuery, so that nothing of FCL is shared by worlds. Goes with
the core's room `geometry`, which keeps the triangles that were near and asks only where they do not decide.

How FCL is asked, found by measuring python-fcl 0.7 against exact distances: a segment is a mesh of one
triangle without area. FCL then uses its closed triangle-triangle form, right to rounding and two to three
times faster than a thin capsule, whose iterative solver is up to 5e-4 m wrong; a sphere's finds 0 far away.
"""

from math import frexp, sqrt
from threading import Lock

import fcl
import numpy as np

from .mesh_files import clean_triangles

UNIT_SIZE = 1000.0  # FCL's meshes are scaled to this size: its tests for degenerate triangles are absolute
SMALLEST_NORMAL = 1e-13  # squared, in that unit; FCL takes a triangle under 1e-15 for degenerate
_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)


class MeshQuery:
    """Distance from segments to triangles, by FCL; FCL's copy of the mesh is centred and scaled.

    Every FCL object belongs to one query, and a query to one world: what another world in another thread
    measures cannot move them. A lock keeps two threads apart that ask the same query.
    """

    def __init__(self, vertices, triangles):
        low, high = vertices[triangles].min((0, 1)), vertices[triangles].max((0, 1))
        size = float((high - low).max())
        self.centre = (0.5 * (low + high)).tolist()
        self.scale = UNIT_SIZE / size if size > 0.0 else 1.0
        scaled, triangles = clean_triangles((vertices - self.centre) * self.scale, triangles, SMALLEST_NORMAL)
        self.corners = scaled[triangles] / self.scale + self.centre  # (t, 3, 3) [m], of what is measured
        self.model = _fcl_mesh(scaled, triangles)
        self._pieces: dict[float, fcl.CollisionObject] = {}  # by length; FCL's objects leak when dropped
        self._lock = Lock()

    def __call__(self, a, d) -> tuple:
        """a (3 floats), d = b - a [m] -> distance, point, u; -1 where the segment crosses a triangle."""
        with self._lock:
            hit, point = self._nearest(a, d)
        square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        if hit <= 0.0:
            return -1.0, (a[0] + 0.5 * d[0], a[1] + 0.5 * d[1], a[2] + 0.5 * d[2]), 0.5
        x, y, z = (p / self.scale + c for p, c in zip(point, self.centre, strict=True))
        along = (x - a[0]) * d[0] + (y - a[1]) * d[1] + (z - a[2]) * d[2]
        u = along / square if square > 0.0 else 0.0
        u = 0.0 if u < 1e-9 else 1.0 if u > 1.0 - 1e-9 else u
        ex, ey, ez = a[0] + u * d[0] - x, a[1] + u * d[1] - y, a[2] + u * d[2] - z
        return sqrt(ex * ex + ey * ey + ez * ez), (x, y, z), u

    def _nearest(self, a, d) -> tuple:
        """FCL's distance and its point on the mesh, both in the mesh's scaled frame.

        FCL's segments come in lengths of powers of two; two of them, one from either end, cover the segment.
        """
        k, c = self.scale, self.centre
        length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * k
        start = (a[0] - c[0]) * k, (a[1] - c[1]) * k, (a[2] - c[2]) * k
        if length < 1e-12 * UNIT_SIZE:
            return self._ask(self._piece(0.0), np.array(start), fcl.DistanceResult())
        way = d[0] * k / length, d[1] * k / length, d[2] * k / length
        half = 0.5 ** (2 - frexp(length)[1])  # length / 4 <= half <= length / 2
        piece = self._piece(2.0 * half)
        piece.setQuatRotation(_turn(*way))
        x, y, z = way
        result = fcl.DistanceResult()
        place = np.array((start[0] + half * x, start[1] + half * y, start[2] + half * z))
        first = self._ask(piece, place, result)
        if first[0] <= 0.0 or length == 2.0 * half:
            return first
        # The used result keeps its value where that is smaller, and spares FCL all that is farther away.
        rest = length - half
        place = np.array((start[0] + rest * x, start[1] + rest * y, start[2] + rest * z))
        return self._ask(piece, place, result)

    def _piece(self, length: float) -> fcl.CollisionObject:
        """A segment along z, centred, as a mesh of one triangle without area; made once, then moved."""
        if length not in self._pieces:
            ends = np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length], [0.0, 0.0, 0.5 * length]])
            self._pieces[length] = _fcl_mesh(ends, np.array([[0, 1, 2]]))
        return self._pieces[length]

    def _ask(self, piece, place, result) -> tuple:
        piece.setTranslation(place)
        distance = fcl.distance(piece, self.model, _REQUEST, result)
        return distance, result.nearest_points[1].tolist()


class ConvexQuery(MeshQuery):
    """The same for a convex hull, whose planes also tell the depth inside."""

    def __init__(self, hull):
        super().__init__(hull.points, hull.simplices)
        self.hull = hull
        self.normals, self.offsets = hull.equations[:, :3].copy(), hull.equations[:, 3].copy()

    def __call__(self, a, d) -> tuple:
        answer = super().__call__(a, d)
        start = self._heights(a, d, 0.0)
        if answer[0] > 0.0 and start.max() > 0.0:  # nothing crosses, so one end speaks for both
            return answer
        return self._push_out(a, d, start, self._heights(a, d, 1.0))

    def _heights(self, a, d, u) -> np.ndarray:
        """Height of a + u d over every face's plane; all below 0 inside."""
        return self.normals @ (a[0] + u * d[0], a[1] + u * d[1], a[2] + u * d[2]) + self.offsets

    def _push_out(self, a, d, start, end) -> tuple:
        """Under the nearest face, at the deepest of the ends and the middle of the part that is inside."""
        slope = end - start
        crossing = -start / np.where(slope == 0.0, 1.0, slope)
        first = crossing[slope < 0.0].max(initial=0.0)
        last = crossing[slope > 0.0].min(initial=1.0)
        _, u = min((self._heights(a, d, u).max(), u) for u in (0.0, 1.0, 0.5 * (first + last)))
        heights = self._heights(a, d, u)
        face = heights.argmax()
        x = np.array(a) + u * np.array(d)
        return min(float(heights[face]), 0.0), tuple(x - heights[face] * self.normals[face]), float(u)


def _turn(x: float, y: float, z: float) -> list:
    """Quaternion (w, x, y, z) that turns z to a unit vector or to its opposite: a piece has no head."""
    if z < 0.0:
        x, y, z = -x, -y, -z
    size = sqrt(2.0 + 2.0 * z)
    return [0.5 * size, -y / size, x / size, 0.0]


def _fcl_mesh(vertices, triangles) -> fcl.CollisionObject:
    model = fcl.BVHModel()
    model.beginModel(len(triangles), len(vertices))
    model.addSubModel(vertices, triangles.tolist())
    model.endModel()
    return fcl.CollisionObject(model)
