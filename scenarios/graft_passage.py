"""A graft is pulled through the tibial and the femoral tunnel (figures 3 and 4 of the paper).

The project's knee at 30 degrees of flexion, bones fixed. A graft of 60 particles lies below the tibial
tunnel; its leading end is drawn along the tunnels' axes, as by a passing suture, until the graft
lies in both tunnels, while its other end is held back by a constant force. What the hand feels and
what the bones feel is recorded. Particles in a bore keep within it, no segment crosses a bone.
"""

from time import process_time

import numpy as np
import pybullet as p

import bullet_tendon as bt

from . import measure
from .scene import Check, Scene

FLEXION = np.radians(30)
RADIUS, LENGTH, PARTICLES = 0.0035, 0.12, 60  # of the graft [m]
SPEED = 0.05  # of the leading end [m/s]
LEAD_IN, LEAD_OUT = 0.006, 0.012  # of the leading end, before the first mouth and beyond the last [m]
HELD_BACK, RAMP = 10.0, 0.25  # force on the other end [N], and the time it takes to come up [s]
SETTLE = 0.5  # time after the passage [s]
DEPTH = 0.02  # of the radius


def build(options) -> Scene:
    scene = Scene(options)
    p.setGravity(0, -9.81, 0, scene.client)  # the knee's y axis points up the leg
    tibia_turn = p.getQuaternionFromEuler([0, 0, -FLEXION])
    femur = _load(scene, "femur.urdf", (0, 0, 0, 1))
    tibia = _load(scene, "tibia.urdf", tibia_turn)
    scene.bones = [femur, tibia]
    scene.names = {femur: "femur", tibia: "tibia"}
    bores = {tunnel.bodyUniqueId: tunnel for tunnel in scene.world.tunnels}
    prepare(scene, [bores[tibia], bores[femur]])
    scene.camera = {"target": (0.0, -0.008, 0), "distance": 0.26, "yaw": 35, "pitch": 8, "up": "y", "fov": 40}
    return scene


def prepare(scene, tunnels) -> None:
    """Lay the graft below the first of two tunnels, and plan the way of its leading end."""
    h = scene.handles
    h.tunnels = tunnels
    placed = {tunnel.name: ends for tunnel, ends in zip(scene.world.tunnels, scene.tunnels, strict=True)}
    h.bores = [placed[tunnel.name][:2] for tunnel in tunnels]
    h.way = way_of_hand(h.bores)
    h.arc = arc_lengths(h.way)
    lead = h.way[0]
    h.down = measure.unit(lead - h.way[1])
    material = bt.Material.preset("hamstring_graft")
    h.graft = scene.world.add_tendon([lead, lead + LENGTH * h.down], RADIUS, material, PARTICLES, "graft")
    h.hand = h.graft.grip(0)
    scene.labels.update(ylabel="force [N]", title="A graft through two bone tunnels")


def way_of_hand(bores) -> np.ndarray:
    """(6, 3) the leading end's way [m]: from before the first bore (start, end) to beyond the second."""
    (a, b), (c, d) = bores
    return np.array([a + LEAD_IN * measure.unit(a - b), a, b, c, d, d + LEAD_OUT * measure.unit(d - c)])


def arc_lengths(way) -> np.ndarray:
    """(m,) arc length [m] of each point of a polyline (m, 3), from its first."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])


def points_at(way, arc, lengths) -> np.ndarray:
    """Points (..., 3) [m] of a polyline (m, 3) at arc lengths (...) [m]; arc: those of its points."""
    return np.stack([np.interp(lengths, arc, way[:, c]) for c in range(3)], axis=-1)


def drive(scene, progress) -> None:
    h = scene.handles
    duration = h.arc[-1] / SPEED + SETTLE
    steps = round(duration / scene.time_step)
    moments = {0: "before", round(0.3 * steps): "tibial tunnel", round(0.55 * steps): "joint"}
    spent = 0.0
    for k in progress(range(steps), "pulling the graft"):
        if k in moments:
            scene.mark(f"{moments[k]}, {scene.time:.1f} s")
        _lead(h, scene.time + scene.time_step)
        start = process_time()  # of another program, or of waiting for a window, nothing counts
        scene.step()
        spent += process_time() - start
        _measure(scene)
    scene.mark(f"in both tunnels, {scene.time:.1f} s")
    scene.measure("speed", scene.time / spent, "x real time")
    scene.measure("particles in the tibial tunnel", _inside(h, 0).sum())
    scene.measure("particles in the femoral tunnel", _inside(h, 1).sum())
    scene.note = _table(scene)


def check(scene) -> list[Check]:
    m = scene.measured
    clearance = 1 - DEPTH  # of the radius, where the wall is at R - r
    return [
        *scene.health(),
        Check.at_least("least distance to a bore's wall", m["least distance to a bore's wall"], clearance),
        Check.at_least("least distance to a contact", m["least distance to a contact"], clearance),
        Check.equal("segments through a bone", m["segments through a bone"], 0),
        Check.at_least("particles in the tibial tunnel", m["particles in the tibial tunnel"], 5),
        Check.at_least("particles in the femoral tunnel", m["particles in the femoral tunnel"], 5),
        Check.at_least("speed", m["speed"], 1),
    ]


def _load(scene, name, turn) -> int:
    flags = p.URDF_USE_INERTIA_FROM_FILE
    return scene.world.load_urdf(bt.data_path(name), (0, 0, 0), turn, useFixedBase=True, flags=flags)


def _lead(h, time) -> None:
    """Move the hand to where it has to be at `time` [s], and raise the force that holds back."""
    along = min(SPEED * time, h.arc[-1])
    h.hand.target = points_at(h.way, h.arc, along)
    h.graft.set_force(-1, held_back(h, time))


def held_back(h, time) -> np.ndarray:
    """(3,) force on the graft's other end at `time` [s], which comes up slowly [N]."""
    return HELD_BACK * min(1.0, time / RAMP) * h.down


def _measure(scene) -> None:
    h = scene.handles
    scene.record("pull on the hand", np.linalg.norm(h.hand.force))
    for bone, tunnel in zip(("tibia", "femur"), h.tunnels, strict=True):
        wrench = scene.world.wrench(tunnel.bodyUniqueId, tunnel.linkIndex)
        scene.record(f"on the {bone}", np.linalg.norm(wrench[:3]))
        scene.highest(f"force on the {bone}, most", np.linalg.norm(wrench[:3]), "N")
    scene.highest("pull, most", np.linalg.norm(h.hand.force), "N")
    for which, tunnel in enumerate(h.tunnels):
        height, off_axis, length = _cylinder(h, which)
        lowest = 2 * tunnel.radius  # an oblique mouth's rim is lower on one side
        off_axis = off_axis[_inside(h, which) & (height > lowest) & (height < length - lowest)]
        if len(off_axis):
            gap = (tunnel.radius - off_axis.max()) / RADIUS
            scene.lowest("least distance to a bore's wall", gap, "radii")
    contacts = scene.world.contacts
    if len(contacts):
        scene.lowest("least distance to a contact", 1 + contacts["distance"].min() / RADIUS, "radii")
    scene.highest("segments through a bone", _crossings(scene))
    scene.highest("Newton iterations, most", scene.world.report.iterations)


def _cylinder(h, which) -> tuple[np.ndarray, np.ndarray, float]:
    """Heights along a bore's axis (n,), distances from it (n,) and the bore's length [m]."""
    start, end = h.bores[which]
    length = np.linalg.norm(end - start)
    axis = (end - start) / length
    away = h.graft.positions - start
    height = away @ axis
    return height, np.linalg.norm(away - np.outer(height, axis), axis=1), length


def _inside(h, which) -> np.ndarray:
    """(n,) which particles are between the bore's mouths and not on the bone's other side."""
    height, off_axis, length = _cylinder(h, which)
    return (height >= 0) & (height <= length) & (off_axis < 3 * h.tunnels[which].radius)


def _crossings(scene) -> int:
    """How many segments outside the bores cross a bone: pybullet's own rays along the centreline."""
    h = scene.handles
    x = h.graft.positions
    drilled = np.zeros(len(x), bool)
    for which, tunnel in enumerate(h.tunnels):
        height, off_axis, length = _cylinder(h, which)
        reach = 2 * tunnel.radius  # a slanting mouth reaches beyond its circle
        drilled |= (height > -reach) & (height < length + reach) & (off_axis <= tunnel.radius)
    open_segments = ~(drilled[:-1] | drilled[1:])
    if not open_segments.any():
        return 0
    rays = p.rayTestBatch(x[:-1][open_segments], x[1:][open_segments], physicsClientId=scene.client)
    return sum(hit[0] in scene.bones for hit in rays)


def _table(scene) -> str:
    """Pull on the hand against time, ten lines."""
    time, pull = scene.series["pull on the hand"]
    rows = np.linspace(0, len(time) - 1, 10).round().astype(int)
    lines = [f"  {time[k]:6.2f} s  {pull[k]:7.2f} N" for k in rows]
    return "pull on the hand against time:\n" + "\n".join(lines)
