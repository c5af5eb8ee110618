"""A knee is flexed without muscles: where the tibia goes, and how long and how tight its ligaments are.

The project's knee in a rig that turns the femur, from full extension to 90 degrees. At each angle the tibia
comes to rest, without a load. Its path (Grood and Suntay's coordinates) and the forces of the groups of
ligaments are recorded. A loose knee has a play in which nothing resists: its path is that of the ligaments
that are taut.
"""

import numpy as np

from .knee import KneeRig
from .scene import Check, Scene

LAST, INCREMENT = 90, 5  # degrees
SHOWN = 0, 45, 90  # degrees
TAUT = 250.0  # N; no group is to pull harder in passive flexion
STRETCHED = 0.15  # strain that no strand is to exceed [-]


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    rig = KneeRig(world=scene.world, step=scene.step)
    scene.handles.rig = rig
    scene.handles.at_rest = True
    scene.bones = [rig.femur[0], rig.tibia[0]]
    scene.camera = {"target": (0, 0.0, 0), "distance": 0.36, "yaw": 60, "pitch": 8, "up": "y", "fov": 40}
    scene.labels.update(
        xlabel="flexion [degrees]", ylabel="[degrees], [mm]", title="Passive flexion of a knee"
    )
    scene.plotted = ["internal rotation", "adduction", "anterior", "superior", "lateral"]
    return scene


def drive(scene, progress) -> None:
    rig = scene.handles.rig
    for angle in progress(range(0, LAST + 1, INCREMENT), "flexing"):
        rig.flex(np.radians(angle))
        scene.handles.at_rest &= rig.settle()
        _record(scene, angle)
        if angle in SHOWN:
            tubes, colours = rig.lines()
            scene.mark(f"{angle} degrees", tendons=tubes, colors=colours)
    scene.note = _table(scene)


def check(scene) -> list[Check]:
    m = scene.measured
    return [
        *scene.health(),
        Check("came to rest", float(scene.handles.at_rest), "true", scene.handles.at_rest),
        Check.at_most("force of a group, most", m["force of a group, most"], TAUT),
        Check.at_most("strain, most", m["strain, most"], STRETCHED),
        Check.above("internal rotation at 90", m["internal rotation at 90"], m["internal rotation at 0"]),
        Check.at_most("adduction, most", m["adduction, most"], 5.0),
    ]


def _record(scene, angle: int) -> None:
    rig = scene.handles.rig
    at = rig.coordinates
    found = {
        "internal rotation": np.degrees(at.internal_rotation),
        "adduction": np.degrees(at.adduction),
        "anterior": 1e3 * at.anterior,
        "superior": 1e3 * at.superior,
        "lateral": 1e3 * at.lateral,
    }
    for name, value in found.items():
        scene.record(name, value, at=angle)
    forces = rig.forces
    for group, force in forces.items():
        scene.record(f"force {group}", force, at=angle)
    tensions = [force for group, force in forces.items() if group != "cartilage"]
    scene.highest("force of a group, most", max(tensions), "N")
    scene.highest("force of the cartilage, most", forces["cartilage"], "N")
    scene.highest("strain, most", max(ligament.strain for ligament in rig.ligaments.values()))
    scene.highest("adduction, most", abs(found["adduction"]), "degrees")
    if angle in SHOWN:
        scene.measure(f"internal rotation at {angle}", found["internal rotation"], "degrees")
        scene.measure(f"anterior at {angle}", found["anterior"], "mm")


def _table(scene) -> str:
    """Forces of the groups [N] against flexion."""
    forces = {name[6:]: values for name, values in scene.series.items() if name.startswith("force ")}
    lines = ["forces [N] against flexion:", "       " + "".join(f"{group:>10}" for group in forces)]
    angles = next(iter(forces.values()))[0]
    for k in range(0, len(angles), 3):
        lines.append(f"  {angles[k]:5.0f}" + "".join(f"{values[1][k]:10.1f}" for values in forces.values()))
    return "\n".join(lines)
