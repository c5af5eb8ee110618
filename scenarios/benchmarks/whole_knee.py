"""Time of a step of a whole knee: 76 ligament strands, cartilage, and a graft in two bone tunnels.

The knee is the project's own, in a KneeRig at 1/240 s. So many of its strands are laid as two, each of half
the stiffness, that there are STRANDS. A hamstring graft of PARTICLES particles runs through the tunnels of
knee.urdf with friction, and is fixed at both ends under tension. One step is what a loop of a user's does:
put the load on the tibia, and TendonWorld.step() (read the bodies, solve, push the bodies, step pybullet).

In "drawer" the tibia is drawn forwards by 0 to 100 N at 1 Hz and turned by 2 N m. In "flexion" the femur
turns between 5 and 65 degrees, at 0.5 Hz, and in "fast flexion" at 5 Hz. In "passive" it turns by 18
degrees/s, from 0 to 90 degrees and back. In "posture" nothing moves. Times are of the thread's processor.
Each is run REPEATS times; "least" takes, for each step, the shortest of the runs. "Settling" is the time of
KneeRig.settle() from one drawer load to the next one, and of that without the graft; "cartilage" that of one
evaluation.
"""

from time import thread_time

import numpy as np
from bullet_tendon.scenarios.knee import KneeRig
from bullet_tendon.scenarios.knee_files import bone_paths
from bullet_tendon.scenarios.reconstruction import FEMORAL, TIBIAL

import bullet_tendon as bt
from bullet_tendon import _core, shapes
from bullet_tendon.mesh_files import read_mesh

STRANDS, PARTICLES = 76, 60
GRAFT_RADIUS, TUNNEL_RADIUS, FRICTION = 3.5e-3, 4.5e-3, 0.1  # m, m, -
STRETCH = 0.014  # of the graft at 20 degrees, without a load [-]
RATE = 240  # steps per second
STEPS, QUICK_STEPS, WARM_UP = 4800, 60, 10
REPEATS, QUICK_REPEATS = 3, 1
LOADS = 0.0, 30.0, 60.0, 100.0, 30.0  # N
EVALUATIONS = 200
PERCENTILES = (50, 99, 99.9, 100)


def run(quick, progress) -> dict:
    """Rows by motion: percentiles of a step [s] and ratios to real time; settling and cartilage [s]."""
    repeats, steps = (QUICK_REPEATS, QUICK_STEPS) if quick else (REPEATS, STEPS)
    rows = []
    for motion in progress(MOTIONS, "motions"):
        runs = [_run(motion, steps) for _ in range(repeats)]
        rows.append({"motion": motion, **_row(runs)})
    return {
        "strands": STRANDS,
        "particles": PARTICLES,
        "repeats": repeats,
        "rows": rows,
        "settling": {
            "with a graft": _settling(True),
            "without": _settling(False),
        },
        "cartilage": _evaluation(),
    }


def table(record) -> list[str]:
    heads = "".join(f"{name:>9}" for name in ("p50", "p99", "p99.9", "worst"))
    lines = [f"{'':13}{'':14}{'steps':>7}{heads}{'times real time':>17}{'iterations':>12}{'unsolved':>9}"]
    for row in record["rows"]:
        for kind in ("as_measured", "least"):
            found = row[kind]
            times = "".join(f"{1e3 * found[f'p{p:g}_s']:9.2f}" for p in PERCENTILES)
            lines.append(
                f"{row['motion']:13}{kind.replace('_', ' '):14}{row['steps']:7}{times}"
                f"{found['times_real_time']:17.1f}{row['iterations']:12.1f}{row['unconverged']:9}"
            )
    for name, times in record["settling"].items():
        each = ", ".join(f"{1e3 * seconds:.1f}" for seconds in times)
        lines.append(f"settling to {', '.join(f'{load:g}' for load in LOADS)} N, {name}: {each} ms")
    cartilage = record["cartilage"]
    lines.append(
        f"cartilage of {cartilage['points']} points: {1e6 * cartilage['seconds']:.1f} us an evaluation"
    )
    lines.append("times of steps in ms; least: for each step, the shortest of all runs")
    return lines


def panels(record) -> list[dict]:
    curves = []
    for row in record["rows"]:
        y = [1e3 * row["least"][f"p{p:g}_s"] for p in PERCENTILES]
        curves.append({"x": [101 - p for p in PERCENTILES], "y": y, "label": row["motion"]})
    labels = {"xlabel": "101 less the percentile", "ylabel": "step [ms]", "title": "Steps of a whole knee"}
    return [{**labels, "curves": curves}]


def whole_knee(graft: bool = True, **rig_arguments) -> tuple[KneeRig, bt.Tendon | None]:
    """A knee of STRANDS strands at 20 degrees of flexion, and its graft.

    rig_arguments: of KneeRig. The inner mouths of the tunnels are where its bones are nearest to those of
    knee.urdf; their outer ends are those of knee.urdf.
    """
    rig = KneeRig(time_step=1 / RATE, **rig_arguments)
    for name in list(rig.ligaments)[: STRANDS - len(rig.ligaments)]:
        _halve(rig, name)
    rig.flex(np.radians(20))
    rig.settle()
    return rig, _graft(rig, bone_paths("bones", rig_arguments.get("bones"))) if graft else None


def _halve(rig: KneeRig, name: str) -> None:
    """Lay a strand as two."""
    strand = rig.strands[name]
    rig.world.remove_ligament(rig.ligaments.pop(name))
    for half in (f"{name}, first half", f"{name}, second half"):
        rig.ligaments[half] = rig.lay(strand, half, share=0.5)
        rig.strands[half] = strand


def _nearest_on(mesh, point) -> np.ndarray:
    """(3,) the point of a mesh file's surface that is nearest to a point (3,) [m]."""
    surface = read_mesh(mesh)
    return shapes.mesh(surface.vertices, surface.triangles).measure([point], [point])[1][0]


def _graft(rig: KneeRig, meshes) -> bt.Tendon:
    """Through both tunnels, under tension, fixed at their outer ends. meshes: files of femur and tibia."""
    ends = []
    for bone, mesh, (mouth, outer) in zip((rig.femur, rig.tibia), meshes, (FEMORAL, TIBIAL), strict=True):
        mouth = _nearest_on(mesh, mouth)
        made = rig.world.add_tunnel(*bone, mouth, outer, radius=TUNNEL_RADIUS, friction=FRICTION)
        ends.append(made.ends)
    points = np.array([ends[0][1], ends[0][0], ends[1][0], ends[1][1]])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    graft = rig.world.add_tendon(
        points,
        GRAFT_RADIUS,
        bt.Material.preset("hamstring_graft"),
        particles=PARTICLES,
        name="graft",
        rest_length=length / (1 + STRETCH),
    )
    graft.attach(0, *rig.femur)
    graft.attach(-1, *rig.tibia)
    return graft


def _draw(rig: KneeRig, time: float) -> None:
    turn = 2 * np.pi * time
    rig.load(anterior=50 - 50 * np.cos(turn), internal=2 * np.sin(0.7 * turn))


def _flex(rig: KneeRig, time: float) -> None:
    rig.turn(np.radians(35 - 30 * np.cos(np.pi * time + np.pi / 3)))


def _flex_fast(rig: KneeRig, time: float) -> None:
    rig.turn(np.radians(35 - 30 * np.cos(10 * np.pi * time + np.pi / 3)))


def _move_passively(rig: KneeRig, time: float) -> None:
    rig.turn(np.radians(90 - abs(90 - (18 * time + 20) % 180)))


MOTIONS = {
    "posture": lambda rig, time: None,
    "drawer": _draw,
    "flexion": _flex,
    "passive": _move_passively,
    "fast flexion": _flex_fast,
}


def _run(motion: str, steps: int) -> dict:
    """Seconds of each step, iterations, and steps that were not solved."""
    rig, _ = whole_knee()
    with rig:
        rig.settle()
        seconds, iterations, unconverged = [], [], 0
        for k in range(WARM_UP + steps):
            MOTIONS[motion](rig, k / RATE)
            start = thread_time()
            rig.step()
            seconds.append(thread_time() - start)
            report = rig.world.report
            iterations.append(report.iterations)
            unconverged += not report.converged
    return {"seconds": seconds[WARM_UP:], "iterations": iterations[WARM_UP:], "unconverged": unconverged}


def _row(runs) -> dict:
    seconds = np.array([run["seconds"] for run in runs])
    return {
        "steps": seconds.shape[1],
        "as_measured": _percentiles(seconds.ravel()),
        "least": _percentiles(seconds.min(axis=0)),
        "iterations": float(np.mean(runs[0]["iterations"])),
        "unconverged": runs[0]["unconverged"],
    }


def _percentiles(seconds) -> dict:
    found = {f"p{p:g}_s": float(np.percentile(seconds, p)) for p in PERCENTILES}
    return {**found, "times_real_time": float(1 / RATE / np.mean(seconds))}


def _settling(graft: bool) -> list[float]:
    """Seconds to each of LOADS, the least of REPEATS."""
    runs = []
    for _ in range(REPEATS):
        rig, _ = whole_knee(graft)
        with rig:
            rig.load(anterior=LOADS[-1])
            rig.settle()
            runs.append([])
            for load in LOADS:
                rig.load(anterior=load)
                start = thread_time()
                rig.settle()
                runs[-1].append(thread_time() - start)
    return np.min(runs, axis=0).tolist()


def _evaluation() -> dict:
    """Seconds of one evaluation of the cartilage under 100 N, and its number of points."""
    rig, _ = whole_knee(False)
    with rig:
        rig.load(anterior=100.0)
        rig.settle()
        times = []
        for _ in range(2 * REPEATS):
            start = thread_time()
            _core.testing.evaluate_cartilage(rig.world._core, rig.cartilage.slot, EVALUATIONS)
            times.append((thread_time() - start) / EVALUATIONS)
        return {"points": len(rig.cartilage.points[0]), "seconds": min(times)}
