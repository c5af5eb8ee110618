"""How rigid bodies by themselves answer to wrenches, by pybullet's masses and inertias."""

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=1024)
def axes_of(quaternion: tuple) -> np.ndarray:
    """(3, 3) rotation of a quaternion (x, y, z, w); remembered, because most bodies stand still."""
    x, y, z, w = quaternion
    s = 2 / (x * x + y * y + z * z + w * w)
    axes = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
    axes.setflags(write=False)
    return axes


def free_response(info, inertial_turn) -> np.ndarray:
    """(6, 6) inverse inertia of a free rigid body about its centre of mass, world axes."""
    axes = axes_of(inertial_turn)
    response = np.zeros((6, 6))
    response[:3, :3] = np.eye(3) / info[0]
    inertia = np.array(info[2])
    inverse = np.divide(1.0, inertia, out=np.zeros(3), where=inertia > 0)
    response[3:, 3:] = (axes * inverse) @ axes.T
    return response
