"""Changes of a body's motion after a step: as if another wrench had acted in it."""

import math

import numpy as np
import pybullet as p

from . import _core
from .jacobians import jacobians_and_mass, movable_joints, rates

_WALL = 1e12  # times its mass: what is stopped answers by nothing


def exchange(body, link, old, new, dt, client, stopped=()) -> None:
    """Change a body's motion as if the wrench `new` had acted on a link in the last step and not `old`.

    Both (6,), about the link's centre of mass, world frame [N], [N m]. dt: length of that step [s], whose
    displacement changes too. stopped: degrees of freedom that do not answer.
    Bodies whose joints jacobians_and_mass does not know stay as they are.
    """
    parts = jacobians_and_mass(body, [link], client)
    if parts is None or not len(parts[1]):
        return
    jacobian, now = parts[0][0], rates(body, client)
    parts[1][stopped, stopped] *= _WALL
    took, gives = dt * _core.answer(parts[1], jacobian.T @ np.transpose([old, new])).T
    most = np.where(np.abs(now) > _core.CUT_OFF_RATE, np.abs(now), np.inf)
    change = gives - np.clip(took, -most, most)  # pybullet cut off what the old wrench gave
    if p.getDynamicsInfo(body, -1, client)[0] > 0:
        _push_base(body, now[:6] + change[:6], change[:6], dt, client)
        change = change[6:]
    _push_joints(body, change, dt, client)


def change_rates(body, by, dt, client) -> None:
    """Change a free body's motion as if its rates had changed by (6,) more in the last step."""
    _push_base(body, rates(body, client) + by, by, dt, client)


def _push_base(body, motion, change, dt, client) -> None:
    centre, turn = p.getBasePositionAndOrientation(body, client)
    turn = product(rotation_by(dt * change[3:]), turn)
    p.resetBasePositionAndOrientation(body, (centre + dt * change[:3]).tolist(), turn, client)
    p.resetBaseVelocity(body, motion[:3].tolist(), motion[3:].tolist(), physicsClientId=client)


def _push_joints(body, change, dt, client) -> None:
    joints, first = movable_joints(body, client), 0
    for joint in joints:
        place, rate = p.getJointStateMultiDof(body, joint, client)[:2]
        by = change[first : first + len(rate)]
        first += len(rate)
        if len(rate) == 1:
            p.resetJointState(body, joint, place[0] + dt * by[0], rate[0] + by[0], client)
        else:
            place = product(place, rotation_by(dt * by))
            p.resetJointStateMultiDof(body, joint, place, (rate + by).tolist(), client)


def rotation_by(vector) -> tuple:
    """Quaternion (x, y, z, w) of a rotation vector (3,)."""
    angle = float(np.linalg.norm(vector))
    half = 0.5 * np.sinc(angle / (2 * math.pi))  # sin(angle / 2) / angle
    return (*(half * vector).tolist(), math.cos(angle / 2))


def product(a, b) -> tuple:
    """Quaternion product a b, rotation b first; pybullet's own rounds to single precision."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
