"""Share of a step that the search for tendons that touch takes, where none does.

Scenes: lines far apart; two layers of lines that cross 20 mm apart ("net"); three helices inside each other;
a bundle of nine; a coil. Quiet: both ends of all held, no gravity, so that a step takes no iteration; moving:
all at 1 m/s; sagging: both ends held, under gravity. The search's time is the core's own
(report.search_seconds), the step's is that of apply(). Medians over the steps until something touches.
"""

from itertools import takewhile
from statistics import median
from time import perf_counter

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

LENGTH, RADIUS = 0.3, 0.002  # m
MATERIAL = bt.Material(stiffness=1e4, damping=1.0, friction=0.3)
SIZES, QUICK_SIZES = (60, 600, 2000), (60,)
STEPS, QUICK_STEPS, WARM_UP = 80, 10, 3
SPEED = np.array([0.6, 0.6, 0.53])  # m/s


def _line(start, end, count):
    return np.linspace(start, end, count)


def _helix(count, phase, radius, turns, height):
    angle = 2 * np.pi * turns * np.linspace(0, 1, count) + phase
    return np.c_[radius * np.cos(angle), radius * np.sin(angle), np.linspace(0, height, count)]


def _net(count):
    places = LENGTH * (np.arange(4) + 0.5) / 4
    below = [_line((0, y, 0), (LENGTH, y, 0), count) for y in places]
    return below + [_line((x, 0, 0.02), (x, LENGTH, 0.02), count) for x in places]


def _bundle(count):
    apart = 3 * RADIUS
    places = [(apart * i, apart * j) for i in range(3) for j in range(3)]
    return [_line((0, y, z), (LENGTH, y + 0.003, z + 0.003), count) for y, z in places]


SCENES = {  # particles -> centrelines
    "far apart": lambda count: [_line((0, k, 0), (LENGTH, k, 0), count) for k in range(6)],
    "net": _net,
    "helices": lambda count: [_helix(count, phase, 0.02, 5, LENGTH) for phase in (0.0, 2.1, 4.2)],
    "bundle": _bundle,
    "coil": lambda count: [_helix(count, 0.0, 0.03, 12, 0.15)],
}
MOTIONS = ("quiet", "moving", "sagging")


def run(quick, progress) -> dict:
    """Times of every scene, motion and size [us]."""
    sizes, steps = (QUICK_SIZES, QUICK_STEPS) if quick else (SIZES, STEPS)
    cells = [(s, m, n) for s in SCENES for m in MOTIONS for n in sizes]
    return {"rows": [_measure(*cell, steps) for cell in progress(cells, "scenes")]}


def table(record) -> list[str]:
    lines = [f"{'':10} {'':8} {'n':>5} {'step us':>9} {'search us':>9} {'share':>7} {'searched anew':>14}"]
    for row in record["rows"]:
        times = f"{row['step_us']:9.1f} {row['search_us']:9.2f} {100 * row['share']:5.1f} %"
        lines.append(
            f"{row['scene']:10} {row['motion']:8} {row['particles']:5} {times} {row['searches']:14.2f}"
        )
    return lines


def panels(record) -> list[dict]:
    curves = []
    for scene in SCENES:
        rows = [r for r in record["rows"] if r["scene"] == scene and r["motion"] == "moving"]
        curve = {"x": [r["particles"] for r in rows], "y": [r["share"] for r in rows]}
        curves.append({**curve, "label": scene})
    labels = {
        "xlabel": "particles",
        "ylabel": "search / step",
        "title": "Tendons that do not touch, at 1 m/s",
    }
    return [{**labels, "curves": curves}]


def _measure(name, motion, count, steps) -> dict:
    gravity = -9.81 if motion == "sagging" else 0.0
    with Scene(gravity=gravity, solver=bt.SolverOptions(sleep=False)) as scene:
        for points in SCENES[name](count):
            tendon = scene.world.add_tendon(points, RADIUS, MATERIAL, count)
            if motion == "moving":
                tendon.set_positions(tendon.positions, np.tile(SPEED, (count, 1)))
            else:
                tendon.grip(0), tendon.grip(-1)
        rows = list(takewhile(lambda row: not row[0], (_step(scene) for _ in range(WARM_UP + steps))))
    _, step, search, searches = zip(*rows[WARM_UP:], strict=True)
    return {
        "scene": name,
        "motion": motion,
        "particles": count,
        "step_us": 1e6 * median(step),
        "search_us": 1e6 * median(search),
        "share": median(search) / median(step),
        "searches": float(np.mean(searches)),
    }


def _step(scene) -> tuple[bool, float, float, int]:
    """Whether something touches; seconds of the step and of the search; pairs searched anew."""
    start = perf_counter()
    scene.world.apply()
    seconds = perf_counter() - start
    p.stepSimulation(scene.client)
    report = scene.world.report
    return report.counts["contacts"] > 0, seconds, report.search_seconds, report.counts["tendon_searches"]
