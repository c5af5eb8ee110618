"""Constraints of the user: what p.createConstraint joins, as the core takes it.

Owns: the constraints of a client, and which bodies move together, by these and by contacts. Points, fixed
frames and gears are known; others (prismatic) are learned from the motion of the bodies. Goes with
link_constraints in the core's room `bodies`.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
import pybullet as p

from . import _core

_KINDS = {
    p.JOINT_POINT2POINT: _core.POINT_CONSTRAINT,
    p.JOINT_FIXED: _core.FIXED_CONSTRAINT,
    p.JOINT_GEAR: _core.GEAR_CONSTRAINT,
}
# What pybullet reports as the largest force of a constraint until that is changed: an impulse [N s], of any
# step, beyond what tendons give.
_AS_CREATED = 500.0
_AT_LIMIT = 1e-6  # share of a force by which one at its limit differs from that


class End(NamedTuple):
    """A side of a constraint: a link of a body (-1, -1: the world), and the frame in its inertial one."""

    body: int
    link: int
    origin: tuple
    turn: tuple


class Constraint(NamedTuple):
    """A constraint that the core knows. most: force of each row [N], [N m]. ratio: of a gear [-]."""

    number: int
    kind: int
    ends: tuple[End, End]
    most: float
    ratio: float

    @property
    def joins(self) -> tuple[int, int, int]:
        """Its number, and the bodies of both ends."""
        return self.number, self.ends[0].body, self.ends[1].body


def read_constraints(client: int) -> list[Constraint]:
    """The constraints of a client that the core knows."""
    count = p.getNumConstraints(client)
    if count == 0:
        return []
    numbers = [p.getConstraintUniqueId(i, client) for i in range(count)]
    infos = [(number, p.getConstraintInfo(number, client)) for number in numbers]
    return [_constraint(number, info, client) for number, info in infos if info[4] in _KINDS]


def _constraint(number: int, info: tuple, client: int) -> Constraint:
    ends = (End(info[0], info[1], info[6], info[8]), End(info[2], info[3], info[7], info[9]))
    most = abs(info[10])
    if most == _AS_CREATED and not _was_at(most, number, client):
        most = np.finfo(float).max
    return Constraint(number, _KINDS[info[4]], ends, most, info[11])


def _was_at(most: float, number: int, client: int) -> bool:
    """Whether a force of a constraint was at that limit in the last step."""
    forces = p.getConstraintState(number, client)
    return any(abs(abs(force) - most) <= _AT_LIMIT * most for force in forces)


def has_constraints(body: int, client: int) -> bool:
    """Whether a constraint of any kind joins it to another body or to the world."""
    ids = [p.getConstraintUniqueId(i, client) for i in range(p.getNumConstraints(client))]
    infos = [p.getConstraintInfo(constraint, client) for constraint in ids]
    return any(body in (info[0], info[2]) for info in infos)


def groups(
    bodies: Iterable[int],
    constraints: list[Constraint],
    touching: Iterable[tuple[int, int]],
    moves: Callable,
) -> list[tuple[int, ...]]:
    """These bodies and those that constraints join to them, or that touch them: what moves together.

    touching: pairs of bodies. moves: whether a body moves. The first of a group is one of `bodies`; their
    order is kept.
    """
    joined: dict[int, set[int]] = {}
    ends = [(c.ends[0].body, c.ends[1].body) for c in constraints]
    pairs = [(a, b) for a, b in ends if a != b and a >= 0 and b >= 0 and moves(a) and moves(b)]
    for a, b in [*pairs, *touching]:
        joined.setdefault(a, set()).add(b)
        joined.setdefault(b, set()).add(a)
    found: list[tuple[int, ...]] = []
    seen: set[int] = set()
    for body in bodies:
        if body in seen:
            continue
        group = [body]
        for member in group:
            group += sorted(joined.get(member, set()) - set(group))
        seen.update(group)
        found.append(tuple(group))
    return found
