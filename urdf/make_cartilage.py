"""Writes meshes/{femur,tibia}_cartilage.obj, the knee's joint surfaces: run it after changing a field.

    python -m bullet_tendon.urdf.make_cartilage [--out DIRECTORY]

The cartilage is the bone's articular surface, shifted outwards by its thickness. The shift fades out over the
last millimetres before its border. The surfaces are open: femur one cap over both condyles and the trochlea,
tibia two patches. Frames as in make_bones.py. README.md has the sources of the thickness.
"""

import argparse
import importlib
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
if not __package__:  # run as a plain script: make the relative imports below work (PEP 366)
    sys.path.insert(0, str(HERE.parent))
    __package__ = HERE.name
    importlib.import_module(__package__)

from .femur_field import articular_body, notch  # noqa: E402
from .fields import gradient  # noqa: E402
from .make_bones import BONES, bone_mesh, write_obj  # noqa: E402
from .tibia_field import oval, plateau  # noqa: E402

FADE = 3.0  # width of the border in which the thickness fades out [mm]


def femoral_border(points):
    """How far points (..., 3) of the femur are inside its articular surface, roughly [mm]; < 0 outside."""
    x, y, z = np.moveaxis(points, -1, 0)
    in_front = np.clip((x - 4.0) / 8.0, 0.0, 1.0)
    # The epicondyles and the metaphysis stand out of the articular body, the trochlea is blended with it.
    body = 4.0 * (0.8 + 2.2 * in_front - np.abs(articular_body(points)))
    side = 33.0 - np.abs(z + 0.5)
    top = 12.0 + 12.0 * in_front - y
    return np.minimum(np.minimum(top, side), np.minimum(notch(points) - 0.5, body))


def tibial_border(points):
    """How far points (..., 3) of the tibia are inside its joint surfaces, roughly [mm]; < 0 outside."""
    x, y, z = np.moveaxis(points, -1, 0)
    medial = oval(x, z, (0.5, -22.0), (23.0, 12.5))
    lateral = oval(x, z, (1.0, 21.5), (20.5, 12.0))
    level = 3.0 * (1.2 - np.abs(y - plateau(points)))  # the spines stand out of it
    return np.minimum(-np.minimum(medial, lateral), level)


SURFACES = {  # border, thickness [mm], spacing of the lattice [mm]
    "femur": (femoral_border, 1.8, 1.4),
    "tibia": (tibial_border, 2.0, 1.6),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "meshes")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name in SURFACES:
        path = out / f"{name}_cartilage.obj"
        write_obj(path, *cartilage_mesh(name), digits=6, made_by="make_cartilage.py")


def cartilage_mesh(name: str):
    """Vertices (V, 3) [mm] and triangles (F, 3) of a bone's cartilage, looking out of the bone."""
    border, thickness, spacing = SURFACES[name]
    vertices, triangles = bone_mesh(name, spacing)
    inside = border(vertices)
    share = np.clip(inside / FADE, 0.0, 1.0)
    share = share * (2.0 - share)
    normals = gradient(BONES[name][0], vertices)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = vertices + (thickness * share)[:, None] * normals
    return compact(vertices, triangles[(inside > 0)[triangles].all(axis=1)])


def compact(vertices, triangles):
    """Only the vertices that triangles use, and only triangles of patches of 100 or more."""
    parent = np.arange(len(vertices))
    for _ in range(len(vertices)):
        least = parent[triangles].min(axis=1)
        smaller = parent.copy()
        np.minimum.at(smaller, triangles.ravel(), np.repeat(least, 3))
        smaller = smaller[smaller]
        if (smaller == parent).all():
            break
        parent = smaller
    patch = parent[triangles[:, 0]]
    triangles = triangles[np.bincount(patch, minlength=len(vertices))[patch] >= 100]
    used, index = np.unique(triangles, return_inverse=True)
    return vertices[used], index.reshape(triangles.shape)


if __name__ == "__main__":
    main()
