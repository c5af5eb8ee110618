"""ReadsOut: what a TendonWorld tells of its last step and of where its tendons are."""

import numpy as np

from .penetration import Surroundings
from .report import contact_table, penetration_table
from .tunnels import Bores


class ReadsOut:
    """Contacts, wrenches and penetrations; part of TendonWorld, whose core, bodies and obstacles it reads."""

    @property
    def contacts(self) -> np.ndarray:
        """Structured array of the last step's contacts (fields: report.CONTACT), sorted by tendon.

        position: (3,) on the centreline [m]; normal: (3,) from the body to the tendon; distance
        between the surfaces [m], negative where they overlap; forces [N]. kind: "bone", "bore",
        "mouth" or "tendon" (another tendon, or the tendon itself; bodyUniqueId is then -1).
        """
        return contact_table(self._core.contacts(), self._names(), self._bodies.links)

    def wrench(self, bodyUniqueId: int, linkIndex: int = -1) -> np.ndarray:
        """(6,) force [N] and torque about the centre of mass [N m] of all tendons on a link.

        World frame, of the last step; zero for links that no tendon can touch. Static links too.
        On a free body that turns by a tenth of a radian or more within the step, or would be swung by half
        of one, arms are those that it turns to.
        """
        self._bodies.require(bodyUniqueId, linkIndex)
        slot = self._bodies.find_slot(bodyUniqueId, linkIndex)
        wrenches = self._core.wrenches()
        return wrenches[slot] if slot is not None and slot < len(wrenches) else np.zeros(6)

    def penetrations(self) -> np.ndarray:
        """Structured array of the tendons' segments that are inside an obstacle or cross its surface, now.

        Fields: report.PENETRATION. position (3,): the deepest point of the segment's centreline [m];
        normal (3,): the near way out; depth [m] of that point beneath the surface. Open surfaces
        have no inside: where they are crossed, depth and normal are nan. Stretches in a bore
        of the link are left out. Obstacles added after a tendon are seen too. No step asks for this.
        Raises UnknownId where an obstacle's body was removed from pybullet.
        """
        return penetration_table({t.name: t.positions for t in self.tendons}, self._surroundings())

    def _surroundings(self) -> Surroundings:
        self._bodies.require_alive()
        return Surroundings(self._obstacles.placed(), Bores(self.tunnels, self._bodies.frame))
