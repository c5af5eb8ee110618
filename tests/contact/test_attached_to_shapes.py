"""Tendons that are attached to a shape at its surface, or beneath it, and led over it."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

ROUND, HALF, RADIUS, LENGTH = 0.012, 0.05, 5e-4, 0.5  # m
SIZES = {
    p.GEOM_SPHERE: {"radius": ROUND},
    p.GEOM_CAPSULE: {"radius": ROUND, "height": 2 * (HALF - ROUND)},
    p.GEOM_CYLINDER: {"radius": ROUND, "height": 2 * HALF},
    p.GEOM_BOX: {"halfExtents": [ROUND, ROUND, HALF]},
}
SLANTED = p.getQuaternionFromEuler([0.3, 0.9, -0.4])


def held_body(client, shape, mass, at):
    """Static, or held by three constraints."""
    body = p.createMultiBody(mass, shape, -1, at, SLANTED, physicsClientId=client)
    for corner in np.eye(3) * 0.03 if mass else ():
        place, _ = p.multiplyTransforms(at, SLANTED, corner.tolist(), [0, 0, 0, 1])
        p.createConstraint(
            body, -1, -1, -1, p.JOINT_POINT2POINT, [0, 0, 0], corner.tolist(), place, physicsClientId=client
        )
    return body


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize("mass", [0.0, 0.1])
@pytest.mark.parametrize("n", [16, 60])
@pytest.mark.parametrize(
    ("kind", "deep"),
    [
        *((p.GEOM_SPHERE, deep) for deep in (0.0, 3e-4, 2e-3)),
        *((p.GEOM_CAPSULE, deep) for deep in (0.0, 3e-4, 2e-3)),
        *((kind, deep) for kind in (p.GEOM_CYLINDER, p.GEOM_BOX) for deep in (0.0, 3e-4, 2e-3)),
    ],
)
def test_comes_to_rest_over_its_end(make_world, client, kind, deep, n, mass):
    """The tendon leaves along the end of the shape, and its hand leads it over the edge, or around it."""
    world = make_world(1 / 240)
    shape = p.createCollisionShape(kind, physicsClientId=client, **SIZES[kind])
    body = held_body(client, shape, mass, [0.1, -0.2, 0.3])
    world.add_obstacle(body, friction=0.0)
    turned = np.array(p.getMatrixFromQuaternion(SLANTED)).reshape(3, 3)
    end = (ROUND if kind == p.GEOM_SPHERE else HALF) - deep
    start = [0.1, -0.2, 0.3] + turned @ [0, 0, end]
    material = bt.Material.from_modulus(5e8, RADIUS, density=1100.0, damping=0.01)
    t = world.add_tendon([start, start + turned @ [LENGTH, 0, 0]], RADIUS, material, n)
    t.attach(0, body)
    hand = t.grip(-1)
    for k in range(240):
        angle = 0.5 * (k + 1) / 240
        hand.target = start + 1.002 * LENGTH * turned @ [np.cos(angle), 0, -np.sin(angle)]
        world.step()
    world.step(60)
    pulls, solved = [], 0
    for _ in range(60):
        world.step()
        assert world.report.converged
        pulls.append(t.tension[[0, -1]])
        solved += world.report.iterations
    assert solved <= 3 * 60
    np.testing.assert_allclose(pulls, [pulls[-1]] * len(pulls), rtol=1e-3)
    # Only the attachment and what presses on the shape hold the hand.
    np.testing.assert_allclose(world.wrench(body)[:3], -np.array(hand.force), atol=1e-3 * pulls[-1][1])
