"""A tendon is dragged and twisted: it touches itself and another at once (figure 2, third scene).

A tendon is laid in a U around a second one and its two ends are led on a circle about the U's axis,
so that its legs wind around each other. The second tendon, held by two soft hands, is drawn into the
closing loop. No two centrelines, nor two stretches of one that are not neighbours, may be nearer to
each other than the sum of the radii, less a fiftieth.
"""

import numpy as np

import bullet_tendon as bt

from . import measure
from .scene import Check, Scene

RADIUS = 0.003  # m, of both tendons
TOUCH = 2 * RADIUS  # m, between centrelines that touch
LEG, BEND = 0.13, 0.012  # m, length of the U's legs and radius of its bend, which is about the origin
PARTICLES = (61, 21)  # of the tendon and of the second one
TURNS = 2.0
DRAG = 0.012  # m, by which the ends move towards the bend, for legs get shorter as they wind
HAND = 600.0  # N/m, stiffness of the second tendon's hands
DRAWN = 0.012  # m, how far these hands go away from the legs
STEPS = 600
NEAREST = 0.98  # of the sum of the radii
# Segments closer to each other along the tendon are neighbours: half a circle that touches itself.
NEIGHBOURS = np.pi * RADIUS  # m


def build(options) -> Scene:
    scene = Scene(options)
    h = scene.handles
    material = bt.Material(stiffness=1e4, damping=2.0, tension_only=True, friction=0.2)
    h.tendon = scene.world.add_tendon(_u_shape(), RADIUS, material, PARTICLES[0], "twisted")
    post = [(0, 0, -0.04), (0, 0, 0.04)]
    h.second = scene.world.add_tendon(post, RADIUS, material, PARTICLES[1], "second")
    h.ends = [h.tendon.grip(end) for end in (0, -1)]
    h.hands = [h.second.grip(end, stiffness=HAND, damping=2.0) for end in (0, -1)]
    scene.camera = {"target": (0.06, 0, 0), "distance": 0.2, "yaw": 20, "pitch": -35}
    scene.labels["ylabel"] = "distance of centrelines / (r1 + r2)"
    scene.plotted = ["with itself", "with the second tendon"]
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    for k in progress(range(STEPS), "twisting"):
        if k % (STEPS // 3) == 0:
            scene.mark(f"{TURNS * k / STEPS:.2f} turns")
        _lead(h, (k + 1) / STEPS)
        scene.step()
        _measure(scene)
    scene.mark(f"{TURNS:.2f} turns")
    scene.measure("pull at the twisted ends", sum(-grip.force[0] for grip in h.ends), "N")
    scene.measure("highest tension", h.tendon.tension.max(), "N")


def check(scene) -> list[Check]:
    got = scene.measured
    return [
        *scene.health(),
        Check.at_least("nearest, with itself", got["nearest, with itself"], NEAREST),
        Check.at_least("nearest, with the second tendon", got["nearest, with the second tendon"], NEAREST),
        Check.at_least("steps with both contacts", got["steps with both contacts"], STEPS // 4),
        Check.at_least("turns of the legs", got["turns of the legs"], 0.8 * TURNS),
    ]


def _u_shape() -> np.ndarray:
    """Two legs along x from a half circle about the origin, in the plane z = 0 [m]."""
    angle = np.linspace(0.5, 1.5, 21)[:, None] * np.pi
    bend = BEND * np.hstack([np.cos(angle), np.sin(angle), 0 * angle])
    return np.vstack([[(LEG, BEND, 0)], bend, [(LEG, -BEND, 0)]])


def _lead(h, share) -> None:
    """Turn the ends about x, drag them towards the bend, draw the second tendon away from them."""
    angle = 2 * np.pi * TURNS * share
    circle = BEND * np.array([0, np.cos(angle), np.sin(angle)])
    for grip, side in zip(h.ends, (1, -1), strict=True):
        grip.target = side * circle + (LEG - DRAG * share, 0, 0)
    away = min(1, 4 * share) * (BEND - TOUCH + DRAWN)
    for hand, z in zip(h.hands, (-0.04, 0.04), strict=True):
        hand.target = (-away, 0, z)


def _measure(scene) -> None:
    h = scene.handles
    own = measure.with_itself(h.tendon.positions, NEIGHBOURS) / TOUCH
    other = measure.between(h.tendon.positions, h.second.positions) / TOUCH
    scene.record("with itself", own)
    scene.record("with the second tendon", other)
    scene.lowest("nearest, with itself", own, "(r1 + r2)")
    scene.lowest("nearest, with the second tendon", other, "(r1 + r2)")
    both = scene.measured.get("steps with both contacts", 0) + (max(own, other) < 1.01)
    scene.measure("steps with both contacts", both)
    scene.measure("turns of the legs", _turns(h.tendon.positions))


def _turns(line) -> float:
    """How often the legs wind around each other: the vector from one to the other, along them."""
    half = len(line) // 2
    across = (line[:half] - line[: -half - 1 : -1])[:, 1:]
    angle = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
    return abs(angle[0] - angle[-1]) / (2 * np.pi)
