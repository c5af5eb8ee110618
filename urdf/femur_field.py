"""Distal right femur as a signed field [mm]: x anterior, y superior, z lateral, origin mid-epicondylar."""

import numpy as np

from .fields import cut, ellipsoid, loft, rounded_bar, union, without

# y, centre x, centre z, half-width AP, half-width ML: metaphysis and shaft. The shaft leans 6 degrees
# laterally (anatomical against mechanical axis) and its posterior cortex lies about 25 mm in front of the
# posterior condyles (posterior condylar offset).
SHAFT = [
    (-6.0, 8.0, 0.0, 14.5, 29.0),
    (12.0, 9.5, 0.0, 18.0, 34.5),
    (24.0, 11.8, 0.5, 17.3, 33.0),
    (40.0, 14.0, 1.5, 16.5, 25.5),
    (60.0, 14.5, 3.5, 15.0, 19.0),
    (85.0, 14.5, 6.0, 14.5, 15.5),
    (120.0, 13.0, 9.5, 14.5, 14.0),
]
TOP = 112.0  # where the shaft is sawn off


def femur(points):
    """Field (...) of the undrilled bone at points (..., 3) [mm]."""
    bone = union(articular_body(points), metaphysis(points), 9.0)
    for centre, semi_axes in (
        ((-3.0, 4.5, -34.0), (11.0, 12.0, 6.8)),  # medial epicondyle
        ((-3.0, 4.0, 33.5), (11.0, 11.0, 6.4)),  # lateral epicondyle
        ((-1.0, 19.0, -31.0), (6.0, 8.0, 5.0)),  # adductor tubercle
    ):
        bone = union(bone, ellipsoid(points, centre, semi_axes), 9.0)
    bone = without(bone, notch(points), 5.0)
    return cut(bone, points[..., 1] - TOP, 10.0)


def articular_body(points):
    """Both condyles and the trochlea in one piece, as if the notch were filled."""
    x, z = points[..., 0], points[..., 2]
    lateral_share = np.clip(0.5 + z / 30.0, 0.0, 1.0)
    lateral_share = lateral_share**2 * (3.0 - 2.0 * lateral_share)
    side = sagittal_profile(points, lateral=True) * lateral_share
    side = side + sagittal_profile(points, lateral=False) * (1.0 - lateral_share)
    groove = 7.5 * np.exp(-(((z - 2.0) / 9.5) ** 2))  # trochlear groove, a little lateral of the middle
    lateral_wall = z - (36.0 - 0.0035 * (x + 5.0) ** 2)
    medial_wall = -z - (37.0 - 0.0095 * (x + 5.0) ** 2)  # runs obliquely: the medial condyle diverges
    return cut(cut(side + groove, lateral_wall, 14.0), medial_wall, 14.0)


def sagittal_profile(points, lateral: bool):
    """The condyle from the side: a posterior and a trochlear circle, a flatter distal facet between."""
    x, y = points[..., 0], points[..., 1]
    if lateral:
        ends = rounded_bar(x, y, (-4.0, -0.5), 19.3, (15.0, 5.5), 23.0)
    else:
        ends = rounded_bar(x, y, (-3.5, -0.5), 20.3, (13.0, 3.0), 21.0)
    return ends - 2.5 * np.exp(-(((x - 5.5) / 13.0) ** 2))


def metaphysis(points):
    """Shaft and flare."""
    return cut(loft(points, SHAFT, power=2.4), SHAFT[0][0] - points[..., 1], 6.0)


def notch(points):
    """The intercondylar notch: its roof is Blumensaat's line, 40 degrees to the shaft."""
    x, y, z = np.moveaxis(points, -1, 0)
    tilt = np.radians(40.0)
    below_roof = (x - 10.0) * -np.cos(tilt) + (y + 10.0) * -np.sin(tilt)
    half_width = 9.5 - 0.05 * np.minimum(x, 10.0) + 0.15 * np.maximum(-y, 0.0)
    return cut(np.abs(z) - half_width, -below_roof, 6.0)
