"""A plate on four slanting tendons: every tension by statics, and what becomes of them when one is cut.

The plate hangs by its corners from four points above, farther apart than the corners are. By symmetry each
tendon carries a quarter of the weight over the cosine of its slant. Then one is cut: its two neighbours
take over, and the one opposite goes slack.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

MASS, HALF, HEIGHT, SPREAD = 1.5, 0.1, 0.25, 1.6  # kg; m, half edge; m; of the upper square over the plate
RADIUS, STIFFNESS, DAMPING = 0.002, 3e4, 300.0  # m, N, N s
SETTLE, SWING = 3.0, 1.0  # s
CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def build(options) -> Scene:
    scene = Scene(options)
    h = scene.handles
    half = [HALF, HALF, 0.005]
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=scene.client)
    h.plate = p.createMultiBody(MASS, shape, physicsClientId=scene.client)
    p.changeDynamics(h.plate, -1, linearDamping=0, angularDamping=0, physicsClientId=scene.client)
    material = bt.Material(stiffness=STIFFNESS, damping=DAMPING)
    h.tendons = []
    for k, (x, y) in enumerate(CORNERS):
        low = np.array([HALF * x, HALF * y, 0.0])
        high = np.array([SPREAD * HALF * x, SPREAD * HALF * y, HEIGHT])
        tendon = scene.world.add_tendon([high, low], RADIUS, material, 12, f"tendon {k}")
        tendon.grip(0)
        tendon.attach(-1, h.plate)
        h.tendons.append(tendon)
    scene.camera = {"target": (0, 0, 0.08), "distance": 0.6, "yaw": 30, "pitch": -15}
    scene.labels.update(ylabel="tension [N]", title="A plate on four tendons, one of them cut")
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    settle, swing = (round(t / scene.time_step) for t in (SETTLE, SWING))
    for k in progress(range(settle + swing), "hanging"):
        if k == settle:
            scene.mark("at rest")
            _compare(scene)
            scene.world.remove_tendon(h.tendons.pop())
        scene.step()
        for tendon in h.tendons:
            scene.record(tendon.name, tendon.tension[0])
    scene.mark("one is cut")
    turned = p.getBasePositionAndOrientation(h.plate, scene.client)[1]
    scene.measure("tilt after the cut", np.degrees(p.getAxisAngleFromQuaternion(turned)[1]), "degrees")
    scene.measure("tension opposite the cut", h.tendons[1].tension[-1], "N")


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check.at_most("tension at rest, error", m["tension at rest, error"], 1e-3),
        Check.at_most("tension opposite the cut", m["tension opposite the cut"], 0.5 * m["tension at rest"]),
        Check.at_most("tilt after the cut", m["tilt after the cut"], 90),
    ]


def _compare(scene) -> None:
    """Tensions at the plate against a quarter of the weight over the cosine of the slant."""
    h = scene.handles
    weight = 9.81 * MASS / 4
    errors = []
    for tendon in h.tendons:
        end = tendon.positions[-2:]
        cosine = (end[0] - end[1])[2] / np.linalg.norm(end[1] - end[0])
        lowest = weight + 9.81 * tendon.masses[-1]
        errors.append(abs(tendon.tension[-1] * cosine / lowest - 1))
    scene.measure("tension at rest", h.tendons[0].tension[-1], "N")
    scene.measure("tension at rest, error", max(errors))
