"""One particle is pulled, suddenly and slowly: where the stretch sits, and how far it overshoots (section 3).

The paper calls a linear chain "super-elastic": under a large force nearly all the stretch sits near the
loaded particle. Its remedy is the power law (equation 3). Here a straight tendon, held at both ends, is
pulled sideways by 200 N at its middle particle, at once or by a ramp of 0.1 s, without gravity. Both laws
carry 600 N at a strain of 0.02. Three methods:

    published   the paper's own: one linearisation a step, steps of 1 ms
    default     every step converged, steps of 1 ms
    resolved    BDF2 with steps of 0.02 ms, which shows the wave along the tendon

Measured: the share of all the stretch that sits in the two segments beside the particle, over the even
share 2/(n-1), at its most; and the overshoot of the particle's way over its way at rest.

Checked against exact results for a massless tendon of two straight parts (it meets its ends at the same
tension everywhere): the way at rest; and the largest way that a force F switched on at once can give, where
the least stored energy U(z) of all shapes with the particle at z is F z. Damping can only lower it, so every
method that keeps the balance of energy stays below it.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p
from scipy.optimize import brentq, minimize_scalar

import bullet_tendon as bt

from .scene import Check, Scene

LENGTH, RADIUS = 0.2, 0.003  # m
FORCE, RAMP, SECONDS = 200.0, 0.1, 0.15  # N, s, s
PARTICLES = (20, 60, 200)
SHOWN = 60  # particles of the tendons in the picture
SHOWN_SECONDS = 0.01  # of the sudden pull
REFERENCE = (600.0, 0.02)  # tension [N] of both laws at this strain [-]
LAWS = {
    "linear": bt.Material(stiffness=REFERENCE[0] / REFERENCE[1], tension_only=True, damping=1.0),
    "power": bt.Material(
        stiffness=REFERENCE[0] / REFERENCE[1] ** 2, exponent=2.0, tension_only=True, damping=1.0
    ),
}
METHODS = {
    "published": (bt.SolverOptions.published(), 1e-3),
    "default": (bt.SolverOptions(), 1e-3),
    "resolved": (bt.SolverOptions(integrator="bdf2"), 2e-5),
}
PULLS = ("sudden", "slow")
UNEVEN = 1.05  # most of the share over the even one, by the default
LOCAL = 0.9  # least of the stretch beside the particle, by the published method


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    scene.handles.runs = []
    scene.camera = {"target": (0.1, 0, 0.01), "distance": 0.25, "yaw": 0, "pitch": -5}
    scene.labels |= {
        "ylabel": "way of the particle [mm]",
        "title": f"A particle pulled suddenly by {FORCE:g} N, {SHOWN} particles",
    }
    scene.map_labels = ("time [ms]", "along the tendon [mm]", "strain [%]")
    return scene


def drive(scene, progress) -> None:
    cases = [
        (n, law, pull, method) for n in PARTICLES for law in LAWS for pull in PULLS for method in METHODS
    ]
    for case in progress(cases, "pulls"):
        run = _pull(scene, *case)
        scene.handles.runs.append(run)
        scene.measure(f"{run.name}: share over even", run.share.max() * (run.particles - 1) / 2)
        scene.measure(f"{run.name}: overshoot", run.way.max() / run.rest - 1)
        if run.particles == SHOWN and run.pull == "sudden":
            _show(scene, run)


def check(scene) -> list[Check]:
    checks = scene.health()
    for run in scene.handles.runs:
        if run.method == "published":
            checks.append(Check.at_least(f"{run.name}: share", run.share.max(), LOCAL))
            continue
        checks.append(
            Check.at_most(f"{run.name}: overshoot", run.way.max() / run.rest, run.largest / run.rest)
        )
        if run.method == "default":
            uneven = scene.measured[f"{run.name}: share over even"]
            checks.append(Check.at_most(f"{run.name}: share over even", uneven, UNEVEN))
            checks.append(Check.at_most(f"{run.name}: at rest, error", abs(run.way[-1] / run.rest - 1), 1e-6))
    return checks


def way_at_rest(material, first, force=FORCE) -> float:
    """Way [m] at rest of a point pulled sideways by `force` [N], `first` [m] from one end of the tendon."""
    step = 1e-7 * LENGTH

    def excess(z):
        return (_energy(material, first, z + step) - _energy(material, first, z - step)) / (2 * step) - force

    return brentq(excess, 1e-3 * LENGTH, LENGTH, xtol=1e-15)


def largest_way(material, first, force=FORCE) -> float:
    """Largest way [m] that `force` [N], switched on at once, can give: U(z) = force z."""
    return brentq(lambda z: _energy(material, first, z) - force * z, 1e-3 * LENGTH, LENGTH)


def _energy(material, first, z) -> float:
    """Least energy [J] of two straight parts that meet at a point z [m] aside."""

    def stored(shift):
        total = 0.0
        for rest, along in ((first, first + shift), (LENGTH - first, LENGTH - first - shift)):
            strain = max(np.hypot(along, z) / rest - 1, 0.0)
            total += rest * material.stiffness * strain ** (material.exponent + 1) / (material.exponent + 1)
        return total

    reach = 0.1 * LENGTH
    return minimize_scalar(stored, bounds=(-reach, reach), method="bounded", options={"xatol": 1e-12}).fun


def _pull(scene, particles, law, pull, method) -> SimpleNamespace:
    """One tendon, pulled for SECONDS: its strains (steps, n-1) and the way (steps,) [m] of its particle."""
    options, dt = METHODS[method]
    p.setTimeStep(dt, scene.client)
    scene.time_step, scene.time = dt, 0.0
    scene.world = bt.TendonWorld(scene.client, options)
    tendon = scene.world.add_tendon([(0, 0, 0), (LENGTH, 0, 0)], RADIUS, LAWS[law], particles)
    for end in (0, -1):
        tendon.grip(end)
    middle = particles // 2
    steps = round(SECONDS / dt)
    strains, way = np.empty((steps, particles - 1)), np.empty(steps)
    for k in range(steps):
        share = 1.0 if pull == "sudden" else min(1.0, (k + 1) * dt / RAMP)
        tendon.set_force(middle, (0, 0, share * FORCE))
        scene.step()
        strains[k], way[k] = tendon.strain, tendon.positions[middle, 2]
    stretch = np.maximum(strains, 0.0)
    first = LENGTH * middle / (particles - 1)
    return SimpleNamespace(
        name=f"{particles}, {law}, {pull}, {method}",
        particles=particles,
        law=law,
        pull=pull,
        method=method,
        times=dt * np.arange(1, steps + 1),
        strains=strains,
        way=way,
        share=stretch[:, [middle - 1, middle]].sum(axis=1) / stretch.sum(axis=1),
        rest=way_at_rest(LAWS[law], first),
        largest=largest_way(LAWS[law], first),
    )


def _show(scene, run) -> None:
    """Strain along the tendon against time, and the way of the particle where it is not far outside."""
    kept = run.times <= SHOWN_SECONDS
    scene.map(
        f"{run.law} law, {run.method}",
        1e3 * run.times[kept],
        1e3 * LENGTH * (np.arange(run.particles - 1) + 0.5) / (run.particles - 1),
        100 * np.maximum(run.strains[kept].T, 0.0),
    )
    if run.method != "published":
        for time, way in zip(run.times[kept], run.way[kept], strict=True):
            scene.record(f"{run.law} law, {run.method}", 1e3 * way, at=time)
