"""Time of a step as the user calls it, world.apply(), beside the core's step within that call.

A tendon of PARTICLES particles, held at one end, swings with a weight at the other. Nothing else is in the
scene. "Point mass": the weight is a mass on the last particle, and there are no bodies. "Body": it is a
pybullet body to which the tendon is attached. pybullet takes a step after every call, outside the time.
"Core" is the rooms near and solve of the world's report: the whole implicit step of the compiled core.
"Beyond" is the rest of the call: pybullet's parameters, the copy of the state, reading and pushing bodies,
and Python. "Parameters" is p.getPhysicsEngineParameters() by itself, which gives the time step and gravity.
"Sense" and "react" are these rooms of the report: the reading of bodies, and the forces on them. Both scenes
are measured by turns in rounds; a figure is the median over the rounds of the rounds' medians.
"""

from statistics import median
from time import perf_counter

import numpy as np
import pybullet as p

from . import pendulum

PARTICLES = 60
ROUNDS, CALLS, QUICK_CALLS = 20, 200, 5  # CALLS: in each round
VARIANTS = ("point mass", "body")
KEYS = ("call_us", "core_us", "beyond_us", "parameters_us", "sense_us", "react_us")


def run(quick, progress) -> dict:
    """Rows by variant: medians in microseconds."""
    calls = QUICK_CALLS if quick else CALLS
    times = {variant: [] for variant in VARIANTS}
    with pendulum.scene() as light, pendulum.scene() as heavy:
        pendulum.add_tendon(light, PARTICLES).set_point_mass(-1, pendulum.WEIGHT)
        pendulum.attach_weight(heavy, pendulum.add_tendon(heavy, PARTICLES))
        for _ in progress(range(ROUNDS), "rounds"):
            times["point mass"].append(_round(light, calls))
            times["body"].append(_round(heavy, calls))
    rows = []
    for variant, rounds in times.items():
        medians = {key: median(one[key] for one in rounds) for key in rounds[0]}
        least = {f"least_{key}": min(one[key] for one in rounds) for key in ("call_us", "beyond_us")}
        rows.append({"variant": variant, **medians, **least})
    return {"particles": PARTICLES, "rounds": ROUNDS, "calls": calls, "rows": rows}


def table(record) -> list[str]:
    keys = ("iterations", *KEYS, "least_beyond_us")
    heads = ("iter", "call us", "core", "beyond", "parameters", "sense", "react", "least beyond")
    lines = [f"{'':12}" + "".join(f"{head:>13}" for head in heads)]
    for row in record["rows"]:
        lines.append(f"{row['variant']:12}" + "".join(f"{row[key]:13.2f}" for key in keys))
    lines.append("all times in microseconds; beyond: the call without the core")
    lines.append(f"{record['particles']} particles; medians over {record['rounds']} rounds of the medians of")
    lines.append(f"{record['calls']} calls, and the least of the rounds")
    return lines


def panels(record) -> list[dict]:
    labels = [row["variant"] for row in record["rows"]]
    curves = [
        {"x": list(range(1, len(labels) + 1)), "y": [row[key] for row in record["rows"]], "label": name}
        for key, name in (("call_us", "call"), ("core_us", "core"), ("beyond_us", "beyond the core"))
    ]
    axes = {"xlabel": ", ".join(labels), "ylabel": "median time [us]"}
    return [{**axes, "title": "One call of a swinging tendon", "curves": curves}]


def _round(scene, calls) -> dict:
    """Medians of the call and its parts [us] (KEYS), and the mean number of iterations of a call."""
    world, client = scene.world, scene.client
    found = {key: [] for key in KEYS}
    iterations = []
    for _ in range(calls):
        start = perf_counter()
        world.apply()
        end = perf_counter()
        p.stepSimulation(client)
        asked = perf_counter()
        p.getPhysicsEngineParameters(client)
        parameters = perf_counter() - asked
        seconds = world.report.seconds
        core = seconds["near"] + seconds["solve"]
        parts = end - start, core, end - start - core, parameters, seconds["sense"], seconds["react"]
        for key, value in zip(KEYS, parts, strict=True):
            found[key].append(1e6 * value)
        iterations.append(world.report.iterations)
    return {key: median(values) for key, values in found.items()} | {"iterations": float(np.mean(iterations))}
