"""Placement: what is asked once about tendons that were put somewhere, and by no step after that.

Owns: nothing but references to the parts that it asks. Goes with no room of the core.
"""

from .bodies import Bodies
from .errors import InvalidValue
from .tunnels import Bores, Tunnel, passes


class Placement:
    """Asks about the tendons and tunnels of one world (by slot)."""

    def __init__(self, bodies: Bodies, tendons: dict, tunnels: dict[int, Tunnel]):
        self._bodies, self._tendons, self._tunnels = bodies, tendons, tunnels

    def require_clearance(self, argument: str, value, line, radius: float) -> None:
        """Raise InvalidValue where a centreline (n, 3) of this radius [m] is in a bore that is not wider."""
        narrow = [tunnel for tunnel in self._tunnels.values() if tunnel.radius <= radius]
        if narrow:
            self._bodies.require_client()
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
            if tendon.radius >= radius and passes(start, end, radius, (tendon.positions - origin) @ axes):
                thick = f"tendon {tendon.name!r}, which lies in the bore"
                raise InvalidValue("radius", radius, f"> {tendon.radius:g}, the radius of {thick} [m]")
