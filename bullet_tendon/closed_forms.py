"""Exact distances from a segment to a box, sphere, capsule or cylinder, in plain floats.

FCL's iterative answer for these is only good to about 1e-6 (cylinder: 4e-4 m at worst, measured with
python-fcl 0.7), never negative, and no faster than this. All quantities are in the shape's frame [m].

Every shape is a convex core grown by a radius. `gap(x, y, z)` is the vector from the nearest point of the
core to a point, zero inside; `inside(x, y, z)` is, for a point in the core, the distance to the core's
surface as a number <= 0, with the outward normal there; `breaks(a, d)` are the places on the line a + u d
where the nearest point passes from one part of the surface to another.
"""

from collections.abc import Callable
from math import copysign, hypot, sqrt
from typing import NamedTuple

GOLDEN = 0.6180339887498949  # (sqrt(5) - 1) / 2
PARALLEL = 1e-14  # cosine between a segment and the way to it from which on it is parallel to the surface


class Core(NamedTuple):
    """A convex core and the radius it is grown by [m]."""

    gap: Callable
    inside: Callable
    breaks: Callable
    radius: float


def rounded_box(hx: float, hy: float, hz: float, radius: float) -> Core:
    """Half extents and radius [m]. Box: radius 0; capsule along z: hx = hy = 0; sphere: all three 0."""

    def gap(x, y, z):
        return (
            x - hx if x > hx else x + hx if x < -hx else 0.0,
            y - hy if y > hy else y + hy if y < -hy else 0.0,
            z - hz if z > hz else z + hz if z < -hz else 0.0,
        )

    def inside(x, y, z):
        depth, axis = min((hx - abs(x), 0), (hy - abs(y), 1), (hz - abs(z), 2))
        normal = [0.0, 0.0, 0.0]
        normal[axis] = copysign(1.0, (x, y, z)[axis])
        return -depth, *normal

    def breaks(a, d):
        walls = zip((hx, hy, hz), a, d, strict=True)
        return [(side - p) / q for h, p, q in walls if q for side in (h, -h)]

    return Core(gap, inside, breaks, radius)


def cylinder(radius: float, half_length: float) -> Core:
    """A cylinder along z [m]; its edges are sharp, so nothing is grown."""

    def gap(x, y, z):
        rho = hypot(x, y)
        share = 1.0 - radius / rho if rho > radius else 0.0
        rest = z - half_length if z > half_length else z + half_length if z < -half_length else 0.0
        return x * share, y * share, rest

    def inside(x, y, z):
        rho = hypot(x, y)
        if half_length - abs(z) < radius - rho:
            return abs(z) - half_length, 0.0, 0.0, copysign(1.0, z)
        return (rho - radius, x / rho, y / rho, 0.0) if rho > 0.0 else (-radius, 1.0, 0.0, 0.0)

    def breaks(a, d):
        caps = [(side - a[2]) / d[2] for side in (half_length, -half_length)] if d[2] else []
        square = d[0] * d[0] + d[1] * d[1]
        if not square:
            return caps
        nearest = -(a[0] * d[0] + a[1] * d[1]) / square  # to the axis: the root itself, beside the mantle
        chord = (radius * radius - (a[0] + nearest * d[0]) ** 2 - (a[1] + nearest * d[1]) ** 2) / square
        reach = sqrt(max(chord, 0.0))
        return [*caps, nearest - reach, nearest, nearest + reach]

    return Core(gap, inside, breaks, 0.0)


def core_of(kind: str, sizes) -> tuple[Core, list]:
    """The core and the highest corner of the box around it, for a kind and sizes as in shapes.primitive."""
    radius, half = sizes[0], 0.5 * sizes[-1]
    if kind == "box":
        corner = [0.5 * size for size in sizes]
        return rounded_box(*corner, 0.0), corner
    if kind == "sphere":
        return rounded_box(0.0, 0.0, 0.0, radius), [radius] * 3
    if kind == "capsule":
        return rounded_box(0.0, 0.0, half, radius), [radius, radius, half + radius]
    return cylinder(radius, half), [radius, radius, half]


def measure(core: Core, a, d) -> tuple:
    """Signed distance [m], surface point (3 numbers) and u in [0, 1] of the segment a + u d's nearest point.

    Where the segment runs through the core, u is where it is deepest: the shortest way to push it out.
    """
    u = _nearest(core, a, d)
    gx, gy, gz = core.gap(a[0] + u * d[0], a[1] + u * d[1], a[2] + u * d[2])
    size = sqrt(gx * gx + gy * gy + gz * gz)
    if size > 1e-15 * sum(
        map(abs, (*a, *d))
    ):  # else it touches, as far as rounding can tell, or runs through
        nx, ny, nz = gx / size, gy / size, gz / size
    else:
        u = _deepest(core, a, d)
        size, nx, ny, nz = core.inside(a[0] + u * d[0], a[1] + u * d[1], a[2] + u * d[2])
    distance = size - core.radius
    x, y, z = a[0] + u * d[0], a[1] + u * d[1], a[2] + u * d[2]
    return distance, (x - distance * nx, y - distance * ny, z - distance * nz), u


def _nearest(core: Core, a, d) -> float:
    """The root of gap . d: half the slope of the squared distance, which never falls along a segment."""

    def slope(u):
        gx, gy, gz = gap(a[0] + u * d[0], a[1] + u * d[1], a[2] + u * d[2])
        value = gx * d[0] + gy * d[1] + gz * d[2]
        return 0.0 if abs(value) <= reach * (PARALLEL * (abs(gx) + abs(gy) + abs(gz)) + rounding) else value

    gap = core.gap
    reach = abs(d[0]) + abs(d[1]) + abs(d[2])
    rounding = 2e-16 * (abs(a[0]) + abs(a[1]) + abs(a[2]) + reach)
    low, high = slope(0.0), slope(1.0)
    if low >= 0.0 or high <= 0.0:  # flat at both ends: parallel to the surface, so the middle speaks for it
        return 0.5 if low == high == 0.0 and reach > 0.0 else 0.0 if low >= 0.0 else 1.0
    return _root(slope, low, high, sorted(core.breaks(a, d)))


def _root(slope, low, high, breaks) -> float:
    """The zero of a non-decreasing function on [0, 1] whose values at the ends are low < 0 < high.

    Breaks first, because between them a box's slope is linear and a cylinder's smooth; then regula falsi with
    the Illinois rule, which ends at once where the slope is linear.
    """
    left, right, kept = 0.0, 1.0, 0
    breaks = [u for u in breaks if 0.0 < u < 1.0]
    for step in range(60):
        u = breaks[step] if step < len(breaks) else (left * high - right * low) / (high - low)
        value = slope(u)
        if value == 0.0:
            break
        if value < 0.0:
            high, kept = (0.5 * high if kept < 0 else high), -1
            left, low = u, value
        else:
            low, kept = (0.5 * low if kept > 0 else low), 1
            right, high = u, value
            breaks = breaks[:step]  # the others are beyond
        if step < len(breaks):
            kept = 0
        if right - left < 1e-15:
            break
    return u


def _deepest(core: Core, a, d) -> float:
    """Golden section on the core's signed distance, which is convex along a line."""

    def signed(u):
        point = a[0] + u * d[0], a[1] + u * d[1], a[2] + u * d[2]
        size = hypot(*core.gap(*point))
        return size if size > 0.0 else core.inside(*point)[0]

    left, right = 0.0, 1.0
    u, v = 1.0 - GOLDEN, GOLDEN
    at_u, at_v = signed(u), signed(v)
    while right - left > 1e-9:
        if at_u <= at_v:
            right, v, at_v = v, u, at_u
            u = right - GOLDEN * (right - left)
            at_u = signed(u)
        else:
            left, u, at_u = u, v, at_v
            v = left + GOLDEN * (right - left)
            at_v = signed(v)
    return min((0.0, 1.0, 0.5 * (left + right)), key=signed)
