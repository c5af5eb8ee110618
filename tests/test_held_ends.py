"""Tendons held at points nearer to each other than they are thick: they part from there, and fight no hold."""

import numpy as np
import pytest

import bullet_tendon as bt

RADIUS, LENGTH, PARTICLES = 0.002, 0.2, 41
MATERIAL = bt.Material(stiffness=3e4, damping=2.0, friction=0.3)
ALONG = np.linspace(0, 1, PARTICLES)[:, None]


def held(world, points):
    t = world.add_tendon(points, RADIUS, MATERIAL, PARTICLES)
    t.grip(0), t.grip(-1)
    return t


def strand(angle, apart, bulge):
    """Points of a strand whose ends are `apart` from the bundle's axis, and its middle `bulge` more [m]."""
    outwards = np.array([0, np.cos(angle), np.sin(angle)])
    return ALONG * [LENGTH, 0, 0] + (apart + bulge * np.sqrt(np.sin(np.pi * ALONG))) * outwards


def settle(world, steps=40):
    for _ in range(steps):
        world.step()
        assert world.report.converged


def greatest_force(world):
    return max([0.0, *world.contacts["normal_force"]])


# Measured: 0.22 N and 0.04 N, of their weight; where contacts fight the holds, 65 to 518 N and up to 7e7 N.
@pytest.mark.parametrize("apart", [0.0, 0.3, 0.9])  # radii
@pytest.mark.parametrize("count", [2, 4, 5])
def test_strands_at_one_anchor_stay_slack(make_world, count, apart):
    world = make_world(gravity=(0, 0, -9.81))
    angles = 2 * np.pi * np.arange(count) / count
    strands = [held(world, strand(a, apart * RADIUS, 3.3 * RADIUS)) for a in angles]
    settle(world)
    assert max(np.abs(t.tension).max() for t in strands) < 1
    assert greatest_force(world) < 1


def test_what_parts_by_itself_does_not_touch(make_world):
    """Two tendons of a V: as if each were alone."""
    away = LENGTH * np.array([np.cos(0.2), np.sin(0.2), 0])
    tensions = []
    for mirrored in ([1], [1, -1]):
        world = make_world(gravity=(0, 0, -9.81))
        tendons = [held(world, ALONG * away * (1, side, 1)) for side in mirrored]
        settle(world)
        assert greatest_force(world) == 0
        tensions.append(tendons[0].tension)
    np.testing.assert_allclose(*tensions, rtol=1e-9)


@pytest.mark.parametrize("apart", [0.0, 0.4, 0.8])  # radii
def test_they_part_by_a_tenth_of_the_arc(make_world, apart):
    world = make_world()
    one, other = (held(world, strand(a, apart * RADIUS, 0.0)) for a in (0.0, np.pi))
    settle(world, 200)
    between = np.linalg.norm(one.positions - other.positions, axis=1)
    arc = np.minimum(ALONG, 1 - ALONG)[:, 0] * LENGTH
    meant = np.minimum(2 * RADIUS, 2 * RADIUS * apart + 0.1 * 2 * arc)
    # Under a fifth of their thickness they may be anywhere.
    firm = meant > 0.25 * 2 * RADIUS
    segment = LENGTH / (PARTICLES - 1)
    assert np.all(between[firm] > meant[firm] - 0.02 * RADIUS)
    assert np.all(between[firm] < meant[firm] + 0.1 * 2 * segment)
    assert np.abs(one.tension).max() < 31  # 1e-3 of strain, by its way around


def test_both_ends_of_a_loop_at_one_point(make_world):
    world = make_world(gravity=(0, 0, -9.81))
    turn = 2 * np.pi * ALONG
    t = held(world, 0.03 * np.hstack([np.sin(turn), 0 * turn, -(1 - np.cos(turn))]))
    settle(world, 200)
    assert np.abs(t.tension).max() < 1
    assert greatest_force(world) < 1


def test_ends_beside_each_other_keep_apart(make_world):
    """As far apart as they are thick, what is held contradicts nothing: a load presses them together in full."""
    world = make_world()
    one, other = (held(world, strand(a, 1.0001 * RADIUS, 0.0)) for a in (0.0, np.pi))
    for k in range(1, PARTICLES - 1):
        one.set_force(k, (0, -1.0, 0)), other.set_force(k, (0, 1.0, 0))
    settle(world, 100)
    between = np.linalg.norm(one.positions - other.positions, axis=1)
    np.testing.assert_allclose(between, 2 * RADIUS, atol=0.01 * RADIUS)
