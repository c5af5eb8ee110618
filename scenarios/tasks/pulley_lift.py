"""PulleyLift: a hand and a trolley bring a weight to a place and stop it there.

A rope goes from a hand over a wheel and down to a weight. The wheel turns on a hinge of a trolley, which a
motor moves along a rail. Rope, wheel, trolley and weight act on each other: a pull accelerates the weight and
turns the wheel, a moving trolley makes the weight swing. An action is the velocity of the trolley and that of
the hand, each at most 0.3 m/s, reached with 3 m/s^2. The weight has 0.5 to 3 kg; its goal is up to 0.15 m
aside and 0.1 to 0.35 m below the wheel's axis. The episode ends when the weight was at rest at its goal for a
quarter of a second.
"""

import dataclasses
import math

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import checks

from .task import Task, Verdict, drawn, scaled
from .vector import TaskVector

WHEEL, ROPE, WIDTH = 0.04, 0.002, 0.02  # m: radius of the wheel and of the rope, half the wheel's width
WHEEL_MASS, TROLLEY_MASS, MOTOR = 0.1, 1.0, 200.0  # kg, kg, N
RUN, HANGING, PARTICLES = 0.55, 0.22, 60  # m, from the hand to the wheel and down from it
SPEED, SLEW = 0.3, 3.0  # m/s and m/s^2, of trolley and hand
RAIL, LED = 0.25, (-0.85, -0.35)  # m: how far the trolley goes, and the hand's places along the rail
BALL = 0.02  # m, radius of the weight
MASSES, ASIDE, BELOW = (0.5, 3.0), 0.15, (0.10, 0.35)  # kg, m, m
NEAR, STILL = 0.01, 0.03  # m, m/s: what counts as at rest at the goal
CALM = 6  # steps for which it has to be so
UNIT, UNIT_SPEED, UNIT_FORCE = 0.1, 0.3, 30.0  # m, m/s, N: of what is observed
NEARNESS, NEAR_UNIT = 0.05, 0.05  # a step at the goal is worth, and the distance [m] at which it is a third
SWING_COST, TIME_COST = 0.02, 0.01  # of UNIT_SPEED aside, of a step
GOAL, LOST = 10.0, 5.0  # what reaching the goal is worth, and losing the weight costs
CLOSE, WIDE = 0.07, 0.2  # m: below the wheel's axis, and aside of the trolley, where the weight is lost
TROLLEY, HUB = 0, 1  # links of the crane


@dataclasses.dataclass
class Episode:
    """What an episode is about.

    goal: (2,) of the weight, along the rail and up [m]. wanted: (2,) speeds of trolley and hand that the
    action asks for [m/s]; speed: those now. calm: steps at rest.
    """

    goal: np.ndarray
    wanted: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2))
    speed: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(2))
    calm: int = 0


class PulleyLift(Task):
    """Bring a weight to its goal by the rope over a trolley's wheel.

    Action (2,): velocity of the trolley along the rail and of the hand towards the wheel, over 0.3 m/s. Both
    follow with at most 3 m/s^2.
    Observation (12,): from the weight to its goal (2,) over 0.1 m; the weight's velocity (2,) over 0.3 m/s;
    from the weight to the trolley, along the rail, over 0.1 m; the trolley's place over 0.1 m and its
    velocity over 0.3 m/s; the hand's place from the middle of its range over 0.1 m; the wheel's surface
    speed over 0.3 m/s; the force on the hand over 30 N; the velocity of trolley and hand (2,) over 0.3 m/s.
    Reward: "nearness" (0.05 a step at the goal, a third of it at 0.05 m), "swing" (-0.02 a step for each
    0.3 m/s between weight and trolley), "time" (-0.01 a step), "goal" (10 at the end), "lost" (-5: the weight
    came to the wheel, or swung by more than 0.2 m, which ends the episode).
    Options of reset: mass [kg] in [0.5, 3]; goal (2,): along the rail in [-0.15, 0.15], and below the wheel's
    axis in [0.1, 0.35] [m].
    """

    action_size = 2
    camera = {"target": (-0.1, 0.0, -0.13), "distance": 0.72, "yaw": 10, "pitch": -8, "fov": 40}
    option_names = ("mass", "goal")

    def build(self) -> None:
        p.setGravity(0, 0, -9.81, self.client)
        self.crane = _crane(self.client)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=BALL, physicsClientId=self.client)
        look = _look(self.client, p.GEOM_SPHERE, (0.30, 0.40, 0.55, 1), radius=BALL)
        arm = WHEEL + ROPE
        self.weight = p.createMultiBody(
            1.0, ball, look, (arm, 0, -HANGING - BALL), physicsClientId=self.client
        )
        angle = np.linspace(math.pi / 2, 0, 30)[:, None]
        over = arm * np.hstack([np.cos(angle), 0 * angle, np.sin(angle)])
        line = np.vstack([[-RUN, 0, arm], over, [arm, 0, -HANGING]])
        material = bt.Material(stiffness=2e4, damping=20.0, friction=0.5, density=1100)
        self.world.add_obstacle(self.crane, HUB, friction=1.0)
        self.rope = self.world.add_tendon(line, ROPE, material, PARTICLES, "rope", "push_out")
        self.hand = self.rope.grip(0)
        self.rope.attach(-1, self.weight, position=(0, 0, BALL))
        mark = _look(self.client, p.GEOM_SPHERE, (0.2, 0.7, 0.3, 1), radius=0.006)
        self.mark = p.createMultiBody(
            0, -1, mark, physicsClientId=self.client
        )  # shows the goal, touches nothing
        self._stop()
        self.world.step(240)  # until the weight hangs still

    def begin(self, rng, options) -> None:
        mass = drawn(options, "mass", *MASSES, rng)
        goal = rng.uniform((-ASIDE, BELOW[0]), (ASIDE, BELOW[1]))
        if "goal" in options:
            given = checks.vector("goal", options["goal"], 2)
            goal = np.clip(given, (-ASIDE, BELOW[0]), (ASIDE, BELOW[1]))
        inertia = [0.4 * mass * BALL**2] * 3
        p.changeDynamics(
            self.weight, -1, mass=mass, localInertiaDiagonal=inertia, physicsClientId=self.client
        )
        self._stop()
        self.episode = Episode(np.array([goal[0], -goal[1]]))
        place = (goal[0], -0.06, -goal[1])  # beside the weight's plane
        p.resetBasePositionAndOrientation(self.mark, place, (0, 0, 0, 1), self.client)

    def act(self, action) -> None:
        self.episode.wanted = SPEED * action

    def drive(self) -> None:
        episode = self.episode
        most = SLEW * self.time_step
        episode.speed = episode.speed + np.clip(episode.wanted - episode.speed, -most, most)
        self._move_trolley(episode.speed[0])
        place = self.hand.target
        place[0] = np.clip(place[0] + self.time_step * episode.speed[1], *LED)
        self.hand.target = place

    def judge(self) -> Verdict:
        episode = self.episode
        distance = float(np.linalg.norm(self._weight()[0] - episode.goal))
        velocity = np.array(p.getBaseVelocity(self.weight, self.client)[0])
        calm = distance < NEAR and np.linalg.norm(velocity) < STILL
        episode.calm = episode.calm + 1 if calm else 0
        swing = abs(velocity[0] - self._trolley()[1])
        done = episode.calm >= CALM
        lost = self._is_lost()
        terms = {
            "nearness": NEARNESS * math.exp(-distance / NEAR_UNIT),
            "swing": -SWING_COST * swing / UNIT_SPEED,
            "time": -TIME_COST,
            "goal": GOAL * done,
            "lost": -LOST * lost,
        }
        return Verdict(terms, done, done or lost)

    def observe(self):
        place, velocity = self._weight()
        trolley, rate = self._trolley()
        turn = p.getJointState(self.crane, HUB, self.client)[1] * (WHEEL + ROPE)
        return scaled(
            (self.episode.goal - place) / UNIT,
            velocity / UNIT_SPEED,
            [(trolley - place[0]) / UNIT, trolley / UNIT, rate / UNIT_SPEED],
            [(self.hand.target[0] - np.mean(LED)) / UNIT, turn / UNIT_SPEED],
            [np.linalg.norm(self.hand.force) / UNIT_FORCE],
            self.episode.speed / UNIT_SPEED,
        )

    def _weight(self) -> tuple[np.ndarray, np.ndarray]:
        """(2,) place [m] of the weight along the rail and up, and (2,) its velocity [m/s]."""
        place = np.array(p.getBasePositionAndOrientation(self.weight, self.client)[0])
        velocity = np.array(p.getBaseVelocity(self.weight, self.client)[0])
        return place[[0, 2]], velocity[[0, 2]]

    def _trolley(self) -> tuple[float, float]:
        """Place [m] along the rail of what the rope hangs from, and its velocity [m/s]."""
        place, rate = p.getJointState(self.crane, TROLLEY, self.client)[:2]
        return place + WHEEL + ROPE, rate

    def _is_lost(self) -> bool:
        place, _ = self._weight()
        return bool(place[1] > -CLOSE or abs(place[0] - self._trolley()[0]) > WIDE)

    def _stop(self) -> None:
        """The trolley's motor holds still; the wheel is free. pybullet's saved states have no motors."""
        self._move_trolley(0.0)
        p.setJointMotorControl2(self.crane, HUB, p.VELOCITY_CONTROL, force=0, physicsClientId=self.client)

    def _move_trolley(self, speed: float) -> None:
        motor = p.VELOCITY_CONTROL, 0.0, float(speed), MOTOR
        p.setJointMotorControl2(self.crane, TROLLEY, *motor, physicsClientId=self.client)


def expert(observation) -> np.ndarray:
    """(2,) action: the weight is led as if it were on a rod, and its swing is damped.

    The trolley moves towards the place below which the weight is wanted, and follows the weight's swing,
    which takes energy out of it. The hand reels in what is missing of the height, and what a moving trolley
    pays out.
    """
    to_goal, velocity, swing = observation[:2], observation[2:4], observation[4]
    missing = to_goal[0] - swing  # from the trolley to above the goal
    trolley = np.clip(1.2 * missing, -0.6, 0.6) - 0.9 * swing
    trolley = np.clip(trolley, -1, 1)
    hand = -1.5 * to_goal[1] + 0.2 * velocity[1] + trolley
    return np.clip([trolley, hand], -1, 1)


def basis(observation) -> np.ndarray:
    """(14, 2): for trolley and hand the way to the goal, velocity, swing, the trolley's velocity, and 1."""
    seen = np.append(np.clip(observation[[0, 1, 2, 3, 4, 6]], -1.5, 1.5), 1.0)
    return np.kron(seen[:, None], np.eye(2))


def _crane(client: int) -> int:
    """A rail, a trolley that slides along x on it, and a wheel on a hinge of the trolley about y."""
    wheel = p.createCollisionShape(p.GEOM_CYLINDER, radius=WHEEL, height=2 * WIDTH, physicsClientId=client)
    upright = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
    rail = _look(client, p.GEOM_BOX, (0.6, 0.6, 0.6, 1), halfExtents=[RAIL + WHEEL, 0.006, 0.004])
    cart = _look(client, p.GEOM_BOX, (0.35, 0.45, 0.5, 1), halfExtents=[0.03, 0.03, 0.008])
    disc = _look(client, p.GEOM_CYLINDER, (0.75, 0.6, 0.35, 1), radius=WHEEL, length=2 * WIDTH)
    crane = p.createMultiBody(
        0,
        -1,
        rail,
        (0, 0, 0.08),
        linkMasses=[TROLLEY_MASS, WHEEL_MASS],
        linkCollisionShapeIndices=[-1, wheel],
        linkVisualShapeIndices=[cart, disc],
        linkPositions=[(0, 0, -0.01), (0, 0, -0.07)],
        linkOrientations=[(0, 0, 0, 1), upright],
        linkInertialFramePositions=[(0, 0, 0)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_PRISMATIC, p.JOINT_REVOLUTE],
        linkJointAxis=[(1, 0, 0), (0, 0, 1)],
        physicsClientId=client,
    )
    p.changeDynamics(crane, TROLLEY, jointLowerLimit=-RAIL, jointUpperLimit=RAIL, physicsClientId=client)
    return crane


def _look(client: int, shape: int, color, **size) -> int:
    return p.createVisualShape(shape, rgbaColor=color, physicsClientId=client, **size)


class PulleyLiftVector(TaskVector):
    """Many PulleyLift tasks, divided among processes."""

    task = PulleyLift
