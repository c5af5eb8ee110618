"""Four strands of a hamstring graft are twisted together and pulled with 200 N: they share it evenly.

The strands lie parallel, as the corners of a square; a hand turns one end of all four about their axis and
follows as they get shorter, then pulls. No two centrelines may be nearer to each other than the sum of
the radii, less three hundredths, every pair winds around each other as often as the hand has turned, and the
strands, alike but for where they lie, carry alike.
"""

from itertools import combinations

import numpy as np

import bullet_tendon as bt

from . import measure
from .scene import Check, Scene

STRANDS = 4
AREA = 57e-6  # m^2, of all strands (Wilson 1999)
RADIUS = np.sqrt(AREA / STRANDS / np.pi)  # m, of a strand
TOUCH = 2 * RADIUS  # m, between centrelines that touch
CIRCLE = 1.1 * np.sqrt(2) * RADIUS  # m, on which the strands' ends are held
LENGTH, PARTICLES = 0.12, 61
TURNS = 2.0
FRICTION = 0.3
TWISTED_STRAIN = 0.003  # of strands on the ends' circle, at which they are twisted
PULL = 200.0  # N, on all strands together
SPEED = 0.01  # m/s, at most, of the hand that pulls
TWISTING, PULLING = 480, 240  # steps
NEAREST = 0.97  # of the sum of the radii
SHARES = 0.02  # of a strand's mean tension, by which strands may differ


def build(options) -> Scene:
    scene = Scene(options, gravity=0)
    h = scene.handles
    # One strand has a quarter of the graft's cross-section.
    slope = 1.5e9 * AREA / STRANDS
    material = bt.Material.preset("hamstring_graft", slope=slope, friction=FRICTION)
    h.strands, h.held, h.hand = [], [], []
    for k in range(STRANDS):
        line = [(x, *_corner(k, 0)) for x in (0, LENGTH)]
        strand = scene.world.add_tendon(line, RADIUS, material, PARTICLES, f"strand {k + 1}")
        h.strands.append(strand)
        h.held.append(strand.grip(0))
        h.hand.append(strand.grip(-1))
    h.at = LENGTH  # m, of the hand along the axis
    scene.camera = {"target": (0.5 * LENGTH, 0, 0), "distance": 0.13, "yaw": 5, "pitch": -30}
    scene.labels["ylabel"] = "tension in the middle [N]"
    scene.plotted = [strand.name for strand in h.strands]
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    for k in progress(range(TWISTING), "twisting"):
        if k in (0, TWISTING // 3, 2 * TWISTING // 3):
            scene.mark(f"{TURNS * k / TWISTING:.2f} turns")
        share = (k + 1) / TWISTING
        around = 2 * np.pi * CIRCLE * TURNS * share
        h.at = np.sqrt((LENGTH * (1 + TWISTED_STRAIN * min(1, 8 * share))) ** 2 - around**2)
        _step(scene, share)
    for _ in progress(range(PULLING), "pulling"):
        h.at += SPEED * scene.time_step * max(0, 1 - _pull(scene) / PULL)
        _step(scene, 1.0)
    scene.mark(f"{TURNS:.2f} turns, {_pull(scene):.0f} N")
    _finish(scene)


def check(scene) -> list[Check]:
    got = scene.measured
    return [
        *scene.health(),
        Check.at_least("nearest", got["nearest"], NEAREST),
        Check.at_least("pull", got["pull"], 0.99 * PULL),
        Check.at_most("difference between strands", got["difference between strands"], SHARES),
        Check.at_least("turns of the pair that winds least", got["least turns"], 0.99 * TURNS),
        Check.at_most("turns of the pair that winds most", got["most turns"], 1.01 * TURNS),
        Check.at_least("segments that touch others", got["segments that touch others"], 2 * PARTICLES),
    ]


def _corner(strand, share) -> np.ndarray:
    """(2,) y and z of a strand's end, turned by a `share` of all turns [m]."""
    angle = 2 * np.pi * (strand / STRANDS + TURNS * share)
    return CIRCLE * np.array([np.cos(angle), np.sin(angle)])


def _step(scene, share) -> None:
    """One step, with the hand turned by `share` of all turns."""
    h = scene.handles
    for k, grip in enumerate(h.hand):
        grip.target = (h.at, *_corner(k, share))
    scene.step()
    lines = [strand.positions for strand in h.strands]
    nearest = min(measure.between(*pair) for pair in combinations(lines, 2)) / TOUCH
    scene.lowest("nearest", nearest, "(r1 + r2)")
    for strand in h.strands:
        scene.record(strand.name, strand.tension[PARTICLES // 2])


def _pull(scene) -> float:
    """What the hand feels along the axis [N]."""
    return -sum(grip.force[0] for grip in scene.handles.hand)


def _finish(scene) -> None:
    h = scene.handles
    tensions = np.array([strand.tension.mean() for strand in h.strands])
    turns = [_turns(one.positions, other.positions) for one, other in combinations(h.strands, 2)]
    scene.measure("pull", _pull(scene), "N")
    scene.measure("difference between strands", np.ptp(tensions) / tensions.mean())
    scene.measure("least turns", min(turns))
    scene.measure("most turns", max(turns))
    scene.measure("torque", -sum(np.cross(g.target, g.force)[0] for g in h.hand), "N m")
    contacts = scene.world.contacts
    scene.measure("segments that touch others", len(np.unique(contacts[["tendon", "segment"]])))


def _turns(one, other) -> float:
    """How often two lines that run along x wind around each other."""
    at = np.linspace(max(one[0, 0], other[0, 0]), min(one[-1, 0], other[-1, 0]), 2 * len(one))
    y, z = (np.interp(at, other[:, 0], other[:, c]) - np.interp(at, one[:, 0], one[:, c]) for c in (1, 2))
    angle = np.unwrap(np.arctan2(z, y))
    return abs(angle[-1] - angle[0]) / (2 * np.pi)
