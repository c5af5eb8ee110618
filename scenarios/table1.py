"""Frames per second of the paper's two models, with their surfaces (table 1 of the paper).

"Original": two tendons of 10 particles each that collide. A closed surface of 158 vertices has 312
triangles (Euler), so these numbers of the table are one surface, and each of the two carries one.
"Composite": 60 particles, dragged around at one end, with 1,478 vertices. No closed orientable surface
has these and the table's 4,694 triangles: Euler's formula leaves 2,952 less 4 for every hole; so ours
has 2,952. A frame is a step of 1/240 s, and vertices and normals of every surface afterwards. The
default and the paper's own method take turns, in blocks of frames, on the same scene. The paper
measured 181 and 51 frames/s on a Pentium 4 at 2.8 GHz, and drew the picture too.
"""

from time import perf_counter
from types import SimpleNamespace

import numpy as np

import bullet_tendon as bt

from .scene import Check, Scene

BLOCKS, FRAMES = 10, 50  # blocks for every model and method, frames in each
PAPER = {"original": 181.0, "composite": 51.0}  # frames/s
SURFACE = {"original": (158, 312), "composite": (1478, 2952)}  # vertices and triangles of each
TUBES = {"original": (12, 13), "composite": (18, 82)}  # points round each layer, layers
PARTICLES = {"original": 20, "composite": 60}  # in all
METHODS = {"default": bt.SolverOptions(), "published": bt.SolverOptions.published()}
MATERIAL = bt.Material(stiffness=3e3, damping=1.0, tension_only=True, friction=0.2)


def build(options) -> Scene:
    scene = Scene(options)
    makers = {"original": _original, "composite": _composite}
    scene.handles.runs = [make(scene, model, method) for model, make in makers.items() for method in METHODS]
    scene.camera = {"target": (0.07, 0, -0.02), "distance": 0.2, "yaw": 30, "pitch": -25}
    scene.labels |= {"xlabel": "block", "ylabel": "frames per second"}
    scene.note = "paper, on a Pentium 4 at 2.8 GHz, with rendering: original 181, composite 51 frames/s"
    return scene


def drive(scene, progress) -> None:
    runs = scene.handles.runs
    for block in progress(range(BLOCKS), "blocks"):
        for run in runs:
            seconds = sum(_frame(scene, run, block * FRAMES + k) for k in range(FRAMES))
            run.seconds += seconds
            scene.record(run.name, FRAMES / seconds, at=block)
            scene.measure(run.name, FRAMES * (block + 1) / run.seconds, "frames/s")
        if block in (0, BLOCKS - 1):
            for run in (runs[0], runs[2]):
                scene.mark(f"{run.model}, frame {(block + 1) * FRAMES}", tendons=run.skins)
    for model in PAPER:
        ratio = scene.measured[f"{model}, default"] / scene.measured[f"{model}, published"]
        scene.measure(f"{model}, default / published", ratio)


def check(scene) -> list[Check]:
    got, checks = scene.measured, []
    for run in scene.handles.runs:
        checks.append(Check.above(run.name, got[run.name], PAPER[run.model]))
        checks.append(Check(f"{run.name}: finite", float(run.finite), "true", run.finite))
        particles = sum(tendon.particles for tendon in run.world.tendons)
        checks.append(Check.equal(f"{run.name}: particles", particles, PARTICLES[run.model]))
        for skin in run.skins:
            sizes = zip(("vertices", "triangles"), _closed_sizes(skin), SURFACE[run.model], strict=True)
            checks += [Check.equal(f"{run.name}: {what}", have, want) for what, have, want in sizes]
        if run.model == "original":
            checks.append(Check.above(f"{run.name}: contacts", run.contacts, 0))
    return checks


def _original(scene, model, method):
    """Two tendons, one held, the other drawn across it to and fro."""
    run = _run(scene, model, method)
    lines = [[(0, 0, 0), (0.1, 0, 0)], [(0.05, -0.05, 0.01), (0.05, 0.05, 0.01)]]
    tendons = [run.world.add_tendon(line, 0.004, MATERIAL, PARTICLES[model] // 2) for line in lines]
    for end in (0, -1):
        tendons[0].grip(end)
    return _equip(run, [tendons[1].grip(end) for end in (0, -1)], (0.02, 0, -0.012))


def _composite(scene, model, method):
    """One tendon held at its first particle and dragged around by its last."""
    run = _run(scene, model, method)
    tendon = run.world.add_tendon([(0, 0, 0), (0.15, 0, 0)], 0.004, MATERIAL, PARTICLES[model])
    tendon.grip(0)
    return _equip(run, [tendon.grip(-1)], (-0.05, 0.05, -0.03))


def _run(scene, model, method) -> SimpleNamespace:
    world = bt.TendonWorld(scene.client, METHODS[method])
    name = f"{model}, {method}"
    return SimpleNamespace(
        name=name, model=model, world=world, seconds=0.0, finite=True, contacts=0, skins=[]
    )


def _equip(run, grips, reach) -> SimpleNamespace:
    """Give every tendon its surface; the grips swing by `reach` (3,) [m] and back."""
    ring, layers = TUBES[run.model]
    run.skins = [bt.Skin.tube(tendon, ring, layers) for tendon in run.world.tendons]
    run.grips, run.starts, run.reach = grips, [grip.target for grip in grips], np.array(reach)
    return run


def _frame(scene, run, k) -> float:
    """Frame k of a run. Seconds it took: the step as the world reports it, and the surfaces."""
    phase = 2 * np.pi * k / 240
    # Down from the first frame on, sideways from where it is; both smooth.
    share = np.array([0.5 - 0.5 * np.cos(phase), np.sin(phase), 0.5 - 0.5 * np.cos(phase / 2)])
    for grip, start in zip(run.grips, run.starts, strict=True):
        grip.target = start + run.reach * share
    scene.world = run.world
    scene.step()
    start = perf_counter()
    surfaces = [(skin.vertices, skin.normals) for skin in run.skins]
    seconds = perf_counter() - start + sum(run.world.report.seconds.values())
    run.finite &= all(np.isfinite(part).all() for surface in surfaces for part in surface)
    run.contacts += int((run.world.contacts["normal_force"] > 0).sum())
    return seconds


def _closed_sizes(skin) -> tuple[int, int]:
    """Vertices that triangles use, and triangles; 0 triangles unless the surface is closed.

    Closed: every edge is run through once in each direction.
    """
    triangles = skin.triangles
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    forward, back = {tuple(e) for e in edges.tolist()}, {tuple(e) for e in edges[:, ::-1].tolist()}
    closed = len(forward) == len(edges) and forward == back
    return len(np.unique(triangles)), len(triangles) if closed else 0
