"""The scene of call and speed: a tendon that is held at one end swings with a weight at the other."""

import numpy as np
import pybullet as p
from bullet_tendon.scenarios.scene import Scene

import bullet_tendon as bt

LENGTH, RADIUS = 0.3, 0.004  # m
STIFFNESS, EXPONENT = 3e4, 2.0  # N, -
WEIGHT = 1.0  # kg
ANGLE = np.radians(60)  # of the tendon with the vertical at the start
GRAVITY = 9.81  # m/s^2
TIME_STEP = 1 / 240  # s
TOLERANCE = 1e-8
END = LENGTH * np.array([np.sin(ANGLE), 0.0, -np.cos(ANGLE)])  # of the tendon without load [m]


def scene() -> Scene:
    return Scene(time_step=TIME_STEP, gravity=-GRAVITY, solver=bt.SolverOptions(tolerance=TOLERANCE))


def add_tendon(scene, particles, radius=RADIUS, shear_share=0.0) -> bt.Tendon:
    """The tendon without load. shear_share: share of the stiffness in each shear spring."""
    material = bt.Material(stiffness=STIFFNESS, exponent=EXPONENT, shear_stiffness=shear_share * STIFFNESS)
    tendon = scene.world.add_tendon([(0, 0, 0), END], radius, material, particles)
    tendon.grip(0)
    return tendon


def attach_weight(scene, tendon) -> None:
    """Attach a body to the last particle, where that is."""
    at = tendon.positions[-1].tolist()
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=scene.client)
    body = p.createMultiBody(WEIGHT, shape, -1, at, physicsClientId=scene.client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=scene.client)
    tendon.attach(-1, body)
