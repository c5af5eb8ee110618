"""What holds a body is felt, what lets it go is mended: tables, motors, limits, constraints."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED, free_ball

import bullet_tendon as bt

LENGTH, RADIUS, LOAD = 0.1, 0.001, 200.0  # m, m, N


def on_table(client, mass):
    p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), physicsClientId=client)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client)
    body = p.createMultiBody(mass, box, basePosition=[0, 0, 0.02], physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    return body, -1, np.array([0, 0, 0.02])


def standing(client, mass):
    """On the plane with its own weight, under a tendon that cannot push."""
    return on_table(client, mass)


def on_block(client, mass):
    """As on a table of the usual kind: four contacts, where a plane has one or two."""
    block = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 0.1], physicsClientId=client)
    p.createMultiBody(0, block, basePosition=[0, 0, -0.1], physicsClientId=client)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client)
    body = p.createMultiBody(mass, box, basePosition=[0, 0, 0.02], physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    return body, -1, np.array([0, 0, 0.02])


def on_joint(client, mass, kind, axis, arm):
    """A link whose centre of mass is `arm` (3,) from its joint, at the origin, without a motor."""
    link = {"linkMasses": [mass], "linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1]}
    link |= {"linkPositions": [[0, 0, 0]], "linkOrientations": [[0, 0, 0, 1]]}
    link |= {"linkInertialFramePositions": [arm], "linkInertialFrameOrientations": [[0, 0, 0, 1]]}
    link |= {"linkParentIndices": [0], "linkJointTypes": [kind], "linkJointAxis": [axis]}
    body = p.createMultiBody(0, **link, physicsClientId=client)
    inertia = {"localInertiaDiagonal": [1e-4 * mass] * 3}
    p.changeDynamics(body, 0, jointDamping=0, **inertia, **UNDAMPED, physicsClientId=client)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body, 0, np.array(arm, float)


def on_motor(client, mass):
    body, link, place = on_joint(client, mass, p.JOINT_REVOLUTE, [0, 1, 0], [0.1, 0, 0])
    p.setJointMotorControl2(body, 0, p.POSITION_CONTROL, targetPosition=0, force=1e5, physicsClientId=client)
    return body, link, place


def on_limit(client, mass):
    body, link, place = on_joint(client, mass, p.JOINT_REVOLUTE, [0, 1, 0], [0.1, 0, 0])
    p.changeDynamics(body, 0, jointLowerLimit=-0.5, jointUpperLimit=0.0, physicsClientId=client)
    return body, link, place


def place_of(client, body, link):
    if link < 0:
        return np.array(p.getBasePositionAndOrientation(body, client)[0])
    return np.array(p.getLinkState(body, link, 1, 1, client)[0])


def pulled(world, held, stiffness, tension_only=False):
    """A tendon from the held body straight down to a hand."""
    body, link, place = held
    material = bt.Material(stiffness=stiffness, damping=1e-4 * stiffness, tension_only=tension_only)
    t = world.add_tendon([place, place - [0, 0, LENGTH]], RADIUS, material, 10)
    t.attach(0, body, link)
    return t, t.grip(-1)


CASES = [(hold, m, k) for hold in (on_motor, on_limit) for m in (0.02, 0.1, 1.0) for k in (1e3, 1e5, 1e6)]
CASES += [(hold, 10.0, 1e3) for hold in (on_motor, on_limit, on_table)]
CASES += [(hold, 10.0, 1e6) for hold in (on_motor, on_limit)]
CASES += [(on_block, m, k) for m in (0.02, 0.1, 1.0, 10.0) for k in (1e3, 1e4, 1e5, 1e6)]
# A tendon that pushes carries a light body as a rod does. Then it touches the plane in one point, over which
# pybullet tips it, before others are there.
CASES += [(on_table, m, 1e3) for m in (0.02, 0.1, 1.0)] + [(on_table, 1.0, 1e5), (on_table, 10.0, 1e5)]
CASES += [(standing, m, k) for m in (0.02, 0.1, 1.0, 10.0) for k in (1e3, 1e4)]
CASES += [(standing, m, 1e5) for m in (0.1, 1.0, 10.0)]


@pytest.mark.parametrize(("hold", "mass", "stiffness"), CASES)
def test_tension_of_a_held_body_is_the_load(make_world, client, hold, mass, stiffness):
    """Within 1 % ten steps after the load is on, within 0.1 % at rest, by where the body really is."""
    world = make_world(1 / 240, (0, 0, -9.81))
    held = hold(client, mass)
    t, hand = pulled(world, held, stiffness, tension_only=hold is standing)
    world.step(30)
    hand.target = hand.target - [0, 0, LOAD / stiffness * LENGTH]
    misses = []
    for _ in range(60):
        world.step()
        span = np.linalg.norm(place_of(client, *held[:2]) - hand.target)
        misses.append(abs(t.tension.mean() - stiffness * (span / LENGTH - 1)) / LOAD)
    assert max(misses[10:]) <= 0.01
    assert misses[-1] <= 1e-3


@pytest.mark.parametrize("mass", [0.1, 10.0, 1e3, 1e4])
@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("arm", [(0.1, 0, 0), (0.06, 0.08, 0)])
def test_a_held_body_feels_the_load_however_heavy(make_world, client, mass, stiffness, arm):
    """Rounding of what its joint blocks hides no force along the rest."""
    world = make_world(1e-3, (0, 0, -9.81))
    across = np.cross([0, 0, 1], arm) / np.linalg.norm(arm)
    held = on_joint(client, mass, p.JOINT_REVOLUTE, across.tolist(), list(arm))
    p.setJointMotorControl2(held[0], 0, p.POSITION_CONTROL, 0, force=1e6, physicsClientId=client)
    _, hand = pulled(world, held, stiffness)
    world.step(30)
    hand.target = hand.target - [0, 0, LOAD / stiffness * LENGTH]
    world.step(10)
    for _ in range(100):
        world.step()
        assert world.wrench(*held[:2])[2] == pytest.approx(-LOAD, rel=1e-3)


def pin(client, body):
    at = p.getBasePositionAndOrientation(body, client)[0]
    origin = [0, 0, 0]
    held = p.createConstraint(body, -1, -1, -1, p.JOINT_FIXED, origin, origin, at, physicsClientId=client)
    p.changeConstraint(held, maxForce=1e6, physicsClientId=client)
    return held


def pinned(client, mass):
    """A ball held by a constraint, its link, and how to let it go; as the two below."""
    body = free_ball(client, mass)
    constraint = pin(client, body)
    return body, -1, lambda: p.removeConstraint(constraint, client)


def motored(client, mass):
    body, link, _ = on_joint(client, mass, p.JOINT_PRISMATIC, [0, 0, 1], [0, 0, 0])
    p.setJointMotorControl2(body, 0, p.POSITION_CONTROL, force=1e6, physicsClientId=client)

    def let_go():
        p.setJointMotorControl2(body, 0, p.POSITION_CONTROL, force=0, physicsClientId=client)
        p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)

    return body, link, let_go


def frozen(client, mass):
    """Held by having no mass."""
    body = free_ball(client, mass)
    p.changeDynamics(body, -1, mass=0, physicsClientId=client)
    inertia = {"localInertiaDiagonal": [1e-4 * mass] * 3, **UNDAMPED}
    return body, -1, lambda: p.changeDynamics(body, -1, mass=mass, **inertia, physicsClientId=client)


@pytest.mark.parametrize("mass", [0.005, 0.02, 0.2, 2.0])
@pytest.mark.parametrize("hold", [pinned, motored, frozen])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_a_released_body_gets_no_more_energy_than_was_stored(make_world, client, integrator, hold, mass):
    """Two-step methods would go on as if it was held: they start again."""
    world = make_world(1 / 240, integrator=integrator)
    body, link, let_go = hold(client, mass)
    t, hand = pulled(world, (body, link, np.zeros(3)), 1e4)
    world.step(5)
    hand.target = hand.target - [0, 0, LOAD / 1e5]
    world.step(60)
    assert t.tension.mean() == pytest.approx(LOAD, rel=1e-3)
    stored, fastest = t.energy, 0.0
    let_go()
    for _ in range(240):
        world.step()
        state = p.getBaseVelocity(body, client)[0][2] if link < 0 else p.getJointState(body, 0, client)[1]
        fastest = max(fastest, abs(state))
    assert 0 < 0.5 * mass * fastest**2 <= 1.05 * stored


@pytest.mark.parametrize(("mass", "stiffness"), [(0.02, 1e6), (1.0, 1e4)])
@pytest.mark.parametrize("speed", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("slackened", [0.02, 0.2])
def test_two_bodies_are_let_go_at_once_and_one_is_pushed(
    make_world, client, mass, stiffness, speed, slackened
):
    """The pushed one is not seen as let go, but as one that yields: the step is mended for both."""
    world, load, along = make_world(1 / 240), 100.0, np.array([0.6, 0.48, 0.64])
    t = world.add_tendon([0 * along, LENGTH * along], RADIUS, bt.Material(stiffness=stiffness), 10)
    balls = [free_ball(client, mass, at) for at in (0 * along, LENGTH * along)]
    pins = [pin(client, body) for body in balls]
    for particle, body in zip((0, -1), balls, strict=True):
        t.attach(particle, body)
    whole = LENGTH * load / stiffness
    for reeled in (*[whole / 20] * 20, *[-slackened * whole / 10] * 11):
        t.shorten(reeled)
        world.step()
    given = t.energy + 0.5 * mass * speed**2
    t.shorten(-slackened * whole / 10)
    world.apply()
    for one in pins:
        p.removeConstraint(one, client)
    p.resetBaseVelocity(balls[1], (speed * along).tolist(), [0, 0, 0], client)
    p.stepSimulation(client)
    world.step()
    velocities = np.array([p.getBaseVelocity(body, client)[0] for body in balls])
    assert world.report.converged
    assert 0 < 0.5 * mass * (velocities**2).sum() <= 1.05 * given


def test_a_spinning_free_body_is_never_taken_for_held(make_world, client):
    """Gyroscopic torques are no reaction of anything."""
    world = make_world(1 / 240)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.02, 0.01], physicsClientId=client)
    body = p.createMultiBody(0.3, box, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    p.resetBaseVelocity(body, [0, 0, 0], [9, 14, 5], client)
    t = world.add_tendon([[0.05, 0, 0], [0.05 + LENGTH, 0, 0]], RADIUS, bt.Material(stiffness=1e3), 8)
    t.attach(0, body)
    t.grip(-1)
    for _ in range(200):
        world.step()
        assert not world._core.any_held()


@pytest.mark.parametrize("mass", [0.02, 1.0, 50.0])
@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7])
@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240, 1 / 60])
def test_a_flying_body_is_caught_without_overshooting(make_world, client, mass, stiffness, dt):
    """Exact: T = v sqrt(m K / L) at most, where the tendon has no mass. It stops, or turns back."""
    length, speed = 0.2, 2.0
    world = make_world(dt)
    material = bt.Material(stiffness=stiffness, tension_only=True, density=100.0)
    t = world.add_tendon([[0, 0, 0], [0, 0, -length]], 1e-3, material, 10)
    t.grip(0)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(mass, ball, -1, [0, 0, -length], physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    t.attach(-1, body)
    p.resetBasePositionAndOrientation(body, [0, 0, -0.9 * length], [0, 0, 0, 1], client)
    p.resetBaseVelocity(body, [0, 0, -speed], [0, 0, 0], client)
    t.set_positions(t.positions * [1, 1, 0.9])
    exact = speed * np.sqrt(mass * stiffness / length)
    tensions = []
    for _ in range(int(max(0.1, 2 * np.pi * np.sqrt(mass * length / stiffness)) / dt) + 4):
        world.step()
        assert world.report.converged
        tensions.append(t.tension.max())
        if p.getBaseVelocity(body, client)[0][2] > -1e-3 * speed:
            break
    assert p.getBaseVelocity(body, client)[0][2] > -1e-3 * speed
    assert 0 < max(tensions) <= 1.1 * exact


@pytest.mark.parametrize("kind", ["free", "maximal", "slider"])
def test_what_hangs_on_a_tendon_is_kept_awake(make_world, client, tmp_path, kind):
    """pybullet puts it to sleep after two seconds at rest; no force wakes it then."""
    if kind == "slider":
        path = tmp_path / "slider.urdf"
        inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
        path.write_text(
            '<robot name="r"><link name="base"/>'
            f'<link name="load"><inertial><mass value="1"/>{inertia}</inertial>'
            '</link><joint name="rail" type="prismatic"><parent link="base"/><child link="load"/>'
            '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="0" velocity="9"/></joint></robot>'
        )
        flags = p.URDF_ENABLE_SLEEPING
        body = p.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
        p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        link = 0
    else:
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
        maximal = kind == "maximal"
        body = p.createMultiBody(1, shape, useMaximalCoordinates=maximal, physicsClientId=client)
        link = -1
    sleeping = p.ACTIVATION_STATE_ENABLE_SLEEPING
    p.changeDynamics(body, -1, activationState=sleeping, physicsClientId=client)
    world = make_world(gravity=(0, 0, -9.81))
    material = bt.Material(stiffness=400, damping=20, density=1e-3)
    tendon = world.add_tendon([(0, 0, 0.1), (0, 0, 0)], 1e-3, material, 4, collides=False)
    hand, knot = tendon.grip(0), tendon.attach(-1, body, link, (0, 0, 0))
    world.step(3 * 240)
    for k in range(240):
        hand.target = (0, 0, 0.1 + 0.05 * (k + 1) / 240)
        world.step()
    world.step(240)
    assert knot.force[2] == pytest.approx(9.81, rel=1e-4)
