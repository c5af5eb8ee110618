"""Time of a step with and without a Recorder, and the sizes of what it writes.

The scene is that of the scenario `graft_passage`: two bones with tunnels, a graft of 60 particles. A hand
draws it into both tunnels and back, in PERIOD seconds. The scene is run for each variant: without a recorder,
with one that is asked for nothing ("idle", every=None), with 30 frames a simulated second (every EVERY
steps), and with a frame each step. All variants take the same steps, by turns, ROUND at a time, and all of it
is repeated REPEATS times. What counts of a round is the least processor time that its steps took, because
another program can only add to it. Sizes are those of SECONDS simulated seconds at 30 frames a second.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
from bullet_tendon.scenarios import graft_passage
from bullet_tendon.scenarios.scene import Options

import bullet_tendon as bt

EVERY = 8  # steps of 1/240 s: 30 frames a second
VARIANTS = {"off": {}, "idle": {}, "30 a second": {"every": EVERY}, "each step": {"every": 1}}
ROUND, REPEATS = 48, 5  # steps in a round; runs
PERIOD, SECONDS, QUICK_SECONDS = 5.0, 20.0, 0.6


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
    return {"seconds": seconds, "repeats": repeats, "rows": rows, **record}


def _recorder(scene, wanted) -> bt.Recorder:
    return bt.Recorder(scene.world, camera=scene.camera, title="A graft in a knee", **wanted)


def table(record) -> list[str]:
    lines = [f"{'recorder':14}{'step us':>10}{'more by':>10}"]
    for row in record["rows"]:
        lines.append(f"{row['variant']:14}{row['step_us']:10.1f}{100 * row['share']:9.2f}%")
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
