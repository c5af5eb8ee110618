"""Triangles out of STL (binary and ASCII) and OBJ files, with numpy only, in the file's own units.

Owns: nothing. Goes with no room of the core.

OBJ faces are cut into fans as pybullet's loader does; groups are what it makes one convex hull each of.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from .errors import InvalidValue

_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


class Mesh(NamedTuple):
    """vertices (v, 3); triangles (t, 3) of vertex indices; group (t,): number of each triangle's group."""

    vertices: np.ndarray
    triangles: np.ndarray
    group: np.ndarray


def read_mesh(path) -> Mesh:
    """Read an STL or OBJ file, told apart by its suffix; InvalidValue says what is wrong with it."""
    path = Path(path)
    readers = {".stl": _read_stl, ".obj": _read_obj}
    if path.suffix.lower() not in readers:
        raise InvalidValue("mesh file", str(path), "an .stl or .obj file")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidValue("mesh file", str(path), f"readable ({error.strerror})") from error
    return _checked(path, readers[path.suffix.lower()](path, content))


def _checked(path: Path, mesh: Mesh) -> Mesh:
    if not len(mesh.triangles):
        raise InvalidValue("mesh file", str(path), "a file with at least one triangle")
    if not np.isfinite(mesh.vertices).all():
        raise InvalidValue("mesh file", str(path), "a file of finite coordinates")
    low, high = mesh.triangles.min(), mesh.triangles.max()
    if low < 0 or high >= len(mesh.vertices):
        raise InvalidValue(
            "mesh file", str(path), f"a file whose faces name its {len(mesh.vertices)} vertices"
        )
    return mesh


def _read_stl(path: Path, content: bytes) -> Mesh:
    count = int.from_bytes(content[80:84], "little")
    # A binary file may begin with "solid" too, so its length decides, not that word.
    if len(content) >= 84 and len(content) == 84 + 50 * count:
        corners = np.frombuffer(content, _STL_RECORD, count, offset=84)["corners"]
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _ascii_corners(path, content)
    else:
        raise InvalidValue("mesh file", str(path), f"an STL file (if binary, {84 + 50 * count} bytes long)")
    vertices = corners.reshape(-1, 3).astype(float)
    triangles = np.arange(len(vertices)).reshape(-1, 3)
    return Mesh(vertices, triangles, np.zeros(len(triangles), int))


def _ascii_corners(path: Path, content: bytes) -> np.ndarray:
    lines = (line.split() for line in content.lower().splitlines())
    try:
        corners = np.array([words[1:4] for words in lines if words[:1] == [b"vertex"]], dtype=float)
        return corners.reshape(-1, 3, 3)
    except ValueError:
        raise InvalidValue("mesh file", str(path), "an STL file with three numbers a vertex") from None


def _read_obj(path: Path, content: bytes) -> Mesh:
    vertices, triangles, group = [], [], []
    name = b""
    for number, line in enumerate(content.replace(b"\\\n", b" ").splitlines(), start=1):
        words = line.split(b"#", 1)[0].split()
        try:
            if words[:1] == [b"v"]:
                vertices.append([float(word) for word in words[1:4]])
            elif words[:1] == [b"f"]:
                corners = [_index(word, len(vertices)) for word in words[1:]]
                fan = [(corners[0], j, k) for j, k in zip(corners[1:-1], corners[2:], strict=True)]
                triangles += fan
                group += [name] * len(fan)
            elif words[:1] in ([b"o"], [b"g"]):
                name = (number, line)  # the same name twice is two groups
        except (ValueError, IndexError):
            raise InvalidValue(f"{path}, line {number}", line, "an OBJ vertex or face") from None
    if any(len(vertex) != 3 for vertex in vertices):
        raise InvalidValue("mesh file", str(path), "an OBJ file with three numbers a vertex")
    numbers = {key: index for index, key in enumerate(dict.fromkeys(group))}
    corners = np.array(triangles, int).reshape(-1, 3)
    return Mesh(np.array(vertices, float).reshape(-1, 3), corners, np.array([numbers[g] for g in group], int))


def _index(word: bytes, count: int) -> int:
    """The vertex of "7", "7/1", "7//3" or "-1" (counted back from the last), from 0."""
    number = int(word.split(b"/", 1)[0])
    if number == 0:
        raise ValueError
    return number - 1 if number > 0 else count + number


def clean_triangles(vertices, triangles, smallest_normal: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge equal vertices; drop duplicates and triangles without area, whose edges their neighbours have.

    smallest_normal: the square of the edges' cross product from which on a triangle has an area.
    """
    vertices, index = np.unique(vertices, axis=0, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    count = len(triangles)
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normal = np.cross(b - a, c - a)
    triangles = triangles[np.einsum("ij,ij->i", normal, normal) > smallest_normal]
    if not len(triangles):
        raise InvalidValue("triangles", f"{count} without an area", "with at least one that has an area")
    first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)[1]
    return vertices, triangles[np.sort(first)]
