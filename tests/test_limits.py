"""Friction limits that go with the step: sliding takes hardly more iterations than no friction does."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, CORE = 0.002, 0.032  # m; of the tendon, and of its centreline over the cylinder


def drawn(world, client, friction, particles):
    """A tendon over half a cylinder, loaded at one end; and the hand that draws at the other."""
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=CORE - RADIUS, height=0.2, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, physicsClientId=client), friction=1.0)
    turned = np.radians(np.arange(0, 181, 5))
    arc = CORE * np.c_[np.cos(turned), np.sin(turned), 0 * turned]
    line = np.vstack([[CORE, -0.03, 0], arc, [-CORE, -0.03, 0]])
    material = bt.Material(stiffness=3e4, damping=3.0, friction=friction)
    t = world.add_tendon(line, RADIUS, material, particles)
    t.set_force(0, (0, -5.0, 0))
    return t.grip(-1)


# Measured with 61 particles: 3.4 to 4.3; limits that follow forces from one iteration to the next: 15 to 17.
@pytest.mark.parametrize("particles", [41, 81])
@pytest.mark.parametrize("friction", [0.3, 1.0])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_sliding_takes_few_iterations(make_world, client, integrator, friction, particles):
    world = make_world(integrator=integrator)
    hand = drawn(world, client, friction, particles)
    iterations = []
    for _ in range(80):
        hand.target = hand.target + (0, -1e-4, 0)
        world.step()
        assert world.report.converged
        iterations.append(world.report.iterations)
    assert np.mean(iterations[20:]) < 7
    c = world.contacts[world.contacts["normal_force"] > 1e-3]
    np.testing.assert_allclose(c["friction_force"], friction * c["normal_force"], rtol=1e-5)
