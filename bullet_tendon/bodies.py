"""Bodies: poses and velocities in, wrenches out. With movers, jacobians and pushes, all that talks
to pybullet about motion.

pybullet gives base poses at the centre of mass; the frames of URDFs, which tunnels and attachments
use, differ from them by the inertial offset.
"""

import numpy as np
import pybullet as p

from . import _core
from .errors import InvalidValue, UnknownId
from .identity import Marks
from .jacobians import joint_infos, movable_joints
from .movers import movers_of
from .pushes import exchange

_TOUCHING = 0.002  # m: bodies at rest on each other are within it; contact points are kept for longer


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
        self._rows: list[tuple | None] = []
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

    def tell(self, core) -> None:
        """Tell the core where links are and how they answer.

        Raises UnknownId where a body was removed from pybullet that something here refers to, and
        InvalidValue where pybullet has no finite pose, velocity or inertia for one.
        """
        self.require_alive()
        count = len(self.links)
        self._rows = [None] * count
        leaders, jacobians, movers = [-1] * count, [None] * count, [None] * count
        by_body: dict[int, list[int]] = {}
        for slot, (body, link) in enumerate(self.links):
            if slot in self._unused:
                continue
            self._rows[slot] = row = self._read(body, link)
            if row[0][0] > 0:
                by_body.setdefault(body, []).append(slot)
        for body, slots in by_body.items():
            self._move(body, slots, leaders, jacobians, movers)
        wild = core.set_links(self._rows, leaders, jacobians, movers)
        if wild >= 0:
            allowed = "a body with finite pose, velocity and inertia"
            raise InvalidValue("bodyUniqueId", self.links[wild][0], allowed)

    def _move(self, body, slots, leaders, jacobians, movers) -> None:
        slot_of = {self.links[s][1]: s for s in slots}
        mark = self._mark_of[slots[0]][1]
        for links, mover, of_links in movers_of(body, list(slot_of), mark, self.client):
            first = slot_of[links[0]]
            movers[first] = mover
            for link, jacobian in zip(links, of_links, strict=True):
                leaders[slot_of[link]] = first
                jacobians[slot_of[link]] = jacobian

    def forget(self, slots: set[int]) -> None:
        """Read and push links no more: nothing refers to them."""
        self._unused |= slots
        self._slots = {key: slot for key, slot in self._slots.items() if slot not in slots}

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
        return _core.link_frame(self._read(int(body), int(link)))

    def apply(self, wrenches: np.ndarray) -> None:
        """Put wrenches (links, 6), forces and torques about the centres of mass, on movable links."""
        for row, wrench, (body, link) in zip(self._rows, wrenches.tolist(), self.links, strict=True):
            if row is not None and row[0][0] > 0 and any(wrench):
                p.applyExternalForce(body, link, wrench[:3], row[1], p.WORLD_FRAME, self.client)
                p.applyExternalTorque(body, link, wrench[3:], p.WORLD_FRAME, self.client)

    def can_be_held(self, slot: int) -> bool:
        """Whether anything can hold a link: a joint, a contact or a constraint."""
        body = self.links[slot][0]
        infos = joint_infos(body, self.client, self._mark_of[slot][1])
        return bool(
            movable_joints(body, self.client, infos)
            or p.getNumConstraints(self.client)
            or self._is_touched(body)
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

    def _read(self, body: int, link: int) -> tuple:
        """Dynamics, centre of mass, orientation of the inertial frame, velocity, spin, as pybullet tells."""
        info = p.getDynamicsInfo(body, link, self.client)
        if link < 0:
            return (
                info,
                *p.getBasePositionAndOrientation(body, self.client),
                *p.getBaseVelocity(body, self.client),
            )
        # The link frame that getLinkState reports itself is rounded to single precision.
        state = p.getLinkState(body, link, 1, 1, self.client)
        return info, state[0], state[1], state[6], state[7]
