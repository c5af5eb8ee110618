"""Collision shapes of pybullet bodies, and distances from a tendon's centreline to them.

Owns: the geometry of one shape in its link's frame. Goes with the core's room `geometry`, which has closed
forms of boxes, spheres, capsules, cylinders and planes; meshes are measured by FCL (mesh_queries.py).

Distances are to the surface as drawn: without Bullet's collision margin (about a millimetre around meshes)
and without the tendon's radius.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import inf

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from . import _core, checks
from .errors import InvalidValue
from .link_shapes import LinkShape, read_link
from .mesh_queries import ConvexQuery, MeshQuery
from .solids import Interior


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
    surface: tuple | None = field(default=None, repr=False)  # vertices and triangles, unless it is a hull

    @cached_property
    def interior(self) -> Interior | None:
        """What is inside of a mesh that is not a hull, whose distances have no sign; None of the others."""
        return None if self.surface is None else Interior(*self.surface)

    @property
    def closed_form(self) -> "_core.Primitive | None":
        """The closed form that the core measures itself, if it has one."""
        return self.query if isinstance(self.query, _core.Primitive) else None

    @property
    def triangles(self) -> np.ndarray:
        """Corners (t, 3, 3) of the triangles that distances are measured from [m]; t = 0: a closed form."""
        return getattr(self.query, "corners", np.empty((0, 3, 3)))

    @cached_property
    def measured(self) -> "_core.Surface | None":
        """These triangles, as the core measures them; None: a closed form."""
        return _core.Surface(self.triangles) if len(self.triangles) else None

    @cached_property
    def solid(self) -> "_core.SignedDistance | None":
        """Signed distances from a closed mesh, for the core; None: a hull, an open mesh or no mesh."""
        inner = self.interior
        return _core.SignedDistance(inner.vertices, inner.triangles) if inner and inner.closed else None

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

    def contains(self, points) -> np.ndarray:
        """(k,) whether points (k, 3) of the shape's frame [m] are inside; of an open mesh, none is."""
        if self.interior is not None:
            return self.interior.contains(points)
        return self.depth(points) > 0.0

    def depth(self, points) -> np.ndarray:
        """(k,) depth [m] of points (k, 3), shape's frame; negative outside, but of a mesh that is no hull.

        The distance to the surface of such a mesh has no sign: it is the depth of points that are inside.
        """
        if self.half_space is not None:
            return self.half_space[3] - points @ self.half_space[:3]
        distance = self.measure(points, points)[0]
        return distance if self.interior is not None else -distance


def collision_shapes(
    bodyUniqueId: int,
    linkIndex: int,
    physicsClientId: int = 0,
    convex: bool | None = None,
    meshes=(),
    concave: Sequence[bool] | None = None,
) -> list[Shape]:
    """Mirror every collision shape of a link (-1: the base); a mesh of several hulls gives several shapes.

    convex: None takes each mesh as pybullet collides with it, as its triangles or their convex hull; True
    takes hulls; False takes the triangles even where pybullet made a hull of them (as for a moving bone).
    meshes: in order, one for each mesh whose triangles are needed and that pybullet does not tell: a path, or
    vertices (v, 3) [m] and triangles (t, 3) of vertex indices; in the shape's frame, as large as pybullet's.
    Needed for concave meshes made by createCollisionShape, whose meshScale pybullet does not tell; a URDF's
    files are found, from the working directory.
    concave: of the link's <collision> elements, where they are known; see link_shapes.read_link.
    """
    found = read_link(bodyUniqueId, linkIndex, physicsClientId, convex, meshes, concave)
    return [_mirror(shape) for shape in found]


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
    form = _core.Primitive(kind, sizes)
    bounds = np.outer([-1.0, 1.0], form.corner)
    return Shape(kind, *_frame(position, rotation), bounds, None, form)


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
    query = MeshQuery(vertices, triangles)
    bounds = np.array([used.min(0), used.max(0)])
    return Shape("mesh", *_frame(position, rotation), bounds, None, query, (vertices, triangles))


def convex_mesh(vertices, position=(0, 0, 0), rotation=None) -> Shape:
    """The convex hull of vertices (v, 3) [m]."""
    vertices = checks.array("vertices", vertices, (None, 3))
    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError) as error:
        raise InvalidValue("vertices", vertices, "the corners of a hull that has a volume") from error
    bounds = np.array([vertices.min(0), vertices.max(0)])
    query = ConvexQuery(hull)
    return Shape("mesh", *_frame(position, rotation), bounds, None, query)


def _frame(position, rotation) -> tuple[np.ndarray, np.ndarray]:
    rotation = np.eye(3) if rotation is None else np.asarray(rotation, float)
    return np.array(position, float), rotation
