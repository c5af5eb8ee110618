"""Steps that Newton's method does not solve in its iterations, and that cannot be cut any further."""

import math

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball

import bullet_tendon as bt


@pytest.mark.parametrize("seed", [0, 1])
def test_descent_from_a_tangled_start_takes_a_bounded_effort(make_world, seed):
    """Particles are put 50 mm (by standard deviation) from a line with 12.5 mm segments. A substep has 12
    iterations. Descent has to end each of the smallest substeps near a minimum, so that the next are easier.
    """
    random = np.random.default_rng(seed)
    world = make_world(1 / 240, (0, 0, -9.81), max_iterations=12)
    law = {"stiffness": 3e5, "exponent": 2.0, "tension_only": bool(seed), "bending_stiffness": 1e-3}
    t = world.add_tendon([[0, 0, 0], [0.3, 0, 0]], 0.002, bt.Material(**law), 25)
    t.grip(0), t.grip(-1)
    t.set_positions(t.positions + 0.05 * random.normal(size=(25, 3)))
    world.step()
    assert np.isfinite(t.positions).all()
    assert world.report.counts["substeps"] > 30
    assert not world.report.over_budget


@pytest.mark.parametrize("mass", [0.006, 0.02])
def test_a_strand_whose_damping_holds_its_force_at_zero_is_solved(make_world, client, mass):
    """A stretched strand is let go with a light body. Damping takes the elastic force: all springs are where
    their force begins. Particles must not yield across the strand as if it were slack.
    """
    p.setTimeStep(1 / 250)
    p.setGravity(0, 0, 0)
    world = make_world()
    sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01)
    body = p.createMultiBody(mass, sphere, -1, (0.10125, 0, 0))
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)
    held = p.createConstraint(body, -1, -1, -1, p.JOINT_FIXED, (0, 0, 0), (0, 0, 0), (0.10125, 0, 0))
    p.changeConstraint(held, maxForce=1e5)
    material = bt.Material(stiffness=1.125e6, exponent=2, toe_strain=0.03, tension_only=True, damping=202.5)
    tendon = world.add_tendon([(0, 0, 0), (0.10125, 0, 0)], 0.0005, material, 29, rest_length=0.1)
    tendon.grip(0)
    tendon.attach(-1, body)
    world.step(20)
    p.setGravity(0, 0, -9.81)
    p.removeConstraint(held)
    for _ in range(60):
        world.step()
        assert world.report.converged and world.report.iterations < 50
        assert tendon.tension.min() >= 0


@pytest.mark.parametrize(
    ("mass", "stiffness", "particles", "step", "length", "drop"),
    [
        (8, 2e3, 41, 1 / 240, 0.15, 0.4),
        (50, 2e4, 21, 1 / 240, 0.1, 0.7),
        (90, 2.3e4, 21, 1 / 212, 0.094, 0.78),
    ],
)
def test_steps_in_which_a_thread_buckles_converge(
    make_world, client, mass, stiffness, particles, step, length, drop
):
    """A ball falls into a slack thread, which resists compression, and comes back up under it. The thread is
    straight to rounding: a saddle of the potential, near which the residual is small.
    """
    world = make_world(step, (0, 0, -9.81))
    material = bt.Material(stiffness=stiffness, density=1000.0)
    t = world.add_tendon([[0, 0, 0], [0, 0, -length]], 5e-4, material, particles)
    t.grip(0)
    top = -length * (1 - drop)
    ball = free_ball(client, mass, at=(0, 0, -length))
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0)
    t.attach(-1, ball)
    side = np.interp(np.linspace(0, 1, particles), [0, 0.5, 1], [0, 0.5 * math.sqrt(length**2 - top**2), 0])
    t.set_positions(np.c_[side, 0 * side, np.linspace(0, top, particles)])
    p.resetBasePositionAndOrientation(ball, [0, 0, top], [0, 0, 0, 1])
    solves = 0
    for _ in range(140):
        world.step()
        assert world.report.converged
        solves += world.report.counts["linear_solves"]
    assert solves < 3000


@pytest.mark.parametrize("step", [1 / 1000, 1 / 240, 1 / 60])
@pytest.mark.parametrize(("stiffness", "particles", "mass"), [(5e4, 30, 0.5), (1e3, 30, 0.5), (5e4, 10, 5.0)])
def test_what_hangs_on_a_straight_thread_is_thrown_as_high_as_without_it(
    make_world, client, stiffness, particles, mass, step
):
    """The thread is straight to the last bit and resists compression: it buckles all the same."""
    world = make_world(step, (0, 0, -9.81))
    t = world.add_tendon([[0, 0, 1], [0, 0, 0.6]], 1e-3, bt.Material(stiffness=stiffness), particles)
    t.grip(0)
    ball = free_ball(client, mass, at=(0, 0, 0.6))
    t.attach(-1, ball)
    world.step(round(0.25 / step))
    start = p.getBasePositionAndOrientation(ball, client)[0][2]
    p.resetBaseVelocity(ball, [0, 0, 2.0], physicsClientId=client)
    heights = []
    for _ in range(round(0.3 / step)):
        world.step()
        assert world.report.converged
        heights.append(p.getBasePositionAndOrientation(ball, client)[0][2])
    # pybullet's velocity is that of the end of the step: it is lower by 2 dt / 2. The thread's mass slows it.
    assert max(heights) - start == pytest.approx(2.0**2 / 2 / 9.81, abs=1.5 * step + 0.01)
