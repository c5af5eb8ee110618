"""Bodies on a spring, moving and held, and what their exact motion and tension are.

Moving: a ball below the fixed point, let go at the spring's rest length. "hanging": under its weight;
"free": without gravity, at SPEED across the spring; "pulled": without gravity, down by PULL at once.
Held: a body that the spring pulls down with LOAD, by a fixed point that is moved away. "motor": the tip of
a lever whose hinge is held level by a position motor; "table": a box on a plane.
"""

import dataclasses
import math
from time import process_time

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.motor_hold import lever
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

from .coupled_springs import LENGTH, motion

GRAVITY, SPEED, PULL, LOAD = 9.81, 1.0, 2000.0, 200.0  # m/s^2, m/s, N, N
MOVING, HELD = ("hanging", "free", "pulled"), ("motor", "table")
DAMPING_RATIO = 0.3  # of the weight that comes to rest
HALF = 0.05  # m, of the box
MOTOR = 1e6  # N m, at most
LOST = 1e6  # m: farther away than this a body has exploded
FAILED = 1e12  # the error of a run that could not be finished, and the largest of any other
DOWN = np.array([0.0, 0.0, -1.0])


@dataclasses.dataclass(frozen=True)
class Cell:
    """One place of the table: K [N], body mass [kg], time step [s]."""

    stiffness: float
    mass: float
    time_step: float

    @property
    def omega(self) -> float:
        """Of the ball on the massless spring [1/s]."""
        return math.sqrt(self.stiffness / LENGTH / self.mass)

    @property
    def critical_damping(self) -> float:
        """C [N s] without overshoot."""
        return 2 * self.mass * self.omega * LENGTH

    def drop(self, load) -> float:
        """By how much the load [N] stretches the spring [m]."""
        return load * LENGTH / self.stiffness


def move(method, case, cell, steps) -> dict:
    """What came of a moving body.

    depths (steps,) [m] below the start; gain: the most energy gained, over the most that was put in until
    then (None: not finite); step_us: wall time of a step [us]; mass: of the body and of what of the spring
    moves with it [kg].
    """
    scene = Scene(time_step=cell.time_step, gravity=-GRAVITY * (case == "hanging"), solver=method.solver)
    with scene:
        body = _ball(scene.client, cell.mass, SPEED * (case == "free"))
        spring = method(scene, (0, 0, LENGTH), body, -1, cell.stiffness)
        pull = PULL * (case == "pulled") * DOWN
        start = _energy(scene, spring, body, cell.mass)
        depths, worst, put_in, seconds = [], 0.0, _put_in(case, cell), 0.0
        for _ in range(steps):
            try:
                seconds += _timed_step(scene, spring, body, pull)
            except bt.StepFailed:
                worst = None
                break
            at = motion(body, -1, scene.client)[0]
            work = pull @ at
            gain = _energy(scene, spring, body, cell.mass) - start - work
            if not (np.isfinite(gain) and np.abs(at).max() < LOST):
                worst = None
                break
            put_in = max(put_in, work)
            worst = max(worst, float(gain) / put_in)
            depths.append(-at[2])
    mass = cell.mass + spring.moving_mass
    step_us = 1e6 * seconds / max(1, len(depths))
    return {"depths": np.array(depths), "gain": worst, "step_us": step_us, "mass": mass}


def rest(method, cell, steps) -> float:
    """Relative error of the tension of a weight that was let go with damping."""
    with Scene(time_step=cell.time_step, gravity=-GRAVITY, solver=method.solver) as scene:
        body = _ball(scene.client, cell.mass, 0.0)
        damping = DAMPING_RATIO * cell.critical_damping
        spring = method(scene, (0, 0, LENGTH), body, -1, cell.stiffness, damping)
        return _tension_error(spring, steps, cell.mass * GRAVITY, 1)


def hold(method, case, cell, steps, last) -> float:
    """Relative error of the tension on a held body, the largest of the last steps."""
    with Scene(time_step=cell.time_step, gravity=-GRAVITY, solver=method.solver) as scene:
        body, link = (_lever if case == "motor" else _box)(scene.client, cell.mass)
        at = motion(body, link, scene.client)[0]
        spring = method(scene, at + LENGTH * DOWN, body, link, cell.stiffness)
        for _ in range(last):
            if _tension(spring) is None:
                return FAILED
        spring.move_anchor(cell.drop(LOAD) * DOWN)
        return _tension_error(spring, steps, LOAD, last)


def _tension_error(spring, steps, load, last) -> float:
    tensions = []
    for _ in range(steps):
        tensions.append(_tension(spring))
        if tensions[-1] is None:
            return FAILED
    return min(FAILED, float(np.abs(np.array(tensions[-last:]) / load - 1).max()))


def _tension(spring) -> float | None:
    """After another step; None where that fails, or is not finite."""
    try:
        spring.step()
    except bt.StepFailed:
        return None
    return spring.tension if np.isfinite(spring.tension) else None


def _timed_step(scene, spring, body, pull) -> float:
    """Seconds of the step alone."""
    if pull.any():
        at = motion(body, -1, scene.client)[0].tolist()
        p.applyExternalForce(body, -1, pull.tolist(), at, p.WORLD_FRAME, scene.client)
    start = process_time()
    spring.step()
    return process_time() - start


def _energy(scene, spring, body, mass) -> float:
    """Of motion, of height and elastic [J]."""
    at, velocity = motion(body, -1, scene.client)
    gravity = -p.getPhysicsEngineParameters(scene.client)["gravityAccelerationZ"]
    return 0.5 * mass * velocity @ velocity + mass * gravity * at[2] + spring.energy


def _put_in(case, cell) -> float:
    """Energy at hand [J]: of the motion, or of a load that falls by the spring's length, or farther."""
    if case == "free":
        return 0.5 * cell.mass * SPEED**2
    load = cell.mass * GRAVITY if case == "hanging" else PULL
    return load * max(LENGTH, 2 * cell.drop(load))


def _ball(client, mass, speed):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(mass, shape, physicsClientId=client)
    p.resetBaseVelocity(body, [speed, 0, 0], [0, 0, 0], client)
    return _undamped(body, client)


def _box(client, mass):
    """On the plane z = 0."""
    p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), physicsClientId=client)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[HALF] * 3, physicsClientId=client)
    body = p.createMultiBody(mass, shape, basePosition=[0, 0, HALF], physicsClientId=client)
    return _undamped(body, client), -1


def _lever(client, mass):
    body = lever(client, mass)
    p.setJointMotorControl2(body, 0, p.POSITION_CONTROL, 0, force=MOTOR, physicsClientId=client)
    return body, 0


def _undamped(body, client):
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    return body
