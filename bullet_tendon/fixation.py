"""Fixation: tensioners, screws and buttons, by which a tendon pulls at a bone (Tendon.pull, Tendon.fix).

Owns: the handles, and the nodes. A node is a small free body that a particle is attached to, at its centre.
A ligament joins it to a point of the bone. So the bone gets the exact opposite of what the tendon gets, and
all of it is solved with the step. What a fixation remembers is the rest length and the tension of its
ligament: it is part of the saved state. Goes with the core's room `ligament`.

A fixation is elastic up to its load F, and then slips under F: its ligament pulls with F while it gets
longer, and is elastic again from where it began to get shorter. Which of both holds is decided before each
step. In the step in which it begins to slip, its force can exceed F, by no more than its stiffness times the
way of that step.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pybullet as p

from . import checks
from .errors import InvalidType, InvalidValue, NotCopied, UnknownId
from .ligament import Ligament
from .material import Material

NODE_RADIUS = 2e-3  # m
NODE_MASS = 1e-3  # kg; about that of 5 mm of a graft. Lighter: the bodies' responses differ by more
BEARING = 0.02  # of a screw: from a particle to where it is held, along the bore [m]
# m; of the line of a fixation. Its stiffness in newtons per metre changes with its rest length, so by the
# slip over this. It goes beyond where it is held, on the same line.
LINE = 0.5


class Hardware(NamedTuple):
    """stiffness [N/m], or None where none is published; slip_load [N]; source."""

    stiffness: float | None
    slip_load: float
    source: str


HARDWARE = {
    "screw": Hardware(
        101.23e3,
        350.0,
        "interference screw: load in young human tibiae, Magen 1999 (PMID 9934416); "
        "stiffness in porcine tibiae, PMC8392818",
    ),
    "tandem_washers": Hardware(259e3, 1159.0, "Magen 1999 (PMID 9934416)"),
    "washerloc": Hardware(248e3, 905.0, "Magen 1999 (PMID 9934416)"),
    "button": Hardware(None, 958.0, "adjustable loop, PMC5954336: 2.8 mm longer after 1,000 cycles"),
}


class _Node:
    """A small free body at a particle of a tendon, and the ligament that joins it to a bone."""

    def __init__(self, tendon, particle: int, bone: tuple, stiffness: float, least: float = 0.0):
        """stiffness [N/m]; least: length [m] to which the line is drawn out beyond the bone's point."""
        world, client = tendon._world, tendon._bodies.client
        self._world, self._client = world, client
        self.particle = particle
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=NODE_RADIUS, physicsClientId=client)
        where = tendon.positions[particle].tolist()
        self.body = p.createMultiBody(NODE_MASS, shape, -1, where, physicsClientId=client)
        p.setCollisionFilterGroupMask(self.body, -1, 0, 0, physicsClientId=client)
        p.changeDynamics(self.body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
        self.ligament: Ligament | None = None
        try:
            self.anchor = tendon.attach(particle, self.body, -1, (0, 0, 0))
            self.ligament = self._join(bone, stiffness, least)
        except BaseException:
            self.remove()
            raise

    def _join(self, bone: tuple, stiffness: float, least: float) -> Ligament:
        origin, axes = self._world._bodies.frame(*bone[:2])
        here = axes.T @ (p.getBasePositionAndOrientation(self.body, self._client)[0] - origin)
        line = np.array(bone[2]) - here
        length = float(np.linalg.norm(line))
        if not length > 1e-6:
            raise InvalidValue("position", bone[2], "apart from the particle: the line to it has a direction")
        line *= max(1.0, least / length)
        length = max(length, least)
        path = [(self.body, -1, (0, 0, 0)), (*bone[:2], tuple((here + line).tolist()))]
        law = Material(stiffness=stiffness * length, exponent=1, tension_only=False)
        return self._world.add_ligament(path, law, length)

    def remove(self) -> None:
        if self.ligament is not None and not self.ligament.removed:
            self._world.remove_ligament(self.ligament)
        if hasattr(self, "anchor"):
            self.anchor.release()
        p.removeBody(self.body, self._client)


class Tensioner(NotCopied):
    """A device that rests on a bone and pulls at a particle with a constant tension; made by Tendon.pull.

    particle: its index; bodyUniqueId, linkIndex: the bone; released: whether it was taken off.

    Example:
        >>> device = tendon.pull(-1, 20, ball, -1, (0, 0, -0.05))
        >>> device.particle, device.force
        (10, 20.0)
        >>> device.release()
        >>> device.released, device.force
        (True, 0.0)
    """

    def __init__(self, tendon, particle, force, bodyUniqueId, linkIndex, position):
        self.particle = particle
        self.bodyUniqueId, self.linkIndex = int(bodyUniqueId), int(linkIndex)
        bone = (self.bodyUniqueId, self.linkIndex, tuple(position.tolist()))
        self._node = _Node(tendon, particle, bone, stiffness=1.0)
        self._node.ligament.set_tension(force)
        self.released = False

    def __repr__(self) -> str:
        state = "released" if self.released else f"{self.force:.4g} N"
        where = f"body {self.bodyUniqueId}, link {self.linkIndex}"
        return f"<Tensioner between particle {self.particle} and {where}: {state}>"

    @property
    def force(self) -> float:
        """The tension [N]; it can be set, >= 0. Zero after the release."""
        return 0.0 if self.released else float(self._node.ligament.tension)

    @force.setter
    def force(self, value: float) -> None:
        force = checks.number("force", value, at_least=0)
        if self.released:
            raise UnknownId("tensioner", self.particle, "one that was not released")
        self._node.ligament.set_tension(force)

    def release(self) -> None:
        """Take it off. Doing so twice does nothing.

        Example:
            >>> device = tendon.pull(-1, 20, ball, -1, (0, 0, -0.05))
            >>> device.release()
            >>> tendon.holds
            ()
        """
        if not self.released:
            self._node.remove()
        self.released = True


class Fixation(NotCopied):
    """Hardware that fixes a tendon to a bone, up to a load; made by Tendon.fix.

    kind: its name; particles: what it holds; slip_load [N], stiffness [N/m]: of all of it; released: whether
    it was taken out.

    Example:
        >>> button = tendon.fix(-1, ball, -1, (0, 0, -0.01), "button", stiffness=2e5)
        >>> button.kind, button.particles, button.slip_load
        ('button', (10,), 958.0)
        >>> button.release()
        >>> button.released
        True
    """

    def __init__(self, tendon, kind: str, stiffness: float, slip_load: float, bone, points: dict):
        """points: by particle, where it is held (3,), in the frame of the bone (bodyUniqueId, linkIndex)."""
        self.kind, self.stiffness, self.slip_load = kind, stiffness, slip_load
        self.particles = tuple(points)
        self._share = 1.0 / len(points)
        self._nodes: list[_Node] = []
        self.released = False
        try:
            for particle, point in points.items():
                where = (*bone, tuple(np.asarray(point).tolist()))
                self._nodes.append(_Node(tendon, particle, where, stiffness * self._share, LINE))
        except BaseException:
            self.release()
            raise
        self._first = [node.ligament.rest_length for node in self._nodes]
        tendon._world._fixations.append(self)

    def __repr__(self) -> str:
        if self.released:
            return f"<Fixation by {self.kind}, released>"
        held, force = _listed(self.particles), f"{self.force:.4g} of {self.slip_load:.4g} N"
        return f"<Fixation of {held} by {self.kind}: {force}, slipped by {1e3 * self.slip:.3g} mm>"

    @property
    def force(self) -> float:
        """Force of the tendon on the bone through it at the end of the last step [N]."""
        return float(sum(self.forces))

    @property
    def forces(self) -> np.ndarray:
        """(k,) shares of `force` by particle [N]."""
        if self.released:
            return np.zeros(len(self.particles))
        return np.array([node.ligament.force for node in self._nodes])

    @property
    def slip(self) -> float:
        """How far it has slipped in all: the mean over its particles [m]."""
        if self.released:
            return 0.0
        longer = [node.ligament.rest_length for node in self._nodes] - np.array(self._first)
        return float(longer.mean())

    def release(self) -> None:
        """Take it out. Doing so twice does nothing.

        Example:
            >>> button = tendon.fix(-1, ball, -1, (0, 0, -0.01), "button", stiffness=2e5)
            >>> button.release()
            >>> tendon.holds
            ()
        """
        for node in self._nodes:
            node.remove()
        if self._nodes:
            fixations = self._nodes[0]._world._fixations
            if self in fixations:
                fixations.remove(self)
        self._nodes = []
        self.released = True

    def _before_step(self) -> None:
        """Decide of each particle whether it slips in the coming step."""
        load = self.slip_load * self._share
        for node in self._nodes:
            line = node.ligament
            rest = line.length / (1 + load / line.material.stiffness)  # under which its force is the load
            if line.tension is None:
                if line.force > load:
                    line.rest_length = rest
                    line.set_tension(load)
            elif rest >= line.rest_length:
                line.rest_length = rest
            else:
                line.set_tension(None)


class Bundle:
    """Strands that work side by side, such as the four of a hamstring graft.

    strands: tendons of one world. pull and fix share what they are given evenly among the strands, as
    hardware does that holds all of them. Raises InvalidType or InvalidValue.

    Example:
        >>> bundle = bt.Bundle([tendon])
        >>> bundle.force, bundle.shares.tolist(), bundle.elongation
        (0.0, [0.0], 0.0)
    """

    def __init__(self, strands):
        from .tendon import Tendon

        if not isinstance(strands, Iterable):
            raise InvalidType("strands", strands, "tendons")
        self.strands = tuple(strands)
        if not self.strands:
            raise InvalidValue("strands", strands, "at least one tendon")
        for strand in self.strands:
            if not isinstance(strand, Tendon):
                raise InvalidType("strands", strand, "tendons")

    def __repr__(self) -> str:
        shares = ", ".join(f"{100 * share:.0f}" for share in self.shares)
        return f"<Bundle of {len(self.strands)} strands: {self.force:.4g} N, shares {shares} %>"

    @property
    def forces(self) -> np.ndarray:
        """(k,) tension of each strand, the mean along it [N]."""
        return np.array([strand.tension.mean() for strand in self.strands])

    @property
    def force(self) -> float:
        """Of all strands [N]."""
        return float(self.forces.sum())

    @property
    def shares(self) -> np.ndarray:
        """(k,) of each strand in `force` [-]; zeros where there is none."""
        total = self.force
        return self.forces / total if total > 0 else np.zeros(len(self.strands))

    @property
    def elongation(self) -> float:
        """Length beyond the rest length, the mean of the strands [m]."""
        return float(np.mean([strand.length - strand.rest_length for strand in self.strands]))

    def pull(self, particle: int, force: float, bodyUniqueId: int, linkIndex: int, position) -> tuple:
        """Pull all strands by one tensioner: Tendon.pull of each, with an equal share of `force` [N].

        Returns the Tensioners in the order of the strands. Raises as Tendon.pull; then nothing has changed.

        Example:
            >>> devices = bt.Bundle([tendon]).pull(-1, 80, ball, -1, (0, 0, -0.05))
            >>> [device.force for device in devices]
            [80.0]
        """
        share = checks.number("force", force, at_least=0) / len(self.strands)
        return self._each(lambda strand: strand.pull(particle, share, bodyUniqueId, linkIndex, position))

    def fix(self, where, *place, length=None, stiffness=None, slip_load=None) -> tuple:
        """Fix all strands by one piece of hardware: Tendon.fix of each, with equal shares of its strength.

        stiffness [N/m], slip_load [N]: of the hardware, None for the published ones; other arguments as in
        Tendon.fix. Returns the Fixations in the order of the strands. Raises as Tendon.fix; then nothing has
        changed.

        Example:
            >>> [button] = bt.Bundle([tendon]).fix(-1, ball, -1, (0, 0, -0.01), "button", stiffness=2e5)
            >>> button.slip_load
            958.0
        """
        if not place:
            raise InvalidValue("place", place, "the name of the hardware at the end")
        strength = _strength(place[-1], stiffness, slip_load)
        shares = dict(zip(("stiffness", "slip_load"), np.array(strength) / len(self.strands), strict=True))
        return self._each(lambda strand: strand.fix(where, *place, length=length, **shares))

    def _each(self, hold) -> tuple:
        """hold(strand) of all strands, or of none where one is refused."""
        made = []
        try:
            for strand in self.strands:
                made.append(hold(strand))
        except BaseException:
            for handle in made:
                handle.release()
            raise
        return tuple(made)


def fix_at(tendon, particle, bodyUniqueId, linkIndex, position, kind, stiffness, slip_load) -> Fixation:
    """A button: see Tendon.fix."""
    index = tendon._free_particle(particle)
    tendon._bodies.require(bodyUniqueId, linkIndex)
    position = checks.vector("position", position)
    stiffness, slip_load = _strength(kind, stiffness, slip_load)
    bone = int(bodyUniqueId), int(linkIndex)
    return Fixation(tendon, kind, stiffness, slip_load, bone, {index: position})


def fix_in(tendon, tunnel, kind, length, stiffness, slip_load) -> Fixation:
    """A screw: see Tendon.fix."""
    if tendon._world._tunnels.get(tunnel.slot) is not tunnel:
        raise UnknownId("tunnel", tunnel.name, "one of the tendon's world, not removed")
    stiffness, slip_load = _strength(kind, stiffness, slip_load)
    span = float(np.linalg.norm(tunnel.end - tunnel.start))
    length = span if length is None else checks.number("length", length, above=0, at_most=span)
    axis = (tunnel.end - tunnel.start) / span
    origin, axes = tendon._bodies.frame(tunnel.bodyUniqueId, tunnel.linkIndex)
    local = (tendon.positions - origin) @ axes - tunnel.start
    height = local @ axis
    beside = np.linalg.norm(local - height[:, None] * axis, axis=1)
    inside = np.flatnonzero((height >= 0) & (height <= span) & (beside <= tunnel.radius))
    if not len(inside):
        raise InvalidValue("tunnel", tunnel.name, "one that particles of the tendon are in")
    # The screw begins at the mouth that is nearer to an end of the tendon, along the tendon.
    to_an_end = np.minimum(inside, tendon.particles - 1 - inside)
    outer = 0.0 if height[inside[to_an_end.argmin()]] < span / 2 else span
    outward = -axis if outer == 0.0 else axis
    held = [i for i in inside.tolist() if abs(height[i] - outer) <= length and i not in tendon._anchors]
    if not held:
        raise InvalidValue("length", length, "as long that free particles are within it")
    points = {i: tunnel.start + local[i] + BEARING * outward for i in held}
    bone = tunnel.bodyUniqueId, tunnel.linkIndex
    return Fixation(tendon, kind, stiffness, slip_load, bone, points)


def _listed(particles: tuple) -> str:
    first, *more = particles
    return f"{1 + len(more)} particles" if more else f"particle {first}"


def _strength(kind, stiffness, slip_load) -> tuple[float, float]:
    known = HARDWARE[checks.choice("kind", kind, tuple(HARDWARE))]
    stiffness = known.stiffness if stiffness is None else stiffness
    if stiffness is None:
        raise InvalidValue("stiffness", stiffness, f"given in N/m: none is published here for a {kind}")
    slip_load = known.slip_load if slip_load is None else slip_load
    return checks.number("stiffness", stiffness, above=0), checks.number("slip_load", slip_load, above=0)
