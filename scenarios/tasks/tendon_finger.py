"""TendonFinger: two tendons move a finger of three links to poses, and hold a sphere with it.

The finger is that of urdf/tendon_finger.urdf, with tendons of its own. Two flexors run in eyelets below the
hinges: the long one to the distal link, past all hinges, the short one to the proximal link, past the first.
Elastic straps above the hinges open the finger. At the palm each flexor ends on a motor. An action is the
speeds of the two motors. Gravity acts along the hinges.

The lengths of the flexors determine the pose: the short one turns the first hinge, and what the long one is
shorter than that curls the finger. With equal straps the second and the third hinge share it equally.
"""

import dataclasses
import math

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import checks
from bullet_tendon.errors import InvalidValue

from .task import Task, Verdict, drawn, scaled
from .vector import TaskVector

MODES = ("reach", "hold")
MODE_OF = {"goal": "reach", "place": "hold", "mass": "hold"}  # what options are for
HINGES = (0.0, 0.045, 0.09)  # m from the palm along the straight finger
LINKS = (0.045, 0.045, 0.04)  # m, from hinge to hinge, and from the last one to the finger's tip
FLEXOR = -0.005  # m, height of the eyelets' axes over the hinges
EYELETS = {  # of a flexor: link, start and end along it [m]
    "long": ((-1, -0.02, -0.005), (0, 0.005, 0.04), (1, 0.005, 0.04)),
    "short": ((-1, -0.02, -0.005),),
}
INSERTION = {"long": (2, 0.006), "short": (0, 0.006)}  # link, and place along it [m]
ASIDE = {"long": 0.002, "short": -0.002}  # m along the hinges
PARTICLES = {"long": 24, "short": 10}
RADIUS, BORE, CHAMFER = 0.0005, 0.0015, 0.001  # m
MOTOR = -0.03  # m along the straight finger, where a flexor ends while the finger is straight
TRAVEL = 0.024  # m, of a motor
SPEED = 0.03  # m/s, of a motor at most
STALL = 8.0  # N, of a motor
STRAP = (0.003, 0.012)  # m before, behind and over a hinge, where its strap is fastened
ELASTICITY = (1.92, 0.96, 0.96)  # N, of the straps: force at strain 1
BALL, TABLE = 0.016, 0.002  # m, radius of the sphere and half the height of its table
PALM_SIDE = (0.0166, -0.0415)  # m, x and z of the middle of where the sphere stands
SPREAD = (0.0004, 0.003)  # m, along x and z
MASS = (0.02, 0.04)  # kg, of the sphere
AWAY = np.array([0.0, 0.0, 0.5])  # m, to where the sphere and its table are moved when they are not needed
ON_TABLE, HELD = 1.25, 1.0  # s: when the table is taken away, and for how long the sphere has to stay then
REACHED, STAYED = 0.003, 0.2  # m, s: how near the goal, and for how long the tip has to be there
CURL = (0.2, 0.9)  # rad, of the second and third hinge at a goal
FIRST = (0.1, 1.0)  # rad, of the first
LEAST_WAY = 0.02  # m, from the straight finger's tip to a goal
SPARE = 0.1  # rad, of the first hinge beyond what the long flexor turns by itself
LEAST_X = 0.01  # m, of a goal from the palm
STRAIGHT = np.array([sum(LINKS), 0.0, 0.0])  # m, the tip of the straight finger
OUTSIDE = 0.5  # reward of a step farther than REACHED
SQUEEZE = np.array([3.5, 3.5])  # N, of the flexors that hold
APPROACH = np.array([1.0, 0.3])  # speed of the motors until then, over SPEED
GAIN, TENSION_GAIN = 6.0, 2.0  # of the expert: 1/s, and speed over SPEED for a tension of TENSION
UNIT = 0.1  # m, of points in observations
RATE, TENSION, FAST = 10.0, 5.0, 0.1  # rad/s, N, m/s: units of what is observed


@dataclasses.dataclass
class Episode:
    """What an episode is about.

    mode: of MODES. goal (3,): where the tip or the sphere has to be [m]. steps: made so far. near: how many
    of the last ones ended within 3 mm of the goal. has_table: whether the sphere stands on it.
    """

    mode: str
    goal: np.ndarray
    steps: int = 0
    near: int = 0
    has_table: bool = False


class TendonFinger(Task):
    """Reach poses with a finger, or hold a sphere between finger and palm.

    Action (2,): speeds of the motors of the long and of the short flexor over 30 mm/s, positive to close. A
    motor stalls at 8 N.
    Observation: a dict. "achieved_goal" (3,): the finger's tip ("reach") or the sphere's centre ("hold") over
    0.1 m, world frame; "desired_goal" (3,): where it has to be. "observation" (18,): the hinges' angles [rad]
    and rates over 10 rad/s; ways of the motors over 24 mm; tensions at the motors over 5 N; 1 in mode
    "reach", 1 in mode "hold"; what is missing to the goal in polar coordinates about the first hinge: radius
    over 50 mm, and bearing over 0.5 rad, positive where the finger has to close; the sphere's velocity over
    0.1 m/s, and 1 while it stands on its table ("reach": zero).
    Reward: "distance" (minus the distance to the goal over 0.1 m, at least -1), "outside" (-0.5 farther than
    3 mm). It is compute_reward of the goals alone.
    Success ends the episode. "reach": the tip has been within 3 mm for 0.2 s. "hold": the table, which is
    taken away after 1.25 s, has been away for 1 s, and the sphere is within 3 mm of where it stood.
    Options of reset: mode, "reach" or "hold". For "reach": goal (2,): x and z of the tip [m], where the
    flexors can lead it (InvalidValue otherwise). For "hold": place (2,) in [-1, 1]: the sphere's offset along
    x and z over 0.4 and 3 mm; mass of the sphere [kg] in [0.02, 0.04].
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 120}
    time_step = 1 / 120
    substeps = 1
    action_size = 2
    camera = {"target": (0.045, 0.0, -0.03), "distance": 0.21, "yaw": 20, "pitch": -35, "up": "y", "fov": 40}
    option_names = ("mode", "goal", "place", "mass")

    def build(self) -> None:
        p.setGravity(0, -9.81, 0, self.client)
        self.finger = self._finger()
        self.flexors = {name: self._flexor(name) for name in EYELETS}
        self.motors = {name: flexor.grip(-1, max_force=STALL) for name, flexor in self.flexors.items()}
        for hinge in range(len(HINGES)):
            self._strap(hinge)
        self.ball, self.table = self._ball_on_table()
        self.mark = self._mark()
        self._move_ball(AWAY)
        self.world.step(120)  # until all is at rest

    def _finger(self) -> int:
        """The finger, whose hinges are free."""
        path, flags = bt.data_path("tendon_finger.urdf"), p.URDF_USE_INERTIA_FROM_FILE
        finger = p.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self.client)
        for link in range(-1, len(HINGES)):
            p.changeDynamics(finger, link, lateralFriction=1.0, physicsClientId=self.client)
        for hinge in range(len(HINGES)):
            p.setJointMotorControl2(finger, hinge, p.VELOCITY_CONTROL, force=0, physicsClientId=self.client)
        return finger

    def _flexor(self, name: str) -> bt.Tendon:
        """A flexor in its eyelets; particle 0 is fastened to the finger."""
        y = ASIDE[name]
        for number, (link, start, end) in enumerate(EYELETS[name]):
            ends = (start, y, FLEXOR), (end, y, FLEXOR)
            self.world.add_tunnel(
                self.finger, link, *ends, BORE, friction=0.0, chamfer=CHAMFER, name=f"{name} {number}"
            )
        material = bt.Material.ligament(slope=300.0, toe_strain=0.02, damping=0.2, density=1120, friction=0.0)
        link, place = INSERTION[name]
        line = [(HINGES[link] + place, y, FLEXOR), (MOTOR, y, FLEXOR)]
        flexor = self.world.add_tendon(line, RADIUS, material, PARTICLES[name], f"{name} flexor")
        flexor.attach(0, self.finger, link)
        return flexor

    def _strap(self, hinge: int) -> None:
        """An elastic strap over a hinge, without tension while the hinge is straight."""
        along, over = STRAP
        material = bt.Material(
            stiffness=ELASTICITY[hinge], damping=0.02, density=1120, friction=0.0, tension_only=True
        )
        line = [(HINGES[hinge] - along, 0, over), (HINGES[hinge] + along, 0, over)]
        strap = self.world.add_tendon(line, RADIUS, material, 2, f"strap {hinge}", collides=False)
        strap.attach(0, self.finger, hinge - 1)
        strap.attach(1, self.finger, hinge)

    def _ball_on_table(self) -> tuple[int, int]:
        """The sphere and the table below it."""
        here = {"physicsClientId": self.client}
        plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.015, TABLE, 0.015], **here)
        look = p.createVisualShape(
            p.GEOM_BOX, halfExtents=[0.015, TABLE, 0.015], rgbaColor=[0.55, 0.5, 0.42, 1], **here
        )
        table = p.createMultiBody(0, plate, look, **here)
        round_shape = p.createCollisionShape(p.GEOM_SPHERE, radius=BALL, **here)
        look = p.createVisualShape(p.GEOM_SPHERE, radius=BALL, rgbaColor=[0.85, 0.35, 0.2, 1], **here)
        ball = p.createMultiBody(MASS[1], round_shape, look, **here)
        surface = {"lateralFriction": 1.0, "spinningFriction": 1e-3, "rollingFriction": 1e-4}
        p.changeDynamics(ball, -1, **surface, **here)
        return ball, table

    def _mark(self) -> int:
        """What shows where the goal is. Nothing touches it."""
        look = p.createVisualShape(
            p.GEOM_SPHERE, radius=REACHED, rgbaColor=[0.2, 0.65, 0.3, 1], physicsClientId=self.client
        )
        return p.createMultiBody(0, -1, look, physicsClientId=self.client)

    def _move_ball(self, place) -> None:
        """Put the sphere at a place, at rest on its table."""
        upright = (0, 0, 0, 1)
        p.resetBasePositionAndOrientation(self.ball, list(place), upright, self.client)
        self._move_table(place)

    def _move_table(self, place) -> None:
        """Put the table below a place of the sphere."""
        below = np.subtract(place, (0, BALL + TABLE, 0))
        p.resetBasePositionAndOrientation(self.table, below.tolist(), (0, 0, 0, 1), self.client)

    def begin(self, rng, options) -> None:
        mode = _drawn_mode(options, rng)
        point, place = _drawn_goal(rng), rng.uniform(-1, 1, 2)
        if "goal" in options:
            point = checks.vector("goal", options["goal"], 2)
            if not _is_reachable(point):
                raise InvalidValue("goal", options["goal"], "a point that the tip reaches with taut flexors")
        if "place" in options:
            place = np.clip(checks.vector("place", options["place"], 2), -1, 1)
        mass = drawn(options, "mass", *MASS, rng)
        if mode == "hold":
            point = np.add(PALM_SIDE, place * SPREAD)
        goal = np.array([point[0], 0.0, point[1]])
        p.changeDynamics(self.ball, -1, mass=mass, physicsClientId=self.client)
        self._move_ball(goal if mode == "hold" else AWAY)
        p.resetBasePositionAndOrientation(self.mark, goal.tolist(), (0, 0, 0, 1), self.client)
        self.episode = Episode(mode, goal, has_table=mode == "hold")

    def act(self, action) -> None:
        episode = self.episode
        if episode.has_table and self._seconds(episode.steps) >= ON_TABLE:
            self._move_table(AWAY)
            episode.has_table = False
        episode.steps += 1
        for (name, motor), way, speed in zip(self.motors.items(), self.ways, action.tolist(), strict=True):
            # A motor that stalls goes on from where it is.
            way = way if motor.slipping else MOTOR - motor.target[0]
            way = min(max(way + SPEED * speed * self.time_step, 0.0), TRAVEL)
            motor.target = (MOTOR - way, ASIDE[name], FLEXOR)

    def _seconds(self, steps: int) -> float:
        """Time that this many actions take."""
        return steps * self.time_step

    def measure(self) -> None:
        """Set what has to be at the goal, (3,) [m], and the state of hinges and motors.

        That is angles [rad] and rates [rad/s] of the hinges, and how far the motors' ends of the flexors are
        from where they were with the finger straight [m].
        """
        states = p.getJointStates(self.finger, range(len(HINGES)), self.client)
        self.angles, self.rates = [state[0] for state in states], [state[1] for state in states]
        self.ways = [MOTOR - float(flexor.positions[-1, 0]) for flexor in self.flexors.values()]
        if self.episode.mode == "hold":
            self.achieved = np.array(p.getBasePositionAndOrientation(self.ball, self.client)[0])
        else:
            self.achieved = _tip(self.angles)

    def judge(self) -> Verdict:
        episode = self.episode
        terms = _reward_terms(*np.float32(np.array([self.achieved, episode.goal]) / UNIT))  # as observed
        episode.near = 0 if terms["outside"] else episode.near + 1
        if episode.mode == "reach":
            success = self._seconds(episode.near) >= STAYED
        else:
            success = episode.near > 0 and self._seconds(episode.steps) >= ON_TABLE + HELD
        return Verdict(terms, success, success)

    def compute_reward(self, achieved_goal, desired_goal, info):
        """() or (...,) reward of goals (..., 3) in units of 0.1 m, for hindsight replay. info is not used."""
        return sum(_reward_terms(achieved_goal, desired_goal).values())

    def observe(self):
        episode, achieved = self.episode, self.achieved
        holds = episode.mode == "hold"
        velocity = p.getBaseVelocity(self.ball, self.client)[0] if holds else (0.0, 0.0, 0.0)
        seen = scaled(
            [
                *self.angles,
                *(rate / RATE for rate in self.rates),
                *(way / TRAVEL for way in self.ways),
                *(motor.force[0] / TENSION for motor in self.motors.values()),
                not holds,
                holds,
                *np.subtract(_polar(episode.goal), _polar(achieved)),
                *(speed / FAST for speed in velocity),
                episode.has_table,
                *(achieved / UNIT),
                *(episode.goal / UNIT),
            ]
        )
        return {"observation": seen[:-6], "achieved_goal": seen[-6:-3], "desired_goal": seen[-3:]}


class TendonFingerVector(TaskVector):
    """Many TendonFinger tasks, divided among processes."""

    task = TendonFinger


def _reward_terms(achieved, desired) -> dict[str, np.ndarray]:
    """Terms of the reward of goals (..., 3) in units of 0.1 m."""
    distance = np.sqrt(np.square(np.subtract(achieved, desired)).sum(axis=-1))
    return {
        "distance": -np.minimum(distance, 1.0),
        "outside": -OUTSIDE * (distance >= REACHED / UNIT),
    }


def _tip(angles) -> np.ndarray:
    """(3,) place of the finger's tip [m] at angles (3,) of the hinges [rad]."""
    x, z, turned = 0.0, 0.0, 0.0
    for length, angle in zip(LINKS, angles, strict=True):
        turned += angle
        x += length * math.cos(turned)
        z -= length * math.sin(turned)
    return np.array([x, 0.0, z])


def _polar(point) -> tuple[float, float]:
    """Distance over 50 mm and bearing over 0.5 rad of a point (3,) [m] seen from the first hinge."""
    x, _, z = point
    return math.hypot(x, z) / 0.05, math.atan2(-z, x) / 0.5


# Poses whose second and third hinge are equally curled: the curl, and the polar coordinates of the tip.
_CURLS = np.linspace(0.0, 1.3, 261)
_TIPS = np.array([_polar(_tip((0.0, curl, curl))) for curl in _CURLS])


def _pose(point, sign: float = 1.0) -> np.ndarray:
    """(2,) angle of the first hinge and curl, of this sign, with which the tip is at a point (3,) [rad]."""
    radius, bearing = _polar(point)
    curl = np.interp(-radius, -_TIPS[:, 0], _CURLS)
    return np.array([0.5 * (bearing - sign * np.interp(curl, _CURLS, _TIPS[:, 1])), sign * curl])


def _strap_torque(hinge: int, angle: float) -> float:
    """Of the strap that opens a hinge [N m]."""
    length, half = 2 * math.hypot(*STRAP), math.atan2(*STRAP) + 0.5 * angle
    tension = ELASTICITY[hinge] * (length * math.sin(half) / (2 * STRAP[0]) - 1)
    return tension * 0.5 * length * math.cos(half)


def _arm(angle: float) -> float:
    """Of a flexor past a hinge [m]: the mouths beside it are as far from the hinge as it is below it."""
    return -FLEXOR * math.sqrt(2) * math.cos(math.pi / 4 - 0.5 * angle)


# Angles of the first hinge, with the torque of its strap and the arm of the flexors there.
_FIRSTS = np.linspace(0.0, 1.2, 121)
_OPENING = np.array([_strap_torque(0, angle) for angle in _FIRSTS])
_ARMS = np.array([_arm(angle) for angle in _FIRSTS])


def _least_first(curl: float) -> float:
    """Angle of the first hinge [rad] at which the long flexor alone balances the straps at a curl."""
    tension = _strap_torque(1, curl) / _arm(curl)
    return float(np.interp(0.0, _OPENING - tension * _ARMS, _FIRSTS))


def _is_reachable(point) -> bool:
    """Whether a point (2,), x and z [m], is a goal for the tip."""
    first, curl = _pose((point[0], 0.0, point[1]))
    tip = _tip((first, curl, curl))
    exact = np.hypot(tip[0] - point[0], tip[2] - point[1]) < 1e-4
    within = CURL[0] <= curl <= CURL[1] and max(FIRST[0], _least_first(curl) + SPARE) <= first <= FIRST[1]
    return bool(exact and within and tip[0] >= LEAST_X and np.linalg.norm(tip - STRAIGHT) >= LEAST_WAY)


def _drawn_mode(options: dict, rng: np.random.Generator) -> str:
    """The mode of an episode: the option, the one that other options are for, or a random one."""
    mode = MODES[int(rng.integers(len(MODES)))]
    for name, its_mode in MODE_OF.items():
        mode = its_mode if name in options else mode
    if "mode" in options:
        mode = checks.choice("mode", options["mode"], MODES)
    for name, its_mode in MODE_OF.items():
        if name in options and mode != its_mode:
            raise InvalidValue(name, options[name], f"left out in mode {mode!r}")
    return mode


def _drawn_goal(rng: np.random.Generator) -> np.ndarray:
    """(2,) x and z [m] of a random goal for the tip."""
    while True:
        first, curl = rng.uniform(*FIRST), rng.uniform(*CURL)
        point = _tip((first, curl, curl))[[0, 2]]
        if _is_reachable(point):
            return point


def expert(observation) -> np.ndarray:
    """(2,) action, from the observation alone.

    "reach": the flexors take up what the hinges have to turn. "hold": the long flexor goes ahead, so that the
    finger closes behind the sphere, and both pull with steady tensions.
    """
    seen = observation["observation"]
    if seen[11] > 0.5:
        missing = SQUEEZE / TENSION - seen[8:10]
        return np.clip(TENSION_GAIN * missing, -APPROACH, APPROACH)
    first, curl = _missing(observation)
    taken = np.array([_arm(angle) for angle in seen[:3]]) * [first, curl, curl]
    return np.clip(GAIN / SPEED * np.array([taken.sum(), taken[0]]), -1, 1)


def _missing(observation) -> np.ndarray:
    """(2,) by how much the first hinge and the curl have to turn to the goal [rad]."""
    _, second, third = observation["observation"][:3]
    now = _pose(UNIT * observation["achieved_goal"], np.sign(second + third))
    return _pose(UNIT * observation["desired_goal"]) - now


def basis(observation) -> np.ndarray:
    """(10, 2): for each flexor the missing angles [rad] in "reach"; 1 and the tensions in "hold"."""
    seen = observation["observation"]
    reaches, holds = seen[10:12]
    missing = _missing(observation) if reaches else np.zeros(2)
    parts = np.concatenate([missing, holds * np.array([1, *seen[8:10]])])
    return np.kron(parts[:, None], np.eye(2))
