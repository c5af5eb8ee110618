"""Tunnel: a bore in a bone (paper, Algorithm 2)."""

import dataclasses

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
