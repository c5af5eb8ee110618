"""Where to drill the femur: a map of anisometry and laxity over Bernard's grid.

The intact knee is flexed to 90 degrees, with a line without tension from each place of the grid to the tibial
tunnel. By how much its length changes is the place's anisometry. Then a graft is fixed at each place under 80
N at 20 degrees, and the knee is tested: the drawer at 30 degrees under 90 N, and the rotation at extension
under 5 N m of internal torque. Places high in the notch, as drilled through the tibial tunnel, make the graft
vertical: it lets the tibia rotate more.
"""

import numpy as np

import bullet_tendon as bt

from .knee import KneeRig
from .reconstruction import TIBIAL, drawer, on_bernards_grid, reconstruct
from .scene import Check, Scene

DEEP = 0.20, 0.30, 0.40, 0.50  # of the condyle's depth, from its rear
LOW = 0.06, 0.20, 0.35, 0.50  # of its height, from the roof of the notch
LAST, INCREMENT = 90, 15  # degrees of flexion
LACHMAN, TORQUE = 30, 5.0  # degrees; N m


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    scene.handles.rig = KneeRig(world=scene.world, step=scene.step)
    scene.handles.at_rest = True
    rig = scene.handles.rig
    scene.bones = [rig.femur[0], rig.tibia[0]]
    scene.camera = {"target": (0, -0.005, 0), "distance": 0.24, "yaw": 25, "pitch": 5, "up": "y", "fov": 40}
    scene.map_labels = ("depth from the rear [%]", "height below the roof [%]", "[mm], [degrees]")
    scene.labels.update(
        xlabel="height below the roof [%]",
        ylabel="internal rotation at extension [degrees]",
        title="Femoral tunnels on Bernard's grid",
    )
    return scene


def drive(scene, progress) -> None:
    rig = scene.handles.rig
    places = [(deep, low) for low in LOW for deep in DEEP]
    change = _anisometry(scene, places, progress)
    rig.load()
    rig.flex(np.radians(LACHMAN))
    scene.handles.at_rest &= rig.settle()
    scene.measure("drawer, intact", 1e3 * drawer(rig, np.radians(LACHMAN)), "mm")
    drawers, rotations = [], []
    for deep, low in progress(places, "reconstructing"):
        graft = reconstruct(rig, on_bernards_grid(deep, low))
        drawers.append(1e3 * drawer(rig, np.radians(LACHMAN)))
        rotations.append(_rotation(scene))
        if (deep, low) in ((DEEP[0], LOW[1]), (DEEP[1], LOW[0])):
            tubes, colours = rig.lines()
            line = type(tubes[0])(positions=graft.points, radius=0.0035)
            title = "high in the notch" if low == LOW[0] else "deep and lower"
            scene.mark(f"{title}: {100 * deep:.0f} %, {100 * low:.0f} %", tendons=[line], colors=colours)
        rig.world.remove_ligament(graft)
        scene.record(f"{100 * deep:.0f} % from the rear", rotations[-1], at=100 * low)
    maps = {"change of length [mm]": change, "drawer [mm]": drawers, "rotation [degrees]": rotations}
    for name, values in maps.items():
        table = np.reshape(values, (len(LOW), len(DEEP)))
        scene.map(name, 100 * np.array(DEEP), 100 * np.array(LOW), table)
        scene.measure(f"{name}, least", table.min())
        scene.measure(f"{name}, most", table.max())
        for low, row in zip(LOW, table, strict=True):
            scene.measure(f"{name}, mean at {100 * low:.0f} % below the roof", row.mean())
    scene.note = _table(places, maps)


def check(scene) -> list[Check]:
    m, at_rest = scene.measured, scene.handles.at_rest
    name = "rotation [degrees], mean at {:.0f} % below the roof"
    high, low = (m[name.format(100 * place)] for place in (LOW[0], LOW[-1]))
    looser = m["drawer [mm], most"] - m["drawer, intact"]
    return [
        *scene.health(),
        Check("came to rest", float(at_rest), "true", at_rest),
        Check.at_most("drawer, most, less the intact knee's", looser, 2.0),
        Check.above("rotation with a vertical graft, less that with a low one", high - low, 1.0),
        Check.above("change of length [mm], most", m["change of length [mm], most"], 2.0),
    ]


def _anisometry(scene, places, progress) -> list[float]:
    """Longest less shortest way from each place to the tibial tunnel, as the intact knee is flexed [mm]."""
    rig = scene.handles.rig
    slack = bt.Material(stiffness=1.0)
    lines = []
    for deep, low in places:
        mouth = on_bernards_grid(deep, low)[0]
        lines.append(rig.world.add_ligament([(*rig.femur, mouth), (*rig.tibia, TIBIAL[0])], slack))
        lines[-1].set_tension(0.0)
    lengths = []
    for angle in progress(range(0, LAST + 1, INCREMENT), "flexing"):
        rig.flex(np.radians(angle))
        scene.handles.at_rest &= rig.settle()
        lengths.append([1e3 * line.length for line in lines])
    for line in lines:
        rig.world.remove_ligament(line)
    return np.ptp(lengths, axis=0).tolist()


def _rotation(scene) -> float:
    """Under the torque at full extension [degrees]."""
    rig = scene.handles.rig
    rig.flex(0.0)
    scene.handles.at_rest &= rig.settle()
    rested = rig.coordinates.internal_rotation
    rig.load(internal=TORQUE)
    scene.handles.at_rest &= rig.settle()
    turned = rig.coordinates.internal_rotation - rested
    rig.load()
    scene.handles.at_rest &= rig.settle()
    return float(np.degrees(turned))


def _table(places, maps) -> str:
    lines = ["deep [%]  low [%]  " + "  ".join(maps)]
    for k, (deep, low) in enumerate(places):
        values = "".join(f"{column[k]:20.2f}" for column in maps.values())
        lines.append(f"{100 * deep:8.0f} {100 * low:8.0f}{values}")
    return "\n".join(lines)
