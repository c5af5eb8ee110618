"""Equilibrium: bodies and joints put where ligaments, cartilage, gravity and told forces balance.

Owns: nothing; it moves pybullet's bodies and reads elements from the core. Goes with no room of the core.

The coordinates q are the twists of rigid bodies and the positions of joints. With the wrenches w_l of all
elements on the links, the Jacobians J_l, gravity and the forces F of the user, the generalized force

    f = sum_l J_l^T (w_l + m_l g) + sum J^T F

vanishes. Newton's matrix is the derivative of -f: sum J^T K J, with K of the elements, the change of the
Jacobians under the forces, and that of forces which follow their link, which is not symmetric. It is exact,
apart from ligaments around ellipsoids. Where not all of its eigenvalues have positive real parts, or the step
would be long, the step is that of the symmetric part with negative curvature reversed, limited in length
along each principal direction.

A step is shortened until f along the step no longer points back, or the potential falls. Forces that follow a
link have no potential. Their work in a step is that of the mean of both ends.

Tendons that act on the bodies are brought to rest at each place, with the bodies held (Relaxation.follow).
Their wrenches are added to f, and the Schur complement of their matrix to K. With friction they have no
potential: the slope of f alone decides, and to go back is no way to where the step began, so that a step is
shortened twice at most. To the next place they are carried by the motion of their particles with the
bodies, at rest, which the same elimination gives; those whose segments it would stretch go with the links
that hold them, or whose bores they are in. A step is as long as one of time in which nothing passes through
anything. Where elements alone give an f that points back, it is shortened before tendons are brought to rest,
with all but the elements' wrenches linear in it.

A joint does not move beyond its limits. Where it is at one, and f points out of it, the limit holds it: it
is left out of the residual and of the step. A step ends where the first joint comes to its limit.

Cartilage moves by a thickness in a step: behind two of them nothing presses, so that no force at all is an
equilibrium too.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
import pybullet as p

from . import _core
from .bodies import Bodies
from .errors import InvalidType, InvalidValue
from .generalized_bodies import (
    is_fixed,
    joint_infos,
    joint_states,
    link_pose,
    movable_joints,
    product,
    rotation_by,
    tree_of,
)

_FARTHEST = 0.05, 0.1  # m or rad that a coordinate moves in a step
_SHORTEST = 1e-3  # share of a step below which it is not shortened further
_LEVER = 0.03  # m: torques count as forces at this arm
_INNER = 0.1  # of the tolerance, to which tendons are brought to rest at each place
_INNER_STEPS = 200  # the most at one place
_MEAN_STEPS = 15  # the most at each place in the mean
_WITH_FRICTION = 2  # times that a step is shortened on which tendons act
_EARTH = 9.81  # m/s^2
_AT_LIMIT = 1e-9  # rad or m from its limit at which a joint is at it
_LEFT = "the next one leads to where `within` does not let them be"
_STIFFEST = 1e-9  # share of the largest curvature to which others are raised


@dataclasses.dataclass
class _Load:
    """Forces on a link: those with directions in the world, as (force, point in the inertial frame); and the
    sum of those that follow it, as force and torque about its centre of mass, in its inertial frame.
    """

    fixed: list = dataclasses.field(default_factory=list)
    following: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(6))

    def wrenches(self, axes) -> np.ndarray:
        """(2, 6) about the centre of mass, world axes: of the fixed and of the following forces."""
        out = np.zeros((2, 6))
        for force, local in self.fixed:
            out[0] += [*force, *_cross(axes @ local, force)]
        out[1] = (self.following.reshape(2, 3) @ axes.T).reshape(-1)
        return out

    def stiffness(self, axes) -> np.ndarray:
        """(3, 3) of the fixed forces' potential by rotation vectors."""
        sums = sum((np.outer(axes @ local, force) for force, local in self.fixed), np.zeros((3, 3)))
        return np.trace(sums) * np.eye(3) - (sums + sums.T) / 2

    def potential(self, centre, axes) -> float:
        return -sum(force @ (centre + axes @ local) for force, local in self.fixed)

    def largest(self) -> float:
        force, torque = np.linalg.norm(self.following[:3]), np.linalg.norm(self.following[3:])
        return max(force, torque / _LEVER, *(np.linalg.norm(fixed) for fixed, _ in self.fixed))


@dataclasses.dataclass
class _Terms:
    """At one place: potential [J], generalized force, the part of it that follows links, its negative
    derivative, and the largest force at hand [N].
    """

    potential: float
    force: np.ndarray
    following: np.ndarray
    matrix: np.ndarray
    largest: float
    twists: np.ndarray  # of the links in slots, by the coordinates (6 k, n)
    of_elements: np.ndarray  # wrenches on these links (k, 6)
    # Where tendons act: the motion of their particles, by the coordinates (n, 3 particles), and the matrix
    # without the stiffness of elements.
    motion: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    of_others: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))


class HeldTendons:
    """Tendons that are at rest wherever the bodies are put."""

    def __init__(self, core: _core.World, tendons, relaxation, gravity):
        self._core, self._tendons, self._relaxation, self._gravity = core, tendons, relaxation, gravity

    def begin(self, slots: list[int], places: int) -> None:
        self._slots, self._most = slots, _INNER_STEPS + _MEAN_STEPS * places
        self._core.want_tendon_stiffness(slots)

    def end(self) -> None:
        self._core.want_tendon_stiffness([])

    def settle(self, tolerance: float, at_hand: float) -> bool:
        """Bring them to rest among the bodies; whether they are, within the steps that are left.

        at_hand: the largest other force on the bodies [N].
        """
        left = min(_INNER_STEPS, self._most - self._relaxation.taken)
        return left > 0 and self._relaxation.follow(self._gravity, _INNER * tolerance, left, at_hand)

    def checkpoint(self) -> _core.Checkpoint:
        """Their state, for take_back."""
        return self._core.checkpoint()

    def take_back(self, to: _core.Checkpoint) -> None:
        """Put them where they were."""
        self._core.return_to(to)

    def wrenches(self) -> np.ndarray:
        """(k, 6) on the links of the slots, about their centres of mass."""
        return self._core.wrenches()[self._slots]

    def stiffness(self) -> np.ndarray:
        """(6 k, 6 k) second derivatives by the twists of these links; zero where there are none."""
        found = self._core.tendon_stiffness()
        return np.zeros((6 * len(self._slots),) * 2) if found is None else found

    def motion(self) -> np.ndarray:
        """(6 k, 3 n) of all particles, by the twists of these links; zero where it is not known."""
        found = self._core.tendon_motion()
        count = sum(len(tendon.masses) for tendon in self._tendons)
        return np.zeros((6 * len(self._slots), 3 * count)) if found is None else found

    def carry(self, motion: np.ndarray) -> None:
        """Move the particles (3 n) with the bodies, which are put elsewhere next."""
        self._core.carry_tendons(motion)

    def largest(self) -> float:
        """Tension [N]."""
        return max(float(np.abs(tendon.tension).max()) for tendon in self._tendons)


class Search(NamedTuple):
    """How a search for the equilibrium ended."""

    steps: int
    residual: float  # over the largest force at hand [-]
    unbalanced: float  # force [N]
    failure: str = ""  # why it ended, where no equilibrium was found
    has_left: bool = False  # whether it ended where it would have left `within`

    @property
    def found(self) -> bool:
        return not self.failure


@dataclasses.dataclass
class _Free:
    """What is free of a body: columns of its degrees of freedom; joints (empty: it is rigid)."""

    body: int
    columns: list[int]
    joints: list[int]
    links: list[int]  # -1 for the base, those that have mass or are touched
    masses: np.ndarray
    infos: tuple  # of joint_infos
    dynamics: list  # p.getDynamicsInfo of `links`
    limits: np.ndarray  # (joints, 2) lower and upper, infinite where there are none
    tree: _core.Articulated | None  # how links hang on joints, where these are all known

    def limits_of_columns(self) -> np.ndarray:
        of_base = np.full((len(self.columns) - len(self.joints), 2), (-np.inf, np.inf))
        return np.concatenate([of_base, self.limits])


class Equilibrium:
    """Finds the equilibrium of the bodies, or (body, joints), that are free.

    free: as given; forces: (body, link, force, point, follows), of which those that follow their link are in
    its inertial frame, others in the world; within: as TendonWorld.relax takes it. Raises InvalidType,
    InvalidValue or UnknownId.
    """

    def __init__(self, bodies: Bodies, core: _core.World, measure, free, gravity, forces, within=None):
        self.tendons: HeldTendons | None = None  # those that act on the bodies
        self._within, self._has_left, self._measure = within, False, measure
        self._bodies, self._core, self._client = bodies, core, bodies.client
        self._gravity = np.array(gravity)
        self._free = [self._checked(entry) for entry in free]
        # (2, n) of all coordinates, lower and upper; a base has none.
        self._limits = np.concatenate([entry.limits_of_columns() for entry in self._free]).T
        found = [entry.body for entry in self._free]
        if len(set(found)) < len(found):
            raise InvalidValue("bodies", free, "bodies that are listed once")
        self._slots = [
            (entry, link, slot)
            for entry in self._free
            for link in entry.links
            if (slot := bodies.find_slot(entry.body, link)) is not None
        ]
        self.slots = [slot for *_, slot in self._slots]  # of the links of the free bodies
        self.free = frozenset(found)
        self._loads: dict[tuple[int, int], _Load] = {}
        for body, link, force, point, follows in forces:
            if body in found:
                load = self._loads.setdefault((body, link), _Load())
                if follows:
                    load.following += [*force, *_cross(point, force)]
                else:
                    centre, axes = self._inertial(body, link)
                    load.fixed.append((np.array(force), axes.T @ (np.array(point) - centre)))
        heaviest = max(float(entry.masses.max()) for entry in self._free)
        told = max((load.largest() for load in self._loads.values()), default=0.0)
        # The largest weight or load [N]. Without gravity too, forces count beside a weight: where all
        # ligaments get slack, they vanish together with the residual.
        self._given = max(heaviest * max(float(np.linalg.norm(gravity)), _EARTH), told)

    def _checked(self, entry) -> _Free:
        is_pair = isinstance(entry, (tuple, list)) and len(entry) == 2
        body, chosen = entry if is_pair else (entry, None)
        self._bodies.require(body, -1, "bodies")
        body, client = int(body), self._client
        infos = joint_infos(body, client)
        movable = movable_joints(body, client, infos)
        links = list(range(-1, p.getNumJoints(body, client)))
        dynamics = [p.getDynamicsInfo(body, link, client) for link in links]
        masses = np.array([info[0] for info in dynamics])
        if not movable:
            if chosen is not None:
                raise InvalidValue("bodies", entry, "a body with joints, or its id alone")
            if masses[0] == 0 or len(links) > 1:
                raise InvalidValue("bodies", entry, "a single body with mass, or one with joints")
            return _Free(body, list(range(6)), [], links, masses, infos, dynamics, np.zeros((0, 2)), None)
        joints = movable if chosen is None else chosen
        if not isinstance(joints, (tuple, list)) or not set(joints) <= set(movable) or not joints:
            raise InvalidValue("bodies", entry, f"(bodyUniqueId, joints) with joints of {movable}")
        kinds = [infos[joint][2] for joint in movable]
        if any(kind not in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC) for kind in kinds):
            raise InvalidValue("bodies", entry, "a body whose joints are hinges and sliders")
        first = 0 if is_fixed(body, client) else 6
        columns = [first + movable.index(joint) for joint in joints]
        if first and chosen is None:
            columns = [*range(6), *columns]
        p.syncBodyInfo(client)  # limits that changeDynamics has changed
        limits = np.array([p.getJointInfo(body, joint, client)[8:10] for joint in joints])
        limits[limits[:, 0] > limits[:, 1]] = -np.inf, np.inf
        tree = tree_of([infos], (bool(first),))
        return _Free(body, columns, list(joints), links, masses, infos, dynamics, limits, tree)

    def _inertial(self, body, link) -> tuple[np.ndarray, np.ndarray]:
        centre, turn = link_pose(body, link, self._client)
        return np.array(centre), np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))

    def _place(self) -> list:
        """Where the bodies are: what _put takes."""
        client = self._client
        return [
            (
                p.getBasePositionAndOrientation(entry.body, client),
                [state[0] for state in p.getJointStates(entry.body, entry.joints, client)]
                if entry.joints
                else [],
            )
            for entry in self._free
        ]

    def _put(self, place: list, step: np.ndarray) -> None:
        """Put the bodies where they were at `place`, moved by `step`, at rest."""
        first, client = 0, self._client
        for entry, ((centre, turn), angles) in zip(self._free, place, strict=True):
            by = step[first : first + len(entry.columns)]
            first += len(entry.columns)
            if len(entry.columns) > len(entry.joints):
                turned = product(rotation_by(by[3:6]), turn)
                p.resetBasePositionAndOrientation(entry.body, (centre + by[:3]).tolist(), turned, client)
                p.resetBaseVelocity(entry.body, (0, 0, 0), (0, 0, 0), physicsClientId=client)
                by = by[6:]
            for joint, angle, change in zip(entry.joints, angles, by, strict=True):
                p.resetJointState(entry.body, joint, angle + change, 0, client)
        self._bodies.read()

    def _terms(self, elements: tuple | None = None) -> _Terms | None:
        """Where the bodies are; None where the tendons do not come to rest.

        elements: the core's terms there.
        """
        slots, tendons = self.slots, self.tendons
        potential, largest, of_elements, stiffness = elements or self._core.element_terms(slots, False)
        wrenches = of_elements
        largest = max(largest, self._given)
        if tendons is not None and not tendons.settle(self._tolerance, largest):
            return None
        if tendons is not None:
            wrenches = wrenches + tendons.wrenches()
            largest = max(largest, tendons.largest())
        size = sum(len(entry.columns) for entry in self._free)
        of_slots, matrix, first = np.zeros((6 * len(slots), size)), np.zeros((size, size)), 0
        force, following = np.zeros((2, size))
        found = _Terms(potential, force, following, matrix, largest, of_slots, of_elements)
        for entry in self._free:
            where = slice(first, first + len(entry.columns))
            first += len(entry.columns)
            jacobians = self._jacobians(entry)
            on_links = np.zeros((2, len(entry.links), 6))  # that have a potential, and that follow
            if self._gravity.any():
                self._weigh(entry, on_links[0], found)
            self._load(entry, jacobians, on_links, where, found)
            for k, (of, link, _) in enumerate(self._slots):
                if of is entry:
                    place = entry.links.index(link)
                    on_links[0, place] += wrenches[k]
                    of_slots[6 * k : 6 * k + 6, where] = jacobians[place]
            found.force[where] = on_links[0].reshape(-1) @ jacobians.reshape(-1, len(entry.columns))
            if on_links[1].any():
                found.following[where] = on_links[1].reshape(-1) @ jacobians.reshape(-1, len(entry.columns))
            floats = len(entry.columns) > len(entry.joints)
            matrix[where, where] += _core.jacobian_curvature(jacobians, on_links, entry.columns, floats)
        if tendons is not None:
            found.motion = of_slots.T @ tendons.motion()
            matrix += of_slots.T @ tendons.stiffness() @ of_slots
            found.of_others = matrix.copy()
        found.force += found.following
        matrix += of_slots.T @ stiffness @ of_slots
        return found

    def _weigh(self, entry: _Free, on_links, terms: _Terms) -> None:
        """Add the weight of a body's links."""
        on_links[:, :3] += entry.masses[:, None] * self._gravity
        for link, (*weight, _, _, _) in zip(entry.links, on_links, strict=True):
            if any(weight):
                terms.potential -= weight @ self._inertial(entry.body, link)[0]

    def _load(self, entry: _Free, jacobians, on_links, where: slice, terms: _Terms) -> None:
        """Add the user's forces on a body."""
        for (body, link), load in self._loads.items():
            if body != entry.body:
                continue
            centre, axes = self._inertial(body, link)
            place = entry.links.index(link)
            on_links[:, place] += load.wrenches(axes)
            if load.fixed:
                turn = jacobians[place, 3:]
                terms.matrix[where, where] += turn.T @ load.stiffness(axes) @ turn
                terms.potential += load.potential(centre, axes)

    def _jacobians(self, entry: _Free) -> np.ndarray:
        if not entry.joints:
            return np.eye(6)[None]
        if entry.tree is None:
            raise InvalidType("bodies", entry.body, "a body on joints that are known")
        state = entry.body, self._client
        bases = [(p.getBasePositionAndOrientation(*state), p.getBaseVelocity(*state))]
        movable = movable_joints(*state, entry.infos)
        joints = joint_states(entry.body, movable, self._client)
        links = [link + 1 for link in entry.links]
        return _core.dynamics(entry.tree, entry.dynamics, bases, joints, links)[0][:, :, entry.columns]

    def find(self, tolerance: float, max_steps: int) -> Search:
        """Look for it.

        Where it is not found, no body has moved, unless the search has left `within`: then they are at its
        last place there.
        """
        start = self._place()
        self._tolerance = tolerance
        if self.tendons is not None:
            self.tendons.begin(self.slots, max_steps)
        try:
            search = self._descend(tolerance, max_steps)
        except BaseException:
            self._put_back(start)
            raise
        finally:
            if self.tendons is not None:
                self.tendons.end()
        if not search.found and not search.has_left:
            self._put_back(start)
        self._core.element_terms(self.slots, True)
        return search

    def _put_back(self, place: list) -> None:
        self._put(place, np.zeros(sum(len(entry.columns) for entry in self._free)))

    def _descend(self, tolerance: float, max_steps: int) -> Search:
        scale = self._scales()
        place = self._place()
        self._put(place, np.clip(0, *self._room(place)))
        self._has_left, at = False, self._terms()
        residual = unbalanced = np.inf
        for count in range(max_steps):
            if at is None:
                why = _LEFT if self._has_left else "tendons on them do not come to rest"
                return Search(count, residual, unbalanced, why, self._has_left)
            place = self._place()
            room = self._room(place)
            free = ~_is_stopped(at.force, room)
            unbalanced = float(np.abs(scale * at.force)[free].max(initial=0))
            residual = unbalanced / max(float(at.largest), 1e-300)
            if residual <= tolerance:
                return Search(count, residual, unbalanced)
            if not (np.isfinite(at.matrix).all() and np.isfinite(at.force).all()):
                return Search(count, residual, unbalanced, "forces or their derivatives are not finite")
            at = self._advance(at, place, _step_within(room, free, at.matrix, at.force, scale))
        return Search(max_steps, residual, unbalanced, "`max_steps` are used up")

    def _room(self, place: list) -> np.ndarray:
        """(2, n) how far coordinates can move, down (<= 0) and up; beyond a limit, the way back to it."""
        at = []
        for entry, (_, places) in zip(self._free, place, strict=True):
            at += [0.0] * (len(entry.columns) - len(entry.joints)) + [*places]
        return self._limits - at

    def _shortened(self, step: np.ndarray, at: _Terms) -> tuple[np.ndarray, np.ndarray]:
        """The step, in which nothing passes through anything, and the motion of particles in it."""
        motion, twists = at.motion, at.twists @ step
        if self.tendons is not None:
            motion = step @ motion
        share = self._core.safe_share(self.slots, twists, motion, self._measure)
        return share * step, share * motion

    def _advance(self, at: _Terms, place: list, step: np.ndarray) -> _Terms | None:
        """Move from a place by a share of the step that is small enough, and find the terms there."""
        before = None if self.tendons is None else self.tendons.checkpoint()
        step, motion = self._shortened(step, at)
        share, ahead, tries = 1.0, at.force @ step, 0
        while True:
            self._put(place, share * step)
            if self._within is not None and not self._within():
                self._put_back(place)
                if self.tendons is not None:
                    self.tendons.take_back(before)
                self._has_left = True
                return None
            elements = self._core.element_terms(self.slots, False)
            if self.tendons is not None:
                back = self._foreseen(at, elements[2], step, share)
                if back < -0.9 * ahead and share >= _SHORTEST:
                    share *= max(0.1, ahead / (ahead - back))
                    continue
                self.tendons.carry(share * motion)
            after = self._terms(elements)
            if after is None:
                if share < _SHORTEST:
                    return None
                share *= 0.25
                self.tendons.take_back(before)
                continue
            shortest = share < _SHORTEST or (self.tendons is not None and tries == _WITH_FRICTION)
            if shortest or self._is_enough(at, after, share * step):
                return after
            back = after.force @ step
            tries += 1
            share *= max(0.1, min(0.5, ahead / (ahead - back))) if back < 0 else 0.5
            if self.tendons is not None:
                self.tendons.take_back(before)

    def _foreseen(self, at: _Terms, of_elements: np.ndarray, step: np.ndarray, share: float) -> float:
        """The force along a step at a share of it, where elements give these wrenches (k, 6).

        Those of tendons, whose rest takes much longer to find, are linear in the share, and so is what loads
        and elements give as links turn.
        """
        by_elements = (of_elements - at.of_elements).reshape(-1) @ (at.twists @ step)
        return at.force @ step + by_elements - share * (step @ at.of_others @ step)

    def _is_enough(self, at: _Terms, after: _Terms, moved: np.ndarray) -> bool:
        """Whether the potential falls in this motion, or the force along it no longer points back."""
        ahead, back = at.force @ moved, after.force @ moved
        if self.tendons is not None:
            return back >= -0.9 * ahead
        work = 0.5 * (at.following + after.following) @ moved
        return after.potential - work <= at.potential - 1e-4 * ahead or abs(back) <= 0.5 * abs(ahead)

    def _scales(self) -> np.ndarray:
        """What makes forces [N] of the generalized forces."""
        out = []
        for entry in self._free:
            kinds = [entry.infos[joint][2] for joint in entry.joints]
            if len(entry.columns) > len(entry.joints):
                out += [1.0] * 3 + [1 / _LEVER] * 3
            out += [1 / _LEVER if kind == p.JOINT_REVOLUTE else 1.0 for kind in kinds]
        return np.array(out)


def _is_stopped(force, room) -> np.ndarray:
    """(n,) whether a force, or a step, points out of a limit that the coordinate is at."""
    low, high = room
    return ((force > 0) & (high <= _AT_LIMIT)) | ((force < 0) & (low >= -_AT_LIMIT))


def _step_within(room, free, matrix, force, scale) -> np.ndarray:
    """Newton's step of the coordinates that are free, up to where the first one comes to its limit."""
    if np.isinf(room).all():
        return _newton_step(matrix, force, scale)
    while True:
        step = np.zeros(len(force))
        if free.all():
            step = _newton_step(matrix, force, scale)
        elif free.any():
            step[free] = _newton_step(matrix[np.ix_(free, free)], force[free], scale[free])
        held = free & _is_stopped(step, room)
        if not held.any():
            break
        free = free & ~held
    moves = step != 0
    ways = np.where(step > 0, room[1], room[0])[moves] / step[moves]
    return step * ways.min(initial=1)


def _newton_step(matrix, force, scale) -> np.ndarray:
    """Newton's step, if all eigenvalues of the matrix have positive real parts and the step is not long.

    Else that of the symmetric part, whose negative and tiny curvatures are replaced, limited in length.
    Each principal direction has a limit of its own: along one in which hardly anything resists, such as the
    spin of a weight about the tendon on which it hangs, the step is long and tells nothing about others.
    """
    scaled = matrix * np.outer(scale, scale)
    farthest = np.where(scale == 1.0, *_FARTHEST)
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    least = _STIFFEST * max(np.abs(values).max(), 1.0)
    # No eigenvalue has a smaller real part than the symmetric part's least one (Bendixson 1902).
    if values[0] > least or np.linalg.eigvals(scaled).real.min() > least:
        step = np.linalg.solve(matrix, force)
        if (np.abs(step) <= farthest).all():
            return step
    values = np.maximum(np.abs(values), least)
    along = vectors * scale[:, None]
    most = 1 / np.abs(along / farthest[:, None]).max(axis=0)
    step = along @ np.clip((along.T @ force) / values, -most, most)
    return step * min(1.0, 1 / np.abs(step / farthest).max()) if step.any() else step


def _cross(a, b) -> list:
    """Of two vectors (3,)."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
