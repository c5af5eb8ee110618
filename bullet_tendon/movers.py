"""Coordinates of a body that tendons touch: their rates, how they answer to forces, its links' Jacobians.

A body is solved for by what can move of it: the twist of a rigid one, else the degrees of freedom of base
and joints. Where pybullet has joints that jacobians_and_mass does not know, every link stands for itself,
with its own mass: the stable side.
"""

from typing import NamedTuple

import numpy as np
import pybullet as p

from . import _core
from .jacobians import dynamics, rates

_SIMPLE = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)


class Mover(NamedTuple):
    """falls (n, 3): acceleration of the rates by a unit of gravity. rates (n,): the velocities of the degrees
    of freedom [m/s], [rad/s]. response (n, n): the inverse of their mass matrix. stops: coordinate, side (1
    where it pushes up) and depth of every joint limit that is reached, one after the other; None where there
    is none."""

    falls: np.ndarray
    rates: np.ndarray
    response: np.ndarray
    stops: list | None


def movers_of(body: int, links: list[int], client: int) -> list[tuple]:
    """(links, mover, Jacobians) for all that can move of a body's links, none of them without mass.

    mover: a Mover; or, of a rigid body by itself, whether it falls, and the core reads the rest of its link.
    Jacobians: of each link, (6, n), velocity of its centre of mass and spin, world axes; None: the identity.
    """
    if p.getNumJoints(body, client) == 0:
        return [(links, True, [None])]
    parts = dynamics(body, links, client)
    if parts is None:
        return [([link], False, [None]) for link in links]
    jacobians, mass, weight = parts
    if len(mass) == 0:
        return []
    floating = p.getDynamicsInfo(body, -1, client)[0] > 0
    response = _core.answer(mass, np.eye(len(mass)))
    reached = stops(body, 6 * floating, client)
    return [(links, Mover(response @ weight, rates(body, client), response, reached), jacobians)]


def stops(body, first: int, client) -> list | None:
    """Limits of hinges and sliders that are reached (Mover.stops). first: coordinate of the first joint.

    pybullet stops a joint that is there as its step begins, and takes back part of the depth.
    """
    found, coordinate = [], first
    for joint in range(p.getNumJoints(body, client)):
        info = p.getJointInfo(body, joint, client)
        if info[2] in _SIMPLE and info[8] <= info[9]:
            place = p.getJointState(body, joint, client)[0]
            for side, depth in ((1, info[8] - place), (-1, place - info[9])):
                if depth >= 0:
                    found += [coordinate, side, depth]
        coordinate += {p.JOINT_FIXED: 0, p.JOINT_SPHERICAL: 3}.get(info[2], 1)
    return found or None
