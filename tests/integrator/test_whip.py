"""A stiff chain that is let go: it turns far within a step, cracks, and has to keep its swing."""

import math

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

LENGTH, MASS, STIFFNESS = 0.1, 0.005, 3e4  # m, kg, N
DT, DURATION = 1 / 240, 0.5  # s


def whip(world, radius, particles=60, axis=0):
    """Along an axis, held at one end; its density is what gives it its mass."""
    density = MASS / (math.pi * radius**2 * LENGTH)
    material = bt.Material(stiffness=STIFFNESS, damping=1e-4 * STIFFNESS, density=density)
    t = world.add_tendon([[0, 0, 0], LENGTH * np.eye(3)[axis]], radius, material, particles)
    t.grip(0)
    return t


def released(make_world, radius, finer=1, axis=0, **options):
    """The tip at the end, and iterations and parts of every step."""
    world = make_world(DT / finer, tuple(np.roll([0, 0, -9.81], axis)), **options)
    t = whip(world, radius, axis=axis)
    iterations, parts = [], []
    for _ in range(round(DURATION / DT) * finer):
        world.step()
        assert world.report.converged
        assert finer > 1 or "iteration" in options or world.report.residual <= 1e-8
        iterations.append(world.report.iterations)
        parts.append(world.report.counts["substeps"])
    return t.positions[-1], np.array(iterations), np.array(parts)


@pytest.mark.parametrize("radius", [1e-4, 3.8e-3])
def test_steps_that_turn_far_take_few_iterations(make_world, radius):
    """The crack as well, where segments pass each other and turn by more than a right angle a step."""
    _, iterations, parts = released(make_world, radius)
    assert np.median(iterations) <= 3
    assert iterations.max() <= 10
    assert parts.max() == 1


def test_every_axis_takes_as_many_iterations(make_world):
    """The whip along x with gravity along z, along y with gravity along x, along z with gravity along y."""
    totals = [released(make_world, 1e-4, axis=axis)[1].sum() for axis in range(3)]
    np.testing.assert_allclose(totals, totals[0], rtol=0.03)


@pytest.mark.parametrize("radius", [1e-4, 3.8e-3])
def test_second_order_takes_few_iterations(make_world, radius):
    """All parts of a step together, those in which it strikes itself (it does, as thick as tendon is) too."""
    _, iterations, parts = released(make_world, radius, integrator="bdf2")
    assert np.median(iterations) <= 3
    assert iterations.max() <= 30
    assert 1 < parts.max() <= 3
    assert np.sum(parts > 1) <= 20


@pytest.mark.parametrize(
    ("integrator", "radius", "share"),
    [("bdf2", 3.8e-3, 0.1), ("bdf2", 1e-4, 0.2)],
)
def test_the_swing_is_kept(make_world, radius, share, integrator):
    """The tip is off by at most that share of one linearisation a step. (As thin as a wire, its second
    crack magnifies what is off before by hundreds.)"""
    exact, *_ = released(make_world, radius, finer=256, integrator="bdf2")
    once, *_ = released(make_world, radius, iteration="single")
    tip, *_ = released(make_world, radius, integrator=integrator)
    assert np.linalg.norm(tip - exact) <= share * np.linalg.norm(once - exact)


def test_what_only_turns_or_passes_by_is_not_split(make_world):
    """Faster than its radius a step: a bent tendon that spins, and one that flies by another."""
    world = make_world(DT, integrator="bdf2")
    bend = np.array([[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0]])
    material = bt.Material(stiffness=STIFFNESS, damping=1e-4 * STIFFNESS)
    turning = world.add_tendon(bend, 1e-4, material, 13)
    x = turning.positions
    turning.set_positions(x, np.cross([0, 0, 30.0], x - x.mean(0)))
    passing = [world.add_tendon([[0, 1, z], [0.1, 1, z]], 1e-4, material, 13) for z in (0, 0.001)]
    x = passing[1].positions
    passing[1].set_positions(x, np.full_like(x, [3.0, 0, 0]))
    for _ in range(20):
        world.step()
        assert world.report.converged
        assert world.report.counts["substeps"] == 1
        assert world.report.iterations <= 10


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


def test_a_turned_scene_cracks_alike(make_world, client):
    """Parts of steps and contacts do not depend on the axes: 0.25 s, with the first crack."""
    turn = np.array(p.getMatrixFromQuaternion(p.getQuaternionFromEuler([0.7, -0.4, 1.1]))).reshape(3, 3)
    found = []
    for axes in (np.eye(3), turn):
        world = make_world(DT, axes @ [0, 0, -9.81], integrator="bdf2")
        t = whip(world, 1e-4)
        t.set_positions(t.positions @ axes.T)
        world.step(60)
        found.append(t.positions @ axes)
    assert np.abs(found[0] - found[1]).max() <= 1e-7 * LENGTH
