"""Bodies that tendons touch, as the core is told of them at every step.

A body is solved for by what can move of it: the twist of a rigid one, else the degrees of freedom of base
and joints. Where pybullet has joints that jacobians_and_mass does not know, every link stands for itself,
with its own mass: the stable side. Slots are those of bodies.Bodies.
"""

import pybullet as p

from .jacobians import joint_infos, joint_states, movable_joints, tree_of

# Told by the core: contacts could tell more of what a body is going to do; those told last may stand.
_MAY_REST, _MAY_STAND = 2, 3
_TOUCHING = 0.002  # m: bodies at rest on each other are within it; contact points are kept for longer


def touched(body: int, slots: dict[int, int], mark: bytes, client: int) -> list["Alone | OnJoints"]:
    """What has to be told of a body. slots: by link; mark: what the body carries (identity.Marks)."""
    infos = joint_infos(body, client, mark)
    if not infos:
        return [Alone(slots[-1], body, -1, True, client)]
    if tree_of(infos, False) is None:
        return [Alone(slot, body, link, False, client) for link, slot in slots.items()]
    return [OnJoints(body, slots, infos, client)]


def read_link(body: int, link: int, client: int) -> tuple:
    """Dynamics, (centre of mass, orientation of the inertial frame), (velocity, spin), as pybullet tells."""
    info = p.getDynamicsInfo(body, link, client)
    if link < 0:
        return info, p.getBasePositionAndOrientation(body, client), p.getBaseVelocity(body, client)
    # The link frame that getLinkState reports itself is rounded to single precision.
    state = p.getLinkState(body, link, 1, 1, client)
    return info, state[:2], state[6:]


def _has_no_mass(link: tuple[int, int], client: int) -> bool:
    """Whether a link, by body and index, is of a body that nothing moves."""
    return p.getDynamicsInfo(*link, client)[0] == 0


class Alone:
    """A link that moves by itself, where it has mass: a body without joints, or on joints not known."""

    def __init__(self, slot: int, body: int, link: int, falls: bool, client: int):
        self.slot, self.body, self.link, self.falls, self.client = slot, body, link, falls, client

    def tell(self, core) -> bool:
        """Where it is, and how it answers; whether all of that is finite."""
        info, where, motion = read_link(self.body, self.link, self.client)
        told = core.tell_link(self.slot, info, where, motion, True, self.falls)
        if told == _MAY_REST or (told == _MAY_STAND and not self._is_carried(core)):
            self._tell_contacts(core, where)
        return told > 0

    def keep_contacts(self, core) -> None:
        """Into the state that is going to be saved: after restoreState pybullet tells later contacts."""
        if self.falls and core.may_rest(self.slot):
            where, motion = read_link(self.body, self.link, self.client)[1:]
            if not (core.contacts_stand(self.slot, where, motion) and self._is_carried(core)):
                self._tell_contacts(core, where)
            core.keep_contacts(self.slot)

    def _is_carried(self, core) -> bool:
        """Whether what it rested on when its contacts were asked for is still there, and nothing else."""
        bodies, links = core.rests_on(self.slot)
        if bodies != p.getNumBodies(self.client):
            return False
        try:
            return all(_has_no_mass(link, self.client) for link in links)
        except p.error:  # it was removed
            return False

    def _tell_contacts(self, core, where) -> None:
        """What it rests on: contacts with bodies without mass."""
        client = self.client
        points = p.getContactPoints(bodyA=self.body, physicsClientId=client)
        stays = [other for other in {(c[2], c[4]): None for c in points} if _has_no_mass(other, client)]
        core.tell_contacts(self.slot, points, stays, where, p.getNumBodies(client))

    def note(self, core) -> bool:
        """Its motion right after pybullet's step; whether it seems to have been let go."""
        return core.note_link(self.slot, read_link(self.body, self.link, self.client)[2])

    def can_be_held(self) -> bool:
        """Whether a joint, a contact or a constraint can hold it."""
        return not self.falls or _can_be_held(self.body, self.client)


class OnJoints:
    """Links of a body on joints, fixed or floating."""

    def __init__(self, body: int, slots: dict[int, int], infos: tuple, client: int):
        self.body, self.client = body, client
        self.slot = next(iter(slots.values()))
        self._slots, self._links = list(slots.values()), [link + 1 for link in slots]
        self._joints = movable_joints(body, client, infos)
        self._trees = [tree_of(infos, floating) for floating in (False, True)]
        self._told = self._trees[0]  # of these, the one that was told last
        self._yields = [any(tree.moves(link) for link in self._links) for tree in self._trees]

    def tell(self, core) -> bool:
        """Where its links are, and how they answer; whether all of that is finite."""
        body, client = self.body, self.client
        info = p.getDynamicsInfo(body, -1, client)
        floating = info[0] > 0
        if not self._yields[floating]:
            links = zip(self._slots, self._links, strict=True)
            told = [core.tell_link(s, *read_link(body, i - 1, client), False, False) for s, i in links]
            return 0 not in told
        self._told = tree = self._trees[floating]
        # applyExternalForce takes its arm from where pybullet last computed the links to be: a step ago, but
        # for this.
        p.getLinkState(body, 0, 0, 1, client)
        return core.tell_body(
            tree,
            self._slots,
            self._links,
            [info, *[p.getDynamicsInfo(body, link, client) for link in range(tree.links - 1)]],
            p.getBasePositionAndOrientation(body, client),
            p.getBaseVelocity(body, client),
            joint_states(body, self._joints, client),
        )

    def note(self, core) -> bool:
        """Its rates right after pybullet's step; whether it seems to have been let go."""
        body, client = self.body, self.client
        motion = p.getBaseVelocity(body, client)
        return core.note_body(self.slot, self._told, motion, joint_states(body, self._joints, client))

    def can_be_held(self) -> bool:
        """Whether a joint, a contact or a constraint can hold it."""
        return bool(self._joints) or _can_be_held(self.body, self.client)

    def keep_contacts(self, core) -> None:
        """None are asked for."""


def can_be_hit(body: int, client: int) -> bool:
    """Whether any other body is near, or there are constraints; whatever contacts pybullet still tells of."""
    others = {p.getBodyUniqueId(i, client) for i in range(p.getNumBodies(client))}
    return p.getNumConstraints(client) > 0 or _is_near(body, others - {body}, client)


def _can_be_held(body: int, client: int) -> bool:
    """Whether another body touches it, or there are constraints.

    pybullet's restoreState leaves contacts of later times behind.
    """
    if p.getNumConstraints(client):
        return True
    return _is_near(body, {c[2] for c in p.getContactPoints(bodyA=body, physicsClientId=client)}, client)


def _is_near(body: int, others: set[int], client: int) -> bool:
    return any(p.getClosestPoints(body, o, _TOUCHING, physicsClientId=client) for o in others)
