"""Bodies with joints that stand on the ground by their tendons."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

LEG = 0.3  # m
ANGLE = 0.5  # of a leg to the vertical [rad]
FOOT = 0.01  # radius [m]
TOP = """<robot name="tripod"><link name="top"><inertial><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}"/></inertial></link>
"""
LEG_LINK = """<link name="l{k}"><inertial><origin xyz="0 0 {middle}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{small}"/></inertial><collision><origin xyz="0 0 {end}"/>
<geometry><sphere radius="{foot}"/></geometry></collision></link>
<joint name="j{k}" type="continuous"><parent link="top"/><child link="l{k}"/>
<origin xyz="{x} {y} 0" rpy="0 0 {yaw}"/><axis xyz="0 1 0"/></joint>
"""


def tripod(client, tmp_path, mass, leg, friction=0.0, gap=1e-4):
    """A free top on three legs with hinges, which have masses mass and leg [kg], over a floor.

    friction: of the feet on the floor. gap: below the feet [m].
    """
    text = TOP.format(mass=mass, i=1e-3 * mass)
    for k in range(3):
        yaw, inertia = 2 * np.pi * k / 3, leg * LEG**2 / 12
        place = {
            "x": 0.03 * np.cos(yaw),
            "y": 0.03 * np.sin(yaw),
            "yaw": yaw,
            "middle": -LEG / 2,
            "end": -LEG,
        }
        text += LEG_LINK.format(k=k, mass=leg, i=inertia, small=1e-4 * leg, foot=FOOT, **place)
    path = tmp_path / "tripod.urdf"
    path.write_text(text + "</robot>")
    slab = p.createCollisionShape(p.GEOM_BOX, halfExtents=[2, 2, 0.1], physicsClientId=client)
    floor = p.createMultiBody(0, slab, basePosition=(0, 0, -0.1), physicsClientId=client)
    p.changeDynamics(floor, -1, lateralFriction=1, physicsClientId=client)
    height = LEG * np.cos(ANGLE) + FOOT + gap
    flags = p.URDF_USE_INERTIA_FROM_FILE
    body = p.loadURDF(str(path), basePosition=(0, 0, height), flags=flags, physicsClientId=client)
    damped = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 1e-3, "lateralFriction": friction}
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    for joint in range(3):
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        p.changeDynamics(body, joint, **damped, physicsClientId=client)
        p.resetJointState(body, joint, -ANGLE, physicsClientId=client)
    return body


def tie(world, client, body, stiffness, particles):
    """A string of so many particles from each foot to the next one."""
    feet = []
    for k in range(3):
        middle, turn = p.getLinkState(body, k, 0, 1, client)[:2]
        feet.append(p.multiplyTransforms(middle, turn, (0, 0, -LEG / 2), (0, 0, 0, 1))[0])
    material = bt.Material(stiffness=stiffness, damping=2.5e-3 * stiffness, density=100.0)
    strings = []
    for k in range(3):
        t = world.add_tendon([feet[k], feet[(k + 1) % 3]], 8e-4, material, particles, collides=False)
        t.attach(0, body, k)
        t.attach(-1, body, (k + 1) % 3)
        strings.append(t)
    return strings


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240, 1 / 120])
@pytest.mark.parametrize(("mass", "leg"), [(5.0, 0.1), (1.0, 0.01), (20.0, 0.02)])
@pytest.mark.parametrize("particles", [2, 8])
def test_strings_between_the_feet_hold_a_tripod_up(make_world, client, tmp_path, dt, mass, leg, particles):
    """Light legs that stand on the floor are led by it: loose, each string would pull its feet at once.

    Each foot bears a third of the weight. About its hinge that is balanced by the pull H = sqrt(3) T of two
    strings: H L cos a = (W/3 - w/2) L sin a, with w the weight of a leg, and W of all.
    """
    body = tripod(client, tmp_path, mass, leg)
    world = make_world(dt, (0, 0, -9.81))
    strings = tie(world, client, body, 2e4, particles)
    for _ in range(round(2 / dt)):
        world.step()
        assert world.report.converged
    weight, own = 9.81 * (mass + 3 * leg), 9.81 * leg
    angle = -np.mean([p.getJointState(body, k, client)[0] for k in range(3)])
    tension = (weight / 3 - own / 2) * np.tan(angle) / np.sqrt(3)
    for t in strings:
        assert t.tension.mean() == pytest.approx(tension, rel=2e-3)
    place = p.getBasePositionAndOrientation(body, client)[0]
    assert place[2] == pytest.approx(LEG * np.cos(angle) + FOOT, abs=2e-4)
    assert np.hypot(*place[:2]) < 1e-3


@pytest.mark.parametrize("gap", [1e-4, 0.02])
@pytest.mark.parametrize("friction", [0.3, 0.8])
@pytest.mark.parametrize(
    ("dt", "mass", "leg", "stiffness", "particles"),
    [
        (1 / 1000, 4.0, 0.25, 2e5, 2),
        (1 / 1000, 11.0, 0.05, 2e4, 2),
        (1 / 240, 1.0, 0.01, 4e4, 8),
        (1 / 240, 11.0, 0.2, 2e4, 2),
        (1 / 120, 5.0, 0.1, 4e4, 8),
    ],
)
def test_feet_with_friction_stay_on_the_floor(
    make_world, client, tmp_path, dt, mass, leg, stiffness, particles, gap, friction
):
    """What was pressed on the floor has no friction once it lifts off: strings would throw such feet away.

    A tripod that lands gains neither height nor energy, and stands. Friction of up to mu W/3 at each foot
    takes part of the strings' load or adds to it, in the mean of all feet.
    """
    body = tripod(client, tmp_path, mass, leg, friction, gap)
    world = make_world(dt, (0, 0, -9.81))
    strings = tie(world, client, body, stiffness, particles)
    rest = np.linalg.norm(np.diff(strings[0].positions, axis=0), axis=1).sum()
    weight, own = 9.81 * (mass + 3 * leg), 9.81 * leg
    start = p.getBasePositionAndOrientation(body, client)[0][2]

    def energy():
        """Of heights, of the top's velocity and of the strings [J]."""
        z = p.getBasePositionAndOrientation(body, client)[0][2]
        links = [p.getLinkState(body, k, 0, 0, client)[0][2] for k in range(3)]
        speed = np.linalg.norm(p.getBaseVelocity(body, client)[0])
        long = [np.linalg.norm(np.diff(t.positions, axis=0), axis=1).sum() / rest - 1 for t in strings]
        stretched = 0.5 * stiffness * rest * np.square(np.maximum(long, 0)).sum()
        return 9.81 * (mass * z + leg * sum(links)) + 0.5 * mass * speed**2 + stretched

    first = energy()
    pulls = []
    for _ in range(round(2 / dt)):
        world.step()
        pulls.append([np.sqrt(3) * t.tension.mean() for t in strings])
        assert p.getBasePositionAndOrientation(body, client)[0][2] < start + 0.01 * LEG
        assert energy() < first + 2e-3 * weight * LEG
    angle = -np.mean([p.getJointState(body, k, client)[0] for k in range(3)])
    at_foot = (weight / 3 - own / 2) * np.tan(angle)
    mean = np.mean(pulls[len(pulls) // 2 :])  # a light foot may slip and stick again
    assert abs(mean - at_foot) < friction * weight / 3 + 0.05 * at_foot
    assert np.linalg.norm(p.getBaseVelocity(body, client)[0]) < 0.02
    up = p.getMatrixFromQuaternion(p.getBasePositionAndOrientation(body, client)[1])[8]
    assert up > np.cos(0.02)


def test_steps_whose_stops_do_not_settle_say_so(make_world, client, tmp_path):
    """Light feet that strings pull to and fro within their friction: the sets of stops go in circles.

    Such a step is taken with the last set, after six others, and has not converged. All others have.
    """
    body = tripod(client, tmp_path, 1.0, 0.01, friction=0.3, gap=0.02)
    world = make_world(1 / 240, (0, 0, -9.81))
    tie(world, client, body, 4e4, 8)
    told = 0
    for _ in range(120):
        world.step()
        report = world.report
        assert report.converged == report.stops_settled == (report.ended_by != "stops")
        if report.stops_settled:
            continue
        told += 1
        assert report.reasons["joint_stops"] >= 6
        assert "did not settle" in world.describe()
    assert 0 < told < 120
