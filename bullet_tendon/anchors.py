"""Anchors: particles of a tendon that are tied to something, a hand (Grip) or a link (Attachment, Line).

Owns: the handles; the core owns what holds (by its slot of the tendon and a number), and a Tendon owns its
anchors. Goes with the core's room `tendon`.
"""

import numpy as np

from . import checks
from .errors import InvalidValue, NotCopied, UnknownId


class Numbers:
    """Numbers that a world gives out, each once: to anchors, saved states and what has no name."""

    def __init__(self):
        self._last = 0

    def next(self) -> int:
        """A number that was not given out yet."""
        self._last += 1
        return self._last

    def skip(self, number: int) -> None:
        """Give out none up to this one any more."""
        self._last = max(self._last, number)


class _Anchor(NotCopied):
    """What grips and attachments share: a particle of a tendon that is tied to something."""

    def __init__(self, tendon, particle: int, number: int):
        self._tendon = tendon
        self.particle = particle
        self._number = number
        self._released = False

    def __repr__(self) -> str:
        kind, of = type(self).__name__, f"particle {self.particle} of {self._tendon.name!r}"
        if self.released:
            return f"<{kind} of {of}, released>"
        force = ", ".join(f"{part:.4g}" for part in self.force)
        return f"<{kind} of {of}{self._holder()}: force ({force}) N>"

    def _holder(self) -> str:
        return ""

    @property
    def released(self) -> bool:
        """True once release() was called, or the tendon was removed."""
        return self._released or self._tendon.removed

    @property
    def force(self) -> np.ndarray:
        """(3,) force of the tendon on what holds it, the mean over the last step [N], world frame.

        Where the step before it was solved again after it could be read (TendonWorld.apply), the impulse that
        this has added is contained, so that the sum of force times time step is the impulse that acts. Zero
        before the first step and after the release.
        """
        if self.released:
            return np.zeros(3)
        return np.array(self._tendon._core.anchor_force(self._tendon._slot, self._number))

    def release(self) -> None:
        """Let go. Doing so twice does nothing."""
        if not self.released:
            self._tendon._core.remove_anchor(self._tendon._slot, self._number)
            self._tendon._anchors.pop(self.particle, None)
        self._released = True

    def _settings(self) -> dict:
        """What a saved state has to know of this handle."""
        return {"number": self._number}

    def _forget(self) -> None:
        """The core has released it already."""
        self._tendon._anchors.pop(self.particle, None)
        self._released = True

    def _restore(self, settings: dict) -> None:
        """The core holds it (again), as `settings` say."""
        self._number = settings["number"]
        self._tendon._anchors[self.particle] = self
        self._released = False

    def _require(self) -> None:
        if self.released:
            raise UnknownId(type(self).__name__.lower(), self.particle, "one that was not released")
        self._tendon._bodies.require_client()


class LinkAnchor(_Anchor):
    """What attachments and lines share: a link, by its slot, and a point of it."""

    def __init__(self, tendon, particle, number, bodyUniqueId, linkIndex, position, link_slot):
        super().__init__(tendon, particle, number)
        self.bodyUniqueId = bodyUniqueId
        self.linkIndex = linkIndex
        self.link_slot = link_slot
        self._position = position

    @property
    def position(self) -> np.ndarray:
        """(3,) its point in the link's URDF frame [m]."""
        return self._position.copy()

    def _holder(self) -> str:
        return f" at body {self.bodyUniqueId}, link {self.linkIndex}"

    def _settings(self) -> dict:
        where = {"bodyUniqueId": self.bodyUniqueId, "linkIndex": self.linkIndex}
        return {**super()._settings(), **where, "position": self.position}


class Attachment(LinkAnchor):
    """A particle tied to a point of a pybullet link; made by Tendon.attach.

    particle: its index. bodyUniqueId, linkIndex: the link. force: what the tendon does to the body; its exact
    opposite acts on the tendon.

    Example:
        >>> knot = tendon.attach(-1, ball)
        >>> knot.particle, knot.bodyUniqueId, knot.position.round(3).tolist()
        (10, 0, [0.0, 0.0, 0.01])
        >>> knot.release()
        >>> knot.released, tendon.holds
        (True, ())
    """


class Line(LinkAnchor):
    """A particle joined to a point of a pybullet link by hardware (Tendon.fix, Tendon.pull).

    It is elastic along the way to its point, slips at its load, and lets the particle move across it.
    particle: its index. bodyUniqueId, linkIndex: the link. force: what the tendon does to the body.

    Example:
        >>> button = tendon.fix(-1, ball, -1, (0, 0, -0.01), "button", stiffness=2e5)
        >>> [line] = tendon.holds
        >>> line.particle, line.load, line.tension, line.slip
        (10, 958.0, 0.0, 0.0)
    """

    @property
    def load(self) -> float:
        """At which it slips [N]. Zero after the release."""
        return 0.0 if self.released else self._tendon._core.line_load(self._tendon._slot, self._number)

    def _set_load(self, load: float) -> None:
        self._tendon._core.set_line_load(self._tendon._slot, self._number, load)

    @property
    def tension(self) -> float:
        """At the end of the last step [N]; negative where it pushes. Zero after the release."""
        return 0.0 if self.released else self._tendon._core.line_tension(self._tendon._slot, self._number)

    @property
    def slip(self) -> float:
        """How far it has slipped in all [m]. Zero after the release."""
        return 0.0 if self.released else self._tendon._core.line_slip(self._tendon._slot, self._number)


class Grip(_Anchor):
    """A particle led by a hand, a suture or a haptic device; made by Tendon.grip.

    Without a stiffness the particle is at the target at the end of every step, exactly. With one it is drawn
    there by a spring [N/m] and a damper [N s/m] (the virtual coupling of haptics, Colgate, Stanley and Brown
    1995). The damper brakes the motion relative to the target, whose velocity is its way in the step over the
    step. force is what the hand feels.

    With a max_force [N] the grip slips where more would be needed: it then draws the particle towards the
    target with that force. Until then a rigid grip yields by at most a thousandth of the tendon's radius.
    With SolverOptions(iteration="single") the limit acts one step late.

    Example:
        >>> hand, other = tendon.grip(0), tendon.grip(-1, max_force=2)
        >>> other.target = other.target - (0, 0, 0.001)
        >>> world.step(120)
        >>> print(f"{other.slipping}, {other.force[2]:.2f} N")
        True, 2.00 N
    """

    def __init__(self, tendon, particle, number, target, stiffness, damping, direction=None, max_force=None):
        super().__init__(tendon, particle, number)
        self._direction = direction
        if direction is not None:
            tendon._core.set_clamp(tendon._slot, number, direction)
        self._stiffness = stiffness
        self._damping = damping
        self._max_force = max_force
        self.target = target

    def _holder(self) -> str:
        return ", slipping" if self.slipping else ""

    @property
    def stiffness(self) -> float | None:
        """Of a soft grip [N/m]; None: rigid."""
        return self._stiffness

    @stiffness.setter
    def stiffness(self, value) -> None:
        stiffness = None if value is None else checks.number("stiffness", value, above=0)
        self._require()
        self._stiffness = stiffness
        self._send()

    @property
    def damping(self) -> float:
        """Of a soft grip [N s/m]."""
        return self._damping

    @damping.setter
    def damping(self, value) -> None:
        damping = checks.number("damping", value, at_least=0)
        self._require()
        self._damping = damping
        self._send()

    @property
    def max_force(self) -> float | None:
        """Largest force [N]; None: no limit."""
        return self._max_force

    @max_force.setter
    def max_force(self, value) -> None:
        most = None if value is None else checks.number("max_force", value, above=0)
        self._require()
        self._max_force = most
        self._send()

    @property
    def slipping(self) -> bool:
        """Whether its force was max_force at the end of the last step."""
        if self.released or self._max_force is None:
            return False
        return self._tendon._core.anchor_slips(self._tendon._slot, self._number)

    @property
    def target(self) -> np.ndarray:
        """(3,) where the particle is to be [m], world frame."""
        return self._target.copy()

    @target.setter
    def target(self, value) -> None:
        target = checks.vector("target", value)
        self._require()
        self._target = target
        self._send()

    def _send(self) -> None:
        spring = (self._stiffness or 0.0, self._damping, self._max_force or 0.0)
        self._tendon._core.set_grip(self._tendon._slot, self._number, self._target, *spring)

    def _settings(self) -> dict:
        spring = {"stiffness": self._stiffness, "damping": self._damping, "max_force": self._max_force}
        return {**super()._settings(), **spring, "target": self.target, "direction": self.direction}

    def _restore(self, settings: dict) -> None:
        super()._restore(settings)
        self._stiffness, self._damping = settings["stiffness"], settings["damping"]
        self._max_force = settings["max_force"]
        self._target, self._direction = settings["target"], settings["direction"]

    @property
    def direction(self) -> np.ndarray | None:
        """(3,) unit tangent that a clamped end is held in, in the order of the particles; else None."""
        return None if self._direction is None else self._direction.copy()

    @direction.setter
    def direction(self, value) -> None:
        self._require()
        self._direction = clamp_direction(self._tendon, self.particle, value)
        self._tendon._core.set_clamp(self._tendon._slot, self._number, self._direction)


def clamp_direction(tendon, particle: int, value) -> np.ndarray:
    """(3,) the unit vector of a direction that the particle can be clamped in; raises where it cannot."""
    if particle not in (0, tendon.particles - 1):
        raise InvalidValue("direction", value, "None, but for the first or the last particle")
    if tendon.material.bending_stiffness == 0:
        raise InvalidValue("direction", value, "None for a tendon without bending stiffness")
    vector = checks.vector("direction", value)
    size = np.linalg.norm(vector / max(np.abs(vector).max(), 1e-300))
    if not size > 0:
        raise InvalidValue("direction", value, "other than zero")
    return vector / np.abs(vector).max() / size
