"""Time of a camera's frame, and memory over many frames, of a knee with a graft, a finger, and round weights.

The scenes are those of the scenarios `graft_passage` (two bones with tunnels, a graft of 60 particles),
`tendon_finger` (four links, two tendons) and `atwood` (a drum and four spheres), each after some steps. A
frame is Camera.render(): colours, depth and segmentation. "Bodies" is the same of the user's client without
its tendons. "Tendons" is the rest: moving the tendons' pieces, rendering them, and taking the nearer. Times
are processor times of the process, the least of FRAMES frames, in each of which the tendons are elsewhere.
Memory is the resident memory of the process, before and after MANY further frames, in which a tendon also
stretches and shrinks.
"""

from pathlib import Path
from time import process_time

import numpy as np
from bullet_tendon.scenarios import atwood, graft_passage, tendon_finger
from bullet_tendon.scenarios.scene import Options

from bullet_tendon import view

SIZES = (64, 128, 256)  # pixels along each side
STEPS, FRAMES, QUICK_FRAMES = 20, 200, 10
MANY, QUICK_MANY = 10_000, 50
SCENES = {"knee": graft_passage, "finger": tendon_finger, "weights": atwood}
STRETCH = 0.3  # share by which the tendon's length changes at random


def run(quick, progress) -> dict:
    """Rows by scene and size: milliseconds; memory by scene [kB]."""
    frames, many = (QUICK_FRAMES, QUICK_MANY) if quick else (FRAMES, MANY)
    rows, memory = [], []
    for name, module in SCENES.items():
        with module.build(Options()) as scene:
            scene.world.step(STEPS)
            for size in progress(SIZES, name):
                rows.append({"scene": name, "size": size, **_times(scene, size, frames)})
            memory.append({"scene": name, "frames": many, **_memory(scene, many, progress)})
    return {"frames": frames, "rows": rows, "memory": memory}


def table(record) -> list[str]:
    lines = [f"{'':10}{'pixels':>10}{'frame ms':>12}{'bodies':>10}{'tendons':>10}"]
    for row in record["rows"]:
        parts = row["bodies_ms"], row["frame_ms"] - row["bodies_ms"]
        size = f"{row['size']} x {row['size']}"
        lines.append(f"{row['scene']:10}{size:>10}{row['frame_ms']:12.2f}{parts[0]:10.2f}{parts[1]:10.2f}")
    for row in record["memory"]:
        told = f"{row['before_kb']} kB before, {row['after_kb']} kB after"
        lines.append(f"{row['scene']:10}memory over {row['frames']} frames: {told}")
    return lines


def panels(record) -> list[dict]:
    curves = []
    for name in SCENES:
        rows = [row for row in record["rows"] if row["scene"] == name]
        sizes = [row["size"] for row in rows]
        curves.append({"x": sizes, "y": [row["frame_ms"] for row in rows], "label": f"{name}, frame"})
        curves.append({"x": sizes, "y": [row["bodies_ms"] for row in rows], "label": f"{name}, bodies alone"})
    axes = {"xlabel": "pixels along each side", "ylabel": "processor time [ms]"}
    return [{**axes, "title": "A frame of a camera", "curves": curves}]


def _times(scene, size, frames) -> dict:
    """The least times of a frame and of its part in the user's client [ms]."""
    lens = scene.camera
    frame, bodies = [], []
    with (
        view.Camera(scene.world, size, size, **lens) as camera,
        view.Camera(scene.client, size, size, **lens) as bare,
    ):
        for _ in range(frames):
            scene.world.step()
            frame.append(_seconds(camera.render))
            bodies.append(_seconds(bare.render))
    return {"frame_ms": 1e3 * min(frame), "bodies_ms": 1e3 * min(bodies)}


def _seconds(call) -> float:
    start = process_time()
    call()
    return process_time() - start


def _memory(scene, frames, progress) -> dict:
    """Resident memory after the first tenth of the frames, and after all of them [kB]."""
    tendon, random = scene.tendons[0], np.random.default_rng(0)
    start = tendon.positions
    away = 3 * tendon.length * np.array([0.0, 0.0, 1.0])  # clear of bones and bores
    with view.Camera(scene.world, 64, 64, full_tension=10.0, **scene.camera) as camera:
        for k in progress(range(frames), "memory"):
            if k == frames // 10:
                before = _resident()
            tendon.set_positions(start * (1 + STRETCH * random.uniform(-1, 1)) + away)
            camera.render()
        return {"before_kb": before, "after_kb": _resident()}


def _resident() -> int:
    return 4 * int(Path("/proc/self/statm").read_text().split()[1])
