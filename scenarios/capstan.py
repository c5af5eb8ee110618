"""Tendons slide around a rough drum: the tension grows by e^(mu phi) (the capstan equation).

Tendons with four wrapping angles and three coefficients of friction each lie around one drum, those of
more than a turn as a helix. One end is held back by a constant force, the other one is drawn. While
all contacts slide, T1/T0 = e^(mu phi) with phi the angle that the tangent turns by (Euler 1769); friction
acts at the centreline, so the radii do not enter. The mean over the passage of one segment is compared.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p

import bullet_tendon as bt

from . import lanes
from .scene import Check, Scene

DRUM, RADIUS = 0.03, 0.001  # m, of the drum and of the tendons
PITCH = 2.5 * RADIUS  # m a turn, of the helices: beside each other
LEG = 0.02  # m, of the straight ends
FRICTIONS = (0.05, 0.2, 0.5)
ANGLES = (np.pi / 2, np.pi, 2 * np.pi, 4 * np.pi)
SEGMENT = np.radians(4.5)  # of wrapping angle a segment
BACK = 2.0  # N, on the slack end
TRAVEL, SPEED = 0.016, 0.04  # m and m/s, of the end that is drawn
START = 0.1  # of the time, in which the hand gets going
WITHIN = 0.01  # of e^(mu phi)


def build(options) -> Scene:
    scene = Scene(options, gravity=0)
    h = scene.handles
    h.lanes, h.width = [], 0.0
    for friction in FRICTIONS:
        for angle in ANGLES:
            h.lanes.append(_wrap(scene, friction, angle, h.width))
            h.width += PITCH * angle / (2 * np.pi) + 5 * RADIUS
    shape = p.createCollisionShape(
        p.GEOM_CYLINDER, radius=DRUM, height=h.width + 0.04, physicsClientId=scene.client
    )
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    drum = p.createMultiBody(0, shape, -1, (0, h.width / 2, 0), turn, physicsClientId=scene.client)
    scene.world.add_obstacle(drum, friction=1.0)
    scene.camera = {"target": (0, h.width / 2, 0), "distance": 0.22, "yaw": 60, "pitch": -20}
    scene.labels.update(xlabel="friction coefficient x angle", ylabel="ln(T1 / T0)", title="Capstan")
    return scene


def drive(scene, progress) -> None:
    lanes.draw(scene, progress, TRAVEL, SPEED, BACK, START)
    for lane in scene.handles.lanes:
        lanes.measure(scene, lane, f"T1/T0 beside e^(mu phi), {lane.name}", lane.spacing, SPEED)


def check(scene) -> list[Check]:
    names = [f"T1/T0 beside e^(mu phi), {lane.name}" for lane in scene.handles.lanes]
    return [*scene.health(), *(Check.at_most(name, abs(scene.measured[name]), WITHIN) for name in names)]


def _wrap(scene, friction, angle, aside) -> SimpleNamespace:
    """A tendon around the drum's axis y by `angle` [rad], with straight ends along its tangents."""
    steep = PITCH / (2 * np.pi) if angle > 1.5 * np.pi else 0.0  # m a radian
    turned = np.linspace(0, angle, 1 + round(angle / SEGMENT))
    around = DRUM + RADIUS
    arc = np.c_[around * np.sin(turned), aside + steep * turned, around * np.cos(turned)]
    length = np.hypot(around, steep)
    first, last = (np.array([around * np.cos(a), steep, -around * np.sin(a)]) / length for a in (0, angle))
    count = max(1, round(LEG / (length * SEGMENT)))
    leg = length * SEGMENT * np.arange(1, count + 1)[:, None]
    points = np.vstack([arc[0] - leg[::-1] * first, arc, arc[-1] + leg * last])
    name = f"mu {friction:g}, phi {angle / np.pi:g} pi"
    material = bt.Material(stiffness=3e4, damping=3.0, friction=friction)
    tendon = scene.world.add_tendon(points, RADIUS, material, name=name)
    hand = tendon.grip(-1)
    true_angle = angle * around / length  # by which the tangent of a helix turns
    return SimpleNamespace(
        name=name, tendon=tendon, hand=hand, start=hand.target, first=first, last=last,
        exponent=friction * true_angle, spacing=length * SEGMENT, logs=[],
    )  # fmt: skip
