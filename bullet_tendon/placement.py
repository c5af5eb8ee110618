"""Placement: what is looked at once, where tendons were put somewhere, and by no step after that.

Owns: which tendons were put somewhere since the last step, and of which of them has been told that they are
inside a link. Goes with no room of the core.
"""

import math

import numpy as np

from .anchors import Attachment
from .bodies import Bodies
from .errors import InsideWarning, InvalidValue, ResolutionWarning, warn
from .obstacles import Obstacles
from .penetration import Obstacle, Penetrations, Surroundings
from .tunnels import Bores, Tunnel, passes

MOST_ERROR = 1.0  # of a tension, that a warning tells [-]
STRETCHED = 1e-3  # of its length, by which obstacles may stretch a tendon without a warning
UNSEEN = 0.1  # of its radius, by which a centreline may begin inside an obstacle without a warning


class Placement:
    """Looks at the tendons and tunnels of one world (by slot), among its obstacles."""

    def __init__(self, bodies: Bodies, obstacles: Obstacles, tendons: dict, tunnels: dict[int, Tunnel]):
        self._bodies, self._obstacles = bodies, obstacles
        self._tendons, self._tunnels = tendons, tunnels
        self._told: set[tuple[int, int, int]] = set()  # slot, body, link
        self.new: set[int] = set()  # slots of tendons to look at before the next step
        self.added: set[int] = set()  # of these, those that have been added

    def require_clearance(self, argument: str, value, line, radius: float, tendon=None) -> None:
        """Raise InvalidValue where a centreline (n, 3) of this radius [m] is in a bore that is not wider.

        tendon: whose centreline it will be, if it exists; bores that it does not collide with are left out.
        """
        narrow = [tunnel for tunnel in self._tunnels.values() if tunnel.radius <= radius]
        if tendon is not None:
            narrow = [t for t in narrow if tendon._may_meet(t.bodyUniqueId, t.linkIndex)]
        if narrow:
            self._bodies.require_alive()
            tunnel = Bores(narrow, self._bodies.frame).first_with(line)
            if tunnel is not None:
                bore = f"tunnel {tunnel.name!r} of radius {tunnel.radius:g}"
                allowed = f"outside {bore}, in which a tendon of radius {radius:g} has no clearance [m]"
                raise InvalidValue(argument, value, allowed)

    def require_width(self, bodyUniqueId: int, linkIndex: int, start, end, radius: float) -> None:
        """Raise InvalidValue where a tendon lies in the bore that would be made, without clearance."""
        origin, axes = self._bodies.frame(bodyUniqueId, linkIndex)
        for tendon in self._tendons.values():
            local = (tendon.positions - origin) @ axes
            meets = tendon._may_meet(bodyUniqueId, linkIndex)
            if meets and tendon.radius >= radius and passes(start, end, radius, local):
                thick = f"tendon {tendon.name!r}, which lies in the bore"
                raise InvalidValue("radius", radius, f"> {tendon.radius:g}, the radius of {thick} [m]")

    def changed_obstacles(self, body: int) -> None:
        """Shapes of a body have been added."""
        self.filled(body)
        self.find_mouths(body)

    def filled(self, body: int) -> None:
        """There is bone of a body where there was none: tell of what is inside of it now."""
        self._told = {told for told in self._told if told[1] != body}
        self.new.update(self._tendons)

    def find_mouths(self, body: int) -> None:
        """Shapes of a body have been added or removed: see where its tunnels meet the surface now."""
        for tunnel in self._tunnels.values():
            if tunnel.bodyUniqueId == body:
                self.find_mouths_of(tunnel)

    def find_mouths_of(self, tunnel: Tunnel) -> None:
        """A tunnel has been added, or the shapes of its link have changed."""
        tunnel._meet(self._obstacles.of_link(tunnel.bodyUniqueId, tunnel.linkIndex))

    def forget(self, slot: int) -> None:
        """A tendon has been removed."""
        self._told = {told for told in self._told if told[0] != slot}
        self.new.discard(slot)
        self.added.discard(slot)

    def look(self) -> None:
        """An InsideWarning for each new tendon and each link that it is inside of and not attached to there.

        One that was added and begins so near to its obstacles that they stretch it is told of as well.
        Raises UnknownId where a body was removed that something here refers to.
        """
        if not self.new:
            return
        tendons = [self._tendons[slot] for slot in sorted(self.new)]
        added = set(self.added)
        self.new.clear()
        self.added.clear()
        if not self._obstacles:
            return
        self._bodies.require_alive()
        bores = Bores(tuple(self._tunnels.values()), self._bodies.frame)
        placed = self._obstacles.placed()
        around = Surroundings(placed, bores)
        for tendon in tendons:
            inside = self._tell_inside(tendon, around)
            if tendon._slot in added and not inside:
                met = [o for o in placed if tendon._may_meet(o.bodyUniqueId, o.linkIndex)]
                _tell_stretched(tendon, Surroundings(met, bores))

    def _tell_inside(self, tendon, around: Surroundings) -> bool:
        """Whether a tendon is inside anything."""
        line = tendon.positions
        found = around.penetrated(line[:-1], line[1:])
        for obstacle, rows in found:
            key = (tendon._slot, obstacle.bodyUniqueId, obstacle.linkIndex)
            depth = _depth_inside(tendon, line, obstacle, rows)
            if key not in self._told and depth > UNSEEN * tendon.radius and tendon._may_meet(*key[1:]):
                self._told.add(key)
                warn(InsideWarning(_message(tendon, obstacle, depth)))
        return bool(found)

    def tell_coarse(
        self,
        slot: int,
        particle: int,
        link: int,
        other: int,
        angle: float,
        sliding: float,
        winding: float,
        bent: float,
        friction: float,
    ) -> None:
        """A ResolutionWarning of a tendon that turns by an angle [rad] at a particle on a link or a tendon.

        Of the slots of the link and of the other tendon, one is -1. sliding: the largest angle there while it
        slides [rad]. winding: by which a segment turns around the other tendon, if both are twisted [rad].
        bent: the part of sliding before the contact, by which a segment bends at a mouth [rad]. friction:
        coefficient of its contact there [-].
        """
        name, turn = self._tendons[slot].name, f"{math.degrees(angle):.0f} degrees at particle {particle}"
        error, around, fine, cure = _error_at_edge(bent, sliding - bent, friction), "", "", ""
        if other >= 0:
            of = "its own loop" if other == slot else f"tendon {self._tendons[other].name!r}"
            error = _error_of_winding(winding) if winding > 0 else error
            around = f", by {math.degrees(winding):.0f} around it in a segment" if winding > 0 else ""
        else:
            body, index = self._bodies.links[link]
            of = f"body {body}, link {index}"
            if any(shape.surface is not None for shape in self._obstacles.of_link(body, index)):
                error, of = max(error, 0.2), f"the mesh of {of}"
                fine, cure = " (by 6 % up to 15 degrees)", ", or use a finer mesh"
        more = " or more" if error >= MOST_ERROR else ""
        warn(
            ResolutionWarning(
                f"tendon {name!r} is too coarse for {of}: "
                f"it turns by {turn}, up to {math.degrees(sliding):.0f} as it slides{around}, and its "
                f"tension can be off by up to {math.ceil(100 * error)}%{more}{fine}. "
                f"Add particles{cure}"
            )
        )


def _error_of_winding(angle: float) -> float:
    """How much farther the ends of a chord over an angle [rad] are from the axis than its middle [-]."""
    return 1 / max(math.cos(min(angle, math.pi) / 2), 1 / (1 + MOST_ERROR)) - 1


def _error_at_edge(before: float, behind: float, friction: float) -> float:
    """How far the ratio of tensions beside a contact can exceed the capstan's, e^(mu (before + behind)) [-].

    The tendon turns by these angles [rad] before and behind the place where N presses it. Of the tensions
    T before and T' behind it, T' cos(behind) = T cos(before) + mu N and N = T' sin(behind) + T sin(before).
    """
    rise = math.cos(before) + friction * math.sin(before)
    left = (math.cos(behind) - friction * math.sin(behind)) * math.exp(friction * (before + behind)) / rise
    return 1 / max(left, 1 / (1 + MOST_ERROR)) - 1


def _message(tendon, obstacle: Obstacle, depth: float) -> str:
    link = f"body {obstacle.bodyUniqueId}, link {obstacle.linkIndex}"
    where = f"begins {depth:.3g} m deep inside" if np.isfinite(depth) else "begins across the open surface of"
    return (
        f"tendon {tendon.name!r} {where} {link}, and is not attached to it there: "
        "it may be kept inside, and steps can take long (see add_tendon, inside=)"
    )


def _tell_stretched(tendon, around: Surroundings) -> None:
    line, radius = tendon.positions, tendon.radius
    tied = [hold.particle for hold in tendon.holds if isinstance(hold, Attachment)]
    out = around.without_overlap(line, radius, tied)
    length, longer = (np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in (line, out))
    if longer <= (1.0 + STRETCHED) * length:
        return
    free = around.free(line, radius, tied)
    found = around.overlapped(line[free], line[free + 1], radius)
    obstacle, rows = max(found, key=lambda one: one[1].depth.max())
    link = f"body {obstacle.bodyUniqueId}, link {obstacle.linkIndex}"
    warn(
        InsideWarning(
            f"tendon {tendon.name!r} begins with segments {rows.depth.max():.3g} m nearer to {link}, "
            f"than its radius: pushed out, it is {100.0 * (longer / length - 1.0):.2g} % longer, and taut "
            "(see add_tendon, inside='push_out')"
        )
    )


def _depth_inside(tendon, line, obstacle: Obstacle, rows: Penetrations) -> float:
    """Depth [m] of the deepest stretch inside the obstacle that is no insertion; 0: there is none.

    An insertion is a stretch with a particle that is attached to that link, and that is nowhere deeper than
    this particle by more than a radius. Infinite where an open surface is crossed, which has no inside.
    """
    link = obstacle.bodyUniqueId, obstacle.linkIndex
    holds = [hold for hold in tendon.holds if isinstance(hold, Attachment)]
    tied = [hold.particle for hold in holds if (hold.bodyUniqueId, hold.linkIndex) == link]
    interior = obstacle.shape.interior
    unknown = np.inf if interior is not None and not interior.closed else 0.0
    depths = np.where(np.isfinite(rows.depth), rows.depth, unknown)
    deepest = 0.0
    for stretch in np.split(np.arange(len(depths)), np.flatnonzero(np.diff(rows.segment) > 1) + 1):
        depth = float(depths[stretch].max())
        own = [i for i in tied if rows.segment[stretch[0]] <= i <= rows.segment[stretch[-1]] + 1]
        if own:
            known = obstacle.penetrated(line[own], line[own]).depth
            allowed = np.max(known, where=np.isfinite(known), initial=0.0) + tendon.radius
            depth = 0.0 if depth <= allowed or np.isinf(depth) else depth
        deepest = max(deepest, depth)
    return deepest
