"""Which knot a polyline is tied in, measured from its projection, apart from the solver."""

import functools

import numpy as np

from . import measure

# A direction that no scene is built along: projected along it, polylines cross at inner points only.
_DIRECTION = np.array([0.2113, -0.3371, 0.9175])


def determinant(curve, direction=_DIRECTION) -> int:
    """|Alexander polynomial at t = -1| of the closed polyline (n, 3), the last point joined to the first.

    1 for the unknot, 3 for the trefoil (a closed overhand knot), 9 for a sum of two (reef and granny). It
    does not change unless the curve passes through itself, and does not depend on `direction` (3,), along
    which it is projected. From the colouring matrix: a row 2, -1, -1 for each crossing, on the arc that
    passes over and on those that end and begin below it; any first minor (Fox; Crowell and Fox 1963).
    """
    over, under = crossings(curve, direction)
    count = len(under)
    if count < 3:
        return 1
    below = np.sort(under)
    ending = np.searchsorted(below, under)  # the arc that ends at each crossing
    above = np.searchsorted(below, over) % count
    rows = np.zeros((count, count))
    each = np.arange(count)
    for column, weight in ((above, 2), (ending, -1), ((ending + 1) % count, -1)):
        np.add.at(rows, (each, column), weight)
    return round(abs(np.linalg.det(rows[1:, 1:])))


def crossings(curve, direction=_DIRECTION) -> tuple[np.ndarray, np.ndarray]:
    """Where the closed polyline (n, 3) passes over and under itself, seen along `direction` (3,).

    Two arrays (c,): parameters of the upper and of the lower point of each crossing, segments counting 1.
    """
    turned = np.asarray(curve, dtype=float) @ _axes(*map(float, direction))
    flat, height = turned[:, :2], turned[:, 2]
    along = np.roll(flat, -1, axis=0) - flat
    climb = np.roll(height, -1) - height
    i, j = _pairs(len(flat))
    area = _cross(along[i], along[j])
    safe = np.where(area != 0, area, np.inf)
    gap = flat[j] - flat[i]
    u, w = _cross(gap, along[j]) / safe, _cross(gap, along[i]) / safe
    adjacent = (i == 0) & (j == len(flat) - 1)
    met = (area != 0) & (u >= 0) & (u < 1) & (w >= 0) & (w < 1) & ~adjacent
    i, j, u, w = i[met], j[met], u[met], w[met]
    first_above = height[i] + u * climb[i] > height[j] + w * climb[j]
    return np.where(first_above, i + u, j + w), np.where(first_above, j + w, i + u)


def closed_far(*lines) -> np.ndarray:
    """Polylines (n, 3), end to beginning and the last end to the first beginning, joined far away.

    Ends go straight out, away from the common centroid, to a sphere a hundred times as large, and are
    joined over it. Meaningful while nothing is beyond the ends.
    """
    every = np.vstack(lines)
    middle = every.mean(axis=0)
    far = 100 * np.linalg.norm(every - middle, axis=1).max()
    parts = []
    for line, following in zip(lines, (*lines[1:], lines[0]), strict=True):
        parts += [
            line,
            middle + far * _arc(measure.unit(line[-1] - middle), measure.unit(following[0] - middle)),
        ]
    return np.vstack(parts)


def _arc(start, end) -> np.ndarray:
    """Points on the unit sphere from one unit vector to another, opposite ones included."""
    aside = measure.unit(np.cross(start, np.eye(3)[np.argmin(np.abs(start))]))
    over = measure.unit(start + end + 1e-3 * aside)
    return np.array([start, measure.unit(start + over), over, measure.unit(over + end), end])


@functools.lru_cache(maxsize=4)
def _pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Segments of a closed polyline that are not neighbours."""
    return np.triu_indices(count, 2)


@functools.lru_cache(maxsize=4)
def _axes(*direction: float) -> np.ndarray:
    """(3, 3) whose columns are two axes across `direction` and itself."""
    third = measure.unit(np.array(direction))
    first = measure.unit(np.cross(third, np.eye(3)[np.argmin(np.abs(third))]))
    return np.column_stack([first, np.cross(third, first), third])


def _cross(a, b) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
