"""Error and stability of a tendon on a body over stiffness, mass and time step, beside an explicit force.

The tendon is stepped by implicit Euler and by BDF2. The explicit force is what pybullet's users write by
hand: k times the elongation, from where the body is before the step (coupled_springs). All methods get the
same bodies, without pybullet's damping, and the same steps (coupled_bodies). In each cell of the table:

gain     the most energy that a moving body gains, over what was put in: hanging, free, pulled with 2 kN.
         Stable: finite, and never more than GAIN in any of the three.
period   of the undamped hanging weight, against 2 pi sqrt(m L/K); path: its RMS distance from the exact path
         over the first period, relative to its drop. Where steps resolve it, omega dt <= RESOLVED.
rest     tension of the hanging weight once it has come to rest, by a damping ratio of 0.3, against m g.
motor    tension on the tip of a lever that a motor holds, against the load, the worst of the last steps.
table    the same of a box on a table; pybullet's contact gives way by about 0.01 mm, which is in the error.

The explicit force is known to be stable for dt < 2 sqrt(m L/K): the line in the plots.
"""

import itertools
import math
from statistics import median

import numpy as np

from .coupled_bodies import DAMPING_RATIO, GRAVITY, HELD, LENGTH, MOVING, Cell, hold, move, rest
from .coupled_springs import METHODS

STIFFNESSES = tuple(10.0**k for k in range(2, 9))  # N
MASSES = tuple(10.0**k for k in range(-4, 5))  # kg
TIME_STEPS = (1 / 1000, 1 / 240, 1 / 60)  # s
QUICK = {"stiffnesses": (1e2, 1e6), "masses": (1e-2, 1e2), "time_steps": (1 / 240,)}
DURATION, MOST_STEPS, QUICK_STEPS = 10.0, 1200, 60  # s, -, -: of a moving body
REST_STEPS, HELD_STEPS, LAST_STEPS = 1000, 120, 30
GAIN, STRICT = 1.0, 0.01  # of the energy put in: what still counts as stable, and as none
RESOLVED = 1.0  # omega dt
SETTLED = 16.0  # damping times after which it is at rest
ERRORS = ("period", "path", "rest", *HELD)
SHOWN = ("period", "rest", "motor")  # the largest of these is a cell's error
FINEST = 1e-15  # smaller errors are rounding


def run(quick, progress) -> dict:
    """All cells, and what they come to."""
    grid = QUICK if quick else {"stiffnesses": STIFFNESSES, "masses": MASSES, "time_steps": TIME_STEPS}
    axes = itertools.product(grid["time_steps"], grid["stiffnesses"], grid["masses"])
    places = [Cell(k, m, dt) for dt, k, m in axes]
    cells = [_measure(cell, quick) for cell in progress(places, "cells")]
    return {"length_m": LENGTH, **grid, "cells": cells, "summary": summary(cells)}


def table(record) -> list[str]:
    lines = []
    for dt, name in itertools.product(record["time_steps"], METHODS):
        lines.append(f"{name}, dt 1/{1 / dt:.0f} s: largest error of {', '.join(SHOWN)}; x: gains energy")
        lines.append("  K [N] over m [kg] " + "".join(f"{m:>9.0e}" for m in record["masses"]))
        for k, row in zip(record["stiffnesses"], _grid(record, dt, name), strict=True):
            lines.append(f"{k:>18.0e} " + "".join(f"{_word(found):>9}" for found in row))
    return lines + _summary_lines(record["summary"])


def panels(record) -> list[dict]:
    labels = {"xlabel": "body mass [kg]", "ylabel": "stiffness [N]"}
    result = []
    for dt, name in itertools.product(record["time_steps"], record["summary"]["methods"]):
        found = _grid(record, dt, name)
        cells = {
            "x": record["masses"],
            "y": record["stiffnesses"],
            "values": [[worst_error(method) for method in row] for row in found],
            "marked": [[not method["stable"] for method in row] for row in found],
            "label": f"largest error of {', '.join(SHOWN)}",
            "mark": "gains energy",
            "limits": (1e-10, 1.0),
        }
        limit = {"x": record["masses"], "label": "dt = 2 sqrt(m L / K)"}
        limit["y"] = [4 * m * record["length_m"] / dt**2 for m in record["masses"]]
        title = f"{name}, dt = 1/{1 / dt:.0f} s"
        result.append({**labels, "title": title, "cells": cells, "curves": [limit]})
    return result


def summary(cells) -> dict:
    """Shares of stable cells by method, and the errors where all methods are stable."""
    stable = [c["methods"] for c in cells if all(m["stable"] for m in c["methods"].values())]
    return {
        "cells": len(cells),
        "methods": {name: _shares([c["methods"][name] for c in cells]) for name in METHODS},
        "all_stable": {"cells": len(stable), **{key: _compare(stable, key) for key in ERRORS}},
    }


def worst_error(found) -> float | None:
    """The largest of the errors that are SHOWN; None where the cell is not stable."""
    known = [found["errors"][key] for key in SHOWN if found["errors"][key] is not None]
    return max(known) if found["stable"] and known else None


def oscillation(depths) -> float | None:
    """Angle [rad] by which samples (n,) of an oscillation about 0, damped or not, turn from one to the next.

    Least squares for y'' = -a y - b y' in differences (Prony 1795), the rotation of whose roots it is.
    """
    before, now, after = depths[:-2], depths[1:-1], depths[2:]
    columns = np.column_stack([now, now - before])
    scale = np.linalg.norm(columns, axis=0)
    a, b = -np.linalg.lstsq(columns / scale, after - 2 * now + before, rcond=None)[0] / scale
    turn2 = a - (0.5 * (a + b)) ** 2
    return math.atan2(math.sqrt(turn2), 1 - 0.5 * (a + b)) if turn2 > 0 else None


def _measure(cell, quick) -> dict:
    place = {"stiffness_N": cell.stiffness, "mass_kg": cell.mass, "time_step_s": cell.time_step}
    methods = {name: _try(method, cell, quick) for name, method in METHODS.items()}
    return {**place, "omega_dt": cell.omega * cell.time_step, "methods": methods}


def _try(method, cell, quick) -> dict:
    """One method in one cell."""
    steps = QUICK_STEPS if quick else min(MOST_STEPS, round(DURATION / cell.time_step))
    moved = {case: move(method, case, cell, steps) for case in MOVING}
    gains = {case: found["gain"] for case, found in moved.items()}
    period, path = motion_errors(cell, **{key: moved["hanging"][key] for key in ("depths", "mass")})
    settled = DAMPING_RATIO * cell.omega * cell.time_step * REST_STEPS >= SETTLED
    errors = {"period": period, "path": path, "rest": rest(method, cell, REST_STEPS) if settled else None}
    errors |= {case: hold(method, case, cell, HELD_STEPS, LAST_STEPS) for case in HELD}
    return {
        "stable": _within(gains, GAIN),
        "strict": _within(gains, STRICT),
        "gain": gains,
        "errors": errors,
        "step_us": moved["hanging"]["step_us"],
    }


def motion_errors(cell, depths, mass) -> tuple[float | None, float | None]:
    """Errors of period and path of an undamped weight; None where steps do not resolve it."""
    drop = cell.drop(cell.mass * GRAVITY)
    turn = cell.time_step * math.sqrt(cell.stiffness / LENGTH / mass)  # exact, within a step
    few = min(len(depths), math.ceil(2 * math.pi / turn))
    if turn > RESOLVED or few < 4:
        return None, None
    exact = drop * (1 - np.cos(turn * np.arange(1, few + 1)))
    path = np.sqrt(np.mean((depths[:few] - exact) ** 2)) / exact.max()
    found = oscillation(depths[:few] - drop)
    return (abs(turn / found - 1) if found else None), float(path)


def _within(gains, most) -> bool:
    return all(gain is not None and gain <= most for gain in gains.values())


def _shares(found) -> dict:
    """Of one method, over its cells."""
    counted = {key: [m["errors"][key] for m in found if m["errors"][key] is not None] for key in ERRORS}
    return {
        "stable_share": sum(m["stable"] for m in found) / len(found),
        "no_gain_share": sum(m["strict"] for m in found) / len(found),
        "largest_gain": {case: _largest([m["gain"][case] for m in found]) for case in MOVING},
        "within_1_percent": {k: [sum(e <= 0.01 for e in v), len(v)] for k, v in counted.items()},
        "step_us": median(m["step_us"] for m in found),
    }


def _largest(gains) -> float | None:
    return None if None in gains else max(gains)


def _compare(stable, key) -> dict | None:
    """Geometric means of an error where all methods have it."""
    rows = [[m[name]["errors"][key] for name in METHODS] for m in stable]
    logs = np.log([np.maximum(row, FINEST) for row in rows if None not in row])
    if len(logs) == 0:
        return None
    means = np.exp(logs.mean(axis=0)).tolist()
    return {"cells": len(logs), "errors": dict(zip(METHODS, means, strict=True))}


def _grid(record, dt, name) -> list[list[dict]]:
    """What a method did, rows by stiffness, columns by mass."""
    of = {
        (c["stiffness_N"], c["mass_kg"]): c["methods"][name]
        for c in record["cells"]
        if c["time_step_s"] == dt
    }
    return [[of[k, m] for m in record["masses"]] for k in record["stiffnesses"]]


def _word(found) -> str:
    error = worst_error(found)
    return "x" if not found["stable"] else "-" if error is None else f"{error:.0e}"


def _summary_lines(record) -> list[str]:
    lines = []
    for name, part in record["methods"].items():
        stable, bare = 100 * part["stable_share"], 100 * part["no_gain_share"]
        gains = ", ".join(f"{case} {_number(gain)}" for case, gain in part["largest_gain"].items())
        counts = ", ".join(f"{key} {a}/{b}" for key, (a, b) in part["within_1_percent"].items())
        lines += [
            f"{name}: stable in {stable:.0f} % of {record['cells']} cells, gains no energy in {bare:.0f} %",
            f"  largest gain: {gains}; {part['step_us']:.0f} us a step",
            f"  cells within 1 %: {counts}",
        ]
    stable = record["all_stable"]
    lines.append(f"where all are stable ({stable['cells']} cells), geometric means:")
    for key in ERRORS:
        if stable[key]:
            means = ", ".join(f"{name} {error:.1e}" for name, error in stable[key]["errors"].items())
            lines.append(f"  {key:7} {means} ({stable[key]['cells']} cells)")
    return lines


def _number(gain) -> str:
    return "not finite" if gain is None else f"{gain:.2g}"
