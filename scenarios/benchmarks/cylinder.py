"""A tendon with a weight at either end slides over a fixed cylinder, without friction.

In the core the cylinder is a pybullet body, contacts are unilateral constraints. The reference takes the same
particles and segments and the limit of that: a stiff, damped spring wherever a particle, or the
inside of a segment, is nearer to the axis than it may be. What its stiffness leaves is part of the
reference's error, as work_precision prints it.
"""

import math

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .chain_ode import GRAVITY

LENGTH, MASS, STIFFNESS, DAMPING = 0.3, 0.0169, 1000.0, 0.1  # m, kg, N, N s
WEIGHTS = (0.1, 0.2)  # kg, left and right
RADIUS, CYLINDER, WIDTH = 0.004, 0.03, 0.1  # m: of tendon and cylinder; the cylinder's length
CLEAR = RADIUS + CYLINDER
PARTICLES, DURATION = 21, 0.15  # -, s
SPRING, DASHPOT = 8e6, 80.0  # N/m, N s/m: of the reference's contacts


def build(scene):
    """The tendon on its cylinder in a scene, stretched as the weights will stretch it once they move."""
    shape = p.createCollisionShape(
        p.GEOM_CYLINDER, radius=CYLINDER, height=WIDTH, physicsClientId=scene.client
    )
    upright = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
    body = p.createMultiBody(0, shape, -1, (0, 0, 0), upright, physicsClientId=scene.client)
    scene.world.add_obstacle(body)
    density = MASS / (math.pi * RADIUS**2 * LENGTH)
    material = bt.Material(stiffness=STIFFNESS, damping=DAMPING, density=density, friction=0.0)
    straight = np.zeros((PARTICLES, 3))
    straight[:, 0] = np.linspace(0, LENGTH, PARTICLES)
    tendon = scene.world.add_tendon(straight, RADIUS, material)
    for end, weight in zip((0, -1), WEIGHTS, strict=True):
        tendon.set_point_mass(end, weight)
    tendon.set_positions(_start())
    return tendon


def _start() -> np.ndarray:
    """(n, 3) [m]: a polygon whose inner segments touch the cylinder, and straight down on both sides."""
    left, right = WEIGHTS
    strain = 2 * left * right * GRAVITY / (left + right) / STIFFNESS
    edge = LENGTH / (PARTICLES - 1) * (1 + strain)
    turn = 2 * math.atan2(edge / 2, CLEAR)
    around = int(math.pi / turn)
    angles = math.pi / 2 + turn * (around / 2 - np.arange(around + 1))
    arc = math.hypot(CLEAR, edge / 2) * np.column_stack([np.cos(angles), 0 * angles, np.sin(angles)])
    before = (PARTICLES - 1 - around) // 2
    down = edge * np.array([0, 0, -1.0])
    first = arc[0] + np.arange(before, 0, -1)[:, None] * down
    last = arc[-1] + np.arange(1, PARTICLES - around - before)[:, None] * down
    return np.vstack([first, arc, last])


def contact_forces(x, v, softer: float = 1.0) -> np.ndarray:
    """(n, 2) [N] of the cylinder on particles x, v (n, 2) [m], [m/s]; softer: divides the stiffness."""
    force = _push(x, v, softer)
    edge = np.diff(x, axis=0)
    share = -np.einsum("ij,ij->i", x[:-1], edge) / np.einsum("ij,ij->i", edge, edge)
    inside = (share > 0) & (share < 1)
    share = np.where(inside, share, 0.0)[:, None]
    push = _push(x[:-1] + share * edge, v[:-1] + share * np.diff(v, axis=0), softer) * inside[:, None]
    force[:-1] += (1 - share) * push
    force[1:] += share * push
    return force


def _push(x, v, softer) -> np.ndarray:
    """(m, 2) [N] on points: none outside, and never inwards."""
    distance = np.linalg.norm(x, axis=1)
    out = x / distance[:, None]
    depth = CLEAR - distance
    push = SPRING / softer * depth - DASHPOT / math.sqrt(softer) * np.einsum("ij,ij->i", v, out)
    return (np.maximum(push, 0.0) * (depth > 0))[:, None] * out
