"""Time stepping: each method against its own scalar recurrence, and orders of convergence."""

import math

import numpy as np
import pybullet as p
import pytest
from scipy.optimize import brentq

import bullet_tendon as bt

LENGTH, RADIUS, STIFFNESS, DAMPING = 0.1, 0.004, 100.0, 0.02
STEPS, STRETCH = 60, 0.03


def law(material, elongation, rate):
    """Force [N] of one spring of LENGTH and its slopes with respect to elongation and rate."""
    s, power = elongation / LENGTH, material.exponent
    force = material.stiffness * math.copysign(abs(s) ** power, s) + material.damping * rate / LENGTH
    return force, material.stiffness * power * abs(s) ** (power - 1) / LENGTH, material.damping / LENGTH


def implicit(material, mass, history, b):
    """End of a step whose history is (position, rate) and whose weight is b: mass a + force = 0."""
    x, v = history

    def residual(e):
        return mass * (e - x - b * v) / b**2 + law(material, e, (e - x) / b)[0]

    end = brentq(residual, -0.5 * LENGTH, 0.5 * LENGTH, xtol=1e-18, rtol=1e-15)
    return end, (end - x) / b


def recurrence(method, material, mass, h):
    """Elongations [m] after every step of one spring between two free particles; mass is the reduced one."""
    states = [(STRETCH, 0.0)]
    for _ in range(STEPS):
        e, v = states[-1]
        force, by_e, by_v = law(material, e, v)
        if method == "explicit_euler":
            states.append((e + h * v, v - h * force / mass))
        elif method == "single":
            dv = h * -(force + h * by_e * v) / (mass + h * by_v + h * h * by_e)
            states.append((e + h * (v + dv), v + dv))
        elif method == "implicit_euler" or len(states) == 1:
            states.append(implicit(material, mass, (e, v), h))
        else:
            before, rate_before = states[-2]
            history = ((4 * e - before) / 3, (4 * v - rate_before) / 3)
            states.append(implicit(material, mass, history, 2 * h / 3))
    return np.array(states[1:])


@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("method", ["implicit_euler", "bdf2", "explicit_euler", "single"])
@pytest.mark.parametrize("solver", ["banded", "pcg"])
def test_free_spring_follows_its_recurrence(make_world, method, exponent, solver):
    h = 2e-4
    choice = {"iteration": "single"} if method == "single" else {"integrator": method}
    precise = {"tolerance": 1e-15, "linear_tolerance": 1e-15, "linear_solver": solver}
    world = make_world(h, **choice, **precise)
    material = bt.Material(stiffness=STIFFNESS, exponent=exponent, damping=DAMPING)
    half = np.array([0.5 * LENGTH, 0.0, 0.0])
    t = world.add_tendon([-half, half], RADIUS, material)
    t.set_positions([-half - [STRETCH / 2, 0, 0], half + [STRETCH / 2, 0, 0]])
    expected = recurrence(method, material, t.masses[0] / 2, h)
    assert np.ptp(expected[:, 0]) > STRETCH  # it swings
    found = []
    for _ in range(STEPS):
        world.step()
        found.append((np.diff(t.positions[:, 0])[0] - LENGTH, np.diff(t.velocities[:, 0])[0]))
        assert world.report.converged
    difference = np.abs(np.array(found) - expected).max(0)
    assert difference[0] <= 1e-12 * STRETCH
    assert difference[1] <= 1e-12 * np.abs(expected[:, 1]).max()


@pytest.mark.parametrize("growth", [0.3, 2.0, 6.0])
def test_bdf2_goes_on_where_the_time_step_changes(make_world, client, growth):
    """By the formula for steps of different lengths; much longer than the last one, by implicit Euler."""
    material = bt.Material(stiffness=STIFFNESS)
    half = np.array([0.5 * LENGTH, 0.0, 0.0])
    world = make_world(1e-3, integrator="bdf2", tolerance=1e-15)
    t = world.add_tendon([-half, half], RADIUS, material)
    t.set_positions([-half - [STRETCH / 2, 0, 0], half])
    world.step(4)
    before = [np.diff(a[:, 0])[0] for a in (t.positions, t.velocities)]
    world.step()
    now = [np.diff(a[:, 0])[0] for a in (t.positions, t.velocities)]
    share = growth**2 / (1 + 2 * growth) if growth < 2.4 else 0
    weight = (1 + growth) / (1 + 2 * growth) if growth < 2.4 else 1
    history = [b + share * (b - a) for a, b in zip(before, now, strict=True)]
    expected = implicit(material, t.masses[0] / 2, (history[0] - LENGTH, history[1]), weight * growth * 1e-3)
    p.setTimeStep(growth * 1e-3, physicsClientId=client)
    world.step()
    assert np.diff(t.positions[:, 0])[0] - LENGTH == pytest.approx(expected[0], abs=1e-13 * STRETCH)
    assert np.diff(t.velocities[:, 0])[0] == pytest.approx(expected[1], abs=1e-12)


def test_a_time_step_that_grows_threefold_is_taken_in_two(make_world, client):
    """So that each goes on from the last by second order: the same as two steps of half the length."""
    found = []
    for growth, steps in ((3.0, 1), (1.5, 2)):
        p.setTimeStep(1e-3, physicsClientId=client)
        world = make_world(1e-3, integrator="bdf2", tolerance=1e-15)
        t = oscillator(world, 1.0, STRETCH)
        world.step(5)
        p.setTimeStep(growth * 1e-3, physicsClientId=client)
        world.step(steps)
        assert world.report.counts["substeps"] == 3 - steps
        found.append((t.positions[1, 0] - LENGTH, t.velocities[1, 0]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12, atol=1e-15)


def oscillator(world, exponent, amplitude):
    """One particle on a spring whose other end is held at the origin, released at `amplitude` [m]."""
    t = world.add_tendon(
        [[0, 0, 0], [LENGTH, 0, 0]], RADIUS, bt.Material(stiffness=STIFFNESS, exponent=exponent)
    )
    t.grip(0)
    t.set_positions([[0, 0, 0], [LENGTH + amplitude, 0, 0]])
    return t


def test_linear_oscillator_loses_exactly_what_implicit_euler_loses(make_world):
    """Amplitude times 1/sqrt(1 + w^2 h^2) and phase atan(w h), every step."""
    h = 2e-3
    world = make_world(h, tolerance=1e-15)
    t = oscillator(world, 1.0, STRETCH)
    w = math.sqrt(STIFFNESS / LENGTH / t.masses[1])
    step = complex(1, -w * h) / (1 + (w * h) ** 2)
    assert abs(step) == pytest.approx(1 / math.sqrt(1 + (w * h) ** 2), rel=1e-15)
    z = complex(STRETCH, 0)
    for _ in range(100):
        world.step()
        z *= step
        found = complex(t.positions[1, 0] - LENGTH, t.velocities[1, 0] / w)
        assert abs(found - z) <= 1e-12 * STRETCH


def power_law_error(make_world, method, steps):
    """Error of the state after 5/4 periods of a spring with exponent 2, relative to the amplitudes."""
    power, amplitude = 2.0, 0.02
    world = make_world(1.0, integrator=method)
    t = oscillator(world, power, amplitude)
    mass, k, q = t.masses[1], STIFFNESS / LENGTH**power, power + 1
    shape = math.sqrt(math.pi) / q * math.gamma(1 / q) / math.gamma(1 / q + 0.5)
    period = 4 * math.sqrt(q * mass / (2 * k)) * amplitude ** ((1 - power) / 2) * shape
    fastest = math.sqrt(2 * k / (q * mass) * amplitude**q)
    p.setTimeStep(1.25 * period / steps, physicsClientId=world.physicsClientId)
    world.step(steps)
    x, v = t.positions[1, 0] - LENGTH, t.velocities[1, 0]
    return math.hypot(x / amplitude, v / fastest + 1)


@pytest.mark.parametrize(("method", "order", "steps"), [("implicit_euler", 0.95, 2000), ("bdf2", 1.9, 500)])
def test_order_of_convergence(make_world, method, order, steps):
    coarse, fine = (power_law_error(make_world, method, n) for n in (steps, 2 * steps))
    assert fine < 0.02
    assert math.log2(coarse / fine) >= order


@pytest.mark.parametrize("method", ["bdf2"])
def test_rounding_does_not_end_the_second_order(make_world, method):
    """Down to 4e-7 of the amplitude: velocities are not differences of rounded positions."""
    coarse, fine = (power_law_error(make_world, method, n) for n in (20000, 40000))
    assert fine < 4e-7
    assert math.log2(coarse / fine) >= 1.95


def test_velocity_damping_decays_as_its_differential_equation(make_world):
    """Quadratic damping alone: v = v0 / (1 + v0 (c/m) t), to first order in the step."""
    h, q, start = 1e-4, 2.0, 2.0
    world = make_world(h, tolerance=1e-12)
    material = bt.Material(stiffness=1e-9, damping=2e-3, damping_exponent=q)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, material)
    t.grip(0)
    t.set_positions([[0, 0, 0], [LENGTH, 0, 0]], [[0, 0, 0], [start, 0, 0]])
    rate = material.damping / LENGTH**q / t.masses[1]
    v = start
    for _ in range(200):
        world.step()
        v = (math.sqrt(1 + 4 * h * rate * v) - 1) / (2 * h * rate)  # v' = v - h rate v'^2
        assert t.velocities[1, 0] == pytest.approx(v, rel=1e-6)
    assert v < 0.8 * start
    assert v == pytest.approx(start / (1 + start * rate * 200 * h), rel=2e-2)


@pytest.mark.parametrize(
    "options", [{}, {"integrator": "bdf2"}, {"iteration": "single"}, {"integrator": "explicit_euler"}]
)
def test_a_rigid_grip_bears_the_force_on_its_particle(make_world, options):
    """The tendon is straight, without tension or weight: nothing else acts."""
    world = make_world(1e-4, **options)
    tendon = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, bt.Material(stiffness=1e3), 5)
    grip = tendon.grip(0)
    tendon.set_force(0, (1.0, -2.0, 3.0))
    world.step(5)
    np.testing.assert_allclose(grip.force, (1.0, -2.0, 3.0), rtol=1e-9)
    np.testing.assert_allclose(tendon.positions, np.outer(np.linspace(0, 0.1, 5), (1, 0, 0)), atol=1e-15)
