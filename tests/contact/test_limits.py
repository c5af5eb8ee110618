"""Friction limits that go with the step: sliding takes hardly more iterations than no friction does."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, CORE = 0.002, 0.032  # m; of the tendon, and of its centreline over the cylinder


def drum(client, mass):
    """A cylinder that is static, or (mass [kg] above 0) a body that a pybullet constraint holds."""
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=CORE - RADIUS, height=0.2, physicsClientId=client)
    body = p.createMultiBody(mass, shape, physicsClientId=client)
    if mass > 0:
        at = [0, 0, 0]
        p.createConstraint(body, -1, -1, -1, p.JOINT_FIXED, at, at, at, physicsClientId=client)
    return body


def drawn(world, client, mass, friction, particles):
    """A tendon over half a drum, loaded at one end; and the hand that draws at the other."""
    world.add_obstacle(drum(client, mass), friction=1.0)
    turned = np.radians(np.arange(0, 181, 5))
    arc = CORE * np.c_[np.cos(turned), np.sin(turned), 0 * turned]
    line = np.vstack([[CORE, -0.03, 0], arc, [-CORE, -0.03, 0]])
    material = bt.Material(stiffness=3e4, damping=3.0, friction=friction)
    t = world.add_tendon(line, RADIUS, material, particles)
    t.set_force(0, (0, -5.0, 0))
    return t.grip(-1)


# Measured: 3.2 to 5.2; limits that follow forces from one iteration to the next: 10 to 20.
@pytest.mark.parametrize("mass", [0.0, 5.0])
@pytest.mark.parametrize("particles", [41, 81])
@pytest.mark.parametrize("friction", [0.3, 1.0])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_sliding_takes_few_iterations(make_world, client, integrator, friction, particles, mass):
    world = make_world(integrator=integrator)
    hand = drawn(world, client, mass, friction, particles)
    iterations = []
    for _ in range(80):
        hand.target = hand.target + (0, -1e-4, 0)
        world.step()
        assert world.report.converged
        iterations.append(world.report.iterations)
    assert np.mean(iterations[20:]) < 7
    c = world.contacts[world.contacts["normal_force"] > 1e-3]
    np.testing.assert_allclose(c["friction_force"], friction * c["normal_force"], rtol=1e-5)
