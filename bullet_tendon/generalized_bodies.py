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
"""

import math
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
_NEEDS_CONTACTS = 2  # what the core answers where contacts may decide what a body is going to do
_TOUCHING = 0.002  # m: bodies at rest on each other are within it; contact points are kept for longer


def generalized_bodies(
    body: int, slots: dict[int, int], mark: bytes, client: int
) -> "list[RigidBody | JointedBody]":
    """What the core solves for of a body. slots: by link; mark: what the body carries (bodies.Marks)."""
    infos = joint_infos(body, client, mark)
    if not infos:
        return [RigidBody(slots[-1], body, -1, True, client)]
    if tree_of(infos, False) is None:
        return [RigidBody(slot, body, link, False, client) for link, slot in slots.items()]
    return [JointedBody(body, slots, infos, client)]


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


class RigidBody:
    """A link that moves by itself, where it has mass: a body without joints, or on joints not known."""

    def __init__(self, slot: int, body: int, link: int, falls: bool, client: int):
        self.slot, self.body, self.link, self.falls, self.client = slot, body, link, falls, client

    def read(self, core) -> bool:
        """Where it is, and how it answers, into the core; whether all of that is finite."""
        info, where, motion = read_link(self.body, self.link, self.client)
        found = core.read_link(self.slot, info, where, motion, True, self.falls)
        if found == _NEEDS_CONTACTS:
            self._read_contacts(core, where, keep=False)
        return found > 0

    def keep_contacts(self, core) -> None:
        """Into the state that is going to be saved: after restoreState pybullet has later contacts."""
        if self.falls:
            self._read_contacts(core, read_link(self.body, self.link, self.client)[1], keep=True)

    def sample(self, core) -> bool:
        """Its motion right after pybullet's step; whether it seems to have been released."""
        return core.sample_link(self.slot, read_link(self.body, self.link, self.client)[2])

    def apply_joint_forces(self, core) -> None:
        """It has no joints."""

    def add_force(self, core, link: int, force: tuple, point: tuple) -> None:
        """Tell the core of a force of the user at a world point, once the body was read."""
        if link == self.link:
            core.add_link_force(self.slot, force, point)

    def add_joint_force(self, core, joint: int, force: float) -> None:
        """It has no joints that are known."""

    def can_be_held(self, core) -> bool:
        """Whether a joint, a contact or a constraint can hold it."""
        return not self.falls or _can_be_held(self.body, self.client)

    def _read_contacts(self, core, where, keep: bool) -> None:
        """What it rests on: contacts with bodies without mass."""
        client = self.client
        points = p.getContactPoints(bodyA=self.body, physicsClientId=client)
        immovable = [other for other in {(c[2], c[4]): None for c in points} if _has_no_mass(other, client)]
        core.set_contacts(self.slot, points, immovable, where[0], keep)


class JointedBody:
    """Links of a body on joints, fixed or floating."""

    def __init__(self, body: int, slots: dict[int, int], infos: tuple, client: int):
        self.body, self.client = body, client
        self.slot = next(iter(slots.values()))
        self._slots, self._links = list(slots.values()), [link + 1 for link in slots]
        self._joints = movable_joints(body, client, infos)
        self._rates = [
            info[4] for info in infos
        ]  # of each joint, its place among the rates of a floating body
        self._trees = [tree_of(infos, floating) for floating in (False, True)]
        self._tree = self._trees[0]  # of these, the one that was read last
        # Of which pybullet reports no forces.
        self._has_hidden_motors = any(info[2] == p.JOINT_SPHERICAL for info in infos)
        self._yields = [any(tree.moves(link) for link in self._links) for tree in self._trees]

    def read(self, core) -> bool:
        """Where its links are, and how they answer, into the core; whether all of that is finite."""
        body, client = self.body, self.client
        info = p.getDynamicsInfo(body, -1, client)
        floating = info[0] > 0
        if not self._yields[floating]:
            links = zip(self._slots, self._links, strict=True)
            found = [core.read_link(s, *read_link(body, i - 1, client), False, False) for s, i in links]
            return 0 not in found
        self._tree = tree = self._trees[floating]
        # applyExternalForce takes its arm from where pybullet last computed the links to be: a step ago, but
        # for this.
        p.getLinkState(body, 0, 0, 1, client)
        base = p.getBasePositionAndOrientation(body, client), p.getBaseVelocity(body, client)
        infos = [info, *[p.getDynamicsInfo(body, link, client) for link in range(tree.links - 1)]]
        joints = joint_states(body, self._joints, client)
        return core.read_body(tree, self._slots, self._links, infos, *base, joints)

    def sample(self, core) -> bool:
        """Its rates right after pybullet's step; whether it seems to have been released."""
        body, client = self.body, self.client
        motion = p.getBaseVelocity(body, client)
        return core.sample_body(self.slot, self._tree, motion, joint_states(body, self._joints, client))

    def apply_joint_forces(self, core) -> None:
        """Put on joints what stops them at limits in this step, and what the forces of the motion lack."""
        frame, client = p.WORLD_FRAME, self.client
        for link, parent, force, point, torque in core.joint_forces(self.slot, self._tree):
            for on, sign in ((link, 1), (parent, -1)):
                if on < -1:  # the world, of which a floating base has its freedom
                    continue
                p.applyExternalForce(self.body, on, [sign * f for f in force], point, frame, client)
                p.applyExternalTorque(self.body, on, [sign * t for t in torque], frame, client)
        self._shift_joints(self.limit_shifts(core), 1)

    def limit_shifts(self, core) -> list[tuple[int, float]]:
        """(joint, change) of the joints that are moved to their limits before this step."""
        return core.limit_shifts(self.slot, self._tree)

    def _shift_joints(self, shifts: list[tuple[int, float]], sign: int) -> None:
        for joint, change in shifts:
            place, rate = p.getJointState(self.body, joint, self.client)[:2]
            p.resetJointState(self.body, joint, place + sign * change, rate, self.client)

    def set_rates(self, wanted: np.ndarray, dt: float, shifts: list[tuple[int, float]]) -> None:
        """Change its motion as if it had ended the last step, of dt [s], with these rates (dofs,).

        shifts: limit_shifts of that step as it was taken.
        """
        self._shift_joints(shifts, -1)
        now = rates(self.body, self.client)
        _push(self.body, now, np.clip(wanted, -_core.MOST_RATE, _core.MOST_RATE) - now, dt, self.client)

    def add_force(self, core, link: int, force: tuple, point: tuple) -> None:
        """Tell the core of a force of the user on a link at a world point, once the body was read."""
        if self._yields[self._tree is self._trees[True]]:
            core.add_body_force(self.slot, self._tree, link + 1, force, point)

    def add_joint_force(self, core, joint: int, force: float) -> None:
        """Tell the core of a force [N] or torque [N m] of the user on a joint, once the body was read."""
        floating = self._tree is self._trees[True]
        if self._yields[floating]:
            core.add_joint_force(self.slot, self._tree, self._rates[joint] - (0 if floating else 6), force)

    def can_be_held(self, core) -> bool:
        """Whether a joint, a contact or a constraint can hold it."""
        moved = self._has_hidden_motors or core.has_motors(self.slot)
        return moved or _can_be_held(self.body, self.client)

    def keep_contacts(self, core) -> None:
        """What its motors give, into the state that is going to be saved: pybullet does not restore that."""
        if self._yields[self._tree is self._trees[True]]:
            core.keep_motors(self.slot, self._tree, joint_states(self.body, self._joints, self.client))


def can_be_hit(body: int, client: int) -> bool:
    """Whether any other body is near, or it has constraints; whatever contacts pybullet still lists."""
    others = {p.getBodyUniqueId(i, client) for i in range(p.getNumBodies(client))}
    return _has_constraints(body, client) or _is_near(body, others - {body}, client)


def _can_be_held(body: int, client: int) -> bool:
    """Whether another body touches it, or it has constraints.

    pybullet's restoreState leaves contacts of later times behind.
    """
    if _has_constraints(body, client):
        return True
    return _is_near(body, {c[2] for c in p.getContactPoints(bodyA=body, physicsClientId=client)}, client)


def _has_constraints(body: int, client: int) -> bool:
    """Whether a constraint joins it to another body or to the world."""
    ids = [p.getConstraintUniqueId(i, client) for i in range(p.getNumConstraints(client))]
    infos = [p.getConstraintInfo(constraint, client) for constraint in ids]
    return any(body in (info[0], info[2]) for info in infos)


def _is_near(body: int, others: set[int], client: int) -> bool:
    return any(p.getClosestPoints(body, o, _TOUCHING, physicsClientId=client) for o in others)


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
    tree = tree_of(infos, dynamics[0][0] > 0)
    if tree is None:
        return None
    if tree.dofs == 0:
        return np.zeros((len(links), 6, 0)), np.zeros((0, 0)), np.zeros(0)
    base = p.getBasePositionAndOrientation(body, client), p.getBaseVelocity(body, client)
    joints = joint_states(body, movable_joints(body, client, infos), client)
    return _core.dynamics(tree, dynamics, *base, joints, [link + 1 for link in links])


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
    return _tree(
        tuple([(info[2], info[16], *info[13:16], info[8:10], info[6:7]) for info in infos]), floating
    )


@lru_cache(maxsize=256)
def _tree(joints: tuple, floating: bool) -> _core.Articulated | None:
    """joints: of every link its joint's kind, parent link, axis, pivot, turn, limits and damping."""
    if any(kind not in _KINDS for kind, *_ in joints):
        return None
    numbers = []
    for kind, _, *places, limits, damping in joints:
        parts = (*places, limits if kind in _LIMITED else (1, 0), damping)
        numbers += [v for part in parts for v in part]
    parents = [parent + 1 for _, parent, *_ in joints]
    return _core.Articulated([_KINDS[joint[0]] for joint in joints], parents, numbers, floating)


def exchange_wrench(body, jacobian, response, old, new, dt, client, stopped=()) -> None:
    """Change a body's motion as if the wrench `new` had acted on a link in the last step and not `old`.

    Both (6,), about the link's centre of mass, world frame [N], [N m]. jacobian (6, n), response (n, n): of
    that link and of the body at the start of that step, as jacobians_and_mass has them, M^-1. dt: length of
    that step [s], whose displacement changes too. stopped: degrees of freedom that do not answer.
    Bodies on joints of other kinds than jacobians_and_mass knows stay as they are.
    """
    if tree_of(joint_infos(body, client), not is_fixed(body, client)) is None:
        return
    now = rates(body, client)
    if len(stopped):
        through = response[:, stopped]
        response = response - through @ np.linalg.solve(response[np.ix_(stopped, stopped)], through.T)
    took, gives = dt * (response @ (jacobian.T @ np.transpose([old, new]))).T
    most = np.where(np.abs(now) > _core.CUT_OFF_RATE, np.abs(now), np.inf)
    change = gives - np.clip(took, -most, most)  # pybullet cut off what the old wrench gave
    change = np.clip(now + change, -_core.MOST_RATE, _core.MOST_RATE) - now  # and so it does with the new one
    _push(body, now, change, dt, client)


def _push(body, now, change, dt, client) -> None:
    if not is_fixed(body, client):
        _push_base(body, now[:6] + change[:6], change[:6], dt, client)
        change = change[6:]
    _push_joints(body, change, dt, client)


def change_rates(body, by, dt, client) -> None:
    """Change a free body's motion as if its rates had changed by (6,) more in the last step."""
    _push_base(body, rates(body, client) + by, by, dt, client)


def _push_base(body, motion, change, dt, client) -> None:
    centre, turn = p.getBasePositionAndOrientation(body, client)
    turn = product(rotation_by(dt * change[3:]), turn)
    p.resetBasePositionAndOrientation(body, (centre + dt * change[:3]).tolist(), turn, client)
    p.resetBaseVelocity(body, motion[:3].tolist(), motion[3:].tolist(), physicsClientId=client)


def _push_joints(body, change, dt, client) -> None:
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
