"""How links answer to wrenches, by pybullet's masses, inertias and Jacobians."""

from functools import lru_cache

import numpy as np

from . import _core
from .jacobians import jacobians_and_mass


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


def articulated_response(body, link, client) -> tuple[np.ndarray, int] | None:
    """(6, 6) J M^-1 J^T of a link's centre of mass, world axes (Khatib 1987, operational space).

    And how many degrees of freedom the body has; the base may be fixed or floating. None where a joint is
    of a kind that jacobians_and_mass does not know.
    """
    parts = jacobians_and_mass(body, [link], client)
    if parts is None:
        return None
    (jacobian,), mass = parts
    return jacobian @ _core.answer(mass, jacobian.T), len(mass)
