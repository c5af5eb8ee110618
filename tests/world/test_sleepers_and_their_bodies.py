"""Sleeping tendons and the bodies that carry them: what they go on pushing at, and tunnels that move."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G, R, DT = 9.81, 0.002, 1 / 240
ROPE = bt.Material(stiffness=500.0, damping=0.5, friction=0.7)


def box(client, half, at=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    return p.createMultiBody(0, shape, -1, at, physicsClientId=client)


@pytest.fixture
def make_sleeping(make_world):
    """make_sleeping(build): a world with gravity, built, and stepped until all its tendons sleep."""

    def make(build):
        world = make_world(DT, (0, 0, -G))
        build(world)
        for _ in range(40):
            world.step(20)
            if all(t.asleep for t in world.tendons):
                return world
        raise AssertionError("it does not fall asleep")

    return make


@pytest.mark.parametrize("kind", ["plane", "box"])
def test_what_sleeps_weighs_on_what_carries_it(make_sleeping, client, kind):
    """Force and torque on the body are the tendon's weight, where it lies."""
    made = {}

    def build(world):
        if kind == "box":
            body, top = box(client, [0.1, 0.1, 0.02], (0.3, 0, 0.1)), 0.12
        else:
            shape = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
            body, top = p.createMultiBody(0, shape, physicsClientId=client), 0.0
        world.add_obstacle(body)
        world.add_tendon([[0.32, 0.01, top + R], [0.36, 0.03, top + R]], R, ROPE, 9)
        made["body"], made["centre"] = body, np.array([0.3, 0, 0.1]) if kind == "box" else np.zeros(3)

    world = make_sleeping(build)
    t = world.tendons[0]
    weights = np.outer(t.masses, [0, 0, -G])
    torque = np.cross(t.positions - made["centre"], weights).sum(0)
    for _ in range(3):
        world.step()
        assert t.asleep
        felt = world.wrench(made["body"])
        np.testing.assert_allclose(felt[:3], weights.sum(0), atol=1e-4 * t.masses.sum() * G)
        np.testing.assert_allclose(felt[3:], torque, atol=1e-4 * np.abs(torque).max())


def test_what_sleeps_pulls_at_what_it_hangs_from(make_sleeping, client):
    """Force and torque on a post with an attachment beside its centre of mass."""
    made = {}

    def build(world):
        made["post"] = box(client, [0.01] * 3, (0, 0, 0.02))
        world.add_tendon([[0.03, 0.01, 0], [0.03, 0.01, -0.05]], R, ROPE, 12).attach(0, made["post"])

    world = make_sleeping(build)
    world.step(3)
    t = world.tendons[0]
    assert t.asleep
    weight = np.array([0, 0, -t.masses.sum() * G])
    felt = world.wrench(made["post"])
    np.testing.assert_allclose(felt[:3], weight, atol=1e-4 * np.abs(weight[2]))
    np.testing.assert_allclose(felt[3:], np.cross([0.03, 0.01, -0.02], weight), atol=1e-5 * np.abs(weight[2]))


@pytest.mark.parametrize("how", ["moved", "fast"])
def test_a_tunnel_of_what_is_no_obstacle_wakes_what_lies_in_it(make_sleeping, client, how):
    """A bore in a body whose own shape tendons do not feel carries a tendon, and lifts it."""
    made = {}

    def build(world):
        made["body"] = box(client, [0.05, 0.02, 0.02])
        world.add_tunnel(made["body"], -1, [-0.05, 0, 0], [0.05, 0, 0], 0.004, 0.5)
        world.add_tendon([[-0.02, 0, -0.0015], [0.02, 0, -0.0015]], R, ROPE, 9)

    world = make_sleeping(build)
    t = world.tendons[0]
    lies = t.positions
    np.testing.assert_allclose(lies[:, 2], -0.002, atol=1e-6)
    if how == "moved":
        lift = 5e-4
        for _ in range(10):
            p.resetBasePositionAndOrientation(made["body"], [0, 0, lift], [0, 0, 0, 1], client)
            world.step()
        assert t.positions[:, 2].min() >= lift - 0.002 - 1e-5
    else:  # a conveyor
        p.resetBaseVelocity(made["body"], [0.2, 0, 0], [0, 0, 0], client)
        world.step()
        np.testing.assert_allclose(t.velocities[:, 0], 0.35 * G * DT, rtol=0.02)
    assert not t.asleep


def test_a_tunnel_that_moves_far_off_wakes_nobody(make_sleeping, client):
    made = {}

    def build(world):
        for name, x in (("near", 0.0), ("far", 0.5)):
            made[name] = box(client, [0.05, 0.02, 0.02], (x, 0, 0))
            world.add_tunnel(made[name], -1, [-0.05, 0, 0], [0.05, 0, 0], 0.004, 0.5)
        world.add_tendon([[-0.02, 0, -0.0015], [0.02, 0, -0.0015]], R, ROPE, 9)

    world = make_sleeping(build)
    p.resetBasePositionAndOrientation(made["far"], [0.5, 0, 0.001], [0, 0, 0, 1], client)
    world.step(2)
    assert world.tendons[0].asleep
