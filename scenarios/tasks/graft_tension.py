"""GraftTension: a graft is pulled and fixed so that the knee is as loose as the other one.

The ACL is cut, and a graft lies in its tunnels. A tensioner pulls it. The surgeon chooses pull and flexion,
and fixes the graft once. Then the drawer under 90 N at 30 degrees is tested. It is to be that of the
patient's other knee, of 6.6 to 7.9 mm (the project's intact knee has 6.9 mm). A pull at more flexion makes
the knee tighter. Where the femoral tunnel is, and how stiff the graft is, changes from episode to episode.
"""

import dataclasses

import numpy as np
from bullet_tendon.scenarios.reconstruction import SLOPE, TIBIAL, fix, on_bernards_grid

from .knee_task import LACHMAN, START, KneeTask
from .task import Verdict, drawn, scaled
from .vector import TaskVector

PULLS, FIRST_PULL = (20.0, 150.0), (20.0, 50.0)  # N
FLEXIONS = (0.0, np.radians(45.0))  # rad
PULL_STEP, FLEXION_STEP = 20.0, np.radians(4.0)  # N, rad: most that a step changes
GOALS = (6.6e-3, 7.9e-3)  # m: drawers of the other knee
# On Bernard's grid, where a graft is slack in a knee at rest at 30 degrees: only then the pull decides on the
# drawer; of SLOPE.
DEEP, LOW, SLOPES = (0.2, 0.35), (0.3, 0.5), (0.6, 1.2)
NEAR = 0.3e-3  # m: a drawer that counts as that of the other knee
WORST = 5.0  # mm of the drawer's error that cost
GOAL, TIME_COST = 5.0, 0.1  # of the reward
KNOWN = tuple(np.radians((0.0, 15.0, 30.0, 45.0)))  # flexions at which the intact knee was seen


@dataclasses.dataclass
class Episode:
    """goal: drawer of the other knee [m]; pull [N]; flexion [rad]; error: of the drawer, once tested [m].

    site: deep, low on Bernard's grid; slope: of the graft, of SLOPE; at_rest: whether the knee came to rest.
    """

    goal: float
    pull: float
    site: tuple[float, float]
    slope: float
    flexion: float = START
    fixed: bool = False
    error: float = 0.0
    at_rest: bool = True


class GraftTension(KneeTask):
    """Choose pull and flexion of a graft, and fix it.

    Action (3,): change of the pull over 20 N, change of the flexion over 4 degrees, and whether to fix the
    graft now (above 0). The pull stays between 20 and 150 N, the flexion between 0 and 45 degrees.
    Observation (9,): the other knee's drawer less 7.1 mm, in mm; the pull over 100 N; the flexion over 45
    degrees; the femoral mouth's place on Bernard's grid, (deep - 0.275) / 0.075 and (low - 0.4) / 0.1; the
    graft's slope, over that of a hamstring graft, less 0.9, over 0.3; how far the tibia is in front of where
    the intact knee rests, over 5 mm; the drawer's error over 2 mm, once tested, and whether it was tested.
    Reward: "time" (-0.1 a step), "drawer" (minus the error in mm, at most 5, once tested), "goal" (5 where
    the error is at most 0.3 mm). The episode ends with the test.
    Options of reset: goal [m] in [0.0066, 0.0079]; deep in [0.2, 0.35]; low in [0.3, 0.5]; slope in [0.6,
    1.2]; pull [N] in [20, 50].
    """

    action_size = 3
    option_names = ("goal", "deep", "low", "slope", "pull")

    def measure_intact(self) -> None:
        self.intact_places = []
        for flexion in KNOWN:
            self.go_to(flexion)
            self.intact_places.append(self.rig.coordinates.anterior)

    def begin(self, rng, options) -> None:
        goal = drawn(options, "goal", *GOALS, rng)
        site = drawn(options, "deep", *DEEP, rng), drawn(options, "low", *LOW, rng)
        slope = drawn(options, "slope", *SLOPES, rng)
        self.episode = Episode(goal, drawn(options, "pull", *FIRST_PULL, rng), site, slope)
        self.start_knee()
        self.lay_graft(on_bernards_grid(*site), TIBIAL, slope * SLOPE)

    def act(self, action) -> None:
        episode = self.episode
        episode.pull = float(np.clip(episode.pull + PULL_STEP * action[0], *PULLS))
        episode.flexion = float(np.clip(episode.flexion + FLEXION_STEP * action[1], *FLEXIONS))
        self.graft.set_tension(episode.pull)
        episode.at_rest = self.go_to(episode.flexion)
        if action[2] > 0:
            self._fix_and_test()

    def judge(self) -> Verdict:
        episode = self.episode
        off = 1e3 * abs(episode.error)
        success = episode.fixed and episode.at_rest and abs(episode.error) <= NEAR
        terms = {
            "time": -TIME_COST,
            "drawer": -min(WORST, off if episode.at_rest else WORST) * episode.fixed,
            "goal": GOAL * success,
        }
        return Verdict(terms, success, episode.fixed)

    def observe(self):
        episode = self.episode
        deep, low = episode.site
        at = self.rig.coordinates
        in_front = at.anterior - np.interp(at.flexion, KNOWN, self.intact_places)
        return scaled(
            [1e3 * episode.goal - 7.1, episode.pull / 100, episode.flexion / FLEXIONS[1]],
            [(deep - 0.275) / 0.075, (low - 0.4) / 0.1, (episode.slope - 0.9) / 0.3],
            [in_front / 5e-3, episode.error / 2e-3, float(episode.fixed)],
        )

    def _fix_and_test(self) -> None:
        episode = self.episode
        fix(self.graft, episode.slope * SLOPE)
        episode.fixed = True
        rests = self.go_to(LACHMAN)
        found, still = self.drawer()
        episode.error = found - episode.goal
        episode.at_rest &= rests and still


def expert(observation) -> np.ndarray:
    """(3,) action: the knee is extended, and the graft is fixed under the pull that the drawer needs."""
    wanted = WANTED @ _needs(observation)
    degrees = 45 * observation[2]
    return np.clip([(wanted - observation[1]) / 0.6, -degrees / 12, 1 - 2 * degrees], -1, 1)


# Pull over 100 N at extension by what _needs sees: a fit to 169 tested grafts, most error 2 N, median 0.4 N.
WANTED = np.array(
    [0.7004, -0.3942, 0.0474, 0.0710, 0.0971, 0.0325, -0.0094, 0.0175, -0.0003, -0.0142, -0.0117]
)


def _needs(observation) -> np.ndarray:
    """(11,) what the pull depends on: the goal, the femoral mouth, the graft's slope."""
    goal, _, _, deep, low, slope = observation[:6]
    pairs = [goal**2, deep, low, deep**2, low**2, deep * low, goal * low, goal * deep, slope]
    return np.array([1.0, goal, *pairs])


def basis(observation) -> np.ndarray:
    """(15, 3): for the pull what it depends on and itself; for flexion and fixing the flexion, and 1."""
    degrees = 45 * observation[2]
    pull = np.append(_needs(observation), observation[1])
    found = np.zeros((len(pull) + 3, 3))
    found[: len(pull), 0] = pull
    found[len(pull), 1] = min(1.0, degrees / 12)
    found[len(pull) + 1 :, 2] = 1.0, min(1.0, degrees)
    return found


class GraftTensionVector(TaskVector):
    """Many GraftTension tasks, divided among processes."""

    task = GraftTension
