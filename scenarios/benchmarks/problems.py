"""What work_precision solves: tendons that move in a plane, and their references by scipy.

The tendons are thin, with the density that gives them their mass, so that they do not touch themselves.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

from . import cylinder
from .chain_ode import GRAVITY, PLANE, ChainOde

RADIUS = 1e-4  # m
LENGTH = 0.3  # m
TENDON = 0.0169  # kg: 0.3 m of a tendon of radius 4 mm and 1120 kg/m^3
STIFF = 3e4  # N
BOB = 1.0  # kg
ANGLE = math.radians(60)  # of the pendulum with the vertical at the start
DAMPING_TIME = 1e-4  # s: damping over stiffness, of the stiff tendons
WHIP = {"length": 0.1, "mass": 0.005}  # m, kg
SPRING = {"stiffness": 30.0, "amplitude": 0.03}  # N, m
STRING = {"stiffness": 300.0, "strain": 0.05, "pluck": 0.001}  # N, -, m
SAMPLES = 8  # times at which a solution is compared


@dataclasses.dataclass(frozen=True)
class Problem:
    """A tendon released at time 0.

    build: puts it into a scene, and returns it. scale [m]: what errors are relative to. duration [s].
    held: its gripped particles; bob: the body on the last one, if any [kg]. coarsest: steps, at least.
    options: of the solver, for every method. contact: forces of what it touches (x, v, softer).
    reference: scipy's method, and its relative tolerance.
    """

    name: str
    build: Callable
    scale: float
    duration: float
    held: tuple[int, ...]
    reference: tuple[str, float]
    gravity: float = 0.0
    bob: float = 0.0
    contact: Callable | None = None
    options: dict = dataclasses.field(default_factory=dict)
    coarsest: int = 4 * SAMPLES

    def scene(self, time_step, solver=None) -> Scene:
        solver = dataclasses.replace(solver or bt.SolverOptions(), **self.options)
        return Scene(time_step=time_step, gravity=self.gravity, solver=solver)

    def start(self, scene):
        """The tendon in the scene, ready for its first step."""
        tendon = self.build(scene)
        for particle in self.held:
            tendon.grip(particle)
        return tendon

    def ode(self, tendon, softer: float = 1.0) -> ChainOde:
        """The same tendon's equations; the bob is part of the last particle. softer: contacts."""
        masses = tendon.masses
        masses[-1] += self.bob
        rest = np.full(tendon.particles - 1, tendon.rest_length / (tendon.particles - 1))
        contact = self.contact and (lambda x, v: self.contact(x, v, softer))
        return ChainOde(masses, rest, tendon.material, self.held, self.gravity, contact)

    def solution(self, coarser: float = 1.0) -> np.ndarray:
        """(SAMPLES, n, 2) the reference [m]; coarser: factor of its tolerance, and softer contacts."""
        method, tolerance = self.reference
        times = self.duration * np.arange(1, SAMPLES + 1) / SAMPLES
        with self.scene(self.duration) as scene:
            tendon = self.start(scene)
            x = tendon.positions[:, PLANE]
            return self.ode(tendon, coarser).solve(x, np.zeros_like(x), times, method, coarser * tolerance)


def _tendon(scene, end, particles, length, mass, **material):
    density = mass / (math.pi * RADIUS**2 * length)
    return scene.world.add_tendon(
        [(0, 0, 0), end], RADIUS, bt.Material(density=density, **material), particles
    )


def _pendulum(scene):
    """At rest at 60 degrees, as long as the bob's weight along it makes it; the bob is a point mass."""
    end, stretch = _hanging_end()
    tendon = _tendon(scene, end, 12, LENGTH, TENDON, stiffness=STIFF, damping=DAMPING_TIME * STIFF)
    tendon.set_point_mass(-1, BOB)
    tendon.set_positions(stretch * tendon.positions)
    return tendon


def _pendulum_with_body(scene):
    """The same with a pybullet body as its bob, which pybullet's own first-order integrator moves."""
    end, stretch = _hanging_end()
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=scene.client)
    bob = p.createMultiBody(BOB, shape, -1, (stretch * end).tolist(), physicsClientId=scene.client)
    p.changeDynamics(bob, -1, linearDamping=0, angularDamping=0, physicsClientId=scene.client)
    tendon = _tendon(scene, end, 12, LENGTH, TENDON, stiffness=STIFF, damping=DAMPING_TIME * STIFF)
    tendon.set_positions(stretch * tendon.positions)
    tendon.attach(-1, bob, position=(0, 0, 0))
    return tendon


def _hanging_end():
    """Where it ends without load (3,) [m], and by how much the bob's weight along it stretches it [-]."""
    end = LENGTH * np.array([math.sin(ANGLE), 0.0, -math.cos(ANGLE)])
    return end, 1 + BOB * GRAVITY * math.cos(ANGLE) / STIFF


def _whip(scene):
    law = {"stiffness": STIFF, "damping": DAMPING_TIME * STIFF}
    return _tendon(scene, (WHIP["length"], 0, 0), 20, WHIP["length"], WHIP["mass"], **law)


def _oscillator(scene):
    law = {"stiffness": SPRING["stiffness"], "exponent": 2.0}
    tendon = _tendon(scene, (LENGTH, 0, 0), 2, LENGTH, TENDON, **law)
    tendon.set_positions([(0, 0, 0), (LENGTH + SPRING["amplitude"], 0, 0)])
    return tendon


def _string(scene):
    """Pulled aside to half a wave of a sine."""
    tendon = _tendon(scene, (LENGTH, 0, 0), 20, LENGTH, TENDON, stiffness=STRING["stiffness"])
    x = tendon.positions
    x[:, 2] = STRING["pluck"] * np.sin(math.pi * x[:, 0] / LENGTH)
    x[:, 0] *= 1 + STRING["strain"]
    x[-1, 2] = 0.0
    tendon.set_positions(x)
    return tendon


def oscillator_period() -> float:
    """Period [s] of the oscillator: an exact formula for a power law."""
    exponent, mass = 2.0, TENDON / 2
    constant = SPRING["stiffness"] / LENGTH**exponent
    gammas = math.gamma(1 / (exponent + 1)) / math.gamma(1 / (exponent + 1) + 0.5)
    shape = math.sqrt(math.pi) / (exponent + 1) * gammas
    size = SPRING["amplitude"] ** ((1 - exponent) / 2)
    return 4 * math.sqrt((exponent + 1) * mass / (2 * constant)) * size * shape


PROBLEMS = (
    Problem("stiff pendulum", _pendulum, LENGTH, 1.0, (0,), ("Radau", 1e-7), -GRAVITY),
    Problem(
        "pendulum with a pybullet bob",
        _pendulum_with_body,
        LENGTH,
        1.0,
        (0,),
        ("Radau", 1e-7),
        -GRAVITY,
        BOB,
    ),
    Problem("released whip", _whip, WHIP["length"], 0.2, (0,), ("Radau", 1e-7), -GRAVITY, coarsest=SAMPLES),
    Problem("power-law oscillator", _oscillator, SPRING["amplitude"], 1.0, (0,), ("DOP853", 1e-12)),
    Problem("plucked string", _string, STRING["pluck"], 0.1, (0, -1), ("DOP853", 1e-9), coarsest=SAMPLES),
    Problem(
        "over a cylinder",
        cylinder.build,
        cylinder.LENGTH,
        cylinder.DURATION,
        (),
        ("Radau", 1e-7),
        -GRAVITY,
        contact=cylinder.contact_forces,
        options={"reuse_tolerance": 0.0},  # a plane that is used again is tilted, which pulls like friction
    ),
)
