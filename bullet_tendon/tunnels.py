"""Tunnel: a bore in a bone (paper, Algorithm 2), and where the bone is drilled.

Owns: the handle of a bore; its contacts are the core's. Goes with the core's room `geometry` (tunnel_bore).
"""

import dataclasses
from collections.abc import Callable

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class Tunnel:
    """A cylindrical bore in a link, made by TendonWorld.add_tunnel.

    start, end: (3,) ends of its axis in the link's frame [m]; radius [m]; friction: coefficient of its
    wall [-]; chamfer: radius by which its mouths' edges are rounded [m], 0 for sharp edges.
    """

    bodyUniqueId: int
    linkIndex: int
    start: np.ndarray
    end: np.ndarray
    radius: float
    friction: float
    chamfer: float
    name: str
    slot: int = dataclasses.field(repr=False)
    link_slot: int = dataclasses.field(repr=False)
    _frame: Callable = dataclasses.field(repr=False)

    @property
    def ends(self) -> np.ndarray:
        """(2, 3) start and end of its axis, world frame, where pybullet has the link now [m].

        Raises UnknownId where the client was disconnected, or the body removed.
        """
        origin, axes = self._frame(self.bodyUniqueId, self.linkIndex)
        return origin + np.array([self.start, self.end]) @ axes.T


REACH = 2.0  # radii by which a bore goes on beyond its mouths; the core's kBoreReach


class Bores:
    """Where the bone is drilled now. frame(body, link) -> origin (3,) and axes (3, 3) of a link's frame."""

    def __init__(self, tunnels, frame):
        self._bores = [(t, *frame(t.bodyUniqueId, t.linkIndex)) for t in tunnels]

    def contain(self, bodyUniqueId: int, linkIndex: int, points) -> np.ndarray:
        """(k,) whether points (k, 3), world frame, are in a bore of that link."""
        found = np.zeros(len(points), bool)
        for tunnel, origin, axes in self._bores:
            if (tunnel.bodyUniqueId, tunnel.linkIndex) == (bodyUniqueId, linkIndex):
                found |= _in_bore(tunnel, (points - origin) @ axes)
        return found


def _in_bore(tunnel: Tunnel, points) -> np.ndarray:
    way = tunnel.end - tunnel.start
    length = np.linalg.norm(way)
    along = (points - tunnel.start) @ way / length
    aside = points - tunnel.start - along[:, None] * way / length
    beyond = REACH * tunnel.radius
    near = (along >= -beyond) & (along <= length + beyond)
    return near & (np.linalg.norm(aside, axis=1) <= tunnel.radius)
