"""Bodies that tendons touch in several places: they go where the solution says that they go."""

import numpy as np
import pybullet as p
import pybullet_data
import pytest
from bullet_tendon.scenarios import suspended_plate
from link_scenes import UNDAMPED, away, hinged, link_frame, matrix, misfit

import bullet_tendon as bt

CORD = bt.Material(stiffness=3e4, damping=100.0)


def box(client, mass, half, at=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    body = p.createMultiBody(mass, shape, basePosition=at, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    return body


@pytest.mark.parametrize("mass", [1e-3, 1.0, 1e3])
def test_a_body_on_several_tendons_goes_where_its_attachments_go(make_world, client, mass):
    """Five tendons on random corners of a box that is hit and swings: every step, to second order."""
    world, rng = make_world(1 / 240, (0, 0, -9.81)), np.random.default_rng(3)
    body = box(client, mass, [0.1, 0.06, 0.02])
    p.resetBaseVelocity(body, [0.2, 0.1, 0], [0.3, -0.2, 0.4], physicsClientId=client)
    held = []
    for _ in range(5):
        corner = rng.uniform(-1, 1, 3) * [0.1, 0.06, 0.02]
        t = world.add_tendon([corner + [*rng.normal(size=2) * 0.1, 0.3], corner], 0.002, CORD, 10)
        t.grip(0)
        held.append((t, t.attach(-1, body)))
    worst = 0.0
    for _ in range(240):
        world.step()
        assert world.report.converged
        spin = np.linalg.norm(p.getBaseVelocity(body, client)[1])
        worst = max(worst, *(misfit(t, a, client) / (1e-7 + 0.2 * (spin / 240) ** 2) for t, a in held))
    assert worst < 1


def test_torques_about_every_axis_take_as_many_iterations(make_world, client):
    """A body swings on two tendons, off its centre. The scene is the same with its coordinates rolled."""
    totals = []
    for axis in range(3):
        world = make_world(1 / 240, tuple(np.roll([0, 0, -9.81], axis)))
        body = box(client, 0.2, [0.02] * 3)
        iterations = 0
        for point in ([0.01, 0.02, 0.02], [-0.02, -0.01, 0.02]):
            ends = np.array([point, np.add(point, [0, 0, 0.1])])
            t = world.add_tendon(np.roll(ends, axis, axis=1), 0.002, CORD, 8)
            t.attach(0, body)
            t.grip(-1)
        p.resetBaseVelocity(body, np.roll([0.5, 1.0, 0], axis), np.roll([2.0, -3.0, 4.0], axis), client)
        for _ in range(100):
            world.step()
            assert world.report.converged
            iterations += world.report.iterations
        totals.append(iterations)
        p.removeBody(body, client)
    np.testing.assert_allclose(totals, totals[0], rtol=0.03)


def chain(client, links=3, damping=0.0):
    """A fixed arm of hinges about y along x, 0.1 m and 50 g each, its motors off."""
    shapes = [p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)] * links
    body = p.createMultiBody(
        0,
        linkMasses=[0.05] * links,
        linkCollisionShapeIndices=shapes,
        linkVisualShapeIndices=[-1] * links,
        linkPositions=[[0, 0, 0]] + [[0.1, 0, 0]] * (links - 1),
        linkOrientations=[[0, 0, 0, 1]] * links,
        linkInertialFramePositions=[[0.05, 0, 0]] * links,
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * links,
        linkParentIndices=list(range(links)),
        linkJointTypes=[p.JOINT_REVOLUTE] * links,
        linkJointAxis=[[0, 1, 0]] * links,
        physicsClientId=client,
    )
    for link in range(links):
        p.changeDynamics(body, link, **UNDAMPED, jointDamping=damping, physicsClientId=client)
        inertia = [1e-5, 5e-5, 5e-5]
        p.changeDynamics(body, link, localInertiaDiagonal=inertia, physicsClientId=client)
        p.setJointMotorControl2(body, link, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


def test_an_arm_with_tendons_on_all_its_links_goes_where_they_go(make_world, client):
    """Each link hangs on a tendon of its own: cross terms between the links of one body."""
    world = make_world(1 / 240, (0, 0, -9.81))
    arm = chain(client)
    held = []
    for link, x in enumerate((0.05, 0.15, 0.25)):
        t = world.add_tendon([[x + 0.02, 0, 0.3], [x, 0, 0]], 0.002, CORD, 12)
        t.grip(0)
        held.append((t, t.attach(-1, arm, link)))
    worst = 0.0
    for _ in range(480):
        world.step()
        assert world.report.converged
        fastest = max(abs(s[1]) for s in p.getJointStates(arm, range(3), client))
        worst = max(worst, *(misfit(t, a, client) / (1e-7 + (fastest / 240) ** 2) for t, a in held))
    assert worst < 1
    # Statics about the root: two and a half links' weight by every tendon's pull and arm.
    weight = 0.05 * 9.81
    own = sum(9.81 * t.masses[-1] * x for (t, _), x in zip(held, (0.05, 0.15, 0.25), strict=True))
    pulls = sum(-np.cross(t.positions[-1], a.force)[1] for t, a in held)
    assert pulls == pytest.approx(weight * (0.05 + 0.15 + 0.25) + own, rel=0.05)


@pytest.mark.parametrize("substeps", [1, 4, 10])
@pytest.mark.parametrize(("mass", "stiffness"), [(0.01, 1e6), (1.0, 3e4), (100.0, 1e4)])
def test_pybullets_substeps(make_world, client, substeps, mass, stiffness):
    """A box on three tendons comes to rest on them, however finely pybullet itself steps."""
    world = make_world(1 / 240, (0, 0, -9.81))
    p.setPhysicsEngineParameter(numSubSteps=substeps, physicsClientId=client)
    body = box(client, mass, [0.05, 0.05, 0.02])
    held = []
    for x, y in ((0.05, 0.05), (-0.05, 0.05), (0, -0.05)):
        material = bt.Material(stiffness=stiffness, damping=1e-2 * stiffness)
        t = world.add_tendon([[1.5 * x, 1.5 * y, 0.3], [x, y, 0]], 0.002, material, 8)
        t.grip(0)
        held.append(t.attach(-1, body))
    forces = []
    for _ in range(480):
        world.step()
        assert world.report.converged
        forces.append(sum(a.force[2] for a in held))
    assert np.mean(forces[240:]) == pytest.approx(9.81 * mass, rel=5e-3)


def test_a_body_with_maximal_coordinates(make_world, client):
    """Its frame is that of its centre of mass; the weight swings like any other."""
    world = make_world(1 / 240, (0, 0, -9.81))
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=client)
    place = {"basePosition": [0, 0, -0.22], "baseOrientation": [0.5, 0.5, 0.5, 0.5]}
    body = p.createMultiBody(1.0, ball, **place, useMaximalCoordinates=True, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    t = world.add_tendon([[0, 0, 0], [0, 0, -0.2]], 0.002, CORD, 20)
    t.grip(0)
    held = t.attach(-1, body)
    p.resetBaseVelocity(body, [0.3, 0, 0], physicsClientId=client)
    for _ in range(480):
        world.step()
        place, turn = p.getBasePositionAndOrientation(body, client)
        assert away(t, held, place, matrix(turn)) < 1e-5
    assert 0.9 * 9.81 < np.linalg.norm(held.force) < 1.1 * 9.81


def test_a_cut_plate_converges_with_first_order():
    """The path of a plate that loses one of its four tendons, against a sixteenth of the step."""

    def path(dt):
        client = p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81, client)
        p.setTimeStep(dt, client)
        world = bt.TendonWorld(client)
        half = suspended_plate.HALF
        plate = box(client, suspended_plate.MASS, [half, half, 0.005])
        tendons = []
        for x, y in suspended_plate.CORNERS:
            low, high = np.array([half * x, half * y, 0]), np.array([1.6 * half * x, 1.6 * half * y, 0.25])
            tendons.append(
                world.add_tendon([high, low], 0.002, bt.Material(stiffness=3e4, damping=300.0), 12)
            )
            tendons[-1].grip(0)
            tendons[-1].attach(-1, plate)
        world.step(round(1 / dt))
        world.remove_tendon(tendons.pop())
        places = []
        for _ in range(10):
            world.step(round(0.04 / dt))
            place, turn = p.getBasePositionAndOrientation(plate, client)
            places.append([*place, *(0.1 * np.array(turn))])
        p.disconnect(client)
        return np.array(places)

    exact = path(1 / 3200)
    coarse, fine = (np.abs(path(dt) - exact).max() for dt in (1 / 200, 1 / 400))
    assert coarse < 5e-4
    # Exactly first order against a sixteenth gives (1 - 1/16) / (1/2 - 1/16) = 2.14.
    assert coarse / fine > 1.8


@pytest.mark.parametrize("name", ["franka_panda/panda.urdf", "r2d2.urdf", "mjcf/humanoid_symmetric.xml"])
def test_robots_with_a_tendon_on_every_link(make_world, client, name):
    """Their links are where pybullet has them, fixed joints and massless links too."""
    world, rng = make_world(1 / 1000, (0, 0, -9.81)), np.random.default_rng(1)
    path = f"{pybullet_data.getDataPath()}/{name}"
    if name.endswith("xml"):
        body = p.loadMJCF(path, physicsClientId=client)[-1]
    else:
        turn = p.getQuaternionFromEuler([0.3, 0.5, 0.2])
        body = p.loadURDF(path, [0, 0, 1], turn, useFixedBase="panda" in name, physicsClientId=client)
    for joint in range(p.getNumJoints(body, client)):
        if p.getJointInfo(body, joint, client)[2] in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC):
            p.resetJointState(body, joint, 0.3 * rng.normal(), physicsClientId=client)
            p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    held = []
    for link in range(-1, p.getNumJoints(body, client)):
        end = link_frame(client, body, link)[0]
        t = world.add_tendon([end + [0, 0, 0.2], end], 0.002, bt.Material(stiffness=100, damping=0.1), 3)
        t.grip(0)
        held.append((t, t.attach(-1, body, link)))
    for _ in range(5):
        world.step()
        assert world.report.converged
        # Turns within a step are of second order; passed limits pybullet takes back in its own way.
        assert max(misfit(t, a, client) for t, a in held) < 1e-4


def test_a_link_without_mass_passes_the_pull_on(make_world, client):
    """An end effector's frame, fixed to the last link of a pendulum: its hinge bears the moment."""
    world = make_world(1 / 240)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(
        0,
        linkMasses=[0.5, 0.0],
        linkCollisionShapeIndices=[ball, -1],
        linkVisualShapeIndices=[-1, -1],
        linkPositions=[[0, 0, 0], [0, 0, -0.2]],
        linkOrientations=[[0, 0, 0, 1]] * 2,
        linkInertialFramePositions=[[0, 0, -0.1], [0, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_REVOLUTE, p.JOINT_FIXED],
        linkJointAxis=[[0, 1, 0], [0, 0, 1]],
        physicsClientId=client,
    )
    p.setJointMotorControl2(body, 0, p.POSITION_CONTROL, 0.0, force=1e3, physicsClientId=client)
    t = world.add_tendon([[0.3, 0, -0.2], [0, 0, -0.2]], 0.002, CORD, 10)
    t.set_force(0, [10.0, 0, 0])
    t.attach(-1, body, 1)
    world.step(300)
    # Bullet's motor bears 10 N on 0.2 m.
    assert abs(p.getJointState(body, 0, client)[3]) == pytest.approx(2.0, rel=1e-3)


def test_a_force_on_a_spinning_link_acts_where_it_is(make_world, client, tmp_path):
    """pybullet's own link poses are a step old: at 8 rad/s the arm of a force would be wrong by 3 %."""
    arm = hinged(client, tmp_path)
    p.resetJointState(arm, 0, -0.9, 8.0, physicsClientId=client)
    world = make_world(1 / 240)
    t = world.add_tendon([[0.3, 0, 0.3], [0.0622, 0, 0.0783]], 0.002, CORD, 12)
    t.grip(0)
    t.attach(-1, arm, 0)
    inertia = 5e-5 + 0.05 * 0.05**2  # about the hinge
    for _ in range(8):
        centre = np.array(p.getLinkState(arm, 0, 0, 1, client)[0])
        before = p.getJointState(arm, 0, client)[1]
        world.step()
        force, torque = np.split(world.wrench(arm, 0), 2)
        change = (torque + np.cross(centre, force))[1] / 240 / inertia
        assert p.getJointState(arm, 0, client)[1] - before == pytest.approx(change, rel=1e-6, abs=1e-9)
