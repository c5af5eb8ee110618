"""Time of a step with and without a Recorder, and the sizes of what it writes.

The scene is that of the scenario `graft_passage`: two bones with tunnels, a graft of 60 particles. A hand
draws it into both tunnels and back, in PERIOD seconds. The scene is run for each variant: without a recorder,
with one that is asked for nothing ("idle", every=None), with 30 frames a simulated second (every EVERY
steps), and with a frame each step. All variants take the same steps, by turns, ROUND at a time, and all of it
is repeated REPEATS times. What counts of a round is the least processor time that its steps took, because
another program can only add to it. Sizes are those of SECONDS simulated seconds at 30 frames a second.

"Scenes" has a frame each step beside none in other scenes: the whole knee of the benchmark `whole_knee` at
rest, the finger of the scenario `tendon_finger` that its tendons close, and a tendon of 60 particles that
swings, with nothing else in its world. Their rounds are SHORT steps, and what counts is the median.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
import pybullet as p
from bullet_tendon.scenarios import graft_passage, tendon_finger
from bullet_tendon.scenarios.scene import Options

import bullet_tendon as bt

from .whole_knee import whole_knee

EVERY = 8  # steps of 1/240 s: 30 frames a second
VARIANTS = {"off": {}, "idle": {}, "30 a second": {"every": EVERY}, "each step": {"every": 1}}
ROUND, REPEATS = 48, 5  # steps in a round; runs
PERIOD, SECONDS, QUICK_SECONDS = 5.0, 20.0, 0.6
SHORT, ROUNDS, QUICK_ROUNDS = 12, 100, 4


def run(quick, progress) -> dict:
    """Rows by variant: times of a step [us] (mean; of rounds p50, p99, most), share above "off"; files."""
    seconds, repeats = (QUICK_SECONDS, 1) if quick else (SECONDS, REPEATS)
    count = round(seconds * 240 / ROUND)
    least = {name: np.full(count, np.inf) for name in VARIANTS}
    for _ in range(repeats):
        scenes = {name: graft_passage.build(Options()) for name in VARIANTS}
        recorders = {name: _recorder(scenes[name], VARIANTS[name]) for name in VARIANTS if name != "off"}
        for k in progress(range(count), "steps"):
            for name, scene in scenes.items():
                least[name][k] = min(least[name][k], _round(scene))
        recorder = recorders["30 a second"]
        record = {"frames": len(recorder), "memory_mb": recorder._bytes / 1e6, "files": _sizes(recorder)}
        for scene in scenes.values():
            scene.close()
    rows = []
    for name, times in least.items():
        share = times.sum() / least["off"].sum() - 1
        p50, p99, most = 1e6 * np.percentile(times, (50, 99, 100)) / ROUND
        mean = {"variant": name, "step_us": 1e6 * times.mean() / ROUND, "share": float(share)}
        rows.append({**mean, "p50_us": p50, "p99_us": p99, "most_us": most})
    scenes = [_in_scene(name, QUICK_ROUNDS if quick else ROUNDS) for name in progress(SCENES, "scenes")]
    return {"seconds": seconds, "repeats": repeats, "rows": rows, "scenes": scenes, **record}


def _in_scene(name: str, rounds: int) -> dict:
    """Times of a step and of a frame [us] in one of SCENES: medians of the rounds' means."""
    worlds = [SCENES[name]() for _ in range(2)]
    recorder = bt.Recorder(worlds[1], every=1)
    times = np.empty((2, rounds))
    for k in range(rounds):
        for which in (0, 1) if k % 2 else (1, 0):
            start = process_time()
            for _ in range(SHORT):
                worlds[which].step()
            times[which, k] = process_time() - start
    off, on = 1e6 * np.median(times, axis=1) / SHORT
    size = recorder._bytes / len(recorder)
    for world in worlds:
        p.disconnect(world.physicsClientId)
    return {"scene": name, "step_us": off, "frame_us": on - off, "share": on / off - 1, "bytes": size}


def _knee() -> bt.TendonWorld:
    return whole_knee()[0].world


def _finger() -> bt.TendonWorld:
    scene = tendon_finger.build(Options())
    for name, tendon in scene.handles.tendons.items():
        tendon.set_force(-1, (-tendon_finger.PULL[name], 0, 0))
    return scene.world


def _tendon() -> bt.TendonWorld:
    client = p.connect(p.DIRECT)
    p.setTimeStep(1 / 240, physicsClientId=client)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    world = bt.TendonWorld(client)
    material = bt.Material(stiffness=1e4, damping=1.0)
    world.add_tendon([(0, 0, 0), (0.3, 0, 0)], 2e-3, material, particles=60).grip(0)
    return world


SCENES = {"whole knee": _knee, "finger": _finger, "one tendon": _tendon}


def _recorder(scene, wanted) -> bt.Recorder:
    return bt.Recorder(scene.world, camera=scene.camera, title="A graft in a knee", **wanted)


def table(record) -> list[str]:
    lines = [f"{'recorder':14}{'step us':>10}{'more by':>10}"]
    for row in record["rows"]:
        lines.append(f"{row['variant']:14}{row['step_us']:10.1f}{100 * row['share']:9.2f}%")
    for row in record["scenes"]:
        times = f"{row['step_us']:10.1f}{100 * row['share']:9.2f}%"
        size = f"{row['frame_us']:.1f} us and {row['bytes']:.0f} bytes a frame"
        lines.append(f"{row['scene']:14}{times}: {size}")
    told = f"{record['seconds']:g} s, {record['frames']} frames"
    lines.append(f"{told}: {record['memory_mb']:.2f} MB in memory")
    for name, size in record["files"].items():
        lines.append(f"{name:30}{size:8.2f} MB")
    return lines


def panels(record) -> list[dict]:
    rows = record["rows"]
    curve = {"x": list(range(1, len(rows) + 1)), "y": [row["step_us"] for row in rows], "label": "step"}
    axes = {"xlabel": ", ".join(row["variant"] for row in rows), "ylabel": "processor time [us]"}
    return [{**axes, "title": "A step with a recorder", "curves": [curve]}]


def _round(scene) -> float:
    """Seconds of processor time that ROUND steps take, without the hand's motion."""
    h, total = scene.handles, 0.0
    for _ in range(ROUND):
        scene.time += scene.time_step
        along = h.arc[-1] * (0.5 - 0.5 * np.cos(2 * np.pi * scene.time / PERIOD))
        h.hand.target = [np.interp(along, h.arc, h.way[:, c]) for c in range(3)]
        h.graft.set_force(-1, graft_passage.held_back(h, scene.time))
        start = process_time()
        scene.world.step()
        total += process_time() - start
    return total


def _sizes(recorder) -> dict:
    """Of the files that the recorder writes [MB]."""
    wanted = {"run.npz": {}, "run.html": {}, "run.html, without contacts": {"contacts": False}}
    sizes = {}
    with TemporaryDirectory() as folder:
        for name, options in wanted.items():
            path = Path(folder) / name.partition(",")[0]
            try:
                recorder.save(path, **options)
            except bt.MissingExtra:
                continue
            sizes[name] = path.stat().st_size / 1e6
    return sizes
