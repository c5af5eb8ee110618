"""Two weights hang from a tendon over a rough cylinder (Atwood's machine without a turning pulley).

With mu = 0.3 and half a turn, friction holds weights up to e^(mu pi) = 2.57 : 1. At 2.3 : 1 they must hang
still, at 2.9 : 1 slide with a = g (m1 - m2 e^(mu pi)) / (m1 + m2 e^(mu pi)). The weights are pybullet's.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

FRICTION = 0.3
GRAVITY = 9.81  # m/s^2
HOLDS, SLIDES = 2.3, 2.9  # m1 / m2
LIGHT = 1.0  # kg, m2
DRUM, RADIUS = 0.04, 0.001  # m
SEGMENT = np.radians(4.0)  # of wrapping angle a segment
HEAVY_LEG, LIGHT_LEG = 0.05, 0.2  # m, from the cylinder down to the weights, at first
APART = 0.16  # m, from one pair to the other
SETTLE, HANG = 1.5, 2.0  # s, until those that hold hang still, and for which they are watched then
BEGIN, SLIDE = 0.1, 0.3  # s, until those that slide are watched, and for how long
CREEP = 1e-6  # m/s
WITHIN = 0.02  # of the acceleration


def build(options) -> Scene:
    scene = Scene(options, gravity=-GRAVITY)
    h = scene.handles
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    shape = p.createCollisionShape(
        p.GEOM_CYLINDER, radius=DRUM, height=APART + 0.1, physicsClientId=scene.client
    )
    drum = p.createMultiBody(0, shape, -1, (0, APART / 2, 0), turn, physicsClientId=scene.client)
    scene.world.add_obstacle(drum, friction=1.0)
    h.holding = _pair(scene, HOLDS, 0.0)
    h.sliding = _pair(scene, SLIDES, APART)
    scene.camera = {"target": (0, APART / 2, -0.09), "distance": 0.6, "yaw": 25, "pitch": -12}
    scene.labels.update(ylabel="way of the heavy weight [mm]", title=f"mu = {FRICTION:g} over half a turn")
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    begin, end, settled = (round(t / scene.time_step) for t in (BEGIN, BEGIN + SLIDE, SETTLE))
    scene.mark("let go")
    for k in progress(range(settled + round(HANG / scene.time_step)), "hanging"):
        if k == begin:
            speed = h.sliding.speed()
        if k == end:
            _measure_slide(scene, h.sliding, (h.sliding.speed() - speed) / SLIDE)
            scene.mark(f"{scene.time:.1f} s")
            scene.world.remove_tendon(h.sliding.tendon)  # before its light weight is at the cylinder
        if k == settled:
            way = h.holding.way()
        scene.step()
        if k < end:
            scene.record(f"{HOLDS:g} : 1", 1e3 * h.holding.way())
            scene.record(f"{SLIDES:g} : 1", 1e3 * h.sliding.way())
    scene.measure("creep", abs(h.holding.way() - way) / HANG, "m/s")
    scene.measure("yield of those that hold", 1e3 * h.holding.way(), "mm")


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check.at_most("creep", m["creep"], CREEP),
        Check.at_most(_SLIDE, abs(m[_SLIDE]), WITHIN),
    ]


_SLIDE = "acceleration beside the exact one"


def _pair(scene, ratio, aside) -> SimpleNamespace:
    """A tendon over the cylinder, and two weights on it: at +x the heavy one."""
    around, turned = DRUM + RADIUS, np.arange(round(np.pi / SEGMENT) + 1) * SEGMENT
    arc = np.c_[around * np.cos(turned), np.full(len(turned), aside), around * np.sin(turned)]
    heavy, light = (np.arange(round(leg / (around * SEGMENT)), 0, -1) for leg in (HEAVY_LEG, LIGHT_LEG))
    drop = np.array([0, 0, -around * SEGMENT])
    points = np.vstack([arc[0] + heavy[:, None] * drop, arc, arc[-1] + light[::-1, None] * drop])
    material = bt.Material(stiffness=1e5, damping=100.0, friction=FRICTION)
    tendon = scene.world.add_tendon(points, RADIUS, material, name=f"{ratio:g} : 1")
    weights = [
        _weight(scene, tendon, particle, points[particle], mass)
        for particle, mass in ((0, ratio * LIGHT), (-1, LIGHT))
    ]
    start = points[0, 2]

    def way():
        return start - tendon.positions[0, 2]

    def speed():
        return -p.getBaseVelocity(weights[0], scene.client)[0][2]

    return SimpleNamespace(tendon=tendon, weights=weights, ratio=ratio, way=way, speed=speed)


def _weight(scene, tendon, particle, place, mass) -> int:
    """A sphere whose centre is on the tendon's end."""
    size = 0.012 * np.cbrt(mass)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=size, physicsClientId=scene.client)
    body = p.createMultiBody(mass, shape, -1, place.tolist(), physicsClientId=scene.client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=scene.client)
    tendon.attach(particle, body, position=(0, 0, 0))
    return body


def _measure_slide(scene, pair, acceleration) -> None:
    held = LIGHT * np.exp(FRICTION * np.pi)
    heavy = pair.ratio * LIGHT
    exact = GRAVITY * (heavy - held) / (heavy + held)
    scene.measure("acceleration", acceleration, "m/s^2")
    scene.measure("exact acceleration", exact, "m/s^2")
    scene.measure(_SLIDE, acceleration / exact - 1)
