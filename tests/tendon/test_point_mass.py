"""Weights on particles: in masses, gravity, momentum and energy, when reeled in, and what is refused."""

import math

import numpy as np
import pytest

import bullet_tendon as bt

LENGTH, RADIUS, STIFFNESS, GRAVITY = 0.3, 0.001, 3e4, 9.81


def straight(world, n=7, **material):
    law = {"stiffness": STIFFNESS, **material}
    return world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, bt.Material(**law), n)


def test_it_is_counted_until_it_is_set_again(make_world):
    t = straight(make_world(1e-3))
    bare = t.masses
    t.set_point_mass(-1, 1.5)
    t.set_point_mass(2, 0.25)
    np.testing.assert_allclose(t.masses - bare, [0, 0, 0.25, 0, 0, 0, 1.5], atol=1e-15)
    t.set_point_mass(2, 0.5)
    np.testing.assert_allclose(t.masses - bare, [0, 0, 0.5, 0, 0, 0, 1.5], atol=1e-15)
    t.set_point_mass(2, 0)
    t.set_point_mass(6, 0)
    np.testing.assert_array_equal(t.masses, bare)


@pytest.mark.parametrize("shear", [0.0, 0.1])
def test_a_hanging_weight_is_carried_by_what_is_above_it(make_world, shear):
    world = make_world(1 / 240, (0, 0, -GRAVITY))
    t = straight(world, exponent=2.0, shear_stiffness=shear * STIFFNESS)
    grip = t.grip(0)
    t.set_point_mass(3, 2.0)
    t.set_point_mass(-1, 1.0)
    world.relax(1e-10)
    below = np.cumsum(t.masses[::-1])[::-1]
    np.testing.assert_allclose(grip.force, [0, 0, -GRAVITY * below[0]], rtol=1e-8, atol=1e-8)
    if shear == 0:
        np.testing.assert_allclose(t.tension, GRAVITY * below[1:], rtol=1e-7)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_it_keeps_momentum_and_falls_like_everything(make_world, integrator):
    dt, steps = 1e-3, 40
    world = make_world(dt, (0, 0, -GRAVITY), integrator=integrator)
    t = straight(world, damping=1.0)
    t.set_point_mass(1, 0.7)
    velocities = np.random.default_rng(5).standard_normal((7, 3))
    t.set_positions(t.positions, velocities)
    momentum = t.masses @ velocities
    world.step(steps)
    expected = momentum - [0, 0, t.masses.sum() * GRAVITY * dt * steps]
    np.testing.assert_allclose(t.masses @ t.velocities, expected, atol=1e-7 * np.abs(expected).max())
    kinetic = 0.5 * t.masses @ (t.velocities**2).sum(axis=1)
    t.set_positions([[k * LENGTH / 6, 0, 0] for k in range(7)], t.velocities)
    assert t.energy == pytest.approx(kinetic, rel=1e-9)


def test_a_bob_swings_with_the_period_of_a_pendulum(make_world):
    """A light, stiff tendon with a bob: 2 pi sqrt(L/g) for small swings."""
    angle = 0.01
    period = 2 * math.pi * math.sqrt(LENGTH / GRAVITY)
    world = make_world(period / 400, (0, 0, -GRAVITY), integrator="bdf2")
    t = world.add_tendon(
        [[0, 0, 0], [LENGTH * math.sin(angle), 0, -LENGTH * math.cos(angle)]],
        1e-5,
        bt.Material(stiffness=1e7, damping=1e3),
        2,
    )
    t.grip(0)
    t.set_point_mass(1, 1.0)
    start = t.positions[1, 0]
    world.step(200)
    assert t.positions[1, 0] == pytest.approx(-start, rel=1e-3)
    world.step(200)
    assert t.positions[1, 0] == pytest.approx(start, rel=2e-3)


def test_it_stays_when_the_tendon_is_reeled_in(make_world):
    t = straight(make_world(1e-3))
    t.set_point_mass(-1, 1.0)
    t.set_point_mass(3, 0.5)
    linear = t.masses[0] * 2 * 6 / LENGTH
    t.shorten(0.02)
    assert t.masses.sum() == pytest.approx(1.5 + linear * (LENGTH - 0.02), rel=1e-12)
    assert t.masses[-1] > 1.0
    t.shorten(-0.02)
    assert t.masses.sum() == pytest.approx(1.5 + linear * LENGTH, rel=1e-12)


@pytest.mark.parametrize("mass", [-1.0, math.nan, math.inf, "1", None, True])
def test_bad_masses_are_refused(make_world, mass):
    t = straight(make_world(1e-3))
    before = t.masses
    with pytest.raises((bt.InvalidValue, bt.InvalidType)):
        t.set_point_mass(0, mass)
    np.testing.assert_array_equal(t.masses, before)


def test_bad_particles_and_removed_tendons_are_refused(make_world):
    world = make_world(1e-3)
    t = straight(world)
    for particle in (7, -8, 1.5):
        with pytest.raises((bt.InvalidValue, bt.InvalidType)):
            t.set_point_mass(particle, 1.0)
    world.remove_tendon(t)
    with pytest.raises(bt.UnknownId):
        t.set_point_mass(0, 1.0)
