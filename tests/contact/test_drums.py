"""A load that hangs from a drum, around which its tendon is wound and to which it is attached."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball, links_on_joints

import bullet_tendon as bt

DRUM, WIDTH, RADIUS = 0.1, 0.3, 0.004  # m
G, MASS, FACETS = 9.81, 1.0, 48


def facetted():
    """Vertices of a prism in place of the drum."""
    angles = np.arange(FACETS) * 2 * np.pi / FACETS
    ring = DRUM * np.c_[np.cos(angles), np.sin(angles)]
    return [[*xy, z] for z in (-WIDTH / 2, WIDTH / 2) for xy in ring.tolist()]


def drum(client, facets, motor):
    """Body and link, at rest: static, or held by the motor of its joint."""
    shape = (
        p.createCollisionShape(p.GEOM_MESH, vertices=facetted(), physicsClientId=client)
        if facets
        else p.createCollisionShape(p.GEOM_CYLINDER, radius=DRUM, height=WIDTH, physicsClientId=client)
    )
    turned = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    if not motor:
        return p.createMultiBody(0, shape, -1, [0, 0, 0], turned, physicsClientId=client), -1
    body = links_on_joints(client, p.JOINT_REVOLUTE, [5.0], [(0, 0, 1)], shape, turned=turned)
    hold = {"targetVelocity": 0, "force": motor, "physicsClientId": client}
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, **hold)
    return body, 0


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize("apart", [-1e-3, -1e-5, 0.0, 1e-6, 1e-4, 1e-3], ids=str)
@pytest.mark.parametrize("motor", [0, 50.0], ids=["static", "held"])
@pytest.mark.parametrize("facets", [False, True], ids=["round", "facets"])
def test_load_comes_to_rest(make_world, client, facets, motor, apart):
    """Wherever the attachment is, beside the surface or at it: the tendon carries the weight, in each step.

    The tendon is laid on a circle `apart` [m] from the one on which its centreline touches the drum.
    """
    world = make_world(1 / 240, (0, 0, -G))
    body, link = drum(client, facets, motor)
    world.add_obstacle(body, friction=0.3)
    out = DRUM + RADIUS + apart
    angles = np.linspace(1.5 * np.pi, 0, 25)
    wound = np.c_[out * np.cos(angles), 0 * angles, out * np.sin(angles)]
    load = free_ball(client, MASS, (out, 0, -1.0), 0.05)
    material = bt.Material.from_modulus(2e9, RADIUS)
    t = world.add_tendon([*wound.tolist(), [out, 0, -1.0]], RADIUS, material, 60)
    t.attach(0, body, link)
    t.attach(-1, load)
    world.step(420)
    for _ in range(60):
        world.step()
        assert t.tension[-1] == pytest.approx(MASS * G, rel=0.01)
        assert world.report.iterations <= 4
