"""What a link looks like, as triangles: pybullet's visual shapes, in the link's URDF frame.

Owns: nothing; goes with no room of the core. pybullet tells the file and scale of a mesh, but not the
triangles of one that was given as vertices: for an obstacle they are those that tendons collide with, else it
is left out.
"""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pybullet as p
from scipy.spatial import ConvexHull

from .errors import TendonError
from .mesh_files import read_mesh
from .recording import VisualMesh
from .shapes import Shape

_SIDES = 24  # of round shapes
_ROUND = p.GEOM_CYLINDER, p.GEOM_CAPSULE, p.GEOM_SPHERE
_PLANE = 1.0  # half the edge of the square that stands for an endless plane [m]


def visual_meshes(rows, body: int, shapes_of: Callable[[int, int], list[Shape]]) -> dict[int, tuple]:
    """VisualMesh tuples by link; rows: of p.getVisualShapeData. shapes_of(body, link): of an obstacle."""
    found: dict[int, list] = {}
    for row in rows:
        link = row[1]
        parts = _shape_meshes(row) or _collision_meshes(shapes_of(body, link))
        color = np.array(row[7], np.float32)
        for vertices, triangles in parts:
            mesh = VisualMesh(vertices.astype(np.float32), triangles.astype(np.uint32), color)
            found.setdefault(link, []).append(mesh)
    return {link: tuple(meshes) for link, meshes in found.items()}


def _shape_meshes(row) -> list:
    """(vertices, triangles) of a row of p.getVisualShapeData, link's frame; none where it is not told."""
    _, _, kind, sizes, file, position, orientation = row[:7]
    if kind == p.GEOM_MESH:
        mesh = _file_mesh(file, sizes)
    elif kind in _ROUND:
        mesh = round_mesh(kind, sizes)
    elif kind == p.GEOM_BOX:
        mesh = _box(np.array(sizes))
    elif kind == p.GEOM_PLANE:
        mesh = _box(np.array([2 * _PLANE, 2 * _PLANE, 0.0]))
    else:
        mesh = None
    if mesh is None:
        return []
    axes = np.reshape(p.getMatrixFromQuaternion(orientation), (3, 3))
    return [(mesh[0] @ axes.T + position, mesh[1])]


def is_round(row) -> bool:
    """Whether a row of p.getVisualShapeData is of a sphere, a cylinder or a capsule."""
    return row[2] in _ROUND


def round_surface(kind: int, sizes, position, orientation, sides: int) -> SimpleNamespace:
    """A round shape as a smooth mesh (vertices, normals, triangles), in the frame of its link.

    kind, sizes, position, orientation: of its row of p.getVisualShapeData. sides: of its cross-sections.
    """
    vertices, triangles = round_mesh(kind, sizes, sides)
    if kind == p.GEOM_CYLINDER:
        is_wall = np.isin(np.arange(len(vertices)), triangles[2 * sides : 4 * sides])
        normals = np.where(is_wall[:, None], (1.0, 1.0, 0.0), (0.0, 0.0, 1.0)) * vertices
    else:
        half = 0.5 * sizes[0] if kind == p.GEOM_CAPSULE else 0.0
        normals = vertices - np.clip(vertices, (0, 0, -half), (0, 0, half))  # from the axis or the centre
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    axes = np.reshape(p.getMatrixFromQuaternion(orientation), (3, 3))
    return SimpleNamespace(
        vertices=vertices @ axes.T + position, normals=normals @ axes.T, triangles=triangles
    )


def _file_mesh(file: bytes, scale):
    try:
        mesh = read_mesh(file.decode())
    except (TendonError, OSError, ValueError):  # of a format that is not read here, or gone
        return None
    return np.asarray(mesh.vertices) * scale, np.asarray(mesh.triangles)


def _collision_meshes(shapes: list[Shape]) -> list:
    """Of the triangle meshes and hulls among an obstacle's shapes."""
    found = []
    for shape in shapes:
        if shape.triangles is not None and len(shape.triangles):
            corners = np.asarray(shape.triangles).reshape(-1, 3)
            vertices, index = np.unique(corners, axis=0, return_inverse=True)
            found.append((vertices @ shape.rotation.T + shape.position, index.reshape(-1, 3)))
    return found


def _box(sizes):
    """A box with these edge lengths around the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    if sizes[2] == 0:
        return 0.5 * sizes * corners[[0, 2, 4, 6]], np.array([[0, 2, 3], [0, 3, 1]])
    hull = ConvexHull(corners)
    return 0.5 * sizes * corners, _outwards(corners, hull.simplices)


def _outwards(vertices, triangles) -> np.ndarray:
    """Triangles of a convex body around the origin, each turned to face outwards."""
    a, b, c = (vertices[corner] for corner in triangles.T)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    return np.where(inward[:, None], triangles[:, ::-1], triangles)


def round_mesh(kind: int, sizes, sides: int = _SIDES):
    """(vertices, triangles) of a sphere (radius,), or a cylinder or capsule (length, radius) along z.

    The ends of a cylinder share no vertices with its wall, so that its edges are sharp. First are the
    triangles of one end, then those of the wall and of the other end, 2 sides each.
    """
    angle = np.linspace(0.0, np.pi / 2, sides // 4 + 1)
    arc = np.c_[np.cos(angle), np.sin(angle)]
    if kind == p.GEOM_SPHERE:
        profile = sizes[0] * np.vstack([arc[:0:-1] * (1, -1), arc])
    elif kind == p.GEOM_CAPSULE:
        profile = sizes[1] * np.vstack([arc[::-1] * (1, -1), arc])
        profile[:, 1] += np.repeat([-0.5, 0.5], len(arc)) * sizes[0]
    else:
        half, radius = 0.5 * sizes[0], sizes[1]
        rim = [(radius, -half), (radius, half)]
        profile = np.array([(0, -half), *np.repeat(rim, 2, axis=0), (0, half)])
    turn = np.arange(sides) * (2 * np.pi / sides)
    circle = np.c_[np.cos(turn), np.sin(turn)]
    around = (profile[:, :1, None] * circle).reshape(-1, 2)
    vertices = np.hstack([around, np.repeat(profile[:, 1], sides)[:, None]])
    one = np.arange(sides)
    other = (one + 1) % sides
    bands = np.flatnonzero(np.diff(profile, axis=0).any(axis=1))  # without those between edges' twin vertices
    row = sides * bands[:, None]
    a, b, c, d = row + one, row + other, row + sides + one, row + sides + other
    triangles = np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)
    return vertices, triangles
