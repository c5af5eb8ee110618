"""One massless spring between a fixed point and a body: a tendon, and what users write by hand.

Both have the force K strain + C d(strain)/dt, pulling and pushing, and start at their rest length LENGTH
straight below (or above) the fixed point. Both act on the body's centre of mass, and end each step with
pybullet's own.
"""

import math

import numpy as np
import pybullet as p

import bullet_tendon as bt

LENGTH, RADIUS, DENSITY, PARTICLES = 0.2, 1e-4, 100.0, 10  # m, m, kg/m^3, -: 0.6 mg


class TendonSpring:
    """A tendon, stepped by its world with implicit Euler.

    anchor (3,) [m]: the fixed point; stiffness K [N], damping C [N s]; link: of `body`.
    """

    solver = bt.SolverOptions()

    def __init__(self, scene, anchor, body, link, stiffness, damping=0.0):
        self.world, self.anchor = scene.world, np.array(anchor, float)
        self.gravity = -p.getPhysicsEngineParameters(scene.client)["gravityAccelerationZ"]
        end = motion(body, link, scene.client)[0]
        material = bt.Material(stiffness=stiffness, damping=damping, density=DENSITY)
        self.tendon = scene.world.add_tendon([anchor, end], RADIUS, material, PARTICLES)
        self.hand = self.tendon.grip(0)
        self.knot = self.tendon.attach(-1, body, link)
        along = np.linspace(0, 1, PARTICLES)
        self.moving_mass = float(self.tendon.masses @ along**2)  # kg, as the body's: of a uniform stretch

    def step(self) -> None:
        self.world.step()

    def move_anchor(self, by) -> None:
        """by (3,) [m]."""
        self.anchor = self.anchor + by
        self.hand.target = self.anchor

    @property
    def tension(self) -> float:
        """Of the last step, at the body [N]."""
        along = self.anchor - self.tendon.positions[-1]
        return float(self.knot.force @ along / np.linalg.norm(along))

    @property
    def energy(self) -> float:
        """Elastic, and of the tendon's own motion and height [J]."""
        return self.tendon.energy + self.gravity * float(self.tendon.masses @ self.tendon.positions[:, 2])


class TwoStepSpring(TendonSpring):
    """A tendon, stepped with BDF2."""

    solver = bt.SolverOptions(integrator="bdf2")


class HandWrittenSpring:
    """An external force from where the body is before the step. The same arguments."""

    solver = bt.SolverOptions()
    moving_mass = 0.0

    def __init__(self, scene, anchor, body, link, stiffness, damping=0.0):
        self.body, self.link, self.client = body, link, scene.client
        self.anchor, self.stiffness, self.damping = np.array(anchor, float), stiffness, damping
        self.tension = 0.0

    def step(self) -> None:
        at, velocity = motion(self.body, self.link, self.client)
        along = at - self.anchor
        span = math.sqrt(along @ along)
        along /= span
        self.tension = (self.stiffness * (span - LENGTH) + self.damping * (velocity @ along)) / LENGTH
        force = (-self.tension * along).tolist()
        p.applyExternalForce(self.body, self.link, force, at.tolist(), p.WORLD_FRAME, self.client)
        p.stepSimulation(self.client)

    def move_anchor(self, by) -> None:
        """by (3,) [m]."""
        self.anchor = self.anchor + by

    @property
    def energy(self) -> float:
        """Elastic [J]."""
        span = np.linalg.norm(motion(self.body, self.link, self.client)[0] - self.anchor)
        return float(0.5 * self.stiffness / LENGTH * (span - LENGTH) ** 2)


METHODS = {"implicit Euler": TendonSpring, "BDF2": TwoStepSpring, "explicit force": HandWrittenSpring}


def motion(body, link, client) -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and velocity [m/s] (3,) of a link's centre of mass, world frame."""
    if link < 0:
        at, velocity = p.getBasePositionAndOrientation(body, client)[0], p.getBaseVelocity(body, client)[0]
    else:
        state = p.getLinkState(body, link, 1, 1, client)
        at, velocity = state[0], state[6]
    return np.array(at), np.array(velocity)
