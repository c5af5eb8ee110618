"""What a tendon takes of the process's memory."""

import sys

import pybullet as p
import pytest

import bullet_tendon as bt


def allocated():
    """Address space of this process [bytes]."""
    with open("/proc/self/statm") as f:
        return 4096 * int(f.read().split()[0])


def tendons(world, count):
    lines = [[[0, 0, 0.1 * k], [0.2, 0, 0.1 * k]] for k in range(count)]
    return [world.add_tendon(x, 0.002, bt.Material(stiffness=1e3, damping=1.0), 20) for x in lines]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_tendon_that_touches_nothing_takes_less_than_120_kB(make_world):
    world = make_world(gravity=(0, 0, -9.81))
    before = allocated()
    for t in tendons(world, 200):
        t.grip(0)
    world.step(3)
    assert allocated() - before < 200 * 120e3


def test_shapes_far_away_take_no_memory_for_planes(make_world, client):
    """A state holds what is known of each tendon and shape: nothing, where they were never near."""
    world = make_world(gravity=(0, 0, -9.81))
    (t,) = tendons(world, 1)
    t.grip(0)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05, physicsClientId=client)

    def add(x):
        world.add_obstacle(p.createMultiBody(0, ball, basePosition=x, physicsClientId=client), friction=1.0)
        world.step()
        return len(world._core.save())

    alone = add([0, 5, 0])
    far = add([0, 6, 0])
    near = add([0.1, 0, -0.051])
    features = (
        39 * 64
    )  # bytes: more than what else is kept of a body, less than what is kept of a shape's planes
    assert far - alone < features < near - far
