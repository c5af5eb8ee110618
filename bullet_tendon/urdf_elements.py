"""Tendons and tunnels written in a URDF: the <tunnel> and <tendon> elements under <robot>.

Owns: nothing; loading.py makes them. Goes with no room of the core.

pybullet's own loader ignores both. Lengths [m]; a point is in the frame of the URDF link it names, a
tendon's point without a link in the world frame.

    <tunnel name="femoral" link="femur" radius="0.004" friction="0.1" chamfer="0.0005">
      <start xyz="0 0 0"/>
      <end xyz="0 0.03 0"/>
    </tunnel>
    <tendon name="graft" radius="0.0035" particles="60">
      <material stiffness="5e4" exponent="2" damping="50" density="1120"/>   (or preset="a name")
      <point link="tibia" xyz="0 0 0" attach="true"/>
      <point xyz="0 0.1 0"/>
    </tendon>

A file is read as a whole: either all of it is right, or UrdfError names what is wrong.
"""

import math
import os
from dataclasses import dataclass, field, replace
from xml.etree import ElementTree

import numpy as np

from .errors import InvalidType, UrdfError

MATERIAL_POSITIVE = ("stiffness", "toe_strain", "density", "rupture_force", "rupture_strain")
MATERIAL_AT_LEAST = {"exponent": 1.0, "damping_exponent": 1.0} | dict.fromkeys(
    ("damping", "shear_stiffness", "bending_stiffness", "friction"), 0.0
)
MATERIAL_ATTRIBUTES = (*MATERIAL_POSITIVE, *MATERIAL_AT_LEAST, "tension_only", "damping_form", "relaxation")
FLAGS = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True, eq=False)
class TunnelElement:
    """A bore: its axis from start to end (3,) [m] in the link's frame, its radius and chamfer [m]."""

    name: str
    link: str
    start: np.ndarray
    end: np.ndarray
    radius: float
    friction: float | None = None
    chamfer: float = 0.0

    def scaled(self, by: float) -> "TunnelElement":
        """The same in links that are larger by a factor."""
        lengths = {"radius": by * self.radius, "chamfer": by * self.chamfer}
        return replace(self, start=by * self.start, end=by * self.end, **lengths)


@dataclass(frozen=True, eq=False)
class TendonElement:
    """A tendon along points (link, position (3,) [m] in that link's frame; link None: the world frame).

    attachments: indices into `points`; the particle nearest such a point is tied to its link there.
    """

    name: str
    points: tuple[tuple[str | None, np.ndarray], ...]
    radius: float
    particles: int | None
    material: dict
    attachments: tuple[int, ...] = ()

    def scaled(self, by: float) -> "TendonElement":
        """The same in links that are larger by a factor; points in the world, and the material, stay."""
        points = tuple((link, xyz if link is None else by * xyz) for link, xyz in self.points)
        return replace(self, points=points, radius=by * self.radius)


@dataclass(frozen=True)
class UrdfElements:
    """All tunnels and tendons of one file, in its order.

    concave: by the name of a link, whether each of its <collision> elements asks pybullet for triangles.
    """

    tunnels: tuple[TunnelElement, ...]
    tendons: tuple[TendonElement, ...]
    concave: dict[str, tuple[bool, ...]] = field(default_factory=dict)

    def scaled(self, by: float) -> "UrdfElements":
        """The same in links that are larger by a factor."""
        tunnels = tuple(tunnel.scaled(by) for tunnel in self.tunnels)
        return replace(self, tunnels=tunnels, tendons=tuple(tendon.scaled(by) for tendon in self.tendons))


def read_elements(path: str | os.PathLike) -> UrdfElements:
    """The <tunnel> and <tendon> elements of a URDF file; anything wrong raises UrdfError."""
    try:
        path = os.fspath(path)
    except TypeError:
        raise InvalidType("path", path, "a path to a URDF file") from None
    robot = _robot(path)
    links = tuple(link.get("name") for link in robot.findall("link"))
    found = UrdfElements(
        tuple(_tunnel(_Element(path, node), links) for node in robot.findall("tunnel")),
        tuple(_tendon(_Element(path, node), links) for node in robot.findall("tendon")),
        {
            link.get("name"): tuple("concave" in node.attrib for node in link.findall("collision"))
            for link in robot.findall("link")
        },
    )
    for kind, elements in (("tunnel", found.tunnels), ("tendon", found.tendons)):
        names = [element.name for element in elements]
        for name in names:
            if names.count(name) > 1:
                raise UrdfError(path, f"<{kind} name={name!r}>", "name", name, f"unique among <{kind}>s")
    return found


def _robot(path: str):
    try:
        robot = ElementTree.parse(path).getroot()
    except OSError as error:
        raise UrdfError(path, "file", "path", path, f"a readable file ({error.strerror})") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise UrdfError(path, "file", "XML", str(error), "well-formed XML") from error
    if robot.tag != "robot":
        raise UrdfError(path, f"<{robot.tag}>", "root element", robot.tag, "'robot'")
    for kind in ("tunnel", "tendon"):
        if len(robot.findall(f".//{kind}")) != len(robot.findall(kind)):
            raise UrdfError(path, f"<{kind}>", "place", "nested", "a child of <robot>")
    return robot


def _tunnel(element: "_Element", links) -> TunnelElement:
    element.expect(("name", "link", "radius", "friction", "chamfer"), ("start", "end"))
    radius = element.number("radius", above=0.0)
    start, end = (element.only(tag).point(("xyz",)) for tag in ("start", "end"))
    if not np.linalg.norm(end - start) > 0.0:
        element.fail("end", end.tolist(), "another point than start")
    return TunnelElement(
        name=element.text("name"),
        link=element.link(links),
        start=start,
        end=end,
        radius=radius,
        friction=element.number("friction", default=None, at_least=0.0),
        chamfer=element.number("chamfer", default=0.0, at_least=0.0),
    )


def _tendon(element: "_Element", links) -> TendonElement:
    element.expect(("name", "radius", "particles"), ("material", "point"))
    points = [_point(child, links) for child in element.children("point")]
    if len(points) < 2:
        element.fail("<point>", f"{len(points)} times", "given at least twice")
    return TendonElement(
        name=element.text("name"),
        points=tuple((link, position) for link, position, _ in points),
        radius=element.number("radius", above=0.0),
        particles=element.count("particles", at_least=2),
        material=_material(element.only("material")),
        attachments=tuple(i for i, (*_, attach) in enumerate(points) if attach),
    )


def _point(element: "_Element", links):
    position, attach = element.point(("link", "xyz", "attach")), element.flag("attach")
    link = element.link(links) if "link" in element.node.attrib else None
    if attach and link is None:
        element.fail("link", None, "given where attach is true")
    return link, position, attach


def _material(element: "_Element") -> dict:
    """Arguments of Material, or of Material.preset where it has a name."""
    if "preset" in element.node.attrib:
        element.expect(("preset", "tissue"), ())
        return {"name": element.text("preset"), "tissue": element.flag("tissue")}
    element.expect(MATERIAL_ATTRIBUTES, ())
    element.text("stiffness")  # the one that has no sensible default
    given = element.node.attrib.keys()
    keywords = {name: element.number(name, above=0.0) for name in MATERIAL_POSITIVE if name in given}
    for name in MATERIAL_AT_LEAST.keys() & given:
        keywords[name] = element.number(name, at_least=MATERIAL_AT_LEAST[name])
    if "tension_only" in given:
        keywords["tension_only"] = element.flag("tension_only")
    if "damping_form" in given:
        keywords["damping_form"] = element.text("damping_form")
    if "relaxation" in given:
        keywords["relaxation"] = element.pairs("relaxation")
    return keywords


class _Element:
    """An XML element that knows its file and how to be named in an error."""

    def __init__(self, path: str, node, parent: str = ""):
        name = node.get("name")
        self.path, self.node = path, node
        self.title = f"{parent}<{node.tag}>" if name is None else f"{parent}<{node.tag} name={name!r}>"

    def fail(self, attribute: str, value, allowed: str):
        raise UrdfError(self.path, self.title, attribute, value, allowed)

    def expect(self, attributes: tuple, children: tuple):
        """Refuses what is not listed: a misspelt name would otherwise be ignored."""
        for name, value in self.node.attrib.items():
            if name not in attributes:
                self.fail(name, value, "absent; known attributes are " + ", ".join(attributes))
        for child in self.node:
            if child.tag not in children:
                known = ", ".join(f"<{tag}>" for tag in children) or "none"
                self.fail(f"<{child.tag}>", dict(child.attrib), f"absent; known children are {known}")

    def children(self, tag: str) -> list:
        return [_Element(self.path, node, f"{self.title} ") for node in self.node.findall(tag)]

    def only(self, tag: str) -> "_Element":
        found = self.children(tag)
        if len(found) != 1:
            self.fail(f"<{tag}>", f"{len(found)} times", "given once")
        return found[0]

    def text(self, attribute: str) -> str:
        value = self.node.get(attribute)
        if value is None or not value.strip():
            self.fail(attribute, value, "given and not empty")
        return value

    def link(self, links) -> str:
        name = self.text("link")
        if name not in links:
            self.fail("link", name, "the name of a link: " + ", ".join(map(repr, links)))
        return name

    def number(self, attribute: str, default=..., above=None, at_least=None):
        if default is not ... and attribute not in self.node.attrib:
            return default
        text = self.text(attribute)
        value = _float(text)
        bad = not math.isfinite(value) or (above is not None and value <= above)
        if bad or (at_least is not None and value < at_least):
            bound = f" > {above:g}" if above is not None else f" >= {at_least:g}"
            self.fail(attribute, text, "a finite number" + bound)
        return value

    def count(self, attribute: str, at_least: int) -> int | None:
        if attribute not in self.node.attrib:
            return None
        text = self.text(attribute)
        if not (text.isascii() and text.isdecimal() and len(text) < 10) or int(text) < at_least:
            self.fail(attribute, text, f"an integer >= {at_least}")
        return int(text)

    def flag(self, attribute: str) -> bool:
        text = self.node.get(attribute, "false")
        if text not in FLAGS:
            self.fail(attribute, text, "true or false")
        return FLAGS[text]

    def pairs(self, attribute: str) -> tuple[tuple[float, float], ...]:
        text = self.text(attribute)
        values = [_float(word) for word in text.split()]
        if len(values) % 2 or not all(map(math.isfinite, values)):
            self.fail(attribute, text, "pairs of finite numbers")
        return tuple(zip(values[::2], values[1::2], strict=True))

    def point(self, attributes: tuple) -> np.ndarray:
        """xyz as (3,) [m], read-only."""
        self.expect(attributes, ())
        text = self.text("xyz")
        values = np.array([_float(word) for word in text.split()])
        if values.shape != (3,) or not np.isfinite(values).all():
            self.fail("xyz", text, "three finite numbers")
        values.flags.writeable = False
        return values


def _float(text: str) -> float:
    """A float of a text, NaN for what is not a number (and for Python's 1_000, which is not URDF)."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan
