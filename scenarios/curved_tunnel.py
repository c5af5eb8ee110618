"""Tendons are drawn through curved tunnels: the wall takes what a capstan takes, a straight one nothing.

A curved tunnel is a row of straight bores that meet end to end. With phi the angle between its first and
its last bore, T1/T0 = e^(mu phi) at the ends of a tendon that slides along the inner wall, and 1 where
the tunnel is straight. The mean over the passage of one segment is compared.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p

import bullet_tendon as bt

from . import lanes
from .scene import Check, Scene

AXIS, BORE, RADIUS = 0.05, 0.004, 0.002  # m: of the tunnels' curve, of the bores, of the tendons
BEND = np.radians(5.0)  # from bore to bore
SPACING = 0.0017  # m, from particle to particle
LEG = 0.02  # m, of tendon before the first and beyond the last bore
FRICTIONS = (0.05, 0.2, 0.5)
ANGLES = (np.pi / 2, np.pi, 1.5 * np.pi)
APART = 0.02  # m, from tunnel to tunnel
BACK = 1.0  # N, on the slack end
TRAVEL, SPEED = 0.008, 0.01  # m and m/s, of the end that is drawn
START = 0.1  # of the time, in which the hand gets going
WITHIN = 0.01  # of e^(mu phi)
STRAIGHT = 1e-6  # of T0, that a straight tunnel may take


def build(options) -> Scene:
    scene = Scene(options, gravity=0)
    h = scene.handles
    h.block = p.createMultiBody(0, physicsClientId=scene.client)
    cases = [(mu, phi) for mu in FRICTIONS for phi in ANGLES] + [(FRICTIONS[-1], 0.0)]
    h.lanes = [_lane(scene, mu, phi, APART * k) for k, (mu, phi) in enumerate(cases)]
    middle = APART * (len(cases) - 1) / 2
    scene.camera = {"target": (0, middle, 0), "distance": 0.34, "yaw": 50, "pitch": -20}
    scene.labels.update(xlabel="friction coefficient x angle", ylabel="ln(T1 / T0)", title="Curved tunnels")
    return scene


def drive(scene, progress) -> None:
    lanes.draw(scene, progress, TRAVEL, SPEED, BACK, START)
    for lane in scene.handles.lanes:
        lanes.measure(scene, lane, lane.title, SPACING, SPEED)


def check(scene) -> list[Check]:
    return [
        *scene.health(),
        *(
            Check.at_most(lane.title, abs(scene.measured[lane.title]), WITHIN if lane.exponent else STRAIGHT)
            for lane in scene.handles.lanes
        ),
    ]


def _lane(scene, friction, angle, aside) -> SimpleNamespace:
    """A tunnel that turns by `angle` [rad], and a tendon that lies along its inner wall."""
    joints = round(angle / BEND)
    axis = _polygon(joints, AXIS, aside)
    for start, end in zip(axis[:-1], axis[1:], strict=True):
        scene.world.add_tunnel(scene.handles.block, -1, start, end, BORE, 1.0)
    line = _polygon(joints, AXIS - (BORE - RADIUS) / np.cos(BEND / 2), aside)
    first, last = (d / np.linalg.norm(d) for d in (line[1] - line[0], line[-1] - line[-2]))
    points = np.vstack([line[0] - LEG * first, line, line[-1] + LEG * last])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    material = bt.Material(stiffness=3e4, damping=3.0, friction=friction)
    name = f"mu {friction:g}, phi {angle / np.pi:g} pi"
    count = 1 + round(length / SPACING)
    tendon = scene.world.add_tendon(points, RADIUS, material, count, name)
    hand = tendon.grip(-1)
    return SimpleNamespace(
        title=f"T1/T0 beside e^(mu phi), {name}", tendon=tendon, hand=hand, start=hand.target, first=first,
        last=last, exponent=friction * angle, logs=[],
    )  # fmt: skip


def _polygon(joints, radius, aside) -> np.ndarray:
    """(joints + 2, 3) corners of an arc about y with that many bends [m]."""
    corner = (np.arange(joints + 2) - 0.5 * (joints + 1)) * BEND
    return np.c_[radius * np.sin(corner), np.full(len(corner), aside), radius * np.cos(corner)]
