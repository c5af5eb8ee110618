"""Grips with a spring and a damper: what a moving hand feels, and the work that it does."""

import numpy as np
import pytest

import bullet_tendon as bt

CORD = bt.Material(stiffness=1e3, damping=1.0)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("dt", [1 / 1000, 1 / 60])
def test_a_hand_that_goes_along_with_a_tendon_feels_nothing(make_world, integrator, dt):
    world = make_world(dt, integrator=integrator)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, CORD, 11)
    speed = np.array([0.2, -0.1, 0.3])
    t.set_positions(t.positions, np.tile(speed, (11, 1)))
    hand = t.grip(0, stiffness=500.0, damping=50.0)
    for _ in range(50):
        hand.target = hand.target + dt * speed
        world.step()
        assert np.linalg.norm(hand.force) < 1e-9
    assert np.allclose(t.positions[0], 50 * dt * speed, atol=1e-12)


def test_a_tendon_that_is_put_elsewhere_with_its_hand_is_at_rest_there(make_world):
    world = make_world(1 / 240)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, CORD, 11)
    hand = t.grip(0, stiffness=500.0, damping=50.0)
    world.step()
    far = np.array([0.0, 1.0, 0.0])
    t.set_positions(t.positions + far)
    hand.target = hand.target + far
    world.step()
    assert np.linalg.norm(hand.force) < 1e-9


@pytest.mark.parametrize("damping", [0.0, 5.0, 50.0])
@pytest.mark.parametrize("steps", [5, 50])
def test_a_soft_hand_gives_at_least_what_is_stored(make_world, damping, steps):
    """Energy of the tendon and of the hand's spring is at most the work along the target's way."""
    world = make_world(1 / 240)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, CORD, 11)
    t.grip(-1)
    hand = t.grip(0, stiffness=500.0, damping=damping)
    work = 0.0
    for k in range(2 * steps):
        way = np.array([-0.01, 0.01, 0.0]) / steps * (1 if k < steps else -1)
        hand.target = hand.target + way
        world.step()
        work -= hand.force @ way
        stretch = t.positions[0] - hand.target
        stored = t.energy + 250.0 * stretch @ stretch
        assert stored <= work + 1e-9 + 1e-6 * abs(work)
