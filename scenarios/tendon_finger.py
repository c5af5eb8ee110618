"""A finger of three 20 g links, driven by two tendons alone, closes on a sphere and holds it.

The sphere stands on a table between palm and finger; gravity acts along the hinges. First the bent
finger is held by stiff position motors while both tendons pull. At rest nothing but the tendons loads
a motor, so its torque, which Bullet's constraint solver reports, must be minus the sum of tension
times moment arm. The arm is the routing's: the perpendicular distance from the hinge to the straight
line that touches the rounded mouths of the two eyelets beside it (eyelets are frictionless).
Then the motors are switched off for good, the flexor closes the finger against the extensor, the
table is taken away, and friction has to carry the sphere.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt

from . import measure
from .scene import Check, Scene

BENT = (0.4, 0.6, 0.5)  # rad, where motors hold the finger
LINKS = ("palm", "proximal", "middle", "distal")
# On the free ends [N]. Twice that gives links so light 100 rad/s in a step, where pybullet cuts off.
PULL = {"flexor": 6.0, "extensor": 1.5}
REST, SETTLE, CLOSE, HOLD = 0.15, 0.6, 1.5, 5.0  # s
BALL, MASS, PLACE = 0.02, 0.05, (0.026, 0.0, -0.028)  # m, kg, m
SLIP = 0.002  # m the sphere may move while held


def build(options) -> Scene:
    scene = Scene(options)
    client, h = scene.client, scene.handles
    p.setGravity(0, -9.81, 0, client)
    path, flags = bt.data_path("tendon_finger.urdf"), p.URDF_USE_INERTIA_FROM_FILE
    h.finger = scene.world.load_urdf(path, useFixedBase=True, flags=flags, obstacles=False)
    h.joints = range(p.getNumJoints(h.finger, client))
    h.tendons = {tendon.name: tendon for tendon in scene.tendons}
    for link in (-1, *h.joints):
        p.changeDynamics(h.finger, link, lateralFriction=1.0, physicsClientId=client)
    for joint in h.joints:
        p.setJointMotorControl2(h.finger, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    scene.camera = {"target": (0.03, 0, -0.02), "distance": 0.24, "yaw": 20, "pitch": -35, "up": "y"}
    scene.camera["fov"] = 40
    scene.labels.update(ylabel="tension [N]", title="A finger on two tendons")
    return scene


def drive(scene, progress) -> None:
    scene.mark("straight")
    _bend_and_weigh(scene, progress)
    _let_go(scene)
    table = _place_ball(scene)
    _close(scene, progress)
    scene.mark("closed")
    p.removeBody(table, scene.client)
    _hold(scene, progress)
    scene.mark(f"held {HOLD:g} s")


def check(scene) -> list[Check]:
    m = scene.measured
    worst = max(m[f"torque of hinge {j}, error"] for j in scene.handles.joints)
    return [
        *scene.health(),
        Check.at_most("torque against tension x arm, error", worst, 0.01),
        Check.at_most("way of the sphere while held", m["way of the sphere while held"], SLIP),
        Check.at_least("finger links that touch it, least", m["finger links that touch it, least"], 1),
    ]


def moment_arm(scene, tendon: str, joint: int) -> float:
    """Signed arm [m] of a tendon's straight way past a hinge: torque about +y = tension x arm."""
    placed = dict(zip((t.name for t in scene.world.tunnels), scene.tunnels, strict=True))
    start, mouth, radius = placed[f"{tendon} {LINKS[joint]}"]
    other, end, _ = placed[f"{tendon} {LINKS[joint + 1]}"]
    chamfer = scene.world.tunnels[0].chamfer
    near, side = _rounding(mouth, mouth - start, other - mouth, radius, chamfer)
    far, _ = _rounding(other, other - end, mouth - other, radius, chamfer)
    along = measure.unit(far - near)
    on_the_way = near - (chamfer + scene.handles.tendons[tendon].radius) * measure.unit(_across(side, along))
    return float(np.cross(on_the_way - _hinge(scene, joint), -along)[1])


def _rounding(mouth, outward, ahead, radius, chamfer) -> tuple[np.ndarray, np.ndarray]:
    """Centre of the circle that a mouth is rounded by on the side that the tendon turns to, and that side."""
    side = measure.unit(_across(ahead, measure.unit(outward)))
    return mouth - chamfer * measure.unit(outward) + (radius + chamfer) * side, side


def _hinge(scene, joint) -> np.ndarray:
    return np.array(p.getLinkState(scene.handles.finger, joint, 0, 1, scene.client)[4])


def _across(vector, unit) -> np.ndarray:
    return vector - np.dot(vector, unit) * unit


def _tension(scene, tendon, joint) -> float:
    """Where it passes the hinge."""
    x = tendon.positions
    nearest = np.argmin(np.linalg.norm(0.5 * (x[1:] + x[:-1]) - _hinge(scene, joint), axis=1))
    return float(tendon.tension[nearest])


def _bend_and_weigh(scene, progress) -> None:
    h = scene.handles
    for k in progress(range(_steps(scene, 2 * SETTLE)), "weighing"):
        part = min(1.0, k / _steps(scene, SETTLE))
        goals = (part * np.array(BENT)).tolist()
        for joint, goal in zip(h.joints, goals, strict=True):
            motor = {"targetPosition": goal, "force": 10.0, "physicsClientId": scene.client}
            p.setJointMotorControl2(h.finger, joint, p.POSITION_CONTROL, **motor)
        _pull(scene, part, part)
        _step(scene)
    for joint in h.joints:
        motor = p.getJointState(h.finger, joint, scene.client)[3]
        by_routing = sum(
            _tension(scene, t, joint) * moment_arm(scene, n, joint) for n, t in h.tendons.items()
        )
        scene.measure(f"torque of hinge {joint}", -motor, "N m")
        scene.measure(f"torque of hinge {joint}, error", abs(-motor / by_routing - 1))
    scene.mark("held by motors")


def _let_go(scene) -> None:
    h = scene.handles
    for joint in h.joints:
        p.setJointMotorControl2(h.finger, joint, p.POSITION_CONTROL, 0, force=0, physicsClientId=scene.client)
    for _ in range(_steps(scene, SETTLE)):
        _pull(scene, 0.05, 1.0)  # the extensor opens the finger
        _step(scene)


def _place_ball(scene) -> int:
    """The sphere on its table; returns the table."""
    client, h = scene.client, scene.handles
    plate = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.015, 0.002, 0.015], physicsClientId=client)
    table = p.createMultiBody(
        0, plate, basePosition=[PLACE[0], -BALL - 0.002, PLACE[2]], physicsClientId=client
    )
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=BALL, physicsClientId=client)
    look = p.createVisualShape(
        p.GEOM_SPHERE, radius=BALL, rgbaColor=[0.85, 0.35, 0.2, 1], physicsClientId=client
    )
    h.ball = p.createMultiBody(MASS, ball, look, PLACE, physicsClientId=client)
    surface = {"lateralFriction": 1.0, "spinningFriction": 1e-3, "rollingFriction": 1e-4}
    p.changeDynamics(h.ball, -1, **surface, physicsClientId=client)
    return table


def _close(scene, progress) -> None:
    steps = _steps(scene, CLOSE)
    for k in progress(range(steps), "closing"):
        _pull(scene, min(1.0, 2 * k / steps), 1 / 3)
        _step(scene)


def _hold(scene, progress) -> None:
    h = scene.handles
    start = _ball(scene)
    for _ in progress(range(_steps(scene, HOLD)), "holding"):
        _step(scene)
        touching = {c[4] for c in p.getContactPoints(h.ball, h.finger, physicsClientId=scene.client)}
        scene.lowest("finger links that touch it, least", len(touching - {-1}))
        scene.highest("way of the sphere while held", np.linalg.norm(_ball(scene) - start), "m")
    scene.measure("held", HOLD, "s")


def _ball(scene) -> np.ndarray:
    return np.array(p.getBasePositionAndOrientation(scene.handles.ball, scene.client)[0])


def _pull(scene, flexor: float, extensor: float) -> None:
    """Pull on the free ends with these shares of PULL, along the palm's eyelets."""
    for name, share in (("flexor", flexor), ("extensor", extensor)):
        scene.handles.tendons[name].set_force(-1, (-share * PULL[name], 0.0, 0.0))


def _step(scene) -> None:
    scene.step()
    for name, tendon in scene.handles.tendons.items():
        scene.record(name, tendon.tension.mean())


def _steps(scene, seconds: float) -> int:
    return round(seconds / scene.time_step)
