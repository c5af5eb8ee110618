"""Steps that are taken in parts: what bodies feel, and that nothing is made of a tangle."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import cube, free_ball, mesh_obstacle

import bullet_tendon as bt


@pytest.mark.parametrize("off", [-0.004, 0.004, 0.008])
@pytest.mark.parametrize("stiffness", [1e3, 1e5])
def test_a_tendon_off_its_body_is_drawn_back_the_same_in_parts(client, make_world, off, stiffness):
    """By m off/dt^2, however many parts the step is taken in because something smooth is near."""
    world = make_world()
    body = free_ball(client, 0.3, radius=0.02)
    mesh_obstacle(world, client, *cube(0.05, at=(0.1, 0, -0.032)))
    t = world.add_tendon([[0, 0, 0.02], [0.3, 0, 0.02]], 0.001, bt.Material(stiffness=stiffness), 10)
    hold = t.attach(0, body, -1, [0, 0, 0.02])
    t.set_positions(t.positions + [off, 0, 0])
    world.step()
    assert world.report.counts["substeps"] > 1
    assert hold.force[0] == pytest.approx(t.masses.sum() * off * 240**2, rel=0.03)


def released(client, world, rng):
    """A body that a constraint held against a taut tendon, about a point beside its middle; let go."""
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.014, 0.008], physicsClientId=client)
    mass, length = 10 ** rng.uniform(-2, 0), rng.uniform(0.2, 0.4)
    offset = {"baseInertialFramePosition": (0.006, 0.002, 0.003), "physicsClientId": client}
    body = p.createMultiBody(mass, box, **offset)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    at = np.array(p.getBasePositionAndOrientation(body, client)[0])
    held = p.createConstraint(
        body, -1, -1, -1, p.JOINT_POINT2POINT, *[(0, 0, 0)] * 2, at, physicsClientId=client
    )
    along = rng.normal(size=3)
    along *= length / np.linalg.norm(along)
    material = bt.Material(stiffness=10 ** rng.uniform(3, 4), tension_only=bool(rng.integers(2)))
    t = world.add_tendon([at, at + along], 0.0005, material, 33)
    t.attach(0, body)
    t.grip(-1, target=at + (1 + rng.choice([0.05, 0.15])) * along)
    world.step(60)
    p.removeConstraint(held, client)
    return t, body, mass


# The tension of the last two hardly changes while the body is held.
@pytest.mark.parametrize(
    "seeds", [range(9), (66, 72), pytest.param(range(9, 240, 3), marks=pytest.mark.slow)]
)
def test_a_released_body_that_flies_into_its_slack_tendon_gains_nothing(client, make_world, seeds):
    """The tendon tangles between body and hand. Linear energy of the body, and the tendon's.

    BDF2 goes on for a step where the tension ends: by that it can gain up to 5 %.
    """
    for seed in seeds:
        p.resetSimulation(physicsClientId=client)
        dt = [1 / 500, 1 / 240, 1 / 60][seed // 3 % 3]
        integrator, bound = [("implicit_euler", 1.02), ("bdf2", 1.05)][seed % 2]
        world = make_world(dt, integrator=integrator)
        p.setPhysicsEngineParameter(numSubSteps=3, physicsClientId=client)
        t, body, mass = released(client, world, np.random.default_rng(seed))
        stored, most = t.energy, 0.0
        for _ in range(int(0.4 / dt)):
            world.step()
            v = np.array(p.getBaseVelocity(body, client)[0])
            most = max(most, 0.5 * mass * v @ v + t.energy)
        assert most <= bound * stored, seed
