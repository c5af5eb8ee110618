"""Spins that tendons would give bodies beyond 100 rad/s, where pybullet cuts them off."""

import numpy as np
import pybullet as p
import pytest
from brute_force import signed_distance
from link_scenes import UNDAMPED

import bullet_tendon as bt

RADIUS = 0.002  # m
CORD = bt.Material(stiffness=1e4, damping=1.0)
HALF = np.array([0.06, 0.04, 0.004])  # of the plate [m]
CUT_OFF = 100.0  # of pybullet [rad/s]


def plate(client, mass, tail):
    """A free plate; tail: a small link on a hinge is on it."""
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=HALF.tolist(), physicsClientId=client)
    links = {}
    if tail:
        links = {
            "linkMasses": [0.1 * mass], "linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1],
            "linkPositions": [[0, 0, -0.05]], "linkOrientations": [[0, 0, 0, 1]],
            "linkInertialFramePositions": [[0, 0, -0.01]], "linkInertialFrameOrientations": [[0, 0, 0, 1]],
            "linkParentIndices": [0], "linkJointTypes": [p.JOINT_REVOLUTE], "linkJointAxis": [[0, 1, 0]],
        }  # fmt: skip
    body = p.createMultiBody(mass, box, **links, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    if tail:
        p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


def gap(body, t, client):
    """From its centreline to the plate, inside negative [m]."""
    centre, turn = p.getBasePositionAndOrientation(body, client)
    axes = np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))
    points = np.vstack([t.positions, 0.5 * (t.positions[1:] + t.positions[:-1])])
    return signed_distance("box", 2 * HALF, (points - centre) @ axes).min()


@pytest.mark.parametrize("tail", [False, True])
@pytest.mark.parametrize("mass", [0.05, 0.5])
def test_a_plate_that_is_struck_beside_its_centre_is_not_entered(make_world, client, mass, tail):
    """It turns away as the solution of the step has it, stopped below the cut-off."""
    body = plate(client, mass, tail)
    p.resetBaseVelocity(body, [0, 0, 15.0], [0, 0, 0], client)
    world = make_world(1 / 1000)
    world.add_obstacle(body, friction=0.3)
    t = world.add_tendon([[-0.15, 0.025, 0.01], [0.15, 0.025, 0.01]], RADIUS, CORD, 31)
    t.grip(0), t.grip(-1)
    fastest = 0.0
    for _ in range(50):
        world.step()
        fastest = max(fastest, np.abs(p.getBaseVelocity(body, client)[1]).max())
        assert gap(body, t, client) > 0.99 * RADIUS
    assert 0.98 * CUT_OFF < fastest < CUT_OFF


def test_what_spins_faster_than_that_by_a_higher_cut_off_is_not_stopped(make_world, client):
    disc = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.05, height=0.04, physicsClientId=client)
    body = p.createMultiBody(1.0, disc, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, maxJointVelocity=1e5, physicsClientId=client)
    p.resetBaseVelocity(body, [0, 2.0, 0], [0, 0, 3 * CUT_OFF], client)
    world = make_world(1 / 1000)
    world.add_obstacle(body)
    t = world.add_tendon([[-0.15, 0.053, 0], [0.15, 0.053, 0]], RADIUS, CORD, 31)
    t.grip(0), t.grip(-1)
    pressed = 0.0
    for _ in range(20):
        world.step()
        pressed = max(pressed, np.linalg.norm(world.wrench(body)[:3]))
    assert pressed > 10  # N
    assert p.getBaseVelocity(body, client)[1][2] > 2.9 * CUT_OFF
