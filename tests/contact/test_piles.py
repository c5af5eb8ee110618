"""Tendons that lie on and beside each other come to rest; those far apart are solved alone."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios.benchmarks.heap import LENGTH, MATERIAL, RADIUS, drop

import bullet_tendon as bt


def floor(world, client):
    world.add_obstacle(p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)))


def dropped(make_world, client, count, seed=0, **options):
    """A world in which so many tendons fall onto a floor."""
    world = make_world(gravity=(0, 0, -9.81), **options)
    floor(world, client)
    drop(world, count, 100, seed)
    return world


def speed(world):
    return max(np.abs(t.velocities).max() for t in world.tendons)


def test_a_heap_comes_to_rest(make_world, client):
    world = dropped(make_world, client, 5)
    world.step(400)
    assert speed(world) < 1e-7
    for _ in range(20):
        world.step()
        assert world.report.converged and world.report.iterations <= 3


@pytest.mark.parametrize(
    ("count", "seed"),
    [(2, 1), (5, 6), (5, 7), *(pytest.param(10, k, marks=pytest.mark.slow) for k in (3, 4))],
)
@pytest.mark.parametrize("integrator", ["bdf2"])
def test_a_heap_comes_to_rest_by_second_order(make_world, client, integrator, count, seed):
    """Methods that go on from velocities of before an impact shake it at 1 mm/s and more."""
    world = dropped(make_world, client, count, seed, integrator=integrator)
    world.step(480)
    assert speed(world) < 1e-5
    world.step(600)
    assert world.report.counts["tendons_asleep"] == count


@pytest.mark.slow
def test_a_high_heap_comes_to_rest(make_world, client):
    """Contacts that take over too much of a force push each other off, every other step."""
    world = dropped(make_world, client, 20)
    world.step(440)
    assert speed(world) < 1e-4


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


@pytest.mark.parametrize("law", [{}, {"tension_only": True}, {"bending_stiffness": 1e-6}])
@pytest.mark.parametrize("friction", [0.1, 0.6, 10.0])
def test_ropes_fall_across_each_other_onto_a_ball(make_world, client, law, friction):
    """Segments stick to the ball while they roll onto it: what sticks moves with the point that touches.

    With a friction that resisted the motion of another point of the segment, the steps were not solved.
    """
    world = make_world(gravity=(0, 0, -9.81))
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.04, physicsClientId=client)
    ball = p.createMultiBody(0, shape, basePosition=(0, 0, 0.03), physicsClientId=client)
    world.add_obstacle(ball, friction=friction)
    material = bt.Material(stiffness=1e4, damping=1.0, friction=0.7, **law)
    for z, turn in ((0.08, 0.0), (0.092, 1.1)):
        way = 0.1 * np.array([np.cos(turn), np.sin(turn), 0])
        world.add_tendon([(0, 0, z) - way, (0.005, 0, z) + way], 0.0034, material, 40)
    solves = []
    for _ in range(36):
        world.step()
        assert world.report.converged
        solves.append(world.report.iterations)
    assert (world.contacts["kind"] == "tendon").any()
    assert sum(solves) <= 5500


@pytest.mark.parametrize("apart", [0.02, 1.0])
def test_tendons_far_apart_are_solved_alone(make_world, client, apart):
    world = make_world(gravity=(0, 0, -9.81))
    for k in range(5):
        world.add_tendon([(0, apart * k, 1), (LENGTH, apart * k, 1)], RADIUS, MATERIAL, 50)
    world.step(5)
    counts = world.report.counts
    assert counts["islands"] == 5 and counts["contacts"] == counts["tendon_pairs_considered"] == 0


@pytest.mark.parametrize(
    ("layers", "load", "rate"), [(2, 5.0, 60), (3, 5.0, 240), (3, 50.0, 240), (5, 20.0, 240)]
)
def test_slack_strands_that_stand_on_each_other_hold_by_friction(make_world, client, layers, load, rate):
    """Crosswise, under a load at 8 degrees to the vertical; friction alone keeps the top from tipping."""
    radius = 1.5e-3
    world = make_world(1 / rate, (0, 0, -9.81))
    floor(world, client)
    material = bt.Material(stiffness=2e3, damping=1, density=1000, friction=0.8)
    for layer in range(layers):
        way = np.roll([0.006, 0, 0], layer % 2)
        height = np.array([0, 0, (1 + 2 * layer) * radius])
        top = world.add_tendon([height - way, height + way], radius, material, 5)
    force = load * np.array([0.1, 0.1, -1])
    for k in range(300):
        top.set_force(2, min(1.0, k / 50) * force)
        world.step()
    np.testing.assert_allclose(top.positions[2, :2], 0, atol=0.05 * layers * radius)
    assert top.positions[2, 2] == pytest.approx((2 * layers - 1) * radius, abs=0.01 * radius)
    assert world.report.converged and world.report.counts["linear_solves"] <= 10
