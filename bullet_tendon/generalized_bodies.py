"""Bodies that tendons touch by their generalized coordinates, as the core solves for them.

Owns: what of a body moves (its twist, or the degrees of freedom of base and joints), how that is read from
pybullet at every step, its Jacobians and mass matrix, and changes of its motion after a step. Goes with the
core's room `bodies`; slots are those of bodies.Bodies.

Jacobians and mass matrix are composed from joint axes, poses and masses (Featherstone 2008, chapters 4 and
6): pybullet's own mass matrix keeps the masses and inertias that a body had when it was first asked for, is
not the one that it steps MJCF's humanoid with (2 % off), and its Jacobians know no spherical joints. Where
pybullet has joints of other kinds than fixed, hinge, slider and spherical, every link stands for itself, with
its own mass: the stable side.

Degrees of freedom: of a floating base the velocity (3) of its centre of mass and its spin (3), world axes;
then the joints in pybullet's order: the rate of a hinge or slider, the three rates of a spherical joint about
the axes of its link's inertial frame.

Bodies that constraints of the user join (constraints.py) are solved for as one, with the degrees of freedom
of all bases before those of the joints, and the constraints as rows among them.
"""

import math
from collections.abc import Callable, Collection, Sequence
from functools import lru_cache

import numpy as np
import pybullet as p

from . import _core
from .constraints import Constraint, End
from .contacts import MOST_RATES, Contacts

_KINDS = {
    p.JOINT_REVOLUTE: _core.HINGE,
    p.JOINT_PRISMATIC: _core.SLIDER,
    p.JOINT_SPHERICAL: _core.BALL,
    p.JOINT_FIXED: _core.FIXED,
}
_COUNTS = {p.JOINT_REVOLUTE: 1, p.JOINT_PRISMATIC: 1, p.JOINT_SPHERICAL: 3, p.JOINT_FIXED: 0}  # of rates
_LIMITED = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)
_NEEDS_CONTACTS = 2  # what the core answers where contacts may decide what a body is going to do
_STILL = (0.0, 0.0, 0.0)


def generalized_bodies(
    group: tuple[int, ...], slots: dict[int, dict[int, int]], marks: dict[int, bytes], client: int
) -> "list[RigidBody | JointedBody]":
    """What the core solves for of bodies that move together.

    slots: by body and link, of the links in use. marks: what bodies carry that have slots (bodies.Marks).
    """
    infos = {body: joint_infos(body, client, marks.get(body)) for body in group}
    if len(group) > 1 and not _are_one(infos, client):
        return [
            found
            for body in group
            if body in slots
            for found in generalized_bodies((body,), slots, marks, client)
        ]
    body = group[0]
    if len(group) == 1 and not infos[body]:
        return [RigidBody(slots[body][-1], body, -1, True, client)]
    if len(group) == 1 and tree_of([infos[body]], (False,)) is None:
        return [RigidBody(slot, body, link, False, client) for link, slot in slots[body].items()]
    return [JointedBody(slots, infos, client)]


def _are_one(infos: dict[int, tuple], client: int) -> bool:
    """Whether the core knows the joints of all these bodies, and their rates are not too many."""
    tree = tree_of(list(infos.values()), tuple(not is_fixed(body, client) for body in infos))
    return tree is not None and tree.dofs <= MOST_RATES


def moves(body: int, client: int) -> bool:
    """Whether a body has mass, or joints."""
    return not is_fixed(body, client) or any(info[2] != p.JOINT_FIXED for info in joint_infos(body, client))


def read_link(body: int, link: int, client: int) -> tuple:
    """Dynamics, (centre of mass, orientation of the inertial frame), (velocity, spin), of pybullet."""
    info = p.getDynamicsInfo(body, link, client)
    if link < 0:
        return info, p.getBasePositionAndOrientation(body, client), p.getBaseVelocity(body, client)
    # The link frame that getLinkState reports itself is rounded to single precision.
    state = p.getLinkState(body, link, 1, 1, client)
    return info, state[:2], state[6:]


def link_pose(body: int, link: int, client: int) -> tuple:
    """Centre of mass, and orientation of the inertial frame (4,)."""
    if link < 0:
        return p.getBasePositionAndOrientation(body, client)
    return p.getLinkState(body, link, 0, 1, client)[:2]


def _joining(
    constraints: list[Constraint], bodies: Collection[int], end_of: Callable, client: int
) -> list[tuple]:
    """Constraints among bodies that move together, and with what they do not move, as the core takes them.

    end_of: a function of a constraint and an end of it on one of the bodies: that end as the core takes it,
    or None where the core does not know it.
    """
    found = []
    for c in constraints:
        here = [end.body in bodies for end in c.ends]
        if any(here) and (all(here) or c.kind != _core.GEAR_CONSTRAINT):
            ends = [
                end_of(c, end) if moved else _standing_end(end, client)
                for end, moved in zip(c.ends, here, strict=True)
            ]
            if None not in ends:
                found.append((c.kind, c.most, c.ratio, *ends))
    return found


def _moving_end(end: End, link: int, coordinate: int = -1) -> tuple:
    """An end on a link of the joined bodies, by its number in the core, and the coordinate of its joint."""
    return link, coordinate, end.origin, end.turn, _STILL, _STILL


def _standing_end(end: End, client: int) -> tuple | None:
    """An end in the world, or on a body that nothing moves, with its velocity; None: the body moves."""
    if end.body < 0:
        return -1, -1, end.origin, end.turn, _STILL, _STILL
    if moves(end.body, client):
        return None
    velocity, spin = p.getBaseVelocity(end.body, client)
    origin, turn = p.multiplyTransforms(*link_pose(end.body, end.link, client), end.origin, end.turn)
    arm = np.subtract(origin, p.getBasePositionAndOrientation(end.body, client)[0])
    return -1, -1, origin, turn, tuple(velocity + np.cross(spin, arm)), spin


class RigidBody:
    """A link that moves by itself, where it has mass: a body without joints, or on joints not known."""

    def __init__(self, slot: int, body: int, link: int, falls: bool, client: int):
        self.slot, self.body, self.link, self.falls, self.client = slot, body, link, falls, client
        self.members = (body,)

    def read(self, core, constraints: list[Constraint], contacts: Contacts) -> bool:
        """Where it is, and how it answers, into the core; whether all of that is finite."""
        info, where, motion = read_link(self.body, self.link, self.client)
        found = core.read_link(self.slot, info, where, motion, True, self.falls)
        if constraints and self.falls:
            joining = _joining(constraints, self.members, self._end, self.client)
            core.set_link_constraints(self.slot, joining, where)
        if found == _NEEDS_CONTACTS:
            self._read_contacts(core, where, contacts, keep=False)
        return found > 0

    def _end(self, constraint: Constraint, end: End) -> tuple | None:
        return None if constraint.kind == _core.GEAR_CONSTRAINT else _moving_end(end, 0)

    def keep_contacts(self, core, contacts: Contacts) -> None:
        """Into the state that is going to be saved: after restoreState pybullet has later contacts."""
        if self.falls:
            where = read_link(self.body, self.link, self.client)[1]
            self._read_contacts(core, where, contacts, keep=True)

    def sample(self, core) -> bool:
        """Its motion right after pybullet's step; whether it seems to have been released."""
        return core.sample_link(self.slot, read_link(self.body, self.link, self.client)[2])

    def apply_joint_forces(self, core) -> None:
        """It has no joints."""

    def limit_shifts(self, core) -> list:
        """It has no joints."""
        return []

    def set_rates(self, wanted: np.ndarray, dt: float, shifts: list) -> None:
        """Change its motion as if it had ended the last step, of dt [s], with these rates (6,)."""
        _set_rates(self.members, wanted, dt, self.client)

    def add_force(self, core, body: int, link: int, force: tuple, point: tuple) -> None:
        """Tell the core of a force of the user at a world point, once the body was read."""
        if link == self.link:
            core.add_link_force(self.slot, force, point)

    def add_joint_force(self, core, body: int, joint: int, force: float) -> None:
        """It has no joints that are known."""

    def can_be_held(self, core, contacts: Contacts) -> bool:
        """Whether a joint, a contact or a constraint can hold it."""
        return not self.falls or contacts.can_be_held(self.body)

    def _read_contacts(self, core, where, contacts: Contacts, keep: bool) -> None:
        """What it rests on: contacts with bodies without mass."""
        own = contacts.of(self.body)
        if not own and not keep:
            return
        immovable = [link for link in {(c[2], c[4]): None for c in own} if _has_no_mass(link, self.client)]
        core.set_contacts(self.slot, tuple(own), immovable, where[0], keep)


class _Member:
    """One of the bodies of a JointedBody: its joints, and its place among the links and rates."""

    def __init__(self, body: int, infos: tuple, base: int, first_link: int, first_rate: int, client: int):
        self.body, self.base, self._first_link, self._first_rate = body, base, first_link, first_rate
        self.count = len(infos)  # of joints
        self.joints = movable_joints(body, client, infos)
        self._rates = [info[4] for info in infos]  # of each joint, among the rates of a floating body
        self.rates = sum(_COUNTS[info[2]] for info in infos)  # of joints

    def link(self, link: int) -> int:
        """The number of a link in the tree, by pybullet's index of it."""
        return self.base if link < 0 else self._first_link + link

    def rate(self, joint: int) -> int:
        """The place of a joint among the rates of all joints."""
        return self._first_rate + self._rates[joint] - 6


class JointedBody:
    """Links on joints, fixed or floating, of one body or of several that constraints join."""

    def __init__(self, slots: dict[int, dict[int, int]], infos: dict[int, tuple], client: int):
        self.members, self.client = tuple(infos), client
        self.body = self.members[0]
        self._members: dict[int, _Member] = {}
        links, count = len(infos), 0
        for base, (body, of_joints) in enumerate(infos.items()):
            member = _Member(body, of_joints, base, links, count, client)
            self._members[body] = member
            links, count = links + member.count, count + member.rates
        used = [(b, link, slot) for b in self.members for link, slot in slots.get(b, {}).items()]
        self.slot = used[0][2]
        self._slots = [slot for _, _, slot in used]
        self._links = [self._members[body].link(link) for body, link, _ in used]
        self._used = [(body, link) for body, link, _ in used]
        self._carried = [(m.body, link) for m in self._members.values() for link in range(m.count)]
        self._named = [(body, -1) for body in self.members] + self._carried  # body and link of each link
        self._infos = list(infos.values())
        self._movable = [(m.body, m.joints) for m in self._members.values()]
        self._with_joints = [m.body for m in self._members.values() if m.count]
        self._trees: dict[tuple, _core.Articulated] = {}  # by what floats
        self._take_tree((False,) * len(infos))
        # Of which pybullet reports no forces.
        self._has_hidden_motors = any(i[2] == p.JOINT_SPHERICAL for of in self._infos for i in of)

    def _take_tree(self, floating: tuple[bool, ...]) -> None:
        """Take what floats (by member) for what is read from now on."""
        if floating not in self._trees:
            # Its own: a tree holds where its links are, from a read to the end of the step.
            self._trees[floating] = tree_of(self._infos, floating).copy()
        self._floating, self._tree = floating, self._trees[floating]
        self._yields = any(map(self._tree.moves, self._links))

    def read(self, core, constraints: list[Constraint], contacts: Contacts) -> bool:
        """Where its links are, and how they answer, into the core; whether all of that is finite."""
        client = self.client
        floating = tuple([p.getDynamicsInfo(body, -1, client)[0] > 0 for body in self.members])
        if floating != self._floating:
            self._take_tree(floating)
        if not self._yields:
            links = zip(self._slots, self._used, strict=True)
            found = [core.read_link(s, *read_link(*link, client), False, False) for s, link in links]
            return 0 not in found
        # applyExternalForce takes its arm from where pybullet last computed the links to be: a step ago, but
        # for this.
        for body in self._with_joints:
            p.getLinkState(body, 0, 0, 1, client)
        joining = _joining(constraints, self.members, self._end, client) if constraints else []
        infos, bases, states = self._places()
        finite = core.read_body(self._tree, self._slots, self._links, infos, bases, states, joining)
        self._read_contacts(core, contacts, infos, keep=False)
        return finite

    def _places(self) -> tuple[list, list, tuple]:
        """Dynamics of the links, places and motions of the bases, and states of the joints, now."""
        client, place, motion = self.client, p.getBasePositionAndOrientation, p.getBaseVelocity
        infos = [p.getDynamicsInfo(*link, client) for link in self._named]
        bases = [(place(body, client), motion(body, client)) for body in self.members]
        return infos, bases, self._joint_states()

    def _read_contacts(self, core, contacts: Contacts, infos: list, keep: bool) -> None:
        """Of its members, with each other and with bodies without mass. infos: dynamics of the links."""
        client, pairs = self.client, []
        for body, member in self._members.items():
            between: dict[tuple, list] = {}  # by body and link, and own link
            for c in contacts.of(body):
                between.setdefault((c[2], c[4], c[3]), []).append(c)
            for (other, link, own_link), found in between.items():
                is_named = other in self._members and other < body
                if is_named or (other not in self._members and moves(other, client)):
                    continue
                own, (end, friction) = member.link(own_link), self._touched(other, link, infos)
                pairs.append((own, end, infos[own][1] * friction, tuple(found)))
        core.set_touching(self.slot, self._tree, pairs, keep)

    def _touched(self, body: int, link: int, infos: list) -> tuple[int, float]:
        """The number of a link that a member touches, -1 where it stands, and its coefficient of friction."""
        if body in self._members:
            number = self._members[body].link(link)
            return number, infos[number][1]
        return -1, p.getDynamicsInfo(body, link, self.client)[1]

    def _joint_states(self) -> tuple:
        parts = [joint_states(body, joints, self.client) for body, joints in self._movable]
        return parts[0] if len(parts) == 1 else sum(parts, ())

    def _end(self, constraint: Constraint, end: End) -> tuple | None:
        member = self._members[end.body]
        if constraint.kind != _core.GEAR_CONSTRAINT:
            return _moving_end(end, member.link(end.link))
        if end.link not in member.joints:
            return None
        return _moving_end(end, member.link(end.link), self._coordinate(member, end.link))

    def _coordinate(self, member: _Member, joint: int) -> int:
        """The place of a joint among all rates."""
        return 6 * sum(self._floating) + member.rate(joint)

    def sample(self, core) -> bool:
        """Its rates right after pybullet's step; whether it seems to have been released."""
        bases = [(None, p.getBaseVelocity(body, self.client)) for body in self.members]
        return core.sample_body(self.slot, self._tree, bases, self._joint_states())

    def apply_joint_forces(self, core) -> None:
        """Put on joints what stops them at limits in this step, and what the forces of the motion lack."""
        frame, client = p.WORLD_FRAME, self.client
        for link, parent, force, point, torque in core.joint_forces(self.slot, self._tree):
            for on, sign in ((link, 1), (parent, -1)):
                if on < 0:  # the world, of which a floating base has its freedom
                    continue
                body, index = self._named[on]
                p.applyExternalForce(body, index, [sign * f for f in force], point, frame, client)
                p.applyExternalTorque(body, index, [sign * t for t in torque], frame, client)
        self._shift_joints(self.limit_shifts(core), 1)

    def limit_shifts(self, core) -> list[tuple[int, int, float]]:
        """(body, joint, change) of the joints that are moved to their limits before this step."""
        return [(*self._named[link], by) for link, by in core.limit_shifts(self.slot, self._tree)]

    def _shift_joints(self, shifts: list[tuple[int, int, float]], sign: int) -> None:
        for body, joint, change in shifts:
            place, rate = p.getJointState(body, joint, self.client)[:2]
            p.resetJointState(body, joint, place + sign * change, rate, self.client)

    def set_rates(self, wanted: np.ndarray, dt: float, shifts: list[tuple[int, int, float]]) -> None:
        """Change its motion as if it had ended the last step, of dt [s], with these rates (dofs,).

        shifts: limit_shifts of that step as it was taken.
        """
        self._shift_joints(shifts, -1)
        _set_rates(self.members, wanted, dt, self.client)

    def add_force(self, core, body: int, link: int, force: tuple, point: tuple) -> None:
        """Tell the core of a force of the user on a link at a world point, once the body was read."""
        if self._yields:
            core.add_body_force(self.slot, self._tree, self._members[body].link(link), force, point)

    def add_joint_force(self, core, body: int, joint: int, force: float) -> None:
        """Tell the core of a force [N] or torque [N m] of the user on a joint, once the body was read."""
        if self._yields:
            dof = self._coordinate(self._members[body], joint)
            core.add_joint_force(self.slot, self._tree, dof, force)

    def can_be_held(self, core, contacts: Contacts) -> bool:
        """Whether a joint, a contact or a constraint can hold it."""
        moved = self._has_hidden_motors or core.has_motors(self.slot)
        return moved or any(map(contacts.can_be_held, self.members))

    def keep_contacts(self, core, contacts: Contacts) -> None:
        """Its contacts and what its motors give, into the state that is saved: pybullet restores neither."""
        if self._yields:
            infos, bases, states = self._places()
            _core.place_body(self._tree, infos, bases, states)
            core.keep_motors(self.slot, self._tree, states)
            self._read_contacts(core, contacts, infos, keep=True)


def rates_of_body(body: int, known: dict[tuple[int, int], int | None], client: int) -> int:
    """How many rates a body has; 0: nothing moves it, or it has joints that pybullet tells too little of.

    Those are joints of other kinds than the core knows, and spherical ones: the forces of their motors are
    not reported, but learned, and nothing is learned of bodies whose contacts are known.
    known: the rates of joints that were counted before, by body and number of joints; these are added.
    """
    base = 0 if is_fixed(body, client) else 6
    joints = p.getNumJoints(body, client)
    if joints == 0:
        return base
    key = body, joints
    if key not in known:
        kinds = [info[2] for info in joint_infos(body, client)]
        is_told = set(kinds) <= set(_COUNTS) - {p.JOINT_SPHERICAL}
        known[key] = sum(_COUNTS[kind] for kind in kinds) if is_told else None
    of_joints = known[key]
    return 0 if of_joints is None else base + of_joints


def _has_no_mass(link: tuple[int, int], client: int) -> bool:
    """Whether a link, by body and index, is of a body that nothing moves."""
    return p.getDynamicsInfo(*link, client)[0] == 0


def joint_infos(body, client, mark: bytes | None = None) -> tuple:
    """p.getJointInfo of all joints; remembered for a body that carries a mark (bodies.Marks)."""
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


def jacobians_and_mass(body, links, client, infos=None, known=None) -> tuple[np.ndarray, np.ndarray] | None:
    """J (len(links), 6, dofs) and M (dofs, dofs) of a body where it is now.

    links: indices, -1 for the base. infos: as of joint_infos, where they are known. known: p.getDynamicsInfo
    of the base and of all links, where they are known. Rows of J: velocity of the link's centre of mass, then
    its spin, world axes. M is the sum of J_l^T diag(m_l 1, I_l) J_l over all links. None where a joint is of
    another kind than fixed, hinge, slider and spherical.
    """
    parts = _dynamics(body, links, client, infos, known)
    return parts and parts[:2]


def velocity_force(body, client) -> np.ndarray | None:
    """(dofs,) generalized force [N], [N m] that a body's motion causes by itself.

    Centrifugal, Coriolis and gyroscopic terms (Featherstone 2008, section 5.3) and the joints' damping as it
    was loaded. None as in jacobians_and_mass.
    """
    parts = _dynamics(body, [], client)
    return parts and parts[2]


def _dynamics(body, links, client, infos=None, known=None) -> tuple | None:
    """J, M, and the force of the motion itself (dofs,)."""
    infos = joint_infos(body, client) if infos is None else infos
    dynamics = known or [p.getDynamicsInfo(body, link, client) for link in range(-1, len(infos))]
    tree = tree_of([infos], (dynamics[0][0] > 0,))
    if tree is None:
        return None
    if tree.dofs == 0:
        return np.zeros((len(links), 6, 0)), np.zeros((0, 0)), np.zeros(0)
    base = p.getBasePositionAndOrientation(body, client), p.getBaseVelocity(body, client)
    joints = joint_states(body, movable_joints(body, client, infos), client)
    return _core.dynamics(tree, dynamics, [base], joints, [link + 1 for link in links])


def rates(body, client) -> np.ndarray:
    """(dofs,) velocities of the degrees of freedom now, so that J @ rates is a link's velocity and spin."""
    return rates_of([body], client)


def rates_of(bodies: Sequence[int], client) -> np.ndarray:
    """(dofs,) the same of several bodies: of their bases, then of their joints."""
    floating = [body for body in bodies if not is_fixed(body, client)]
    parts = [part for body in floating for part in p.getBaseVelocity(body, client)]
    for body in bodies:
        parts += [state[1] for state in joint_states(body, movable_joints(body, client), client)]
    return np.array([rate for part in parts for rate in part])


def joint_states(body, joints, client) -> tuple:
    """p.getJointStatesMultiDof of joints, of which there may be none."""
    return p.getJointStatesMultiDof(body, joints, physicsClientId=client) if joints else ()


def is_fixed(body, client) -> bool:
    """Whether nothing moves a body's base."""
    return p.getDynamicsInfo(body, -1, client)[0] == 0


def tree_of(infos: Sequence, floating: tuple[bool, ...]) -> _core.Articulated | None:
    """How the links of bodies hang on their joints, by their joint_infos; None where others than those."""
    joints = [
        tuple([(info[2], info[16], *info[13:16], info[8:10], info[6:7]) for info in of]) for of in infos
    ]
    return _tree(tuple(joints), floating)


@lru_cache(maxsize=256)
def _tree(bodies: tuple, floating: tuple[bool, ...]) -> _core.Articulated | None:
    """bodies: by link its joint's kind, parent link, axis, pivot, turn, limits and damping."""
    kinds, parents, numbers = [], [], []
    for base, joints in enumerate(bodies):
        first = len(bodies) + len(kinds)
        for kind, parent, *places, limits, damping in joints:
            if kind not in _KINDS:
                return None
            kinds.append(_KINDS[kind])
            parents.append(base if parent < 0 else first + parent)
            for part in (*places, limits if kind in _LIMITED else (1, 0), damping):
                numbers += part
    return _core.Articulated(kinds, parents, numbers, floating)


def exchange_wrench(bodies: Sequence[int], jacobian, response, old, new, dt, client) -> None:
    """Change bodies' motion as if the wrench `new` had acted on a link in the last step and not `old`.

    Both (6,), about the link's centre of mass, world frame [N], [N m]. jacobian (6, n), response (n, n): of
    that link and of the bodies that move together at the start of that step, as jacobians_and_mass has them,
    M^-1 without what was stopped. dt: length of that step [s], whose displacement changes too.
    Bodies on joints of other kinds than jacobians_and_mass knows stay as they are.
    """
    infos = [joint_infos(body, client) for body in bodies]
    if tree_of(infos, tuple(not is_fixed(body, client) for body in bodies)) is None:
        return
    now = rates_of(bodies, client)
    took, gives = dt * (response @ (jacobian.T @ np.transpose([old, new]))).T
    most = np.where(np.abs(now) > _core.CUT_OFF_RATE, np.abs(now), np.inf)
    change = gives - np.clip(took, -most, most)  # pybullet cut off what the old wrench gave
    change = np.clip(now + change, -_core.MOST_RATE, _core.MOST_RATE) - now  # and so it does with the new one
    _push(bodies, now, change, dt, client)


def _set_rates(bodies: Sequence[int], wanted, dt, client) -> None:
    now = rates_of(bodies, client)
    _push(bodies, now, np.clip(wanted, -_core.MOST_RATE, _core.MOST_RATE) - now, dt, client)


def _push(bodies: Sequence[int], now, change, dt, client) -> None:
    first = 0
    for body in bodies:
        if not is_fixed(body, client):
            of_base = slice(first, first + 6)
            _push_base(body, now[of_base] + change[of_base], change[of_base], dt, client)
            first += 6
    for body in bodies:
        first += _push_joints(body, change[first:], dt, client)


def change_rates(body, by, dt, client) -> None:
    """Change a free body's motion as if its rates had changed by (6,) more in the last step."""
    _push_base(body, rates(body, client) + by, by, dt, client)


def _push_base(body, motion, change, dt, client) -> None:
    centre, turn = p.getBasePositionAndOrientation(body, client)
    turn = product(rotation_by(dt * change[3:]), turn)
    p.resetBasePositionAndOrientation(body, (centre + dt * change[:3]).tolist(), turn, client)
    p.resetBaseVelocity(body, motion[:3].tolist(), motion[3:].tolist(), physicsClientId=client)


def _push_joints(body, change, dt, client) -> int:
    """The number of its joints' rates, which `change` begins with."""
    joints, first = movable_joints(body, client), 0
    for joint in joints:
        place, rate = p.getJointStateMultiDof(body, joint, client)[:2]
        by = change[first : first + len(rate)]
        first += len(rate)
        if len(rate) == 1:
            p.resetJointState(body, joint, place[0] + dt * by[0], rate[0] + by[0], client)
        else:
            place = product(place, rotation_by(dt * by))
            p.resetJointStateMultiDof(body, joint, place, (rate + by).tolist(), client)
    return first


def rotation_by(vector) -> tuple:
    """Quaternion (x, y, z, w) of a rotation vector (3,)."""
    angle = float(np.linalg.norm(vector))
    half = 0.5 * np.sinc(angle / (2 * math.pi))  # sin(angle / 2) / angle
    return (*(half * vector).tolist(), math.cos(angle / 2))


def product(a, b) -> tuple:
    """Quaternion product a b, rotation b first; pybullet's own rounds to single precision."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
