"""KnotTie: one hand ties an overhand knot by way-points, then both ends are pulled with 20 N.

A cord lies in an open loop: one hand holds its standing end, two fingers hold the loop, and the hand of the
task holds the other end. An action is the next way-point of that hand, and whether to let go and pull. The
hand goes straight to it, at most as fast as 0.3 m/s. Pulling ends the episode: the fingers let go, and the
hand pulls the end away from the standing end, with 20 N. Cord, fingers and the expert's way are those of the
scenario overhand_knot. There is no gravity.
"""

import dataclasses

import numpy as np
from bullet_tendon.scenarios import measure, topology
from bullet_tendon.scenarios import overhand_knot as scenario

from bullet_tendon import checks

from .task import Task, Verdict, drawn, scaled
from .vector import TaskVector

PARTICLES, FINGERS = 91, (30, 45)  # of the cord, and those that the fingers hold
# m: where the apex of a loop is beside the scenario's.
LOOPS = ((0, 0), (-0.006, 0), (-0.012, 0), (0, -0.006), (-0.006, -0.006))
OPENING, RESTING = 90, 90  # time steps in which a loop is opened, and in which it comes to rest
TURN, ASIDE = 0.5, 0.02  # rad, m: how far the start is turned about z, and moved along x and y
SPEED = 0.3  # m/s, of the hand
BOX = 0.25  # m, half the edge of the cube in which way-points are
PULL, FELT = 20.0, 0.95  # N, and the share of it that has to be felt at both ends
PULLING = 300  # time steps
POINTS, CROSSINGS = 31, 8  # of the cord that are observed
UNIT = 0.1  # m, of points in observations
WORTH, TIME_COST = 10.0, 0.02  # of the knot, of a step
HORIZON = 20  # actions
ABOVE = np.array([0.013, 0.021, 1.0])  # direction from which crossings are observed
LEG, ARC = 0.12, 6  # m, points: how far apart the expert's way-points are, and how many are before the loop


@dataclasses.dataclass
class Episode:
    """What an episode is about.

    middle (3,): of the box of way-points [m]. outward (3,): unit vector along which the end is pulled.
    target (3,): the way-point [m]. steps: made so far. is_pulled: whether the fingers have let go.
    """

    middle: np.ndarray
    outward: np.ndarray
    target: np.ndarray
    steps: int = 0
    is_pulled: bool = False


class KnotTie(Task):
    """Tie an overhand knot with one end of a cord.

    Action (4,): the next way-point of the hand, relative to where the second finger holds the loop, over
    0.25 m, world axes; and more than 0 to let go and pull. A step is 0.42 s, in which the hand moves at most
    0.125 m. Pulling takes 2.5 s and ends the episode. The 20th action pulls whatever it says.
    Observation (121,): 31 points of the cord, evenly from the standing end to the hand, relative to where the
    second finger holds the loop, over 0.1 m (the fingers hold points 10 and 15); 8 crossings of the cord seen
    from above (zero where there are fewer), in the order in which they are passed on the upper strand: shares
    of the cord at which it is above and below, and the sign of the crossing; the cord's force on the hand
    over 20 N; the share of the 20 actions that is used up.
    Reward: "knot" (10 for success), "time" (-0.02 a step). Success: pulled with 20 N at both ends, the cord
    is a trefoil.
    Options of reset: turn [rad] in [-0.5, 0.5]: of the start about z; mirrored (bool): whether the loop is on
    the other side; loop in 0 ... 4: its shape; aside (2,) in [-1, 1]: the start's offset over 20 mm.
    """

    time_step = 1 / 120
    substeps = 50
    action_size = 4
    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 3}
    camera = {"target": (0.03, 0.0, 0.0), "distance": 0.5, "yaw": 0, "pitch": -75, "fov": 45}
    option_names = ("turn", "mirrored", "loop", "aside")

    def build(self) -> None:
        self.cord = scenario.cord(self.world, PARTICLES)
        self.standing = self.cord.grip(0)
        self.fingers = [self.cord.grip(particle) for particle in FINGERS]
        self.hand = self.cord.grip(-1, max_force=PULL)
        straight = self.world.save_state()
        self.loops = [self._loop(straight, off) for off in LOOPS]

    def _loop(self, straight: int, off) -> int:
        """The number of a saved state in which the fingers hold a loop at rest."""
        self.world.restore_state(straight)
        apex = scenario.APEX + (*off, 0.0)
        ends = ((self.fingers[1], apex), (self.hand, _way(apex)[0]))
        starts = [grip.target for grip, _ in ends]
        for k in range(OPENING + RESTING):
            share = min(1.0, (k + 1) / OPENING)
            for (grip, end), start in zip(ends, starts, strict=True):
                grip.target = start + share * (end - start)
            self.world.step()
        return self.world.save_state()

    def begin(self, rng, options) -> None:
        turn = drawn(options, "turn", -TURN, TURN, rng)
        is_mirrored, loop = bool(rng.integers(2)), int(rng.integers(len(LOOPS)))
        if "mirrored" in options:
            is_mirrored = checks.flag("mirrored", options["mirrored"])
        if "loop" in options:
            loop = checks.integer("loop", options["loop"], at_least=0, at_most=len(LOOPS) - 1)
        aside = rng.uniform(-1, 1, 2)
        if "aside" in options:
            aside = np.clip(checks.vector("aside", options["aside"], 2), -1, 1)
        self.world.restore_state(self.loops[loop])
        axes = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        if is_mirrored:
            axes[:, 1] *= -1
        x = self.cord.positions @ axes.T + (*(ASIDE * aside), 0.0)
        self.cord.set_positions(x)
        for grip in (self.standing, *self.fingers, self.hand):
            grip.target = x[grip.particle]
        self.episode = Episode(middle=x[FINGERS[1]], outward=axes[:, 0], target=x[-1])
        self.substeps = type(self).substeps

    def act(self, action) -> None:
        episode = self.episode
        episode.steps += 1
        episode.target = episode.middle + BOX * action[:3]
        if action[3] > 0 or episode.steps == HORIZON:
            self._let_go()

    def _let_go(self) -> None:
        """From now on the end is pulled."""
        self.episode.is_pulled = True
        self.substeps = PULLING
        for finger in self.fingers:
            finger.release()

    def drive(self) -> None:
        """Lead the hand on from where it is; where it slips, from where the cord is."""
        episode = self.episode
        place = self.cord.positions[-1] if self.hand.slipping else self.hand.target
        target = episode.target
        if episode.is_pulled:
            target = self.standing.target + 2 * scenario.LENGTH * episode.outward
        ahead = target - place
        distance = np.linalg.norm(ahead)
        step = SPEED * self.time_step
        self.hand.target = target if distance <= step else place + step / distance * ahead

    def judge(self) -> Verdict:
        success = self.episode.is_pulled and self._holds()
        return Verdict({"knot": WORTH * success, "time": -TIME_COST}, success, self.episode.is_pulled)

    def _holds(self) -> bool:
        """Whether the cord carries the pull, and is a trefoil if it is closed far away."""
        forces = [np.linalg.norm(grip.force) for grip in (self.standing, self.hand)]
        determinant = topology.determinant(topology.closed_far(self.cord.positions))
        return bool(min(forces) >= FELT * PULL and determinant == scenario.TREFOIL)

    def observe(self):
        episode, x = self.episode, self.cord.positions
        points = x[np.linspace(0, PARTICLES - 1, POINTS).astype(int)] - episode.middle
        return scaled(points / UNIT, _crossings(x), self.hand.force / PULL, [episode.steps / HORIZON])


class KnotTieVector(TaskVector):
    """Many KnotTie tasks, divided among processes."""

    task = KnotTie


def _crossings(x) -> np.ndarray:
    """(8, 3): shares of the cord (n, 3) at which it passes over and under itself, and signs; else zero."""
    over, under = topology.crossings(x, ABOVE)
    last = len(x) - 1  # the segment from there to the beginning is none of the cord's
    open_ones = (over < last) & (under < last)
    over, under = over[open_ones], under[open_ones]
    order = np.argsort(over)[:CROSSINGS]
    along = np.diff(x, axis=0)
    upper, lower = along[over[order].astype(int)], along[under[order].astype(int)]
    seen = np.zeros((CROSSINGS, 3))
    seen[: len(order)] = np.column_stack(
        [over[order] / last, under[order] / last, np.sign(np.cross(upper, lower) @ ABOVE)]
    )
    return seen


def _way(apex) -> np.ndarray:
    """(m, 3) way-points of the hand, in the scenario's frame, around a loop with this apex (3,) [m].

    They lead through the middle of the triangle between the crossing and the two fingers.
    """
    first = scenario.START + (scenario.LENGTH * FINGERS[0] / (PARTICLES - 1), 0, 0)
    through = np.mean([apex, scenario.CROSSING, first], axis=0)
    strand = scenario.REACH * scenario.LENGTH * (PARTICLES - 1 - FINGERS[1]) / (PARTICLES - 1)
    return scenario.way_points(apex, scenario.CROSSING, through, strand, ARC)


def expert(observation) -> np.ndarray:
    """(4,) action, from the observation alone: the scenario's way, laid around the loop that is seen."""
    points = UNIT * np.reshape(observation[: 3 * POINTS], (POINTS, 3)).astype(float)
    made = round(float(observation[-1]) * HORIZON)
    standing, first, apex = points[0], points[10], points[15]
    x = measure.unit((first - standing) * (1, 1, 0))
    y = np.array([-x[1], x[0], 0])
    axes = np.column_stack([x, y * np.sign(y @ (apex - standing)), (0, 0, 1)])
    way = _in_legs(_way((apex - standing) @ axes + scenario.START))[1:]
    if made >= len(way):
        return np.array([0.0, 0.0, 0.0, 1.0])
    place = standing + axes @ (way[made] - scenario.START)
    return np.clip([*place / BOX, -1.0], -1, 1)


def _in_legs(way) -> np.ndarray:
    """(m, 3) way-points, with others between those that are farther apart than the expert wants."""
    legs = [way[:1]]
    for start, end in zip(way[:-1], way[1:], strict=True):
        parts = max(1, int(np.ceil(np.linalg.norm(end - start) / LEG)))
        legs.append(start + np.linspace(0, 1, parts + 1)[1:, None] * (end - start))
    return np.vstack(legs)
