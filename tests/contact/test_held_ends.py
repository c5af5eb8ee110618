"""Tendons held at points nearer to each other than they are thick part from there, and fight no hold."""

import numpy as np
import pybullet as p
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
    settle(world, 80)
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


def weight(client, mass, position):
    """A small weight that touches no other."""
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.005, physicsClientId=client)
    body = p.createMultiBody(mass, ball, -1, position, physicsClientId=client)
    p.setCollisionFilterGroupMask(body, -1, 0, 0, physicsClientId=client)
    return body


@pytest.mark.parametrize("mass", [0.05, 1.0, 20.0])
def test_strands_share_a_weight(make_world, client, mass):
    """Four strands from a ring to one point of a weight: each has its part of the load."""
    world = make_world(gravity=(0, 0, -9.81))
    body = weight(client, mass, (0, 0, -LENGTH))
    tendons, knots = [], []
    for angle in np.pi / 2 * np.arange(4):
        ring = 0.004 * np.array([np.cos(angle), np.sin(angle), 0])
        tendons.append(world.add_tendon([ring, [0, 0, -LENGTH]], RADIUS, MATERIAL, PARTICLES))
        tendons[-1].grip(0)
        knots.append(tendons[-1].attach(-1, body))
    settle(world, 960)
    np.testing.assert_allclose(sum(k.force for k in knots), [0, 0, mass * 9.81], atol=1e-4 * mass * 9.81)
    np.testing.assert_allclose(
        [t.tension[-1] for t in tendons], mass * 9.81 / 4, rtol=0.03
    )  # they are oblique
    assert greatest_force(world) < 0.1 * mass * 9.81


@pytest.mark.parametrize("mass", [0.02, 1.0])
def test_weights_on_tendons_of_their_own_do_not_let_them_through(make_world, client, mass):
    """What each hangs on its own body can move away: thrown at each other, they stay thick to the end."""
    world = make_world(gravity=(0, 0, -9.81))
    tendons = []
    for side in (1, -1):
        top = np.array([0, side * 0.005, 0])
        end = top - [0, 0, LENGTH]
        body = weight(client, mass, list(end))
        tendons.append(world.add_tendon([top, end], RADIUS, MATERIAL, PARTICLES))
        tendons[-1].grip(0), tendons[-1].attach(-1, body)
        p.resetBaseVelocity(body, (0, -side * 0.3, 0), physicsClientId=client)
    for _ in range(60):
        world.step()
        one, other = (t.positions[1:] for t in tendons)
        assert np.linalg.norm(one[:, None] - other, axis=2).min() > 0.97 * 2 * RADIUS


def test_ends_beside_each_other_keep_apart(make_world):
    """As far apart as they are thick, what is held contradicts nothing: a load presses them together."""
    world = make_world()
    one, other = (held(world, strand(a, 1.0001 * RADIUS, 0.0)) for a in (0.0, np.pi))
    for k in range(1, PARTICLES - 1):
        one.set_force(k, (0, -1.0, 0)), other.set_force(k, (0, 1.0, 0))
    settle(world, 100)
    between = np.linalg.norm(one.positions - other.positions, axis=1)
    np.testing.assert_allclose(between, 2 * RADIUS, atol=0.01 * RADIUS)


@pytest.mark.parametrize("seed", range(3))
def test_strands_that_overlap_at_an_insertion_carry_the_weight_alone(make_world, client, seed):
    """Twelve strands whose insertions are nearer to each other than the strands are thick. There is no force
    between points that are fixed on one body. The body rests with forces of the size of its weight."""
    world = make_world(gravity=(0, 0, -9.81))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.04, 0.03, 0.02], physicsClientId=client)
    body = p.createMultiBody(2.0, shape, -1, physicsClientId=client)
    rng = np.random.default_rng(seed)
    holds = []
    for _ in range(12):
        end = np.array([0, 0, 0.02]) + rng.normal(size=3) * [0.002, 0.002, 0]
        top = [0.01 * rng.normal(), 0.01 * rng.normal(), 0.07]
        t = world.add_tendon([top, end], 3e-4, bt.Material.ligament(1e4, 0.06), 10)
        t.grip(0)
        holds.append(t.attach(-1, body, -1))
    for _ in range(240):
        world.step()
        assert world.report.converged
    assert sum(hold.force[2] for hold in holds) == pytest.approx(2 * 9.81, rel=0.05)  # it swings a little
    assert max(np.linalg.norm(hold.force) for hold in holds) < 2 * 9.81
    assert greatest_force(world) < 2
