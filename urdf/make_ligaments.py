"""Writes knee_ligaments.csv, the ligaments of the knee: run it after changing a bone's field or a bundle.

    python -m bullet_tendon.urdf.make_ligaments [--out DIRECTORY]

A bundle has an insertion on each bone, which is laid onto the bone's surface, and strands that are spread
evenly between two ends of each insertion. Its reference strain is that at full extension, where both frames
coincide; it gives the strands their slack lengths. Where a bone is in the straight way of a strand, it
passes around a cylinder that is fitted to the bone there. README.md has the sources. Table: one row for each
point of a strand's path, and one for its cylinder, between them, [m], in the frame of its bone, as in
make_bones.py; the law is that of Material.ligament.
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

from .fields import gradient  # noqa: E402
from .make_bones import BONES, to_surface  # noqa: E402

COLUMNS = ["strand", "linear_stiffness_N_per_strain", "slack_length_m", "point", "body", "x_m", "y_m", "z_m"]
COLUMNS += ["cylinder_radius_m", "axis_x", "axis_y", "axis_z"]
PLACES, HEIGHTS = 401, 301  # of a section, along a strand and away from it
HIGHEST = 15.0  # of a bone above the straight way [mm]
OUTSIDE = 0.2  # of its cylinder, by which the ends of a strand stay [mm]


class Bundle(NamedTuple):
    """stiffness [N per unit strain] of all strands together; strain: at full extension [-].

    femoral, tibial: ((x, y, z), (x, y, z)) [mm], the insertions of the first and the last strand, near the
    surface. around: the bone around which its strands pass, and about which axis (3,); clear: of their
    cylinders from the bone [mm].
    """

    strands: int
    stiffness: float
    strain: float
    femoral: tuple
    tibial: tuple
    around: tuple = ()
    clear: float = 0.0


class Cylinder(NamedTuple):
    """A cylinder in the frame of a bone: centre (3,), radius [mm], and the unit vector of its axis (3,)."""

    bone: str
    centre: np.ndarray
    radius: float
    axis: np.ndarray


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
        ((11.0, -80, -13), (2.0, -88, -14)), ("tibia", (1, 0, 0)), 1.0,
    ),
    "MCLd": Bundle(
        4, 2500.0, 0.02, ((1.0, -1.0, -40.0), (-8.0, 0.0, -40.0)),
        ((4.0, -32, -38), (-8.0, -32, -37)),
    ),
    "POL": Bundle(
        4, 2500.0, 0.04, ((-6.0, 13.0, -38.0), (-9.0, 9.5, -39)),
        ((-17.0, -30, -30), (-22.0, -31, -22)), ("femur", (8, -4, -4)),
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
        ((-22.0, -34, -27), (-23.0, -34, -12)), ("femur", (0, 0, 1)),
    ),
    "pCAPl": Bundle(
        4, 2000.0, 0.04, ((-18.5, 13, 12.0), (-18.5, 13, 28.0)),
        ((-21.0, -34, 11), (-21.0, -34, 25)), ("femur", (0, 0, 1)),
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
    for index, (start, end, cylinder) in enumerate(paths(bundle), start=1):
        slack = 1e-3 * length(start, end, cylinder) / (1 + bundle.strain)
        law = f"{bundle.stiffness / bundle.strands:.6g}", f"{slack:.6f}"
        path = [("femur", start, [""] * 4), ("tibia", end, [""] * 4)]
        if cylinder is not None:
            size = [f"{1e-3 * cylinder.radius:.6f}", *(f"{c:.6f}" for c in cylinder.axis)]
            path.insert(1, (cylinder.bone, cylinder.centre, size))
        for number, (body, point, size) in enumerate(path):
            place = (f"{1e-3 * c + 0.0:.6f}" for c in point)
            found.append([f"{name}{index}", *law, str(number), body, *place, *size])
    return found


def paths(bundle: Bundle):
    """(insertion on the femur (3,), on the tibia (3,) [mm], Cylinder or None) of each strand."""
    shares = np.linspace(0.0, 1.0, bundle.strands)[:, None]
    femoral, tibial = (a + shares * (b - a) for a, b in map(np.array, (bundle.femoral, bundle.tibial)))
    ends = zip(on_surface("femur", femoral), on_surface("tibia", tibial), strict=True)
    around, clear = bundle.around, bundle.clear
    return [(a, b, fitted(*around, clear, a, b) if around else None) for a, b in ends]


def fitted(bone: str, axis, clear: float, start, end) -> Cylinder:
    """The cylinder around which a strand from start to end (3,) passes a bone, about an axis (3,).

    Its axis is turned to lie across the straight strand. A line that is taut over the bone's section across
    the axis touches it in an arc, to which the circle is fitted by least squares (Kasa 1976). Both ends of
    the strand are outside.
    """
    field, span = BONES[bone][0], np.linalg.norm(end - start)
    along, places = (end - start) / span, np.linspace(0.0, span, PLACES)
    line = start + places[:, None] * along
    deepest = line[field(line).argmin()][None]
    outward = np.cross(along, axis) / np.linalg.norm(np.cross(along, axis))
    outward *= np.sign(outward @ gradient(field, deepest)[0])
    heights = outermost(field, line, outward)
    touched = taut_over(places, heights)
    u, v = places[touched[0] : touched[-1] + 1], heights[touched[0] : touched[-1] + 1]
    a, b, c = np.linalg.lstsq(np.stack([2 * u, 2 * v, np.ones(len(u))], 1), u**2 + v**2, rcond=None)[0]
    nearest = min(np.hypot(a, b), np.hypot(span - a, b))
    radius = min(np.sqrt(c + a**2 + b**2) + clear, nearest - OUTSIDE)
    return Cylinder(bone, start + a * along + b * outward, radius, np.cross(along, outward))


def outermost(field, points, outward):
    """(n,) heights above points (n, 3), along `outward` (3,), where the bone is left for the last time [mm].

    0 where the bone is not above.
    """
    high = np.linspace(0.0, HIGHEST, HEIGHTS)[:, None]
    inside = field(points + high[..., None] * outward) < 0
    last = np.where(inside.any(axis=0), HEIGHTS - 1 - inside[::-1].argmax(axis=0), 0)
    low, far = high[last, 0], np.minimum(high[last, 0] + high[1, 0], HIGHEST)
    for _ in range(30):
        middle = 0.5 * (low + far)
        within = field(points + middle[:, None] * outward) < 0
        low, far = np.where(within, middle, low), np.where(within, far, middle)
    return np.where(inside.any(axis=0), low, 0.0)


def taut_over(places, heights) -> list[int]:
    """Where a line that is taut between the ends of a section touches it: the upper hull without its ends."""
    hull: list[int] = []
    for k in range(len(places)):
        while len(hull) > 1:
            i, j = hull[-2:]
            rise = (heights[j] - heights[i]) * (places[k] - places[i])
            if rise > (heights[k] - heights[i]) * (places[j] - places[i]):
                break
            hull.pop()
        hull.append(k)
    return hull[1:-1]


def length(start, end, cylinder: Cylinder | None) -> float:
    """Of the shortest way from start to end (3,), both outside of the cylinder, around it."""
    straight = float(np.linalg.norm(end - start))
    if cylinder is None:
        return straight
    rise = (end - start) @ cylinder.axis
    a, b = (p - cylinder.centre - (p - cylinder.centre) @ cylinder.axis * cylinder.axis for p in (start, end))
    share = -a @ (b - a) / ((b - a) @ (b - a))
    if not 0 < share < 1 or np.linalg.norm(a + share * (b - a)) >= cylinder.radius:
        return straight
    far, other, radius = np.linalg.norm(a), np.linalg.norm(b), cylinder.radius
    arc = np.arccos(a @ b / (far * other)) - np.arccos(radius / far) - np.arccos(radius / other)
    flat = np.sqrt(far**2 - radius**2) + radius * arc + np.sqrt(other**2 - radius**2)
    return float(np.hypot(flat, rise))


def on_surface(bone: str, points):
    """Points (n, 3) moved to the bone's surface [mm]."""
    for _ in range(20):
        points = to_surface(points, BONES[bone][0], 0.5)
    return points


if __name__ == "__main__":
    main()
