"""Mouths: where a bore meets the surface of its bone.

Owns: nothing; it looks at shapes once, when a bore or an obstacle is added. The core's room `geometry`
(tunnel_bore) keeps what is found: a plane for each mouth, whose edge with the bore's wall is an ellipse.
"""

from typing import NamedTuple

import numpy as np

from .shapes import Shape

REACH = 2.0  # radii from a mouth, along the axis, within which a bore that is open meets the surface
STEEPEST = 2.0  # rise of a mouth's plane per length across the axis: at 63 degrees from the axis
FLAT = 0.25  # radii by which the surface may leave the plane that is put through it at a mouth
RAYS = 16  # along the wall, around the axis
ASIDE = 1.05  # radii from the axis of these rays: a mesh can have the bore already
ROUNDING = 1e-6  # share of the radius at which a ray has met the surface
EXACT = 1e-5  # height in radii, and slope, that are rounding
MARCHES = 200  # steps of a ray to the surface, each as long as its distance from it


class Mouths(NamedTuple):
    """Where a bore's axis meets the planes of its mouths, centres (2, 3) [m], and their slopes (2, 3) [-].

    In the link's frame. A slope is across the axis: the rise of the plane along the axis, from start to end,
    per length across it.
    """

    centres: np.ndarray
    slopes: np.ndarray


def mouths_of(shapes: list[Shape], start, end, radius: float) -> Mouths:
    """The mouths of a bore from start to end (3,) in a link of these shapes; link's frame [m].

    A mouth lies in the surface of the bone where the bore's wall meets it within REACH radii of the end that
    was given, and a plane describes it. Otherwise it is across the axis, at that end.
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    given = np.array([start, end])
    length = np.linalg.norm(end - start)
    axis = (end - start) / length
    centres, slopes = given.copy(), np.zeros((2, 3))
    for k, outwards in enumerate((-axis, axis)):
        found = _plane(shapes, given[k], outwards, radius, 0.5 * length)
        if found is not None:
            height, rise = found
            centres[k] += height * outwards
            slopes[k] = rise if k else -rise
    return Mouths(centres, slopes)


def _plane(shapes: list[Shape], centre, outwards, radius: float, within: float):
    """Height over the centre, along `outwards`, and slope (3,) of the plane in which the wall ends; or None.

    within: how far from the mouth the wall surely goes on inwards [m].
    """
    one = np.cross(outwards, np.eye(3)[np.abs(outwards).argmin()])
    one /= np.linalg.norm(one)
    angles = 2.0 * np.pi * np.arange(RAYS) / RAYS
    around = np.outer(np.cos(angles), one) + np.outer(np.sin(angles), np.cross(outwards, one))
    farthest = (REACH + 2.0 * ASIDE * STEEPEST) * radius
    inwards = min(within, farthest)
    begin = centre + ASIDE * radius * around - inwards * outwards
    ways = _ways_out(shapes, begin, outwards, inwards + farthest, radius)
    if ways is None:
        return None
    heights = ways - inwards
    height = heights.mean()
    rise = 2.0 / (RAYS * ASIDE * radius) * heights @ around
    off = np.abs(heights - height - ASIDE * radius * around @ rise).max()
    if np.abs(heights).min() > REACH * radius or np.linalg.norm(rise) > STEEPEST or off > FLAT * radius:
        return None
    # What is where it was given or across the axis, but for rounding, is exactly so.
    height = height if abs(height) > EXACT * radius else 0.0
    return height, rise if np.linalg.norm(rise) > EXACT else np.zeros(3)


def _ways_out(shapes: list[Shape], begin, outwards, farthest: float, radius: float):
    """(k,) lengths of rays from points inside (k, 3) to the surface [m]; None where one is not inside, or
    does not come out within `farthest`.

    Each ray goes on by its depth in the shape that it is deepest in (sphere tracing, Hart 1996). Open meshes,
    as scans of a part of a bone are, have no inside: a ray that begins in no other shape goes on to the
    nearest of them.
    """
    places = [
        ((begin - shape.position) @ shape.rotation, outwards @ shape.rotation, shape) for shape in shapes
    ]
    inside = np.array([shape.contains(at) for at, _, shape in places], bool).reshape(-1, len(begin))
    beside = ~inside.any(0)
    is_open = [shape.interior is not None and not shape.interior.closed for shape in shapes]
    if beside.any() and not any(is_open):
        return None
    ways = np.zeros(len(begin))
    going = np.arange(len(begin))
    for _ in range(MARCHES):
        depth = np.where(beside[going], np.inf, -np.inf)
        for still, opened, (at, way, shape) in zip(inside, is_open, places, strict=True):
            rows = beside[going] if opened else still[going]
            x = at[going[rows]] + ways[going[rows], None] * way
            nearest = np.minimum if opened else np.maximum
            depth[rows] = nearest(depth[rows], shape.depth(x))
        ways[going] += np.maximum(depth, 0.0)
        going = going[(depth > ROUNDING * radius) & (ways[going] <= farthest)]
        if not len(going):
            break
    return None if len(going) or (ways > farthest).any() else ways
