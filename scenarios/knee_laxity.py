"""How loose is a knee? Drawer and pivot tests, intact and without its ACL, beside published cadavers.

The project's knee in a rig that holds its flexion. At each angle the unloaded knee comes to rest. Then the
tibia is drawn forwards and backwards by 90 N (the Lachman test is that at 30 degrees), and loaded by 10 N m
of valgus together with 5 N m of internal torque, as in a pivot shift test. Laxity is the way from the
unloaded place of the intact knee. The drawers have to be within one standard deviation of cadavers, where
these are published (12 knees, PMC7148266).
"""

import numpy as np

from .knee import KneeRig
from .scene import Check, Scene

ANGLES = 0, 15, 30, 60, 90  # degrees
FORCE = 90.0  # N
PIVOT = {"valgus": 10.0, "internal": 5.0}  # N m
STATES = "intact", "ACL cut"
# What is drawn in which state: the ACL does not hold the tibia from behind.
DRAWERS = {"intact": (("drawer", 1.0), ("posterior drawer", -1.0)), "ACL cut": (("drawer", 1.0),)}
PIVOTS_WITHOUT_ACL = (
    15  # degrees; beyond, this knee without menisci and muscles dislocates under the pivot's load
)
# Anterior drawer under 90 N by degrees: mean and standard deviation [mm], intact and with the ACL cut.
CADAVERS = {
    0: ((4.0, 1.4), (10.0, 2.9)),
    30: ((6.0, 2.5), (12.9, 2.5)),
    60: ((4.7, 2.4), (9.4, 2.7)),
    90: ((3.7, 2.3), (7.7, 2.5)),
}


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    rig = KneeRig(world=scene.world, step=scene.step)
    scene.handles.rig = rig
    scene.handles.unloaded = {}  # of the intact knee, by angle
    scene.handles.at_rest = True
    scene.bones = [rig.femur[0], rig.tibia[0]]
    scene.camera = {"target": (0, -0.012, 0), "distance": 0.27, "yaw": 55, "pitch": 10, "up": "y", "fov": 40}
    scene.labels.update(
        xlabel="flexion [degrees]", ylabel="anterior drawer [mm]", title="Laxity of a knee under 90 N"
    )
    return scene


def drive(scene, progress) -> None:
    rig = scene.handles.rig
    for state in STATES:
        if state != "intact":
            rig.cut("ACL")
        for angle in progress(ANGLES, state):
            _measure(scene, state, angle)
        for angle, published in CADAVERS.items():
            scene.record(f"cadavers, {state}", published[STATES.index(state)][0], at=angle)
    scene.note = _table(scene)


def check(scene) -> list[Check]:
    m = scene.measured
    checks = [
        *scene.health(),
        Check("came to rest", float(scene.handles.at_rest), "true", scene.handles.at_rest),
    ]
    for angle, published in CADAVERS.items():
        for state, (mean, deviation) in zip(STATES, published, strict=True):
            name = f"drawer at {angle}, {state}"
            checks.append(Check.at_most(f"{name}, from cadavers' mean", abs(m[name] - mean), deviation))
    for angle in ANGLES:
        gain = m[f"drawer at {angle}, ACL cut"] - m[f"drawer at {angle}, intact"]
        checks.append(Check.above(f"drawer at {angle}, gain by the cut", gain, 2.0))
    return checks


def _measure(scene, state: str, angle: int) -> None:
    """All tests at one angle; the load is taken off after each."""
    h = scene.handles
    h.rig.load()
    h.rig.flex(np.radians(angle))
    unloaded = _settled(scene)
    if state == "intact":
        h.unloaded[angle] = unloaded
    zero = h.unloaded[angle]
    for name, sign in DRAWERS[state]:
        h.rig.load(anterior=sign * FORCE)
        found = 1e3 * sign * (_settled(scene).anterior - zero.anterior)
        scene.measure(f"{name} at {angle}, {state}", found, "mm")
        if name == "drawer":
            scene.record(state, found, at=angle)
            if angle == 30:
                tubes, colours = h.rig.lines()
                scene.mark(f"{FORCE:.0f} N at 30 degrees, {state}", tendons=tubes, colors=colours)
        h.rig.load()
        _settled(scene)
    if state == "intact" or angle <= PIVOTS_WITHOUT_ACL:
        _pivot(scene, state, angle, zero)


def _pivot(scene, state: str, angle: int, zero) -> None:
    scene.handles.rig.load(**PIVOT)
    loaded = _settled(scene)
    turned = np.degrees(loaded.internal_rotation - zero.internal_rotation)
    scene.measure(f"pivot: anterior at {angle}, {state}", 1e3 * (loaded.anterior - zero.anterior), "mm")
    scene.measure(f"pivot: internal at {angle}, {state}", turned, "degrees")
    scene.handles.rig.load()
    _settled(scene)


def _settled(scene):
    scene.handles.at_rest &= scene.handles.rig.settle()
    return scene.handles.rig.coordinates


def _table(scene) -> str:
    """Anterior drawer beside cadavers."""
    lines = ["anterior drawer under 90 N [mm], and cadavers (PMC7148266):"]
    for angle in ANGLES:
        cells = [f"  {angle:3d} degrees"]
        for k, state in enumerate(STATES):
            published = "   none   "
            if angle in CADAVERS:
                mean, deviation = CADAVERS[angle][k]
                published = f"{mean:4.1f} +- {deviation:.1f}"
            cells.append(f"{state} {scene.measured[f'drawer at {angle}, {state}']:5.1f} ({published})")
        lines.append("   ".join(cells))
    return "\n".join(lines)
