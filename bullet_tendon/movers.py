"""Coordinates of a body that tendons touch: their rates, how they answer to forces, its links' Jacobians.

A body is solved for by what can move of it: the twist of a rigid one, else the degrees of freedom of base
and joints. Where pybullet has joints that jacobians_and_mass does not know, every link stands for itself,
with its own mass: the stable side.
"""

from typing import NamedTuple

import numpy as np
import pybullet as p

from . import _core
from .jacobians import dynamics, joint_infos, joint_states, movable_joints, rates_of

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


def movers_of(body: int, links: list[int], mark: bytes, client: int) -> list[tuple]:
    """(links, mover, Jacobians) for all that can move of a body's links, none of them without mass.

    mark: what the body carries (identity.Marks). mover: a Mover; or, of a rigid body by itself, whether it
    falls, and the core reads the rest of its link. Jacobians: of each link, (6, n), velocity of its centre of
    mass and spin, world axes; None: the identity.
    """
    infos = joint_infos(body, client, mark)
    if not infos:
        return [(links, True, [None])]
    parts = dynamics(body, links, client, infos)
    if parts is None:
        return [([link], False, [None]) for link in links]
    jacobians, mass, weight = parts
    if len(mass) == 0:
        return []
    joints = movable_joints(body, client, infos)
    states = joint_states(body, joints, client)
    rates = rates_of(body, states, len(mass), client)
    response = _core.answer(mass, np.eye(len(mass)))
    reached = stops([infos[joint] for joint in joints], states, len(mass))
    return [(links, Mover(response @ weight, rates, response, reached), jacobians)]


def stops(infos, states, dofs: int) -> list | None:
    """Limits of hinges and sliders that are reached (Mover.stops), of joints that move.

    dofs: degrees of freedom of the body, of which those joints have the last. pybullet stops a joint that is
    there as its step begins, and takes back part of the depth.
    """
    found, coordinate = [], dofs - sum(len(state[1]) for state in states)
    for info, (place, rate, *_) in zip(infos, states, strict=True):
        if info[2] in _SIMPLE and info[8] <= info[9]:
            for side, depth in ((1, info[8] - place[0]), (-1, place[0] - info[9])):
                if depth >= 0:
                    found += [coordinate, side, depth]
        coordinate += len(rate)
    return found or None
