"""Geometry of a centreline: frames along it that do not twist, and stations between its points.

Owns: nothing; skin.py is made of it. Goes with no room of the core.

Frames are held as unit tangents and normals (n, 3); the binormal is tangent x normal. Everything
works on whole arrays, stays finite whatever the points are, and turns with the points. A station
is a segment's index and a fraction of that segment.
"""

import numpy as np
from scipy import sparse

from . import checks
from .errors import InvalidValue

_TINY = 1e-10  # a unit vector's rounding errors stay below; what is shorter has no direction


def twist_free_frames(centreline, first_normal=None) -> np.ndarray:
    """Rotation-minimising frames (n, 3, 3) along points (n, 3) [m], n >= 2, in the points' frame.

    Columns: tangent, normal, binormal, right-handed. `first_normal` (3,) is projected on the first
    normal plane; without it, the coordinate axis that is farthest from the first tangent is taken.
    Double reflection: Wang, Juettler, Zheng, Liu, "Computation of rotation minimizing frames", ACM
    Trans. Graph. 27 (2008), table I. Each step is linear in the normal, so all steps are done at once
    on arbitrary normals and only their angles are summed up. A tangent is that of the circle through
    three neighbours; coincident points take their direction from the points before them; where the
    curve doubles back the frame turns about its own reflected normal.
    Raises InvalidValue for fewer than two points and a normal along the tangent.
    """
    points = checks.array("centreline", centreline, (None, 3))
    if len(points) < 2:
        raise InvalidValue("centreline", centreline, "at least two points")
    unit_chords, lengths = chords(points)
    along = tangents(unit_chords, lengths)
    if first_normal is None:
        first_normal = any_normals(along[:1])[0]
    normal = checks.vector("first_normal", first_normal)
    across = normal - (normal @ along[0]) * along[0]
    if not across @ across > (1e-8**2) * (normal @ normal):
        raise InvalidValue("first_normal", first_normal, "not along the first tangent")
    normals = transport(unit_chords, lengths, along, across)
    return np.stack([along, normals, cross(along, normals)], axis=-1)


def chords(points) -> tuple[np.ndarray, np.ndarray]:
    """Unit chords (n-1, 3) between points (n, 3), and their lengths (n-1,) in the points' unit.

    A chord of no length takes the direction of the one before it, the first ones of the one after;
    points that all coincide lie along x.
    """
    steps = points[1:] - points[:-1]
    lengths = np.sqrt(dot(steps, steps))
    short = lengths <= np.finfo(float).tiny
    if not short.any():
        return steps / lengths[:, None], lengths
    if short.all():
        return np.tile([1.0, 0.0, 0.0], (len(steps), 1)), lengths
    source = np.maximum.accumulate(np.where(short, 0, np.arange(len(steps))))
    source = np.maximum(source, np.argmin(short))
    return steps[source] / lengths[source, None], lengths


def tangents(unit_chords, lengths) -> np.ndarray:
    """Unit tangents (n, 3): inside, of the circle through a point and its two neighbours.

    By the sine rule that is h1 e0 + h0 e1 (chords e, lengths h). At a point where the curve doubles
    back exactly, the chord before it. At the ends, of the parabola: 2 e - the neighbour's tangent.
    """
    if len(unit_chords) == 1:
        return np.repeat(unit_chords, 2, axis=0)
    result = np.empty((len(unit_chords) + 1, 3))
    before, after = lengths[:-1, None], lengths[1:, None]
    total = np.maximum(before + after, np.finfo(float).tiny)
    inside = (after * unit_chords[:-1] + before * unit_chords[1:]) / total
    result[1:-1] = unit(inside, unit_chords[:-1])
    result[0] = 2 * unit_chords[0] - result[1]
    result[-1] = 2 * unit_chords[-1] - result[-2]
    result[[0, -1]] = unit(result[[0, -1]], unit_chords[[0, -1]])
    return result


def transport(unit_chords, lengths, along, first_normal) -> np.ndarray:
    """Rotation-minimising unit normals (n, 3) to the tangents `along` (n, 3), from the first one (3,)."""
    normals = any_normals(along)
    binormals = cross(along, normals)
    moved, mirrored = _double_reflection(unit_chords, lengths, along, normals)
    delta = np.arctan2(dot(moved, binormals[1:]), dot(moved, normals[1:]))
    # angle[i + 1] = sign[i] * angle[i] + delta[i], solved for all i at once
    sign = np.cumprod(np.where(np.append(False, mirrored), -1.0, 1.0))
    angle = np.append(np.arctan2(first_normal @ binormals[0], first_normal @ normals[0]), delta * sign[1:])
    angle = sign * np.cumsum(angle)
    return np.cos(angle)[:, None] * normals + np.sin(angle)[:, None] * binormals


def carry(old_tangent, old_normal, tangent) -> np.ndarray:
    """The unit normal (3,) turned with its tangent by the smallest rotation; kept where that is undefined."""
    cosine = old_tangent @ tangent
    if cosine < -1 + _TINY:
        return old_normal
    return old_normal - (old_normal @ tangent) / (1 + cosine) * (old_tangent + tangent)


def roll_between(old_bends, bends) -> complex:
    """e^(i angle) of the roll about the centreline that keeps its bends where they were in the material.

    Bends (n-2,): change of the unit chord at each inner point, normal + i binormal part. The angle is
    the least-squares one as far as only the bends' direction changed; the more their form did (a wave,
    a bow that goes over to the other side), the nearer to 1. Without bends, 1.
    """
    overlap = np.vdot(old_bends, bends)
    if not overlap.real > 0:
        return 1.0 + 0.0j
    change = np.vdot(bends, bends).real + np.vdot(old_bends, old_bends).real - 2 * abs(overlap)
    overlap += 10 * max(change, 0.0) + 1e-16  # far above the square of the chords' rounding errors
    return overlap / abs(overlap)


def any_normals(along) -> np.ndarray:
    """A unit normal (n, 3) to each unit tangent: the coordinate axis farthest from it, made orthogonal."""
    axis = np.abs(along).argmin(axis=1)
    rows = np.arange(len(along))
    normals = -along[rows, axis][:, None] * along
    normals[rows, axis] += 1
    return unit(normals)


def unit(vectors, fallback=(1.0, 0.0, 0.0)) -> np.ndarray:
    """Vectors (n, 3) made unit; those without a direction are replaced by the fallback (3,) or (n, 3)."""
    length = np.sqrt(dot(vectors, vectors))[:, None]
    if length.min() > _TINY:
        return vectors / length
    return np.where(length > _TINY, vectors / np.maximum(length, _TINY), fallback)


def dot(a, b) -> np.ndarray:
    """Row by row scalar product (n,) of two (n, 3)."""
    return np.einsum("ij,ij->i", a, b)


def cross(a, b) -> np.ndarray:
    """Row by row vector product (n, 3); a quarter of numpy.cross's time at these sizes."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def even_stations(points, layers) -> np.ndarray:
    """Where `layers` evenly spaced points lie: segment + fraction (layers,), by arc length."""
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    if not arc[-1] > 0:
        raise InvalidValue("tendon.positions", points, "of a length > 0 when a skin is made")
    return np.interp(np.linspace(0.0, arc[-1], layers), arc, np.arange(len(points), dtype=float))


def nearest_stations(points, vertices, block=1 << 20) -> tuple[np.ndarray, np.ndarray]:
    """Segment (V,) and fraction (V,) of the point of the polyline nearest to each vertex."""
    start, chord = points[:-1], np.diff(points, axis=0)
    square = np.maximum(dot(chord, chord), np.finfo(float).tiny)
    segment, fraction = np.empty(len(vertices), dtype=int), np.empty(len(vertices))
    step = max(1, block // len(start))  # bounds the memory
    for at in range(0, len(vertices), step):
        rows = slice(at, at + step)
        away = vertices[rows, None] - start
        part = np.clip(np.einsum("vsx,sx->vs", away, chord) / square, 0.0, 1.0)
        away -= part[..., None] * chord
        segment[rows] = nearest = np.einsum("vsx,vsx->vs", away, away).argmin(axis=1)
        fraction[rows] = np.take_along_axis(part, nearest[:, None], axis=1)[:, 0]
    return segment, fraction


def station_matrix(points, segment, fraction) -> sparse.csr_array:
    """(3 K, 2 n): from positions over particle normals to stations' centres, tangents, normals (not unit).

    Centres lie on the cubic Hermite curve through the particles whose velocities are the parabolas'
    of three neighbours, by the arc length of `points` (Catmull-Rom on uneven knots); normals linearly.
    """
    count = len(points)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = np.maximum(length, 0.01 * (length.mean() or 1.0))  # bounds the velocities
    velocity = _velocity_matrix(length)
    f, h = np.asarray(fraction, dtype=float), length[segment]
    at, to = (_picker(segment + shift, count) for shift in (0, 1))
    scale = sparse.diags_array
    centre = scale((1 + 2 * f) * (1 - f) ** 2) @ at + scale(f * f * (3 - 2 * f)) @ to
    centre += (scale(h * f * (1 - f) ** 2) @ at + scale(h * f * f * (f - 1)) @ to) @ velocity
    along = scale(6 * f * (1 - f) / h) @ (to - at)
    along += (scale((1 - f) * (1 - 3 * f)) @ at + scale(f * (3 * f - 2)) @ to) @ velocity
    across = scale(1 - f) @ at + scale(f) @ to
    return sparse.block_array([[centre, None], [along, None], [None, across]], format="csr")


def _double_reflection(unit_chords, lengths, along, normals) -> tuple[np.ndarray, np.ndarray]:
    """Each normal but the last moved to the next point (n-1, 3), and whether by one reflection only."""
    before, after = along[:-1], along[1:]
    chord = unit_chords
    coincident = lengths[:, None] <= np.finfo(float).tiny
    if coincident.any():  # an arc's chord lies midway between its tangents
        chord = np.where(coincident, unit(before + after, 0.0), chord)
    tangent = before - 2 * dot(chord, before)[:, None] * chord
    moved = normals[:-1] - 2 * dot(chord, normals[:-1])[:, None] * chord
    gap = after - tangent
    mirrored = dot(gap, gap) < _TINY  # the second plane is undefined: keep the once reflected normal
    gap = np.where(mirrored[:, None], 0.0, unit(gap))
    return moved - 2 * dot(gap, moved)[:, None] * gap, mirrored


def _velocity_matrix(length) -> sparse.csr_array:
    """(n, n): from positions to derivatives by arc length at the particles, segments' `length` (n-1,)."""
    count = len(length) + 1
    slope = (_picker(np.arange(1, count), count) - _picker(np.arange(count - 1), count)).multiply(
        1 / length[:, None]
    )
    if count == 2:
        return sparse.vstack([slope, slope], format="csr")
    share = length[1:] / (length[:-1] + length[1:])
    inside = sparse.diags_array(share) @ slope[:-1] + sparse.diags_array(1 - share) @ slope[1:]
    ends = [2 * slope[[0]] - inside[[0]], 2 * slope[[-1]] - inside[[-1]]]
    return sparse.vstack([ends[0], inside, ends[1]], format="csr")


def _picker(rows, count) -> sparse.csr_array:
    return sparse.csr_array((np.ones(len(rows)), rows, np.arange(len(rows) + 1)), shape=(len(rows), count))
