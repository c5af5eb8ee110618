"""Two tendons collide, crosswise and lengthwise (figure 2 of the paper, first two scenes).

Crosswise: a tendon is held at both ends; another lies across it at a right angle and is pulled down
and outwards by its ends, so that both bend at the crossing. Lengthwise: a tendon is held at both
ends; another, 17 degrees off parallel, is pressed down on it by two soft hands, one on either side
of it, and slid along it. Centrelines may never be nearer to each other than the sum of the radii, less
a fiftieth.
"""

import numpy as np

import bullet_tendon as bt

from . import measure
from .scene import Check, Scene

RADIUS = 0.004  # m, of all tendons
TOUCH = 2 * RADIUS  # m, between centrelines that touch
LENGTH, SHORT = 0.12, 0.08  # m, of the tendons; of the one that slides
PARTICLES = 25
PULL = np.array([0.0, 2.0, -4.0])  # N at one end of the crossing tendon; mirrored at the other
SLACK = 0.006  # m, by which the ends held of the crossed tendon come together
HAND = 800.0  # N/m, stiffness of the hands that press
PRESS, SLIDE = 0.014, 0.03  # m, how far these hands go below touching, and then along
ASIDE = 0.13  # m, from the crossing pair to the sliding pair, along y
STEPS = 360
NEAREST = 0.98  # of the sum of the radii
WAYS = ("crosswise", "lengthwise")


def build(options) -> Scene:
    scene = Scene(options)
    h = scene.handles
    h.held = _straight(scene, "held", (0, 0, 0), (1, 0, 0))
    h.crossing = _straight(scene, "crossing", (0, 0, 1.2 * TOUCH), (0, 1, 0))
    h.lower = _straight(scene, "lower", (0, ASIDE, 0), (1, 0, 0))
    h.upper = _straight(scene, "upper", (-SLIDE / 2, ASIDE, 1.5 * TOUCH), (1, 0.3, 0), SHORT)
    h.anchors = [t.grip(end) for t in (h.held, h.lower) for end in (0, -1)]
    h.hands = [h.upper.grip(end, stiffness=HAND, damping=2.0) for end in (0, -1)]
    h.starts = [grip.target for grip in h.anchors + h.hands]
    scene.camera = {"target": (0, 0.42 * ASIDE, -0.02), "distance": 0.26, "yaw": 35, "pitch": -25}
    scene.labels["ylabel"] = "distance of centrelines / (r1 + r2)"
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    for k in progress(range(STEPS), "colliding"):
        if k in (0, STEPS // 3):
            scene.mark(f"{scene.time:.2f} s")
        _lead(h, (k + 1) / STEPS)
        scene.step()
        _measure(scene, "crosswise", h.held, h.crossing)
        _measure(scene, "lengthwise", h.lower, h.upper)
    scene.measure("sag of the held tendon", -h.held.positions[:, 2].min() * 1e3, "mm")
    scene.measure("tension of the held tendon", h.held.tension.max(), "N")
    scene.measure("pressing force", sum(hand.force[2] for hand in h.hands), "N")
    scene.measure("force along the slide", -sum(hand.force[0] for hand in h.hands), "N")
    scene.mark(f"{scene.time:.2f} s")


def check(scene) -> list[Check]:
    names = [f"nearest, {way}" for way in WAYS]
    touching = [f"steps in contact, {way}" for way in WAYS]
    return [
        *scene.health(),
        *(Check.at_least(name, scene.measured[name], NEAREST) for name in names),
        *(Check.at_least(name, scene.measured[name], STEPS // 2) for name in touching),
        Check.at_least("sag of the held tendon", scene.measured["sag of the held tendon"], 5),
    ]


def _straight(scene, name, middle, direction, length=LENGTH):
    """A straight tendon about a point (3,) [m]."""
    material = bt.Material(stiffness=3e4, damping=1.0, tension_only=True, friction=0.4)
    half = 0.5 * length * np.array(direction) / np.linalg.norm(direction)
    ends = [np.array(middle) - half, np.array(middle) + half]
    return scene.world.add_tendon(ends, RADIUS, material, PARTICLES, name)


def _lead(h, share) -> None:
    """Move the hands and raise the pull: `share` of the way, from 0 to 1."""
    early, late = min(1, 3 * share), max(0, 1.5 * share - 0.5)
    inwards = (0.5 * SLACK * early, 0, 0)
    for grip, start, side in zip(h.anchors, h.starts, (1, -1), strict=False):
        grip.target = start + np.multiply(side, inwards)
    for hand, start in zip(h.hands, h.starts[4:], strict=True):
        hand.target = start + (SLIDE * late, 0, -(0.5 * TOUCH + PRESS) * early)
    rising = early**3  # gently: the free tendon weighs grams
    h.crossing.set_force(0, rising * PULL * (1, -1, 1))
    h.crossing.set_force(-1, rising * PULL)


def _measure(scene, way, one, other) -> None:
    ratio = measure.between(one.positions, other.positions) / (one.radius + other.radius)
    scene.record(way, ratio)
    scene.lowest(f"nearest, {way}", ratio, "(r1 + r2)")
    touching = scene.measured.get(f"steps in contact, {way}", 0) + (ratio < 1.01)
    scene.measure(f"steps in contact, {way}", touching)
