"""What multibody solves: bodies that swing on tendons whose mass is negligible, and their exact paths.

All start at rest. Springs begin with about the tension that holds the weight.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from .rigid_ode import GRAVITY, Arm, FreeBodies

STIFFNESS = 3e4  # N
WORLD = (-1, -1)  # in the place of body and link


@dataclasses.dataclass(frozen=True)
class Tie:
    """A tendon between two points: (body, link) each, WORLD for a fixed end, and where they are (3,) [m]."""

    a: tuple[int, int]
    b: tuple[int, int]
    start: np.ndarray
    end: np.ndarray
    rest: float  # m


@dataclasses.dataclass(frozen=True)
class System:
    """Tracked are the bodies (body, link) that are compared.

    paths(times): their centres on the exact paths, (len(times), n, 3) [m].
    """

    ties: list[Tie]
    tracked: list[tuple[int, int]]
    paths: Callable


def pendulum(client) -> System:
    """A sphere of 1 kg on 0.3 m, from 60 degrees."""

    def shape():
        return p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=client)

    return _chain(client, 1, 60, shape, 1.0, 0.0, 0.3)


def double_pendulum(client) -> System:
    """Two boxes of 0.5 kg, knotted at their faces, from 40 degrees."""
    half = 0.03

    def shape():
        return p.createCollisionShape(p.GEOM_BOX, halfExtents=[half] * 3, physicsClientId=client)

    return _chain(client, 2, 40, shape, 0.5, half, 0.15)


def plate(client) -> System:
    """A plate of 1 kg on four tendons of 0.3 m, aside by 30 degrees and turned about z by 20."""
    half = np.array([0.1, 0.1, 0.01])
    turn = Rotation.from_euler("z", 20, degrees=True)
    corners = half * [[x, y, 1] for x in (-1, 1) for y in (-1, 1)]
    height, aside = 0.3 * math.cos(math.radians(30)), 0.3 * math.sin(math.radians(30))
    centre = np.array([aside, 0, -height - half[2]])
    body = _body(
        p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client),
        1.0,
        centre,
        turn,
        client,
    )
    tops, ends = corners * [1, 1, 0], centre + turn.apply(corners)
    spans = np.linalg.norm(ends - tops, axis=1)
    tension = GRAVITY / 4 * spans.mean() / height * math.cos(math.radians(30)) ** 2
    ties = [
        Tie(WORLD, (body, -1), top, end, span / (1 + tension / STIFFNESS))
        for top, end, span in zip(tops, ends, spans, strict=True)
    ]
    return System(ties, [(body, -1)], _free_paths(client, [body], ties))


def arm(client) -> System:
    """Two links of 0.2 m and 0.5 kg on hinges, whose tip swings on a tendon above it."""
    length, half, angles = 0.2, [0.1, 0.01, 0.01], np.array([0.2, 0.5])
    anchor = np.array([0.45, 0, 0.2])
    body = _two_links(client, length, half, angles)
    inertia = p.getDynamicsInfo(body, 0, client)[2][1]
    tip = Arm(length, 0.5, inertia, anchor, STIFFNESS, 1.0).points(angles)[2]
    rest = np.linalg.norm(anchor - tip) / (1 + 0.5 * GRAVITY / STIFFNESS)
    exact = Arm(length, 0.5, inertia, anchor, STIFFNESS, rest)
    tie = Tie(WORLD, (body, 1), anchor, tip, rest)
    return System([tie], [(body, 0), (body, 1)], lambda times: exact.paths(angles, times))


PROBLEMS = {"pendulum": pendulum, "double pendulum": double_pendulum, "plate": plate, "arm": arm}


def link_frame(body, link, client) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) [m] and axes (3, 3) of a link's centre of mass, world frame."""
    if link < 0:
        at, turn = p.getBasePositionAndOrientation(body, client)
    else:
        at, turn = p.getLinkState(body, link, 0, 1, client)[:2]
    return np.array(at), Rotation.from_quat(turn).as_matrix()


def _chain(client, count, degrees, shape, mass, half, length) -> System:
    """Equal bodies hung below each other, in one line that is turned from the vertical."""
    turn = Rotation.from_euler("y", -degrees, degrees=True)
    down = turn.apply([0, 0, -1])
    top, above, ties, bodies = np.zeros(3), WORLD, [], []
    for k in range(count):
        tension = (count - k) * mass * GRAVITY * math.cos(math.radians(degrees))
        end = top + length * (1 + tension / STIFFNESS) * down
        centre = end + half * down
        bodies.append(_body(shape(), mass, centre, turn, client))
        ties.append(Tie(above, (bodies[-1], -1), top, end, length))
        top, above = centre + half * down, (bodies[-1], -1)
    return System(ties, [(body, -1) for body in bodies], _free_paths(client, bodies, ties))


def _free_paths(client, bodies, ties) -> Callable:
    info = [p.getDynamicsInfo(body, -1, client) for body in bodies]
    frames = [link_frame(body, -1, client) for body in bodies]

    def place(end, point):
        if end == WORLD:
            return -1, point
        k = bodies.index(end[0])
        return k, frames[k][1].T @ (point - frames[k][0])

    springs = [(*place(t.a, t.start), *place(t.b, t.end), STIFFNESS, t.rest) for t in ties]
    exact = FreeBodies([i[0] for i in info], [i[2] for i in info], springs)
    turns = [Rotation.from_matrix(axes).as_quat() for _, axes in frames]
    return lambda times: exact.paths([at for at, _ in frames], turns, times)


def _body(shape, mass, centre, turn, client) -> int:
    body = p.createMultiBody(mass, shape, -1, list(centre), list(turn.as_quat()), physicsClientId=client)
    _undamp(body, [-1], client)
    return body


def _two_links(client, length, half, angles) -> int:
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    turned = [0, 0, 0, 1]
    body = p.createMultiBody(
        0.0,
        linkMasses=[0.5, 0.5],
        linkCollisionShapeIndices=[shape] * 2,
        linkVisualShapeIndices=[-1] * 2,
        linkPositions=[(0, 0, 0), (length, 0, 0)],
        linkOrientations=[turned] * 2,
        linkInertialFramePositions=[(length / 2, 0, 0)] * 2,
        linkInertialFrameOrientations=[turned] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_REVOLUTE] * 2,
        linkJointAxis=[(0, 1, 0)] * 2,
        physicsClientId=client,
    )
    for link, angle in enumerate(angles):
        p.resetJointState(body, link, angle, 0, client)
        p.setJointMotorControl2(body, link, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    p.setCollisionFilterPair(body, body, 0, 1, 0, client)
    _undamp(body, [-1, 0, 1], client)
    return body


def _undamp(body, links, client) -> None:
    for link in links:
        p.changeDynamics(
            body, link, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=client
        )
