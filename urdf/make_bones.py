"""Writes meshes/{femur,tibia}{,_drilled}.obj: run it after changing a field or a tunnel.

    python -m bullet_tendon.urdf.make_bones [--out DIRECTORY]

The bones are modelled, not scanned: blended primitives (femur_field.py, tibia_field.py), polygonised here.
README.md has the published dimensions and their sources. Frame of both: x anterior, y superior, z to the
right (lateral, for this is a right knee), origin half-way between the epicondyles; in full extension the two
frames coincide.

The drilled meshes are for the eye: the same triangles with the <tunnel> elements of femur.urdf and tibia.urdf
bored through them (drill.py).
"""

import argparse
import importlib
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

HERE = Path(__file__).resolve().parent
if not __package__:  # run as a plain script: make the relative imports below work (PEP 366)
    sys.path.insert(0, str(HERE.parent))
    __package__ = HERE.name
    importlib.import_module(__package__)

from .drill import drill  # noqa: E402
from .femur_field import femur  # noqa: E402
from .fields import gradient  # noqa: E402
from .surface_nets import surface_nets  # noqa: E402
from .tibia_field import tibia  # noqa: E402

BONES = {  # field, box [mm], and the range of y that deserves the fine lattice
    "femur": (femur, ((-32.0, -30.0, -50.0), (46.0, 120.0, 48.0)), (-30.0, 36.0)),
    "tibia": (tibia, ((-34.0, -130.0, -48.0), (42.0, -12.0, 50.0)), (-62.0, -12.0)),
}
SPACING = 3.0  # of the lattice [mm]
SHAFT_STRETCH = 2.0  # how much longer the cells are along the shafts, where little changes


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "meshes")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name, (field, *_) in BONES.items():
        vertices, triangles = bone_mesh(name)
        write_obj(out / f"{name}.obj", vertices, triangles)
        normals = gradient(field, vertices)
        for tunnel in tunnels(HERE / f"{name}.urdf"):
            vertices, triangles, normals = drill(vertices, triangles, normals, field, *tunnel)
        write_obj(out / f"{name}_drilled.obj", vertices, triangles, normals)


def bone_mesh(name: str, spacing: float = SPACING):
    """Vertices (V, 3) [mm] and triangles (F, 3) of the undrilled bone."""
    field, box, fine = BONES[name]
    grid = lattice(box, fine, spacing)
    vertices, triangles = surface_nets(grid, field(grid))
    return settle(vertices, triangles, field, spacing), triangles


def tunnels(urdf: Path):
    """(start (3,), end (3,), radius) [mm] of every <tunnel>. The URDF is the one place that states them."""
    found = ElementTree.parse(urdf).getroot().iter("tunnel")
    return [
        (
            *(1e3 * np.array(t.find(end).get("xyz").split(), float) for end in ("start", "end")),
            1e3 * float(t.get("radius")),
        )
        for t in found
    ]


def lattice(box, fine, spacing: float):
    """Sample positions (I, J, K, 3) [mm]; along y wider outside the range `fine`."""
    low, high = box
    x, z = (np.arange(low[i], high[i] + spacing, spacing) for i in (0, 2))
    y = [low[1]]
    while y[-1] < high[1]:
        y.append(y[-1] + spacing * (1.0 if fine[0] <= y[-1] < fine[1] else SHAFT_STRETCH))
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)


def settle(vertices, triangles, field, spacing: float, rounds: int = 6):
    """Even out the triangles and put every vertex on the zero level, to about a micrometre."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = np.bincount(edges[:, 0], minlength=len(vertices))[:, None]
    for _ in range(rounds):
        total = np.zeros_like(vertices)
        np.add.at(total, edges[:, 0], vertices[edges[:, 1]])
        vertices = to_surface(0.5 * (vertices + total / count), field, spacing)
    for _ in range(4):
        vertices = to_surface(vertices, field, spacing)
    return vertices


def to_surface(points, field, limit: float):
    """One Newton step along the gradient, at most `limit` [mm] far."""
    slope = gradient(field, points)
    size = np.maximum(np.linalg.norm(slope, axis=1), 1e-3)
    step = np.clip(field(points) / size, -limit, limit)
    return points - (step / size)[:, None] * slope


def write_obj(path: Path, vertices, triangles, normals=None, digits: int = 5, made_by: str = "make_bones.py"):
    """A Wavefront file in metres, to so many digits (5: a hundredth of a millimetre)."""
    lines = [f"# made by {made_by}: metres; x anterior, y superior, z lateral (right knee)"]
    lines += ["v " + " ".join(f"{c / 1e3 + 0.0:.{digits}f}" for c in v) for v in vertices]
    if normals is not None:
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        lines += ["vn {:.2f} {:.2f} {:.2f}".format(*(n + 0.0)) for n in normals]
    corner = "{0}" if normals is None else "{0}//{0}"
    lines += ["f " + " ".join(corner.format(i + 1) for i in t) for t in triangles]
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
