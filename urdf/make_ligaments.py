"""Writes knee_ligaments.csv, the ligaments of the knee: run it after changing a bone's field or a bundle.

    python -m bullet_tendon.urdf.make_ligaments [--out DIRECTORY]

A bundle has an insertion on each bone, which is laid onto the bone's surface, and strands that are spread
evenly between two ends of each insertion. Its reference strain is that at full extension, where both frames
coincide; it gives the strands their slack lengths. README.md has the sources. Table: one row for each point
of a strand's path, [m], in the frame of its bone, as in make_bones.py; the law is that of Material.ligament.
"""

import argparse
import csv
import importlib
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).resolve().parent
if not __package__:  # run as a plain script: make the relative imports below work (PEP 366)
    sys.path.insert(0, str(HERE.parent))
    __package__ = HERE.name
    importlib.import_module(__package__)

from .make_bones import BONES, to_surface  # noqa: E402

COLUMNS = ["strand", "linear_stiffness_N_per_strain", "slack_length_m", "point", "body", "x_m", "y_m", "z_m"]


class Bundle(NamedTuple):
    """stiffness [N per unit strain] of all strands together; strain: at full extension [-].

    femoral, tibial: ((x, y, z), (x, y, z)) [mm], the insertions of the first and the last strand, near the
    surface. over: a point of the path on the tibia between them, for each of these two strands, `clear`
    outside the surface.
    """

    strands: int
    stiffness: float
    strain: float
    femoral: tuple
    tibial: tuple
    over: tuple = ()
    clear: float = 1.0


BUNDLES = {
    "ACLam": Bundle(
        4, 5000.0, 0.02, ((-6.5, 5.0, 9.0), (-3.5, 1.5, 9.5)),
        ((10.5, -23, -4.0), (6.5, -23, -3.0)),
    ),
    "ACLpl": Bundle(
        4, 5000.0, 0.01, ((-5.0, -0.5, 9.5), (-2.0, -3.5, 10.0)),
        ((4.5, -23, -0.5), (0.5, -23, 0.5)),
    ),
    "PCLal": Bundle(
        4, 9000.0, -0.08, ((8.0, -2.0, -7.5), (3.0, -3.0, -8.5)),
        ((-18.5, -31, 1.0), (-19.5, -34, -1.0)),
    ),
    "PCLpm": Bundle(
        4, 3000.0, -0.06, ((2.0, -8.0, -9.5), (-2.5, -7.0, -10)),
        ((-20.0, -36, -0.5), (-21, -38, -3.0)),
    ),
    "MCLs": Bundle(
        6, 5500.0, 0.045, ((1.0, 3.0, -42.0), (-8.0, 3.0, -41.0)),
        ((11.0, -80, -13), (2.0, -88, -14)), ((6.0, -31.0, -38.0), (-6.0, -31.0, -38.0)),
    ),
    "MCLd": Bundle(
        4, 2500.0, 0.02, ((1.0, -1.0, -40.0), (-8.0, 0.0, -40.0)),
        ((4.0, -32, -38), (-8.0, -32, -37)),
    ),
    "POL": Bundle(
        4, 2500.0, 0.04, ((-6.0, 13.0, -38.0), (-9.0, 9.5, -39)),
        ((-17.0, -30, -30), (-22.0, -31, -22)),
    ),
    "LCL": Bundle(
        4, 2400.0, 0.04, ((-4.0, 8.5, 41.0), (-8.0, 6.5, 40.5)),
        ((-14.0, -44, 38), (-19.0, -46, 37)),
    ),
    "PFL": Bundle(
        4, 2200.0, -0.02, ((0.5, 3.0, 40.0), (-2.5, 0.5, 39.5)),
        ((-17.0, -41, 33), (-19.0, -42, 31)),
    ),
    "ALL": Bundle(
        3, 1500.0, 0.02, ((-6.0, 9.0, 41.0), (-10.0, 8.0, 40.0)),
        ((5.0, -36, 37), (-2.0, -36, 38)),
    ),
    "pCAPm": Bundle(
        4, 2000.0, 0.04, ((-19.0, 13, -28), (-19.0, 13, -12)),
        ((-22.0, -34, -27), (-23.0, -34, -12)),
    ),
    "pCAPl": Bundle(
        4, 2000.0, 0.04, ((-18.5, 13, 12.0), (-18.5, 13, 28.0)),
        ((-21.0, -34, 11), (-21.0, -34, 25)),
    ),
}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    with open(out / "knee_ligaments.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name, bundle in BUNDLES.items():
            writer.writerows(rows(name, bundle))


def rows(name: str, bundle: Bundle) -> list[list[str]]:
    """The table's rows of a bundle."""
    found = []
    for index, (bodies, points) in enumerate(paths(bundle), start=1):
        slack = np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / (1 + bundle.strain)
        law = f"{bundle.stiffness / bundle.strands:.6g}", f"{slack:.6f}"
        for number, (body, point) in enumerate(zip(bodies, points, strict=True)):
            found.append([f"{name}{index}", *law, str(number), body, *(f"{c:.6f}" for c in point)])
    return found


def paths(bundle: Bundle):
    """(names of the bones, points (k, 3) [m]) of each strand."""
    shares = np.linspace(0.0, 1.0, bundle.strands)[:, None]
    femoral, tibial = (a + shares * (b - a) for a, b in map(np.array, (bundle.femoral, bundle.tibial)))
    lines = [on_surface("femur", femoral), on_surface("tibia", tibial)]
    bodies = ["femur", "tibia"]
    if bundle.over:
        first, last = np.array(bundle.over)
        lines.insert(1, on_surface("tibia", first + shares * (last - first), bundle.clear))
        bodies.insert(1, "tibia")
    return [(bodies, 1e-3 * np.array(points)) for points in zip(*lines, strict=True)]


def on_surface(bone: str, points, clear: float = 0.0):
    """Points (n, 3) moved to where the bone's field is `clear` [mm]."""
    field = BONES[bone][0]
    for _ in range(20):
        points = to_surface(points, lambda x: field(x) - clear, 0.5)
    return points


if __name__ == "__main__":
    main()
