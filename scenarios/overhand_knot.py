"""An overhand knot is tied by hands and pulled tight with 200 N: it stays the knot that it is.

One hand holds the standing end, two fingers hold a loop, and a third hand leads the other end across the
standing part, around behind it and through the loop. Then the fingers let go and the hands pull. No two
stretches of the centreline that are not neighbours may be nearer to each other than twice the radius,
less three hundredths, at any step; and from the tying on the tendon, closed far away, is a trefoil.
"""

import numpy as np

import bullet_tendon as bt

from . import measure, topology
from .scene import Check, Scene

RADIUS, LENGTH, PARTICLES = 0.002, 0.36, 181  # m
START = np.array([-0.12, 0, 0])  # m, of the standing end; the tendon begins along x
FINGERS = (0.12, 0.182)  # m along the tendon, where fingers hold it
APEX = np.array([0.03, 0.05, 0.0])  # m, where the second finger goes to
CROSSING = np.array([-0.06, 0.0, 0.0])  # m, where the end is led around the standing part
THROUGH = np.array([0.0, 0.017, 0.0])  # m, where it passes through the loop
BEHIND = ((1, 0.3), (1, 1), (0.4, 1))  # from there: shares of its direction there, and away from the loop
REACH = 0.92  # of its length, at which the strand that is led is held
OPENING, TYING, TIGHTENING = 120, 600, 360  # steps
PULL = 200.0  # N
SPEED = 0.3  # m/s, at most, of the hand that pulls
TREFOIL = 3  # its determinant
NEAREST = 0.97  # of twice the radius
# As in the solver: what is nearer along the tendon, at rest, than half of the tightest turn of a tube.
NEIGHBOURS = np.pi * RADIUS  # m


def build(options) -> Scene:
    scene = Scene(options, gravity=0)
    h = scene.handles
    h.tendon = cord(scene.world, PARTICLES)
    h.rest = measure.rest_lengths(h.tendon)
    h.standing, h.end = h.tendon.grip(0), h.tendon.grip(-1)
    h.fingers = [h.tendon.grip(round(at / LENGTH * (PARTICLES - 1))) for at in FINGERS]
    h.path = _path()
    scene.camera = {"target": (-0.02, 0.015, 0), "distance": 0.28, "yaw": 20, "pitch": -60}
    scene.labels["ylabel"] = "distance of centrelines / (2 radius)"
    scene.plotted = ["nearest"]
    return scene


def cord(world, particles) -> bt.Tendon:
    """The tendon that is tied, straight along x."""
    material = bt.Material(
        stiffness=2e4, damping=0.05, bending_stiffness=1e-4, friction=0.4, damping_form="whole"
    )
    return world.add_tendon([START, START + (LENGTH, 0, 0)], RADIUS, material, particles, "overhand")


def drive(scene, progress) -> None:
    h = scene.handles
    scene.measure("determinant before", _determinant(scene))
    first, end = h.fingers[1].target, h.end.target
    for k in progress(range(OPENING), "opening"):
        share = (k + 1) / OPENING
        h.fingers[1].target = first + share * (APEX - first)
        h.end.target = end + share * (h.path(0) - end)
        _step(scene)
    for k in progress(range(TYING), "tying"):
        if k == 3 * TYING // 4:
            scene.mark(f"{scene.time:.2f} s: around the standing part")
        h.end.target = h.path((k + 1) / TYING)
        _step(scene)
    scene.mark(f"{scene.time:.2f} s: through the loop")
    for finger in h.fingers:
        finger.release()
    lost = 0
    for k in progress(range(TIGHTENING), "tightening"):
        if k == TIGHTENING // 4:
            scene.mark(f"{scene.time:.2f} s: tightening")
        _pull(scene)
        _step(scene)
        lost += _determinant(scene) != TREFOIL
    scene.measure("steps without the trefoil", lost)
    _finish(scene)


def check(scene) -> list[Check]:
    got = scene.measured
    return [
        *scene.health(),
        Check.at_least("nearest", got["nearest"], NEAREST),
        Check.equal("determinant before", got["determinant before"], 1),
        Check.equal("steps of tightening without the trefoil", got["steps without the trefoil"], 0),
        Check.at_least("pull on the end", got["pull on the end"], 0.995 * PULL),
        Check.at_least("pull on the standing end", got["pull on the standing end"], 0.995 * PULL),
    ]


def _path():
    """share -> (3,) [m]: the way of the end that is led, at an even speed."""
    points = way_points(APEX, CROSSING, THROUGH, REACH * (LENGTH - FINGERS[1]), 30)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return lambda share: np.array([np.interp(share * arc[-1], arc, column) for column in points.T])


def way_points(apex, crossing, through, strand, arc) -> np.ndarray:
    """(arc + 5, 3): in front of the standing part, behind it, under the loop and up through it [m].

    apex (3,): where the second finger is; crossing (3,): where the end is led around the standing part;
    through (3,): where it passes through the loop. strand: how far from apex the end is led [m]. arc: number
    of points in front. The loop is on the +y side of the standing part, which is along +x.
    """
    beyond = strand - np.linalg.norm(apex - crossing)
    up, last = np.array([0, 0, 1]), measure.unit(crossing - apex)
    angle = np.linspace(0, np.arctan2(last[1], last[0]) % (2 * np.pi), arc)[:, None]
    circle = np.hstack([np.cos(angle), np.sin(angle), 0 * angle])
    across = apex + 5 * RADIUS * up + strand * circle
    behind = crossing + 0.9 * beyond * np.array([measure.unit(share * last - z * up) for share, z in BEHIND])
    over = through + beyond * np.array([-0.85, 0.5])[:, None] * up
    return np.vstack([across, behind, over])


def _pull(scene) -> None:
    """Lead the end along x, the slower the nearer its force is to the full pull."""
    h = scene.handles
    force = np.linalg.norm(h.end.force)
    left = max(0.0, 1 - force / PULL)
    ahead = START + (LENGTH, 0, 0) - h.end.target
    h.end.target = h.end.target + SPEED * scene.time_step * left * measure.unit(ahead)


def _step(scene) -> None:
    h = scene.handles
    scene.step()
    own = measure.with_itself(h.tendon.positions, NEIGHBOURS, h.rest) / (2 * RADIUS)
    scene.record("nearest", own)
    scene.lowest("nearest", own, "(2 r)")


def _determinant(scene) -> int:
    return topology.determinant(topology.closed_far(scene.handles.tendon.positions))


def _finish(scene) -> None:
    h = scene.handles
    scene.measure("pull on the end", np.linalg.norm(h.end.force), "N")
    scene.measure("pull on the standing end", np.linalg.norm(h.standing.force), "N")
    scene.measure("contacts in the knot", len(scene.world.contacts))
    where = scene.world.contacts["position"]
    if len(where):
        close = {"target": where.mean(axis=0), "distance": 0.06}
        scene.mark(f"{scene.time:.2f} s: {scene.measured['pull on the end']:.0f} N", close)
