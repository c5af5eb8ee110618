"""What is inside a triangle surface, whichever way its triangles were wound.

Owns: the closed surfaces of one mesh. Used by shapes.py and penetration.py; goes with no room of the core.

The surface is cut into pieces that hang together by edges of two triangles. A piece that closes has an
inside: its triangles are turned to agree, outwards. A closed piece wholly within another is a cavity, one
within a cavity is solid again. Open pieces have no inside. Then the generalised winding number
(Jacobson, Kavan and Sorkine-Hornung 2013), a sum of solid angles, tells inside from outside.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

WELD = 1e-6  # vertices this near, as a share of the surface's size, are one
HOLES = 0.01  # squared length of all edges of holes, as a share of the area, up to which a piece is closed
_PROBES = 32  # vertices that must all be within another piece, to be wholly within it
_CHUNK = 200_000  # solid angles at a time


class Interior:
    """The inside of a surface of vertices (v, 3) [m] and triangles (t, 3) of vertex indices.

    closed: whether any piece of the surface has an inside.
    vertices, triangles (c, 3): of the pieces that do; wound outwards round what is solid.
    """

    def __init__(self, vertices, triangles):
        vertices = np.asarray(vertices, float)
        triangles = _welded(vertices, np.asarray(triangles, int))
        pieces = _closed_pieces(vertices, triangles) if len(triangles) else []
        self.vertices, self.triangles = vertices, _outwards(vertices, pieces)
        self._corners = vertices[self.triangles]

    @property
    def closed(self) -> bool:
        return len(self._corners) > 0

    def contains(self, points) -> np.ndarray:
        """(k,) whether points (k, 3) are inside."""
        return winding_number(points, self._corners) > 0.5


def winding_number(points, corners) -> np.ndarray:
    """(k,) how often a surface of triangles (t, 3, 3) winds round points (k, 3); 1 within, 0 outside.

    The solid angle of a triangle a, b, c seen from the origin (van Oosterom and Strackee 1983):
    tan(W / 2) = a . (b x c) / (|a||b||c| + (a . b)|c| + (b . c)|a| + (c . a)|b|).
    """
    points = np.asarray(points, float).reshape(-1, 3)
    turns = np.zeros(len(points))
    rows = max(1, _CHUNK // max(1, len(corners)))
    for first in range(0, len(points), rows):
        a, b, c = np.moveaxis(corners[None] - points[first : first + rows, None, None], 2, 0)
        la, lb, lc = (np.sqrt(_dot(x, x)) for x in (a, b, c))
        below = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
        half = np.arctan2(_dot(a, np.cross(b, c)), below)
        turns[first : first + rows] = half.sum(1) / (2.0 * np.pi)
    return turns


def _dot(a, b) -> np.ndarray:
    return np.einsum("...i,...i", a, b)


def _welded(vertices, triangles) -> np.ndarray:
    """Triangles of three different vertices, each once, after vertices that coincide were made one."""
    used = np.unique(triangles)
    size = np.ptp(vertices[used], axis=0).max()
    pairs = cKDTree(vertices[used]).query_pairs(WELD * size, output_type="ndarray").reshape(-1, 2)
    group = _connected(len(used), pairs)
    first = np.unique(group, return_index=True)[1]  # one vertex stands for its group
    stands_for = np.zeros(len(vertices), int)
    stands_for[used] = used[first[group]]
    triangles = stands_for[triangles]
    corners = np.sort(triangles, axis=1)
    whole = (corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2])
    kept = np.unique(corners[whole], axis=0, return_index=True)[1]
    return triangles[whole][np.sort(kept)]


def _connected(count: int, pairs) -> np.ndarray:
    """(count,) number of the connected group of each of `count` nodes joined by pairs (e, 2)."""
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def _closed_pieces(vertices, triangles) -> list[np.ndarray]:
    """Triangles of each closed piece, wound to agree with each other."""
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    owner = np.repeat(np.arange(len(triangles)), 3)
    forward = ends[:, 0] < ends[:, 1]
    key = ends.min(1) * np.int64(len(vertices)) + ends.max(1)  # quicker than rows are sorted
    _, edge, count = np.unique(key, return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    pairs = order[count[edge[order]] == 2].reshape(-1, 2)
    piece = _connected(len(triangles), owner[pairs])
    turned, orientable = _turned(piece, owner[pairs], forward[pairs[:, 0]] == forward[pairs[:, 1]])
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    closed = orientable & _closes(vertices, triangles, piece, edge, ends)
    return [triangles[piece == k] for k in np.flatnonzero(closed)]


def _turned(piece, joined, same_way) -> tuple[np.ndarray, np.ndarray]:
    """Which triangles to turn over (t,), and which pieces can be made to agree at all (pieces,).

    Each triangle stands for two nodes, as it is and turned over; an edge joins the nodes that agree along
    it. A piece that can agree falls into two groups of nodes, one the other turned over.
    """
    count = len(piece)
    other = joined[:, 1] + count * same_way, joined[:, 1] + count * ~same_way
    pairs = np.vstack(
        [np.stack([joined[:, 0], other[0]], -1), np.stack([joined[:, 0] + count, other[1]], -1)]
    )
    group = _connected(2 * count, pairs)
    first = np.unique(piece, return_index=True)[1]
    return group[:count] != group[first[piece]], group[first] != group[first + count]


def _closes(vertices, triangles, piece, edge, ends) -> np.ndarray:
    """(pieces,) whether the edges that have an odd number of a piece's triangles are short together."""
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    area = np.bincount(piece, 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    key = np.repeat(piece, 3) * (edge.max() + 1) + edge
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    odd = first[count % 2 == 1]
    length = np.linalg.norm(vertices[ends[odd, 0]] - vertices[ends[odd, 1]], axis=1)
    rim = np.bincount(piece[odd // 3], length, minlength=len(area))
    return rim**2 <= HOLES * area


def _outwards(vertices, pieces: list[np.ndarray]) -> np.ndarray:
    """(t, 3) the triangles of all pieces, wound outwards round what is solid and inwards round cavities."""
    turned = [np.zeros((0, 3), int)]
    corners = [vertices[piece] for piece in pieces]
    for k, piece in enumerate(pieces):
        outer = sum(_within(corners[k], other) for j, other in enumerate(corners) if j != k)
        inwards = np.einsum("ij,ij", *_about(corners[k])) < 0.0
        turned.append(piece[:, ::-1] if inwards != bool(outer % 2) else piece)
    return np.concatenate(turned)


def _about(corners) -> tuple[np.ndarray, np.ndarray]:
    """a and b x c of triangles, from their own middle: the sum of a . (b x c) is six times the volume."""
    a, b, c = np.moveaxis(corners - corners.mean((0, 1)), 1, 0)
    return a, np.cross(b, c)


def _within(corners, other) -> bool:
    """Whether a closed piece is wholly within another that winds either way."""
    low, high = other.min((0, 1)), other.max((0, 1))
    if (corners.min((0, 1)) < low).any() or (corners.max((0, 1)) > high).any():
        return False
    step = -(-len(corners) // _PROBES)
    return bool((np.abs(winding_number(corners[::step, 0], other)) > 0.5).all())
