"""Naive surface nets: the zero level of a sampled field as a closed triangle mesh.

After S. F. F. Gibson, "Constrained elastic surface nets" (MICCAI 1998): one vertex for every lattice cell
that the surface crosses, one quadrilateral for every lattice edge that it crosses.
"""

import itertools

import numpy as np

CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
PAIRS = itertools.combinations(range(8), 2)
CELL_EDGES = [(a, b) for a, b in PAIRS if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]


def surface_nets(lattice, values):
    """Vertices (V, 3) and triangles (F, 3), normals towards positive values.

    lattice: positions (I, J, K, 3) of the samples, right-handed and any smooth deformation of a grid;
    values: the field (I, J, K) there, positive on the whole border, so that the mesh is closed.
    """
    vertices, index = cell_vertices(lattice, values)
    quads = np.concatenate([crossing_quads(values, index, axis) for axis in range(3)])
    return vertices, split(quads, vertices)


def cell_vertices(lattice, values):
    """The mean of each crossed cell's edge crossings (V, 3), and which vertex a cell has (-1: none)."""
    shape = np.array(values.shape) - 1
    views = [tuple(slice(o, o + n) for o, n in zip(corner, shape, strict=True)) for corner in CORNERS]
    total, count = np.zeros((*shape, 3)), np.zeros(shape)
    for a, b in CELL_EDGES:
        va, vb = values[views[a]], values[views[b]]
        crossed = (va < 0) != (vb < 0)
        share = np.where(crossed, va / np.where(crossed, va - vb, 1.0), 0.0)[..., None]
        crossing = (1 - share) * lattice[views[a]] + share * lattice[views[b]]
        total += np.where(crossed[..., None], crossing, 0.0)
        count += crossed
    used = count > 0
    index = np.full(shape, -1)
    index[used] = np.arange(used.sum())
    return total[used] / count[used][:, None], index


def crossing_quads(values, index, axis: int):
    """For each lattice edge along `axis` that the surface crosses, the four cells around it (Q, 4)."""
    values, index = np.moveaxis(values, axis, 0), np.moveaxis(index, axis, 0)
    inside = values < 0
    crossed = inside[:-1, 1:-1, 1:-1] != inside[1:, 1:-1, 1:-1]
    i, j, k = np.nonzero(crossed)
    ring = [index[i, j, k], index[i, j + 1, k], index[i, j + 1, k + 1], index[i, j, k + 1]]
    quads = np.stack(ring, axis=1)
    # moveaxis of axis 1 is an odd permutation of the axes: the ring then turns the other way
    outward = inside[i, j + 1, k + 1] != (axis == 1)
    return np.where(outward[:, None], quads, quads[:, ::-1])


def split(quads, vertices):
    """Two triangles for each quadrilateral, along its shorter diagonal."""
    a, b, c, d = quads.T
    ac, bd = (np.linalg.norm(vertices[p] - vertices[q], axis=1) for p, q in ((a, c), (b, d)))
    first = ac <= bd
    one = np.where(first[:, None], np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    two = np.where(first[:, None], np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return np.concatenate([one, two])
