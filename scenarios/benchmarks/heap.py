"""Time of a step of heaps of tendons, by the pairs of segments that touch.

Tendons of 100 particles (0.2 m, radius 2 mm) are dropped onto a plane and each other, in directions by
chance. Falling: the first FALL steps at 1/240 s; at rest: the last ones of REST. A touching pair is a
contact of two tendons, or of a tendon with the plane, that carries a force. Time is that of the process,
apply() alone; counts and times are means over a phase. "Apart" is the same tendons far above the plane, side
by side: nothing touches, and they are stepped alone.
"""

import time

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

RADIUS, LENGTH, PARTICLES = 0.002, 0.2, 100  # m, m, -
MATERIAL = bt.Material(stiffness=1e3, damping=1.0, friction=0.3)
COUNTS, QUICK_COUNTS = (1, 2, 5, 10, 20), (1, 2, 3)  # tendons
SEEDS, QUICK_SEEDS = (0, 1), (0,)
FALL, REST, LAST = 80, 400, 40  # steps; those of the rest that are measured
QUICK = 4  # times shorter


def drop(world, count, particles, seed=0):
    """Adds tendons above each other, at heights of three radii and in directions by chance."""
    random = np.random.default_rng(seed)
    for k in range(count):
        angle, (x, y) = random.uniform(0, np.pi), 0.02 * random.standard_normal(2)
        centre = np.array([x, y, 2 * RADIUS + 3 * RADIUS * k])
        half = np.array([np.cos(angle), np.sin(angle), 0]) * LENGTH / 2
        world.add_tendon([centre - half, centre + half], RADIUS, MATERIAL, particles)


def run(quick, progress) -> dict:
    """Phases of every heap, and of tendons that are apart."""
    counts, seeds = (QUICK_COUNTS, QUICK_SEEDS) if quick else (COUNTS, SEEDS)
    shorter = QUICK if quick else 1
    heaps = [
        {"tendons": count, "seed": seed, **_heap(count, seed, shorter)}
        for count, seed in progress([(c, s) for c in counts for s in seeds], "heaps")
    ]
    apart = [{"tendons": count, **_apart(count, shorter)} for count in counts]
    return {"particles": PARTICLES, "heaps": heaps, "apart": apart}


def table(record) -> list[str]:
    lines = [f"heaps of tendons of {record['particles']} particles: us a step and touching pair"]
    for heap in record["heaps"]:
        parts = [
            f"{name} {heap[name]['us_a_pair']:7.2f} ({heap[name]['touching']:6.0f} touch, "
            f"{heap[name]['iterations']:6.1f} iterations)"
            for name in ("falling", "rest")
        ]
        lines.append(
            f"  {heap['tendons']:3} tendons, seed {heap['seed']}: {'; '.join(parts)}; "
            f"{heap['unconverged']} steps not converged"
        )
    for apart in record["apart"]:
        us = apart["us_a_step"]
        lines.append(
            f"  {apart['tendons']:3} apart: {us:8.1f} us a step, {us / apart['tendons']:6.1f} a tendon"
        )
    return lines


def panels(record) -> list[dict]:
    curves = []
    for name in ("falling", "rest"):
        for seed in sorted({heap["seed"] for heap in record["heaps"]}):
            heaps = [heap[name] for heap in record["heaps"] if heap["seed"] == seed]
            curve = {"x": [h["touching"] for h in heaps], "y": [h["us_a_step"] for h in heaps]}
            curves.append({**curve, "label": f"{name}, seed {seed}"})
    labels = {"xlabel": "touching pairs", "ylabel": "time of a step [us]"}
    return [{**labels, "title": "heaps of tendons", "curves": curves}]


def _heap(count, seed, shorter) -> dict:
    with Scene(solver=bt.SolverOptions(sleep=False)) as scene:
        plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=scene.client)
        scene.world.add_obstacle(p.createMultiBody(0, plane, physicsClientId=scene.client))
        drop(scene.world, count, PARTICLES, seed)
        steps = [_step(scene) for _ in range(REST // shorter)]
    falling, rest = steps[: FALL // shorter], steps[-LAST // shorter :]
    unconverged = sum(not step[3] for step in steps)
    return {"falling": _mean(falling), "rest": _mean(rest), "unconverged": unconverged}


def _apart(count, shorter) -> dict:
    with Scene(solver=bt.SolverOptions(sleep=False)) as scene:
        for k in range(count):
            scene.world.add_tendon([(0, k, 10), (LENGTH, k, 10)], RADIUS, MATERIAL, PARTICLES)
        return {"us_a_step": _mean([_step(scene) for _ in range(FALL // shorter)])["us_a_step"]}


def _step(scene) -> tuple[float, int, int, bool]:
    """Seconds, touching pairs, iterations, and whether it converged."""
    start = time.process_time()
    scene.world.apply()
    seconds = time.process_time() - start
    p.stepSimulation(scene.client)
    report = scene.world.report
    touching = int(np.sum(scene.world.contacts["normal_force"] > 0))
    return seconds, touching, report.iterations, report.converged


def _mean(steps) -> dict:
    seconds, touching, iterations = (sum(step[i] for step in steps) for i in range(3))
    return {
        "us_a_step": 1e6 * seconds / len(steps),
        "touching": touching / len(steps),
        "iterations": iterations / len(steps),
        "us_a_pair": 1e6 * seconds / max(touching, 1),
    }
