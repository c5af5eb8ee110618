"""Coordinates of a body that tendons touch: their rates, how they answer to forces, its links' Jacobians.

A body is solved for by what can move of it: the twist of a rigid one, else the degrees of freedom of base
and joints. Where pybullet has joints that jacobians_and_mass does not know, every link stands for itself,
with its own mass: the stable side.
"""

from typing import NamedTuple

import numpy as np
import pybullet as p

from . import _core
from .jacobians import jacobians_and_mass, rates
from .responses import free_response

_SIMPLE = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)


class Mover(NamedTuple):
    """falls: gravity changes the first three rates by itself. rates (n,): the velocities of the degrees of
    freedom [m/s], [rad/s]. response (n, n): the inverse of their mass matrix. stops: coordinate, side (1
    where it pushes up) and depth of every joint limit that is reached, one after the other; None where there
    is none. jacobians: of each link asked for, (6, n), velocity of its centre of mass and spin, world axes;
    None for the identity."""

    falls: bool
    rates: np.ndarray
    response: np.ndarray
    stops: list | None
    jacobians: list


def movers_of(body: int, links: list[int], rows: dict[int, np.ndarray], client: int) -> list:
    """(links it is of, Mover) for all that can move of a body's links, none of them without mass.

    rows: by link, what bodies.py reads of it (velocity at 15, spin at 18).
    """
    if p.getNumJoints(body, client) == 0:
        return [(links, _alone(body, -1, rows[-1], client, falls=True))]
    parts = jacobians_and_mass(body, links, client)
    if parts is None:
        return [([link], _alone(body, link, rows[link], client, falls=False)) for link in links]
    jacobians, mass = parts
    if len(mass) == 0:
        return []
    floating = p.getDynamicsInfo(body, -1, client)[0] > 0
    response = _core.answer(mass, np.eye(len(mass)))
    return [
        (
            links,
            Mover(
                floating, rates(body, client), response, stops(body, 6 * floating, client), list(jacobians)
            ),
        )
    ]


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


def _alone(body, link, row, client, falls) -> Mover:
    info = p.getDynamicsInfo(body, link, client)
    return Mover(falls, row[15:21].copy(), free_response(info, _turn(body, link, client)), None, [None])


def _turn(body, link, client):
    if link < 0:
        return p.getBasePositionAndOrientation(body, client)[1]
    return p.getLinkState(body, link, physicsClientId=client)[1]
