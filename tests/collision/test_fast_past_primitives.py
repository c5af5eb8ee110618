"""Fast tendons beside convex shapes: a way over a face, or that ends clear, does not cut a step."""

import numpy as np
import pybullet as p
import pytest
from brute_force import signed_distance
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bullet_tendon as bt

R, DT = 0.002, 1 / 240
ROPE = bt.Material(stiffness=1e3, damping=0.5, friction=1.0)


def add(client, shape, at=(0, 0, 0), turn=(0, 0, 0, 1)):
    collision = p.createCollisionShape(**shape, physicsClientId=client)
    return p.createMultiBody(0, collision, -1, at, turn, physicsClientId=client)


def plate(client, top=0.0):
    return add(client, {"shapeType": p.GEOM_BOX, "halfExtents": [30, 30, 5]}, (0, 0, top - 5))


def lying(world, height, count=9):
    return world.add_tendon([[-0.02, 0, height], [0.02, 0, height]], R, ROPE, count)


def shoot(tendon, velocity):
    tendon.set_positions(tendon.positions, np.tile(velocity, (tendon.particles, 1)))


@pytest.mark.parametrize("speed", [2.0, 20.0, 100.0])
def test_a_tendon_slides_along_a_box_in_whole_steps(make_world, client, speed):
    """Coulomb's friction brakes it by mu g, however many radii a step takes it along."""
    friction, steps = 0.3, 60
    world = make_world(DT, gravity=(0, 0, -9.81))
    world.add_obstacle(plate(client), friction=friction)
    t = lying(world, R)
    shoot(t, (0.6 * speed, 0.8 * speed, 0))
    for _ in range(steps):
        world.step()
        assert "motion" not in world.report.reasons
        assert world.report.converged
    slid = t.velocities @ (0.6, 0.8, 0)
    assert slid == pytest.approx(speed - friction * 9.81 * DT * steps, rel=1e-6)
    assert t.positions[:, 2] == pytest.approx(R, rel=1e-3)


@pytest.mark.parametrize("speed", [3.0, 30.0, 300.0])
def test_a_tendon_lands_on_a_box_in_whole_steps(make_world, client, speed):
    """It would end far behind the face, whose plane holds it as a half-space would."""
    world = make_world(DT, gravity=(0, 0, -9.81))
    world.add_obstacle(plate(client), friction=0.0)
    t = lying(world, 5 * R)
    shoot(t, (0.3 * speed, 0, -speed))
    for _ in range(5):
        world.step()
        assert "motion" not in world.report.reasons
        assert t.positions[:, 2].min() >= 0.999 * R


def test_a_tendon_leaves_a_ball_in_whole_steps(make_world, client):
    world = make_world(DT)
    world.add_obstacle(add(client, {"shapeType": p.GEOM_SPHERE, "radius": 0.02}), friction=0.0)
    t = lying(world, 0.02 + R)
    shoot(t, (0, 5.0, 20.0))
    for _ in range(3):
        world.step()
        assert "motion" not in world.report.reasons
    assert t.velocities == pytest.approx(np.tile([0, 5.0, 20.0], (9, 1)), rel=1e-6)


def test_a_tendon_that_runs_over_an_edge_is_not_held_by_the_face(make_world, client):
    """Beyond the edge it falls freely: the plane of the face ends there."""
    world = make_world(DT, gravity=(0, 0, -9.81))
    world.add_obstacle(add(client, {"shapeType": p.GEOM_BOX, "halfExtents": [0.03, 0.1, 0.01]}), friction=0.0)
    t = lying(world, 0.01 + R)
    shoot(t, (20.0, 0, 0))
    for _ in range(12):
        world.step()
    fallen = 12 - int((0.03 + 0.02) / (20 * DT)) - 1  # steps since its last particle has passed the edge
    assert t.velocities[:, 2].max() < -9.81 * DT * fallen


# Of three numbers: what pybullet is told, and the sizes as signed_distance takes them.
SHAPES = {
    "box": lambda a: ({"shapeType": p.GEOM_BOX, "halfExtents": list(a)}, 2 * a),
    "capsule": lambda a: (
        {"shapeType": p.GEOM_CAPSULE, "radius": a[0], "height": 2 * a[1]},
        (a[0], 2 * a[1]),
    ),
    "cylinder": lambda a: (
        {"shapeType": p.GEOM_CYLINDER, "radius": a[0], "height": 2 * a[1]},
        (a[0], 2 * a[1]),
    ),
    "sphere": lambda a: ({"shapeType": p.GEOM_SPHERE, "radius": a[0]}, a[:1]),
}


@settings(max_examples=40, deadline=None)
@given(name=st.sampled_from(sorted(SHAPES)), seed=st.integers(0, 2**31))
def test_nothing_enters_a_convex_shape(name, seed):
    """Shot past, along and at a shape by up to 60 m/s, its centreline stays outside."""
    random = np.random.default_rng(seed)
    client = p.connect(p.DIRECT)
    try:
        p.setTimeStep(DT, physicsClientId=client)
        world = bt.TendonWorld(client)
        size = random.uniform(0.004, 0.04, 3)
        shape, sizes = SHAPES[name](size)
        world.add_obstacle(add(client, shape), friction=random.uniform(0, 0.5))
        way = random.normal(size=3)
        middle = (np.linalg.norm(size) + 0.01) * way / np.linalg.norm(way)
        along = np.cross(way, random.normal(size=3))
        half = 0.015 * along / np.linalg.norm(along)
        t = world.add_tendon([middle - half, middle + half], R, ROPE, 9)
        assume(signed_distance(name, sizes, t.positions).min() > R)  # long capsules reach further
        shoot(t, 10 ** random.uniform(0, 1.8) * (random.normal(size=3) - 1.5 * way) / 2.5)
        for _ in range(8):
            world.step()
            assert signed_distance(name, sizes, t.positions).min() > 0.5 * R
    finally:
        p.disconnect(client)
