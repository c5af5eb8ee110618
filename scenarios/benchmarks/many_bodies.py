"""Time of a step of many bodies that tendons join, by their number.

Ladder: bars of 0.5 kg below each other, each on two ropes of 4 particles. Net: balls of 20 g in a square
grid, each tied to its neighbours by ropes of 4 particles; its corners are held. Bridge: planks of 5 kg on
hangers from two ropes over all of them, each on a node of 50 g. All hang at 1/240 s, and all bodies of a
scene are solved for together. Time is that of the process, apply() alone: the median of the last STEPS.
"""

import time

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

ROPE = bt.Material(stiffness=2e4, damping=50.0, friction=0.0)
RADIUS, GAP = 0.002, 0.3  # m
SIZES, QUICK_SIZES = (4, 8, 16, 36, 64, 100), (4, 9)  # bodies
BEFORE, STEPS, QUICK = 10, 40, 4  # steps; the quick run has fewer by that factor


def run(quick, progress) -> dict:
    """Median times of a step [us], and numbers of bodies and of iterations, by scene and size."""
    scenes = {"ladder": ladder, "net": net, "bridge": bridge}
    steps = STEPS // QUICK if quick else STEPS
    cases = [(name, size) for name in scenes for size in (QUICK_SIZES if quick else SIZES)]
    return {
        "scenes": [
            {"scene": name, **_measure(scenes[name], size, steps)} for name, size in progress(cases, "scenes")
        ]
    }


def table(record) -> list[str]:
    lines = ["many bodies: time of a step"]
    for row in record["scenes"]:
        lines.append(
            f"  {row['scene']:8} {row['bodies']:4} bodies, {row['tendons']:4} tendons: "
            f"{row['us_a_step']:9.0f} us, {row['iterations']:.1f} iterations"
        )
    return lines


def panels(record) -> list[dict]:
    curves = []
    for name in dict.fromkeys(row["scene"] for row in record["scenes"]):
        rows = [row for row in record["scenes"] if row["scene"] == name]
        times = [row["us_a_step"] for row in rows]
        curves.append({"x": [row["bodies"] for row in rows], "y": times, "label": name})
    labels = {"xlabel": "bodies", "ylabel": "time of a step [us]"}
    return [{**labels, "title": "bodies joined by tendons", "curves": curves}]


def ladder(scene, count):
    """That many bars."""
    bars = [_box(scene, 0.5, (0.2, 0.01, 0.01), (0, 0, -GAP * (k + 1))) for k in range(count)]
    for k, bar in enumerate(bars):
        for x in (-0.2, 0.2):
            above = bars[k - 1] if k > 0 else None
            _rope(scene, [x, 0, -GAP * k], [x, 0, -GAP * (k + 1)], above, bar)
    return bars


def net(scene, count):
    """A square grid with about that many balls."""
    side = max(2, round(np.sqrt(count)))
    places = {(i, j): (GAP * i, GAP * j, 0.0) for i in range(side) for j in range(side)}
    balls = {place: _ball(scene, 0.02, at) for place, at in places.items()}
    for (i, j), at in places.items():
        for other in ((i + 1, j), (i, j + 1)):
            if other in places:
                _rope(scene, at, places[other], balls[i, j], balls[other])
        if i in (0, side - 1) and j in (0, side - 1):
            out = np.sign([i - 0.5, j - 0.5])
            _rope(scene, np.add(at, [*(GAP * out), 0.1]), at, None, balls[i, j])
    return list(balls.values())


def bridge(scene, count):
    """About a third as many planks, and a node of either rope over each."""
    planks = max(1, count // 3)
    middle, bodies = 0.5 * (planks - 1), []
    boards = [_box(scene, 5.0, (0.12, 0.5, 0.02), (GAP * (k - middle), 0, 0)) for k in range(planks)]
    for y in (-0.5, 0.5):
        along = GAP * (np.arange(planks + 2) - middle - 1)
        line = np.c_[along, np.full(planks + 2, y), 0.1 + (along / along[-1]) ** 2]
        rope = scene.world.add_tendon(line, RADIUS, ROPE, 2 * planks + 3)
        rope.grip(0)
        rope.grip(-1)
        for board, at in zip(boards, line[1:-1], strict=True):
            particle = int(np.argmin(np.abs(rope.positions[:, 0] - at[0])))
            at = rope.positions[particle]
            node = _ball(scene, 0.05, at)
            rope.attach(particle, node)
            _rope(scene, at, [at[0], y, 0.02], node, board)
            bodies.append(node)
    return boards + bodies


def _box(scene, mass, half, at) -> int:
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=scene.client)
    return p.createMultiBody(mass, shape, -1, at, physicsClientId=scene.client)


def _ball(scene, mass, at) -> int:
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=scene.client)
    return p.createMultiBody(mass, shape, -1, at, physicsClientId=scene.client)


def _rope(scene, start, end, first, last):
    rope = scene.world.add_tendon([start, end], RADIUS, ROPE, 4)
    if first is None:
        rope.grip(0)
    else:
        rope.attach(0, first)
    rope.attach(-1, last)


def _measure(build, size, steps) -> dict:
    with Scene(solver=bt.SolverOptions(sleep=False)) as scene:
        bodies = build(scene, size)
        seconds, iterations = [], []
        for _ in range(BEFORE + steps):
            start = time.process_time()
            scene.world.apply()
            seconds.append(time.process_time() - start)
            p.stepSimulation(scene.client)
            iterations.append(scene.world.report.iterations)
        return {
            "bodies": len(bodies),
            "tendons": len(scene.world.tendons),
            "us_a_step": 1e6 * float(np.median(seconds[BEFORE:])),
            "iterations": float(np.mean(iterations[BEFORE:])),
        }
