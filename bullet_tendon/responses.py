"""How links answer to wrenches, by pybullet's masses, inertias and Jacobians."""

from functools import lru_cache

import numpy as np
import pybullet as p


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


def rigid_response(body, client) -> tuple[np.ndarray, np.ndarray]:
    """(6, 6) inverse inertia of a floating body whose links are rigidly joined, about its centre of mass (3,)."""
    parts = [_mass_of(body, link, client) for link in range(-1, p.getNumJoints(body, client))]
    mass = sum(m for m, _, _ in parts)
    centre = sum(m * c for m, c, _ in parts) / mass
    response = np.zeros((6, 6))
    response[:3, :3] = np.eye(3) / mass
    response[3:, 3:] = np.linalg.pinv(sum(i + m * _point_inertia(c - centre) for m, c, i in parts))
    return response, centre


def shifted(by) -> np.ndarray:
    """(6, 6) Jacobian of the point `by` (3,) away on a rigid body: velocity and spin there."""
    jacobian = np.eye(6)
    jacobian[:3, 3:] = -_cross_matrix(by)
    return jacobian


def _mass_of(body, link, client) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre (3,) and inertia (3, 3) about it of a link, world frame."""
    info = p.getDynamicsInfo(body, link, client)
    if link < 0:
        centre, turn = p.getBasePositionAndOrientation(body, client)
    else:
        centre, turn = p.getLinkState(body, link, physicsClientId=client)[:2]
    axes = axes_of(turn)
    return info[0], np.array(centre), (axes * info[2]) @ axes.T


def _cross_matrix(r) -> np.ndarray:
    """(3, 3) matrix of v -> r x v."""
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


def _point_inertia(r) -> np.ndarray:
    """Inertia of a unit mass at r."""
    return np.dot(r, r) * np.eye(3) - np.outer(r, r)


def movable_joints(body, client) -> list[int]:
    """Indices of the joints that have a degree of freedom."""
    kinds = ((j, p.getJointInfo(body, j, client)[2]) for j in range(p.getNumJoints(body, client)))
    return [j for j, kind in kinds if kind != p.JOINT_FIXED]


def jacobian_and_mass(body, link, joints, client) -> tuple[np.ndarray, np.ndarray] | None:
    """J (6, joints) of a link's centre of mass, world axes, and M (joints, joints), of a fixed base.

    None where pybullet's Jacobian does not cover the body: a floating base, or spherical joints.
    """
    simple = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)
    if any(p.getJointInfo(body, j, client)[2] not in simple for j in joints):
        return None
    angles = [s[0] for s in p.getJointStates(body, joints, client)]
    mass = np.array(p.calculateMassMatrix(body, angles, physicsClientId=client))
    if len(mass) != len(joints):
        return None
    if link < 0:
        return np.zeros((6, len(joints))), mass
    zero = [0.0] * len(angles)
    # pybullet takes the point in the link's URDF frame, and answers in the base's inertial axes.
    info = p.getDynamicsInfo(body, link, client)
    at = axes_of(info[4]).T @ info[3]
    linear, angular = p.calculateJacobian(body, link, at.tolist(), angles, zero, zero, client)
    base = axes_of(p.getBasePositionAndOrientation(body, client)[1])
    return np.vstack([base @ linear, base @ angular]), mass
