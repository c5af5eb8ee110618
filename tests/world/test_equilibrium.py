"""relax(bodies=...): bodies and joints put where ligaments, cartilage, gravity and told forces balance."""

import math

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G = 9.81


def block(client, mass, at=(0, 0, 0), half=(0.02, 0.03, 0.05)):
    """A box that pybullet neither damps nor lets collide."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    body = p.createMultiBody(mass, shape, -1, at, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.setCollisionFilterGroupMask(body, -1, 0, 0, client)
    return body


def place(body, client):
    return np.concatenate(p.getBasePositionAndOrientation(body, client))


def hung(world, client):
    """A block in six strands, and the block."""
    stand, body = block(client, 0), block(client, 2.0, (0.01, -0.02, -0.15))
    rng = np.random.default_rng(7)
    for _ in range(6):
        above, below = rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.02, 0.02, 3)
        path = [(stand, -1, (above[0], above[1], 0)), (body, -1, (*below[:2], 0.05))]
        world.add_ligament(path, bt.Material.ligament(2e3, damping=60.0), rest_length=0.09)
    return body


def test_what_is_put_there_does_not_move(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    start = place(body, client)
    world.relax(bodies=[body], tolerance=1e-9)
    assert world.report.converged and world.report.residual <= 1e-9
    found, forces = place(body, client), [ligament.force for ligament in world.ligaments]
    assert np.abs(found - start).max() > 1e-3
    world.step(5)
    np.testing.assert_allclose(place(body, client), found, atol=1e-8)
    np.testing.assert_allclose([ligament.force for ligament in world.ligaments], forces, atol=1e-5)


def test_a_told_force_is_balanced(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    world.relax(bodies=[body], tolerance=1e-9)
    before = place(body, client)
    pull = np.array([5.0, 3.0, 0.0])
    world.apply_external_force(body, -1, pull, before[:3], p.WORLD_FRAME)
    world.relax(bodies=[body], tolerance=1e-9)
    assert np.abs(place(body, client) - before).max() > 1e-3
    total, torque = np.zeros(3), np.zeros(3)
    for ligament in world.ligaments:
        upper, lower = ligament.points
        force = ligament.force * (upper - lower) / np.linalg.norm(upper - lower)
        total += force
        torque += np.cross(lower - place(body, client)[:3], force)
    np.testing.assert_allclose(total, [-5, -3, 2 * G], atol=1e-6)
    np.testing.assert_allclose(torque, 0, atol=1e-7)


@pytest.mark.parametrize("flags", [p.WORLD_FRAME, p.LINK_FRAME])
def test_forces_of_the_call_are_balanced_and_those_of_the_link_follow_it(make_world, client, flags):
    """Three forces, as a couple and a pull; pybullet is given none of them."""
    world = make_world(1 / 240, (0, 0, -G))
    body = hung(world, client)
    world.relax(bodies=[body], tolerance=1e-9)
    centre, turn = p.getBasePositionAndOrientation(body, client)
    axes = np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))
    couple = ((0, 0.5, 0), (0.02, 0, 0)), ((0, -0.5, 0), (-0.02, 0, 0))
    given = [((4.0, 3.0, -2.0), (0.01, 0.0, -0.05)), *couple]
    forces = []
    for force, point in given:
        if flags == p.WORLD_FRAME:
            point = centre + axes @ point
        forces.append((body, -1, force, tuple(point), flags))
    world.relax(bodies=[body], tolerance=1e-9, forces=forces)
    assert world.report.converged
    found, turned = p.getBasePositionAndOrientation(body, client)
    now = np.reshape(p.getMatrixFromQuaternion(turned), (3, 3))
    assert np.abs(now - axes).max() > 0.02
    total, torque = np.array([0, 0, -2 * G]), np.zeros(3)
    for force, point in given:
        along = now @ force if flags == p.LINK_FRAME else np.array(force)
        total += along
        torque += np.cross(now @ point, along)
    for ligament in world.ligaments:
        upper, lower = ligament.points
        force = ligament.force * (upper - lower) / np.linalg.norm(upper - lower)
        total += force
        torque += np.cross(lower - found, force)
    np.testing.assert_allclose(total, 0, atol=1e-6)
    np.testing.assert_allclose(torque, 0, atol=1e-7)
    world.relax(bodies=[body], tolerance=1e-9)
    before = place(body, client)
    world.step(3)
    np.testing.assert_allclose(place(body, client), before, atol=1e-8)


def test_a_joint_is_free_and_the_others_stay(make_world, client):
    """Two links on hinges; a line of constant tension turns the first one until the torques balance."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.01, 0.1], physicsClientId=client)
    arm = p.createMultiBody(
        0,
        -1,
        -1,
        (0, 0, 0),
        linkMasses=[1.0, 1.0],
        linkCollisionShapeIndices=[shape] * 2,
        linkVisualShapeIndices=[-1] * 2,
        linkPositions=[(0, 0, 0), (0, 0, -0.2)],
        linkOrientations=[(0, 0, 0, 1)] * 2,
        linkInertialFramePositions=[(0, 0, -0.1)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_REVOLUTE] * 2,
        linkJointAxis=[(0, 1, 0)] * 2,
        physicsClientId=client,
    )
    p.resetJointState(arm, 1, 0.3, 0, client)
    stand = block(client, 0, (1.0, 0, -0.2))
    line = world.add_ligament([(stand, -1, (0, 0, 0)), (arm, 0, (0, 0, -0.2))], bt.Material(stiffness=1.0))
    line.set_tension(10.0)
    world.relax(bodies=[(arm, [0])], tolerance=1e-8)
    assert world.report.converged
    angle, other = (p.getJointState(arm, joint, client)[0] for joint in (0, 1))
    assert other == 0.3
    tip = 0.2 * np.array([-math.sin(angle), 0, -math.cos(angle)])
    along = np.array([1.0, 0, -0.2]) - tip
    pull = 10.0 * along / np.linalg.norm(along)
    centres = tip / 2, tip + 0.1 * np.array([-math.sin(angle + 0.3), 0, -math.cos(angle + 0.3)])
    torque = np.cross(tip, pull) + sum(np.cross(centre, [0, 0, -G]) for centre in centres)
    assert abs(torque[1]) <= 1e-6


def test_what_hangs_on_nothing_is_put_back(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, body = block(client, 0), block(client, 1.0, (0, 0, -0.1))
    with pytest.warns(bt.SlackWarning):
        world.add_ligament([(stand, -1, (0, 0, 0)), (body, -1, (0, 0, 0))], bt.Material.ligament(1e3), 1e3)
    before = place(body, client)
    world.relax(bodies=[body], max_steps=20)
    assert not world.report.converged
    np.testing.assert_allclose(place(body, client), before, atol=1e-12)


def test_bad_calls_change_nothing(make_world, client):
    world = make_world()
    stand, body = block(client, 0), block(client, 1.0, (0, 0, -0.1))
    world.add_ligament([(stand, -1, (0, 0, 0)), (body, -1, (0, 0, 0))], bt.Material.ligament(1e3))
    for bodies, error in (
        (body, bt.InvalidType),
        ([stand], bt.InvalidValue),
        ([body, body], bt.InvalidValue),
        ([77], bt.UnknownId),
        ([(body, [0])], bt.InvalidValue),
    ):
        with pytest.raises(error):
            world.relax(bodies=bodies)
    for forces, error in (
        (3, bt.InvalidType),
        ([(body, -1, (1, 0, 0))], bt.InvalidType),
        ([(body, -1, (1, 0, math.nan), (0, 0, 0), p.WORLD_FRAME)], bt.InvalidValue),
        ([(body, -1, (1, 0, 0), (0, 0, 0), 7)], bt.InvalidValue),
        ([(body, 3, (1, 0, 0), (0, 0, 0), p.WORLD_FRAME)], bt.UnknownId),
        ([(stand, -1, (1, 0, 0), (0, 0, 0), p.WORLD_FRAME)], bt.InvalidValue),
    ):
        with pytest.raises(error):
            world.relax(bodies=[body], forces=forces)
    with pytest.raises(bt.InvalidValue):
        world.relax(forces=[(body, -1, (1, 0, 0), (0, 0, 0), p.WORLD_FRAME)])
    tendon = world.add_tendon([(0, 0, -0.2), (0, 0, -0.1)], 0.001, bt.Material(stiffness=1e3), particles=5)
    tendon.attach(-1, body)
    with pytest.raises(bt.InvalidValue, match="no tendon is attached to"):
        world.relax(bodies=[body])
