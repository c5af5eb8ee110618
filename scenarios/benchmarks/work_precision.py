"""Run time against error of the paper's method and of the others, on problems with a reference.

Errors are the largest distance of a particle from where scipy's solution of the same discrete chain has it
(chain_ode), RMS over eight times, relative to a length of the problem. Run time is the room `solve` of the
world's reports, summed; pybullet and the Python side, the same for all, are left out. In a step that was
interrupted, it is the processor time of the whole step at most. Steps are halved until a run takes too long
or its error is as small as the references'. "Time to reach" an error is interpolated between runs, on
logarithmic scales. Where the paper's method does not reach an error, its longest run stands for it: the ratio
is then a lower bound, as it is marked.
"""

import dataclasses
from time import process_time

import numpy as np

import bullet_tendon as bt

from .chain_ode import PLANE
from .problems import PROBLEMS, SAMPLES, oscillator_period

PAPER = "paper"
METHODS = {
    PAPER: bt.SolverOptions.published(),
    "single, banded": bt.SolverOptions(iteration="single"),
    "implicit Euler": bt.SolverOptions(),
    "BDF2": bt.SolverOptions(integrator="bdf2"),
    "explicit Euler": bt.SolverOptions(integrator="explicit_euler"),
}
TARGETS = (1e-2, 1e-3, 1e-4)
CAP, QUICK_CAP = 2.0, 0.02  # s, about the longest run
QUICK_SHARE = 0.03  # of the duration
SHORT, REPEATS = 0.1, 3  # s: shorter runs are repeated, and the quickest counts
FLOOR = 2e-6  # relative error below which no smaller step is tried
LOST = 1e3  # relative error above which a solution has exploded
SHOWN = 3.0  # relative error above which a run is not plotted
FITTED = 4  # finest runs, whose errors the order of convergence is fitted to


def run(quick, progress) -> dict:
    """Runs, times to reach the targets and orders, by problem and method."""
    parts = []
    for problem in progress(PROBLEMS, "problems"):
        part = dataclasses.replace(problem, duration=problem.duration * QUICK_SHARE) if quick else problem
        parts.append(_work(part, QUICK_CAP if quick else CAP))
    return {
        "time": "seconds of the processor in the solver's room, summed over the steps",
        "oscillator_period_s": oscillator_period(),
        "problems": parts,
        "geometric_mean_ratio": {name: _mean_ratio(parts, name) for name in METHODS if name != PAPER},
    }


def table(record) -> list[str]:
    lines = []
    for part in record["problems"]:
        lines.append(
            f"{part['name']}: {part['duration_s']:.3g} s, error relative to {part['scale_m']:.3g} m, "
            f"reference good to {part['reference_error']:.1e}"
        )
        lines += [_method_line(name, part["methods"][name]) for name in METHODS]
    for name, mean in record["geometric_mean_ratio"].items():
        ratio = "-" if mean["ratio"] is None else f"{'>= ' * mean['bounded']}{mean['ratio']:.3g}"
        lines.append(f"{name}: less run time than the paper's method by {ratio}, {mean['reached']} targets")
    return lines


def panels(record) -> list[dict]:
    labels = {"xlabel": "relative error", "ylabel": "processor time of the solver [s]"}
    result = []
    for part in record["problems"]:
        curves = []
        for name, found in part["methods"].items():
            runs = [r for r in found["runs"] if r["error"] is not None and r["error"] < SHOWN]
            x, y = [r["error"] for r in runs], [r["seconds"] for r in runs]
            curves.append({"x": x, "y": y, "label": name})
        result.append({**labels, "title": part["name"], "curves": curves})
    return result


def time_to_reach(runs, target) -> float | None:
    """Seconds at which the error is `target`, between two runs; None where no run reaches it.

    Where the coarsest run that worked reaches it already, the seconds of that run.
    """
    before = None
    for r in (r for r in runs if r["error"] is not None):
        if r["error"] <= target:
            if before is None:
                return r["seconds"]
            errors, seconds = (np.log([before[key], r[key]]) for key in ("error", "seconds"))
            share = (np.log(target) - errors[0]) / (errors[1] - errors[0])
            return float(np.exp(seconds[0] + share * (seconds[1] - seconds[0])))
        before = r
    return None


def order(runs) -> float | None:
    """Order of convergence: slope of log error over log step, over the finest runs."""
    fine = [(r["time_step_s"], r["error"]) for r in runs if r["error"]][-FITTED:]
    if len(fine) < 2:
        return None
    logs = np.log(fine)
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def _method_line(name, found) -> str:
    cells = []
    for target in TARGETS:
        seconds, ratio = found["seconds_to"][f"{target:g}"], found["ratio_to"][f"{target:g}"]
        cells.append(f"{target:g}: " + ("not reached" if seconds is None else f"{1e3 * seconds:.3g} ms"))
        if ratio is not None:
            cells[-1] += f" ({'>= ' * ratio['bounded']}{ratio['value']:.3g} x)"
    slope = "-" if found["order"] is None else f"{found['order']:.2f}"
    return f"  {name:15} order {slope:>5}  " + "  ".join(f"{cell:28}" for cell in cells).rstrip()


def _work(problem, cap) -> dict:
    """All methods on one problem."""
    solution = problem.solution()
    doubt = _error(problem, problem.solution(coarser=10.0), solution)
    methods = {name: {"runs": _refine(problem, METHODS[name], solution, cap)} for name in METHODS}
    for found in methods.values():
        found["order"] = order(found["runs"])
        found["seconds_to"] = {f"{t:g}": time_to_reach(found["runs"], t) for t in TARGETS}
    for found in methods.values():
        found["ratio_to"] = {f"{t:g}": _ratio(methods[PAPER], found, f"{t:g}") for t in TARGETS}
    sizes = {"duration_s": problem.duration, "scale_m": problem.scale, "reference_error": doubt}
    return {"name": problem.name, **sizes, "methods": methods}


def _ratio(paper, found, target) -> dict | None:
    """The paper's time over this method's; bounded: the paper's is more than its longest run's."""
    mine, theirs = found["seconds_to"][target], paper["seconds_to"][target]
    if mine is None:
        return None
    longest = max(r["seconds"] for r in paper["runs"])
    return {"value": (longest if theirs is None else theirs) / mine, "bounded": theirs is None}


def _mean_ratio(parts, name) -> dict:
    """Geometric mean over the problems and targets that the method reaches."""
    every = [part["methods"][name]["ratio_to"][f"{t:g}"] for part in parts for t in TARGETS]
    known = [ratio for ratio in every if ratio]
    mean = float(np.exp(np.mean(np.log([r["value"] for r in known])))) if known else None
    bounded = any(r["bounded"] for r in known)
    return {"ratio": mean, "bounded": bounded, "reached": f"{len(known)} of {len(every)}"}


def _refine(problem, solver, solution, cap) -> list[dict]:
    """Runs with ever smaller steps."""
    runs, steps = [], problem.coarsest
    while True:
        start = process_time()
        runs.append(_run(problem, solver, steps, solution))
        spent = process_time() - start
        for _ in range(REPEATS - 1 if spent < min(SHORT, cap) else 0):
            again = _run(problem, solver, steps, solution)
            runs[-1]["seconds"] = min(runs[-1]["seconds"], again["seconds"])
        error = runs[-1]["error"]
        if spent > cap / 2 or (error is not None and error < FLOOR):
            return runs
        steps *= 2


def _run(problem, solver, steps, solution) -> dict:
    """One run; its error is None where it exploded, or a step could not be solved."""
    time_step, seconds, seen = problem.duration / steps, 0.0, []
    with problem.scene(time_step, solver) as scene:
        tendon = problem.start(scene)
        for done in range(1, steps + 1):
            start = process_time()
            try:
                scene.world.step()
            except bt.StepFailed:
                break
            seconds += min(scene.world.report.seconds["solve"], process_time() - start)
            if done % (steps // SAMPLES) == 0:
                seen.append(tendon.positions[:, PLANE])
                if not np.abs(seen[-1]).max() < LOST * problem.scale:
                    break
    error = _error(problem, np.array(seen), solution) if len(seen) == SAMPLES else None
    lost = error is None or not error < LOST
    return {"time_step_s": time_step, "steps": steps, "seconds": seconds, "error": None if lost else error}


def _error(problem, found, solution) -> float:
    """Largest distance of a particle, RMS over the times, over the problem's length [-]."""
    away = np.linalg.norm(found - solution, axis=2).max(axis=1)
    return float(np.sqrt(np.mean(away**2)) / problem.scale)
