"""Tendon: what a user holds of a tendon, and how a polyline becomes its particles.

Owns: the handle, its anchors (anchors.py) and the rest lengths it was made with; positions, velocities and
forces are the core's. Goes with the core's room `tendon`.
"""

import numpy as np
from numpy.typing import ArrayLike

from . import _core, checks
from .anchors import Attachment, Grip, Line, Numbers, clamp_direction
from .bodies import Bodies
from .errors import AttachmentWarning, InvalidValue, NotCopied, UnknownId, warn
from .fixation import Fixation, Tensioner, fix_at, fix_in
from .material import Material
from .placement import Placement
from .tunnels import Tunnel

# A segment may be reeled in to, or paid out to, these shares of its first rest length [-]: shorter
# ones would make the springs needlessly stiff, longer ones lose contacts between their ends.
_SHORTEST, _LONGEST = 0.1, 4.0


class Tendon(NotCopied):
    """A tendon in a world; made by TendonWorld.add_tendon.

    Its particles are numbered 0 ... n-1, its segments 0 ... n-2. Read-outs are new arrays, computed when
    asked for.

    Example:
        >>> tendon.particles, tendon.name
        (11, 'tendon1')
        >>> print(f"{1e3 * tendon.masses.sum():.2f} g")
        1.41 g
    """

    def __init__(
        self,
        core: _core.World,
        bodies: Bodies,
        placement: Placement,
        numbers: Numbers,
        slot: int,
        name: str,
        radius: float,
        material: Material,
    ):
        self._core = core
        self._bodies = bodies
        self._placement = placement
        self._numbers = numbers
        self._slot = slot
        self._name = name
        self._radius = radius
        self._material = material
        self._anchors: dict[int, Grip | Attachment | Line] = {}
        self._first_rest = self._core.rest(slot)
        self.removed = False

    def __repr__(self) -> str:
        if self.removed:
            return f"<Tendon {self._name!r}, removed>"
        tension = self.tension
        parts = [
            f"{self.particles} particles",
            f"{1e3 * self.length:.4g} mm long (rest {1e3 * self.rest_length:.4g} mm)",
            f"radius {1e3 * self._radius:.3g} mm",
            f"tension {tension.min():.4g} to {tension.max():.4g} N",
        ]
        parts += [f"{len(self._anchors)} held"] if self._anchors else []
        parts += ["asleep"] if self.asleep else []
        parts += ["ruptured"] if self.ruptured else []
        parts += [] if self.collides else ["makes no contacts"]
        return f"<Tendon {self._name!r}: {', '.join(parts)}>"

    @property
    def name(self) -> str:
        """Its name, different from those of the world's other tendons."""
        return self._name

    @property
    def radius(self) -> float:
        """Radius of its cross-section [m]."""
        return self._radius

    @property
    def material(self) -> Material:
        """What it is made of."""
        return self._material

    @property
    def particles(self) -> int:
        """Number n of its particles."""
        return len(self._first_rest) + 1

    @property
    def positions(self) -> np.ndarray:
        """(n, 3) particles [m], world frame."""
        return self._core.positions(self._alive())

    @property
    def velocities(self) -> np.ndarray:
        """(n, 3) particles [m/s], world frame, at the end of the last step.

        With "bdf2", of tendons on free bodies: means over the last step, as pybullet's are.
        """
        return self._core.velocities(self._alive())

    @property
    def masses(self) -> np.ndarray:
        """(n,) particles [kg]: half of the mass of each adjacent segment, and set_point_mass's."""
        return self._core.masses(self._alive())

    @property
    def tension(self) -> np.ndarray:
        """(n-1,) force carried by each cross-section [N]: the sum over the springs that cross it.

        Elastic and axial damping forces at the end of the last step; compression is negative.
        """
        return self._core.tension(self._alive())

    @property
    def strain(self) -> np.ndarray:
        """(n-1,) strain of each segment [-]; 0 of those that have ruptured, which bear nothing."""
        rest = self._core.rest(self._alive())
        return self._segment_lengths() / rest - 1

    @property
    def length(self) -> float:
        """Length of the centreline [m]; of a ruptured tendon the sum of its parts, without the gaps between.

        The unloaded halves of a segment that has ruptured belong to the parts. So `length` less `rest_length`
        is the stretch of the parts.
        """
        return float(self._segment_lengths().sum())

    @property
    def rest_length(self) -> float:
        """Length of the centreline without load [m]."""
        return float(self._core.rest(self._alive()).sum())

    @property
    def energy(self) -> float:
        """Elastic energy, and kinetic energy of `velocities` [J]; of what relaxes, that of what is left."""
        return self._core.energy(self._alive())

    @property
    def asleep(self) -> bool:
        """Whether it rests, and steps leave it out until something that it feels changes."""
        return self._core.is_asleep(self._alive())

    @property
    def ruptured(self) -> bool:
        """Whether a segment of it has ended a step beyond its material's rupture force or strain."""
        return self.ruptured_segments.size > 0

    @property
    def ruptured_segments(self) -> np.ndarray:
        """Segments that have ruptured, the first one first: they carry nothing and touch nothing any more.

        Of a tendon that is loaded evenly one segment ruptures, which unloads the others.
        """
        return np.array(self._core.torn(self._alive()), dtype=int)

    @property
    def collides(self) -> bool:
        """Whether it makes contacts: False, with no body, tunnel or tendon, nor with itself. Can be set."""
        return self._core.collides(self._alive())

    @collides.setter
    def collides(self, value: bool) -> None:
        collides = checks.flag("collides", value)
        self._in_use()
        self._core.set_collides(self._slot, collides)

    def collides_with(self, bodyUniqueId: int, linkIndex: int = -1) -> bool:
        """Whether it can make contacts with a link (see TendonWorld.set_collision).

        Raises:
            UnknownId: for what is no link.

        Example:
            >>> tendon.collides_with(ball)
            True
        """
        self._in_use()
        self._bodies.require(bodyUniqueId, linkIndex)
        return self._may_meet(bodyUniqueId, linkIndex)

    def _may_meet(self, body: int, link: int) -> bool:
        """collides_with, of a link that a part of the world refers to, whether it is still there or not."""
        slot = self._bodies.find_slot(body, link)
        return self.collides if slot is None else self._core.link_collides(self._alive(), slot)

    @property
    def holds(self) -> tuple[Grip | Attachment | Line, ...]:
        """Its grips, attachments and lines of hardware that were not released, by particle."""
        return tuple(self._anchors[i] for i in sorted(self._anchors))

    def attach(
        self, particle: int, bodyUniqueId: int, linkIndex: int = -1, position: ArrayLike | None = None
    ) -> Attachment:
        """Tie a particle to a point of a link.

        Args:
            particle: its index, negative from the end. A particle can be held once.
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base.
            position: (3,) in the link's URDF frame [m]; None: where the particle is now. An
                AttachmentWarning is given where that is farther away than the radius.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> knot = tendon.attach(-1, ball, position=(0, 0, 0.01))
            >>> hand = tendon.grip(0)
            >>> world.step(480)
            >>> print(f"{knot.force[2]:.3f} N")
            0.981 N
        """
        index = self._free_particle(particle)
        bodies = self._bodies
        origin, axes = bodies.checked_frame(bodyUniqueId, linkIndex)
        now = axes.T @ (self.positions[index] - origin)
        local = now if position is None else checks.vector("position", position)
        away = np.linalg.norm(now - local)
        if away > self.radius:
            warn(
                AttachmentWarning(
                    f"particle {index} of tendon {self.name!r} is {away:.3g} m away from its point on body "
                    f"{bodyUniqueId}, link {linkIndex}: the next step draws it there. `position` is in the "
                    "link's URDF frame"
                )
            )
        link = bodies.slot(bodyUniqueId, linkIndex)
        number = self._numbers.next()
        self._core.add_attachment(self._slot, number, index, link, local)
        anchor = Attachment(self, index, number, int(bodyUniqueId), int(linkIndex), local, link)
        self._anchors[index] = anchor
        return anchor

    def grip(
        self,
        particle: int,
        target: ArrayLike | None = None,
        stiffness: float | None = None,
        damping: float = 0.0,
        direction: ArrayLike | None = None,
        max_force: float | None = None,
    ) -> Grip:
        """Hold a particle at a target, which can then be moved step by step.

        Args:
            particle: its index, negative from the end. A particle can be held once.
            target: (3,) [m], world frame; None: where the particle is.
            stiffness: of a soft grip [N/m]; None: rigid.
            damping: of a soft grip, times the velocity relative to the target's [N s/m].
            direction: (3,) tangent in which an end with bending stiffness is clamped, in the order of the
                particles; None: it is free to turn.
            max_force: the grip slips beyond it [N] (see Grip); None: no limit.

        Raises:
            InvalidType, InvalidValue: then nothing has changed.

        Example:
            >>> hand = tendon.grip(0)
            >>> world.step()
            >>> hand.target = (0, 0, 0.01)
            >>> world.step()
            >>> tendon.positions[0].round(3).tolist()
            [0.0, 0.0, 0.01]
        """
        index = self._free_particle(particle)
        where = self.positions[index] if target is None else checks.vector("target", target)
        if stiffness is not None:
            stiffness = checks.number("stiffness", stiffness, above=0)
        damping = checks.number("damping", damping, at_least=0)
        if direction is not None:
            direction = clamp_direction(self, index, direction)
        if max_force is not None:
            max_force = checks.number("max_force", max_force, above=0)
        number = self._numbers.next()
        self._core.add_grip(self._slot, number, index, where)
        anchor = Grip(self, index, number, where, stiffness, damping, direction, max_force)
        self._anchors[index] = anchor
        return anchor

    def pull(
        self, particle: int, force: float, bodyUniqueId: int, linkIndex: int, position: ArrayLike
    ) -> "Tensioner":
        """Pull a particle towards a point of a bone with a constant tension, by a device that rests on the
        bone.

        The bone gets the exact opposite of what the tendon gets. (A hand, or set_force, pulls against the
        world instead: once the graft is fixed and the hand lets go, the bone moves, and most of the tension
        is lost.)

        Args:
            particle: its index, negative from the end. A particle can be held once.
            force: the tension [N], >= 0.
            bodyUniqueId: the bone.
            linkIndex: its link, -1 for the base.
            position: (3,) of the device in the link's URDF frame [m], apart from the particle, on the way
                that it is pulled.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> device = tendon.pull(-1, 20, ball, -1, (0, 0, -0.05))
            >>> hand = tendon.grip(0)
            >>> device.force
            20.0
            >>> device.release()
        """
        index = self._free_particle(particle)
        force = checks.number("force", force, at_least=0)
        self._bodies.require(bodyUniqueId, linkIndex)
        return Tensioner(self, index, force, bodyUniqueId, linkIndex, checks.vector("position", position))

    def fix(
        self,
        where: "Tunnel | int",
        *place,
        length: float | None = None,
        stiffness: float | None = None,
        slip_load: float | None = None,
    ) -> "Fixation":
        """Fix the tendon to a bone by hardware that slips at its load.

        fix(tunnel, "screw", length=) holds all free particles within `length` of the tunnel's outer mouth,
        which is the one nearer to an end of the tendon. Each has an equal share of stiffness and load, so
        that the load moves along the screw as the particles nearest to it slip. fix(particle, bodyUniqueId,
        linkIndex, position, "button") holds one particle by a line to `position`.

        Args:
            where: a tunnel that the tendon lies in, or a particle's index.
            place: the hardware's name in fixation.HARDWARE ("screw", "tandem_washers", "washerloc",
                "button"); for a particle bodyUniqueId, linkIndex and position (3,) in the link's URDF frame
                [m] before it.
            length: of a screw [m]; None: of the tunnel.
            stiffness: of all of it together [N/m]; None: the published one of the hardware, if there is one.
            slip_load: of all of it together [N]; None: the published one.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> button = tendon.fix(-1, ball, -1, (0, 0, -0.01), "button", stiffness=2e5)
            >>> button.slip_load, button.slip
            (958.0, 0.0)
            >>> button.release()
        """
        strength = stiffness, slip_load
        if isinstance(where, Tunnel):
            if len(place) != 1:
                raise InvalidValue("place", place, "the name of the hardware, after a tunnel")
            return fix_in(self, where, place[0], length, *strength)
        if len(place) != 4:
            raise InvalidValue("place", place, "bodyUniqueId, linkIndex, position, name, after a particle")
        if length is not None:
            raise InvalidValue("length", length, "None: it is that of a screw in a tunnel")
        return fix_at(self, where, *place, *strength)

    def is_attached_to(self, bodyUniqueId: int) -> bool:
        """Whether a particle is attached to any link of the body.

        Raises:
            InvalidType: for what is no integer.

        Example:
            >>> knot = tendon.attach(-1, ball)
            >>> tendon.is_attached_to(ball)
            True
        """
        body = checks.integer("bodyUniqueId", bodyUniqueId)
        return any(a.bodyUniqueId == body for a in self.holds if isinstance(a, Attachment))

    def set_force(self, particle: int, force: ArrayLike) -> None:
        """A constant external force on a particle, until it is set again.

        Args:
            particle: its index, negative from the end.
            force: (3,) [N], world frame.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> hand = tendon.grip(0)
            >>> tendon.set_force(-1, (0, 0, -5))
            >>> world.relax()
            >>> print(f"{tendon.tension[-1]:.2f} N")
            5.00 N
        """
        index = self._particle(particle)
        self._core.set_force(self._in_use(), index, checks.vector("force", force))

    def set_point_mass(self, particle: int, mass: float) -> None:
        """A weight on a particle beside the tendon's own mass: a bob, a needle.

        It has no size and does not collide. It stays, whatever is reeled in, until it is set again.

        Args:
            particle: its index, negative from the end.
            mass: [kg], >= 0.

        Raises:
            InvalidType, InvalidValue: then nothing has changed.

        Example:
            >>> tendon.set_point_mass(-1, 0.5)
            >>> print(f"{tendon.masses[-1]:.3f} kg")
            0.500 kg
        """
        index = self._particle(particle)
        self._core.set_point_mass(self._in_use(), index, checks.number("mass", mass, at_least=0))

    def set_positions(self, positions: ArrayLike, velocities: ArrayLike | None = None) -> None:
        """Put the particles elsewhere.

        Rest lengths stay; its contacts and the history of its steps are forgotten. Neighbours at one place
        are spread by a millionth of their rest length, because springs need a direction.

        Args:
            positions: (n, 3) [m], world frame.
            velocities: (n, 3) [m/s], world frame; None: at rest.

        Raises:
            InvalidType, InvalidValue, UnknownId: also for places in a bore that is not wider than it is. Then
                nothing has changed.

        Example:
            >>> tendon.set_positions(tendon.positions + (0.05, 0, 0))
            >>> tendon.positions[0].tolist()
            [0.05, 0.0, 0.0]
        """
        shape = (self.particles, 3)
        x = checks.array("positions", positions, shape)
        v = np.zeros(shape) if velocities is None else checks.array("velocities", velocities, shape)
        self._in_use()
        self._placement.require_clearance("positions", positions, x, self._radius, self)
        self._core.set_state(self._slot, x, v)
        self._core.forget_contacts(self._slot)
        self._placement.new.add(self._slot)

    def shorten(self, length: float, end: int = 1) -> None:
        """Reel in rest length at one end; a negative length pays out.

        The end segment shrinks to a tenth of its first rest length, then the one beside it, and so on. Paying
        out goes the same way back, and then lengthens the end segment up to four times its first rest length.
        Mass and spring constants follow.

        Args:
            length: [m].
            end: 0, the first particle's, or 1, the last's.

        Raises:
            InvalidValue: where no more can be reeled in or paid out. Then nothing has changed.

        Example:
            >>> tendon.shorten(0.02)
            >>> print(f"{tendon.rest_length:.3f} m")
            0.080 m
        """
        amount = checks.number("length", length)
        checks.choice("end", end, (0, 1))
        rest = self._core.rest(self._in_use())
        order = slice(None) if end == 0 else slice(None, None, -1)
        moved = _reeled(rest[order], self._first_rest[order], amount)
        if moved is None:
            least = self._first_rest * _SHORTEST
            allowed = f"between {rest[order][0] - _LONGEST * self._first_rest[order][0]:.6g} (pay out) and "
            raise InvalidValue("length", length, allowed + f"{(rest - least).sum():.6g} (reel in) [m]")
        self._core.set_rest(self._slot, moved[order])

    def _segment_lengths(self) -> np.ndarray:
        """(n-1,) of ruptured segments the rest length: that of their halves, not of the gap [m]."""
        lengths = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        torn = self.ruptured_segments
        if torn.size:
            lengths[torn] = self._core.rest(self._slot)[torn]
        return lengths

    def _in_use(self) -> int:
        """Its slot, for what changes it. Raises UnknownId where it was removed or the client disconnected."""
        self._bodies.require_client()
        return self._alive()

    def _alive(self) -> int:
        if self.removed:
            raise UnknownId("tendon", self._name, "one that was not removed")
        return self._slot

    def _particle(self, particle) -> int:
        n = self.particles
        return checks.integer("particle", particle, at_least=-n, at_most=n - 1) % n

    def _free_particle(self, particle) -> int:
        self._in_use()
        index = self._particle(particle)
        if index in self._anchors:
            raise InvalidValue("particle", particle, "one that is not gripped or attached already")
        return index


def _reeled(rest, first, amount):
    """Rest lengths from the reel inwards after reeling in `amount`, or None where it does not fit."""
    rest = rest.copy()
    for k in range(len(rest)) if amount > 0 else reversed(range(len(rest))):
        bound = _SHORTEST * first[k] if amount > 0 else max(rest[k], (_LONGEST if k == 0 else 1.0) * first[k])
        taken = min(amount, rest[k] - bound) if amount > 0 else max(amount, rest[k] - bound)
        rest[k] -= taken
        amount -= taken
    return rest if abs(amount) <= 1e-12 * first.sum() else None


def particle_positions(points: ArrayLike, particles: int | None) -> np.ndarray:
    """(n, 3) particles along the polyline `points` (m, 3) [m].

    particles: how many, evenly spaced by arc length; None: the points themselves. At corners the
    centreline cuts across, so it can be shorter than the polyline. Raises InvalidType or InvalidValue,
    also where neighbouring points coincide, or where there would be more than checks.MOST_PARTICLES.
    """
    line = checks.array("points", points, (None, 3))
    if len(line) < 2:
        raise InvalidValue("points", points, "at least 2 points")
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    if not (lengths > 1e-9 * lengths.max()).all() or lengths.max() == 0:
        raise InvalidValue("points", points, "distinct from one point to the next")
    if particles is None:
        if len(line) > checks.MOST_PARTICLES:
            allowed = f"at most {checks.MOST_PARTICLES} points, or resampled to `particles`"
            raise InvalidValue("points", f"{len(line)} points", allowed)
        return line
    n = checks.integer("particles", particles, at_least=2, at_most=checks.MOST_PARTICLES)
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    even = np.linspace(0.0, arc[-1], n)
    return np.column_stack([np.interp(even, arc, line[:, c]) for c in range(3)])
