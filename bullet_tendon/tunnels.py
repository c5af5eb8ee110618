"""Tunnel: a bore in a bone (paper, Algorithm 2), and where the bone is drilled.

Owns: the handle of a bore; its contacts are the core's. Goes with the core's room `geometry` (tunnel_bore).
"""

import dataclasses

import numpy as np

from ._core import World as Core
from .bodies import Bodies
from .errors import NotCopied
from .mouths import mouths_of
from .shapes import Shape


@dataclasses.dataclass(frozen=True, eq=False)
class Tunnel(NotCopied):
    """A cylindrical bore in a link, made by TendonWorld.add_tunnel.

    start, end: (3,) ends of its axis, as given, in the link's frame [m]; radius [m]; chamfer: radius by which
    its mouths' edges are rounded [m], 0 for sharp edges.

    Example:
        >>> eyelet = world.add_tunnel(ball, -1, (0, 0, -0.01), (0, 0, 0.01), radius=0.003)
        >>> eyelet.bodyUniqueId, eyelet.radius, eyelet.start.tolist(), eyelet.chamfer
        (0, 0.003, [0.0, 0.0, -0.01], 0.0)
    """

    bodyUniqueId: int
    linkIndex: int
    start: np.ndarray
    end: np.ndarray
    radius: float
    chamfer: float
    name: str
    slot: int = dataclasses.field(repr=False)
    link_slot: int = dataclasses.field(repr=False)
    _friction: float | None = dataclasses.field(repr=False)
    _bodies: Bodies = dataclasses.field(repr=False)
    _core: Core = dataclasses.field(repr=False)

    def __repr__(self) -> str:
        length = 1e3 * float(np.linalg.norm(self.end - self.start))
        friction = "of the link" if self._friction is None else f"{self._friction:.3g}"
        sizes = f"radius {1e3 * self.radius:.3g} mm, {length:.3g} mm long, friction {friction}"
        edge = f", chamfer {1e3 * self.chamfer:.3g} mm" if self.chamfer else ""
        return f"<Tunnel {self.name!r} in body {self.bodyUniqueId}, link {self.linkIndex}: {sizes}{edge}>"

    @property
    def friction(self) -> float:
        """Coefficient of its wall [-]: as given, else the lateralFriction that pybullet has for the link now.

        The latter raises UnknownId where the client was disconnected, or the body removed.
        """
        if self._friction is not None:
            return self._friction
        return self._bodies.lateral_friction(self.bodyUniqueId, self.linkIndex)

    @property
    def ends(self) -> np.ndarray:
        """(2, 3) start and end of its axis, world frame, where pybullet has the link now [m].

        Raises UnknownId where the client was disconnected, or the body removed.
        """
        origin, axes = self._frame()
        return origin + np.array([self.start, self.end]) @ axes.T

    def _frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) and axes (3, 3) of its link's frame in the world, now. Raises UnknownId."""
        self._bodies.require_same([self.link_slot])
        return self._bodies.checked_frame(self.bodyUniqueId, self.linkIndex)

    def _drills(self, points) -> np.ndarray:
        """(k,) whether it removes the bone at points (k, 3) of the link's frame [m]."""
        return self._core.is_drilled(self.slot, points)

    def _meet(self, shapes: list[Shape]) -> None:
        """Let its mouths be where it meets the surface of its link's shapes."""
        self._core.set_mouths(self.slot, *mouths_of(shapes, self.start, self.end, self.radius))


ROUNDING = 1e-6  # share of a bore's radius by which a centreline may be in it unnoticed: an end on its mouth


class Bores:
    """Where the bone is drilled now. frame(body, link) -> origin (3,) and axes (3, 3) of a link's frame."""

    def __init__(self, tunnels, frame):
        self._bores = [(t, *frame(t.bodyUniqueId, t.linkIndex)) for t in tunnels]

    def contain(self, bodyUniqueId: int, linkIndex: int, points) -> np.ndarray:
        """(k,) whether points (k, 3), world frame, are in a bore of that link."""
        found = np.zeros(len(points), bool)
        for tunnel, origin, axes in self._bores:
            if (tunnel.bodyUniqueId, tunnel.linkIndex) == (bodyUniqueId, linkIndex):
                found |= tunnel._drills((points - origin) @ axes)
        return found

    def hold(self, bodyUniqueId: int, linkIndex: int, a, b) -> np.ndarray:
        """(k,) whether a bore of that link has an end or a part of segments a -> b (k, 3), world frame."""
        found = self.contain(bodyUniqueId, linkIndex, a) | self.contain(bodyUniqueId, linkIndex, b)
        for tunnel, origin, axes in self._bores:
            if (tunnel.bodyUniqueId, tunnel.linkIndex) == (bodyUniqueId, linkIndex):
                ends = (a - origin) @ axes, (b - origin) @ axes
                found |= passing(tunnel.start, tunnel.end, tunnel.radius, *ends)
        return found

    def gaps(self, line) -> np.ndarray:
        """(n-1,) bounds from below of the distances of a line's (n, 3) segments from all bores [m]."""
        half = 0.5 * np.linalg.norm(np.diff(line, axis=0), axis=1)
        found = np.full(len(half), np.inf)
        for tunnel, origin, axes in self._bores:
            way, points = tunnel.end - tunnel.start, (line - origin) @ axes - tunnel.start
            nearest = np.clip(points @ way / (way @ way), 0.0, 1.0)[:, None] * way
            aside = np.linalg.norm(points - nearest, axis=1)
            found = np.minimum(found, np.minimum(aside[:-1], aside[1:]) - half - tunnel.radius)
        return np.maximum(found, 0.0)

    def first_with(self, line) -> Tunnel | None:
        """The first tunnel in which a part of the centreline (n, 3), world frame, lies between its mouths."""
        for tunnel, origin, axes in self._bores:
            if passes(tunnel.start, tunnel.end, tunnel.radius, (line - origin) @ axes):
                return tunnel
        return None


def passes(start, end, radius: float, line) -> bool:
    """Whether a part of a centreline (n, 3) is in a bore, not only on its mouths or wall; one frame [m]."""
    return bool(passing(start, end, radius, line[:-1], line[1:]).any())


def passing(start, end, radius: float, a, b) -> np.ndarray:
    """(k,) which of the segments a -> b (k, 3) a bore has a part of: see passes."""
    length, slack = np.linalg.norm(end - start), ROUNDING * radius
    axis = (end - start) / length
    z, dz = (a - start) @ axis, (b - a) @ axis
    x, dx = a - start - z[:, None] * axis, b - a - dz[:, None] * axis
    # The part u in [first, last] of each segment that is between the mouths.
    flat = dz == 0.0
    between = (z > slack) & (z < length - slack)
    steps = np.where(flat, 1.0, dz)
    mouths = np.array([slack - z, length - slack - z]) / steps
    first = np.where(flat, 0.0, np.maximum(mouths.min(0), 0.0))
    last = np.where(flat, np.where(between, 1.0, -1.0), np.minimum(mouths.max(0), 1.0))
    # Of that part, the point nearest to the axis.
    square = np.einsum("ij,ij->i", dx, dx)
    nearest = -np.einsum("ij,ij->i", x, dx) / np.where(square > 0.0, square, 1.0)
    nearest = np.maximum(np.minimum(nearest, last), first)
    off = np.linalg.norm(x + nearest[:, None] * dx, axis=1)
    return (first < last) & (off < radius - slack)
