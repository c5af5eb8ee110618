"""The surface mesh that a tendon's centreline carries: for eyes and pictures, without physics.

Owns: the vertices' places about the centreline, and the last evaluated pose. Goes with no room of the core.

As in the paper (section 4.3), every edge point's vector from the centre of its layer is stored
once; afterwards the particles' positions give each layer's translation and rotation. Layers need
not sit at particles: a layer is a *station*, a segment and a fraction of it, on the cubic through
the particles. Nothing is computed before somebody asks, and never twice for the same positions;
what is handed out are copies.

A centreline does not tell how far a tendon has turned about itself. The twist along it is taken to
be zero (a rotation-minimising frame); the one angle that is left is carried over from the pose that
was evaluated last, see `Skin`.
"""

import numpy as np
from scipy import sparse

from . import centreline, checks
from .centreline import cross, dot, twist_free_frames, unit
from .errors import InvalidType, InvalidValue

__all__ = ["Skin", "twist_free_frames"]


class Skin:
    """A triangle mesh that follows a tendon, for eyes and pictures; made by Skin.tube or Skin.bind.

    The tendon is any object with positions (n, 3) [m] and radius [m]. All results are in the frame of the
    positions (world).

    The roll about the centreline: from the last evaluated pose to this one the first normal is
    parallel-transported onto the new first tangent; then, if the centreline is bent and its bends kept their
    form, the frames roll by the angle (< 90 degrees) that keeps the bends' direction in the material. So a
    rigid motion of a bent centreline carries the mesh rigidly. A rotation about a straight centreline is
    invisible, and a bend that goes over to the other side is no roll.

    Example:
        >>> skin = bt.Skin.tube(tendon, ring=12)
        >>> skin.vertices.shape, skin.normals.shape, skin.triangles.shape
        ((134, 3), (134, 3), (264, 3))
    """

    def __init__(self, tendon, segment, fraction, station, offsets, triangles):
        """Stations (K,) by segment and fraction; vertices (V,) at `station`; local `offsets` (V, 3)."""
        self.tendon = tendon
        self._positions = _positions(tendon)
        self._fit = centreline.station_matrix(self._positions, segment, fraction)
        self._blend = self._fit[2 * len(segment) :, len(self._positions) :]
        self._first: tuple | None = None  # tangent and normal at the first particle, last pose
        self._bends: np.ndarray | None = None
        self._frames = self._evaluate(self._positions)
        self._spread = _spread_matrix(len(segment), station, offsets)
        self._station = station
        self._triangles = triangles.astype(np.int32)
        self._vertices: np.ndarray | None = None
        self._normals: np.ndarray | None = None
        self._gather: sparse.csr_array | None = None  # made with the first normals

    @classmethod
    def tube(cls, tendon, ring: int = 12, layers: int | None = None, radius=None) -> "Skin":
        """A closed tube: ring * layers + 2 vertices, 2 * ring * layers triangles, facing outwards.

        Layers lie evenly along the centreline's present arc length, the end layers exactly at its ends.
        Vertices: layer by layer, then the centre of the first and of the last layer.

        Args:
            tendon: with positions and radius.
            ring: vertices around it, >= 3.
            layers: along it, >= 2; None: one at each particle.
            radius: [m], a number or one per layer; None: the tendon's.

        Raises:
            InvalidType, InvalidValue: naming the argument.

        Example:
            >>> len(bt.Skin.tube(tendon, ring=6, layers=4).vertices)
            26
        """
        ring = checks.integer("ring", ring, at_least=3)
        points = _positions(tendon)
        if layers is None:
            layers, along = len(points), np.arange(len(points), dtype=float)
        else:
            layers = checks.integer("layers", layers, at_least=2)
            along = centreline.even_stations(points, layers)
        radii = _radii(tendon.radius if radius is None else radius, layers)
        segment = np.minimum(along.astype(int), len(points) - 2)
        angle = np.arange(ring) * (2 * np.pi / ring)
        circle = np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)
        offsets = np.vstack([(radii[:, None, None] * circle).reshape(-1, 3), np.zeros((2, 3))])
        station = np.append(np.repeat(np.arange(layers), ring), [0, layers - 1])
        return cls(tendon, segment, along - segment, station, offsets, _tube_triangles(ring, layers))

    @classmethod
    def bind(cls, tendon, vertices, triangles) -> "Skin":
        """A mesh of the user's around the tendon as it lies now.

        Each vertex follows its nearest point on the centreline. Triangles keep their order: the normals point
        outwards if the triangles are counter-clockwise seen from outside.

        Args:
            tendon: with positions and radius.
            vertices: (V, 3) [m], world frame.
            triangles: (T, 3) vertex indices.

        Raises:
            InvalidType, InvalidValue: naming the argument.

        Example:
            >>> flap = bt.Skin.bind(tendon, [(0.01, 0, 0), (0.01, 0, -0.1), (0, 0, -0.05)], [(0, 1, 2)])
            >>> tendon.set_positions(tendon.positions + (0, 0.02, 0))
            >>> flap.vertices.round(3).tolist()
            [[0.01, 0.02, 0.0], [0.01, 0.02, -0.1], [0.0, 0.02, -0.05]]
        """
        vertices = checks.array("vertices", vertices, (None, 3))
        triangles = _checked_triangles(triangles, len(vertices))
        segment, fraction = centreline.nearest_stations(_positions(tendon), vertices)
        station = np.arange(len(vertices))
        skin = cls(tendon, segment, fraction, station, np.zeros_like(vertices), triangles)
        centres, *axes = np.split(skin._frames, 4)
        local = np.stack([dot(vertices - centres, axis) for axis in axes], axis=1)
        skin._spread = _spread_matrix(len(vertices), station, local)
        return skin

    @property
    def triangles(self) -> np.ndarray:
        """Vertex indices (T, 3) int32."""
        return self._triangles.copy()

    @property
    def centres(self) -> np.ndarray:
        """Layer centres of a tube (layers, 3), of a bound mesh each vertex's point (V, 3) [m], world."""
        self._update()
        return self._frames[: len(self._frames) // 4].copy()

    @property
    def vertices(self) -> np.ndarray:
        """Vertices (V, 3) [m], world frame."""
        return self._placed().copy()

    @property
    def normals(self) -> np.ndarray:
        """Unit normals (V, 3), world frame: the area-weighted mean of the faces around."""
        vertices = self._placed()
        if self._normals is None:
            self._normals = self._vertex_normals(vertices)
        return self._normals.copy()

    def _placed(self) -> np.ndarray:
        self._update()
        if self._vertices is None:
            self._vertices = self._spread @ self._frames
        return self._vertices

    def _update(self):
        positions = _positions(self.tendon)
        if positions.shape != self._positions.shape:
            raise InvalidValue("tendon.positions", positions, f"of shape {self._positions.shape}, as bound")
        if not np.array_equal(positions, self._positions):
            self._frames = self._evaluate(positions)
            self._positions, self._vertices, self._normals = positions, None, None

    def _evaluate(self, positions) -> np.ndarray:
        """Stations' centres, tangents, normals and binormals, one below the other (4 K, 3)."""
        chords, lengths = centreline.chords(positions)
        tangents = centreline.tangents(chords, lengths)
        normals = self._roll(chords, lengths, tangents)
        centres, along, across = np.split(self._fit @ np.vstack([positions, normals]), 3)
        tangent = unit(along, self._blend @ tangents)
        normal = unit(across - dot(across, tangent)[:, None] * tangent)
        return np.vstack([centres, tangent, normal, cross(tangent, normal)])

    def _roll(self, chords, lengths, tangents) -> np.ndarray:
        """Twist-free normals (n, 3) carried on from the last evaluated pose; remembers this one."""
        if self._first is None:
            first = centreline.any_normals(tangents[:1])[0]
        else:
            first = centreline.carry(self._first[0], self._first[1], tangents[0])
        normals = centreline.transport(chords, lengths, tangents, first)
        binormals = cross(tangents, normals)
        turns = np.diff(chords, axis=0)
        bends = dot(turns, normals[1:-1]) + 1j * dot(turns, binormals[1:-1])
        if self._bends is not None:
            roll = centreline.roll_between(self._bends, bends)
            normals = roll.real * normals + roll.imag * binormals
            bends = bends * roll.conjugate()
        self._first, self._bends = (tangents[0], normals[0]), bends
        return normals

    def _vertex_normals(self, vertices) -> np.ndarray:
        if self._gather is None:
            self._gather = _incidence(len(vertices), self._triangles)
        a, b, c = (vertices.take(corner, axis=0).T for corner in self._triangles.T)
        ux, uy, uz = b - a
        vx, vy, vz = c - a
        faces = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)
        sums = self._gather @ faces
        size = max(np.abs(sums).max(), np.finfo(float).tiny)  # areas: as small as the mesh is
        return unit(sums / size, unit(vertices - self.centres[self._station]))


def _positions(tendon) -> np.ndarray:
    if not hasattr(tendon, "positions"):
        raise InvalidType("tendon", tendon, "a Tendon, or what has positions (n, 3) as well")
    positions = checks.array("tendon.positions", tendon.positions, (None, 3))
    if len(positions) < 2:
        raise InvalidValue("tendon.positions", positions, "at least two points")
    return positions


def _radii(radius, layers) -> np.ndarray:
    if checks.as_array(radius).ndim == 0:
        return np.full(layers, checks.number("radius", radius, above=0.0))
    radii = checks.array("radius", radius, (layers,))
    if not (radii > 0).all():
        raise InvalidValue("radius", radius, "> 0 at every layer")
    return radii


def _checked_triangles(triangles, count) -> np.ndarray:
    result = checks.as_array(triangles)
    if result.dtype.kind not in "iu":
        raise InvalidType("triangles", triangles, "integers of shape (m, 3)")
    if result.ndim != 2 or result.shape[1] != 3 or not len(result):
        raise InvalidValue("triangles", triangles, "of shape (m, 3)")
    if result.min() < 0 or result.max() >= count:
        raise InvalidValue("triangles", triangles, f"indices from 0 to {count - 1}")
    return result


def _spread_matrix(stations, station, offsets) -> sparse.csr_array:
    """(V, 4 K): vertex = centre + tangent, normal and binormal times its offsets (V, 3)."""
    columns = station[:, None] + stations * np.arange(4)
    values = np.hstack([np.ones((len(station), 1)), offsets])
    starts = np.arange(len(station) + 1) * 4
    matrix = sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=(len(station), 4 * stations))
    matrix.eliminate_zeros()
    return matrix


def _incidence(count, triangles) -> sparse.csr_array:
    """(V, T): 1 where the triangle has the vertex."""
    columns = np.repeat(np.arange(len(triangles)), 3)
    return sparse.csr_array(
        (np.ones(columns.size), (triangles.ravel(), columns)), shape=(count, len(triangles))
    )


def _tube_triangles(ring, layers) -> np.ndarray:
    """Triangles (2 * ring * layers, 3), counter-clockwise seen from outside, caps last."""
    edge = np.arange(ring)
    after = (edge + 1) % ring
    row = ring * np.arange(layers - 1)[:, None]
    a, b, c, d = row + edge, row + after, row + ring + edge, row + ring + after
    sides = np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)
    first = np.stack([np.full(ring, ring * layers), after, edge], axis=1)
    last = np.stack([np.full(ring, ring * layers + 1), edge, after], axis=1)
    return np.vstack([sides, first, last + [0, ring * (layers - 1), ring * (layers - 1)]])
