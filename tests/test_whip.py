"""A stiff chain that is let go: it turns far within a step, cracks, and has to keep its swing."""

import math

import numpy as np
import pytest

import bullet_tendon as bt

LENGTH, MASS, STIFFNESS = 0.1, 0.005, 3e4  # m, kg, N
DT, DURATION = 1 / 240, 0.5  # s


def whip(world, radius, particles=60):
    """Horizontal, held at one end; its density is what gives it its mass."""
    density = MASS / (math.pi * radius**2 * LENGTH)
    material = bt.Material(stiffness=STIFFNESS, damping=1e-4 * STIFFNESS, density=density)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], radius, material, particles)
    t.grip(0)
    return t


def released(make_world, radius, finer=1, **options):
    """The tip at the end, and iterations and parts of every step."""
    world = make_world(DT / finer, (0, 0, -9.81), **options)
    t = whip(world, radius)
    iterations, parts = [], []
    for _ in range(round(DURATION / DT) * finer):
        world.step()
        assert world.report.converged
        iterations.append(world.report.iterations)
        parts.append(world.report.counts["substeps"])
    return t.positions[-1], np.array(iterations), np.array(parts)


@pytest.mark.parametrize("radius", [1e-4, 3.8e-3])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_steps_that_turn_far_take_few_iterations(make_world, radius, integrator):
    _, iterations, parts = released(make_world, radius, integrator=integrator)
    assert np.median(iterations) <= 3
    whole = iterations[parts == 1]
    assert len(whole) > 80  # the others are the crack, where it passes itself by its own thickness
    assert whole.max() <= 10


def test_two_stages_keep_the_swing(make_world):
    """The tip is off by at most a fifth of one linearisation a step. (As thick as its mass would make
    it of tendon, it strikes itself, and the error is that of the impact.)"""
    radius = 1e-4
    exact, *_ = released(make_world, radius, finer=64, integrator="tr_bdf2")
    once, *_ = released(make_world, radius, iteration="single")
    tip, *_ = released(make_world, radius, integrator="tr_bdf2")
    assert np.linalg.norm(tip - exact) <= 0.2 * np.linalg.norm(once - exact)


@pytest.mark.parametrize("held", [(), (0,), (4,), (0, 11), (3, 8)])
def test_what_is_held_stays_and_momentum_is_kept(make_world, client, held):
    """Spinning by half a radian a step: kept lengths shift nothing that is held, and no centre of mass."""
    world = make_world(DT, tolerance=1e-12)
    t = whip(world, 1e-3, 12)
    for grip in t.holds:
        grip.release()
    x = t.positions
    spin = np.cross([0, 0, 120.0], x - x[held[0] if held else 0])
    if len(held) < 2:
        t.set_positions(x, spin)
    grips = [t.grip(i) for i in held]
    if len(held) == 2:
        grips[1].target = x[held[1]] + [-0.01, 0.02, 0]
    momentum = t.masses @ t.velocities
    for _ in range(20):
        world.step()
        assert world.report.converged
        change = t.masses @ t.velocities - momentum
        momentum = momentum + change
        pulled = sum((g.force for g in grips), np.zeros(3)) * DT
        np.testing.assert_allclose(change, -pulled, atol=1e-9 * (1e-3 + np.abs(pulled).max()))
    for i, grip in zip(held, grips, strict=True):
        np.testing.assert_allclose(t.positions[i], grip.target, atol=1e-15)
