"""Two reef knots are pulled with 200 N by their standing parts: friction alone holds one, the other slips.

Each is laid loosely of two tendons; hands draw all four ends until it is snug, then the two tails are let
go and the hands pull on the standing parts alone. With mu = 0.3 it holds: the hands stop, and what they feel
stays (a slip of 20 um would take 2 N off it). Without friction it comes undone; what the hands feel
meanwhile is the tendons' damping, for they are drawn around tight bends. Centrelines may never be nearer to
each other than the sum of the radii, less three hundredths, nor may a tendon to itself apart from
neighbours; and while it holds, the closed knot stays a sum of two trefoils.
"""

from types import SimpleNamespace

import numpy as np

import bullet_tendon as bt

from . import measure, topology
from .scene import Check, Scene

RADIUS, SPACING = 0.002, 0.002  # m, of all tendons; between particles, about
TOUCH = 2 * RADIUS  # m, between centrelines that touch
STANDING, TAIL = 0.07, 0.04  # m, length of the straight parts
FRICTIONS = (0.3, 0.0)  # of tendon on tendon
ASIDE = 0.1  # m, from knot to knot
SNUG, PULL = 10.0, 200.0  # N, at all ends, then at the standing ones
SPEED = 0.15  # m/s, at most, of the hands
SNUGGING, PULLING, HOLDING = 180, 420, 240  # steps
SUM_OF_TREFOILS = 9  # its determinant
HELD, GONE = 0.98, 0.01  # of the pull, that is left where the knot holds, and where it is undone
NEAREST = 0.97  # of the sum of the radii
# As in the solver: what is nearer along the tendon, at rest, than half of the tightest turn of a tube.
NEIGHBOURS = np.pi * RADIUS  # m
# Half of a loose reef knot from its standing part on, in radii: x, y and height. The other half is this,
# turned about y by half a turn.
LAID = [(-11, -2, 3), (0, -5, -3), (10, -8, 3), (13, 0, 3)]
LAID += [(x, -y, z) for x, y, z in LAID[2::-1]]


def build(options) -> Scene:
    scene = Scene(options, gravity=0)
    scene.handles.knots = [_lay(scene, mu, ASIDE * k) for k, mu in enumerate(FRICTIONS)]
    scene.camera = {"target": (0, 0.5 * ASIDE, 0), "distance": 0.3, "yaw": 0, "pitch": -70}
    scene.labels["ylabel"] = "pull at the standing ends [N]"
    return scene


def drive(scene, progress) -> None:
    knots = scene.handles.knots
    for knot in knots:
        _measure(scene, knot)
    scene.mark("laid")
    for _ in progress(range(SNUGGING), "drawing snug"):
        _step(scene, SNUG)
    scene.mark(f"{scene.time:.2f} s: snug, {SNUG:g} N at four ends")
    for tail, _ in (pair for knot in knots for pair in knot.tails):
        tail.release()
    for knot in knots:
        knot.tails = []
    for k in progress(range(PULLING), "pulling"):
        if k == PULLING // 4:
            scene.mark(f"{scene.time:.2f} s: pulled at the standing ends")
        _step(scene, PULL)
    for knot in knots:
        scene.measure(f"pull, {knot.name}", _pull(knot), "N")
    for _ in progress(range(HOLDING), "holding"):
        _step(scene, 0.0)
    for knot in knots:
        scene.measure(f"pull held, {knot.name}", _pull(knot), "N")
    scene.mark(f"{scene.time:.2f} s: mu = {FRICTIONS[0]:g}", {"target": (0, 0, 0), "distance": 0.08})


def check(scene) -> list[Check]:
    got = scene.measured
    holding, undone = scene.handles.knots
    names = [f"nearest, {knot.name}" for knot in scene.handles.knots]
    return [
        *scene.health(),
        *(Check.at_least(name, got[name], NEAREST) for name in names),
        Check.at_least("pull on the knot that holds", got[f"pull, {holding.name}"], 0.98 * PULL),
        Check.at_least("held without moving", got[f"pull held, {holding.name}"], HELD * PULL),
        Check.equal("steps without the two trefoils", holding.lost, 0),
        Check.at_most("pull on the knot undone", got[f"pull held, {undone.name}"], GONE * PULL),
        Check.equal("its determinant", _determinant(undone), 1),
    ]


def _lay(scene, friction, aside) -> SimpleNamespace:
    """A loose reef knot about (0, aside, 0), with hands at its four ends."""
    laid = RADIUS * np.array(LAID)
    line = np.vstack([laid[0] - (STANDING, 0, 0), laid, laid[-1] - (TAIL, 0, 0)])
    line[[0, -1], 2] = 0
    material = bt.Material(
        stiffness=2e4, damping=0.05, damping_form="whole", bending_stiffness=1e-6, friction=np.sqrt(friction)
    )
    tendons = []
    for side in (1, -1):
        points = _rounded(line) * (side, 1, side) + (0, aside, 0)
        count = 1 + round(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / SPACING)
        tendons.append(scene.world.add_tendon(points, RADIUS, material, count, f"mu {friction:g}, {side}"))
    hands = [(t.grip(0), d) for t, d in zip(tendons, (-1, 1), strict=True)]
    tails = [(t.grip(-1), d) for t, d in zip(tendons, (-1, 1), strict=True)]
    rests = [measure.rest_lengths(t) for t in tendons]
    return SimpleNamespace(
        friction=friction, tendons=tendons, hands=hands, tails=tails, rests=rests, lost=0,
        name=f"mu = {friction:g}",
    )  # fmt: skip


def _rounded(line, times=4) -> np.ndarray:
    """The polyline with its corners cut again and again (Chaikin 1974); its ends stay."""
    for _ in range(times):
        quarters = [(3 * line[:-1] + line[1:]) / 4, (line[:-1] + 3 * line[1:]) / 4]
        line = np.vstack([line[:1], np.stack(quarters, axis=1).reshape(-1, 3), line[-1:]])
    return line


def _draw(scene, hand, pull) -> None:
    """Lead a hand outwards along x, the slower the nearer its force is to `pull` [N]."""
    grip, side = hand
    left = np.clip(1 - np.linalg.norm(grip.force) / pull, 0, 1)
    grip.target = grip.target + (side * SPEED * scene.time_step * left, 0, 0)


def _step(scene, pull) -> None:
    """One step, hands drawing with up to `pull` [N]; 0: where they are."""
    for knot in scene.handles.knots:
        for hand in (*knot.hands, *knot.tails) if pull else ():
            _draw(scene, hand, pull)
    scene.step()
    for knot in scene.handles.knots:
        _measure(scene, knot)


def _measure(scene, knot) -> None:
    one, other = (t.positions for t in knot.tendons)
    pairs = zip((one, other), knot.rests, strict=True)
    own = [measure.with_itself(line, NEIGHBOURS, rest) for line, rest in pairs]
    nearest = min(measure.between(one, other), *own) / TOUCH
    scene.record(knot.name, _pull(knot))
    scene.lowest(f"nearest, {knot.name}", nearest, "(r1 + r2)")
    knot.lost += knot.friction > 0 and _determinant(knot) != SUM_OF_TREFOILS


def _determinant(knot) -> int:
    one, other = (t.positions for t in knot.tendons)
    return topology.determinant(topology.closed_far(one, other[::-1]))


def _pull(knot) -> float:
    """What the weaker of the hands at the standing ends feels [N]."""
    return min(np.linalg.norm(hand.force) for hand, _ in knot.hands)
