"""Bodies: the links that tendons can touch, as pybullet has them and as the core numbers them.

Owns: the slots of links, and the marks by which a body is known again. Reads poses, velocities and inertias
into the core, and puts the core's wrenches on the links. With generalized_bodies, all that talks to pybullet
about motion. Goes with the core's room `bodies`.

pybullet gives base poses at the centre of mass; the frames of URDFs, which tunnels and attachments use,
differ from them by the inertial offset.
"""

import itertools
import os
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
import pybullet as p

from . import _core, checks
from .constraints import Constraint, groups, read_constraints
from .contacts import Contacts, bodies_of
from .errors import InertiaWarning, InvalidValue, UnknownId, warn
from .generalized_bodies import (
    change_rates,
    exchange_wrench,
    generalized_bodies,
    link_pose,
    moves,
    rates_of_body,
    read_link,
)

_MOST_CLIENTS = 2**31 - 1  # what pybullet can be asked for
_SOFT_BODY = 3  # type of a body in getDynamicsInfo
_TURNING = p.JOINT_REVOLUTE, p.JOINT_SPHERICAL
_WAKE = 0.5  # pybullet puts a body to sleep that was slow for 2 s [s]
_KEY = "bullet_tendon"  # of the user data that marks a body
_PROCESS = os.urandom(8).hex()
_numbers = itertools.count()  # its next() is one operation, whatever threads there are


def client_of(physicsClientId) -> int:
    """The number of a client: an int, or a pybullet_utils BulletClient."""
    number = getattr(physicsClientId, "_client", physicsClientId)
    askable = isinstance(number, int) and not isinstance(number, bool) and 0 <= number <= _MOST_CLIENTS
    if not (askable and p.isConnected(number)):
        raise UnknownId("physicsClientId", physicsClientId, "a connected pybullet client")
    return number


def checked_body(body, client: int, argument: str = "bodyUniqueId") -> int:
    """The id of a body of a connected client. Raises UnknownId for anything else."""
    known = bodies_of(client)
    if not isinstance(body, (int, np.integer)) or isinstance(body, bool) or body not in known:
        raise UnknownId(argument, body, f"the id of a body of this client: {known}")
    return int(body)


class Marks:
    """Marks on the bodies of one client, by which an id is known to mean the same body still.

    pybullet gives the ids of removed bodies to others (all of them after resetSimulation), so every body that
    tendons refer to gets a mark, as pybullet user data: it goes when its body goes, and a body that has the
    id next does not carry it.
    """

    def __init__(self, client: int):
        self._client = client

    def mark(self, body: int) -> tuple[int, bytes]:
        """The body's mark, made where it has none: the user data's id and its value."""
        number = p.getUserDataId(body, _KEY, physicsClientId=self._client)
        if number < 0:
            value = f"{_PROCESS}-{next(_numbers)}"
            number = p.addUserData(body, _KEY, value, physicsClientId=self._client)
        return number, p.getUserData(number, self._client)

    def all_hold(self, marks) -> bool:
        """Whether all bodies that carry these marks are still there."""
        value_of, client = p.getUserData, self._client
        return all(value_of(number, client) == value for number, value in marks)

    def holds(self, mark: tuple[int, bytes]) -> bool:
        """Whether the body that carries the mark is still there."""
        return p.getUserData(mark[0], self._client) == mark[1]


class Bodies:
    """The links that tendons can touch, in slots numbered as the core numbers them.

    client: the number of a pybullet client. core: the compiled world. in_use: a function that tells the slots
    of the links that something refers to.
    """

    def __init__(self, client: int, core: _core.World, in_use: Callable[[], set[int]]):
        self.client = client
        self._core = core
        self._in_use = in_use
        self.links: list[tuple[int, int]] = []
        self._slots: dict[tuple[int, int], int] = {}
        self._bodies: list | None = None  # generalized, of the links in use
        self._members: dict[int, tuple[int, ...]] = {}  # of the generalized bodies, by slot
        self._joined: dict[int, tuple[int, bytes]] = {}  # marks of bodies that move together with others
        self._moved_together: list[tuple[int, ...]] = []  # the same in the last step
        self._contacts = Contacts(client)
        self._touching: list[tuple[int, int]] = []  # bodies that touch each other
        self._movable: dict[int, int] = {}  # bodies that are used, and that something moves: with their rates
        self._rates: dict[tuple[int, int], int | None] = {}  # see rates_of_body
        self._constraints: list[Constraint] = []  # of the user, as they were read last
        self._marks = Marks(client)
        self._mark_of: list[tuple[int, bytes]] = []
        self._told: set[tuple[bytes, int]] = set()  # of which it was told that they do not turn
        self._updated: set[bytes] = set()  # marks of bodies whose joints were updated
        self._unused: set[int] = set()
        self._external: list[tuple[int, int, tuple, tuple]] = []  # body, link, force, point
        self._joint_forces: list[tuple[int, int, float]] = []  # body, joint, force or torque
        self._awake: set[int] = set()  # bodies on which wrenches acted in the last step
        self._since_woken = 0.0  # [s]
        self.revision = 0  # of what slots mean

    def require_client(self) -> None:
        """Raise UnknownId where the client was disconnected."""
        if not p.isConnected(self.client):
            raise UnknownId("physicsClientId", self.client, "a connected pybullet client")

    def require(self, body: int, link: int, argument: str = "bodyUniqueId") -> None:
        """Raise UnknownId unless the body has that link (-1: its base), InvalidValue if it is soft.

        pybullet's pose of a soft body is no frame, and its mass is a number from anywhere.
        """
        self.require_client()
        if p.getDynamicsInfo(checked_body(body, self.client, argument), -1, self.client)[10] == _SOFT_BODY:
            raise InvalidValue(argument, body, "a body with links: a soft one has neither frame nor mass")
        count = p.getNumJoints(int(body), self.client)
        if not isinstance(link, (int, np.integer)) or isinstance(link, bool) or not -1 <= link < count:
            raise UnknownId("linkIndex", link, f"an integer from -1 to {count - 1} for body {body}")

    def require_joint(self, body: int, joint: int) -> None:
        """Raise UnknownId unless the body has that joint, InvalidValue unless it is a hinge or a slider."""
        self.require(body, -1)
        count = p.getNumJoints(int(body), self.client)
        if checks.integer("jointIndex", joint) not in range(count):
            raise UnknownId("jointIndex", joint, f"an integer from 0 to {count - 1} for body {body}")
        if p.getJointInfo(int(body), int(joint), self.client)[2] not in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
            raise InvalidValue("jointIndex", joint, "a hinge or a slider")

    def slot(self, body: int, link: int) -> int:
        """The slot of a link, made where there is none."""
        key = (int(body), int(link))
        known = self.find_slot(*key)
        if known is not None:
            return known
        mark = self._marks.mark(key[0])
        self._bodies = None
        self.revision += 1
        if self._unused:
            slot = min(self._unused)
            self._unused.discard(slot)
            self._core.clear_link(slot)
            self.links[slot], self._mark_of[slot] = key, mark
        else:
            slot = len(self.links)
            self.links.append(key)
            self._mark_of.append(mark)
        self._slots[key] = slot
        return slot

    def find_slot(self, body: int, link: int) -> int | None:
        """The slot of a link; None where there is none, or it is of a body that had this id before."""
        slot = self._slots.get((body, link))
        return None if slot is None or self.is_gone(slot) else slot

    def is_gone(self, slot: int) -> bool:
        """Whether the body that a slot was made for was removed from pybullet."""
        return not self._marks.holds(self._mark_of[slot])

    def require_same(self, slots: Iterable[int]) -> None:
        """Raise UnknownId where a body that one of these slots was made for was removed."""
        self.require_client()
        for slot in slots:
            if self.is_gone(slot):
                raise UnknownId("bodyUniqueId", self.links[slot][0], "a body that was not removed")

    def slots_of(self, body: int) -> set[int]:
        return {s for (b, _), s in self._slots.items() if b == body and not self.is_gone(s)}

    def marks_read(self) -> set[tuple[int, bytes]]:
        """The marks of bodies without which `read` raises, or changes what slots mean."""
        return {self._mark_of[slot] for slot in self._used()}

    def marked_links(self) -> tuple:
        """Body, link and the body's mark by slot; None for slots not in use."""
        marked = [(*key, mark[1]) for key, mark in zip(self.links, self._mark_of, strict=True)]
        for slot in self._unused:
            marked[slot] = None
        while marked and marked[-1] is None:
            marked.pop()
        return tuple(marked)

    def read(self) -> None:
        """Into the core: where links are and how they answer.

        Raises UnknownId where a body was removed from pybullet that something here refers to, and
        InvalidValue where pybullet has no finite pose, velocity or inertia for one.
        """
        self.require_alive()
        for slot in self._unused:
            self._core.clear_link(slot)
        self._leave_removed()
        before = list(self._members.values())
        self._read_constraints()
        self._read_touching()
        self._moved_together = before if self._members else []  # none: a state was restored
        for body in self._generalized():
            if not body.read(self._core, self._constraints, self._contacts):
                allowed = "a body with finite pose, velocity and inertia"
                raise InvalidValue("bodyUniqueId", body.body, allowed)
            for body_id, link, force, point in self._external:
                if body_id in body.members:
                    body.add_force(self._core, body_id, link, force, point)
            for body_id, joint, force in self._joint_forces:
                if body_id in body.members:
                    body.add_joint_force(self._core, body_id, joint, force)

    def _read_constraints(self) -> None:
        """Those of the user; bodies move together otherwise where there are others."""
        before, now = self._constraints, read_constraints(self.client)
        self._constraints = now
        if (now or before) and [c.joins for c in now] != [c.joins for c in before]:
            self._bodies = None

    def _read_touching(self) -> None:
        """The bodies that touch each other; bodies move together otherwise where these are others."""
        self._begin_contacts()
        kept = self._core.kept_touching()
        if kept is None:
            found = self._contacts.pairs(self._movable, self._rates_of)
            if found != self._touching and self.sample():
                return  # what is known of it is needed once more
        else:
            there = set(bodies_of(self.client))
            found = [pair for pair in zip(kept[::2], kept[1::2], strict=True) if there.issuperset(pair)]
            self._members.clear()  # what the core has learned is of these
        if found != self._touching:
            self._touching = found
            self._bodies = None

    def _leave_removed(self) -> None:
        """Let nothing move together with a body that was removed, or with another one that has its id now."""
        gone = {body for body, mark in self._joined.items() if not self._marks.holds(mark)}
        if not gone:
            return
        for slot, members in self._members.items():
            if not gone.isdisjoint(members):
                self._core.forget_body(slot)
        self._touching = [pair for pair in self._touching if gone.isdisjoint(pair)]
        self._constraints = read_constraints(self.client)
        self._bodies = None

    def _begin_contacts(self) -> None:
        self._generalized()
        self._contacts.begin(moved=bool(self._movable))

    def _rates_of(self, body: int) -> int:
        return rates_of_body(body, self._rates, self.client)

    def rest(self) -> None:
        """Tendons, or bodies, were put in equilibrium: the next step begins with the forces there.

        Raises what read raises.
        """
        self.read()
        self._core.rest_bodies()

    def sample(self) -> bool:
        """Motion of what is held, right after pybullet's step; whether any of it seems to be released."""
        held = self._core.held_bodies()
        released = [body.sample(self._core) for body in self._generalized() if body.slot in held]
        return any(released)

    def keep_contacts(self) -> None:
        """What free bodies rest on becomes part of the core's state."""
        if p.isConnected(self.client) and not any(map(self.is_gone, self._used())):
            self._leave_removed()
            self._begin_contacts()
            for body in self._generalized():
                body.keep_contacts(self._core, self._contacts)
            touching = self._contacts.pairs(self._movable, self._rates_of)
            self._core.keep_touching([body for pair in touching for body in pair])

    def _used(self) -> list[int]:
        return [slot for slot in range(len(self.links)) if slot not in self._unused]

    def _generalized(self) -> list:
        """The bodies of the links in use; slots do not change what they mean while they are."""
        if self._bodies is None:
            self._update_joints()
            slots: dict[int, dict[int, int]] = {}
            marks: dict[int, bytes] = {}
            for slot in self._used():
                body, link = self.links[slot]
                slots.setdefault(body, {})[link] = slot
                marks[body] = self._mark_of[slot][1]
            together = groups(slots, self._constraints, self._touching, partial(moves, client=self.client))
            self._bodies = [
                found for group in together for found in generalized_bodies(group, slots, marks, self.client)
            ]
            joined = [body for group in together if len(group) > 1 for body in group]
            self._joined = {body: self._marks.mark(body) for body in joined}
            self._rates = {}
            counts = {body: self._rates_of(body) for body in slots}
            self._movable = {body: count for body, count in counts.items() if count > 0}
            self._forget_others()
            self._tell_unturned(marks)
        return self._bodies

    def _tell_unturned(self, marks: dict[int, bytes]) -> None:
        """An InertiaWarning for each base and link on a hinge, of bodies of these marks, without inertia."""
        links = {(body, -1) for body in marks} | {self.links[slot] for slot in self._used()}
        for body, link in sorted(links):
            if (marks[body], link) not in self._told and self._is_unturned(body, link):
                self._told.add((marks[body], link))
                mass = p.getDynamicsInfo(body, link, self.client)[0]
                what = f"body {body}, link {link} has a mass of {mass:g} kg and no inertia"
                how = "pybullet does not turn it about its centre of mass"
                warn(InertiaWarning(f"{what}: {how} (see changeDynamics, localInertiaDiagonal=)"))

    def _is_unturned(self, body: int, link: int) -> bool:
        """Whether it has mass and a shape and could turn, but for want of inertia."""
        if link >= 0 and p.getJointInfo(body, link, self.client)[2] not in _TURNING:
            return False
        mass, _, inertia = p.getDynamicsInfo(body, link, self.client)[:3]
        return mass > 0.0 and not any(inertia) and bool(p.getCollisionShapeData(body, link, self.client))

    def _forget_others(self) -> None:
        """What was learned of a body is not that of another one, or of more bodies."""
        members = {body.slot: body.members for body in self._bodies or ()}
        for slot, known in self._members.items():
            if members.get(slot, known) != known:
                self._core.forget_body(slot)
        self._members = members

    def _update_joints(self) -> None:
        """Make pybullet report joints as they are, where bodies are new; else it does as they were loaded."""
        found = {self._mark_of[slot][1] for slot in self._used()}
        if not found <= self._updated:
            p.syncBodyInfo(self.client)
            p.syncUserData(physicsClientId=self.client)  # else the marks of removed bodies stay
        self._updated = found

    def forget(self, slots: set[int]) -> None:
        """Read and push links no more: nothing refers to them."""
        self._unused |= slots
        self._slots = {key: slot for key, slot in self._slots.items() if slot not in slots}
        self._bodies = None
        self.revision += 1

    def require_alive(self) -> None:
        """Forget bodies that were removed and that nothing refers to; raise UnknownId for others."""
        if self._marks.all_hold(self._mark_of):
            return
        gone = {s for s in self._used() if self.is_gone(s)}
        for slot in sorted(gone & self._in_use()):
            body = self.links[slot][0]
            raise UnknownId("bodyUniqueId", body, "a body that was not removed: release what refers to it")
        if gone:
            self.forget(gone)

    def frame(self, body: int, link: int) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) and axes (3, 3) of the URDF link frame in the world."""
        return _core.link_frame(*read_link(int(body), int(link), self.client)[:2])

    def checked_frame(self, body: int, link: int) -> tuple[np.ndarray, np.ndarray]:
        """frame, or UnknownId where the client was disconnected or the link does not exist."""
        self.require(body, link)
        return self.frame(body, link)

    def lateral_friction(self, body: int, link: int) -> float:
        """pybullet's coefficient of a link now [-]. Raises what require raises."""
        self.require(body, link)
        return p.getDynamicsInfo(body, link, self.client)[1]

    def apply_wrenches(self, dt: float) -> None:
        """Put the core's wrenches on the links that answer to them, and the forces of limits on joints.

        dt: length of the step [s].
        """
        pushed = set()
        for slot, force, point, torque in self._core.pushes():
            body, link = self.links[slot]
            pushed.add(body)
            p.applyExternalForce(body, link, force, point, p.WORLD_FRAME, self.client)
            if torque is not None:
                p.applyExternalTorque(body, link, torque, p.WORLD_FRAME, self.client)
        self._keep_awake(pushed, dt)
        for body in self._generalized():
            body.apply_joint_forces(self._core)

    def _keep_awake(self, pushed: set[int], dt: float) -> None:
        """A force does not wake a body that pybullet has put to sleep, where sleeping is enabled for it."""
        sleepy = pushed - self._awake
        self._awake = pushed
        self._since_woken += dt
        if self._since_woken > _WAKE:
            sleepy = pushed
            self._since_woken = 0.0
        for body in sleepy:
            awake = p.ACTIVATION_STATE_WAKE_UP
            p.changeDynamics(body, -1, activationState=awake, physicsClientId=self.client)

    def apply_external_force(self, body: int, link: int, force, point, in_link: bool) -> None:
        """Put a force [N] of the user on a link for pybullet's next step, and tell the next reads of it.

        in_link: force and point (3,) are in the link's inertial frame, else in the world's.
        """
        # pybullet takes the arm from where it last computed the link to be: of its last step, but for this.
        centre, turn = link_pose(body, link, self.client)
        if in_link:
            axes = np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))
            force, point = axes @ force, centre + axes @ point
        force, point = tuple(map(float, force)), tuple(map(float, point))
        p.applyExternalForce(body, link, force, point, p.WORLD_FRAME, self.client)
        self._external.append((body, link, force, point))

    def apply_joint_force(self, body: int, joint: int, force: float) -> None:
        """Put a force [N] or torque [N m] on a slider or hinge, and tell the next reads of it."""
        mode = p.TORQUE_CONTROL
        p.setJointMotorControl2(body, joint, mode, force=force, physicsClientId=self.client)
        self._joint_forces.append((body, joint, force))

    @property
    def external_forces(self) -> tuple:
        """(body, link, force, point) of the forces that the user has told for the next step."""
        return tuple(self._external)

    def forget_external_forces(self) -> None:
        """The step that they were for has been solved."""
        self._external.clear()
        self._joint_forces.clear()

    def unheld(self) -> list[int]:
        """Slots of the bodies that were held, and that no joint, contact or constraint can hold now."""
        held = self._core.held_bodies()
        bodies = [body for body in self._generalized() if body.slot in held] if held else []
        return [body.slot for body in bodies if not body.can_be_held(self._core, self._contacts)]

    def was_free(self, slot: int) -> bool:
        """Whether neither a contact nor a constraint had a part in how a body without joints moved."""
        return not self._contacts.can_be_hit(self.links[slot][0])

    def change_rates(self, slot: int, by: np.ndarray, dt: float) -> None:
        """Change a free body's motion as if its rates had changed by more in the last step, of dt [s].

        by (6,): velocity of its centre of mass and spin, world frame [m/s], [rad/s].
        """
        change_rates(self.links[slot][0], by, dt, self.client)

    def jointed(self, slot: int):
        """The body that the core solves for in this slot."""
        return next(body for body in self._generalized() if body.slot == slot)

    def exchange_wrench(self, slot: int, old: np.ndarray, new: np.ndarray, dt: float) -> None:
        """Change a link's motion as if the wrench `new` had acted in the last step and not `old`, both (6,).

        About its centre of mass, world frame [N], [N m]. dt: length of that step [s], whose displacement
        changes too. Degrees of freedom that a joint's limit kept from moving in it do not answer.
        """
        body = self.links[slot][0]
        together = self._moved_together or [found.members for found in self._generalized()]
        members = next(members for members in together if body in members)
        exchange_wrench(members, *self._core.response(slot), old, new, dt, self.client)
