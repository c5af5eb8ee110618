"""Where to drill the femur: maps of anisometry and laxity over Bernard's grid.

The intact knee is flexed to 90 degrees, with a line without tension from each place of the grid to the tibial
tunnel. By how much its length changes is the place's anisometry. Then a graft is fixed at each place under 80
N at 20 degrees, and the knee is tested: the drawer at 30 degrees under 90 N, and the rotation at extension
under 5 N m of internal torque. The grid is covered wherever the notch has a wall.

Three places are marked and tested beside: the middle of the native footprint (24.8 % from the rear, 28.5 %
below the roof: Bernard 1997, Am J Knee Surg 10:14), the mean of tunnels that were drilled through the tibia
(35.1 +- 5.3 %, 16.6 %: 26 knees, Yang 2014, Clin Orthop Surg 6:32), and where the tibial tunnel of this knee
points at 90 degrees, which is all that a straight drill can reach. Tunnels through the tibia are too shallow
and too high: the graft is vertical, and lets the tibia rotate more.
"""

import numpy as np
import pybullet as p
from bullet_tendon.urdf.femur_field import femur

import bullet_tendon as bt
from bullet_tendon.errors import InvalidValue

from .knee import KneeRig
from .measure import unit
from .reconstruction import TIBIAL, drawer, on_bernards_grid, reconstruct, to_bernards_grid
from .scene import Check, Scene

DEEP = tuple(k / 10 for k in range(11))  # of the condyle's depth, from its rear
LOW = tuple(k / 10 for k in range(11))  # of its height, from the roof of the notch
PLOTTED = 0.2, 0.3, 0.4, 0.5  # depths whose rotation is plotted
FOOTPRINT, TRANSTIBIAL = (0.248, 0.285), (0.351, 0.166)  # published
LAST, INCREMENT = 90, 15  # degrees of flexion
LACHMAN, TORQUE = 30, 5.0  # degrees; N m
DRILL = 0.06  # m: beyond the tibial tunnel, in which its line meets the femur


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    scene.handles.rig = KneeRig(world=scene.world, step=scene.step)
    scene.handles.at_rest = True
    rig = scene.handles.rig
    scene.bones = [rig.femur[0], rig.tibia[0]]
    scene.camera = {"target": (0, -0.005, 0), "distance": 0.24, "yaw": 25, "pitch": 5, "up": "y", "fov": 40}
    scene.map_labels = ("depth from the rear [%]", "height below the roof [%]", "")
    scene.labels.update(
        xlabel="height below the roof [%]",
        ylabel="internal rotation at extension [degrees]",
        title="Femoral tunnels on Bernard's grid",
    )
    scene.plotted = [_depth(deep) for deep in PLOTTED]
    return scene


def drive(scene, progress) -> None:
    rig = scene.handles.rig
    grid = [(deep, low) for low in LOW for deep in DEEP if _has_wall(deep, low)]
    marks = {"footprint": FOOTPRINT, "through the tibia, published": TRANSTIBIAL}
    lengths = _lengths(scene, [*grid, *marks.values()], progress)
    marks["line of the tibial tunnel at 90 degrees"] = pointed = _pointed_at(rig)
    places = [*grid, *marks.values()]
    lengths.append(_lengths(scene, [pointed], progress)[0])
    rig.load()
    rig.flex(np.radians(LACHMAN))
    scene.handles.at_rest &= rig.settle()
    scene.measure("drawer, intact", 1e3 * drawer(rig, np.radians(LACHMAN)), "mm")
    rows = []
    for k, place in enumerate(progress(places, "reconstructing")):
        graft = reconstruct(rig, on_bernards_grid(*place))
        found = 1e3 * drawer(rig, np.radians(LACHMAN)), _rotation(scene)
        rows.append((lengths[k], *found))
        if k >= len(grid):
            name = list(marks)[k - len(grid)]
            _tell(scene, name, place, rows[-1], graft)
        elif place[0] in PLOTTED:
            scene.record(_depth(place[0]), found[1], at=100 * place[1])
        rig.world.remove_ligament(graft)
    _draw_maps(scene, grid, marks, np.array(rows))


def check(scene) -> list[Check]:
    m, at_rest = scene.measured, scene.handles.at_rest
    looser = m["drawer, most"] - m["drawer, intact"]
    more = m["rotation, through the tibia, published"] - m["rotation, footprint"]
    return [
        *scene.health(),
        Check("came to rest", float(at_rest), "true", at_rest),
        Check.at_most("drawer, most, less the intact knee's", looser, 2.0),
        Check.above("rotation with a tunnel through the tibia, less that at the footprint", more, 0.5),
        Check.above("change of length, most", m["change of length, most"], 2.0),
    ]


def _depth(deep: float) -> str:
    return f"{100 * deep:.0f} % from the rear"


def _has_wall(deep: float, low: float) -> bool:
    try:
        on_bernards_grid(deep, low)
    except InvalidValue:
        return False
    return True


def _lengths(scene, places, progress) -> list[float]:
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


def _pointed_at(rig) -> tuple[float, float]:
    """The place on the grid where the line of the tibial tunnel meets the femur, where the knee is now."""
    femoral = p.invertTransform(*p.getBasePositionAndOrientation(rig.femur[0], rig.client))
    tibial = p.getLinkState(*rig.tibia, 0, 1, rig.client)[4:6]
    frame = p.multiplyTransforms(*femoral, *tibial)
    inner, outer = (np.array(p.multiplyTransforms(*frame, point, (0, 0, 0, 1))[0]) for point in TIBIAL)
    line = inner + np.linspace(0, DRILL, 1201)[:, None] * unit(inner - outer)
    return to_bernards_grid(line[(femur(1e3 * line) < 0).argmax()])


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


MAPS = ("change of length", "mm"), ("drawer", "mm"), ("rotation", "degrees")


def _tell(scene, name: str, place, found, graft) -> None:
    """Measure what was found at a marked place, and photograph the graft there."""
    for (title, unit_), value in zip(MAPS, found, strict=True):
        scene.measure(f"{title}, {name}", value, unit_)
    tubes, colours = scene.handles.rig.lines()
    line = type(tubes[0])(positions=graft.points, radius=0.0035)
    deep, low = place
    scene.mark(f"{name}: {100 * deep:.0f} %, {100 * low:.0f} %", tendons=[line], colors=colours)


def _draw_maps(scene, grid, marks, found) -> None:
    """found (len(grid) + len(marks), 3): values of MAPS."""
    places = {name: (100 * deep, 100 * low) for name, (deep, low) in marks.items()}
    at = [(LOW.index(low), DEEP.index(deep)) for deep, low in grid]
    for (title, unit_), values in zip(MAPS, found[: len(grid)].T, strict=True):
        table = np.full((len(LOW), len(DEEP)), np.nan)
        table[tuple(np.transpose(at))] = values
        axes = 100 * np.array(DEEP), 100 * np.array(LOW)
        scene.map(title, *axes, table, label=f"[{unit_}]", marks=places, down=True)
        scene.measure(f"{title}, least", values.min(), unit_)
        scene.measure(f"{title}, most", values.max(), unit_)
    lines = ["deep [%]  low [%]" + "".join(f"{f'{title} [{unit_}]':>24}" for title, unit_ in MAPS)]
    for (deep, low), row in zip([*grid, *marks.values()], found, strict=True):
        lines.append(f"{100 * deep:8.0f} {100 * low:8.0f}" + "".join(f"{value:24.2f}" for value in row))
    scene.note = "\n".join(lines)
