"""Cartilage: an elastic foundation between the surfaces of two bodies.

Owns: the handle, and how surfaces are read, checked and measured once; pressures are the core's. Goes with
the core's rooms `element` and `cartilage`.
"""

import dataclasses
import hashlib
from collections import OrderedDict
from os import PathLike
from pathlib import Path
from threading import Lock
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from . import _core, checks
from .bodies import Bodies
from .errors import CartilageWarning, InvalidType, InvalidValue, NotCopied, UnknownId, warn
from .mesh_files import clean_triangles, read_mesh

_MOST_NODES = 3e7  # of a grid: 240 MB
_DEPTH = 2.0  # thicknesses behind the surface, to which its distance is known
LAWS = "linear", "logarithmic"
RESOLUTION = 1.0  # of the grid's spacing, within which triangles are merged by default
_FAR = 0.05  # m between surfaces from which they are not meant for each other
_FACING = -0.2  # mean cosine of the normals of surfaces that face each other, at most
_SMALLEST = 1e-26  # m^4, squared normal of a triangle with an area
_MOST_GRIDS = 8  # that are kept in memory
_GRID_VERSION = 2  # of the values at the nodes: files of another one are made anew

_grids: OrderedDict = OrderedDict()  # of all worlds
_grids_lock = Lock()  # worlds may be in different threads


@dataclasses.dataclass(frozen=True)
class Region:
    """What presses on one connected patch of the second surface, at the end of the last step.

    wrench (6,): force [N] and torque about its link's centre of mass [N m], world frame. area [m^2] of the
    pressed points. centre (3,) of pressure, world frame [m]; zero where nothing is pressed. max_pressure
    [Pa], max_depth [m].

    Example:
        >>> plate = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * 0.02 - (0.01, 0.01, 0)
        >>> lower, upper = (plate, [(0, 1, 2), (0, 2, 3)]), (plate, [(0, 2, 1), (0, 3, 2)])
        >>> stand = p.createMultiBody(0, basePosition=(0, 0, -0.11))
        >>> pad = world.add_cartilage((stand, -1, lower), (ball, -1, upper), damping=1.0)
        >>> world.step(240)
        >>> [round(float(region.wrench[2]), 3) for region in pad.regions]
        [0.981]
    """

    wrench: np.ndarray
    area: float
    centre: np.ndarray
    max_pressure: float
    max_depth: float


class Surface(NamedTuple):
    """A mesh in the frame of its link: vertices (v, 3) [m], triangles (t, 3)."""

    vertices: np.ndarray
    triangles: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        return self.vertices[self.triangles]

    @property
    def normals(self) -> np.ndarray:
        """(t, 3) unit normals times the areas [m^2]."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.cross(b - a, c - a) / 2

    def patches(self) -> np.ndarray:
        """(t,) number of the connected patch of each triangle."""
        ends = self.triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
        count = len(self.vertices)
        graph = coo_matrix((np.ones(len(ends)), ends.T), (count, count))
        of_vertices = connected_components(graph, directed=False)[1]
        labels = of_vertices[self.triangles[:, 0]]
        _, first, label = np.unique(labels, return_index=True, return_inverse=True)
        return first.argsort().argsort()[label]

    def digest(self) -> bytes:
        found = hashlib.blake2b(np.ascontiguousarray(self.vertices).tobytes(), digest_size=16)
        found.update(np.ascontiguousarray(self.triangles).tobytes())
        return found.digest()


class Cartilage(NotCopied):
    """Cartilage between two bodies, made by TendonWorld.add_cartilage.

    first, second: (bodyUniqueId, linkIndex) of surface A and B. foundation: K [Pa/m], the pressure per depth.
    thickness [m]; name: as given; removed: whether it was taken out. What is read is of the end of the last
    step, and on B.

    Example:
        >>> plate = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * 0.02 - (0.01, 0.01, 0)
        >>> lower, upper = (plate, [(0, 1, 2), (0, 2, 3)]), (plate, [(0, 2, 1), (0, 3, 2)])
        >>> stand = p.createMultiBody(0, basePosition=(0, 0, -0.11))
        >>> pad = world.add_cartilage((stand, -1, lower), (ball, -1, upper), damping=1.0)
        >>> p.resetBaseVelocity(ball, (0, 0, 0))
        >>> world.step(240)
        >>> round(float(pad.wrench[2]), 3), round(pad.area, 6)
        (0.981, 0.0004)
    """

    def __init__(self, core, bodies: Bodies, slot: int, name: str, links: tuple, layer: tuple):
        self._core, self._bodies, self.slot, self.name = core, bodies, slot, name
        self.first, self.second = links
        self.foundation, self.thickness = layer
        self.link_slots = frozenset(bodies.slot(*link) for link in links)
        self.removed = False

    def __repr__(self) -> str:
        if self.removed:
            return f"<Cartilage {self.name!r}, removed>"
        between = " and ".join(f"body {body}, link {link}" for body, link in (self.first, self.second))
        pressed = f"{1e6 * self.area:.4g} mm^2 pressed by {np.linalg.norm(self.wrench[:3]):.4g} N"
        return f"<Cartilage {self.name!r} between {between}: {pressed}>"

    @property
    def regions(self) -> tuple[Region, ...]:
        """One for each connected patch of B, in the order of their first triangles."""
        found = self._core.pressed_regions(self._there())
        return tuple(
            Region(np.array([*force, *torque]), area, np.array(centre), pressure, depth)
            for force, torque, area, centre, pressure, depth in found
        )

    @property
    def wrench(self) -> np.ndarray:
        """(6,) force [N] on B and torque about its link's centre of mass [N m], world frame."""
        return np.sum([region.wrench for region in self.regions], axis=0)

    @property
    def area(self) -> float:
        """Of the pressed points of B [m^2]."""
        return sum(region.area for region in self.regions)

    @property
    def centre(self) -> np.ndarray:
        """(3,) centre of pressure, world frame [m]; zero where nothing is pressed."""
        loads = [np.linalg.norm(region.wrench[:3]) for region in self.regions]
        if not sum(loads) > 0:
            return np.zeros(3)
        return np.average([region.centre for region in self.regions], axis=0, weights=loads)

    @property
    def max_pressure(self) -> float:
        """[Pa]."""
        return max(region.max_pressure for region in self.regions)

    @property
    def max_depth(self) -> float:
        """Of the pressed points of B [m]. More than the thickness: the layer is pressed flat."""
        return max(region.max_depth for region in self.regions)

    def _tell_flat(self) -> None:
        """A CartilageWarning where it was pressed by more than its thickness, once."""
        depth = self._core.flat_depth(self.slot)
        if depth > 0:
            warn(
                CartilageWarning(
                    f"cartilage {self.name!r} is pressed by {depth:.3g} m, more than its thickness of "
                    f"{self.thickness:.3g} m. Behind two thicknesses nothing is pushed out. Lower the load, "
                    'or take a thicker or stiffer layer, or law="logarithmic"'
                )
            )

    def depths(self) -> np.ndarray:
        """(t,) depth of the centre of each triangle of B inside A, where the bodies were last read [m].

        In the order of B's triangles, without those that have no area. Negative: outside, by at least that
        much. The pressure of a linear law is `foundation` times a depth above 0.

        Raises:
            UnknownId: the cartilage was removed.

        Example:
            >>> plate = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * 0.02 - (0.01, 0.01, 0)
            >>> lower, upper = (plate, [(0, 1, 2), (0, 2, 3)]), (plate, [(0, 2, 1), (0, 3, 2)])
            >>> stand = p.createMultiBody(0, basePosition=(0, 0, -0.1095))
            >>> pad = world.add_cartilage((stand, -1, lower), (ball, -1, upper))
            >>> pad.depths().round(6).tolist()
            [0.0005, 0.0005]
        """
        return self._core.cartilage_depths(self._there())

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the foundation is integrated: one for each patch of triangles that `resolution` has merged.

        Places (n, 3) in the frame of B's link [m], and areas (n,) [m^2]. Raises UnknownId: the cartilage was
        removed.
        """
        return self._core.cartilage_points(self._there())

    def _there(self) -> int:
        if self.removed:
            raise UnknownId("cartilage", self.name, "one that was not removed")
        return self.slot


def side_of(bodies: Bodies, argument: str, side) -> tuple[tuple[int, int], Surface, Path | None]:
    """Link, surface and file of (bodyUniqueId, linkIndex, mesh).

    Raises InvalidType, InvalidValue or UnknownId.
    """
    if not isinstance(side, (tuple, list)) or len(side) != 3:
        raise InvalidType(argument, side, "(bodyUniqueId, linkIndex, mesh)")
    body, link, mesh = side
    bodies.require(body, link)
    file = Path(mesh) if isinstance(mesh, (str, PathLike)) else None
    return (int(body), int(link)), _surface(argument, mesh, file), file


def _surface(argument: str, mesh, file: Path | None) -> Surface:
    if file is not None:
        found = read_mesh(file)
        vertices, triangles = found.vertices, found.triangles
    else:
        if not isinstance(mesh, (tuple, list)) or len(mesh) != 2:
            raise InvalidType(argument, mesh, "a path, or (vertices (v, 3), triangles (t, 3))")
        vertices = checks.array(argument, mesh[0], (None, 3))
        given = checks.array(argument, mesh[1], (None, 3))
        triangles = given.astype(int)
        if (triangles != given).any() or triangles.min() < 0 or triangles.max() >= len(vertices):
            raise InvalidValue(argument, mesh[1], f"triangles of the indices of {len(vertices)} vertices")
    return Surface(*clean_triangles(vertices, triangles, _SMALLEST))


def grid_of(surface: Surface, spacing: float, thickness: float, cache: Path | None):
    """The grid of signed distances to a surface, from memory, from its file, or made now.

    cache: file that keeps it; None: none. Raises InvalidValue where the surface is closed and wound inwards,
    or the grid would be too large.
    """
    depth = _DEPTH * thickness
    key = surface.digest(), spacing, depth, _GRID_VERSION
    with _grids_lock:
        if key in _grids:
            _grids.move_to_end(key)
            return _grids[key]
    grid = _read_grid(cache, key) if cache is not None else None
    if grid is None:
        distance = _core.SignedDistance(surface.vertices, surface.triangles)
        if not distance.open and distance.volume() < 0:
            volume = distance.volume()
            raise InvalidValue("first", f"a closed mesh of volume {volume:.3g} m^3", "wound to look outwards")
        nodes = distance.nodes(spacing, depth)
        if nodes > _MOST_NODES:
            allowed = f"so large that the grid has at most {_MOST_NODES:.0e} nodes, not {nodes:.2g}"
            raise InvalidValue("spacing", spacing, allowed)
        grid = _core.DistanceGrid(distance, spacing, depth)
        if cache is not None:
            with open(cache, "wb") as file:
                np.savez(file, key=np.array(repr(key)), numbers=grid.numbers())
    with _grids_lock:
        _grids[key] = grid
        while len(_grids) > _MOST_GRIDS:
            _grids.popitem(last=False)
    return grid


def _read_grid(cache: Path, key: tuple):
    """The grid that a file keeps; None where it keeps none of this surface."""
    try:
        with np.load(cache, allow_pickle=False) as file:
            if str(file["key"]) != repr(key):
                return None
            return _core.DistanceGrid.of_numbers(file["numbers"])
    except Exception:  # of numpy, zipfile and the file system: it is made anew
        return None


def foundation_of(modulus, poisson, thickness) -> float:
    """K [Pa/m] of a thin layer on a rigid base (Bei and Fregly 2004). Raises InvalidType or InvalidValue."""
    modulus = checks.number("modulus", modulus, above=0)
    poisson = checks.number("poisson", poisson, at_least=0)
    if poisson >= 0.5:
        raise InvalidValue("poisson", poisson, "a finite number >= 0 and < 0.5")
    return modulus * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson)) / thickness


def look(name: str, core, slot: int, second: Surface) -> None:
    """Give a CartilageWarning where the surfaces are far apart, or do not face each other."""
    gap = -core.cartilage_depths(slot).max()
    if gap > _FAR:
        warn(CartilageWarning(f"cartilage {name!r}: its surfaces are at least {gap:.3g} m apart"))
        return
    areas = np.linalg.norm(second.normals, axis=1)
    found = core.cartilage_facing(slot, second.normals / areas[:, None])
    if not found:
        return
    weights = areas[[triangle for triangle, _ in found]]
    cosine = float(np.average([cosine for _, cosine in found], weights=weights))
    if cosine > _FACING:
        share = weights.sum() / areas.sum()
        warn(
            CartilageWarning(
                f"cartilage {name!r}: its surfaces do not face each other: where they are near, on "
                f"{share:.0%} of the second one, the mean cosine of their normals is {cosine:.2f}, and "
                "should be near -1. "
                "One of them may be wound inwards"
            )
        )


__all__ = ["Cartilage", "Region"]
