"""STL and OBJ files, good and bad."""

import numpy as np
import pytest

from bullet_tendon.errors import InvalidValue
from bullet_tendon.mesh_files import read_mesh

TETRA = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.4, 0], [0, 0, 0.5]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def test_stl_files_binary_and_ascii(tmp_path):
    corners = TETRA[FACES].astype("<f4")
    records = np.zeros(len(FACES), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    records["c"] = corners
    binary = tmp_path / "binary.STL"
    binary.write_bytes(b"solid, but binary".ljust(80) + np.uint32(4).tobytes() + records.tobytes())
    ascii_file = tmp_path / "ascii.stl"
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*c) for c in f)
        + "endloop\nendfacet\n"
        for f in TETRA[FACES]
    )
    ascii_file.write_text(f"solid t\n{facets}endsolid t\n")
    for path in (binary, ascii_file):
        found = read_mesh(path)
        assert found.vertices[found.triangles] == pytest.approx(TETRA[FACES], abs=1e-7)


def test_obj_files(tmp_path):
    path = tmp_path / "m.obj"
    path.write_text(
        "# a square, a triangle counted from the end\nmtllib x.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\nv 0 1 0\n"
        "vt 0 0\nvn 0 0 1\ng one\nf 1/1/1 2/1 \\\n3//1 4\no two\nf -4 -3 -2\n"
    )
    found = read_mesh(path)
    assert found.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    assert found.group.tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    "name,content",
    [
        ("a.dae", ""),
        ("a.stl", "nonsense"),
        ("a.stl", "solid a\nvertex 0 0\nendsolid"),
        ("a.stl", "solid a\nendsolid"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 3\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n"),
        ("a.obj", ""),
        ("missing.obj", None),
    ],
)
def test_bad_mesh_files_are_named(tmp_path, name, content):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(InvalidValue, match=name):
        read_mesh(path)
