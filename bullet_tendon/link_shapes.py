"""What pybullet has of the collision shapes of a link, put into the link's frame.

Owns: nothing; it reads a link once, when it becomes an obstacle. Goes with the core's room `collision`. It
does not use FCL.

pybullet 3.2.7 reports less than it has; found by reading its source and by running it:

- Local frames are relative to the link's inertial frame.
- `createCollisionShape` meshes are all reported as "unknown_file", scale 1; a URDF's keep their file name and
  scale. getAABB tells where a shape is and how large, whatever its scale: what callers give is held to that.
- Meshes become convex hulls unless created with indices, GEOM_FORCE_CONCAVE_TRIMESH or, in a URDF,
  `<collision concave=...>`. Bullet has no algorithm for two triangle meshes, so a link that is nothing but
  triangles is near nothing of itself: that is how hulls and triangles are told apart.
- getMeshData gives a hull's vertices. It prints a line "?" for every other shape that it is asked for, so it
  is asked only where something of the link is convex: links that mix triangle meshes with other shapes still
  print, unless their URDF's elements are known.
- An OBJ file becomes one hull per group; from a URDF they are reported as one row.
- A URDF `<cylinder>` is a hull of 64 vertices, unless loaded with URDF_USE_IMPLICIT_CYLINDER. It is taken
  as the true cylinder here.
- Planes pass through their frame's origin; height fields are not reported at all.
- `loadMJCF` makes a capsule that leads from one point to another (`fromto`) of two spheres, for which
  getCollisionShapeData ends the process. What is drawn, and the margin, tell of such links.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pybullet
from scipy.spatial import ConvexHull, cKDTree

from . import checks
from .errors import InvalidValue, UnknownId
from .mesh_files import read_mesh

_MULTI_BODY = 2  # body type in getDynamicsInfo
_NO_FILE = b"unknown_file"
_NEAR = 1.0  # m; a convex shape is at a distance below 0 from itself
_MARGINS = 2e-3, 5.5e-3  # m; more than pybullet adds around triangles (1 mm, turned) and hulls (up to 3 mm)
_ANOTHER_SIZE = 0.05  # of the link, by which a mesh that the caller gives may differ from pybullet's
_PRISM_SIDES = 32  # of the hull that stands for a URDF cylinder
_SPHERES_MARGIN = 0.04  # m; of a shape of several spheres. Compounds of loadMJCF have none
_NEW_BASE = b"link0"  # name that createMultiBody gives to a base


@dataclass
class LinkShape:
    """One shape of a link. position (3,) [m] and rotation (3, 3) of its frame in the link's frame.

    kind "box": sizes = edge lengths; "sphere": (radius,); "capsule" and "cylinder": (radius, length) along z;
    "plane": the normal; "mesh": none, but vertices (v, 3) in the shape's frame and triangles (t, 3), which
    are None for the convex hull of the vertices.
    """

    kind: str
    position: np.ndarray
    rotation: np.ndarray
    sizes: tuple = ()
    vertices: np.ndarray | None = None
    triangles: np.ndarray | None = None


class _Link(NamedTuple):
    """A link and getCollisionShapeData's rows of it; concave: of its meshes from files, where it is known."""

    body: int
    index: int
    client: int
    rows: tuple
    concave: tuple | None

    def has_convex_shapes(self) -> bool:
        """Whether any of the link's shapes is convex: only such a shape is ever near itself."""
        near = pybullet.getClosestPoints(
            self.body, self.body, _NEAR, self.index, self.index, physicsClientId=self.client
        )
        return len(near) > 0

    def hull_vertices(self, **numbered) -> np.ndarray:
        """Vertices (v, 3) of the link's hulls in its inertial frame: all, or one child's of its compound."""
        if not self.has_convex_shapes():
            return np.empty((0, 3))
        points = pybullet.getMeshData(self.body, self.index, physicsClientId=self.client, **numbered)[1]
        return np.array(points, float).reshape(-1, 3)


def read_link(
    bodyUniqueId: int, linkIndex: int, physicsClientId: int, convex=None, meshes=(), concave=None
) -> list[LinkShape]:
    """All collision shapes of a link (-1: the base); for the arguments see shapes.collision_shapes.

    concave: whether each <collision> element of the link's URDF asks for triangles, so that pybullet need not
    be asked; None, or of another number than pybullet has shapes: not known.
    """
    info = _dynamics(bodyUniqueId, linkIndex, physicsClientId)
    if _may_be_of_spheres(bodyUniqueId, linkIndex, physicsClientId, margin=info[11]):
        allowed = "a link without a capsule by `fromto` of an MJCF file, which pybullet does not tell"
        raise InvalidValue("linkIndex", linkIndex, allowed)
    rows = pybullet.getCollisionShapeData(bodyUniqueId, linkIndex, physicsClientId=physicsClientId)
    is_known = concave is not None and len(concave) == len(rows)
    link = _Link(bodyUniqueId, linkIndex, physicsClientId, rows, tuple(concave) if is_known else None)
    if not rows:
        _refuse_unreported(link)
    inertial_position, inertial_rotation = np.array(info[3]), _rotation(info[4])
    given, shapes, boxes = list(meshes), [], []
    for number, row in enumerate(rows):
        found = _row_shapes(link, number, convex, given)
        for shape in found:
            boxes.append(_box_around(shape, np.array(row[5]), _rotation(row[6])))
            shape.position = inertial_position + inertial_rotation @ row[5]
            shape.rotation = inertial_rotation @ _rotation(row[6])
        shapes += found
    if given:
        needed = len(meshes) - len(given)
        raise InvalidValue("meshes", meshes, f"{needed}, for those that pybullet does not tell")
    if len(meshes):
        _require_fit(link, np.array(boxes))
    return shapes


def _box_around(shape: LinkShape, position, rotation) -> np.ndarray:
    """(2, 3) lowest and highest corner of a box around a shape whose frame is placed like that in another."""
    if shape.kind == "mesh":
        hull = shape.triangles is None
        used = shape.vertices if hull else shape.vertices[np.unique(shape.triangles)]
        low, high = used.min(0), used.max(0)
    elif shape.kind == "plane":
        return np.array([[-np.inf] * 3, [np.inf] * 3])
    else:
        radius, length = (*shape.sizes, 0.0)[:2]
        along = 0.5 * length + (radius if shape.kind != "cylinder" else 0.0)
        high = 0.5 * np.array(shape.sizes) if shape.kind == "box" else np.array([radius, radius, along])
        low = -high
    return turned_box(low, high, position, rotation)


def turned_box(low, high, position, rotation) -> np.ndarray:
    """(2, 3) the box around a box in another frame, as Bullet computes it."""
    middle = position + rotation @ (0.5 * (low + high))
    half = np.abs(rotation) @ (0.5 * (high - low))
    return np.array([middle - half, middle + half])


def _require_fit(link: _Link, boxes):
    """Raise InvalidValue where the shapes, in boxes (k, 2, 3) in the inertial frame, are not pybullet's.

    pybullet does not tell the meshScale of createCollisionShape, but where the shape is, and how large.
    """
    low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
    if not np.isfinite([low, high]).all():
        return
    have = turned_box(low, high, *_inertial_frame(link))
    want = np.array(pybullet.getAABB(link.body, link.index, physicsClientId=link.client))
    sizes = np.ptp(have, axis=0), np.ptp(want, axis=0)
    margin = _MARGINS[link.has_convex_shapes()]
    allowed = _ANOTHER_SIZE * min(sizes[0].max(), sizes[1].max())
    beyond = np.array([[-1.0], [1.0]]) * (want - have)  # of pybullet's box over the meshes'
    if (beyond < -allowed).any() or (beyond > allowed + margin).any():
        given, meant = (" x ".join(f"{x:.4g}" for x in size) for size in sizes)
        needed = "as large as pybullet's shape, and in the same place"
        how = f"its box in the world is {meant} m (give its meshScale too, as (path, meshScale))"
        raise InvalidValue("meshes", f"a box of {given} m in the world", f"{needed}: {how}")


def _inertial_frame(link: _Link) -> tuple[np.ndarray, np.ndarray]:
    """Where a link's inertial frame is in the world: origin (3,) and axes (3, 3)."""
    if link.index < 0:
        place = pybullet.getBasePositionAndOrientation(link.body, link.client)
    else:
        place = pybullet.getLinkState(link.body, link.index, 0, 1, link.client)[:2]
    return np.array(place[0]), _rotation(place[1])


def _dynamics(body: int, link: int, client: int) -> tuple:
    """getDynamicsInfo of a link that exists, of a body that reports its shapes."""
    try:
        pybullet.getBodyInfo(body, physicsClientId=client)
    except pybullet.error as error:
        raise UnknownId("bodyUniqueId", body, "the id of a body in this physics server") from error
    if not -1 <= link < pybullet.getNumJoints(body, physicsClientId=client):
        raise UnknownId("linkIndex", link, "-1 (the base) or the index of a link of this body")
    info = pybullet.getDynamicsInfo(body, link, physicsClientId=client)
    if info[10] != _MULTI_BODY:
        allowed = "a body that reports shapes: not soft, not with useMaximalCoordinates"
        raise InvalidValue("bodyUniqueId", body, allowed)
    return info


def _may_be_of_spheres(body: int, link: int, client: int, margin: float) -> bool:
    """Whether a link may have a capsule of two spheres, by its margin [m] and its visual capsules."""
    is_of_spheres = abs(margin - _SPHERES_MARGIN) < 1e-6
    if margin != 0.0 and not is_of_spheres:
        return False
    if margin == 0.0 and pybullet.getBodyInfo(body, physicsClientId=client)[0] == _NEW_BASE:
        return False  # a compound of createCollisionShapeArray
    visual = pybullet.getVisualShapeData(body, physicsClientId=client)
    capsules = [row for row in visual if row[1] == link and row[2] == pybullet.GEOM_CAPSULE]
    # Where it leads is in its spheres, not in its frame. The margin of a capsule of one shape is its radius.
    radii = [row[3][1] for row in capsules if not np.any(row[5])]
    return any(not is_of_spheres or abs(radius - margin) > 1e-6 for radius in radii)


def _refuse_unreported(link: _Link):
    """No rows: without a shape, a link's box is a point grown by a margin (1 mm); else there is something."""
    low, high = pybullet.getAABB(link.body, link.index, physicsClientId=link.client)
    if max(np.subtract(high, low)) > 0.01:
        allowed = (
            "a link of boxes, spheres, cylinders, capsules, planes or meshes, which pybullet reports: "
            "no height field (use a concave mesh), no SDF shape"
        )
        raise InvalidValue("linkIndex", link.index, allowed)


def _row_shapes(link: _Link, number: int, convex, given: list) -> list[LinkShape]:
    row, nowhere = link.rows[number], (np.zeros(3), np.eye(3))
    sizes = row[3]
    kinds = {
        pybullet.GEOM_BOX: ("box", sizes),
        pybullet.GEOM_SPHERE: ("sphere", sizes[:1]),
        pybullet.GEOM_CYLINDER: ("cylinder", (sizes[1], sizes[0])),
        pybullet.GEOM_CAPSULE: ("capsule", (sizes[1], sizes[0])),
        pybullet.GEOM_PLANE: ("plane", sizes),
    }
    if row[2] in kinds:
        kind, sizes = kinds[row[2]]
        return [LinkShape(kind, *nowhere, sizes)]
    if row[2] != pybullet.GEOM_MESH:
        raise InvalidValue("collision shape type", row[2], "box, sphere, cylinder, capsule, plane or mesh")
    alone = len(link.rows) == 1
    numbered = {} if alone else {"collisionShapeIndex": number}
    if row[4] == _NO_FILE:
        hull = link.hull_vertices(**numbered)
        if len(hull):
            hull = (hull - row[5]) @ _rotation(row[6])
            round_one = _cylinder_of(hull)
            if round_one or convex is not False:
                return [round_one or LinkShape("mesh", *nowhere, vertices=hull)]
    vertices, triangles, group = _mesh_of(link, number, given)
    if convex is None and alone:
        convex = link.has_convex_shapes()
    elif convex is None and link.concave is not None and row[4] != _NO_FILE:
        convex = not link.concave[number]
    elif convex is None:
        convex = len(link.hull_vertices(**numbered)) > 0 or _is_hull(
            link, row, vertices[triangles[group == 0]]
        )
    if not convex:
        return [LinkShape("mesh", *nowhere, vertices=vertices, triangles=triangles)]
    pieces = [vertices[np.unique(triangles[group == g])] for g in range(group.max() + 1)]
    return [LinkShape("mesh", *nowhere, vertices=piece) for piece in pieces]


def _is_hull(link: _Link, row, corners) -> bool:
    """Whether the hull of a file's corners (..., 3), in the shape's frame, is among the link's hulls.

    Asking for one child by number fails where that child is a compound itself, as an OBJ file of hulls is.
    Bullet rounds a hull's vertices to 1e-4 of its size and leaves some out.
    """
    points = link.hull_vertices()
    if not len(points):
        return False
    placed = corners.reshape(-1, 3) @ _rotation(row[6]).T + row[5]
    extreme = placed[ConvexHull(placed).vertices]
    away = cKDTree(points).query(extreme)[0]
    return bool(np.quantile(away, 0.9) < 3e-3 * np.ptp(extreme, axis=0).max())


def _mesh_of(link: _Link, number: int, given: list):
    """Vertices in the shape's frame, triangles and groups: from what the caller gave, or from the file."""
    row = link.rows[number]
    name = row[4].decode()
    if given and (row[4] == _NO_FILE or not Path(name).is_file()):
        return _from_caller(given.pop(0), np.array(row[3]))
    if row[4] == _NO_FILE:
        allowed = "given: pybullet does not tell the triangles of a mesh made by createCollisionShape"
        missing = f"none for body {link.body}, link {link.index}, shape {number}"
        raise InvalidValue("meshes", missing, allowed)
    file = read_mesh(name)
    return file.vertices * np.array(row[3]), file.triangles, file.group


def _from_caller(source, scale):
    if isinstance(source, (str, Path)):
        file = read_mesh(source)
        return file.vertices * scale, file.triangles, file.group
    try:
        vertices, triangles = source
    except (TypeError, ValueError):
        allowed = "file names, pairs of a file name and its meshScale, or pairs of vertices and triangles"
        raise InvalidValue("meshes", source, allowed) from None
    if isinstance(vertices, (str, Path)):
        file, size = read_mesh(vertices), checks.as_array(triangles)
        if size.ndim == 0:
            size = np.full(3, checks.number("meshScale", triangles))
        return file.vertices * checks.vector("meshScale", size), file.triangles, file.group
    vertices = checks.array("vertices", vertices, (None, 3))
    triangles = checks.array("triangles", triangles, (None, 3)).astype(int)
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InvalidValue("triangles", triangles, f"indices of the {len(vertices)} vertices, from 0")
    return vertices, triangles, np.zeros(len(triangles), int)


def _cylinder_of(hull: np.ndarray) -> LinkShape | None:
    """The cylinder along z that a regular prism of 32 sides stands for, or None."""
    if len(hull) != 2 * _PRISM_SIDES:
        return None
    radius, half = np.hypot(hull[:, 0], hull[:, 1]), np.abs(hull[:, 2])
    turns = np.arctan2(hull[:, 0], hull[:, 1]) * (_PRISM_SIDES / (2.0 * np.pi))
    rough = max(np.ptp(radius) / radius.max(), np.ptp(half) / half.max(), np.abs(turns - turns.round()).max())
    if rough > 1e-2:  # the hull's vertices are rounded to 1e-4 of its size, but not the outermost ones
        return None
    sizes = float(np.abs(hull[:, :2]).max()), float(2.0 * half.max())
    return LinkShape("cylinder", np.zeros(3), np.eye(3), sizes)


def _rotation(quaternion) -> np.ndarray:
    """(3, 3) of a quaternion (x, y, z, w)."""
    return np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
