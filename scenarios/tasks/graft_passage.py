"""GraftPassage: a hand leads a graft through the tibial and the femoral tunnel of the knee.

The knee is the project's own, flexed by 0 to 90 degrees, with its bones fixed. The graft lies below the
tibial tunnel. A hand holds its leading end, a constant force of 10 N holds back the other one. An action is
the velocity of the hand, at most 0.06 m/s along each axis of the world. The episode ends when the leading end
is 12 mm beyond the last mouth.
"""

import dataclasses
import math

import numpy as np
import pybullet as p
from bullet_tendon.scenarios import graft_passage as scenario
from bullet_tendon.scenarios import measure

import bullet_tendon as bt
from bullet_tendon import checks

from .task import Task, Verdict, drawn, scaled
from .vector import TaskVector

GRAFTS = ((0.0025, 0.6), (0.0030, 0.3), (0.0035, 0.1), (0.0035, 0.4))  # radius [m] and friction
LENGTH, PARTICLES = 0.12, 40  # of a graft [m]
PARKED = np.array([0.0, -0.5, 0.5])  # m, where the grafts hang that the episode does not use
SPEED = 0.06  # m/s, of the hand along each axis
GRASP = 40.0  # N, at which the hand slips
FLEXION = math.radians(90)  # the largest
ASIDE = 0.004  # m, by which the start may be off the tunnel's axis
CORRIDOR = 0.006  # m, within which the hand follows the way outside of bores
WINDOW = 0.015  # m of the way that are looked at ahead
STAGES, CLOSE = 8, 0.004  # of the way, that the learned policy tells apart; m
LOOK_AHEAD = 0.006  # m of the way, of the expert
POINTS = 12  # of the graft that are observed
REACH = 0.1  # m, the unit of observed lengths
FELT, TOLERATED = 20.0, 20.0  # N: the unit of observed forces, and what costs nothing
WORTH, FORCE_COST, TIME_COST = 10.0, 0.1, 0.01  # of the whole way, of 20 N too much, of a step


@dataclasses.dataclass
class Episode:
    """What an episode is about.

    graft: index in GRAFTS. way: (6, 3) [m], polyline of the hand; arc: (6,) its arc lengths [m].
    reached: arc length that was reached [m]. command: the last action.
    """

    graft: int
    way: np.ndarray
    arc: np.ndarray
    reached: float = 0.0
    command: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))


class GraftPassage(Task):
    """Lead a graft through two bone tunnels.

    Action (3,): velocity of the hand over 0.06 m/s, world axes. Observation (56,): 12 points of the graft and
    the four ends of the tunnels relative to the hand, over 0.1 m; the graft's force on the hand over 20 N;
    the last action; the share of the way that was made; the clearance in the bores over 1 mm.
    Reward: "way" (10 for the whole way), "force" (-0.1 a step for 20 N beyond 20 N), "time" (-0.01 a step).
    Options of reset: flexion [rad] in [0, pi/2]; graft in 0 ... 3 (radius 2.5, 3, 3.5, 3.5 mm, friction 0.6,
    0.3, 0.1, 0.4); aside (2,) in [-1, 1]: the start's offset from the tunnel's axis over 4 mm.
    """

    action_size = 3
    camera = {"target": (0.0, -0.01, 0.0), "distance": 0.28, "yaw": 35, "pitch": 8, "up": "y", "fov": 40}
    option_names = ("flexion", "graft", "aside")

    def build(self) -> None:
        p.setGravity(0, -9.81, 0, self.client)  # the knee's y axis points up the leg
        self.femur, self.tibia = (self._load(f"{name}.urdf") for name in ("femur", "tibia"))
        self.bones = self.femur, self.tibia
        bores = {tunnel.bodyUniqueId: tunnel for tunnel in self.world.tunnels}
        self.tunnels = bores[self.tibia], bores[self.femur]
        material = bt.Material.preset("hamstring_graft")
        self.grafts, self.hands = [], []
        for index, (radius, friction) in enumerate(GRAFTS):
            line = PARKED + [[0.02 * index, 0, 0], [0.02 * index, -LENGTH, 0]]
            made = dataclasses.replace(material, friction=friction)
            graft = self.world.add_tendon(line, radius, made, PARTICLES, f"graft {index}")
            self.grafts.append(graft)
            self.hands.append(graft.grip(0, max_force=GRASP))
        self.world.step(240)  # until those that hang there are asleep

    def _load(self, name: str) -> int:
        flags = p.URDF_USE_INERTIA_FROM_FILE
        return self.world.load_urdf(bt.data_path(name), useFixedBase=True, flags=flags)

    @property
    def graft(self) -> bt.Tendon:
        """The graft of this episode."""
        return self.grafts[self.episode.graft]

    @property
    def hand(self):
        """The grip that leads it."""
        return self.hands[self.episode.graft]

    def begin(self, rng, options) -> None:
        flexion = drawn(options, "flexion", 0.0, FLEXION, rng)
        index = int(rng.integers(len(GRAFTS)))
        if "graft" in options:
            index = checks.integer("graft", options["graft"], at_least=0, at_most=len(GRAFTS) - 1)
        aside = rng.uniform(-1, 1, 2)
        if "aside" in options:
            aside = np.clip(checks.vector("aside", options["aside"], 2), -1, 1)
        turn = p.getQuaternionFromEuler([0, 0, -flexion])
        inertial = p.getDynamicsInfo(self.tibia, -1, self.client)[3:5]
        place = p.multiplyTransforms((0, 0, 0), turn, *inertial)
        p.resetBasePositionAndOrientation(self.tibia, *place, self.client)
        way = scenario.way_of_hand([tunnel.ends for tunnel in self.tunnels])
        self.episode = Episode(index, way, scenario.arc_lengths(way))
        down = measure.unit(way[0] - way[1])
        across = np.cross(down, [0, 0, 1])
        off = ASIDE * (aside[0] * measure.unit(across) + aside[1] * measure.unit(np.cross(down, across)))
        start = way[0] + off
        self.graft.set_positions(start + np.linspace(0, LENGTH, PARTICLES)[:, None] * down)
        self.hand.target = start
        self.graft.set_force(-1, scenario.HELD_BACK * down)

    def act(self, action) -> None:
        self.episode.command = action
        self._from = self.graft.positions[0] if self.hand.slipping else self.hand.target
        self._count = 0

    def drive(self) -> None:
        self._count += 1
        self.hand.target = self._from + SPEED * self._count * self.time_step * self.episode.command

    def judge(self) -> Verdict:
        episode = self.episode
        reached = self._reached()
        gained, episode.reached = reached - episode.reached, reached
        force = float(np.linalg.norm(self.hand.force))
        done = reached >= episode.arc[-1] - 1e-3
        terms = {
            "way": WORTH * gained / episode.arc[-1],
            "force": -FORCE_COST * max(0.0, force - TOLERATED) / TOLERATED,
            "time": -TIME_COST,
        }
        return Verdict(terms, done, done)

    def observe(self):
        episode, x = self.episode, self.graft.positions
        hand = x[0]
        points = x[np.linspace(1, PARTICLES - 1, POINTS).astype(int)] - hand
        ends = np.concatenate([tunnel.ends for tunnel in self.tunnels]) - hand
        share = episode.reached / episode.arc[-1]
        clearance = (self.tunnels[0].radius - self.graft.radius) / 1e-3
        force = self.hand.force / FELT
        return scaled(points / REACH, ends / REACH, force, episode.command, [share, clearance])

    def _reached(self) -> float:
        """Arc length of the way that the leading end has reached [m]: what is near it, and not far ahead."""
        episode = self.episode
        ahead = episode.reached + np.linspace(0.0, WINDOW, 31)
        ahead = ahead[ahead <= episode.arc[-1]]
        if not len(ahead):
            return episode.reached
        on_way = scenario.points_at(episode.way, episode.arc, ahead)
        distance = np.linalg.norm(on_way - self.graft.positions[0], axis=1)
        nearest = int(np.argmin(distance))
        return float(ahead[nearest]) if distance[nearest] < CORRIDOR else episode.reached


def expert(observation) -> np.ndarray:
    """(3,) action: along the way through the tunnels, as it is observed, and slower under force."""
    ends = observation[3 * POINTS : 3 * POINTS + 12].reshape(2, 2, 3) * REACH
    force, share = observation[3 * POINTS + 12 : 3 * POINTS + 15], observation[3 * POINTS + 18]
    way = scenario.way_of_hand(ends)
    arc = scenario.arc_lengths(way)
    goal = scenario.points_at(way, arc, min(share * arc[-1] + LOOK_AHEAD, arc[-1]))
    speed = np.clip(1.6 - np.linalg.norm(force), 0.2, 1.0)
    return speed * goal / np.abs(goal).max()


def basis(observation) -> np.ndarray:
    """(54, 3): directions to five points of the way, each fading in and out along it, and against the force.

    The points are the tunnels' four ends and the end of the way, nearer than CLOSE in proportion.
    """
    ends = observation[3 * POINTS : 3 * POINTS + 12].reshape(2, 2, 3) * REACH
    points = scenario.way_of_hand(ends)[1:]
    directions = points / np.maximum(np.linalg.norm(points, axis=1), CLOSE)[:, None]
    force, share = observation[3 * POINTS + 12 : 3 * POINTS + 15], observation[3 * POINTS + 18]
    stages = np.maximum(0.0, 1.0 - np.abs(STAGES * share - np.arange(STAGES + 1)))
    return np.vstack([np.kron(stages[:, None], directions), np.kron(stages[:, None], force)])


class GraftPassageVector(TaskVector):
    """Many GraftPassage tasks, divided among processes."""

    task = GraftPassage
