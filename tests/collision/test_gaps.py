"""How far a centreline is from all that it could meet: bounds from below, exact where it is near."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

SHAPES = {
    "sphere": lambda c: p.createCollisionShape(p.GEOM_SPHERE, radius=0.03, physicsClientId=c),
    "box": lambda c: p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.03, 0.02, 0.04], physicsClientId=c),
    "plane": lambda c: p.createCollisionShape(p.GEOM_PLANE, planeNormal=[0, 0, 1], physicsClientId=c),
}
TURNED = p.getQuaternionFromEuler([0.3, -0.5, 0.8])


def distances(kind, points) -> np.ndarray:
    """(...,) of points (..., 3) in the shape's frame from its surface [m]; 0 inside."""
    if kind == "sphere":
        return np.maximum(np.linalg.norm(points, axis=-1) - 0.03, 0)
    if kind == "plane":
        return np.maximum(points[..., 2], 0)
    return np.linalg.norm(np.maximum(np.abs(points) - [0.03, 0.02, 0.04], 0), axis=-1)


def along(line, n=201) -> np.ndarray:
    """(k, n, 3) points of a line's k segments."""
    return line[:-1, None] + np.linspace(0, 1, n)[:, None] * np.diff(line, axis=0)[:, None]


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("most", [0.01, 0.2])
def test_of_shapes(make_world, client, kind, most):
    world = make_world(1 / 240, (0, 0, 0))
    place = [0.01, -0.02, 0.005]
    world.add_obstacle(p.createMultiBody(0, SHAPES[kind](client), -1, place, TURNED, physicsClientId=client))
    line = np.cumsum(np.random.default_rng(5).normal(0, 0.03, (60, 3)), axis=0)
    axes = np.reshape(p.getMatrixFromQuaternion(TURNED), (3, 3))
    exact = distances(kind, (along(line) - place) @ axes).min(axis=1)
    found = world._readouts.surroundings().gaps(line, most)
    assert (found <= exact + 1e-7).all()
    near = exact < most
    assert near.any()
    np.testing.assert_allclose(found[near], exact[near], atol=2e-4)  # of what was sampled
    assert (found[~near] >= most - 1e-7).all()


def test_of_bores(make_world, client):
    world = make_world(1 / 240, (0, 0, 0))
    body = p.createMultiBody(0, -1, -1, [0.01, 0, 0], TURNED, physicsClientId=client)
    world.add_tunnel(body, -1, [0, 0, -0.02], [0, 0, 0.03], 0.004)
    line = np.cumsum(np.random.default_rng(6).normal(0, 0.01, (60, 3)), axis=0)
    axes = np.reshape(p.getMatrixFromQuaternion(TURNED), (3, 3))
    points = (along(line) - [0.01, 0, 0]) @ axes
    nearest = points[..., 2].clip(-0.02, 0.03)[..., None] * [0, 0, 1]
    exact = np.maximum(np.linalg.norm(points - nearest, axis=-1).min(axis=1) - 0.004, 0)
    found = world._readouts.surroundings().gaps(line, 1.0)
    assert (found <= exact + 1e-9).all()
    assert (found >= exact - np.linalg.norm(np.diff(line, axis=0), axis=1)).all()


def test_of_nothing(make_world):
    world = make_world(1 / 240, (0, 0, 0))
    assert np.isinf(world._readouts.surroundings().gaps(np.zeros((3, 3)), 1.0)).all()


def test_of_a_removed_body(make_world, client):
    world = make_world(1 / 240, (0, 0, 0))
    body = p.createMultiBody(0, SHAPES["sphere"](client), physicsClientId=client)
    world.add_obstacle(body)
    world.add_tendon([(0.1, 0, 0), (0.2, 0, 0)], 0.001, bt.Material(stiffness=1e3))
    p.removeBody(body, client)
    with pytest.raises(bt.UnknownId):
        world.relax()
