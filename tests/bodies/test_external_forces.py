"""Forces of the user of which the tendons are told, TendonWorld.apply_external_force."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED, free_ball, hinged, misfit

import bullet_tendon as bt

LENGTH = 0.2
CUT = 99.9  # [m/s], [rad/s]: pybullet cuts rates off at 100
STOPPED = 99.0  # spin at which free bodies are stopped [rad/s]
FRAMES = [p.WORLD_FRAME, p.LINK_FRAME]
FORCE, POINT = [3.0, -2.0, 1.0], [0.02, 0.01, -0.03]


def taut(world, body, lever, stiffness=1e5, damping=1e-3):
    """A tendon from a grip above, attached beside the body's centre."""
    material = bt.Material(stiffness=stiffness, damping=damping * stiffness)
    t = world.add_tendon([[0, 0, LENGTH], [lever, 0, 0]], 1e-3, material, 12)
    t.grip(0)
    return t, t.attach(-1, body)


def pull(world, body, force):
    at = p.getBasePositionAndOrientation(body, world.physicsClientId)[0]
    world.apply_external_force(body, -1, force, at, p.WORLD_FRAME)


def offset_box(client):
    """Its inertial frame is neither at its link frame's origin nor along its axes."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.02, 0.03], physicsClientId=client)
    turn = p.getQuaternionFromEuler([0.4, 0.2, -0.7])
    body = p.createMultiBody(
        0.3, shape, -1, [0.1, 0.2, 0.3], turn,
        baseInertialFramePosition=[0.01, -0.02, 0.03], baseInertialFrameOrientation=turn,
        physicsClientId=client,
    )  # fmt: skip
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    return body


def motion(body, client):
    found = p.getBasePositionAndOrientation(body, client) + p.getBaseVelocity(body, client)
    joints = [p.getJointState(body, j, client)[:2] for j in range(p.getNumJoints(body, client))]
    return np.concatenate([*found, *joints])


@pytest.mark.parametrize("flags", FRAMES)
@pytest.mark.parametrize("kind, link", [("box", -1), ("arm", 0)])
def test_the_body_moves_as_pybullet_alone_moves_it(make_world, client, tmp_path, kind, link, flags):
    body = offset_box(client) if kind == "box" else hinged(client, tmp_path)
    world, start = make_world(1 / 240), p.saveState(client)
    ends = []
    for apply in (p.applyExternalForce, world.apply_external_force):
        p.restoreState(start, physicsClientId=client)
        told = {"physicsClientId": client} if apply is p.applyExternalForce else {}
        for _ in range(20):
            if link >= 0:
                p.getLinkState(body, link, 0, 1, client)  # else pybullet uses the pose of a step ago
            apply(body, link, FORCE, POINT, flags, **told)
            world.step()
        ends.append(motion(body, client))
    np.testing.assert_allclose(*ends, atol=1e-12)
    p.restoreState(start, physicsClientId=client)
    assert np.abs(ends[0] - motion(body, client)).max() > 1e-3


@pytest.mark.parametrize("mass", [0.002, 0.2])
@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240])
def test_a_sudden_force_is_no_surprise(make_world, client, mass, dt):
    """It comes and ends between two steps; no step is taken again, and the end stays on the body."""
    world = make_world(dt)
    body = free_ball(client, mass)
    t, held = taut(world, body, 0.0)
    world.step(10)
    for k in range(60):
        if k < 30:
            pull(world, body, [0.0, 0.0, -200.0])
        world.step()
        assert not world.report.reasons.get("released", 0)
        assert misfit(t, held, client) <= 1e-7
        assert k != 25 or t.tension.max() > 100


def chain(client, kind, floating):
    """Three links of 50 g on hinges or sliders, whose motors are off."""
    pose, count = [0.0, 0.0, 0.0, 1.0], 3
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=client)
    body = p.createMultiBody(
        0.2 if floating else 0.0,
        ball,
        linkMasses=[0.05] * count,
        linkCollisionShapeIndices=[ball] * count,
        linkVisualShapeIndices=[-1] * count,
        linkPositions=[[0.1, 0, 0]] * count,
        linkOrientations=[pose] * count,
        linkInertialFramePositions=[[0.05, 0, 0]] * count,
        linkInertialFrameOrientations=[pose] * count,
        linkParentIndices=list(range(count)),
        linkJointTypes=[p.JOINT_FIXED, kind, kind],
        linkJointAxis=[[0, 0, 1], [0, 1, 0], [0, 1, 0]],
        physicsClientId=client,
    )
    for link in range(-1, count):
        p.changeDynamics(body, link, **UNDAMPED, jointDamping=0, physicsClientId=client)
    for joint in (1, 2):
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


CHAINS = [(kind, floating) for kind in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC) for floating in (False, True)]


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("kind, floating", CHAINS)
def test_a_joint_moves_as_pybullet_alone_moves_it(make_world, client, kind, floating, joint):
    world, ends = make_world(1 / 240), []
    body = chain(client, kind, floating)
    start = p.saveState(client)
    for told in (False, True):
        p.restoreState(start, physicsClientId=client)
        for _ in range(10):
            if told:
                world.apply_joint_force(body, joint, 0.01)
            else:
                p.setJointMotorControl2(body, joint, p.TORQUE_CONTROL, force=0.01, physicsClientId=client)
            world.step()
        ends.append(motion(body, client))
    np.testing.assert_array_equal(*ends)
    assert np.abs(ends[0]).max() > 1e-3


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("kind, floating", CHAINS)
def test_a_sudden_force_on_a_joint_is_no_surprise(make_world, client, kind, floating, joint):
    """It begins between two steps, at a cord whose end stays on its link; a step later it is no news."""
    world, force = make_world(1 / 240), -1.0 if kind == p.JOINT_PRISMATIC else -0.01
    body = chain(client, kind, floating)
    cord = world.add_tendon([(0.4, 0.1, 0), (0.4, 0, 0)], 1e-3, bt.Material(stiffness=1e4, damping=10.0), 8)
    cord.grip(0)
    knot = cord.attach(-1, body, 2)
    world.step(3)
    before = motion(body, client)
    for _ in range(2):
        world.apply_joint_force(body, joint, force)
        world.step()
        assert world.report.converged and not world.report.reasons.get("released", 0)
        # Of the second order in how far the joints move; by a force that is not told it is of the first.
        moved = np.abs(motion(body, client) - before)[[0, 1, 2, -4, -2]].max()  # base [m], joints [m], [rad]
        assert misfit(cord, knot, client) <= 4e-3 * moved


FAST = [  # kg, N, m, s, damping over stiffness [s]
    (0.00141, 660, 0.0058, 0.00412, 1e-5),
    (0.00451, 270, 0.0071, 0.00357, 1e-4),
    (0.00238, 264, 0.0057, 0.00304, 1e-3),
    (0.00335, 141, 0.0078, 0.00289, 1e-4),
    (0.00332, 204, 0.0038, 0.00475, 1e-3),
    (0.00727, 540, 0.0052, 0.00260, 1e-5),
    (0.00189, 355, 0.0049, 0.00316, 1e-5),
    (0.00785, 187, 0.0079, 0.00286, 1e-5),
]


@pytest.mark.parametrize("mass, force, lever, dt, damping", FAST)
def test_what_stops_a_spin_is_not_taken_for_a_torque(make_world, client, mass, force, lever, dt, damping):
    """A knot beside the centre would spin light bodies beyond 100 rad/s; the step after it is right again."""
    world = make_world(dt, (0, 0, -9.81))
    body = free_ball(client, mass)
    t, held = taut(world, body, lever, 200 * force, damping)
    world.step(60)
    rates, stopped, judged = np.zeros(6), 0, 0
    for k in range(120):
        if k < 40:
            pull(world, body, [0.1 * force, 0.15 * force, -force])
        before = rates
        world.step()
        rates = np.abs(np.concatenate(p.getBaseVelocity(body, client)))
        stopped += rates[3:].max() > 0.999 * STOPPED
        if max(rates.max(), before.max()) > CUT:
            continue
        judged += 1
        turn = dt * np.linalg.norm(rates[3:])
        assert misfit(t, held, client) <= 1e-7 + 0.5 * lever * turn**2
    assert stopped >= 1 and judged >= 60


def test_a_failed_step_keeps_the_force(make_world, client, monkeypatch):
    """pybullet keeps what was applied until it is stepped; the next step is told of it again."""
    world = make_world(1 / 240)
    body = free_ball(client, 0.01)
    t, held = taut(world, body, 0.0)
    world.step(3)
    pull(world, body, [0, 0, -50.0])
    t.set_force(5, [1e300, 0, 0])
    with pytest.raises(bt.StepFailed):
        world.apply()
    t.set_force(5, [0, 0, 0])
    world.step()
    assert misfit(t, held, client) <= 1e-9 and t.tension.max() > 10


def test_an_untouched_body_is_simply_pushed(make_world, client):
    world = make_world(1 / 100)
    body = free_ball(client, 2.0)
    pull(world, body, [4.0, 0, 0])
    world.step(2)
    np.testing.assert_allclose(p.getBaseVelocity(body, client)[0], [0.02, 0, 0], atol=1e-12)


BAD = {
    "no body": ((99, -1, FORCE, POINT, p.WORLD_FRAME), bt.UnknownId, "bodyUniqueId"),
    "no link": ((0, 3, FORCE, POINT, p.WORLD_FRAME), bt.UnknownId, "linkIndex"),
    "not finite": ((0, -1, [0, 0, np.nan], POINT, p.WORLD_FRAME), bt.InvalidValue, "forceObj"),
    "short": ((0, -1, FORCE, [0, 0], p.WORLD_FRAME), bt.InvalidValue, "posObj"),
    "text": ((0, -1, "abc", POINT, p.WORLD_FRAME), bt.InvalidType, "forceObj"),
    "no frame": ((0, -1, FORCE, POINT, 7), bt.InvalidValue, "flags"),
    "frame of text": ((0, -1, FORCE, POINT, "world"), bt.InvalidType, "flags"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_forces_are_refused(make_world, client, what):
    arguments, error, name = BAD[what]
    world = make_world(1 / 240)
    body = free_ball(client, 1.0)
    assert body == 0
    with pytest.raises(error) as caught:
        world.apply_external_force(*arguments)
    assert caught.value.argument == name
    world.step()
    assert not np.any(p.getBaseVelocity(body, client))


BAD_JOINTS = {
    "no body": ((99, 1, 1.0), bt.UnknownId, "bodyUniqueId"),
    "no joint": ((0, 3, 1.0), bt.UnknownId, "jointIndex"),
    "a base": ((0, -1, 1.0), bt.UnknownId, "jointIndex"),
    "a fixed joint": ((0, 0, 1.0), bt.InvalidValue, "jointIndex"),
    "text": ((0, "1", 1.0), bt.InvalidType, "jointIndex"),
    "not finite": ((0, 1, np.inf), bt.InvalidValue, "force"),
    "a vector": ((0, 1, [0, 0, 1]), bt.InvalidType, "force"),
}


@pytest.mark.parametrize("what", BAD_JOINTS)
def test_bad_forces_on_joints_are_refused(make_world, client, what):
    arguments, error, name = BAD_JOINTS[what]
    world = make_world(1 / 240)
    body = chain(client, p.JOINT_REVOLUTE, False)
    with pytest.raises(error) as caught:
        world.apply_joint_force(*arguments)
    assert caught.value.argument == name
    world.step()
    assert [p.getJointState(body, joint, client)[1] for joint in (1, 2)] == [0, 0]
