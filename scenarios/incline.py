"""Tendons lie on two slopes, one just less and one just more steep than friction holds.

With mu = 0.5, a tendon laid on a slope of 0.499 must not creep, for 10,000 steps; one on a slope of 0.501
slides with a = g (sin - mu cos). One tendon on each slope lies across it, one along it.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

FRICTION = 0.5
HOLDS, SLIDES = 0.499, 0.501  # tangents of the slopes
RADIUS, LENGTH, PARTICLES = 0.004, 0.08, 11  # m
HALF = (0.3, 0.1, 0.01)  # m, half extents of a slope
APART = 0.24  # m, from slope to slope
LAID = 240  # steps until the slide is measured: it has begun then
STEPS, SLIDE_STEPS = 10_000, 960  # after that, and measured of the slide
CREEP = 1e-6  # m
WITHIN = 0.02  # of the acceleration


def build(options) -> Scene:
    scene = Scene(options)
    h = scene.handles
    h.gravity = 9.81
    h.slopes = [_slope(scene, HOLDS, 0.0), _slope(scene, SLIDES, APART)]
    scene.camera = {"target": (0.05, APART / 2, -0.02), "distance": 0.6, "yaw": 20, "pitch": -25}
    scene.labels.update(ylabel="way down the slope [mm]", title=f"mu = {FRICTION:g}")
    return scene


def drive(scene, progress) -> None:
    holding, sliding = scene.handles.slopes
    scene.mark("laid down")
    for k in progress(range(LAID + STEPS), "lying"):
        if k in (0, LAID):
            _note(sliding if k else holding)
        scene.step()
        if k < LAID + SLIDE_STEPS:
            scene.record(f"slope {HOLDS:g}", 1e3 * _ways(holding).mean())
            scene.record(f"slope {SLIDES:g}", 1e3 * _ways(sliding).mean())
        if k == LAID + SLIDE_STEPS - 1:
            _measure_slide(scene, sliding, SLIDE_STEPS * scene.time_step)
        scene.highest("creep", np.abs(_ways(holding) - holding.ways).max(), "m")


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check.at_most("creep", m["creep"], CREEP),
        Check.at_most("acceleration beside g (sin - mu cos)", abs(m[_SLIDE]), WITHIN),
    ]


_SLIDE = "acceleration beside g (sin - mu cos)"


def _slope(scene, tangent, aside) -> SimpleNamespace:
    """A slope that falls along x, `aside` along y [m], with a tendon across it and one along it."""
    angle = np.arctan(tangent)
    down = np.array([np.cos(angle), 0, -np.sin(angle)])
    up = np.array([np.sin(angle), 0, np.cos(angle)])
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=HALF, physicsClientId=scene.client)
    turn = p.getQuaternionFromEuler([0, angle, 0])
    place = (0, aside, 0) - HALF[2] * up
    body = p.createMultiBody(0, shape, -1, place.tolist(), turn, physicsClientId=scene.client)
    scene.world.add_obstacle(body, friction=1.0)
    material = bt.Material(stiffness=1e3, damping=1.0, friction=FRICTION)
    tendons = []
    for name, side, along in (("across", -0.1, np.array([0, 1, 0])), ("along", 0.05, down)):
        middle = np.array([0, aside, 0]) + side * down + RADIUS * up
        ends = [middle - 0.5 * LENGTH * along, middle + 0.5 * LENGTH * along]
        label = f"{name}, {tangent:g}"
        tendons.append(scene.world.add_tendon(ends, RADIUS, material, PARTICLES, label))
    return SimpleNamespace(tendons=tendons, down=down, angle=angle, ways=None, speeds=None)


def _note(slope) -> None:
    slope.ways, slope.speeds = _ways(slope), _speeds(slope)


def _ways(slope) -> np.ndarray:
    """(2 n,) how far down the slope the particles are [m]."""
    return np.concatenate([tendon.positions @ slope.down for tendon in slope.tendons])


def _speeds(slope) -> np.ndarray:
    """(2,) mean speeds of the tendons down the slope [m/s]."""
    return np.array([np.average(t.velocities @ slope.down, weights=t.masses) for t in slope.tendons])


def _measure_slide(scene, slope, duration) -> None:
    exact = scene.handles.gravity * (np.sin(slope.angle) - FRICTION * np.cos(slope.angle))
    off = (_speeds(slope) - slope.speeds) / duration / exact - 1
    scene.measure(_SLIDE, off[np.abs(off).argmax()])
    scene.measure("way slid", 1e3 * (_ways(slope) - slope.ways).mean(), "mm")
    scene.mark(f"{scene.time:.1f} s")
    for tendon in slope.tendons:
        scene.world.remove_tendon(tendon)
