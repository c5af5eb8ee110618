"""Collision shapes of pybullet bodies, and distances from a tendon's centreline to them.

The only file that talks to FCL, which measures meshes; boxes, spheres, capsules and cylinders have closed
forms (closed_forms.py), planes the core does itself. Distances are to the surface as drawn: without Bullet's
collision margin (about a millimetre around meshes) and without the tendon's radius.

How FCL is asked, found by measuring python-fcl 0.7 against exact distances: a segment is a mesh of one
triangle without area. FCL then uses its closed triangle-triangle form, right to rounding and two to three
times faster than a thin capsule, whose iterative solver is up to 5e-4 m wrong; a sphere's finds 0 far away.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import frexp, inf, sqrt

import fcl
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from . import checks, closed_forms
from .errors import InvalidValue
from .link_shapes import LinkShape, read_link
from .mesh_files import clean_triangles

UNIT_SIZE = 1000.0  # FCL's meshes are scaled to this size: its tests for degenerate triangles are absolute
SMALLEST_NORMAL = 1e-13  # squared, in that unit; FCL takes a triangle under 1e-15 for degenerate
_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)


@dataclass(eq=False)
class Shape:
    """One collision shape, fixed in a link's frame (the URDF link frame, not the inertial frame).

    kind: "box", "sphere", "cylinder", "capsule", "plane" or "mesh".
    position (3,) [m], rotation (3, 3): the origin and axes of the shape's frame in the link's frame.
    bounds (2, 3): lowest and highest corner of a box around the shape, in the shape's frame [m].
    half_space (4,): of a plane, the unit normal n and offset c in the shape's frame; n . x = c: its surface.
    """

    kind: str
    position: np.ndarray
    rotation: np.ndarray
    bounds: np.ndarray
    half_space: np.ndarray | None = None
    query: Callable | None = field(default=None, repr=False)  # (a, d) -> (distance, point, u)

    def measure(self, a, b) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance of k segments a -> b (k, 3), in the shape's frame [m]; a == b is a point.

        Returns distance (k,), surface point (k, 3) and u (k,), the nearest point being a + u (b - a). Inside
        a box, sphere, capsule, cylinder or convex mesh the distance is negative and the point the way out.
        Where the segment crosses the surface of another mesh it is -1, and the point means nothing; wholly
        inside such a mesh it is the positive distance to the surface.
        """
        if self.query is None:
            raise InvalidValue("kind", self.kind, "anything but a plane, which has a closed form: half_space")
        if not len(a) and not len(b):
            return np.empty(0), np.empty((0, 3)), np.empty(0)
        a = checks.array("a", a, (None, 3))  # also keeps NaN from FCL, which may hang on it
        b = checks.array("b", b, (len(a), 3))
        answers = [self.query(start, way) for start, way in zip(a.tolist(), (b - a).tolist(), strict=True)]
        distance, point, u = zip(*answers, strict=True)
        return np.array(distance), np.array(point), np.array(u)


def collision_shapes(
    bodyUniqueId: int, linkIndex: int, physicsClientId: int = 0, convex: bool | None = None, meshes=()
) -> list[Shape]:
    """Mirror every collision shape of a link (-1: the base); a mesh of several hulls gives several shapes.

    convex: None takes each mesh as pybullet collides with it, as its triangles or their convex hull; True
    takes hulls; False takes the triangles even where pybullet made a hull of them (as for a moving bone).
    meshes: in order, one for each mesh whose triangles are needed and that pybullet does not tell: a path, or
    vertices (v, 3) [m] and triangles (t, 3) of vertex indices; in the shape's frame, scaled already. Needed
    for concave meshes made by createCollisionShape; a URDF's files are found, from the working directory.
    """
    return [_mirror(shape) for shape in read_link(bodyUniqueId, linkIndex, physicsClientId, convex, meshes)]


def _mirror(shape: LinkShape) -> Shape:
    frame = shape.position, shape.rotation
    if shape.kind == "plane":
        return plane(shape.sizes, 0.0, *frame)
    if shape.kind != "mesh":
        return primitive(shape.kind, shape.sizes, *frame)
    if shape.triangles is None:
        return convex_mesh(shape.vertices, *frame)
    return mesh(shape.vertices, shape.triangles, *frame)


def primitive(kind: str, sizes, position=(0, 0, 0), rotation=None) -> Shape:
    """kind "box": edge lengths; "sphere": (radius,); "capsule", "cylinder": (radius, length along z) [m].

    A capsule's length is that of its straight part, as in pybullet.
    """
    sizes = checks.array("sizes", sizes, (None,)).tolist()
    if min(sizes) <= 0.0:
        raise InvalidValue("sizes", sizes, "> 0")
    core, corner = closed_forms.core_of(kind, sizes)
    bounds = np.array([[-c for c in corner], corner])
    return Shape(kind, *_frame(position, rotation), bounds, None, partial(closed_forms.measure, core))


def plane(normal, offset: float = 0.0, position=(0, 0, 0), rotation=None) -> Shape:
    """The half-space normal . x <= offset is solid [m]; `normal` (3,) need not be a unit vector."""
    normal = checks.vector("normal", normal)
    length = np.linalg.norm(normal)
    if length == 0.0:
        raise InvalidValue("normal", normal, "a vector with a length")
    half_space = np.append(normal, offset) / length
    return Shape("plane", *_frame(position, rotation), np.array([[-inf] * 3, [inf] * 3]), half_space)


def mesh(vertices, triangles, position=(0, 0, 0), rotation=None) -> Shape:
    """Vertices (v, 3) [m] and triangles (t, 3) of vertex indices; may be open or non-manifold."""
    vertices = checks.array("vertices", vertices, (None, 3))
    triangles = np.asarray(triangles, int)
    used = vertices[np.unique(triangles)]
    query = _MeshQuery(vertices, triangles)
    return Shape("mesh", *_frame(position, rotation), np.array([used.min(0), used.max(0)]), None, query)


def convex_mesh(vertices, position=(0, 0, 0), rotation=None) -> Shape:
    """The convex hull of vertices (v, 3) [m]."""
    vertices = checks.array("vertices", vertices, (None, 3))
    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError) as error:
        raise InvalidValue("vertices", vertices, "the corners of a hull that has a volume") from error
    bounds = np.array([vertices.min(0), vertices.max(0)])
    query = _ConvexQuery(hull)
    return Shape("mesh", *_frame(position, rotation), bounds, None, query)


def _frame(position, rotation) -> tuple[np.ndarray, np.ndarray]:
    rotation = np.eye(3) if rotation is None else np.asarray(rotation, float)
    return np.array(position, float), rotation


class _MeshQuery:
    """Distance from segments to triangles, by FCL; FCL's copy of the mesh is centred and scaled."""

    def __init__(self, vertices, triangles):
        low, high = vertices[triangles].min((0, 1)), vertices[triangles].max((0, 1))
        size = float((high - low).max())
        self.centre = (0.5 * (low + high)).tolist()
        self.scale = UNIT_SIZE / size if size > 0.0 else 1.0
        scaled = (vertices - self.centre) * self.scale
        self.model = _fcl_mesh(*clean_triangles(scaled, triangles, SMALLEST_NORMAL))

    def __call__(self, a, d) -> tuple:
        """a (3 floats), d = b - a [m] -> distance, point, u; -1 where the segment crosses a triangle."""
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
            return self._ask(_piece(0.0), start)
        way = d[0] * k / length, d[1] * k / length, d[2] * k / length
        half = 0.5 ** (2 - frexp(length)[1])  # length / 4 <= half <= length / 2
        piece = _piece(2.0 * half)
        piece.setQuatRotation(_turn(*way))
        first = self._ask(piece, [s + half * w for s, w in zip(start, way, strict=True)])
        if first[0] <= 0.0 or length == 2.0 * half:
            return first
        rest = length - half
        return min(first, self._ask(piece, [s + rest * w for s, w in zip(start, way, strict=True)]))

    def _ask(self, piece, centre) -> tuple:
        piece.setTranslation(np.array(centre))
        result = fcl.DistanceResult()  # a used one keeps its old, smaller value
        distance = fcl.distance(piece, self.model, _REQUEST, result)
        return distance, result.nearest_points[1].tolist()


class _ConvexQuery(_MeshQuery):
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


_pieces: dict[float, fcl.CollisionObject] = {}  # FCL's objects leak when dropped: made once, then moved


def _piece(length: float) -> fcl.CollisionObject:
    """A segment along z, centred, as a mesh of one triangle without area."""
    if length not in _pieces:
        ends = np.array([[0.0, 0.0, -0.5 * length], [0.0, 0.0, 0.5 * length], [0.0, 0.0, 0.5 * length]])
        _pieces[length] = _fcl_mesh(ends, np.array([[0, 1, 2]]))
    return _pieces[length]


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
