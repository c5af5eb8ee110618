"""Bodies: poses and velocities in, wrenches out. With movers, responses, jacobians and pushes, all that talks
to pybullet about motion.

pybullet gives base poses at the centre of mass; the frames of URDFs, which tunnels and attachments
use, differ from them by the inertial offset.
"""

import numpy as np
import pybullet as p

from .errors import InvalidValue, UnknownId
from .identity import Marks
from .jacobians import movable_joints
from .movers import movers_of
from .pushes import exchange
from .responses import axes_of

_TOUCHING = 0.002  # m: bodies at rest on each other are within it; contact points are kept for longer
_WIDTH = 22  # origin 3, rotation 9, centre 3, velocity 3, spin 3, slot of its mover 1 (-1: none)


def client_of(physicsClientId) -> int:
    """The number of a client: an int, or a pybullet_utils BulletClient."""
    number = getattr(physicsClientId, "_client", physicsClientId)
    if not isinstance(number, int) or isinstance(number, bool) or number < 0 or not p.isConnected(number):
        raise UnknownId("physicsClientId", physicsClientId, "a connected pybullet client")
    return number


class Bodies:
    """The links that tendons can touch, in slots numbered as the core numbers them."""

    def __init__(self, client: int):
        self.client = client
        self.links: list[tuple[int, int]] = []
        self._slots: dict[tuple[int, int], int] = {}
        self._table = np.zeros((0, _WIDTH))
        self._marks = Marks(client)
        self._mark_of: list[tuple[int, bytes]] = []
        self._unused: set[int] = set()
        self.in_use = lambda: set(range(len(self.links)))

    def require_client(self) -> None:
        """Raise UnknownId where the client was disconnected."""
        if not p.isConnected(self.client):
            raise UnknownId("physicsClientId", self.client, "a connected pybullet client")

    def require(self, body: int, link: int, argument: str = "bodyUniqueId") -> None:
        """Raise UnknownId unless the body exists and has that link (-1: its base)."""
        self.require_client()
        known = [p.getBodyUniqueId(i, self.client) for i in range(p.getNumBodies(self.client))]
        if not isinstance(body, (int, np.integer)) or isinstance(body, bool) or body not in known:
            raise UnknownId(argument, body, f"the id of a body of this client: {known}")
        count = p.getNumJoints(int(body), self.client)
        if not isinstance(link, (int, np.integer)) or isinstance(link, bool) or not -1 <= link < count:
            raise UnknownId("linkIndex", link, f"an integer from -1 to {count - 1} for body {body}")

    def slot(self, body: int, link: int) -> int:
        """The slot of a link, made where there is none."""
        key = (int(body), int(link))
        known = self.find_slot(*key)
        if known is not None:
            return known
        mark = self._marks.mark(key[0])
        if self._unused:
            slot = min(self._unused)
            self._unused.discard(slot)
            self.links[slot], self._mark_of[slot] = key, mark
        else:
            slot = len(self.links)
            self.links.append(key)
            self._mark_of.append(mark)
            self._table = np.vstack([self._table, np.zeros((1, _WIDTH))])
        self._slots[key] = slot
        return slot

    def find_slot(self, body: int, link: int) -> int | None:
        """The slot of a link; None where there is none, or it is of a body that had this id before."""
        slot = self._slots.get((body, link))
        return None if slot is None or self.is_gone(slot) else slot

    def is_gone(self, slot: int) -> bool:
        """Whether the body that a slot was made for was removed from pybullet."""
        return not self._marks.holds(self._mark_of[slot])

    def slots_of(self, body: int) -> set[int]:
        return {s for (b, _), s in self._slots.items() if b == body and not self.is_gone(s)}

    def marked_links(self) -> tuple:
        """Body, link and the body's mark by slot; None for slots not in use."""
        marked = [(*key, mark[1]) for key, mark in zip(self.links, self._mark_of, strict=True)]
        for slot in self._unused:
            marked[slot] = None
        while marked and marked[-1] is None:
            marked.pop()
        return tuple(marked)

    def table(self) -> tuple[np.ndarray, list, list]:
        """What the core needs to know of every link: (links, 22) numbers (layout: _WIDTH), Jacobians, movers.

        Jacobians by link, (6, n) or None for the identity; movers by the slot of their first link: (falls,
        rates, response, stops) as of movers.Mover, or None. Raises UnknownId where a body was removed from
        pybullet that something here refers to, and InvalidValue where pybullet has no finite pose or velocity
        for one.
        """
        self.require_alive()
        by_body: dict[int, list[int]] = {}
        for slot, (row, (body, link)) in enumerate(zip(self._table, self.links, strict=True)):
            if slot in self._unused:
                continue
            info = p.getDynamicsInfo(body, link, self.client)
            self._read(row, body, link, info)
            row[21] = -1
            if info[0] > 0:
                by_body.setdefault(body, []).append(slot)
        jacobians, movers = [None] * len(self.links), [None] * len(self.links)
        for body, slots in by_body.items():
            self._move(body, slots, jacobians, movers)
        self._require_finite(movers)
        return self._table, jacobians, movers

    def _move(self, body: int, slots: list[int], jacobians: list, movers: list) -> None:
        slot_of = {self.links[s][1]: s for s in slots}
        rows = {link: self._table[s] for link, s in slot_of.items()}
        for links, mover in movers_of(body, list(slot_of), rows, self.client):
            first = slot_of[links[0]]
            movers[first] = mover[:4]
            for link, jacobian in zip(links, mover.jacobians, strict=True):
                self._table[slot_of[link], 21] = first
                jacobians[slot_of[link]] = jacobian

    def _require_finite(self, movers: list) -> None:
        fine = np.isfinite(self._table).all(axis=1)
        for slot, mover in enumerate(movers):
            if mover is not None and not (np.isfinite(mover[1]).all() and np.isfinite(mover[2]).all()):
                fine[slot] = False
        if not fine.all():
            body = self.links[int(np.argmin(fine))][0]
            raise InvalidValue("bodyUniqueId", body, "a body with finite pose, velocity and inertia")

    def forget(self, slots: set[int]) -> None:
        """Read and push links no more: nothing refers to them."""
        self._unused |= slots
        self._slots = {key: slot for key, slot in self._slots.items() if slot not in slots}
        self._table[list(slots)] = 0.0
        self._table[list(slots), -1] = -1

    def require_alive(self) -> None:
        """Forget bodies that were removed and that nothing refers to; raise UnknownId for others."""
        gone = {s for s in range(len(self.links)) if s not in self._unused and self.is_gone(s)}
        if not gone:
            return
        for slot in sorted(gone & self.in_use()):
            body = self.links[slot][0]
            raise UnknownId("bodyUniqueId", body, "a body that was not removed: release what refers to it")
        self.forget(gone)

    def frame(self, body: int, link: int) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) and axes (3, 3) of the URDF link frame in the world."""
        row = np.zeros(_WIDTH)
        self._read(row, int(body), int(link), p.getDynamicsInfo(int(body), int(link), self.client))
        return row[:3].copy(), row[3:12].reshape(3, 3).copy()

    def apply(self, wrenches: np.ndarray) -> None:
        """Put wrenches (links, 6), forces and torques about the centres of mass, on movable links."""
        for row, wrench, (body, link) in zip(self._table, wrenches, self.links, strict=True):
            if wrench.any() and p.getDynamicsInfo(body, link, self.client)[0] > 0:
                centre = row[12:15]
                p.applyExternalForce(body, link, wrench[:3], centre, p.WORLD_FRAME, self.client)
                p.applyExternalTorque(body, link, wrench[3:], p.WORLD_FRAME, self.client)

    def can_be_held(self, slot: int) -> bool:
        """Whether anything can hold a link: a joint, a contact or a constraint."""
        body, link = self.links[slot]
        return bool(
            p.getNumConstraints(self.client) or self._is_touched(body) or movable_joints(body, self.client)
        )

    def _is_touched(self, body) -> bool:
        """Whether another body touches it. pybullet's restoreState leaves contacts of later times behind."""
        others = {c[2] for c in p.getContactPoints(bodyA=body, physicsClientId=self.client)}
        return any(p.getClosestPoints(body, o, _TOUCHING, physicsClientId=self.client) for o in others)

    def exchange(self, slot: int, old: np.ndarray, new: np.ndarray, dt: float, stopped=()) -> None:
        """Change a link's motion as if the wrench `new` had acted in the last step and not `old`, both (6,).

        About its centre of mass, world frame [N], [N m]. dt: length of that step [s], whose displacement
        changes too. stopped: degrees of freedom that a joint's limit kept from moving in it.
        """
        exchange(*self.links[slot], old, new, dt, self.client, stopped)

    def _read(self, row, body, link, info) -> None:
        if link < 0:
            centre, turn = p.getBasePositionAndOrientation(body, self.client)
            _write(row, centre, turn, info, *p.getBaseVelocity(body, self.client))
        else:
            # The link frame that getLinkState reports itself is rounded to single precision.
            state = p.getLinkState(body, link, 1, 1, self.client)
            _write(row, state[0], state[1], info, state[6], state[7])


def _write(row, centre, turn, info, velocity, spin) -> None:
    # URDF frame = inertial frame x inverse of the local inertial pose; in numpy, because pybullet's
    # own transforms round to single precision.
    axes = axes_of(turn) @ axes_of(info[4]).T
    row[0:3], row[3:12], row[12:15] = centre - axes @ info[3], axes.ravel(), centre
    row[15:18], row[18:21] = velocity, spin
