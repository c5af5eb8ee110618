"""The largest stable time step for 60 particles, explicit and implicit (section 4.2 of the paper).

A tendon is held at one end, lies horizontally, is struck upwards at its middle and released. A time
step is stable if STEPS of it stay finite and converge, and the mechanical energy (elastic, kinetic
and in the field of gravity) never exceeds its first value by more than a hundredth of what was put
in: the strike, and what gravity can do over the tendon's length. The limit is found by going up in
octaves until a step is not stable, then by bisection on a logarithmic scale.

Methods: explicit Euler (equation 6), the paper's implicit method (one linearisation, conjugate
gradients) and the default. Materials: "soft", whose explicit limit is about the paper's 0.002 s, with
the paper's damping of whole velocities (with axial damping explicit Euler makes every swing grow,
whatever the step), and "tendon", with a real one's stiffness. The default has to be stable at every
step tried, with axial damping too. The paper found 0.002 s and 0.05 s.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .scene import Check, Scene

PARTICLES = 60
LENGTH, RADIUS = 0.6, 0.004  # m
STRIKE = 0.5  # m/s, velocity of the middle third
STEPS = 400
BISECTIONS = 6
SMALLEST = {"explicit": 1e-6, "published implicit": 1e-4, "default": 1e-4}  # s, tried first
LARGEST = 0.5  # s, tried last
EXCESS = 0.01  # of the energy that was put in
GRAVITY = 9.81  # m/s^2
MATERIALS = {
    "soft": bt.Material(stiffness=0.7, damping=0.0014, damping_form="whole"),
    "tendon": bt.Material(stiffness=3e4, damping=1.0, damping_form="whole"),
    "axially damped tendon": bt.Material(stiffness=3e4, damping=1.0),
}
METHODS = {
    "explicit": bt.SolverOptions(integrator="explicit_euler"),
    "published implicit": bt.SolverOptions.published(),
    "default": bt.SolverOptions(),
}
COMPARED = ("soft", "tendon")  # materials of which every method's limit is sought
RATIO = 25  # 0.05 s over 0.002 s


def build(options) -> Scene:
    scene = Scene(options, gravity=-GRAVITY)
    scene.camera = {"target": (0.15, 0, -0.25), "distance": 1.1, "yaw": 0, "pitch": -10}
    scene.labels |= {"xlabel": "log10 of the time step [s]", "ylabel": "share of the steps survived"}
    return scene


def drive(scene, progress) -> None:
    for material in progress(COMPARED, "materials"):
        for method in METHODS:
            scene.measure(f"{material}: {method}", _limit(scene, material, method), "s")
        _ratio(scene, material)
    for material in MATERIALS:
        failed = sum(not stable(scene, material, "default", dt) for dt in _ladder())
        scene.measure(f"{material}: steps at which the default is not stable", failed)
    _photograph(scene)


def check(scene) -> list[Check]:
    got = scene.measured
    ratios = [f"{material}: published implicit / explicit" for material in COMPARED]
    failed = [f"{material}: steps at which the default is not stable" for material in MATERIALS]
    return [
        *(Check.at_least(name, got[name], RATIO) for name in ratios),
        *(Check.at_least(f"{m}: default", got[f"{m}: default"], LARGEST) for m in COMPARED),
        *(Check.equal(name, got[name], 0) for name in failed),
    ]


def stable(scene, material, method, dt) -> bool:
    """Whether a time step dt [s] is stable, as the module's text says."""
    tendon = _place(scene, material, method, dt)
    start = _energy(tendon)
    most = start + EXCESS * (start + GRAVITY * tendon.masses.sum() * LENGTH)
    for _ in range(STEPS):
        try:
            scene.step()
        except bt.StepFailed:
            return False
        if not _energy(tendon) <= most or not scene.world.report.converged:
            return False
    return True


def _place(scene, material, method, dt):
    """A new world, in which the tendon was struck just now."""
    p.setTimeStep(dt, scene.client)
    scene.time_step, scene.time = dt, 0.0
    scene.world = bt.TendonWorld(scene.client, METHODS[method])
    tendon = scene.world.add_tendon([(0, 0, 0), (LENGTH, 0, 0)], RADIUS, MATERIALS[material], PARTICLES)
    tendon.grip(0)
    speed = np.zeros((PARTICLES, 3))
    speed[PARTICLES // 3 : 2 * PARTICLES // 3, 2] = STRIKE
    tendon.set_positions(tendon.positions, speed)
    return tendon


def _energy(tendon) -> float:
    """Elastic, kinetic and potential energy [J], the last against the height of the held end."""
    with np.errstate(all="ignore"):
        return tendon.energy + GRAVITY * float(tendon.masses @ tendon.positions[:, 2])


def _ladder() -> np.ndarray:
    """Time steps at all of which the default has to be stable [s]."""
    return np.geomspace(SMALLEST["default"], LARGEST, 25)


def _limit(scene, material, method) -> float:
    """The largest stable time step [s], at most LARGEST; 0 where even the first one tried is not stable."""
    low, high = 0.0, SMALLEST[method]
    while _tried(scene, material, method, high):
        if high == LARGEST:
            return LARGEST
        low, high = high, min(2 * high, LARGEST)
    for _ in range(BISECTIONS if low else 0):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if _tried(scene, material, method, middle) else (low, middle)
    return low


def _tried(scene, material, method, dt) -> bool:
    before = scene.steps
    result = stable(scene, material, method, dt)
    share = 1.0 if result else (scene.steps - before) / STEPS
    scene.record(f"{material}: {method}", share, at=np.log10(dt))
    return result


def _ratio(scene, material) -> None:
    explicit, implicit = (scene.measured[f"{material}: {m}"] for m in ("explicit", "published implicit"))
    scene.measure(f"{material}: published implicit / explicit", np.divide(implicit, explicit))


def _photograph(scene) -> None:
    """The scene itself, by the default at the paper's implicit time step."""
    _place(scene, "axially damped tendon", "default", 0.05)
    for steps in (0, 4, 4, 52):
        for _ in range(steps):
            scene.step()
        scene.mark(f"{scene.time:.2f} s, in steps of 0.05 s")
