"""Jacobians, mass matrix and rates of articulated bodies, fixed or floating.

Composed from joint axes, poses and masses (Featherstone 2008, chapters 4 and 6): pybullet's own mass
matrix keeps the masses and inertias that a body had when it was first asked for, is not the one that it
steps MJCF's humanoid with (2 % off), and its Jacobians know no spherical joints.

Degrees of freedom: of a floating base the velocity (3) of its centre of mass and its spin (3), world
axes; then the joints in pybullet's order: the rate of a hinge or slider, the three rates of a spherical
joint about the axes of its link's inertial frame.
"""

from functools import lru_cache

import numpy as np
import pybullet as p

from . import _core

_KINDS = {
    p.JOINT_REVOLUTE: _core.HINGE,
    p.JOINT_PRISMATIC: _core.SLIDER,
    p.JOINT_SPHERICAL: _core.BALL,
    p.JOINT_FIXED: _core.FIXED,
}
_LIMITED = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)


def joint_infos(body, client, mark: bytes | None = None) -> tuple:
    """p.getJointInfo of all joints; remembered for a body that carries a mark (identity.Marks)."""
    return _read_infos(body, client) if mark is None else _remembered_infos(body, client, mark)


@lru_cache(maxsize=1024)
def _remembered_infos(body, client, _mark) -> tuple:
    return _read_infos(body, client)


def _read_infos(body, client) -> tuple:
    return tuple(p.getJointInfo(body, joint, client) for joint in range(p.getNumJoints(body, client)))


def movable_joints(body, client, infos=None) -> list[int]:
    """Indices of the joints that have a degree of freedom. infos: as of joint_infos, where they are known."""
    infos = joint_infos(body, client) if infos is None else infos
    return [joint for joint, info in enumerate(infos) if info[2] != p.JOINT_FIXED]


def jacobians_and_mass(body, links, client) -> tuple[np.ndarray, np.ndarray] | None:
    """J (len(links), 6, dofs) and M (dofs, dofs) of a body where it is now.

    links: indices, -1 for the base. Rows of J: velocity of the link's centre of mass, then its spin, world
    axes. M is the sum of J_l^T diag(m_l 1, I_l) J_l over all links. None where a joint is of another kind
    than fixed, hinge, slider and spherical.
    """
    tree = tree_of(joint_infos(body, client), not is_fixed(body, client))
    if tree is None:
        return None
    if tree.dofs == 0:
        return np.zeros((len(links), 6, 0)), np.zeros((0, 0))
    infos = [p.getDynamicsInfo(body, link, client) for link in range(-1, tree.links - 1)]
    base = p.getBasePositionAndOrientation(body, client), p.getBaseVelocity(body, client)
    joints = joint_states(body, movable_joints(body, client), client)
    return _core.dynamics(tree, infos, *base, joints, [link + 1 for link in links])


def rates(body, client) -> np.ndarray:
    """(dofs,) velocities of the degrees of freedom now, so that J @ rates is a link's velocity and spin."""
    joints = joint_states(body, movable_joints(body, client), client)
    base = [] if is_fixed(body, client) else p.getBaseVelocity(body, client)
    return np.array([rate for part in (*base, *(state[1] for state in joints)) for rate in part])


def joint_states(body, joints, client) -> tuple:
    """p.getJointStatesMultiDof of joints, of which there may be none."""
    return p.getJointStatesMultiDof(body, joints, physicsClientId=client) if joints else ()


def is_fixed(body, client) -> bool:
    """Whether nothing moves a body's base."""
    return p.getDynamicsInfo(body, -1, client)[0] == 0


def tree_of(infos, floating: bool) -> _core.Articulated | None:
    """How a body's links hang on its joints, by its joint_infos; None where it has others than those."""
    return _tree(tuple([(info[2], info[16], *info[13:16], info[8:10]) for info in infos]), floating)


@lru_cache(maxsize=256)
def _tree(joints: tuple, floating: bool) -> _core.Articulated | None:
    """joints: of every link its joint's kind, parent link, axis, pivot, turn and limits."""
    if any(kind not in _KINDS for kind, *_ in joints):
        return None
    numbers = []
    for kind, _, *places, limits in joints:
        numbers += [v for part in (*places, limits if kind in _LIMITED else (1, 0)) for v in part]
    parents = [parent + 1 for _, parent, *_ in joints]
    return _core.Articulated([_KINDS[joint[0]] for joint in joints], parents, numbers, floating)
