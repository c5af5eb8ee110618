"""Bending stiffness against beams, the elastica and finite differences."""

import numpy as np
import pybullet as p
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bullet_tendon as bt

EI, LENGTH, STIFFNESS = 1e-3, 0.3, 3e6


def beam(world, n):
    """A beam along x, clamped at its first particle."""
    material = bt.Material(stiffness=STIFFNESS, bending_stiffness=EI)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], 0.004, material, n)
    t.grip(0, direction=(1, 0, 0))
    return t


def deflection(world, n, load) -> float:
    t = beam(world, n)
    t.set_force(-1, (0, 0, -load))
    world.relax(1e-10)
    assert world.report.converged
    return -t.positions[-1, 2]


def test_cantilever_is_second_order(make_world):
    """P L^3 / (3 EI) for a small load."""
    load = 1e-3 * EI / LENGTH**2
    exact = load * LENGTH**3 / (3 * EI)
    errors = [abs(deflection(make_world(), n, load) / exact - 1) for n in (15, 30, 60)]
    assert errors[-1] <= 0.005
    assert np.log2(errors[0] / errors[1]) >= 1.9


@pytest.mark.parametrize(("load", "exact"), [(1, 0.3017), (2, 0.4935), (5, 0.7138), (10, 0.8106)])
def test_elastica(make_world, load, exact):
    """w/L at P L^2/EI (Mattiasson 1981)."""
    assert deflection(make_world(), 60, load * EI / LENGTH**2) / LENGTH == pytest.approx(exact, rel=0.01)


def test_time_stepping_ends_in_the_same_shape(make_world):
    """Every method, from rest, with long implicit steps."""
    shapes = []
    for options in ({}, {"integrator": "bdf2"}, {"iteration": "single"}, {"linear_solver": "pcg"}):
        world = make_world(0.5, **options)
        t = beam(world, 20)
        t.set_force(-1, (0, 0, -EI / LENGTH**2))
        world.step(400)
        shapes.append(t.positions)
    for shape in shapes[1:]:
        assert np.abs(shape - shapes[0]).max() <= 1e-6 * LENGTH


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10**6))
def test_forces_are_the_energys_gradient(make_world, seed):
    """Grips on every particle feel -dE/dx, by finite differences, at random shapes."""
    world = make_world(1e4)
    n, h = 6, 1e-6
    shape = np.cumsum(np.random.default_rng(seed).normal(size=(n, 3)), axis=0) * 0.02
    spaced = np.column_stack([np.arange(n) * 0.02, np.zeros((n, 2))])
    t = world.add_tendon(spaced, 1e-4, bt.Material(stiffness=1e-9, bending_stiffness=EI))
    gradient = np.zeros((n, 3))
    for i, c in np.ndindex(n, 3):
        for sign in (1, -1):
            moved = shape.copy()
            moved[i, c] += sign * h
            t.set_positions(moved)
            gradient[i, c] += sign * t.energy / (2 * h)
    t.set_positions(shape)
    grips = [t.grip(i) for i in range(n)]
    world.step()
    forces = np.array([g.force for g in grips])
    assert np.abs(forces + gradient).max() <= 1e-5 * np.abs(gradient).max()


def test_newton_converges_fast_with_the_full_hessian(make_world):
    """A strongly bent beam in few iterations: the second derivatives are right."""
    world = make_world()
    deflection(world, 60, 10 * EI / LENGTH**2)
    assert world.report.iterations <= 15


@pytest.mark.parametrize("collides", [False, True])
@pytest.mark.parametrize("force", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("stiffness", [1e-5, 1e-4, 1e-3, 1e-1])
def test_a_tendon_folds_over_a_hand(make_world, stiffness, force, collides):
    """A graft that carries no compression is held at its middle, and its ends are pulled down. It comes to
    rest with half of each pull on either side of the hand, and each leg near its length."""
    world = make_world()
    material = bt.Material.preset("hamstring_graft", damping=0.0, bending_stiffness=stiffness)
    t = world.add_tendon([[-0.08, 0, 0], [0.08, 0, 0]], 0.004, material, 60, collides=collides)
    hand = t.grip(30)
    for end in (0, -1):
        t.set_force(end, [0, 0, -force])
    for _ in range(240):
        world.step()
        assert world.report.converged
        assert world.report.iterations <= 150
    np.testing.assert_allclose(hand.force, [0, 0, -2 * force], atol=0.05 * force)  # it swings a little
    assert t.length == pytest.approx(0.16, rel=0.02)


def test_momentum_of_a_free_beam(make_world):
    world = make_world(1 / 240)
    t = beam(world, 20)
    next(iter(t._anchors.values())).release()
    v = np.zeros((20, 3))
    v[:, 2] = np.linspace(-1, 2, 20) ** 2
    t.set_positions(t.positions, v)
    before = t.masses @ t.velocities
    world.step(200)
    np.testing.assert_allclose(t.masses @ t.velocities, before, rtol=0, atol=1e-12)


def test_refused_clamps(make_world):
    world = make_world()
    t = beam(world, 10)
    with pytest.raises(bt.InvalidValue, match="direction"):
        t.grip(3, direction=(1, 0, 0))
    with pytest.raises(bt.InvalidValue, match="direction"):
        t.grip(-1, direction=(0, 0, 0))
    t.grip(3), t.grip(-1)  # nothing was left by the refused calls
    soft = world.add_tendon([[0, 1, 0], [1, 1, 0]], 0.01, bt.Material(stiffness=1.0), 5)
    with pytest.raises(bt.InvalidValue, match="direction"):
        soft.grip(0, direction=(1, 0, 0))
    assert p.isConnected(world.physicsClientId)
