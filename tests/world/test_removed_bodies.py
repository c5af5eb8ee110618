"""Bodies that are removed from pybullet while they touch, or are joined to, what hangs on tendons."""

import itertools

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G = 9.81
TRAY, MASS = 0.5, 2.0  # masses of the tray and of what stands on it [kg]
ROPE = bt.Material(stiffness=2e4, damping=200.0, density=1e-3)
CALLS = {
    "hash": lambda world: world.state_hash(),
    "save": lambda world: world.save_state(),
    "snapshot": lambda world: world.snapshot(),
    "apply": lambda world: world.apply(),
    "step": lambda world: world.step(),
}


def box(client, half, height, mass):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    return p.createMultiBody(mass, shape, basePosition=(0, 0, height), physicsClientId=client)


def tray_on_ropes(world, client):
    """A tray on four ropes, at z = 0; the ropes."""
    tray = box(client, (0.1, 0.1, 0.01), 0.0, TRAY)
    ropes = []
    for x, y in itertools.product((-0.09, 0.09), repeat=2):
        rope = world.add_tendon([[x, y, 0.5], [x, y, 0.01]], 1e-3, ROPE, 4, collides=False)
        rope.grip(0)
        rope.attach(-1, tray, -1)
        ropes.append(rope)
    return tray, ropes


def two_boxes(client, height):
    """A box with another one on it, on a hinge: instead of a body without links."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client)
    return p.createMultiBody(
        MASS,
        shape,
        basePosition=(0, 0, height),
        linkMasses=[0.5],
        linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[-1],
        linkPositions=[[0, 0, 0.04]],
        linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0],
        linkJointTypes=[p.JOINT_REVOLUTE],
        linkJointAxis=[[0, 0, 1]],
        physicsClientId=client,
    )


def tie_loosely(world, body):
    """A slack tendon to the body; what takes it out again."""
    slack = world.add_tendon([[0, 0, 0.5], [0, 0, 0.05]], 1e-3, ROPE, 4, rest_length=0.6, collides=False)
    slack.grip(0)
    slack.attach(-1, body, -1)
    return lambda: world.remove_tendon(slack)


def touch(world, body):
    """The body is an obstacle; what takes it out again."""
    world.add_obstacle(body)
    return lambda: world.remove_obstacle(body)


KNOWN = {"not": lambda world, body: lambda: None, "by a tendon": tie_loosely, "as an obstacle": touch}


@pytest.mark.parametrize("known", KNOWN)
@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize("instead", [None, "same", "other"])
@pytest.mark.parametrize("call", CALLS)
def test_ropes_carry_what_is_still_there(make_world, client, call, instead, joined, known):
    """Whatever is asked first. instead: what takes the place, and the id, of the one that is removed.

    joined: a constraint joins it to the tray. known: how the world knows it.
    """
    world = make_world(1 / 240, (0, 0, -G))
    tray, ropes = tray_on_ropes(world, client)
    stands = box(client, [0.02] * 3, 0.03, MASS)
    if joined:
        at = (0, 0, 0.01), (0, 0, -0.02)
        p.createConstraint(tray, -1, stands, -1, p.JOINT_FIXED, (0, 0, 0), *at, physicsClientId=client)
    take_out = KNOWN[known](world, stands)
    world.step(240)
    carried = sum(rope.tension.mean() for rope in ropes)
    assert carried == pytest.approx((TRAY + MASS) * G, rel=1e-3)
    p.removeBody(stands, physicsClientId=client)
    take_out()
    left = TRAY
    if instead == "same":
        assert box(client, [0.02] * 3, 0.03, MASS) == stands
        left += MASS
    elif instead == "other":
        assert two_boxes(client, 0.03) == stands
        left += MASS + 0.5
    CALLS[call](world)
    world.step(480)
    carried = sum(rope.tension.mean() for rope in ropes)
    assert carried == pytest.approx(left * G, rel=1e-3)
    assert np.linalg.norm(p.getBaseVelocity(tray, client)) < 1e-3
