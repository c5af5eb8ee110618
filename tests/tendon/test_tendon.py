"""Tendon: grips, forces, reeling in and paying out, read-outs, and what they refuse."""

import math
import warnings

import numpy as np
import pybullet as p
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from link_scenes import links_on_joints

import bullet_tendon as bt

LENGTH, RADIUS, STIFFNESS = 0.3, 0.004, 3e4
SMALL = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def world(make_world):
    return make_world(10.0, tolerance=1e-10)


def straight(world, n=16, **material):
    law = {"stiffness": STIFFNESS, **material}
    return world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, bt.Material(**law), n)


def test_read_outs(world):
    t = straight(world)
    mass = t.material.density * math.pi * RADIUS**2 * LENGTH
    assert (t.particles, t.radius, t.name, t.removed) == (16, RADIUS, world.tendons[0].name, False)
    assert t.length == pytest.approx(LENGTH, rel=1e-14)
    assert t.rest_length == pytest.approx(LENGTH, rel=1e-14)
    np.testing.assert_allclose(t.masses, mass / 15 * np.array([0.5] + [1] * 14 + [0.5]), rtol=1e-13)
    assert t.positions.shape == t.velocities.shape == (16, 3)
    assert t.energy == pytest.approx(0, abs=1e-15)
    t.positions[:] = 7
    assert t.length == pytest.approx(LENGTH, rel=1e-14)  # read-outs are copies


def test_kinetic_and_elastic_energy(world):
    t = straight(world, exponent=2.0, shear_stiffness=0.2 * STIFFNESS)
    v = np.random.default_rng(0).normal(size=(16, 3))
    t.set_positions(t.positions * 1.1, v)
    exact = STIFFNESS * LENGTH * 0.1**3 / 3 + 0.5 * (t.masses * (v**2).sum(1)).sum()
    # A cross-section beside the ends is crossed by fewer shear springs, of the same total stiffness.
    assert t.energy == pytest.approx(exact, rel=1e-12)


def nodal_forces(t, x):
    """-dE/dx by central differences."""
    forces, h = np.zeros_like(x), 1e-7
    for i, c in np.ndindex(*x.shape):
        energies = []
        for side in (h, -h):
            moved = x.copy()
            moved[i, c] += side
            t.set_positions(moved)
            energies.append(t.energy)
        forces[i, c] = (energies[1] - energies[0]) / (2 * h)
    t.set_positions(x)
    return forces


@SMALL
@given(n=st.integers(2, 9), exponent=st.sampled_from([1.0, 1.5, 2.0, 2.7, 3.0]), seed=st.integers(0, 10**6))
def test_tension_is_the_gradient_of_the_energy(make_world, n, exponent, seed):
    rng, world = np.random.default_rng(seed), make_world()
    line = np.cumsum(rng.normal(size=(n, 3)) * 0.01 + [0.02, 0, 0], axis=0)
    t = world.add_tendon(line, RADIUS, bt.Material(stiffness=100.0, exponent=exponent, toe_strain=0.2))
    x = line * rng.uniform(0.9, 1.4, 3) + rng.normal(size=(n, 3)) * 1e-3
    along = np.diff(x, axis=0)
    strain = np.linalg.norm(along, axis=1) / np.linalg.norm(np.diff(line, axis=0), axis=1) - 1
    # Differences of a power of the strain are inexact where it begins, and where its tangent takes over.
    assume(min(np.abs(strain).min(), np.abs(strain - 0.2).min()) > 1e-3)
    found = nodal_forces(t, x)
    pull = t.tension[:, None] * along / np.linalg.norm(along, axis=1)[:, None]
    exact = np.zeros((n, 3))
    exact[:-1] += pull
    exact[1:] -= pull
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.abs(exact).max() + 1e-9)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_springs_with_shear_follow_the_gradient_of_the_energy(make_world, exponent):
    """One explicit step from rest: what moves the particles is -dE/dx."""
    h, rng = 1e-6, np.random.default_rng(8)
    world = make_world(h, integrator="explicit_euler")
    t = straight(world, 9, stiffness=100.0, exponent=exponent, shear_stiffness=30.0)
    x = t.positions * 1.2 + rng.normal(size=(9, 3)) * 4e-3
    expected = nodal_forces(t, x)
    world.step()
    found = t.masses[:, None] * t.velocities / h
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_force_is_constant_until_set_again(world):
    t = straight(world)
    t.grip(0)
    t.set_force(-1, [100.0, 0, 0])
    t.set_force(7, [50.0, 0, 0])
    for _ in range(2):
        world.step(5)
        np.testing.assert_allclose(t.tension, [150.0] * 7 + [100.0] * 8, rtol=1e-8)
    t.set_force(15, [0, 0, 0])
    world.step(5)
    np.testing.assert_allclose(t.tension, [50.0] * 7 + [0] * 8, rtol=1e-8, atol=1e-6)


def test_rigid_grip_is_at_its_target_at_the_end_of_every_step(make_world):
    world = make_world(1 / 240, (0, 0, -9.81))
    t = straight(world, damping=5.0)
    grip = t.grip(-1)
    np.testing.assert_array_equal(grip.target, t.positions[-1])
    for k in range(50):
        grip.target = [LENGTH + 1e-3 * k, 0.02 * math.sin(k), 0]
        world.step()
        np.testing.assert_array_equal(t.positions[-1], grip.target)
    with pytest.raises(bt.InvalidValue):
        grip.target = [0, 0, math.nan]
    assert grip.target[0] == LENGTH + 1e-3 * 49


def test_grip_force_is_what_the_hand_feels(world):
    """A grip that stretches the tendon pulls with its tension, on both sides."""
    t = straight(world, exponent=1.5)
    grips = t.grip(0), t.grip(-1, [LENGTH * 1.04, 0, 0])
    world.step(5)
    tension = STIFFNESS * 0.04**1.5
    np.testing.assert_allclose(grips[0].force, [tension, 0, 0], atol=1e-6 * tension)
    np.testing.assert_allclose(grips[1].force, [-tension, 0, 0], atol=1e-6 * tension)


@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_soft_grip_yields_by_force_over_stiffness(world, damping):
    t = straight(world)
    soft = t.grip(0, stiffness=800.0, damping=damping)
    t.set_force(-1, [40.0, 0, -30.0])
    world.step(40)
    np.testing.assert_allclose(t.positions[0], [40.0 / 800, 0, -30.0 / 800], atol=1e-7)
    np.testing.assert_allclose(soft.force, [40.0, 0, -30.0], atol=1e-5)
    np.testing.assert_allclose(t.tension, 50.0, rtol=1e-6)


@pytest.mark.parametrize("link", [-1, 0])
@pytest.mark.parametrize("away", [0.0, 0.9 * RADIUS, 1.1 * RADIUS, 0.05])
def test_an_attachment_tells_where_its_particle_is_far_from_its_point(world, client, link, away):
    """Points are in the link's URDF frame: who takes that of the centre of mass is told."""
    origin, centre = np.array([LENGTH, 0.1, 0]), np.array([0.05, 0, 0])
    if link < 0:
        frame = {"baseInertialFramePosition": centre}
        body = p.createMultiBody(1.0, basePosition=origin, **frame, physicsClientId=client)
    else:
        axis = [(0, 0, 1)]
        body = links_on_joints(client, p.JOINT_REVOLUTE, [1.0], axis, places=[origin], centre=centre)
    t = straight(world)
    position = t.positions[-1] - origin + [0, 0, away]
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        t.attach(-1, body, link, position)
    told = [str(w.message) for w in given if w.category is bt.AttachmentWarning]
    assert len(told) == (away > RADIUS)
    for message in told:
        assert message.startswith(f"particle 15 of tendon {t.name!r} is {away:.3g} m away from its point on")


def test_what_is_attached_where_it_is_is_not_told_of(world, client):
    body = p.createMultiBody(1.0, basePosition=[LENGTH, 0.2, 0], physicsClientId=client)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        straight(world).attach(-1, body)


def test_released_grips_let_go(make_world):
    h, g = 1 / 240, 9.81
    world = make_world(h, (0, 0, -g))
    t = straight(world)
    grips = [t.grip(i) for i in range(16)]
    world.step(3)
    np.testing.assert_array_equal(t.velocities, 0)
    np.testing.assert_allclose([grip.force[2] for grip in grips], -g * t.masses, rtol=1e-9)
    for grip in grips:
        grip.release()
        grip.release()
        assert grip.released
        assert (grip.force == 0).all()
        with pytest.raises(bt.UnknownId):
            grip.target = [0, 0, 0]
    world.step()
    np.testing.assert_allclose(t.velocities[:, 2], -g * h, rtol=1e-9)
    assert t.grip(0).particle == 0  # it can be held again


def test_negative_indices_count_from_the_end(world):
    t = straight(world)
    assert [t.grip(i).particle for i in (-1, -16, 3)] == [15, 0, 3]


@pytest.mark.parametrize("particle", [16, -17, 1.0, "0", True])
def test_particles_that_there_are_not(world, particle):
    t = straight(world)
    error = bt.InvalidValue if type(particle) is int else bt.InvalidType
    for use in (t.grip, lambda i: t.set_force(i, [0, 0, 0]), lambda i: t.attach(i, 0)):
        with pytest.raises(error) as caught:
            use(particle)
        assert caught.value.argument == "particle"


def test_particles_are_held_once(world):
    t = straight(world)
    t.grip(3)
    with pytest.raises(bt.InvalidValue, match="not gripped or attached"):
        t.grip(3 - 16)


@pytest.mark.parametrize(
    ("argument", "value"),
    [("target", [0, 0]), ("target", [0, 0, math.inf]), ("stiffness", 0), ("stiffness", -1), ("damping", -1)],
)
def test_refused_grips_hold_nothing(world, argument, value):
    t = straight(world)
    with pytest.raises(bt.InvalidValue) as caught:
        t.grip(0, **{argument: value})
    assert caught.value.argument == argument
    t.grip(0)


def test_refused_positions_change_nothing(world):
    t = straight(world)
    before = t.positions
    for x, v in ((before[:-1], None), (before, before[:-1]), (before * math.nan, None)):
        with pytest.raises(bt.InvalidValue):
            t.set_positions(x, v)
    np.testing.assert_array_equal(t.positions, before)


@pytest.mark.parametrize("end", [0, 1])
def test_reeling_in_tightens(world, end):
    """Between two grips, shorter by `reel`: the rest length, the mass and the tension follow."""
    t, reel, exponent = straight(world, exponent=2.0), 0.025, 2.0
    t.grip(0), t.grip(-1)
    density = t.masses.sum() / LENGTH
    for _ in range(25):
        t.shorten(reel / 25, end)
        world.step()
    assert t.rest_length == pytest.approx(LENGTH - reel, rel=1e-12)
    assert t.masses.sum() == pytest.approx(density * (LENGTH - reel), rel=1e-12)
    light = t.masses[[0, -1]]
    assert (light[0] < light[1]) == (end == 0)
    world.step(10)
    np.testing.assert_allclose(t.strain, reel / (LENGTH - reel), rtol=1e-6)
    np.testing.assert_allclose(t.tension, STIFFNESS * (reel / (LENGTH - reel)) ** exponent, rtol=1e-6)


@SMALL
@given(reels=st.lists(st.floats(-0.05, 0.05), max_size=6), end=st.sampled_from([0, 1]))
def test_reeling_in_and_paying_out_is_a_round_trip(make_world, reels, end):
    t = straight(make_world())
    masses, done = t.masses, 0.0
    for reel in reels:
        try:
            t.shorten(reel, end)
        except bt.InvalidValue:
            continue
        done += reel
        assert t.rest_length == pytest.approx(LENGTH - done, rel=1e-12)
    t.shorten(-done, end)
    np.testing.assert_allclose(t.masses, masses, rtol=1e-9)


@pytest.mark.parametrize("length", [0.9 * LENGTH + 1e-6, -3 * LENGTH / 15 - 1e-6, math.nan])
def test_more_than_there_is_cannot_be_reeled(world, length):
    t = straight(world)
    masses = t.masses
    with pytest.raises(bt.InvalidValue) as caught:
        t.shorten(length)
    assert caught.value.argument == "length"
    with pytest.raises(bt.InvalidValue):
        t.shorten(0.01, end=2)
    np.testing.assert_array_equal(t.masses, masses)
    t.shorten(0.9 * LENGTH - 1e-9)
    assert t.rest_length == pytest.approx(0.1 * LENGTH, rel=1e-6)


@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.5)])
def test_particles_in_one_place_are_spread(make_world, where):
    """A segment without length has no direction. Its end is moved by a millionth of the rest length."""
    world = make_world(1e-3)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 0.002, bt.Material(stiffness=1e3, damping=1.0), 11)
    placed = t.positions + where
    placed[3:6] = placed[3]
    t.set_positions(placed)
    moved = np.linalg.norm(t.positions - placed, axis=1)
    np.testing.assert_allclose(moved, np.where(np.isin(np.arange(11), (4, 5)), 1e-8, 0), atol=1e-15)
    t.set_positions(np.tile(where, (11, 1)))
    assert (np.linalg.norm(np.diff(t.positions, axis=0), axis=1) > 1e-9).all()
    world.step(2000)
    np.testing.assert_allclose(np.linalg.norm(np.diff(t.positions, axis=0), axis=1), 0.01, rtol=1e-3)


@pytest.mark.parametrize("slack", [0.09, 0.0999, 0.12])
@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_a_tendon_starts_under_the_tension_of_its_rest_length(make_world, slack, exponent):
    """T = K s^p with s = L/l - 1, at once and after steps; its mass is that of its rest length."""
    world = make_world()
    material = bt.Material(stiffness=2e4, exponent=exponent, tension_only=True, density=1000)
    points = [[0, 0, 0], [0.03, 0, 0], [0.1, 0, 0]]
    t = world.add_tendon(points, 1e-3, material, rest_length=slack)
    tension = 2e4 * max(0.0, 0.1 / slack - 1) ** exponent
    np.testing.assert_allclose(t.positions, points)
    assert t.rest_length == pytest.approx(slack)
    assert t.masses.sum() == pytest.approx(1000 * np.pi * 1e-6 * slack)
    np.testing.assert_allclose(t.tension, tension, rtol=1e-9)
    hands = t.grip(0), t.grip(-1)
    world.step(5)
    np.testing.assert_allclose(t.tension, tension, rtol=1e-9)
    for hand, side in zip(hands, (1, -1), strict=True):
        np.testing.assert_allclose(hand.force, [side * tension, 0, 0], atol=1e-9 * tension)


@pytest.mark.parametrize("slack", [0, -0.1, np.nan, "long", 1e308, 2e4])
def test_a_rest_length_that_is_none_is_refused(make_world, slack):
    world = make_world()
    with pytest.raises(bt.TendonError, match="rest_length"):
        world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, bt.Material(stiffness=1e4), rest_length=slack)
    assert not world.tendons


@pytest.mark.parametrize("damping", [0.0, 50.0])
def test_the_tension_of_a_fast_pendulum_is_what_the_hand_feels(make_world, damping):
    """It turns by a tenth of a radian in a step, which stretches nothing."""
    world = make_world(1 / 240, (0, 0, -9.81))
    material = bt.Material(stiffness=5e4, damping=damping, density=1000)
    t = world.add_tendon([[0, 0, 0], [0.05, 0, 0]], 1e-3, material, 2)
    t.set_point_mass(-1, 0.1)
    hand = t.grip(0)
    t.set_positions(t.positions, [[0, 0, 0], [0, 0, -1.2]])
    for _ in range(30):
        world.step()
        assert t.tension[0] == pytest.approx(np.linalg.norm(hand.force), rel=0.02)


@pytest.mark.parametrize("grip", [{"max_force": 40.0}, {"stiffness": 2e3, "damping": 5.0}])
def test_a_hand_is_moved_together_with_the_tendon(make_world, client, grip):
    """After set_positions the hand begins at its particle, also where the next step is divided."""
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.015, physicsClientId=client)
    body = p.createMultiBody(0, ball, -1, (0.02, 0, -0.06), physicsClientId=client)
    line = np.linspace((0, 0, 0), (0, 0, -0.12), 40)
    material = bt.Material(stiffness=2e4, exponent=1.5, damping=1.0)

    def thrown(away) -> np.ndarray:
        """At the ball, after it was brought there from elsewhere."""
        world = make_world(1 / 240)
        world.add_obstacle(body)
        t = world.add_tendon(line + away, 0.003, material)
        hand = t.grip(0, **grip)
        world.step(5)
        t.set_positions(line, np.tile((5.0, 0, 0), (40, 1)))
        hand.target = line[0]
        world.step()
        assert world.report.counts["substeps"] > 1
        return t.positions

    assert np.abs(thrown((-0.5, 0, 0.3)) - thrown((0, 0, 0))).max() < 1e-6
