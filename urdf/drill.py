"""Bores a round tunnel through a closed triangle mesh: a clean rim at both mouths and a tube between them."""

import numpy as np

from .fields import gradient

SIDES = 24  # of the polygon that stands for the circle
EVEN = 2 * np.pi * np.arange(SIDES) / SIDES  # [rad]
MARGIN = 1.2  # triangles nearer than this to the bore are replaced [mm]
CHAMFER = 0.5  # broken edge of the rims [mm]
REACH = 9.0  # how far along the axis a mouth may spread [mm]


def drill(vertices, triangles, normals, field, start, end, radius: float):
    """The mesh with a bore from `start` to `end` (3,) [mm], both on the surface, of `radius` [mm].

    vertices (V, 3) [mm] and normals (V, 3), triangles (F, 3); field(points) is the bone's signed field.
    """
    axis = (end - start) / np.linalg.norm(end - start)
    rings = []
    for mouth, inward in ((start, axis), (end, -axis)):
        triangles, loop = open_hole(vertices, triangles, mouth, axis, radius + MARGIN)
        angles, spokes = compass(vertices[loop] - mouth, axis)
        outer = on_surface(mouth + (radius + CHAMFER) * spokes, axis, field)
        inner = on_surface(mouth + radius * spokes, axis, field) + CHAMFER * inward
        ring = len(vertices) + np.arange(SIDES)
        vertices = np.concatenate([vertices, outer, inner])
        normals = np.concatenate([normals, gradient(field, outer), -spokes])
        rim = [bridge(loop, ring, angles, EVEN), bridge(ring, ring + SIDES, EVEN, EVEN)]
        triangles = np.concatenate([triangles, *rim])
        rings.append(ring + SIDES)
    last = np.roll(rings[1][::-1], 1)  # the two mouths are walked round in opposite senses
    triangles = np.concatenate([triangles, bridge(rings[0], last, EVEN, EVEN)])
    kept, renumbered = np.unique(triangles, return_inverse=True)
    return vertices[kept], renumbered.reshape(-1, 3), normals[kept]


def compass(loop, axis):
    """Angles (L,) [rad] of a closed walk about the axis, rising along it; unit spokes (SIDES, 3) alike."""
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(axis, first)])
    angles = np.arctan2(loop @ across[1], loop @ across[0])
    turn = np.sign(np.angle(np.exp(1j * np.diff(angles))).sum())
    spokes = np.cos(EVEN)[:, None] * across[0] + turn * np.sin(EVEN)[:, None] * across[1]
    return turn * angles, spokes


def open_hole(vertices, triangles, mouth, axis, radius: float):
    """Takes out the triangles around a mouth: those left (F, 3) and the hole's border, a closed walk (L,)."""
    offset = vertices - mouth
    along = offset @ axis
    near = (np.linalg.norm(offset - along[:, None] * axis, axis=1) < radius) & (np.abs(along) < REACH)
    gone = near[triangles].any(axis=1)
    edges = np.concatenate([triangles[gone][:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    known = {(int(a), int(b)) for a, b in edges}
    follow = {b: a for a, b in known if (b, a) not in known}  # as the triangles left walk along the border
    walk = [min(follow)]
    while (following := follow[walk[-1]]) != walk[0]:
        walk.append(following)
    if len(walk) != len(follow):
        raise ValueError(f"the hole at {mouth} has more than one border: change MARGIN")
    return triangles[~gone], np.array(walk)


def on_surface(points, axis, field):
    """Points (N, 3) moved along the axis to the nearest zero of the field, within REACH [mm]."""
    reach = np.linspace(-REACH, REACH, 361)
    values = field(points[:, None] + reach[:, None] * axis)
    crossing = (values[:, 1:] < 0) != (values[:, :-1] < 0)
    if not crossing.any(axis=1).all():
        raise ValueError("the bore's rim leaves the bone: move the tunnel's end")
    index = np.where(crossing, np.abs(reach[1:] + reach[:-1]), np.inf).argmin(axis=1)
    rows = np.arange(len(points))
    before, after = values[rows, index], values[rows, index + 1]
    share = before / (before - after)
    return points + (reach[index] + share * (reach[1] - reach[0]))[:, None] * axis


def bridge(outer, inner, outer_angles, inner_angles):
    """Triangles (L + N, 3) between two closed walks, both in the sense of rising angle [rad].

    The triangles lie on the other side of `outer` from those that walk along it in that sense.
    """
    outer_angles = np.unwrap(np.asarray(outer_angles))
    begin = int(np.argmin(np.abs(np.angle(np.exp(1j * (np.asarray(inner_angles) - outer_angles[0]))))))
    inner, inner_angles = np.roll(inner, -begin), np.unwrap(np.roll(inner_angles, -begin))
    inner_angles = inner_angles + 2 * np.pi * np.round((outer_angles[0] - inner_angles[0]) / (2 * np.pi))
    i, j, triangles = 0, 0, []
    while i < len(outer) or j < len(inner):
        here, there = outer[i % len(outer)], inner[j % len(inner)]
        next_outer = outer_angles[(i + 1) % len(outer)] + 2 * np.pi * ((i + 1) // len(outer))
        next_inner = inner_angles[(j + 1) % len(inner)] + 2 * np.pi * ((j + 1) // len(inner))
        if j == len(inner) or (i < len(outer) and next_outer <= next_inner):
            i += 1
            triangles.append((outer[i % len(outer)], here, there))
        else:
            j += 1
            triangles.append((there, inner[j % len(inner)], here))
    return np.array(triangles)
