"""The coordinates of a body that tendons touch: their rates, how they answer to forces, and its links' Jacobians.

A body is solved for by what can move of it: the twist of a rigid one, the rates of its joints otherwise. Where
pybullet gives no Jacobian (jacobian_and_mass), every link stands for itself, with its own mass: the stable side.
"""

from typing import NamedTuple

import numpy as np
import pybullet as p

from .responses import free_response, jacobian_and_mass, movable_joints, rigid_response, shifted


class Mover(NamedTuple):
    """falls: gravity changes the first three rates by itself. rates (n,): velocity of the centre of mass
    [m/s] and spin [rad/s], or of the joints. response (n, n): the inverse of their mass matrix. jacobians: of
    each link asked for, (6, n), velocity of its centre of mass and spin, world axes; None for the identity."""

    falls: bool
    rates: np.ndarray
    response: np.ndarray
    jacobians: list


def movers_of(body: int, links: list[int], rows: dict[int, np.ndarray], client: int) -> list:
    """(links it is of, Mover) for all that can move of a body's links; links of mass 0 left out by the caller.

    rows: by link, what bodies.py reads (centre of mass at 12, velocity at 15, spin at 18).
    """
    joints = movable_joints(body, client)
    fixed = p.getDynamicsInfo(body, -1, client)[0] == 0
    if fixed and not joints:
        return []
    if not fixed and not joints:
        return [(links, _rigid(body, links, rows, client))]
    if fixed:
        jointed = _jointed(body, links, joints, client)
        if jointed is not None:
            return [(links, jointed)]
    return [([link], _alone(body, link, rows[link], client, falls=False)) for link in links]


def _rigid(body, links, rows, client) -> Mover:
    if p.getNumJoints(body, client) == 0:
        return _alone(body, -1, rows[-1], client, falls=True)
    response, centre = rigid_response(body, client)
    row = rows[links[0]]
    spin = row[18:21]
    rates = np.concatenate([row[15:18] + np.cross(spin, centre - row[12:15]), spin])
    return Mover(True, rates, response, [shifted(rows[link][12:15] - centre) for link in links])


def _jointed(body, links, joints, client) -> Mover | None:
    parts = [jacobian_and_mass(body, link, joints, client) for link in links]
    if any(part is None for part in parts):
        return None
    rates = np.array([s[1] for s in p.getJointStates(body, joints, client)])
    return Mover(False, rates, np.linalg.inv(parts[0][1]), [jacobian for jacobian, _ in parts])


def _alone(body, link, row, client, falls) -> Mover:
    info = p.getDynamicsInfo(body, link, client)
    return Mover(falls, row[15:21].copy(), free_response(info, _turn(body, link, client)), [None])


def _turn(body, link, client):
    if link < 0:
        return p.getBasePositionAndOrientation(body, client)[1]
    return p.getLinkState(body, link, physicsClientId=client)[1]
