"""TunnelPlacement: one decision, where to drill femur and tibia for a graft.

The ACL is cut. Both tunnels are drilled where the action says, and a graft is fixed in them at 20 degrees.
Its stiffness and its tension are given. Two things are wanted: the drawer under 90 N at 30 degrees is that of
the intact knee, and the graft is isometric, which means that the way between both inner mouths keeps its
length while the intact knee is flexed from 0 to 90 degrees.
"""

import dataclasses

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.reconstruction import FIXED_AT, SLOPE, TIBIAL, fix, on_bernards_grid

from .knee_task import LACHMAN, KneeTask
from .task import Verdict, drawn, scaled
from .vector import TaskVector

DEEP, LOW = (0.2, 0.5), (0.2, 0.5)  # of the femoral mouth on Bernard's grid
FORWARD, SIDEWAYS = 5e-3, 4e-3  # m: most that the tibial tunnel is moved from that of knee.urdf
TENSIONS, SLOPES = (40.0, 90.0), (0.6, 1.2)  # N; of SLOPE
FLEXED = tuple(np.radians(range(0, 91, 15)))  # flexions between which the graft is to keep its length
NEAR, ISOMETRIC = 0.5e-3, 1.5e-3  # m: errors of the drawer and changes of length that count as none
WORST = 5.0  # mm of each that cost
GOAL, CHANGE_COST = 5.0, 0.5  # of the reward; for each mm


@dataclasses.dataclass
class Episode:
    """What an episode is about, and what came of it.

    tension [N], slope (of SLOPE): of the graft. error: of the drawer; change: of the length [m], once placed.
    at_rest: whether the knee came to rest.
    """

    tension: float
    slope: float
    placed: bool = False
    error: float = 0.0
    change: float = 0.0
    at_rest: bool = True


class TunnelPlacement(KneeTask):
    """Place both tunnels of a graft. One step.

    Action (4,): place of the femoral mouth on Bernard's grid, depth from 0.2 to 0.5 and height below the roof
    from 0.2 to 0.5; shift of the tibial tunnel forwards over 5 mm and sideways (lateral) over 4 mm.
    Observation (5,): the graft's tension (T - 65 N) / 25 N; its slope, over that of a hamstring graft, less
    0.9, over 0.3; once placed, the drawer's error over 2 mm, the change of length over 5 mm, and 1.
    Reward: "drawer" (minus the error in mm, at most 5), "anisometry" (-0.5 for each mm of the change of
    length, at most 5), "goal" (5 where the error is at most 0.5 mm and the change at most 1.5 mm). The
    episode ends with the step.
    Options of reset: tension [N] in [40, 90]; slope in [0.6, 1.2].
    """

    action_size = 4
    option_names = ("tension", "slope")

    def measure_intact(self) -> None:
        frames = []
        for flexion in FLEXED:
            self.go_to(flexion)
            frames.append([self._frame(*bone) for bone in (self.rig.femur, self.rig.tibia)])
        self._frames = frames

    def begin(self, rng, options) -> None:
        tension = drawn(options, "tension", *TENSIONS, rng)
        self.episode = Episode(tension, drawn(options, "slope", *SLOPES, rng))
        self.start_knee()

    def act(self, action) -> None:
        episode = self.episode
        share = 0.5 * (action + 1)
        femoral = on_bernards_grid(DEEP[0] + share[0] * np.ptp(DEEP), LOW[0] + share[1] * np.ptp(LOW))
        tibial = np.array(TIBIAL) + (FORWARD * action[2], 0.0, SIDEWAYS * action[3])
        self.lay_graft(femoral, tibial, episode.slope * SLOPE)
        self.graft.set_tension(episode.tension)
        rests = self.go_to(FIXED_AT)
        fix(self.graft, episode.slope * SLOPE)
        rests &= self.go_to(LACHMAN)
        found, still = self.drawer()
        episode.error = found - self.intact_drawer
        episode.change = self._change(femoral[0], tibial[0])
        episode.at_rest, episode.placed = rests and still, True

    def judge(self) -> Verdict:
        episode = self.episode
        off, change = 1e3 * abs(episode.error), 1e3 * episode.change
        success = episode.at_rest and abs(episode.error) <= NEAR and episode.change <= ISOMETRIC
        terms = {
            "drawer": -min(WORST, off if episode.at_rest else WORST),
            "anisometry": -CHANGE_COST * min(WORST, change),
            "goal": GOAL * success,
        }
        return Verdict(terms, success, True)

    def observe(self):
        episode = self.episode
        return scaled(
            [(episode.tension - 65) / 25, (episode.slope - 0.9) / 0.3],
            [episode.error / 2e-3, episode.change / 5e-3, float(episode.placed)],
        )

    def _frame(self, body: int, link: int) -> tuple[np.ndarray, np.ndarray]:
        """Origin (3,) [m] and axes (3, 3), as columns, of a bone's frame now."""
        if link < 0:
            origin, turn = p.getBasePositionAndOrientation(body, self.client)
        else:
            origin, turn = p.getLinkState(body, link, 0, 1, self.client)[4:6]
        return np.array(origin), np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))

    def _change(self, femoral, tibial) -> float:
        """Longest less shortest way between two points of the bones, as the intact knee is flexed [m]."""
        ends = [
            (femur[0] + femur[1] @ femoral, tibia[0] + tibia[1] @ tibial) for femur, tibia in self._frames
        ]
        return float(np.ptp([np.linalg.norm(a - b) for a, b in ends]))


# Action by 1, tension and slope as they are observed: where a quadratic fit to 420 tested placements has the
# drawer of the intact knee and the least change of length.
PLACES = np.array(
    [
        [0.294, -1.0, 0.108, -0.957],
        [0.081, 0.0, -0.495, -0.008],
        [0.004, 0.0, -0.068, 0.011],
    ]
)


def expert(observation) -> np.ndarray:
    """(4,) action: deep in the notch; the tibial tunnel is farther back, the tighter the graft."""
    return np.clip(np.append(1.0, observation[:2]) @ PLACES, -1, 1)


def basis(observation) -> np.ndarray:
    """(12, 4): for each number of the action 1, tension and slope."""
    return np.kron(np.append(1.0, observation[:2])[:, None], np.eye(4))


class TunnelPlacementVector(TaskVector):
    """Many TunnelPlacement tasks, divided among processes."""

    task = TunnelPlacement
