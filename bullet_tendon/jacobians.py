"""Jacobians, mass matrix and rates of articulated bodies, fixed or floating.

Composed from joint axes, poses and masses (Featherstone 2008, chapters 4 and 6): pybullet's own mass
matrix keeps the masses and inertias that a body had when it was first asked for, and its Jacobians know
no spherical joints.

Degrees of freedom: of a floating base the velocity (3) of its centre of mass and its spin (3), world
axes; then the joints in pybullet's order: the rate of a hinge or slider, the three rates of a spherical
joint about the axes of its link's inertial frame.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pybullet as p

_TWISTS = np.eye(6)
_COUNTS = {p.JOINT_REVOLUTE: 1, p.JOINT_PRISMATIC: 1, p.JOINT_SPHERICAL: 3, p.JOINT_FIXED: 0}


class Structure(NamedTuple):
    """What does not change while a body moves. Rows of links start with the base."""

    moves: np.ndarray  # (links, dofs): whether a degree of freedom moves a link
    carriers: np.ndarray  # (joint dofs,) row of the link that a joint's degree of freedom carries
    axes: np.ndarray  # (joint dofs, 3) in that link's inertial frame
    slides: np.ndarray  # (joint dofs, 1) whether it is a slider
    base: int  # 6 for a floating base, 0 for a fixed one


class Posture(NamedTuple):
    """Where the links of a body are. Rows start with the base."""

    centres: np.ndarray  # (links, 3) centres of mass, world
    turns: np.ndarray  # (links, 3, 3) axes of the inertial frames, world
    masses: np.ndarray  # (links,)
    inertias: np.ndarray  # (links, 3) about the inertial axes
    pivots: np.ndarray  # (links, 3) origins of the URDF frames, world


def movable_joints(body, client) -> list[int]:
    """Indices of the joints that have a degree of freedom."""
    kinds = ((j, p.getJointInfo(body, j, client)[2]) for j in range(p.getNumJoints(body, client)))
    return [j for j, kind in kinds if kind != p.JOINT_FIXED]


def jacobians_and_mass(body, links, client) -> tuple[np.ndarray, np.ndarray] | None:
    """J (len(links), 6, dofs) and M (dofs, dofs) of a body where it is now.

    links: indices, -1 for the base. Rows of J: velocity of the link's centre of mass, then its spin, world
    axes. M is the sum of J_l^T diag(m_l 1, I_l) J_l over all links. None where a joint is of another kind
    than fixed, hinge, slider and spherical.
    """
    structure = _structure_of(body, client)
    if structure is None:
        return None
    posture = _posture_of(body, client)
    jacobians = _jacobians(structure, posture)
    return jacobians[np.add(links, 1)], _mass_matrix(jacobians, posture)


def rates(body, client) -> np.ndarray:
    """(dofs,) velocities of the degrees of freedom now, so that J @ rates is a link's velocity and spin."""
    base = [] if _is_fixed(body, client) else np.concatenate(p.getBaseVelocity(body, client)).tolist()
    joints = movable_joints(body, client)
    states = p.getJointStatesMultiDof(body, joints, physicsClientId=client) if joints else ()
    return np.array([*base, *(rate for state in states for rate in state[1])])


def _is_fixed(body, client) -> bool:
    return p.getDynamicsInfo(body, -1, client)[0] == 0


def _structure_of(body, client) -> Structure | None:
    infos = [p.getJointInfo(body, j, client) for j in range(p.getNumJoints(body, client))]
    return _structure(tuple((i[2], i[13], i[16]) for i in infos), not _is_fixed(body, client))


@lru_cache(maxsize=256)
def _structure(joints: tuple, floating: bool) -> Structure | None:
    """joints: of every link its joint's kind, axis and parent link."""
    if any(kind not in _COUNTS for kind, _, _ in joints):
        return None
    base = 6 if floating else 0
    counts = [_COUNTS[kind] for kind, _, _ in joints]
    moves = np.zeros((len(joints) + 1, base + sum(counts)))
    moves[0, :base] = 1
    axes, first = [], base
    for row, ((kind, axis, parent), count) in enumerate(zip(joints, counts, strict=True), start=1):
        moves[row] = moves[parent + 1]
        moves[row, first : first + count] = 1
        axes += np.eye(3).tolist() if kind == p.JOINT_SPHERICAL else [axis] * count
        first += count
    carriers = np.repeat(np.arange(1, len(joints) + 1), counts)
    slides = np.repeat([kind == p.JOINT_PRISMATIC for kind, _, _ in joints], counts)[:, None]
    return Structure(moves, carriers, np.reshape(axes, (-1, 3)), slides, base)


def _posture_of(body, client) -> Posture:
    links = range(-1, p.getNumJoints(body, client))
    poses = [p.getBasePositionAndOrientation(body, client)]
    if len(links) > 1:
        poses += p.getLinkStates(body, links[1:], 0, 1, client)
    infos = [p.getDynamicsInfo(body, link, client) for link in links]
    turns = rotations([pose[1] for pose in poses])
    centres = np.array([pose[0] for pose in poses])
    local = rotations([info[4] for info in infos])
    origins = np.array([info[3] for info in infos])
    # The URDF frame that getLinkState reports itself is rounded to single precision.
    pivots = centres - (turns @ local.transpose(0, 2, 1) @ origins[:, :, None])[:, :, 0]
    masses, inertias = np.array([info[0] for info in infos]), np.array([info[2] for info in infos])
    return Posture(centres, turns, masses, inertias, pivots)


def rotations(quaternions) -> np.ndarray:
    """(n, 3, 3) rotations of quaternions (n, 4), x, y, z, w, of any length."""
    q = np.array(quaternions)
    x, y, z, w = (q * np.sqrt(2 / (q * q).sum(1))[:, None]).T
    rows = [
        [1 - y * y - z * z, x * y - z * w, x * z + y * w],
        [x * y + z * w, 1 - x * x - z * z, y * z - x * w],
        [x * z - y * w, y * z + x * w, 1 - x * x - y * y],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _jacobians(structure: Structure, posture: Posture) -> np.ndarray:
    """(links, 6, dofs) by the screws of the degrees of freedom about the base's centre of mass."""
    centres = posture.centres - posture.centres[0]
    axes = (posture.turns[structure.carriers] @ structure.axes[:, :, None])[:, :, 0]
    arms = posture.pivots[structure.carriers] - posture.centres[0]
    spins = np.where(structure.slides, 0.0, axes)
    shifts = np.where(structure.slides, axes, _cross(arms, axes))
    shifts = np.vstack([_TWISTS[: structure.base, :3], shifts])
    spins = np.vstack([_TWISTS[: structure.base, 3:], spins])
    velocities = shifts + _cross(spins, centres[:, None])
    jacobians = np.concatenate([velocities, np.broadcast_to(spins, velocities.shape)], axis=2)
    return (jacobians * structure.moves[:, :, None]).transpose(0, 2, 1)


def _cross(a, b) -> np.ndarray:
    """Cross products over the last axis; numpy's own takes several times as long."""
    first = a[..., [1, 2, 0]] * b[..., [2, 0, 1]]
    return first - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def _mass_matrix(jacobians: np.ndarray, posture: Posture) -> np.ndarray:
    inertias = (posture.turns * posture.inertias[:, None]) @ posture.turns.transpose(0, 2, 1)
    momenta = np.concatenate(
        [posture.masses[:, None, None] * jacobians[:, :3], inertias @ jacobians[:, 3:]], axis=1
    )
    flat = (6 * len(jacobians), jacobians.shape[2])
    return jacobians.reshape(flat).T @ momenta.reshape(flat)
