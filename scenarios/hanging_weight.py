"""A weight hangs on a tendon and bobs: static stretch, tension and period against their formulas.

A ball is let go where the tendon is not yet stretched. It bobs with the period of a mass on a spring,
2 pi sqrt(m L / K), m the ball's mass and half of the one-segment tendon's, and comes to rest where
K strain carries the weight. The period is taken from the first two seconds, without damping; then the
tendon is damped until the weight hangs still.
"""

import math

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

LENGTH, RADIUS, STIFFNESS, BOB = 0.3, 0.002, 60.0, 0.5  # m, m, N, kg
GRAVITY = 9.81
DAMPING = 12.0  # N s, of the second tendon
BOBBING, RESTING = 2.0, 6.0  # s
ASIDE = 0.12  # m, between both


def build(options) -> Scene:
    scene = Scene(options, time_step=1 / 1000)
    h = scene.handles
    h.bobbing, h.ball = _weight(scene, "bobbing", 0.0, 0.0, 2)
    h.resting, h.other = _weight(scene, "resting", ASIDE, DAMPING, 20)
    scene.camera = {"target": (0.5 * ASIDE, 0, -0.2), "distance": 0.6, "yaw": 0, "pitch": -5}
    scene.labels.update(ylabel="height [m]", title="Two weights on tendons")
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    scene.mark("before")
    heights, times = [], []
    for _ in progress(range(round((BOBBING + RESTING) / scene.time_step)), "bobbing"):
        scene.step()
        for name, ball in (("bobbing", h.ball), ("resting", h.other)):
            scene.record(name, p.getBasePositionAndOrientation(ball, scene.client)[0][2])
        heights.append(h.bobbing.positions[-1, 2]), times.append(scene.time)
    scene.mark(f"{scene.time:.0f} s")
    few = round(BOBBING / scene.time_step)
    period, exact = _period(np.array(times[:few]), np.array(heights[:few])), _exact_period(h.bobbing)
    scene.measure("period", period, "s")
    scene.measure("period, error", abs(period / exact - 1))
    tension = _static_tension(h.resting)
    stretch = (1 + tension / STIFFNESS).mean() * LENGTH
    scene.measure("stretched length", h.resting.length, "m")
    scene.measure("stretch, error", abs(h.resting.length - stretch) / (stretch - LENGTH))
    scene.measure("tension, error", np.abs(h.resting.tension / tension - 1).max())


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check.at_most("period, error", m["period, error"], 0.01),
        Check.at_most("stretch, error", m["stretch, error"], 1e-6),
        Check.at_most("tension, error", m["tension, error"], 1e-6),
    ]


def _weight(scene, name, x, damping, particles):
    """A tendon hanging from its gripped end, and the ball on its other end."""
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.03, physicsClientId=scene.client)
    ball = p.createMultiBody(BOB, shape, -1, (x, 0, -LENGTH - 0.03), physicsClientId=scene.client)
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=scene.client)
    material = bt.Material(stiffness=STIFFNESS, damping=damping)
    ends = [(x, 0, 0), (x, 0, -LENGTH)]
    tendon = scene.world.add_tendon(ends, RADIUS, material, particles, name)
    tendon.grip(0)
    tendon.attach(-1, ball)
    return tendon, ball


def _exact_period(tendon) -> float:
    mass = BOB + tendon.masses[-1]
    return 2 * math.pi * math.sqrt(mass * LENGTH / STIFFNESS)


def _period(times, heights) -> float:
    """Mean time between upward passages of the mean height [s]."""
    off = heights - heights.mean()
    up = np.flatnonzero((off[:-1] < 0) & (off[1:] >= 0))
    when = times[up] - off[up] * (times[up + 1] - times[up]) / (off[up + 1] - off[up])
    return float(np.diff(when).mean())


def _static_tension(tendon) -> np.ndarray:
    """(n-1,) weight of all that hangs below each segment [N]."""
    below = np.cumsum(tendon.masses[::-1])[::-1][1:]
    return GRAVITY * (below + BOB)
