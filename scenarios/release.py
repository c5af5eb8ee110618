"""A light body is let go under tension: it gets no more energy than the tendon had stored.

A 20 g ball is held by a fixed constraint against 200 N of tension (1e5 N/m). The constraint is taken
away between two steps. The step after it still pulls with the force of a held body, 41 m/s worth of
impulse; that step is taken back and solved with the ball as it is now (TendonWorld.step).
"""

import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

MASS, LENGTH, RADIUS = 0.02, 0.1, 0.001  # kg, m, m
SPRING, LOAD = 1e5, 200.0  # N/m, N
HELD, AFTER = 60, 240  # steps


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    h = scene.handles
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=scene.client)
    h.ball = p.createMultiBody(MASS, shape, physicsClientId=scene.client)
    p.changeDynamics(h.ball, -1, linearDamping=0, angularDamping=0, physicsClientId=scene.client)
    fixed = (p.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 0])
    h.pin = p.createConstraint(h.ball, -1, -1, -1, *fixed, physicsClientId=scene.client)
    p.changeConstraint(h.pin, maxForce=1e6, physicsClientId=scene.client)
    material = bt.Material(stiffness=SPRING * LENGTH, tension_only=True)
    h.tendon = scene.world.add_tendon([(0, 0, 0), (0, 0, -LENGTH)], RADIUS, material, 10, "stretched")
    h.tendon.attach(0, h.ball)
    h.hand = h.tendon.grip(-1)
    scene.camera = {"target": (0, 0, -0.05), "distance": 0.3, "yaw": 0, "pitch": -10}
    scene.labels.update(ylabel="energy [J]", title="A body let go under 200 N")
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    h.hand.target = h.hand.target - [0, 0, LOAD / SPRING]
    for k in progress(range(HELD + AFTER), "held, then let go"):
        if k == HELD:
            scene.mark("held")
            scene.measure("tension while held", h.tendon.tension.mean(), "N")
            scene.measure("stored energy", h.tendon.energy, "J")
            p.removeConstraint(h.pin, scene.client)
        scene.step()
        speed = p.getBaseVelocity(h.ball, scene.client)[0]
        kinetic = 0.5 * MASS * sum(v * v for v in speed)
        scene.record("kinetic energy of the ball", kinetic)
        scene.record("energy of the tendon", h.tendon.energy)
        if k >= HELD:
            scene.highest("kinetic energy", kinetic, "J")
    scene.mark("let go")
    scene.measure(
        "kinetic over stored energy", scene.measured["kinetic energy"] / scene.measured["stored energy"]
    )


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check.at_most("tension while held, error", abs(m["tension while held"] / LOAD - 1), 1e-3),
        Check.at_most("kinetic over stored energy", m["kinetic over stored energy"], 1.05),
        Check.above("kinetic energy", m["kinetic energy"], 0.0),
    ]
