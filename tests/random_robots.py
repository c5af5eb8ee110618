"""Random articulated bodies: trees of links with turned inertial frames off centre."""

import numpy as np
import pybullet as p
from link_scenes import turn

KINDS = (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC, p.JOINT_FIXED)
UNDAMPED = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}


def robot(client, rng, floating, kinds=KINDS):
    """A body of 2 to 8 links besides its base, moving, without motors and damping; its number."""
    n = int(rng.integers(2, 9))
    body = p.createMultiBody(
        rng.uniform(0.5, 2) if floating else 0,
        basePosition=rng.normal(size=3),
        baseOrientation=turn(rng),
        baseInertialFramePosition=0.1 * rng.normal(size=3),
        baseInertialFrameOrientation=turn(rng),
        linkMasses=rng.uniform(0.2, 2, n),
        linkCollisionShapeIndices=[-1] * n,
        linkVisualShapeIndices=[-1] * n,
        linkPositions=0.3 * rng.normal(size=(n, 3)),
        linkOrientations=[turn(rng) for _ in range(n)],
        linkInertialFramePositions=0.1 * rng.normal(size=(n, 3)),
        linkInertialFrameOrientations=[turn(rng) for _ in range(n)],
        linkParentIndices=[int(rng.integers(0, k + 1)) for k in range(n)],
        linkJointTypes=[int(kind) for kind in rng.choice(kinds, n)],
        linkJointAxis=[unit(rng) for _ in range(n)],
        physicsClientId=client,
    )
    for link in range(-1, n):
        inertia = rigid_inertia(rng)
        p.changeDynamics(body, link, localInertiaDiagonal=inertia, physicsClientId=client, **UNDAMPED)
    for joint in range(n):
        let_go(client, body, joint)
        place_joint(client, body, joint, rng)
    if floating:
        p.resetBaseVelocity(body, rng.normal(size=3), rng.normal(size=3), physicsClientId=client)
    return body


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def rigid_inertia(rng):
    """Principal moments that a rigid body can have: none above the sum of the others."""
    squares = rng.uniform(0.01, 0.05, 3)
    return (squares.sum() - squares).tolist()


def let_go(client, body, joint):
    """Joint motors off."""
    kind = p.getJointInfo(body, joint, client)[2]
    if kind == p.JOINT_SPHERICAL:
        none = {"positionGain": 0, "velocityGain": 0, "force": [0, 0, 0], "physicsClientId": client}
        p.setJointMotorControlMultiDof(body, joint, p.POSITION_CONTROL, [0, 0, 0, 1], **none)
    elif kind != p.JOINT_FIXED:
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)


def place_joint(client, body, joint, rng):
    """Angle and rate at random."""
    kind = p.getJointInfo(body, joint, client)[2]
    if kind == p.JOINT_SPHERICAL:
        p.resetJointStateMultiDof(body, joint, turn(rng), rng.normal(size=3), physicsClientId=client)
    elif kind != p.JOINT_FIXED:
        p.resetJointState(body, joint, *rng.normal(size=2), physicsClientId=client)


def stop(client, body):
    """Every velocity zero, every place as it is."""
    if p.getDynamicsInfo(body, -1, client)[0] > 0:
        p.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0], physicsClientId=client)
    for joint in range(p.getNumJoints(body, client)):
        place = p.getJointStateMultiDof(body, joint, client)[0]
        if len(place) == 1:
            p.resetJointState(body, joint, place[0], 0, client)
        elif len(place) == 4:
            p.resetJointStateMultiDof(body, joint, place, [0, 0, 0], physicsClientId=client)


def velocities(client, body):
    """(links, 6) pybullet's own velocities of the centres of mass and spins, the base first."""
    links = range(p.getNumJoints(body, client))
    states = (p.getLinkState(body, k, 1, 1, client)[6:8] for k in links)
    return np.array([np.ravel(v) for v in (p.getBaseVelocity(body, client), *states)])


def poses(client, body):
    """Positions (links, 3) of the centres of mass and rotations (links, 3, 3), the base first."""
    links = range(p.getNumJoints(body, client))
    states = [p.getLinkState(body, k, 0, 1, client)[:2] for k in links]
    states.insert(0, p.getBasePositionAndOrientation(body, client))
    turns = [np.reshape(p.getMatrixFromQuaternion(s[1]), (3, 3)) for s in states]
    return np.array([s[0] for s in states]), np.array(turns)
