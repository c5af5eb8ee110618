"""Ligament: a massless line that pulls on bodies along a path of points, through which it slides freely.

Owns: the handle; forces are the core's. Goes with the core's rooms `element` and `ligament`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pybullet as p

from . import checks
from ._core import World as Core
from ._core import trace_path
from .bodies import Bodies
from .errors import InvalidType, InvalidValue, NotCopied, SlackWarning, UnknownId, warn
from .material import Material

_KINDS = ("sphere", "cylinder", "ellipsoid")  # in the order of the core's
_FLATTEST = 10  # longest over shortest axis of an ellipsoid, for which its geodesics are found surely [-]
_SLACK = 1.25  # rest length over the path from which a warning is given [-]


@dataclasses.dataclass(frozen=True, eq=False)
class Wrap(NotCopied):
    """A surface of a link that paths of ligaments wrap around, made by TendonWorld.add_wrap.

    kind: "sphere", "cylinder" (without ends, along its z axis) or "ellipsoid"; radius [m], of an ellipsoid
    its three semi-axes along x, y and z; position (3,) [m] and orientation (x, y, z, w) in the link's
    URDF frame.

    Example:
        >>> condyle = world.add_wrap(ball, -1, ("sphere", 0.01), (0, 0, 0))
        >>> condyle.kind, condyle.radius, condyle.bodyUniqueId == ball
        ('sphere', 0.01, True)
    """

    bodyUniqueId: int
    linkIndex: int
    kind: str
    radius: float | tuple[float, float, float]
    position: np.ndarray
    orientation: np.ndarray

    def __repr__(self) -> str:
        sizes = ", ".join(f"{1e3 * size:.3g}" for size in np.atleast_1d(self.radius))
        return f"<Wrap, {self.kind} of {sizes} mm on body {self.bodyUniqueId}, link {self.linkIndex}>"

    @property
    def radii(self) -> np.ndarray:
        """(3,) its semi-axes [m]. Along z, a cylinder has none: the number is its radius there, too."""
        return np.broadcast_to(self.radius, 3).astype(float)

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) its axes as columns, in the link's frame."""
        return np.reshape(p.getMatrixFromQuaternion(self.orientation.tolist()), (3, 3))


def checked_wrap(bodies: Bodies, body, link, shape, position, orientation) -> Wrap:
    """A wrap with checked arguments. Raises InvalidType, InvalidValue or UnknownId."""
    bodies.require(body, link)
    if not isinstance(shape, (tuple, list)) or len(shape) != 2:
        allowed = '("sphere", radius), ("cylinder", radius) or ("ellipsoid", (a, b, c))'
        raise InvalidType("shape", shape, allowed)
    kind = checks.choice("shape", shape[0], _KINDS)
    radius = _semi_axes(shape[1]) if kind == "ellipsoid" else checks.number("shape", shape[1], above=0)
    turn = checks.vector("orientation", orientation, 4)
    if not np.linalg.norm(turn) > 0:
        raise InvalidValue("orientation", orientation, "a quaternion other than zero")
    at = checks.vector("position", position)
    return Wrap(int(body), int(link), kind, radius, at, turn / np.linalg.norm(turn))


def _semi_axes(value) -> tuple[float, float, float]:
    radii = checks.vector("shape", value)
    if not (radii.min() > 0 and radii.max() <= _FLATTEST * radii.min()):
        allowed = f"three semi-axes > 0 [m], the longest at most {_FLATTEST} times the shortest"
        raise InvalidValue("shape", value, allowed)
    return tuple(radii.tolist())


class Ligament(NotCopied):
    """A ligament between bodies, made by TendonWorld.add_ligament.

    It has no mass. It is straight between its points, slides through the inner ones without friction, and has
    one tension along its whole length. name, material: as given; removed: whether it was taken out.
    path: ((bodyUniqueId, linkIndex, (x, y, z)), ...), the points in the links' URDF frames [m].

    Example:
        >>> stand = p.createMultiBody(0)
        >>> line = world.add_ligament([(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))], material)
        >>> round(line.length, 3), round(line.rest_length, 3), line.force
        (0.11, 0.11, 0.0)
    """

    def __init__(
        self,
        core: Core,
        bodies: Bodies,
        slot: int,
        name: str,
        material: Material,
        path: tuple,
        wraps: tuple[Wrap, ...] = (),
    ):
        self._core, self._bodies = core, bodies
        self.slot, self.name, self.material, self.path, self.wraps = slot, name, material, path, wraps
        self.links = {*(row[:2] for row in path), *((wrap.bodyUniqueId, wrap.linkIndex) for wrap in wraps)}
        self.link_slots = frozenset(bodies.slot(*link) for link in self.links)
        self.removed = False

    def __repr__(self) -> str:
        if self.removed:
            return f"<Ligament {self.name!r}, removed>"
        try:
            length = f"{1e3 * self.length:.4g} mm long"
        except UnknownId:
            length = "of a body that was removed"
        parts = [f"{length} (rest {1e3 * self.rest_length:.4g} mm)", f"force {self.force:.4g} N"]
        parts += ["with wraps"] if self.wraps else []
        parts += ["ruptured"] if self.ruptured else []
        parts += [] if self.tension is None else [f"under a tension of {self.tension:.4g} N"]
        return f"<Ligament {self.name!r}: {', '.join(parts)}>"

    @property
    def force(self) -> float:
        """Its tension at the end of the last step [N]; 0 before the first one. Negative: it pushes."""
        return self._core.ligament_force(self._there())

    @property
    def length(self) -> float:
        """Length of its path where the bodies are now [m]. Raises UnknownId where a body was removed."""
        return self._measured()[0] if self.wraps else path_length(self.points)

    @property
    def strain(self) -> float:
        """(length - rest_length) / rest_length, now [-]."""
        return self.length / self.rest_length - 1

    @property
    def points(self) -> np.ndarray:
        """(k, 3) the points of its path in the world frame, now [m]; where it meets and leaves wraps, too.

        Raises UnknownId where a body was removed.
        """
        self._require_bodies()
        return self._measured()[1] if self.wraps else points_of(self._bodies, self.path)

    @property
    def line(self) -> np.ndarray:
        """(k, 3) what to draw of it, world frame, now [m]: its path, also along wraps. k does not change."""
        self._require_bodies()
        return line_of(self, {link: self._bodies.checked_frame(*link) for link in self.links})

    def _require_bodies(self) -> None:
        self._there()
        self._bodies.require_same(self.link_slots)

    def _measured(self) -> tuple[float, np.ndarray]:
        """Length and points of a path with wraps, where pybullet has the bodies now."""
        slot = self._there()
        self._bodies.require_client()
        self._bodies.read()
        return self._core.ligament_points(slot)

    @property
    def rest_length(self) -> float:
        """Length at which its law has no force [m]; it can be set, to re-tension it. Raises InvalidValue."""
        return self._core.ligament_rest(self._there())

    @rest_length.setter
    def rest_length(self, value: float) -> None:
        rest = checks.number("rest_length", value, above=0)
        self._bodies.require_client()
        self._core.set_ligament_rest(self._there(), rest)

    @property
    def ruptured(self) -> bool:
        """Whether it has ended a step beyond its material's rupture force or strain: it has no tension."""
        return self._core.ligament_is_ruptured(self._there())

    @property
    def tension(self) -> float | None:
        """The tension that was set by set_tension [N]; None: its material decides."""
        found = self._core.ligament_tension(self._there())
        return None if found < 0 else found

    def set_tension(self, tension: float | None) -> None:
        """Pull with a constant tension [N], >= 0, whatever the length: a muscle, or a line with a weight.

        Args:
            tension: [N]; None: the material's law again.

        Raises:
            InvalidType, InvalidValue: not a number >= 0.
            UnknownId: the ligament was removed.

        Example:
            >>> stand = p.createMultiBody(0)
            >>> line = world.add_ligament([(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))], material)
            >>> line.set_tension(0.1 * 9.81)
            >>> world.step(240)
            >>> round(line.force, 3), round(line.length, 3)
            (0.981, 0.11)
        """
        chosen = -1.0 if tension is None else checks.number("tension", tension, at_least=0)
        self._bodies.require_client()
        self._core.set_ligament_tension(self._there(), chosen)

    def _there(self) -> int:
        if self.removed:
            raise UnknownId("ligament", self.name, "one that was not removed")
        return self.slot


def checked_path(bodies: Bodies, path: Sequence) -> tuple:
    """The path with checked ids and points. Raises InvalidType, InvalidValue or UnknownId."""
    points = "points (bodyUniqueId, linkIndex, (x, y, z))"
    rows = [checks.sequence("path", row, points) for row in checks.sequence("path", path, points)]
    if len(rows) < 2 or any(len(row) != 3 for row in rows):
        raise InvalidValue("path", path, "two points (bodyUniqueId, linkIndex, (x, y, z)) or more")
    for body, link, _ in rows:
        bodies.require(body, link)
    found = tuple(
        (int(body), int(link), tuple(checks.vector("path", at).tolist())) for body, link, at in rows
    )
    if len({row[:2] for row in found}) < 2:
        raise InvalidValue("path", path, "through two links at least: on one alone it has no effect")
    return found


def points_of(bodies: Bodies, path: tuple) -> np.ndarray:
    """(k, 3) points of a path in the world frame [m]."""
    return _placed(path, {key: bodies.checked_frame(*key) for key in {row[:2] for row in path}})


def line_of(ligament: Ligament, frames: dict) -> np.ndarray:
    """(..., k, 3) Ligament.line by frames of its links: origin (..., 3), axes (..., 3, 3), by link."""
    points = _placed(ligament.path, frames)
    if not ligament.wraps:
        return points
    if points.ndim > 2:
        moments = [
            {link: (x[row], axes[row]) for link, (x, axes) in frames.items()} for row in range(len(points))
        ]
        return np.array([line_of(ligament, moment) for moment in moments])
    around = []
    for wrap in ligament.wraps:
        origin, axes = frames[wrap.bodyUniqueId, wrap.linkIndex]
        shape = 0, _KINDS.index(wrap.kind), wrap.radii
        around.append((*shape, origin + axes @ wrap.position, axes @ wrap.axes))
    return trace_path(points, around)


def _placed(path: tuple, frames: dict) -> np.ndarray:
    places = [(*frames[body, link], np.array(at)) for body, link, at in path]
    return np.stack([origin + axes @ at for origin, axes, at in places], axis=-2)


def path_length(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def checked_rest(name: str, rest_length: float | None, length: float) -> float:
    """The rest length [m] of a ligament whose path has this length now; warns where it is far longer."""
    if rest_length is None:
        return checks.number("path", length, above=0)
    rest = checks.number("rest_length", rest_length, above=0)
    if rest > _SLACK * length:
        warn(
            SlackWarning(
                f"ligament {name!r} is slack: its rest length of {rest:.4g} m is "
                f"{rest / length - 1 if length > 0 else np.inf:.0%} beyond its path of {length:.4g} m"
            )
        )
    return rest


def wrap_arguments(bodies: Bodies, wraps: tuple[Wrap, ...]) -> list[tuple]:
    """The wraps as the compiled core takes them."""
    return [
        (
            bodies.slot(wrap.bodyUniqueId, wrap.linkIndex),
            _KINDS.index(wrap.kind),
            wrap.radii,
            wrap.position,
            wrap.axes,
        )
        for wrap in wraps
    ]
