"""Wall time against error of a catenary and a pendulum, beside what other engines take for the same.

A cable of 0.3 m, radius 4 mm, EA 3e4 N and 1,100 kg/m^3, for 2 s, by TendonWorld.step(): wall time of the
whole loop, pybullet's stepSimulation, sensing and reports included; building the scene is not.
Catenary: both ends pinned 0.24 m apart, from a slack V; error: the largest distance of a particle, after
2 s, from the continuous elastic catenary (Irvine 1981), which counts the discretisation too.
Pendulum: 1 kg, from 60 degrees, at its static stretch; error: RMS of the bob's path, at every step, from
scipy's solution of the same elastic chain (chain_ode). Errors are relative to the length.

PEERS are measured figures, on one core of a machine like the one this was written on, best wall time of the
settings tried. They are facts of other programs and another run: ratios to them are for scale.
"""

import dataclasses
import math
from time import perf_counter

import numpy as np
from bullet_tendon.scenarios.scene import Scene
from scipy.optimize import brentq

import bullet_tendon as bt

from .chain_ode import PLANE
from .problems import BOB, DAMPING_TIME, GRAVITY, LENGTH, PROBLEMS, STIFF

RADIUS, DENSITY, SPAN = 0.004, 1100.0, 0.24  # m, kg/m^3, m
DURATION = 2.0  # s
TARGETS = (1e-3, 1e-4)
# Seconds to reach the targets, by problem; None: not reached.
PEERS = {
    "catenary": {
        "MuJoCo 3 cable": (0.016, 0.71),
        "MuJoCo 4 flex": (0.036, 0.82),
        "MuJoCo 4 explicit springs": (0.75, 7.0),
        "Newton VBD": (0.36, None),
        "PyElastica": (1.8, 4.2),
        "pybullet beads": (0.78, None),
        "pybullet link chain": (0.008, None),
    },
    "pendulum": {
        "MuJoCo 3 cable": (0.14, 0.23),
        "MuJoCo 4 flex": (0.29, None),
        "MuJoCo 4 explicit springs": (0.55, 0.55),
        "Newton VBD": (None, None),
        "PyElastica": (1.7, 1.7),
        "pybullet beads": (None, None),
        "pybullet link chain": (0.14, 1.4),
    },
}
WIDE_STEP = 0.1  # s, of the catenary: what is sought is where it ends
SIZES, QUICK_SIZES = (5, 9, 13, 17, 25, 33, 41, 61, 81), (5, 9)  # particles of the catenary
PARTICLES, QUICK_PARTICLES = 20, 3  # of the pendulum
RATES, QUICK_RATES = (30, 60, 120, 240, 360, 480, 720), (60, 120)  # its steps a second
REPEATS = 5  # the quickest counts


def run(quick, progress) -> dict:
    """Runs, times to reach the targets, and ratios to the best peer's, by problem."""
    sizes, rates = (QUICK_SIZES, QUICK_RATES) if quick else (SIZES, RATES)
    swings = _pendulums(QUICK_PARTICLES if quick else PARTICLES, rates)
    runs = {
        "catenary": [_best(lambda size=size: _catenary(size)) for size in progress(sizes, "catenaries")],
        "pendulum": [_best(swing) for swing in progress(swings, "pendulums")],
    }
    problems = {name: _compare(PEERS[name], found) for name, found in runs.items()}
    return {"duration_s": DURATION, "peers_s": PEERS, "problems": problems}


def table(record) -> list[str]:
    lines = []
    for name, part in record["problems"].items():
        lines.append(f"{name}: wall time of {record['duration_s']:g} s")
        for r in part["runs"]:
            lines.append(
                f"  {r['particles']:3} particles, {r['integrator']}, dt {1e3 * r['time_step_s']:7.3f} ms: "
                f"error {r['error']:.2e}, {1e3 * r['seconds']:8.3f} ms"
            )
        for target, reached in part["reached"].items():
            ours, best, ratio = reached["seconds"], reached["best_peer_s"], reached["ratio"]
            text = "not reached" if ours is None else f"{1e3 * ours:.3g} ms"
            more = "" if ratio is None else f", {ratio:.3g} times less"
            lines.append(
                f"  to {target}: {text}; best peer {1e3 * best:.3g} ms ({reached['best_peer']}){more}"
            )
    return lines


def panels(record) -> list[dict]:
    labels = {"xlabel": "relative error", "ylabel": "wall time of 2 s [s]"}
    result = []
    for name, part in record["problems"].items():
        runs = part["runs"]
        curves = [
            {"x": [r["error"] for r in runs], "y": [r["seconds"] for r in runs], "label": "bullet_tendon"}
        ]
        for peer, times in record["peers_s"][name].items():
            points = [(target, time) for target, time in zip(TARGETS, times, strict=True) if time]
            if points:
                x, y = zip(*points, strict=True)
                curves.append({"x": x, "y": y, "label": peer})
        result.append({**labels, "title": name, "curves": curves})
    return result


def hanging_curve(arc) -> np.ndarray:
    """(n, 2) x and z [m] of the continuous elastic catenary at rest lengths `arc` (n,) from its left end.

    Irvine, Cable Structures (1981), for level ends SPAN apart.
    """
    weight = DENSITY * math.pi * RADIUS**2 * LENGTH * GRAVITY
    pull = brentq(lambda pull: _curve(np.array([LENGTH]), weight, pull)[0, 0] - SPAN, 1e-6 * STIFF, STIFF)
    return _curve(np.asarray(arc), weight, pull)


def _curve(arc, weight, pull) -> np.ndarray:
    """The same for a horizontal tension `pull` [N]; half of the weight [N] hangs on each end."""
    left, here = weight / 2 / pull, (weight / 2 - weight * arc / LENGTH) / pull
    scale = pull * LENGTH / weight
    x = pull * arc / STIFF + scale * (np.arcsinh(left) - np.arcsinh(here))
    stretch = weight * arc / STIFF * (0.5 - arc / (2 * LENGTH))
    z = -stretch - scale * (np.sqrt(1 + left**2) - np.sqrt(1 + here**2))
    return np.column_stack([x, z])


def _material():
    return bt.Material(stiffness=STIFF, damping=DAMPING_TIME * STIFF, density=DENSITY)


def _catenary(particles) -> dict:
    depth = math.sqrt(LENGTH**2 - SPAN**2) / 2
    corners = [(0, 0, 0), (SPAN / 2, 0, -depth), (SPAN, 0, 0)]
    with Scene(time_step=WIDE_STEP, gravity=-GRAVITY, solver=bt.SolverOptions()) as scene:
        tendon = scene.world.add_tendon(corners, RADIUS, _material(), particles)
        for end in (0, -1):
            tendon.grip(end)
        seconds = _timed(lambda: scene.world.step(round(DURATION / WIDE_STEP)))
        curve = hanging_curve(np.linspace(0, LENGTH, particles))
        away = np.linalg.norm(tendon.positions[:, PLANE] - curve, axis=1).max()
    return _record(particles, "implicit_euler", WIDE_STEP, away, seconds)


def _pendulums(particles, rates) -> list:
    """One run for every rate, as functions; the reference is solved for once, at all their times."""
    pendulum = next(q for q in PROBLEMS if q.name == "stiff pendulum")
    pendulum = dataclasses.replace(pendulum, build=lambda scene: _hang(scene, particles), duration=DURATION)
    times = np.unique(np.round(np.concatenate([_times(rate) for rate in rates]), 9))
    with pendulum.scene(1.0) as scene:
        tendon = pendulum.start(scene)
        x = tendon.positions[:, PLANE]
        path = pendulum.ode(tendon).solve(x, np.zeros_like(x), times, "Radau", 1e-7)[:, -1]
    found = [path[np.searchsorted(times, np.round(_times(rate), 9) - 1e-10)] for rate in rates]
    return [
        lambda rate=rate, path=path: _swing(pendulum, rate, path)
        for rate, path in zip(rates, found, strict=True)
    ]


def _times(rate) -> np.ndarray:
    """Ends of the steps [s]."""
    return np.arange(1, round(DURATION * rate) + 1) / rate


def _hang(scene, particles):
    stretch = 1 + BOB * GRAVITY * 0.5 / STIFF
    end = LENGTH * np.array([math.sqrt(0.75), 0.0, -0.5])  # 60 degrees from the vertical
    tendon = scene.world.add_tendon([(0, 0, 0), end], RADIUS, _material(), particles)
    tendon.set_point_mass(-1, BOB)
    tendon.set_positions(stretch * tendon.positions)
    return tendon


def _swing(pendulum, rate, path) -> dict:
    found = np.empty_like(path)
    with pendulum.scene(1 / rate, bt.SolverOptions(integrator="bdf2")) as scene:
        tendon = pendulum.start(scene)

        def loop():
            for k in range(len(found)):
                scene.world.step()
                found[k] = tendon.positions[-1, PLANE]

        seconds = _timed(loop)
        particles = tendon.particles
    away = math.sqrt(np.mean(np.sum((found - path) ** 2, axis=1)))
    return _record(particles, "bdf2", 1 / rate, away, seconds)


def _timed(call) -> float:
    start = perf_counter()
    call()
    return perf_counter() - start


def _record(particles, integrator, time_step, away, seconds) -> dict:
    return {
        "particles": particles,
        "integrator": integrator,
        "time_step_s": time_step,
        "error": float(away / LENGTH),
        "seconds": seconds,
    }


def _best(once) -> dict:
    """The quickest of several runs, which are the same bit by bit."""
    return min((once() for _ in range(REPEATS)), key=lambda r: r["seconds"])


def _compare(peers, runs) -> dict:
    reached = {}
    for k, target in enumerate(TARGETS):
        ours = min((r["seconds"] for r in runs if r["error"] <= target), default=None)
        best = min((p for p in peers if peers[p][k]), key=lambda p: peers[p][k])
        ratio = None if ours is None else peers[best][k] / ours
        reached[f"{target:g}"] = {
            "seconds": ours,
            "best_peer": best,
            "best_peer_s": peers[best][k],
            "ratio": ratio,
        }
    return {"runs": runs, "reached": reached}
