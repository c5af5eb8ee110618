"""A graft of four strands of particles in a KneeRig: drilled for, passed, tensioned, fixed.

The strands of a doubled hamstring graft are laid side by side below the tibial tunnel, each by its own
tendon. Passing sutures lead them through both tunnels. A button on the femur's cortex holds their leading
ends by a loop. A tensioner that rests on the tibia pulls at the other ends, until a screw holds them in the
tibial tunnel. Strands touch each other, the bores and the bones. KneeRig.come_to_rest waits for the knee.
"""

import numpy as np

import bullet_tendon as bt
from bullet_tendon import checks

from . import measure
from .graft_passage import arc_lengths, points_at
from .knee import KneeRig
from .reconstruction import FEMORAL, SLOPE, TIBIAL, TOE

# Four strands of this radius go into a bore of 2.42 times the radius. Their law is that of 57 mm^2.
RADIUS, BORE = 0.0016, 0.004  # m
APART = 1.02  # half the distance of neighbouring strands, in radii
PLACES = (1, 1), (1, -1), (-1, -1), (-1, 1)  # of the strands around the graft's axis
LENGTH, PARTICLES = 0.11, 26  # of a strand [m]
IN_FEMUR = 0.024  # length of the graft in the femoral tunnel [m]
LEAD_IN = 0.004  # of the leading ends before the tibial tunnel [m]
SPEED = 0.08  # of the passing sutures [m/s]
HELD_BACK = 1.0  # force on the other end of a strand while it is passed [N]
# A loop is longer by 2.8 to 3.2 mm when it fails, at 1455 to 2178 N (J Exp Orthop 2020,
# doi 10.1186/s40634-020-00235-9).
LOOP_STIFFNESS = 500e3  # N/m
TENSIONER = 0.06  # from the tibial tunnel's outer end [m]
SCREW = 0.02  # length [m]
WALL_FRICTION, CHAMFER = 0.5, 0.0005  # as in knee.urdf


class StrandGraft:
    """Tunnels in both bones of a rig, and four strands below the tibial one.

    femoral, tibial: inner mouth and outer end of the tunnels, in the bones' frames [m]; radius: of the bores
    [m], which four strands fill. slope [N]: of the whole graft's law beyond its toe. Nothing is cut. Raises
    InvalidType or InvalidValue.

    bundle: the strands. tunnels: tibial, femoral. buttons, screws, tensioners: by strand, empty where there
    are none.
    """

    def __init__(self, rig: KneeRig, femoral=FEMORAL, tibial=TIBIAL, radius=BORE, slope: float = SLOPE):
        radius = checks.number("radius", radius, above=0)
        slope = checks.number("slope", slope, above=0)
        self.rig, world = rig, rig.world
        wall = {"radius": radius, "friction": WALL_FRICTION, "chamfer": CHAMFER}
        self.tunnels = (
            world.add_tunnel(*rig.tibia, tibial[1], tibial[0], name="tibial", **wall),
            world.add_tunnel(*rig.femur, femoral[0], femoral[1], name="femoral", **wall),
        )
        self._radius = radius * RADIUS / BORE
        material = bt.Material.ligament(slope / len(PLACES), TOE)
        ways = self._ways()
        tail = LENGTH * measure.unit(ways[0, 0] - ways[0, 1])
        self.bundle = bt.Bundle(
            world.add_tendon([way[0], way[0] + tail], self._radius, material, PARTICLES, f"strand {k + 1}")
            for k, way in enumerate(ways)
        )
        self.buttons: tuple = ()
        self.screws: tuple = ()
        self.tensioners: tuple = ()

    @property
    def forces(self) -> np.ndarray:
        """(4,) tension of each strand between the tunnels [N]."""
        tibial, femoral = self.tunnels
        middle = 0.5 * (tibial.ends[1] + femoral.ends[0])
        return np.array([strand.tension[_nearest(strand, middle)] for strand in self.bundle.strands])

    @property
    def force(self) -> float:
        """Tension between the tunnels, of all strands [N]."""
        return float(self.forces.sum())

    @property
    def shares(self) -> np.ndarray:
        """(4,) of each strand in `force` [-]."""
        return self.forces / self.force

    def pass_through(self, watch=lambda done: None) -> None:
        """Lead the strands through both tunnels by their first particles, and hold them by a button there.

        watch(done): called after each step, with the share of the way that is done.
        """
        world = self.rig.world
        hands = [strand.grip(0) for strand in self.bundle.strands]
        outward = measure.unit(self._ways()[0, 0] - self._ways()[0, 1])
        for strand in self.bundle.strands:
            strand.set_force(-1, HELD_BACK * outward)
        length = arc_lengths(self._ways().mean(axis=0))[-1]
        steps = int(np.ceil(length / (SPEED * self.rig.time_step)))
        for k in range(1, steps + 1):
            ways = self._ways()  # the tibia is free
            arc = arc_lengths(ways.mean(axis=0))
            for hand, way in zip(hands, ways, strict=True):
                hand.target = points_at(way, arc, arc[-1] * k / steps)
            self.rig.step()
            watch(k / steps)
        for hand in hands:
            hand.release()
        femoral = self.tunnels[1]
        cortex = femoral.bodyUniqueId, femoral.linkIndex, femoral.end
        self.buttons = self.bundle.fix(0, *cortex, "button", stiffness=LOOP_STIFFNESS)
        for strand in self.bundle.strands:
            strand.set_force(-1, (0.0, 0.0, 0.0))
        world.step()

    def pull(self, tension: float) -> None:
        """Pull all strands together with a tension [N] by a tensioner that rests on the tibia."""
        for device in self.tensioners:
            device.release()
        tibial = self.tunnels[0]
        place = tibial.start + TENSIONER * measure.unit(tibial.start - tibial.end)
        self.tensioners = self.bundle.pull(-1, tension, tibial.bodyUniqueId, tibial.linkIndex, place)

    def fix(self, stiffness: float | None = None) -> None:
        """Hold the strands in the tibial tunnel by a screw, and take the tensioner off.

        stiffness [N/m] of the screw; None: the published one. The screw takes no load until the tensioner is
        off. Then it yields until its force is the tension that is left.
        """
        self.screws = self.bundle.fix(self.tunnels[0], "screw", length=SCREW, stiffness=stiffness)
        for device in self.tensioners:
            device.release()
        self.tensioners = ()

    def _ways(self) -> np.ndarray:
        """(4, 5, 3) each strand's way: before the tibial tunnel, through it, and into the femoral one [m]."""
        (outer, inner), (mouth, cortex) = self.tunnels[0].ends, self.tunnels[1].ends
        along, beyond = measure.unit(inner - outer), measure.unit(cortex - mouth)
        axis = np.array([outer - LEAD_IN * along, outer, inner, mouth, mouth + IN_FEMUR * beyond])
        side = measure.unit(np.cross(along, beyond))
        headings = np.array([along, along, along, beyond, beyond])
        ways = []
        for place in PLACES:
            offset = place[0] * side + place[1] * np.cross(headings, side)
            ways.append(axis + APART * self._radius * offset)
        return np.array(ways)


def _nearest(strand, point) -> int:
    """The segment of a tendon whose middle is nearest to a point."""
    middles = 0.5 * (strand.positions[1:] + strand.positions[:-1])
    return int(np.linalg.norm(middles - point, axis=1).argmin())
