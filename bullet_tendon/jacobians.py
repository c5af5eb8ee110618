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
    parts = dynamics(body, links, client)
    return None if parts is None else parts[:2]


def dynamics(body, links, client, infos=None) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """J and M of jacobians_and_mass, and the generalized force (dofs, 3) of a unit of gravity."""
    infos = joint_infos(body, client) if infos is None else infos
    tree = _tree(tuple([(info[2], info[13], info[16]) for info in infos]), not is_fixed(body, client))
    if tree is None:
        return None
    if tree.dofs == 0:
        return np.zeros((len(links), 6, 0)), np.zeros((0, 0)), np.zeros((0, 3))
    return tree.dynamics(_placements(body, tree.links - 1, client), [link + 1 for link in links])


def rates(body, client) -> np.ndarray:
    """(dofs,) velocities of the degrees of freedom now, so that J @ rates is a link's velocity and spin."""
    states = joint_states(body, movable_joints(body, client), client)
    joints = sum(len(state[1]) for state in states)
    return rates_of(body, states, joints if is_fixed(body, client) else joints + 6, client)


def rates_of(body, states, dofs, client) -> np.ndarray:
    """The same, of a body with dofs of them, from the states of the joints that move."""
    joints = [rate for state in states for rate in state[1]]
    base = np.concatenate(p.getBaseVelocity(body, client)).tolist() if dofs > len(joints) else []
    return np.array([*base, *joints])


def joint_states(body, joints, client) -> tuple:
    """p.getJointStatesMultiDof of joints, of which there may be none."""
    return p.getJointStatesMultiDof(body, joints, physicsClientId=client) if joints else ()


def is_fixed(body, client) -> bool:
    """Whether nothing moves a body's base."""
    return p.getDynamicsInfo(body, -1, client)[0] == 0


@lru_cache(maxsize=256)
def _tree(joints: tuple, floating: bool) -> _core.Articulated | None:
    """joints: of every link its joint's kind, axis and parent link."""
    if any(kind not in _KINDS for kind, _, _ in joints):
        return None
    kinds, axes, parents = zip(*joints, strict=True) if joints else ((), (), ())
    return _core.Articulated([_KINDS[k] for k in kinds], np.add(parents, 1), np.array(axes), floating)


def _placements(body, count, client) -> list[float]:
    """What the core needs of every link, the base first, one number after the other (articulated.h)."""
    poses = [p.getBasePositionAndOrientation(body, client)]
    if count:
        poses += p.getLinkStates(body, range(count), 0, 1, client)
    numbers = []
    for link, pose in enumerate(poses, start=-1):
        mass, _, inertia, place, turn, *_ = p.getDynamicsInfo(body, link, client)
        numbers += pose[0]
        numbers += pose[1]
        numbers.append(mass)
        numbers += inertia
        numbers += place
        numbers += turn
    return numbers
