"""The proximal right tibia with the fibular head as a signed field [mm]; axes as in femur_field.py."""

import numpy as np

from .fields import capsule, cut, ellipsoid, loft, union

# y, centre x, centre z, half-width AP, half-width ML
SHAFT = [
    (-130.0, 1.0, 1.0, 11.5, 11.5),
    (-100.0, 1.0, 1.0, 12.5, 12.8),
    (-75.0, 3.0, 0.5, 16.5, 17.5),
    (-58.0, 3.7, 0.0, 20.5, 24.5),
    (-45.0, 3.2, 0.0, 22.5, 31.0),
    (-36.0, 2.2, 0.0, 23.0, 35.5),
    (-20.0, 2.0, 0.0, 22.5, 36.0),
]
BOTTOM = -122.0  # where the shafts are sawn off
SLOPE = np.tan(np.radians(8.0))


def tibia(points):
    """Field (...) of the undrilled bone at points (..., 3) [mm]."""
    bone = cut(union(condyles(points), loft(points, SHAFT), 8.0), points[..., 1] - plateau(points), 6.0)
    bone = union(bone, capsule(points, (23.5, -47.0, 4.0), (20.5, -65.0, 4.0), 7.5, 4.5), 12.0)  # tuberosity
    bone = union(bone, capsule(points, (20.5, -64.0, 3.5), (15.0, -130.0, 1.0), 3.5, 2.5), 14.0)  # crest
    bone = union(bone, ellipsoid(points, (15.0, -37.0, 27.0), (8.0, 8.0, 7.0)), 10.0)  # Gerdy's tubercle
    bone = union(bone, eminence(points), 8.0)
    bone = union(bone, fibula(points), 10.0)
    return cut(bone, BOTTOM - points[..., 1], 9.0)


def condyles(points):
    """The flared outline of the two plateaus, seen from above two ovals with a dent behind."""
    x, y, z = np.moveaxis(points, -1, 0)
    shrink = 0.020 * np.maximum(-30.0 - y, 0.0) ** 2 * (1.0 + 0.03 * np.maximum(-30.0 - y, 0.0))
    medial = oval(x, z, (0.5, -19.0), (25.5, 18.5)) + shrink
    lateral = oval(x, z, (1.5, 19.0), (23.0, 18.5)) + shrink
    front = oval(x, z, (9.0, 0.0), (16.5, 24.0)) + shrink
    return union(union(medial, lateral, 8.0), front, 6.0)


def oval(x, z, centre, semi_axes):
    """An ellipse in the plane x, z."""
    size = np.hypot((x - centre[0]) / semi_axes[0], (z - centre[1]) / semi_axes[1])
    return (size - 1.0) * min(semi_axes)


def plateau(points):
    """Height y [mm] of the joint surface: sloping backwards, medially a dish, laterally a low dome."""
    x, z = points[..., 0], points[..., 2]
    level = -24.8 + SLOPE * x
    dish = -2.4 * np.exp(-(((x - 2.0) / 16.0) ** 2) - ((z + 22.0) / 10.0) ** 2)
    dome = 0.7 * np.exp(-((x / 14.0) ** 2)) - 0.9
    # the intercondylar areas slope down to the front (ACL, menisci) and to the rear (PCL)
    front = -5.0 * np.exp(-((z / 13.0) ** 2)) / (1.0 + np.exp((17.0 - x) / 3.0))
    rear = -5.0 * np.exp(-((z / 8.0) ** 2)) / (1.0 + np.exp((x + 13.0) / 2.0))
    return level + dish + dome * np.clip(z / 15.0, 0.0, 1.0) + front + rear


def eminence(points):
    """The two intercondylar spines."""
    medial = capsule(points, (3.0, -28.0, -6.0), (-3.0, -22.0, -4.5), 4.5, 3.4)
    lateral = capsule(points, (-1.0, -28.0, 6.5), (-6.0, -23.0, 6.0), 4.5, 3.4)
    return union(medial, lateral, 3.0)


def fibula(points):
    """Head, neck and shaft of the fibula, joined to the tibia where their joint is."""
    head = ellipsoid(points, (-15.0, -50.0, 30.5), (9.0, 11.0, 9.0))
    styloid = capsule(points, (-17.0, -47.0, 32.0), (-18.5, -41.0, 32.5), 6.0, 4.0)
    shaft = capsule(points, (-15.0, -56.0, 31.0), (-13.0, -130.0, 28.0), 5.8, 6.2)
    return union(union(head, styloid, 5.0), shaft, 8.0)
