"""Time of a step at 1 kHz while a jerky hand draws a graft through two bone tunnels.

The scene is that of the scenario `graft_passage`. The hand follows a record (hand_record): minimum-jerk
pulls and pull-backs, pauses, tremor, slips, and the steps of an encoder. A soft hand is a virtual coupling
(COUPLING); a rigid hand puts the particle where the record is. One step is what a haptic loop does each
millisecond: set the hand's target, TendonWorld.step() (read the bodies, solve, push the bodies, step
pybullet), read the force on the hand and the wrenches on both bones. Its time is the processor's, so that
what else the machine does is left out. A time_budget is wall time: what else the machine does uses it up too.

Each variant of hand, time_budget and record is run REPEATS times. "As measured" is over all steps of all
runs. "Least" takes, for each step, the shortest of the runs: the same work with the least interrupts. It is
left out with a time_budget, because a budget that is used up changes the path.
"Force error" is the RMS difference of the hand's force from the run without a budget, over the RMS force.
"""

import dataclasses
from time import process_time

import numpy as np
import pybullet as p
from bullet_tendon.scenarios import graft_passage
from bullet_tendon.scenarios.scene import Options

from .hand_record import RATE, hand_record

COUPLING = {"stiffness": 2000.0, "damping": 5.0}  # of a soft hand [N/m], [N s/m]
HANDS = {"soft": COUPLING, "rigid": {}}
BUDGETS, QUICK_BUDGETS = (None, 5e-4, 2e-4), (None, 5e-4)  # time_budget [s]
SEEDS, QUICK_SEEDS = (0, 1, 2), (0,)
REPEATS, QUICK_REPEATS, QUICK_STEPS = 3, 2, 60
LIMITS = (5e-4, 1e-3)  # s
WARM_UP = 10  # steps at the start that are not counted: the first looks whether tendons begin inside bones
PERCENTILES = (50, 99, 99.9, 100)
REST_SHARES = tuple(10.0 ** (-k / 10) for k in range(1, 41))  # of the steps, for the plot


def run(quick, progress) -> dict:
    """Rows by hand and budget: percentiles of a step [s], steps over LIMITS, and what the budget cost."""
    seeds, budgets = (QUICK_SEEDS, QUICK_BUDGETS) if quick else (SEEDS, BUDGETS)
    repeats = QUICK_REPEATS if quick else REPEATS
    places = [(hand, seed) for hand in HANDS for seed in seeds]
    runs = {}
    for hand, seed in progress(places, "records"):
        for budget in budgets:
            runs[hand, budget, seed] = [_passage(hand, budget, seed, quick) for _ in range(repeats)]
    rows = []
    for hand in HANDS:
        free = [runs[hand, None, seed][0]["forces"] for seed in seeds]
        for budget in budgets:
            found = [runs[hand, budget, seed] for seed in seeds]
            rows.append({"hand": hand, "time_budget_s": budget, **_row(found, free, budget is None)})
    return {"rate_hz": RATE, "records": len(seeds), "repeats": repeats, "limits_s": LIMITS, "rows": rows}


def table(record) -> list[str]:
    heads = "".join(f"{name:>9}" for name in ("p50", "p99", "p99.9", "most"))
    limits = "".join(f"{f'> {1e3 * limit:g} ms':>10}" for limit in record["limits_s"])
    lines = [
        f"{'hand':6} {'budget ms':>9} {'steps':>7}{heads}{limits}{'cut off':>9}{'unsolved':>9}{'error':>9}"
    ]
    for row in record["rows"]:
        budget = "none" if row["time_budget_s"] is None else f"{1e3 * row['time_budget_s']:g}"
        lines.append(f"{row['hand']:6} {budget:>9} {row['steps']:7}" + _times(row["as_measured"]))
        lines[-1] += f"{row['over_budget']:9}{row['unconverged']:9}{row['force_error']:9.1e}"
        if row["least"]:
            lines.append(f"{'':16} {'least':>7}" + _times(row["least"]))
    lines.append("times in ms, and steps over a limit; least: for each step, the shortest of all runs")
    lines.append("cut off: steps whose budget was used up; error: RMS of the hand's force, relative")
    return lines


def panels(record) -> list[dict]:
    curves = []
    for row in record["rows"]:
        budget = "no budget" if row["time_budget_s"] is None else f"budget {1e3 * row['time_budget_s']:g} ms"
        curve = {"label": f"{row['hand']} hand, {budget}"}
        curves.append({"x": row["as_measured"]["rest_ms"], "y": REST_SHARES, **curve})
    labels = {"xlabel": "processor time of a step [ms]", "ylabel": "share of steps that take longer"}
    return [{**labels, "title": "A graft led by a jerky hand at 1 kHz", "curves": curves}]


def _times(part) -> str:
    times = "".join(f"{time:9.3f}" for time in part["percentiles_ms"])
    return times + "".join(f"{count:10}" for count in part["over_limits"])


def _row(found, free, repeatable) -> dict:
    """Of one hand and budget. found: lists of runs by record; free: hand's forces without a budget."""
    runs = [run for record in found for run in record]
    count = {key: sum(run[key] for run in runs) for key in ("over_budget", "unconverged")}
    seconds = np.concatenate([run["seconds"] for run in runs])
    least = np.concatenate([np.min([run["seconds"] for run in record], axis=0) for record in found])
    away = [run["forces"] - exact for record, exact in zip(found, free, strict=True) for run in record]
    error = (
        np.linalg.norm(np.concatenate(away)) / np.sqrt(len(found[0])) / np.linalg.norm(np.concatenate(free))
    )
    return {
        "steps": len(seconds),
        **count,
        "force_error": float(error),
        "as_measured": _spread(seconds),
        "least": _spread(least) if repeatable else None,
    }


def _spread(seconds) -> dict:
    return {
        "percentiles_ms": (1e3 * np.percentile(seconds, PERCENTILES)).tolist(),
        "over_limits": [int((seconds > limit).sum()) for limit in LIMITS],
        "rest_ms": (1e3 * np.quantile(seconds, [1 - share for share in REST_SHARES])).tolist(),
    }


def _passage(hand, budget, seed, quick) -> dict:
    """One run: seconds (n,) and the hand's forces (n, 3) [N] by step, steps cut off and not converged."""
    with graft_passage.build(Options()) as scene:
        p.setTimeStep(1 / RATE, scene.client)
        scene.world.options = dataclasses.replace(scene.world.options, time_budget=budget)
        h = scene.handles
        h.hand.release()
        grip = h.graft.grip(0, **HANDS[hand])
        along, off = hand_record(h.arc[-1], seed)
        targets = off + np.column_stack([np.interp(along, h.arc, h.way[:, c]) for c in range(3)])
        rows = []
        for k, target in enumerate(targets[: WARM_UP + QUICK_STEPS] if quick else targets):
            h.graft.set_force(-1, graft_passage.held_back(h, k / RATE))
            rows.append(_step(scene, grip, target))
    seconds, forces, over_budget, converged = (list(column) for column in zip(*rows[WARM_UP:], strict=True))
    unconverged = len(converged) - sum(converged)
    counts = {"over_budget": sum(over_budget), "unconverged": unconverged}
    return {"seconds": np.array(seconds), "forces": np.array(forces), **counts}


def _step(scene, grip, target) -> tuple:
    """Seconds of what a haptic loop does in a step, the hand's force, over_budget, converged."""
    world = scene.world
    start = process_time()
    grip.target = target
    world.step()
    force = grip.force
    for tunnel in scene.handles.tunnels:
        world.wrench(tunnel.bodyUniqueId, tunnel.linkIndex)
    return process_time() - start, force, world.report.over_budget, world.report.converged
