"""Grip and Attachment: particles of a tendon that are tied to something."""

import numpy as np

from . import checks
from .errors import InvalidValue, UnknownId


class _Hold:
    """What grips and attachments share: a particle of a tendon that is tied to something."""

    def __init__(self, tendon, particle: int, number: int):
        self._tendon = tendon
        self.particle = particle
        self._number = number
        self._released = False

    @property
    def released(self) -> bool:
        """True once release() was called, or the tendon was removed."""
        return self._released or self._tendon.removed

    @property
    def force(self) -> np.ndarray:
        """(3,) force of the tendon on what holds it, in the last step [N], world frame.

        Zero before the first step and after the release.
        """
        if self.released:
            return np.zeros(3)
        return np.array(self._tendon._core.hold_force(self._tendon._slot, self._number))

    def release(self) -> None:
        """Let go. Doing so twice does nothing."""
        if not self.released:
            self._tendon._core.remove_hold(self._tendon._slot, self._number)
            self._tendon._holds.pop(self.particle, None)
        self._released = True

    def _require(self) -> None:
        if self.released:
            raise UnknownId(type(self).__name__.lower(), self.particle, "one that was not released")


class Attachment(_Hold):
    """A particle tied to a point of a pybullet link; made by Tendon.attach.

    force is what the tendon does to the body; its exact opposite acts on the tendon.
    """

    def __init__(self, tendon, particle, number, bodyUniqueId, linkIndex, position):
        super().__init__(tendon, particle, number)
        self.bodyUniqueId = bodyUniqueId
        self.linkIndex = linkIndex
        self.position = position


class Grip(_Hold):
    """A particle led by a hand, a suture or a haptic device; made by Tendon.grip.

    Without a stiffness the particle is at `target` at the end of every step, exactly. With one
    it is drawn there by a spring [N/m] and a damper [N s/m] (the virtual coupling of haptics).
    force is what the hand feels.
    """

    def __init__(self, tendon, particle, number, target, stiffness, damping, direction=None):
        super().__init__(tendon, particle, number)
        self._direction = None
        if direction is not None:
            self.direction = direction
        self.stiffness = stiffness
        self.damping = damping
        self.target = target

    @property
    def target(self) -> np.ndarray:
        """(3,) where the particle is to be [m], world frame."""
        return self._target.copy()

    @target.setter
    def target(self, value) -> None:
        target = checks.vector("target", value)
        self._require()
        self._target = target
        self._tendon._core.set_grip(
            self._tendon._slot, self._number, target, self.stiffness or 0.0, self.damping
        )

    @property
    def direction(self) -> np.ndarray | None:
        """(3,) unit tangent that a clamped end is held in, in the order of the particles; else None."""
        return None if self._direction is None else self._direction.copy()

    @direction.setter
    def direction(self, value) -> None:
        self._require()
        if self.particle not in (0, self._tendon.particles - 1):
            raise InvalidValue("direction", value, "None, but for the first or the last particle")
        if self._tendon.material.bending_stiffness == 0:
            raise InvalidValue("direction", value, "None for a tendon without bending stiffness")
        vector = checks.vector("direction", value)
        size = np.linalg.norm(vector)
        if size == 0:
            raise InvalidValue("direction", value, "other than zero")
        self._direction = vector / size
        self._tendon._core.set_clamp(self._tendon._slot, self._number, self._direction)
