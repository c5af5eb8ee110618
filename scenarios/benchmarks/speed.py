"""Time of a step against the number of particles, beside one banded LAPACK solve of the same size.

A taut tendon, held at one end, swings with a weight at the other, solved to TOLERANCE at every step.
"Step" is the room `solve` of the world's report: the whole implicit step of the compiled core, all
its iterations, and the search for contacts of the tendon with itself. "Thin" tendons have segments
that are no shorter than thick, so that this search ends at once, at every n. "dpbsv" is one
factorisation and solution, by scipy's LAPACK, of a symmetric positive definite band matrix of the
same size and bandwidth, assembled from the tendon's own state: mass/dt^2 and the springs' blocks.
Both are timed by turns in one process. The Python side is all of world.apply() but that room. Bytes
are what the core asks the heap for in a step (its operator new counts), and, apart from them, what Python
holds at most in one apply() beyond what it held before (by tracemalloc).
"""

import tracemalloc
from statistics import median
from time import perf_counter

import numpy as np
import pybullet as p
from scipy.linalg.lapack import dpbsv

from bullet_tendon import _core

from . import pendulum
from .pendulum import ANGLE, EXPONENT, GRAVITY, LENGTH, RADIUS, STIFFNESS, TIME_STEP, TOLERANCE, WEIGHT

SIZES, QUICK_SIZES = (20, 60, 200, 600, 2000, 6000), (20, 60)
FITTED = 60  # particles: the growth is fitted from here on
VARIANTS = {  # share of the stiffness in each shear spring; whether segments are no shorter than thick
    "block tridiagonal": (0.0, False),
    "with shear springs": (0.1, False),
    "thin": (0.0, True),
}
STEPS, FEWEST, QUICK_STEPS = 240, 60, 12  # FEWEST: for long tendons
WARM_UP = 3  # steps that are not counted


def run(quick, progress) -> dict:
    """Rows by variant, and the growth exponents of the step's time."""
    sizes = QUICK_SIZES if quick else SIZES
    rows = []
    for particles in progress(sizes, "particles"):
        for variant, (share, thin) in VARIANTS.items():
            rows.append({"variant": variant, **_measure(particles, share, thin, quick)})
    growth = {variant: _growth([row for row in rows if row["variant"] == variant]) for variant in VARIANTS}
    return {"tolerance": TOLERANCE, "time_step_s": TIME_STEP, "rows": rows, "growth_exponent": growth}


def table(record) -> list[str]:
    head = f"{'':18} {'n':>5} {'iter':>5} {'step us':>9} {'min':>9} {'us/iter':>9} {'dpbsv us':>9} {'min':>9}"
    lines = [head + f" {'step/dpbsv':>10} {'of min':>7} {'python us':>9} {'bytes':>6} {'python':>6}"]
    for row in record["rows"]:
        lines.append(
            f"{row['variant']:18} {row['particles']:5} {row['iterations']:5.3g} {row['step_us']:9.2f} "
            f"{row['step_least_us']:9.2f} {row['iteration_us']:9.2f} {row['dpbsv_us']:9.2f} "
            f"{row['dpbsv_least_us']:9.2f} {row['ratio']:10.3f} {row['ratio_of_least']:7.3f} "
            f"{row['python_us']:9.2f} {row['core_bytes']:6} {row['python_bytes']:6}"
        )
    for variant, growth in record["growth_exponent"].items():
        lines.append(f"time of a step grows with n to the power {growth:.3f}: {variant}")
    lines.append("medians over the steps; bytes: asked for by the core in a step; and Python's peak")
    return lines


def panels(record) -> list[dict]:
    curves = []
    for variant in VARIANTS:
        rows = [row for row in record["rows"] if row["variant"] == variant]
        sizes = [row["particles"] for row in rows]
        for key, label in (("step_us", "step"), ("iteration_us", "iteration"), ("dpbsv_us", "dpbsv")):
            curves.append({"x": sizes, "y": [row[key] for row in rows], "label": f"{label}, {variant}"})
    labels = {"xlabel": "particles", "ylabel": "median time [us]", "title": "One step of a swinging tendon"}
    return [{**labels, "curves": curves}]


def band_matrix(positions, masses, spans, dt) -> np.ndarray:
    """(bandwidth + 1, 3n) lower band of M/dt^2 + the springs' blocks, as LAPACK stores it [N/m].

    positions (n, 3) [m], masses (n,) [kg]; spans: (gap, rest lengths [m], stiffness [N]) for springs that
    join particles i and i + gap. The first particle is held: its mass is ten thousandfold.
    """
    weight = masses / dt**2
    weight[0] *= 1e4
    diagonal = weight[:, None, None] * np.eye(3)
    band = np.zeros((3 * max(gap for gap, _, _ in spans) + 3, 3 * len(masses)), order="F")
    for gap, rest, stiffness in spans:
        block = _spring_blocks(positions[gap:] - positions[:-gap], rest, stiffness)
        diagonal[gap:] += block
        diagonal[:-gap] += block
        for row, column in np.ndindex(3, 3):
            band[3 * gap + row - column, column : 3 * len(block) : 3] = -block[:, row, column]
    for row, column in zip(*np.tril_indices(3), strict=True):
        band[row - column, column::3] = diagonal[:, row, column]
    return band


def _spring_blocks(edges, rest, stiffness) -> np.ndarray:
    """(m, 3, 3) tangents: the law's slope along the spring, tension / length across it (>= 0)."""
    length = np.linalg.norm(edges, axis=1)
    strain = length / rest - 1
    slope = stiffness * EXPONENT * np.abs(strain) ** (EXPONENT - 1) / rest
    across = np.maximum(stiffness * np.sign(strain) * np.abs(strain) ** EXPONENT / length, 0.0)
    along = np.einsum("ki,kj->kij", edges, edges) / length[:, None, None] ** 2
    return slope[:, None, None] * along + across[:, None, None] * (np.eye(3) - along)


def _build(scene, particles, share, radius):
    """The pendulum, as long as it hangs at its angle at rest."""
    stretch = 1 + (WEIGHT * GRAVITY * np.cos(ANGLE) / STIFFNESS) ** (1 / EXPONENT)
    tendon = pendulum.add_tendon(scene, particles, radius, share)
    tendon.set_positions(stretch * tendon.positions)
    pendulum.attach_weight(scene, tendon)
    return tendon


def _measure(particles, share, thin, quick) -> dict:
    """One row of the table; times in microseconds."""
    steps = QUICK_STEPS if quick else max(FEWEST, min(STEPS, STEPS * 600 // particles))
    radius = min(RADIUS, LENGTH / (2 * particles)) if thin else RADIUS
    with pendulum.scene() as scene:
        tendon = _build(scene, particles, share, radius)
        rows = [_one_step(scene, tendon, share) for _ in range(WARM_UP + steps)][WARM_UP:]
        core_bytes, python_bytes = _core_allocated(scene), _python_allocated(scene)
    step, whole, lapack, iterations, converged = (list(column) for column in zip(*rows, strict=True))
    per_iteration = [s / max(i, 1) for s, i in zip(step, iterations, strict=True)]
    return {
        "particles": particles,
        "steps": steps,
        "unconverged": steps - sum(converged),
        "iterations": float(np.mean(iterations)),
        "step_us": 1e6 * median(step),
        "step_least_us": 1e6 * min(step),
        "iteration_us": 1e6 * median(per_iteration),
        "dpbsv_us": 1e6 * median(lapack),
        "dpbsv_least_us": 1e6 * min(lapack),
        "ratio": median(step) / median(lapack),
        "ratio_of_least": min(step) / min(lapack),
        "python_us": 1e6 * median(w - s for w, s in zip(whole, step, strict=True)),
        "core_bytes": core_bytes,
        "python_bytes": python_bytes,
    }


def _one_step(scene, tendon, share) -> tuple:
    """Seconds of the solve, of the whole apply() and of dpbsv; iterations, converged."""
    start = perf_counter()
    scene.world.apply()
    whole = perf_counter() - start
    lapack = _time_lapack(tendon, share)
    p.stepSimulation(scene.client)
    report = scene.world.report
    return report.seconds["solve"], whole, lapack, report.iterations, report.converged


def _time_lapack(tendon, share) -> float:
    """Seconds of one dpbsv on the tendon's present matrix; the right-hand side is its weight."""
    rest = np.full(tendon.particles - 1, tendon.rest_length / (tendon.particles - 1))
    spans = [(1, rest, (1 - 2 * share) * STIFFNESS)]
    if share:
        spans.append((2, rest[1:] + rest[:-1], share * STIFFNESS))
    masses = tendon.masses
    masses[-1] += WEIGHT
    band = band_matrix(tendon.positions, masses, spans, TIME_STEP)
    load = np.asfortranarray((masses[:, None] * [0.0, 0.0, -GRAVITY]).reshape(-1, 1))
    start = perf_counter()
    info = dpbsv(band, load, lower=1, overwrite_ab=1, overwrite_b=1)[2]
    seconds = perf_counter() - start
    if info:
        raise ArithmeticError(f"dpbsv: info = {info}: must be 0 (positive definite)")
    return seconds


def _core_allocated(scene) -> int:
    """Bytes that the core asked for in one step, freed or not."""
    core = scene.world._core
    before = _core.allocated_bytes()
    core.step(TIME_STEP, (0.0, 0.0, -GRAVITY), False, None)
    return _core.allocated_bytes() - before


def _python_allocated(scene) -> int:
    """Most bytes that Python held in one apply() beyond those before it."""
    tracemalloc.start()
    scene.world.apply()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    scene.world.apply()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak - before


def _growth(rows) -> float:
    """Exponent of n in the step's time, by least squares over the logarithms."""
    rows = [row for row in rows if row["particles"] >= FITTED] if len(rows) > 2 else rows
    logs = np.log([(row["particles"], row["step_us"]) for row in rows])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])
