"""A whole world: equilibria that are known exactly, invariances, and what it refuses."""

import math

import numpy as np
import pybullet as p
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import bullet_tendon as bt

LENGTH, RADIUS = 0.3, 0.004
FAST = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def pulled(world, n, material, force, direction=(1.0, 0.0, 0.0)):
    """A straight tendon of n particles with one end held and a force on the other, at equilibrium."""
    way = np.array(direction) / np.linalg.norm(direction)
    t = world.add_tendon([0 * way, LENGTH * way], RADIUS, material, n)
    grip = t.grip(0)
    t.set_force(-1, force * way)
    for _ in range(8):
        world.step()
        assert world.report.converged
    return t, grip


@pytest.mark.parametrize("share", [0.0, 0.2])
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("n", [5, 20, 60, 500])
def test_series_stretch(make_world, n, exponent, share):
    """L (F/K)^(1/p), whatever n and the share of the shear springs; every cross-section carries F."""
    stiffness, force = 3e4, 500.0
    material = bt.Material(stiffness=stiffness, exponent=exponent, shear_stiffness=share * stiffness)
    t, grip = pulled(make_world(10.0), n, material, force)
    exact = LENGTH * (force / stiffness) ** (1 / exponent)
    assert t.length - LENGTH == pytest.approx(exact, rel=1e-6)
    np.testing.assert_allclose(t.tension, force, rtol=1e-6)
    np.testing.assert_allclose(t.strain, exact / LENGTH, rtol=1e-6)
    np.testing.assert_allclose(grip.force, [force, 0, 0], rtol=1e-6, atol=1e-6 * force)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_series_stretch_to_a_tight_tolerance(make_world, exponent):
    material = bt.Material(stiffness=3e4, exponent=exponent, shear_stiffness=6e3)
    t, _ = pulled(make_world(10.0, tolerance=1e-10), 60, material, 500.0)
    exact = LENGTH * (500.0 / 3e4) ** (1 / exponent)
    assert t.length - LENGTH == pytest.approx(exact, rel=1e-9)
    np.testing.assert_allclose(t.tension, 500.0, rtol=1e-9)


@FAST
@given(
    n=st.integers(2, 40),
    exponent=st.floats(1, 4),
    stiffness=st.floats(10, 1e6),
    share=st.floats(0, 0.4),
    strain=st.floats(1e-3, 0.3),
    direction=st.sampled_from([(1.0, 0, 0), (0.3, -0.8, 0.5), (0, 0, -1.0)]),
)
def test_series_stretch_of_any_tendon(make_world, n, exponent, stiffness, share, strain, direction):
    material = bt.Material(stiffness=stiffness, exponent=exponent, shear_stiffness=share * stiffness)
    force = stiffness * strain**exponent
    t, _ = pulled(make_world(1e4), n, material, force, direction)
    np.testing.assert_allclose(t.strain, strain, rtol=1e-5)
    np.testing.assert_allclose(t.tension, force, rtol=1e-5)


def test_hanging_under_its_own_weight(make_world):
    """Segment k carries the weight below it."""
    g, n = 9.81, 30
    world = make_world(10.0, (0, 0, -g), tolerance=1e-10)
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], RADIUS, bt.Material(stiffness=50.0, exponent=1.5), n)
    grip = t.grip(0)
    world.step(10)
    below = g * (t.masses.sum() - np.cumsum(t.masses)[:-1])
    np.testing.assert_allclose(t.tension, below, rtol=1e-8)
    np.testing.assert_allclose(t.strain, (below / 50.0) ** (1 / 1.5), rtol=1e-8)
    np.testing.assert_allclose(grip.force, [0, 0, -g * t.masses.sum()], atol=1e-8)


def catenary(masses, rest, span, drop, stiffness, exponent, g):
    """Particles (n, 2) of the discrete elastic catenary; unknown are the first segment's two forces."""
    below = g * np.concatenate([[0.0], np.cumsum(masses[1:-1])])

    def steps(horizontal, vertical):
        v = vertical - below  # what segment k carries upwards at its first end
        tension = np.hypot(horizontal, v)
        length = rest * (1 + (tension / stiffness) ** (1 / exponent))
        return length * horizontal / tension, -length * v / tension

    def vertical_of(horizontal):
        return brentq(lambda v: steps(horizontal, v)[1].sum() + drop, -50, 50, xtol=1e-16, rtol=1e-15)

    h = brentq(lambda h: steps(h, vertical_of(h))[0].sum() - span, 1e-4, 50, xtol=1e-16, rtol=1e-15)
    x, z = steps(h, vertical_of(h))
    return np.column_stack([np.concatenate([[0.0], np.cumsum(a)]) for a in (x, z)])


@pytest.mark.parametrize("drop", [0.0, 0.07])
@pytest.mark.parametrize(("stiffness", "exponent"), [(3e4, 1.0), (30.0, 1.0), (3e4, 2.0), (300.0, 2.0)])
def test_elastic_catenary(make_world, stiffness, exponent, drop):
    g, n, span = 9.81, 40, 0.24
    world = make_world(1.0, (0, 0, -g), tolerance=1e-12)
    t = world.add_tendon(
        [[0, 0, 0], [LENGTH, 0, 0]], RADIUS, bt.Material(stiffness=stiffness, exponent=exponent), n
    )
    grips = t.grip(0), t.grip(-1, [span, 0, -drop])
    world.step(40)
    rest = np.full(n - 1, LENGTH / (n - 1))
    exact = catenary(t.masses, rest, span, drop, stiffness, exponent, g)
    np.testing.assert_allclose(t.positions[:, [0, 2]], exact, rtol=0, atol=1e-8 * LENGTH)
    np.testing.assert_allclose(t.positions[:, 1], 0, atol=1e-12)
    weight = [0, 0, -g * t.masses.sum()]
    np.testing.assert_allclose(grips[0].force + grips[1].force, weight, atol=1e-8)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_steps_do_not_depend_on_place_or_direction(make_world, integrator):
    """A world that is moved and turned moves the same way."""
    rng = np.random.default_rng(3)
    material = bt.Material(stiffness=300.0, exponent=2.0, damping=0.1, shear_stiffness=30.0)
    x = np.cumsum(rng.normal(size=(12, 3)) * 0.003 + [0.01, 0, 0], axis=0)
    v, pull = rng.normal(size=(12, 3)) * 0.2, np.array([0.1, -0.2, 0.05])
    turn = np.array(p.getMatrixFromQuaternion(rng.normal(size=4) / 2)).reshape(3, 3)
    turn = np.linalg.qr(turn)[0]
    ends = []
    for rotation, shift in ((np.eye(3), np.zeros(3)), (turn, np.array([0.3, -0.2, 0.1]))):
        world = make_world(1 / 240, rotation @ [0, 0, -9.81], integrator=integrator, tolerance=1e-11)
        t = world.add_tendon(x @ rotation.T + shift, 1e-3, material)
        t.set_positions(x @ rotation.T * 1.02 + shift, v @ rotation.T)
        t.grip(0)
        t.set_force(-1, rotation @ pull)
        world.step(30)
        ends.append((t.positions - shift) @ rotation)
    assert np.abs(ends[0] - x).max() > 0.01
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-8)


def test_free_fall_is_exact(make_world):
    """Without contact a tendon falls as implicit Euler says: x = g h^2 n (n + 1) / 2."""
    h, g = 1 / 240, 9.81
    world = make_world(h, (0, 0, -g))
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, bt.Material(stiffness=3e4), 20)
    world.step(50)
    np.testing.assert_allclose(t.positions[:, 2], -g * h * h * 50 * 51 / 2, rtol=1e-10)
    np.testing.assert_allclose(t.velocities[:, 2], -g * h * 50, rtol=1e-10)
    np.testing.assert_allclose(t.tension, 0, atol=1e-6)


def test_apply_does_not_step_pybullet(make_world, client):
    world = make_world(0.01, (0, 0, -9.81))
    ball = p.createMultiBody(1.0, basePosition=[5, 0, 0], physicsClientId=client)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, bt.Material(stiffness=3e4), 5)
    world.apply()
    assert p.getBaseVelocity(ball, client)[0] == (0, 0, 0)
    assert t.velocities[0, 2] == pytest.approx(-0.0981, rel=1e-12)
    world.step(3)
    assert p.getBaseVelocity(ball, client)[0][2] < -0.28
    assert set(world.report.seconds) == {"sense", "near", "solve", "react", "bullet"}


LINE = [[0, 0, 0], [LENGTH, 0, 0]]
REFUSED = [
    ("points", {"points": [[0, 0, 0]]}, bt.InvalidValue),
    ("points", {"points": [[0, 0, 0], [0, 0, 0]]}, bt.InvalidValue),
    ("points", {"points": [[0, 0, 0], [1, 0, math.nan]]}, bt.InvalidValue),
    ("points", {"points": [[0, 0], [1, 0]]}, bt.InvalidValue),
    ("points", {"points": "line"}, bt.InvalidType),
    ("radius", {"radius": 0}, bt.InvalidValue),
    ("radius", {"radius": "thin"}, bt.InvalidType),
    ("material", {"material": 3e4}, bt.InvalidType),
    ("particles", {"particles": 1}, bt.InvalidValue),
    ("particles", {"particles": 2.0}, bt.InvalidType),
    ("name", {"name": ""}, bt.InvalidValue),
    ("name", {"name": 7}, bt.InvalidType),
    ("name", {"name": "taken"}, bt.InvalidValue),
]


@pytest.mark.parametrize(("argument", "change", "error"), REFUSED)
def test_refused_tendons_leave_nothing(make_world, argument, change, error):
    world, material = make_world(), bt.Material(stiffness=1e3)
    world.add_tendon(LINE, RADIUS, material, name="taken")
    with pytest.raises(error) as caught:
        world.add_tendon(**{"points": LINE, "radius": RADIUS, "material": material, **change})
    assert caught.value.argument == argument
    assert argument in str(caught.value)
    assert "must be" in str(caught.value)
    assert [t.name for t in world.tendons] == ["taken"]


def test_more_particles_than_contacts_can_tell_apart_are_refused(make_world):
    """Given one by one as well as by `particles`; resampled to fewer, a long polyline is welcome."""
    world, material, count = make_world(), bt.Material(stiffness=1e3), 32_769
    line = np.zeros((count, 3))
    line[:, 0] = 1e-3 * np.arange(count)
    with pytest.raises(bt.InvalidValue, match="points = .*at most 32768"):
        world.add_tendon(line, RADIUS, material)
    with pytest.raises(bt.InvalidValue, match="particles = .*<= 32768"):
        world.add_tendon(line, RADIUS, material, count)
    assert world.tendons == ()
    assert world.add_tendon(line, RADIUS, material, 20).particles == 20


def test_removed_tendons_are_gone(make_world):
    world, other, material = make_world(), make_world(), bt.Material(stiffness=1e3)
    t, kept = (world.add_tendon(LINE, RADIUS, material, 5, name=name) for name in "ab")
    grip = t.grip(0)
    with pytest.raises(bt.UnknownId):
        other.remove_tendon(t)
    with pytest.raises(bt.InvalidType):
        world.remove_tendon("a")
    world.remove_tendon(t)
    assert (world.tendons, t.removed, grip.released) == ((kept,), True, True)
    for use in (
        lambda: t.positions,
        lambda: t.tension,
        lambda: t.grip(1),
        lambda: t.set_force(0, [0, 0, 1]),
        lambda: t.shorten(0.01),
        lambda: world.remove_tendon(t),
        lambda: setattr(grip, "target", [0, 0, 1]),
    ):
        with pytest.raises(bt.UnknownId):
            use()
    assert (grip.force == 0).all()
    world.step()
    assert world.add_tendon(LINE, RADIUS, material, name="a").name == "a"


@pytest.mark.parametrize("number", [-1, 999, "0", True, None])
def test_world_needs_a_connected_client(number):
    with pytest.raises(bt.UnknownId):
        bt.TendonWorld(number)


def test_options_can_be_replaced_but_only_by_options(make_world):
    world = make_world()
    with pytest.raises(bt.InvalidType):
        world.options = {"integrator": "bdf2"}
    world.options = bt.SolverOptions(integrator="bdf2")
    assert world.options.integrator == "bdf2"
