"""The files of a knee: bones, cartilage, ligaments, and the URDF of a tibia with five freedoms."""

import csv
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

import bullet_tendon as bt
from bullet_tendon.errors import InvalidType, InvalidValue

COLUMNS = ("strand", "linear_stiffness_N_per_strain", "slack_length_m", "point", "body", "x_m", "y_m", "z_m")
# Optional: in a row with a radius, a cylinder around which the strand passes. Its centre is where points are.
CYLINDER = ("cylinder_radius_m", "axis_x", "axis_y", "axis_z")
# Of the femur and the tibia in a table: the first pair of which it has both.
FRAMES = (("femur_distal", "tibia_proximal"), ("femur", "tibia"))


class Cylinder(NamedTuple):
    """What a strand passes around, in the frame of a bone: centre and direction of its axis; radius [m]."""

    bone: str
    centre: tuple
    radius: float
    axis: tuple

    @property
    def orientation(self) -> np.ndarray:
        """(x, y, z, w) that turns z into its axis."""
        x, y, z = np.array(self.axis) / np.linalg.norm(self.axis) * (-1 if self.axis[2] < 0 else 1)
        turn = np.array([-y, x, 0.0, 1.0 + z])
        return turn / np.linalg.norm(turn)


class Strand(NamedTuple):
    """A strand of a ligament. path: ("femur" | "tibia", (x, y, z) [m]); stiffness [N]; slack length [m]."""

    name: str
    path: tuple
    stiffness: float
    slack: float
    cylinders: tuple[Cylinder, ...] = ()

    @property
    def group(self) -> str:
        """The strand's name without the number at its end."""
        return self.name.rstrip("0123456789")


def own(name: str) -> Path:
    """A file of the project's own knee."""
    return Path(bt.data_path("knee.urdf")).parent / name


def bone_paths(argument: str, given, suffix: str = "") -> tuple[Path, Path]:
    """Paths of the femur's and the tibia's mesh. suffix: of the names in a folder.

    given: None for the project's own; a folder with femur.stl and tibia.stl; a pair; or a mapping with the
    keys "femur" and "tibia". Raises InvalidType or InvalidValue.
    """
    if given is None:
        found = [own(f"meshes/{bone}{suffix}.obj") for bone in ("femur", "tibia")]
    elif isinstance(given, (str, PathLike)):
        found = [Path(given) / f"{bone}{suffix}.stl" for bone in ("femur", "tibia")]
    elif isinstance(given, Mapping):
        if not {"femur", "tibia"} <= set(given):
            raise InvalidValue(argument, given, 'a mapping with the keys "femur" and "tibia"')
        found = [Path(given[bone]) for bone in ("femur", "tibia")]
    else:
        try:
            found = [Path(path) for path in given][:2]
        except TypeError:
            raise InvalidType(argument, given, "None, a folder, or two paths: femur and tibia") from None
        if len(found) < 2:
            raise InvalidValue(argument, given, "two paths: femur and tibia")
    for path in found:
        if not path.is_file():
            raise InvalidValue(argument, str(path), "a file that exists")
    return found[0].resolve(), found[1].resolve()


def read_strands(argument: str, path: str | PathLike | None) -> list[Strand]:
    """The strands of a table that join femur and tibia; others, as to the patella, are left out.

    path: None for the project's own; a CSV file with the columns COLUMNS, one row for each point of a strand,
    and with CYLINDER, if strands pass around something; or a folder with ligaments.csv. Raises InvalidValue.
    """
    path = own("knee_ligaments.csv") if path is None else Path(path)
    path = path / "ligaments.csv" if path.is_dir() else path
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except OSError as problem:
        raise InvalidValue(argument, str(path), f"a file that can be read ({problem.strerror})") from None
    if not rows or not set(COLUMNS) <= set(rows[0]):
        raise InvalidValue(argument, str(path), f"a table with the columns {', '.join(COLUMNS)}")
    known = {row["body"] for row in rows}
    frames = next((pair for pair in FRAMES if set(pair) <= known), None)
    if frames is None:
        raise InvalidValue(argument, str(path), f"a table of strands between {FRAMES[0]} or {FRAMES[1]}")
    by_name: dict[str, list[dict]] = {}
    for row in rows:
        by_name.setdefault(row["strand"], []).append(row)
    bones = dict(zip(frames, ("femur", "tibia"), strict=True))
    try:
        strands = [
            _strand(name, points, bones)
            for name, points in by_name.items()
            if {point["body"] for point in points} == set(frames)
        ]
    except (TypeError, ValueError) as problem:
        raise InvalidValue(argument, str(path), f"a table of numbers ({problem})") from None
    return strands


def _strand(name: str, rows: list[dict], bones: dict[str, str]) -> Strand:
    path, cylinders = [], []
    for row in sorted(rows, key=lambda row: int(row["point"])):
        bone, place = bones[row["body"]], tuple(float(row[f"{c}_m"]) for c in "xyz")
        if row.get(CYLINDER[0]):
            radius, *axis = (float(row[column]) for column in CYLINDER)
            if not (radius > 0 and np.linalg.norm(axis) > 0):
                raise ValueError(f"strand {name}: a cylinder without a radius or an axis")
            cylinders.append(Cylinder(bone, place, radius, tuple(axis)))
        else:
            path.append((bone, place))
    law = float(rows[0]["linear_stiffness_N_per_strain"]), float(rows[0]["slack_length_m"])
    return Strand(name, tuple(path), *law, tuple(cylinders))


# Joints from the laboratory, in which the femur turns about z, to the tibia: Grood and Suntay's three axes
# with a shift along each and the rotations about the last two.
JOINTS = (
    ("lateral", "prismatic", (0, 0, 1)),
    ("anterior", "prismatic", (1, 0, 0)),
    ("adduction", "continuous", (1, 0, 0)),
    ("superior", "prismatic", (0, 1, 0)),
    ("internal_rotation", "continuous", (0, 1, 0)),
)
# Shank: mass [kg], centre of mass [m] in the frame of the proximal tibia, principal inertia [kg m^2]
# (lenhart2015).
SHANK = (2.652, (-0.006, -0.17313, 0.0), (0.0249, 0.0043, 0.0259))
INNER = (0.01, (0.0, 0.0, 0.0), (1e-5, 1e-5, 1e-5))  # of the links between: keeps the chain well conditioned


def tibia_urdf(mesh: Path, colour=(0.93, 0.89, 0.78, 1.0)) -> str:
    """A tibia at the end of JOINTS, whose base stands still, as the text of a URDF file."""
    links = ["laboratory", *(f"after_{name}" for name, *_ in JOINTS[:-1]), "tibia"]
    parts = [f'<link name="laboratory">{_inertial(*INNER)}</link>']
    for (name, kind, axis), parent, child in zip(JOINTS, links[:-1], links[1:], strict=True):
        limit = '<limit lower="-1" upper="1" effort="1e6" velocity="1e3"/>' if kind == "prismatic" else ""
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<axis xyz="{_text(axis)}"/>{limit}</joint>'
        )
        parts.append(
            f'<link name="{child}">{_inertial(*INNER)}</link>' if child != "tibia" else _bone(mesh, colour)
        )
    return f'<robot name="tibia">{"".join(parts)}</robot>'


def _bone(mesh: Path, colour) -> str:
    shape = f"<geometry><mesh filename={quoteattr(str(mesh))}/></geometry>"
    look = f'<material name="bone"><color rgba="{_text(colour)}"/></material>'
    return (
        f'<link name="tibia">{_inertial(*SHANK)}<visual>{shape}{look}</visual>'
        f'<collision concave="yes">{shape}</collision></link>'
    )


def _inertial(mass: float, centre, inertia) -> str:
    moments = " ".join(
        f'{name}="{value}"' for name, value in zip(("ixx", "iyy", "izz"), inertia, strict=True)
    )
    return (
        f'<inertial><origin xyz="{_text(centre)}"/><mass value="{mass}"/>'
        f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def _text(numbers) -> str:
    return " ".join(str(number) for number in numbers)
