"""Fixation: tensioners, screws and buttons, by which a tendon pulls at a bone (Tendon.pull, Tendon.fix).

Owns: the handles. Each particle that is held has a line to a point of the bone (anchors.Line), which the core
solves with the step. The bone gets the exact opposite of what the tendon gets. What a line remembers is how
far it has slipped: it is part of the saved state. Goes with the core's room `tendon`.

A fixation is elastic up to its load F, and then slips under F: its line pulls with F while it gets longer,
and is elastic again from where it began to get shorter.
"""

from typing import NamedTuple

import numpy as np

from . import checks
from .anchors import Line
from .errors import InvalidType, InvalidValue, NotCopied, UnknownId

BEARING = 0.02  # of a screw: from a particle to where it is held, along the bore [m]


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


def _join(tendon, particle: int, bone: tuple, stiffness: float, load: float) -> Line:
    """Join a particle to a point of a bone (bodyUniqueId, linkIndex, position) by a line.

    stiffness [N/m]; 0: it pulls by `load` [N] until the particle is at the point.
    """
    body, link, point = bone
    origin, axes = tendon._bodies.frame(body, link)
    length = float(np.linalg.norm(origin + axes @ point - tendon.positions[particle]))
    if not length > 1e-6:
        raise InvalidValue("position", point, "apart from the particle: the line to it has a direction")
    slot, number = tendon._bodies.slot(body, link), tendon._numbers.next()
    first = length if stiffness > 0 else 0.0
    tendon._core.add_line(tendon._slot, number, particle, slot, point, first, stiffness, load)
    line = Line(tendon, particle, number, body, link, np.array(point), slot)
    tendon._anchors[particle] = line
    return line


class Tensioner(NotCopied):
    """A device that rests on a bone and pulls at a particle with a constant tension; made by Tendon.pull.

    A particle that comes to the device's point is held there, by up to that tension.

    particle: its index; bodyUniqueId, linkIndex: the bone.

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
        self._line = _join(tendon, particle, (self.bodyUniqueId, self.linkIndex, position), 0.0, force)

    def __repr__(self) -> str:
        state = "released" if self.released else f"{self.force:.4g} N"
        where = f"body {self.bodyUniqueId}, link {self.linkIndex}"
        return f"<Tensioner between particle {self.particle} and {where}: {state}>"

    @property
    def released(self) -> bool:
        """Whether it was taken off."""
        return self._line.released

    @property
    def force(self) -> float:
        """The tension [N], the most at the device's point; it can be set, >= 0. Zero after the release."""
        return self._line.load

    @force.setter
    def force(self, value: float) -> None:
        force = checks.number("force", value, at_least=0)
        if self.released:
            raise UnknownId("tensioner", self.particle, "one that was not released")
        self._line._set_load(force)

    def release(self) -> None:
        """Take it off. Doing so twice does nothing.

        Example:
            >>> device = tendon.pull(-1, 20, ball, -1, (0, 0, -0.05))
            >>> device.release()
            >>> tendon.holds
            ()
        """
        self._line.release()


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
        self._lines: list[Line] = []
        share = 1.0 / len(points)
        try:
            for particle, point in points.items():
                self._lines.append(
                    _join(tendon, particle, (*bone, point), stiffness * share, slip_load * share)
                )
        except BaseException:
            self.release()
            raise

    def __repr__(self) -> str:
        if self.released:
            return f"<Fixation by {self.kind}, released>"
        held, force = _listed(self.particles), f"{self.force:.4g} of {self.slip_load:.4g} N"
        return f"<Fixation of {held} by {self.kind}: {force}, slipped by {1e3 * self.slip:.3g} mm>"

    @property
    def released(self) -> bool:
        """Whether all that it holds was let go."""
        return all(line.released for line in self._lines)

    @property
    def force(self) -> float:
        """Force of the tendon on the bone through it at the end of the last step [N]."""
        return float(sum(self.forces))

    @property
    def forces(self) -> np.ndarray:
        """(k,) shares of `force` by particle [N]."""
        return np.array([line.tension for line in self._lines])

    @property
    def slip(self) -> float:
        """How far it has slipped in all: the mean over its particles [m]."""
        return float(np.mean([line.slip for line in self._lines]))

    def release(self) -> None:
        """Take it out. Doing so twice does nothing.

        Example:
            >>> button = tendon.fix(-1, ball, -1, (0, 0, -0.01), "button", stiffness=2e5)
            >>> button.release()
            >>> tendon.holds
            ()
        """
        for line in self._lines:
            line.release()


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

        self.strands = tuple(checks.sequence("strands", strands, "tendons"))
        if not self.strands:
            raise InvalidValue("strands", strands, "at least one tendon")
        for strand in self.strands:
            if not isinstance(strand, Tendon):
                raise InvalidType("strands", strand, "tendons")
        if len(set(self.strands)) < len(self.strands):
            raise InvalidValue("strands", strands, "tendons that are listed once")

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
    origin, axes = tunnel._frame()
    local = (tendon.positions - origin) @ axes - tunnel.start
    height = local @ axis
    beside = np.linalg.norm(local - height[:, None] * axis, axis=1)
    inside = np.flatnonzero((height >= 0) & (height <= span) & (beside <= tunnel.radius))
    if not len(inside):
        raise InvalidValue("tunnel", tunnel.name, "one that particles of the tendon are in")
    outer = _outer_mouth(tendon.positions, height, inside[0], inside[-1], span)
    outward = -axis if outer == 0.0 else axis
    held = [i for i in inside.tolist() if abs(height[i] - outer) <= length and i not in tendon._anchors]
    if not held:
        raise InvalidValue("length", length, "as long that free particles are within it")
    points = {i: tunnel.start + local[i] + BEARING * outward for i in held}
    bone = tunnel.bodyUniqueId, tunnel.linkIndex
    return Fixation(tendon, kind, stiffness, slip_load, bone, points)


def _outer_mouth(positions, height, first: int, last: int, span: float) -> float:
    """Height of the mouth of a bore that is nearer to an end of the tendon, along the tendon [m].

    positions (n, 3); height (n,): of its particles over the first mouth; first, last: of those in the bore;
    span: height of the other mouth.
    """
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    rises = height[min(last + 1, len(height) - 1)] > height[max(first - 1, 0)]
    mouths = (0.0, span) if rises else (span, 0.0)
    beyond = arc[first] - abs(height[first] - mouths[0]), arc[-1] - arc[last] - abs(height[last] - mouths[1])
    # An end in the bore is nearest, and of two such ends that which is less deep.
    before, behind = ((max(0.0, way), abs(way)) for way in beyond)
    return mouths[0] if before <= behind else mouths[1]


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
