"""Error against run time of bodies that swing on tendons, beside an explicit force.

The problems are those of multibody_problems: a pendulum, a double pendulum of two boxes, a plate on four
tendons, an arm of two hinges whose tip swings on a tendon. The tendons' mass is negligible, and nothing is
damped. The references are scipy's solutions of the exact equations (rigid_ode). The methods are a tendon of
two particles by implicit Euler and by BDF2, and what users write by hand: the spring's force from where the
bodies are before the step. Errors are the RMS distance of the bodies' centres from their exact paths, at
every step of DURATION seconds, over LENGTH. pybullet starts bodies half a step late: "half a step later" is
the error against the exact path half a time step later. Times are the processor's in the whole loop, the
least of REPEATS.
"""

import math
from time import process_time

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

from .multibody_problems import PROBLEMS, STIFFNESS, WORLD, link_frame
from .rigid_ode import GRAVITY, pull

LENGTH = 0.3  # m: what errors are relative to
DURATION, QUICK_DURATION = 2.0, 0.1  # s
RATES, QUICK_RATES = (240, 480, 1000, 2000, 4000), (240, 480)  # steps per second
REPEATS = 2
RADIUS, DENSITY = 1e-4, 10.0  # of a tendon [m], [kg/m^3]: 0.1 mg
SOLVERS = {"implicit Euler": "implicit_euler", "BDF2": "bdf2", "by hand": None}


def run(quick, progress) -> dict:
    """Rows by problem, method and rate."""
    rates, duration = (QUICK_RATES, QUICK_DURATION) if quick else (RATES, DURATION)
    rows = []
    for problem, build in progress(PROBLEMS.items(), "problems"):
        exact = _references(build, rates, duration)
        for method in SOLVERS:
            for rate in rates:
                runs = [_measure(build, method, rate, duration) for _ in range(REPEATS)]
                errors = [_error(runs[0][1], path) for path in exact[rate]]
                rows.append(_row(problem, method, rate, min(seconds for seconds, _ in runs), errors))
    orders = {problem: {m: _order(rows, problem, m) for m in SOLVERS} for problem in PROBLEMS}
    return {"duration_s": duration, "length_m": LENGTH, "rows": rows, "orders_half_a_step_later": orders}


def table(record) -> list[str]:
    lines = [f"{'':16} {'':15} {'dt ms':>7} {'error':>9} {'half a step later':>18} {'us a step':>10}"]
    for row in record["rows"]:
        per_step = 1e6 * row["seconds"] * row["time_step_s"] / record["duration_s"]
        errors = f"{_text(row['error']):>9} {_text(row['error_half_a_step_later']):>18}"
        place = f"{row['problem']:16} {row['method']:15} {1e3 * row['time_step_s']:7.3f}"
        lines.append(f"{place} {errors} {per_step:10.1f}")
    lines.append("orders against the path half a step later, from the shortest two steps:")
    for problem, found in record["orders_half_a_step_later"].items():
        words = ", ".join(f"{method} {_text(order, '.2f')}" for method, order in found.items())
        lines.append(f"  {problem}: {words}")
    return lines


def panels(record) -> list[dict]:
    labels = {
        "xlabel": "relative error, half a step later",
        "ylabel": f"processor time of {record['duration_s']:g} s [s]",
    }
    result = []
    for problem, orders in record["orders_half_a_step_later"].items():
        curves = []
        for method in orders:
            rows = [r for r in record["rows"] if (r["problem"], r["method"]) == (problem, method)]
            rows = [r for r in rows if r["error_half_a_step_later"] is not None]
            curve = {"x": [r["error_half_a_step_later"] for r in rows], "y": [r["seconds"] for r in rows]}
            curves.append({**curve, "label": method})
        result.append({**labels, "title": problem, "curves": curves})
    return result


def _references(build, rates, duration) -> dict:
    """By rate: exact paths at the ends of the steps, and half a step later."""
    times = {rate: np.arange(1, round(duration * rate) + 1) / rate for rate in rates}
    wanted = np.concatenate([[t, t + 0.5 / rate] for rate, t in times.items()], axis=1)
    every, where = np.unique(np.round(wanted, 10), return_inverse=True)
    with Scene(gravity=-GRAVITY) as scene:
        paths = build(scene.client).paths(every)[where.reshape(wanted.shape)]
    ends = np.cumsum([len(t) for t in times.values()])[:-1]
    parts = [np.split(part, ends) for part in paths]
    return {rate: (parts[0][k], parts[1][k]) for k, rate in enumerate(rates)}


def _measure(build, method, rate, duration) -> tuple[float, np.ndarray]:
    """Seconds of the loop, and the centres' paths (steps, n, 3) [m]."""
    options = bt.SolverOptions(integrator=SOLVERS[method] or "implicit_euler")
    with Scene(time_step=1 / rate, gravity=-GRAVITY, solver=options) as scene:
        system = build(scene.client)
        step = _tie(scene, system.ties) if SOLVERS[method] else _by_hand(scene.client, system.ties)
        found = np.empty((round(duration * rate), len(system.tracked), 3))
        seconds = 0.0
        for row in found:
            start = process_time()
            step()
            seconds += process_time() - start
            row[:] = [link_frame(*which, scene.client)[0] for which in system.tracked]
    return seconds, found


def _tie(scene, ties):
    """The step of a world with a tendon for each tie."""
    material = bt.Material(stiffness=STIFFNESS, density=DENSITY)
    for tie in ties:
        tendon = scene.world.add_tendon([tie.start, tie.end], RADIUS, material, 2, rest_length=tie.rest)
        for particle, end in ((0, tie.a), (-1, tie.b)):
            if end == WORLD:
                tendon.grip(particle)
            else:
                tendon.attach(particle, *end)
    return scene.world.step


def _by_hand(client, ties):
    """pybullet's step after the springs' forces at the present positions."""
    ends = [
        (tie, [_local(end, point, client) for end, point in ((tie.a, tie.start), (tie.b, tie.end))])
        for tie in ties
    ]

    def step():
        for tie, locals_ in ends:
            points = [_world(end, local, client) for end, local in zip((tie.a, tie.b), locals_, strict=True)]
            force = pull(*points, STIFFNESS, tie.rest)
            for end, point, on in ((tie.a, points[0], force), (tie.b, points[1], -force)):
                if end != WORLD:
                    p.applyExternalForce(*end, on.tolist(), point.tolist(), p.WORLD_FRAME, client)
        p.stepSimulation(client)

    return step


def _local(end, point, client) -> np.ndarray:
    """(3,) a point of the world in the link's frame [m]."""
    if end == WORLD:
        return point
    at, axes = link_frame(*end, client)
    return axes.T @ (point - at)


def _world(end, local, client) -> np.ndarray:
    if end == WORLD:
        return local
    at, axes = link_frame(*end, client)
    return at + axes @ local


def _error(path, exact) -> float | None:
    """RMS distance over LENGTH; None for a path that has left the scene."""
    away = float(np.sqrt(np.mean(np.sum((path - exact) ** 2, axis=2)))) / LENGTH
    return away if away < 10 else None


def _row(problem, method, rate, seconds, errors) -> dict:
    row = {"problem": problem, "method": method, "time_step_s": 1 / rate, "seconds": seconds}
    return {**row, "error": errors[0], "error_half_a_step_later": errors[1]}


def _order(rows, problem, method) -> float | None:
    """Of the error half a step later, from the two shortest steps."""
    found = [r for r in rows if (r["problem"], r["method"]) == (problem, method)][-2:]
    coarse, fine = (r["error_half_a_step_later"] for r in found)
    if coarse is None or fine is None:
        return None
    return math.log(coarse / fine) / math.log(found[0]["time_step_s"] / found[1]["time_step_s"])


def _text(number, form=".1e") -> str:
    return "unstable" if number is None else f"{number:{form}}"
