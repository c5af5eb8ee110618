"""Tendons that lie on and beside each other come to rest; those far apart are solved alone."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, LENGTH = 0.002, 0.2
MATERIAL = bt.Material(stiffness=1e3, damping=1.0, friction=0.3)


def floor(world, client):
    world.add_obstacle(p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)))


def heap(world, count, n):
    """Tendons dropped on each other, in directions by chance."""
    random = np.random.default_rng(0)
    for k in range(count):
        angle, (x, y) = random.uniform(0, np.pi), 0.02 * random.standard_normal(2)
        centre = np.array([x, y, 2 * RADIUS + 3 * RADIUS * k])
        half = np.array([np.cos(angle), np.sin(angle), 0]) * LENGTH / 2
        world.add_tendon([centre - half, centre + half], RADIUS, MATERIAL, n)


def speed(world):
    return max(np.abs(t.velocities).max() for t in world.tendons)


def test_a_heap_comes_to_rest(make_world, client):
    world = make_world(gravity=(0, 0, -9.81))
    floor(world, client)
    heap(world, 5, 100)
    world.step(400)
    assert speed(world) < 1e-7
    for _ in range(20):
        world.step()
        assert world.report.converged and world.report.iterations <= 3


def test_tendons_side_by_side_come_to_rest(make_world, client):
    """Pressed against each other, segments all but parallel: contacts stay in place."""
    world = make_world(gravity=(0, 0, -9.81))
    floor(world, client)
    x = np.linspace(-0.02, 0.02, 21)
    for k in range(3):
        y = 2.02 * RADIUS * k + 3e-4 * np.sin(60 * x + k)
        tendon = world.add_tendon(np.stack([x, y, 0 * x + RADIUS], axis=1), RADIUS, MATERIAL, 21)
        for i in range(21):
            tendon.set_force(i, (0, 2e-4 * (1 - k), 0))
    world.step(400)
    assert speed(world) < 1e-6
    before = world.contacts
    world.step()
    after = world.contacts
    assert (after["kind"] == "tendon").sum() > 40
    np.testing.assert_allclose(after["position"], before["position"], rtol=0, atol=1e-3 * RADIUS)


@pytest.mark.parametrize("apart", [0.02, 1.0])
def test_tendons_far_apart_are_solved_alone(make_world, client, apart):
    world = make_world(gravity=(0, 0, -9.81))
    for k in range(5):
        world.add_tendon([(0, apart * k, 1), (LENGTH, apart * k, 1)], RADIUS, MATERIAL, 50)
    world.step(5)
    counts = world.report.counts
    assert counts["groups"] == 5 and counts["rows"] == counts["tendon_pairs_considered"] == 0
