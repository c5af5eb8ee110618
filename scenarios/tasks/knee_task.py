"""KneeTask: what the tasks share in which an ACL is reconstructed.

The project's knee in a rig (knee.KneeRig), whose intact laxity was measured before its ACL was cut. The graft
is that of reconstruction.py: a ligament through two tunnels. Between two steps of a task the knee comes to
rest, so that no time passes but for one time step.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.knee import KneeRig
from bullet_tendon.scenarios.reconstruction import DRAWER, TOE

import bullet_tendon as bt
from bullet_tendon import view

from .task import Task

LACHMAN = np.radians(30.0)  # flexion at which the drawer is tested
INCREMENT = np.radians(15.0)  # of flexion, after which the knee comes to rest on its way
GRAFT_RADIUS = 0.0035  # m, in pictures
# In which the knee comes to rest on its way, and at its end; one that is too tight for that is given up.
MOST_STEPS = 40
START = np.radians(30.0)  # flexion at the beginning of an episode


class KneeTask(Task):
    """A knee without its ACL, at rest at 30 degrees.

    rig: the KneeRig; intact_drawer: of the intact knee at 30 degrees [m]; graft: the ligament of this
    episode, or None.
    """

    substeps = 1
    metadata = {**Task.metadata, "render_fps": 4}
    camera = {"target": (0, -0.012, 0), "distance": 0.27, "yaw": 55, "pitch": 10, "fov": 40, "up": "y"}

    def build(self) -> None:
        p.setGravity(0, 0, 0, self.client)
        self.rig = KneeRig(world=self.world)
        self.bones = self.rig.femur[0], self.rig.tibia[0]
        self.graft: bt.Ligament | None = None
        self.go_to(START)
        self.measure_intact()
        self.go_to(START)
        self.intact_drawer, _ = self.drawer()
        self.rig.cut("ACL")
        self.rig.settle()
        self._rested = self.rig.joints

    def measure_intact(self) -> None:
        """What else is to be known of the intact knee."""

    def start_knee(self) -> None:
        """Put the rig to the beginning of an episode, after its state was restored."""
        self.rig.load()
        self.rig.place(self._rested, START)

    def lay_graft(self, femoral, tibial, slope: float) -> None:
        """Lay the episode's graft, without tension, through tunnels as in reconstruction.reconstruct."""
        self._remove_graft()
        (inner_f, outer_f), (inner_t, outer_t) = femoral, tibial
        rig = self.rig
        points = [(rig.femur, outer_f), (rig.femur, inner_f), (rig.tibia, inner_t), (rig.tibia, outer_t)]
        path = [(*bone, tuple(map(float, point))) for bone, point in points]
        self.graft = self.world.add_ligament(path, bt.Material.ligament(slope, TOE), name="graft")
        self.graft.set_tension(0.0)

    def go_to(self, flexion: float) -> bool:
        """Flex the knee without a load; whether it came to rest in joint at the end."""
        self.rig.load()
        self.rig.flex(flexion, INCREMENT, max_steps=MOST_STEPS)
        return self._settle()

    def drawer(self) -> tuple[float, bool]:
        """Way of the tibia under 90 N from where it rests [m], and whether it came to rest in joint."""
        rested = self.rig.coordinates.anterior
        self.rig.load(anterior=DRAWER)
        rests = self._settle()
        found = self.rig.coordinates.anterior - rested
        self.rig.load()
        rests &= self._settle()
        return float(found), rests

    def _settle(self) -> bool:
        return self.rig.settle(max_steps=MOST_STEPS) and not self.rig.dislocated

    def lines(self):
        tubes, colours = self.rig.lines()
        if self.graft is not None:
            tubes.append(SimpleNamespace(positions=self.graft.points, radius=GRAFT_RADIUS))
            colours.append(view.PALETTE[0])
        return tubes, colours

    def _remove_graft(self) -> None:
        if self.graft is not None:
            self.world.remove_ligament(self.graft)
            self.graft = None

    def _restore(self) -> None:
        self._remove_graft()  # the state is that of a knee without one
        super()._restore()
