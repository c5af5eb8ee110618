"""A light link that a motor holds is pulled by a tendon: the tension is the whole load.

A 20 g lever on a hinge is held level by a position motor. A stiff tendon from its tip down is drawn
out by 200 N worth of stretch within one step. To the tendon the lever must not look like the 20 g
that it weighs: its motor holds it (core/bodies/joint_motors.h).
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

ARM, MASS = 0.1, 0.02  # m, kg
LENGTH, RADIUS, STIFFNESS, LOAD = 0.1, 0.002, 1e5, 200.0  # m, m, N, N
SOON = 10  # steps
STEPS = 120


def build(options) -> Scene:
    scene = Scene(options)
    h = scene.handles
    h.lever = lever(scene.client)
    p.setJointMotorControl2(h.lever, 0, p.POSITION_CONTROL, 0, force=1e3, physicsClientId=scene.client)
    tip = np.array([ARM, 0, 0])
    material = bt.Material(stiffness=STIFFNESS, damping=1e-4 * STIFFNESS)
    h.tendon = scene.world.add_tendon([tip, tip - [0, 0, LENGTH]], RADIUS, material, 10, "pull")
    h.tendon.attach(0, h.lever, 0)
    h.hand = h.tendon.grip(-1)
    scene.camera = {"target": (0.5 * ARM, 0, -0.05), "distance": 0.3, "yaw": 0, "pitch": -10}
    scene.labels.update(ylabel="force [N]", title="A lever held by its motor")
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    scene.mark("before")
    start = h.hand.target
    for k in progress(range(STEPS), "holding"):
        if k == STEPS // 4:
            h.hand.target = start - [0, 0, LOAD / STIFFNESS * LENGTH]
        scene.step()
        scene.record("tension", h.tendon.tension.mean())
        if k == STEPS // 4 + SOON:
            scene.measure("tension after ten steps, error", _miss(h.tendon))
    scene.mark("loaded")
    scene.measure("tension", h.tendon.tension.mean(), "N")
    scene.measure("tension at rest, error", _miss(h.tendon))
    scene.measure("sag of the lever", abs(p.getJointState(h.lever, 0, scene.client)[0]), "rad")


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check.at_most("tension after ten steps, error", m["tension after ten steps, error"], 0.01),
        Check.at_most("tension at rest, error", m["tension at rest, error"], 1e-3),
        Check.at_most("sag of the lever", m["sag of the lever"], 1e-6),
    ]


def lever(client: int, mass: float = MASS) -> int:
    """A massless-looking bar on a hinge at the origin, all its mass [kg] at the tip."""
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.004] * 3, physicsClientId=client)
    bar = p.createVisualShape(
        p.GEOM_BOX,
        halfExtents=[0.5 * ARM, 0.004, 0.004],
        rgbaColor=[0.55, 0.6, 0.68, 1],
        visualFramePosition=[0.5 * ARM, 0, 0],
        physicsClientId=client,
    )
    link = {"linkMasses": [mass], "linkCollisionShapeIndices": [box], "linkVisualShapeIndices": [bar]}
    link |= {"linkPositions": [[0, 0, 0]], "linkOrientations": [[0, 0, 0, 1]]}
    link |= {"linkInertialFramePositions": [[ARM, 0, 0]], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
    link |= {"linkParentIndices": [0], "linkJointTypes": [p.JOINT_REVOLUTE], "linkJointAxis": [[0, 1, 0]]}
    body = p.createMultiBody(0, **link, physicsClientId=client)
    free = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}
    p.changeDynamics(body, 0, **free, physicsClientId=client)
    return body


def _miss(tendon) -> float:
    return abs(tendon.tension.mean() / LOAD - 1)
