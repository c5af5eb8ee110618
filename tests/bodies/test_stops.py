"""Joint limits that stop links: foreseen, believed while they hold, and let go of without a kick."""

import numpy as np
import pybullet as p
import pybullet_data
import pytest
from link_scenes import HINGED, UNDAMPED, hinged, links_on_joints, misfit

import bullet_tendon as bt

CORD = bt.Material(stiffness=3e4, damping=100.0)


def test_a_limit_is_foreseen(make_world, client, tmp_path):
    """A link swings into its limit: the end of the tendon on it does not go on for a step."""
    arm = hinged(client, tmp_path)
    world = make_world(1 / 240)
    t = world.add_tendon([[0.1, 0, 0], [0.1, 0, -0.2]], 0.002, CORD, 12)
    held = t.attach(0, arm, 0)
    rates = [8.0]
    for _ in range(30):
        world.step()
        rates.append(p.getJointState(arm, 0, client)[1])
        assert misfit(t, held, client) < 1e-4  # 3e-3 where the limit comes as a surprise
    assert rates[5] > 5
    assert abs(rates[-1]) < 2


@pytest.mark.parametrize("late", [False, True])
def test_a_limit_that_was_changed_is_not_believed(make_world, client, tmp_path, late):
    """Before the first step it is known; after that, what passes it once is not stopped there again."""
    arm = hinged(client, tmp_path)
    world = make_world(1 / 240)
    t = world.add_tendon([[0.1, 0, 0], [0.1, 0, -0.2]], 0.002, CORD, 12)
    held = t.attach(0, arm, 0)
    if late:
        world.step()
    p.changeDynamics(arm, 0, jointLowerLimit=-1, jointUpperLimit=1.5, physicsClientId=client)
    misfits = []
    for _ in range(40):
        world.step()
        misfits.append(misfit(t, held, client))
    assert p.getJointState(arm, 0, client)[0] > 0.5  # the limit was 0.3
    assert sum(m > 1e-4 for m in misfits) <= 2 * late


@pytest.mark.parametrize("mass", [0.02, 1.0])
@pytest.mark.parametrize("stiffness", [1e3, 1e6])
def test_what_rests_on_a_limit_is_not_thrown_off_it(make_world, client, tmp_path, mass, stiffness):
    """A tendon above is tightened at once: the link gets no more energy than was put in."""
    path = tmp_path / "lever.urdf"
    text = HINGED.replace('lower="-1" upper="0.3"', 'lower="0" upper="1"').replace("0 1 0", "0 -1 0")
    path.write_text(text.replace('mass value="0.05"', f'mass value="{mass}"'))
    arm = p.loadURDF(str(path), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    p.changeDynamics(arm, 0, **UNDAMPED, jointDamping=0, physicsClientId=client)
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world = make_world(1 / 240, (0, 0, -9.81))
    cord = bt.Material(stiffness=stiffness, damping=1e-4 * stiffness)
    t = world.add_tendon([[0.05, 0, 0], [0.05, 0, 0.1]], 0.001, cord, 10)
    t.attach(0, arm, 0)
    hand = t.grip(-1)
    world.step(30)
    hand.target = hand.target + [0, 0, 200 / stiffness * 0.1]
    fastest = 0.0
    for _ in range(20):
        world.step()
        fastest = max(fastest, abs(p.getJointState(arm, 0, client)[1]))
    given = 0.5 * 200**2 / stiffness * 0.1
    assert 0.5 * (5e-5 + mass * 0.05**2) * fastest**2 <= 1.05 * given + 1e-6


JOINT = """<robot name="joint"><link name="base">
<inertial><origin xyz="0.01 0.02 -0.03"/><mass value="{base}"/>
<inertia ixx="4e-4" iyy="5e-4" izz="6e-4"/></inertial></link>
<link name="arm"><inertial><origin xyz="0.05 0 0"/><mass value="{arm}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}"/></inertial></link>
<joint name="joint" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="{axis}"/>
<origin xyz="0.02 0 0.01" rpy="0.3 -0.2 0.5"/>
<limit lower="{low}" upper="{high}" effort="10" velocity="100"/></joint></robot>"""


def jointed(client, tmp_path, fixed, **values):
    """A base and an arm on one joint, without damping and motor."""
    values = {"base": 0.3, "arm": 0.02, "i": 2e-5, "kind": "revolute", "axis": "0 1 0", **values}
    path = tmp_path / "joint.urdf"
    path.write_text(JOINT.format(**values))
    flags = p.URDF_USE_INERTIA_FROM_FILE
    body = p.loadURDF(str(path), useFixedBase=fixed, flags=flags, physicsClientId=client)
    for link in (-1, 0):
        p.changeDynamics(body, link, **UNDAMPED, jointDamping=0, physicsClientId=client)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


def pulled(world, client, arm, force, direction) -> None:
    """A tendon from the arm's tip, pulled along a direction in its frame."""
    tip, turn = p.getLinkState(arm, 0, physicsClientId=client)[:2]
    away = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3) @ direction
    t = world.add_tendon([tip, tip + 0.3 * away], 0.001, bt.Material(stiffness=1e4, damping=5.0), 12)
    t.attach(0, arm, 0)
    t.set_force(-1, force * away)


@pytest.mark.parametrize("kind, reach", [("revolute", 0.5), ("prismatic", 0.03)])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240, 1 / 60])
@pytest.mark.parametrize("pull", [0.5, 5.0])
def test_what_a_tendon_throws_stops_at_its_limit(make_world, client, tmp_path, kind, reach, side, dt, pull):
    """pybullet lets a joint pass its limit by a step's way, up to 0.4 rad here."""
    values = {"low": -reach, "high": reach, "axis": "0 1 0" if kind == "revolute" else "0 0 1"}
    arm = jointed(client, tmp_path, True, kind=kind, **values)
    world = make_world(dt)
    pulled(world, client, arm, pull, [0, 0, side] if kind == "prismatic" else [0, 0, -side])
    places = []
    for _ in range(round(0.3 / dt)):
        world.step()
        places.append(side * p.getJointState(arm, 0, client)[0])
    assert max(places) <= reach + 2e-6
    assert places[-1] == pytest.approx(reach, abs=2e-6)


def momentum(client, body):
    """Linear momentum of the base and its link (3,)."""
    base = np.array(p.getBaseVelocity(body, client)[0])
    link = np.array(p.getLinkState(body, 0, 1, 1, client)[6])
    return sum(p.getDynamicsInfo(body, k, client)[0] * v for k, v in ((-1, base), (0, link)))


@pytest.mark.parametrize("kind, reach", [("revolute", 0.2), ("prismatic", 0.01)])
def test_a_limit_gives_a_floating_body_no_momentum(make_world, client, tmp_path, kind, reach):
    """The arm strikes its limit: what stops it acts on its base in reverse."""
    body = jointed(client, tmp_path, False, kind=kind, low=-reach, high=reach)
    rate = 8.0 if kind == "revolute" else 0.5
    p.resetJointState(body, 0, 0.0, rate, client)
    world = make_world(1 / 240)
    t = world.add_tendon([[0.02, 0, 0.01], [0.02, 0.2, 0.01]], 0.001, bt.Material(stiffness=1e3), 4)
    t.attach(0, body)
    places, found = [], [momentum(client, body)]
    for _ in range(12):
        world.step()
        places.append(p.getJointState(body, 0, client)[0])
        found.append(momentum(client, body))
    assert max(places) == pytest.approx(reach, abs=2e-6)
    # pybullet's explicit step makes that error itself: in one step the arm turns about its joint by 0.03.
    brought = 0.02 * rate * (0.05 if kind == "revolute" else 1)
    assert np.linalg.norm(np.diff(found, axis=0), axis=1).max() < 0.04 * brought


def test_damping_that_was_changed_after_loading_is_known(make_world, client, tmp_path):
    """Unless it was changed after the first step: pybullet reports it as loaded."""
    arm = jointed(client, tmp_path, True, low=-3, high=3)
    p.changeDynamics(arm, 0, jointDamping=2e-3, physicsClientId=client)
    p.resetJointState(arm, 0, 0.0, 5.0, client)
    world = make_world(1 / 240)
    tip = p.getLinkState(arm, 0, physicsClientId=client)[0]
    t = world.add_tendon([tip, np.add(tip, (0, 0, 0.2))], 0.001, bt.Material(stiffness=1e3), 6)
    t.attach(0, arm, 0)
    world.step(2)
    assert np.abs(world._core.missed(0)).max() / 240 < 1e-6


@pytest.mark.parametrize("dt, pull", [(1 / 240, 3.0), (1 / 240, 10.0), (1 / 90, 3.0)])
def test_what_damps_a_swing_into_a_limit_does_not_hold_it_off(make_world, client, tmp_path, dt, pull):
    """pybullet damps every link: a push that is gone once the joint rests at its limit."""
    arm = jointed(client, tmp_path, True, low=-0.6, high=0.6, arm=0.1)
    p.changeDynamics(arm, 0, linearDamping=0.04, angularDamping=0.04, physicsClientId=client)
    world = make_world(dt)
    pulled(world, client, arm, pull, [0, 0, -1])
    places = []
    for _ in range(round(1 / dt)):
        world.step()
        places.append(p.getJointState(arm, 0, client)[0])
    assert max(places) < 0.6 + 5e-4  # where it lands, by the damping of one step
    assert places[-1] == pytest.approx(0.6, abs=2e-6)


CHAIN_LINK = """<link name="l{k}"><inertial><origin xyz="{half} 0 0"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}"/></inertial></link>
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin xyz="{x} 0 0"/>
<axis xyz="0 1 0"/><limit lower="-0.1" upper="1.2" effort="10" velocity="100"/></joint>
"""


# On a rail along z. A motor holds it.
CARRIAGE = """<link name="carriage"><inertial><mass value="0.5"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3"/>
</inertial></link><joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1000" velocity="100"/></joint>
"""


def chain(client, tmp_path, masses, length=0.04, carried=False):
    """Links on hinges in a row along x, without damping and motors, at rest at zero.

    carried: they are on a carriage, which is link 0.
    """
    text = '<robot name="chain"><link name="base"/>' + CARRIAGE * carried
    for k, mass in enumerate(masses):
        values = {"half": length / 2, "mass": mass, "i": mass * length**2 / 12}
        parent = f"l{k - 1}" if k else "carriage" if carried else "base"
        text += CHAIN_LINK.format(k=k, parent=parent, x=length if k else 0, **values)
    path = tmp_path / "chain.urdf"
    path.write_text(text + "</robot>")
    flags = p.URDF_USE_INERTIA_FROM_FILE
    body = p.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    if carried:
        p.setJointMotorControl2(body, 0, p.POSITION_CONTROL, 0, force=1000, physicsClientId=client)
    for link in range(carried, carried + len(masses)):
        p.changeDynamics(body, link, **UNDAMPED, jointDamping=0, physicsClientId=client)
        p.setJointMotorControl2(body, link, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


def places_under_pull(world, client, arm, links, pull, dt):
    """Angles (steps, links) [rad] for one second in which a cord above the hinges pulls on the last link."""
    tip = np.array([0.04 * len(links) - 0.01, 0, 0.006])
    t = world.add_tendon([tip, [-0.1, 0, 0.006]], 0.001, bt.Material(stiffness=2e4, damping=2.0), 20)
    t.attach(0, arm, links[-1])
    t.set_force(-1, [-pull, 0, 0])
    places = []
    for _ in range(round(1 / dt)):
        world.step()
        assert world.report.converged
        places.append([s[0] for s in p.getJointStates(arm, links, client)])
    return places


@pytest.mark.parametrize("dt", [1 / 240, 1 / 80, 1 / 60])
@pytest.mark.parametrize("pull", [0.4, 4.0, 20.0])
@pytest.mark.parametrize("masses", [[0.02, 0.01, 0.005], [0.005] * 4, [0.2, 0.003]])
def test_light_links_come_to_rest_at_all_their_limits(make_world, client, tmp_path, masses, pull, dt):
    """pybullet cuts off rates before its limits act, and ends its sweeps over several limits early.

    A pull above the hinges bends all of them to the same side. What was cut off, or left undone, would throw
    the other links.
    """
    arm = chain(client, tmp_path, masses)
    places = places_under_pull(make_world(dt), client, arm, range(len(masses)), pull, dt)
    assert np.min(places) > -0.1 - 1e-4
    assert places[-1] == pytest.approx([-0.1] * len(masses), abs=1e-4)


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240, 1 / 80])
@pytest.mark.parametrize("pull", [0.4, 4.0, 20.0])
@pytest.mark.parametrize("masses", [[0.02, 0.01, 0.005], [0.005] * 4, [0.2, 0.003]])
def test_light_links_of_a_carriage_that_a_motor_holds_are_not_thrown(
    make_world, client, tmp_path, masses, pull, dt
):
    """The same where a motor answers. Its force limit is not known: a joint may pass its limit by a step."""
    arm = chain(client, tmp_path, masses, carried=True)
    places = places_under_pull(make_world(dt), client, arm, range(1, 1 + len(masses)), pull, dt)
    assert np.min(places) > -0.14
    assert np.max(places) < 0.1
    assert places[-1] == pytest.approx([-0.1] * len(masses), abs=1e-4)


def kinetic_energy(arm, links, client) -> float:
    """Of the links of a body [J]."""
    energy = 0.0
    for link in range(links):
        mass, _, inertia = p.getDynamicsInfo(arm, link, client)[:3]
        state = p.getLinkState(arm, link, 1, 1, client)
        axes = np.reshape(p.getMatrixFromQuaternion(state[1]), (3, 3))
        spin = axes.T @ state[7]
        energy += 0.5 * mass * np.dot(state[6], state[6]) + 0.5 * np.dot(inertia, spin**2)
    return energy


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 500, 1 / 240])
@pytest.mark.parametrize("links, strength", [(2, 0.1), (2, 0.4), (3, 0.03), (3, 0.1), (3, 0.3), (4, 0.1)])
@pytest.mark.parametrize("load", [0.1, 0.5])
def test_an_arm_with_weak_motors_that_falls_on_its_limits_is_not_thrown(
    make_world, client, tmp_path, links, strength, load, dt
):
    """Its motors yield when it strikes. A force that stops it as if they held would throw it back.

    strength: of the motors, as a share of the torque of the arm's weight. load: mass on the tendon, as a
    share of the arm's. Gravity points upwards, where the limits are near.
    """
    mass, length, g = 0.03, 0.04, 9.81
    arm = chain(client, tmp_path, [mass] * links, length)
    reach = links * length
    for link in range(links):
        force = strength * links * mass * g * 0.5 * reach
        p.setJointMotorControl2(arm, link, p.POSITION_CONTROL, 0, force=force, physicsClientId=client)
    world = make_world(dt, (0, 0, g))
    ball = p.createMultiBody(load * links * mass, basePosition=[reach, 0, 0.05], physicsClientId=client)
    cord = bt.Material(stiffness=3e3, damping=3.0)
    t = world.add_tendon([[reach, 0, 0], [reach, 0, 0.05]], 0.001, cord, 6)
    t.attach(0, arm, links - 1)
    t.attach(-1, ball)
    most = 0.0
    for _ in range(round(0.4 / dt)):
        world.step()
        heights = [p.getLinkState(arm, link, 0, 1, client)[0][2] for link in range(links)]
        fell = mass * sum(heights)
        fell += load * links * mass * (p.getBasePositionAndOrientation(ball, client)[0][2] - 0.05)
        most = max(most, kinetic_energy(arm, links, client) - g * fell)
    assert most < 0.05 * links * mass * g * reach


@pytest.mark.parametrize("links, strength", [(2, 0.1), (3, 0.03), (3, 0.3)])
def test_an_arm_that_strikes_its_limits_goes_on_from_a_saved_state_as_before(
    make_world, client, tmp_path, links, strength
):
    """Joints are moved to their limits in a step that the next one may solve again: that is saved too."""
    mass, reach, g = 0.03, 0.04 * links, 9.81
    arm = chain(client, tmp_path, [mass] * links)
    for link in range(links):
        force = strength * links * mass * g * 0.5 * reach
        p.setJointMotorControl2(arm, link, p.POSITION_CONTROL, 0, force=force, physicsClientId=client)
    world = make_world(1 / 240, (0, 0, g))
    ball = p.createMultiBody(0.1 * links * mass, basePosition=[reach, 0, 0.05], physicsClientId=client)
    t = world.add_tendon([[reach, 0, 0], [reach, 0, 0.05]], 0.001, bt.Material(stiffness=3e3, damping=3.0), 6)
    t.attach(0, arm, links - 1)
    t.attach(-1, ball)

    def go_on() -> np.ndarray:
        for _ in range(4):
            world.apply()
            p.stepSimulation(client)
        return np.array([state[:2] for state in p.getJointStates(arm, range(links), client)])

    for _ in range(36):
        world.apply()
        p.stepSimulation(client)
        bodies, tendons = p.saveState(client), world.save_state()
        went = go_on()
        p.restoreState(stateId=bodies, physicsClientId=client)
        world.restore_state(tendons)
        np.testing.assert_allclose(go_on(), went, rtol=0, atol=1e-9)
        p.restoreState(stateId=bodies, physicsClientId=client)
        world.restore_state(tendons)
        p.removeState(bodies, physicsClientId=client)


FOLDED_LINK = """<link name="l{k}"><inertial><origin xyz="0 0 0.015"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}"/></inertial></link>
<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/><origin xyz="0 0 {z}"/>
<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="10" velocity="100"/></joint>
"""


@pytest.mark.parametrize("dt", [1 / 500, 1 / 240])
@pytest.mark.parametrize("mass", [0.01, 0.08])
@pytest.mark.parametrize("links, limit", [(5, 0.4), (9, 0.3)])
def test_nothing_holds_an_arm_without_motors_beyond_its_limits(
    make_world, client, tmp_path, links, limit, mass, dt
):
    """Four cords fold discs on damped hinges. What the stops miss must not be taken for a hold."""
    text, i = '<robot name="discs"><link name="base"/>', mass * 3e-4
    for k in range(links):
        values = {"parent": f"l{k - 1}" if k else "base", "z": 0.03 if k else 0, "low": -limit, "high": limit}
        text += FOLDED_LINK.format(k=k, mass=mass, i=i, axis="1 0 0" if k % 2 else "0 1 0", **values)
    path = tmp_path / "discs.urdf"
    path.write_text(text + "</robot>")
    flags = p.URDF_USE_INERTIA_FROM_FILE
    arm = p.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
    for link in range(links):
        p.setJointMotorControl2(arm, link, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        p.changeDynamics(arm, link, jointDamping=1e-5, physicsClientId=client)
    world = make_world(dt, (0, 0, -9.81))
    hands = []
    for k in range(4):
        x, y = 0.016 * np.cos(k * np.pi / 2), 0.016 * np.sin(k * np.pi / 2)
        points = [(x, y, -0.05), *[(x, y, 0.03 * (link + 0.5)) for link in range(links)]]
        cord = world.add_tendon(points, 5e-4, bt.Material(stiffness=2e3, damping=1.0), 4 * links)
        cord.attach(-1, arm, links - 1, position=(x, y, 0))
        hands.append(cord.grip(0))
    farthest = 0.0
    for k in range(round(1 / dt)):
        pulled = 0.01 * min(1, 2 * k * dt)
        hands[0].target = (0.016, 0, -0.05 - pulled)
        hands[2].target = (-0.016, 0, -0.05 + pulled)
        world.step()
        states = p.getJointStates(arm, range(links), client)
        farthest = max(farthest, *(abs(state[0]) for state in states))
    assert farthest < limit + 5e-3


def trolley_with_wheel(client, radius, wheel_mass, mass=1.0, rail=(1, 0, 0), way=0.1):
    """A trolley on a rail up to +-way [m], and a wheel on a hinge of it about y."""
    disc = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=0.04, physicsClientId=client)
    body = p.createMultiBody(
        0,
        linkMasses=[mass, wheel_mass],
        linkCollisionShapeIndices=[-1, disc],
        linkVisualShapeIndices=[-1, -1],
        linkPositions=[(0, 0, 0)] * 2,
        linkOrientations=[(0, 0, 0, 1), p.getQuaternionFromEuler([np.pi / 2, 0, 0])],
        linkInertialFramePositions=[(0, 0, 0)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_PRISMATIC, p.JOINT_REVOLUTE],
        linkJointAxis=[rail, (0, 0, 1)],
        physicsClientId=client,
    )
    p.changeDynamics(body, 0, jointLowerLimit=-way, jointUpperLimit=way, physicsClientId=client)
    p.setJointMotorControl2(body, 1, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


@pytest.mark.parametrize("mass", [0.3, 3.0])
@pytest.mark.parametrize("wheel_mass", [0.01, 0.1])
@pytest.mark.parametrize("dt", [1 / 480, 1 / 240])
def test_a_motor_that_drives_a_joint_onto_its_limit_leaves_the_others_alone(
    make_world, client, mass, wheel_mass, dt
):
    """A rope runs over the wheel of a trolley that drives into its end stop: the wheel follows the rope."""
    radius, rope, speed = 0.04, 0.002, 0.3
    world = make_world(dt, (0, 0, -9.81))
    body = trolley_with_wheel(client, radius, wheel_mass)
    world.add_obstacle(body, 1, friction=1.0)
    weight = p.createMultiBody(mass, basePosition=(radius + rope, 0, -0.2), physicsClientId=client)
    angle = np.linspace(np.pi / 2, 0, 30)[:, None]
    arc = (radius + rope) * np.hstack([np.cos(angle), 0 * angle, np.sin(angle)])
    line = np.vstack([[-0.4, 0, radius + rope], arc, [radius + rope, 0, -0.2]])
    cord = bt.Material(stiffness=2e4, damping=20.0, friction=0.5)
    tendon = world.add_tendon(line, rope, cord, 50)
    hand = tendon.grip(0)
    tendon.attach(-1, weight)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, 0, speed, 200.0, physicsClientId=client)
    for _ in range(round(0.6 / dt)):
        hand.target = hand.target + (0.5 * speed * dt, 0, 0)
        world.step()
        assert world.report.converged
        assert world.report.iterations < 500  # 8,000 where the wheel is predicted to be thrown
        assert abs(p.getJointState(body, 1, client)[1]) < 20  # rad/s; the rope passes at 0.3 m/s, 7 rad/s
    place, rate = p.getJointState(body, 0, client)[:2]
    assert place == pytest.approx(0.1, abs=1e-4) and abs(rate) < 1e-6


@pytest.mark.parametrize("factor", [1.5, 3.0])
@pytest.mark.parametrize("mass", [0.05, 0.5])
@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240, 1 / 100])
def test_a_motor_that_yields_to_an_impact_throws_nothing(make_world, client, dt, mass, factor):
    """A weight falls into a cord below a slider that a motor holds by a limited force: it only yields."""
    load = 0.3
    world = make_world(dt, (0, 0, -9.81))
    body = links_on_joints(client, p.JOINT_PRISMATIC, [mass], [(0, 0, 1)])
    force = factor * (mass + load) * 9.81
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, 0, 0, force, physicsClientId=client)
    cord = bt.Material(stiffness=1e4, damping=1.0, tension_only=True)
    tendon = world.add_tendon([(0, 0, 0), (0, 0, -0.2)], 0.001, cord, 20, rest_length=0.202)
    tendon.attach(0, body, 0)
    tendon.set_point_mass(-1, load)
    for _ in range(round(1 / dt)):
        world.step()
        # 75 mm, where the motor's force is taken for none in the step in which it yields
        assert p.getJointState(body, 0, client)[0] < 1e-6
    assert p.getJointState(body, 0, client)[0] > -0.01  # mm: what the fall's energy lets it slip by
    assert tendon.tension.min() == pytest.approx(load * 9.81, rel=0.1)


def jaws_about_a_cord(world, client, mass, radius, cord, particles, slack, count=2, away=3):
    """Two jaws, or one and an anvil, that slide towards a cord: box bodies, and slack as rest over length.

    away: from the cord's axis, in its radii.
    """
    edge = 10 * radius
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[edge, edge / 2, edge], physicsClientId=client)
    places = [(0, side * (edge / 2 + away * radius), 0) for side in (-1, 1)[:count]]
    axes = [(0, 1, 0), (0, -1, 0)][:count]
    jaws = links_on_joints(client, p.JOINT_PRISMATIC, [mass] * count, axes, box, places)
    world.add_obstacle(jaws, friction=1.0)
    if count == 1:
        anvil = p.createMultiBody(0, box, -1, (0, edge / 2 + radius, 0), physicsClientId=client)
        world.add_obstacle(anvil, friction=1.0)
    line = [(-3 * edge, 0, 0), (3 * edge, 0, 0)]
    tendon = world.add_tendon(line, radius, cord, particles, rest_length=slack * 6 * edge)
    for end in (0, -1):
        tendon.grip(end)
    return jaws


@pytest.mark.parametrize("modes", ["rates", "places", "both"])
@pytest.mark.parametrize("share", [5.0, 35.0, 46.0, 49.0])
@pytest.mark.parametrize(
    ("force", "speed", "dt"), [(47.0, 0.012, 1 / 150), (5.0, 0.05, 1 / 240), (1.02, 0.016, 0.009)]
)
def test_light_jaws_that_motors_close_on_a_cord_are_not_thrown_back(
    make_world, client, force, speed, dt, share, modes
):
    """They press it with the motors' force. share: what this would give a jaw in a step [m/s].

    modes: motors that hold rates, or drive to places, or one of each, so that the jaws answer differently.
    """
    radius = 1.3e-3
    world = make_world(dt)
    cord = bt.Material(stiffness=3e4, damping=20.0)
    jaws = jaws_about_a_cord(world, client, force * dt / share, radius, cord, 21, 0.995)
    for joint in (0, 1):
        if modes == "rates" or (modes == "both" and joint == 0):
            goal = {"controlMode": p.VELOCITY_CONTROL, "targetVelocity": speed}
        else:
            goal = {"controlMode": p.POSITION_CONTROL, "targetPosition": 3 * radius, "maxVelocity": speed}
        p.setJointMotorControl2(jaws, joint, force=force, **goal, physicsClientId=client)
    most = 1.1 * speed if modes == "rates" else 1.1 * speed + radius / dt  # out by half a radius each, once
    for _ in range(240):
        world.step()
        rates = [p.getJointState(jaws, joint, client)[1] for joint in (0, 1)]
        assert np.abs(rates).max() < most
    for joint in (0, 1):
        assert abs(world.wrench(jaws, joint)[1]) == pytest.approx(force, rel=1e-3)


@pytest.mark.parametrize("share", [0.5, 5.0, 20.0])
@pytest.mark.parametrize("radii", [0.7, 1.3, 1.9])
@pytest.mark.parametrize("dt", [1 / 70, 1 / 240])
@pytest.mark.parametrize("has_limits", [False, True])
def test_jaws_that_come_at_a_steady_speed_close_on_a_cord(make_world, client, dt, radii, share, has_limits):
    """On the way their motors give what pybullet's damping takes, and nothing else. radii: way in a step.

    has_limits: their joints end behind the cord. What the motors could give moves a jaw that far in a step.
    """
    radius, force = 2e-3, 10.0
    world = make_world(dt)
    cord = bt.Material(stiffness=3e4, damping=20.0)
    jaws = jaws_about_a_cord(world, client, force * dt / share, radius, cord, 21, 0.995, away=20)
    limits = {"jointLowerLimit": 0.0, "jointUpperLimit": 24 * radius} if has_limits else {}
    for joint in (0, 1):  # with pybullet's own damping
        damping = {"linearDamping": 0.04, "angularDamping": 0.04}
        p.changeDynamics(jaws, joint, **damping, **limits, physicsClientId=client)
    speed = radii * radius / dt
    drive(client, jaws, False, force, speed, 0)
    for _ in range(round(19 / radii) + 40):
        world.step()
        assert world.report.converged
        places, rates = np.transpose([p.getJointState(jaws, joint, client)[:2] for joint in (0, 1)])
        assert np.abs(rates).max() < 1.1 * speed
        assert places.max() < 19.1 * radius
    assert places == pytest.approx([19 * radius] * 2, rel=1e-3)
    pressed = [abs(world.wrench(jaws, joint)[1]) for joint in (0, 1)]
    assert pressed == pytest.approx([force] * 2, rel=1e-3)


GRIPPER = """<robot name="gripper">
  <link name="base">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  {links}
</robot>"""
SLIDE = """<link name="{name}">
    <inertial><mass value="{mass}"/>
      <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>{collision}
  </link>
  <joint name="to_{name}" type="prismatic">
    <parent link="{parent}"/><child link="{name}"/><origin xyz="{at} 0 0"/><axis xyz="{axis}"/>
    <limit lower="-0.1" upper="0.1" effort="1e4" velocity="10"/>
  </joint>"""


def gripper(client, folder, mass, size):
    """A slide that lifts (joint 0) two balls on slides (joints 1 and 2), of this mass [kg] and radius [m]."""
    ball = f'<collision><geometry><sphere radius="{size}"/></geometry></collision>'
    lift = SLIDE.format(name="lift", mass=0.5, collision="", parent="base", at=0, axis="0 0 1")
    jaws = [
        SLIDE.format(
            name=f"jaw{k}", mass=mass, collision=ball, parent="lift", at=0.03 * side, axis=f"{-side} 0 0"
        )
        for k, side in enumerate((-1, 1))
    ]
    path = folder / "gripper.urdf"
    path.write_text(GRIPPER.format(links="".join([lift, *jaws])))
    return p.loadURDF(str(path), [0, 0, -0.05], useFixedBase=True, physicsClientId=client)


@pytest.mark.parametrize(
    ("mass", "force", "stiffness"),
    [
        (0.036, 14.39, 63.8),
        (0.03, 14.39, 63.8),
        (0.036, 14.39, 30.0),
        (0.036, 14.39, 200.0),
        (0.042, 17.39, 63.8),
    ],
)
def test_jaws_whose_motors_yield_are_not_stopped_at_the_ends_of_their_joints(
    make_world, client, tmp_path, mass, force, stiffness
):
    """There the motors alone would push them in this step. They would squeeze the cord as if held there."""
    radius, size, load = 0.00294, 0.005, 0.25
    world = make_world(0.0142, (0, 0, -9.81))
    cord = bt.Material(stiffness=stiffness, damping=0.01 * stiffness)
    tendon = world.add_tendon([(0, 0, 0), (0, 0, -0.3)], radius, cord, 35)
    tendon.grip(0)
    tendon.set_point_mass(-1, load)
    jaws = gripper(client, tmp_path, mass, size)
    for joint in (1, 2):
        world.add_obstacle(jaws, joint, friction=0.26)
        goal = {"controlMode": p.VELOCITY_CONTROL, "targetVelocity": 0.3, "force": force}
        p.setJointMotorControl2(jaws, joint, **goal, physicsClientId=client)
    p.setJointMotorControl2(jaws, 0, p.POSITION_CONTROL, 0.0, force=1e4, physicsClientId=client)
    for _ in range(60):
        world.step()
        assert world.report.converged
        rates = [p.getJointState(jaws, joint, client)[1] for joint in (1, 2)]
        assert np.abs(rates).max() < 0.31
    reached = [p.getJointState(jaws, joint, client)[0] for joint in (1, 2)]
    assert reached == pytest.approx([0.03 - size - radius] * 2, rel=1e-2)


def drive(client, jaws, places, force, speed, goal):
    """Let both motors close jaws at a speed, the second one by driving to a place, where `places` is set."""
    for joint in (0, 1):
        mode = {"controlMode": p.VELOCITY_CONTROL, "targetVelocity": speed}
        if places and joint == 1:
            to = goal if speed > 0 else 0
            mode = {"controlMode": p.POSITION_CONTROL, "targetPosition": to, "maxVelocity": abs(speed)}
        p.setJointMotorControl2(jaws, joint, force=force, **mode, physicsClientId=client)


@pytest.mark.parametrize("share", [0.5, 5.0, 20.0, 45.0])
@pytest.mark.parametrize("dt", [1 / 120, 1 / 240, 1 / 1000])
@pytest.mark.parametrize("places", [False, True])
def test_jaws_press_with_what_their_motors_are_given(make_world, client, dt, share, places):
    """Less, more, opened, closed, and nearly nothing. share: what 5 N would give a jaw in a step [m/s]."""
    radius = 1.3e-3
    world = make_world(dt)
    cord = bt.Material(stiffness=3e4, damping=20.0, friction=0.5)
    jaws = jaws_about_a_cord(world, client, 5.0 * dt / share, radius, cord, 21, 0.995)
    speed = radius / (10 * dt)
    turns = [(5.0, 1, 60), (2.0, 1, 30), (8.0, 1, 30), (8.0, -1, 60), (3.0, 1, 100), (0.5, 2, 30)]
    for force, factor, steps in turns:
        drive(client, jaws, places, force, factor * speed, 3 * radius)
        for _ in range(steps):
            world.step()
            rates = [p.getJointState(jaws, joint, client)[1] for joint in (0, 1)]
            assert np.abs(rates).max() < 2 * speed  # not thrown: 0.5 N alone would give 0.2 to 20 of it
        pressed = [abs(world.wrench(jaws, joint)[1]) for joint in (0, 1)]
        assert pressed == pytest.approx([force if factor > 0 else 0] * 2, rel=1e-3, abs=1e-9)


def test_motors_that_were_off_are_off_after_a_restore(make_world, client):
    """pybullet goes on to tell what they gave last, and after a restore what they gave later."""
    radius, dt = 1.3e-3, 1 / 240
    world = make_world(dt)
    cord = bt.Material(stiffness=3e4, damping=20.0, friction=0.5)
    jaws = jaws_about_a_cord(world, client, 5.0 * dt / 20, radius, cord, 21, 0.995)
    speed = radius / (10 * dt)
    drive(client, jaws, False, 5.0, speed, 0)
    world.step(40)
    drive(client, jaws, False, 0.0, 0.0, 0)
    world.step(3)
    state, saved = world.save_state(), p.saveState(physicsClientId=client)

    def go_on():
        motions = []
        for step in range(40):
            if step == 10:
                drive(client, jaws, False, 2.0, speed, 0)
            world.step()
            motions.append([p.getJointState(jaws, joint, client)[:2] for joint in (0, 1)])
        return np.array(motions)

    first = go_on()
    p.restoreState(saved, physicsClientId=client)
    world.restore_state(state)
    drive(client, jaws, False, 0.0, 0.0, 0)
    np.testing.assert_array_equal(first, go_on())


@pytest.mark.parametrize("mass", [0.2, 0.5, 0.6, 0.718, 0.8])
@pytest.mark.parametrize("particles", [41, 43, 45])
def test_a_jaw_whose_motor_yields_within_a_cut_step_was_where_it_is_let_yield(
    make_world, client, mass, particles
):
    """A motor's force acts evenly in a step: where it yields late in it, the step is solved from its start.

    Else the jaw was elsewhere in the substeps that are finished, and leaps through the cord.
    """
    force, speed, radius = 275.0, 0.01284, 7.93e-4
    world = make_world(0.00823)
    cord = bt.Material(stiffness=13.74, damping=6.4e-4, density=1790.0, friction=0.45)
    jaw = jaws_about_a_cord(world, client, mass, radius, cord, particles, 0.9388, count=1)
    p.setJointMotorControl2(jaw, 0, p.VELOCITY_CONTROL, 0, speed, force, physicsClientId=client)
    for _ in range(240):
        world.step()
        assert abs(p.getJointState(jaw, 0, client)[1]) < 1.1 * speed
    assert abs(world.wrench(jaw, 0)[1]) == pytest.approx(force, rel=1e-3)
    assert p.getJointState(jaw, 0, client)[0] == pytest.approx(2 * radius, rel=1e-2)


@pytest.mark.parametrize(
    ("torque", "mass", "arm", "dt", "stiffness", "speed", "particles"),
    [
        (9.27, 0.766, 0.15, 1 / 60, 2.6e5, 0.35, 2),
        (1.02, 0.223, 0.07, 1 / 60, 2.8e4, 2.2, 2),
        (1.42, 0.072, 0.12, 1 / 240, 2.9e5, 1.2, 15),
        (5.9, 1.1, 0.11, 1 / 60, 2.7e4, 0.18, 2),
        (0.0143, 0.000274, 0.0634, 0.00206, 1260.0, 17.4, 2),
    ],
)
def test_a_lever_whose_motor_stalls_pulls_with_its_torque(
    make_world, client, torque, mass, arm, dt, stiffness, speed, particles
):
    """A motor that moved a lever freely is stalled by a stiff tendon: T arm = torque; nothing is thrown."""
    world = make_world(dt)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.01, arm], physicsClientId=client)
    axis, centre = [(0, -1, 0)], (0, 0, arm / 2)
    lever = links_on_joints(client, p.JOINT_REVOLUTE, [mass], axis, shape, centre=centre)
    p.setJointMotorControl2(
        lever, 0, p.VELOCITY_CONTROL, targetVelocity=speed, force=torque, physicsClientId=client
    )
    cord = bt.Material(stiffness=stiffness, damping=1e-3 * stiffness)
    tendon = world.add_tendon([(0.2, 0, arm), (0, 0, arm)], 1e-3, cord, particles, rest_length=0.2005)
    tendon.grip(0)
    tendon.attach(-1, lever, 0)
    for _ in range(round(3 / dt)):
        world.step()
        assert world.report.converged
        assert abs(p.getJointState(lever, 0, client)[1]) < 10 * speed
    end, along = tendon.positions[-1], tendon.positions[-2] - tendon.positions[-1]
    lever_arm = abs(np.cross(end, along / np.linalg.norm(along))[1])
    assert tendon.tension[-1] * lever_arm == pytest.approx(torque, rel=1e-3)


@pytest.mark.parametrize(
    "wheel_mass, load, strain, friction",
    [(0.02, 0.5, 0.3, 0.0), (0.02, 0.5, 0.3, 0.6), (0.5, 0.05, 0.003, 0.0)],
)
def test_a_motor_that_just_holds_a_joint_is_not_thrown_off_its_limit(
    make_world, client, wheel_mass, load, strain, friction
):
    """It lifts a wheel with a rope over it: what was learned of its hold is no response to the limit."""
    radius, rope, block, speed, dt = 0.04, 0.002, 2.0, 0.3, 1e-3
    world = make_world(dt, (0, 0, -9.81))
    body = trolley_with_wheel(client, radius, wheel_mass, block, rail=(0, 0, 1), way=0.05)
    for joint in range(2):
        p.changeDynamics(
            body, joint, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=client
        )
    world.add_obstacle(body, 1, friction=1.0)
    angle, off = np.linspace(np.pi, 0, 40)[:, None], 1.01 * (radius + rope)
    arc = off * np.hstack([np.cos(angle), 0 * angle, np.sin(angle)])
    line = np.vstack([[-off, 0, -0.2], arc, [off, 0, -0.2]])
    cord = bt.Material(stiffness=load * 9.81 / strain, friction=friction)
    tendon = world.add_tendon(line, rope, cord, 40)
    tendon.set_point_mass(0, load)
    tendon.grip(-1)
    force = 1.5 * (block + wheel_mass + 2 * load) * 9.81
    for k in range(600):
        target = speed if k > 200 else 0.0
        p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, 0, target, force, physicsClientId=client)
        world.step()
        # 3 m/s, down to the other end of the rail, where the limit's force is that on the response learned
        assert abs(p.getJointState(body, 0, client)[1]) < 1.01 * speed
    assert p.getJointState(body, 0, client)[0] == pytest.approx(0.05, abs=1e-4)


@pytest.mark.parametrize("step", [0.003, 0.003428, 0.004])
@pytest.mark.parametrize("pulls", [(0.3631, 0.2812), (0.5, 0.45)])
def test_a_finger_that_swings_into_its_stop_is_not_thrown_back(client, make_world, step, pulls):
    """On the way there it leaves another stop. What pybullet's sweeps leave of that is no constraint."""
    world = make_world(step, (0, 0, -9.81))
    flags = p.URDF_USE_INERTIA_FROM_FILE
    path = bt.data_path("tendon_finger.urdf")
    finger = world.load_urdf(path, useFixedBase=True, flags=flags, obstacles=False)
    for joint in range(3):
        p.changeDynamics(finger, joint, **UNDAMPED, jointDamping=0, physicsClientId=client)
        p.setJointMotorControl2(finger, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    for _ in range(60):
        for tendon, pull in zip(world.tendons, pulls, strict=True):
            end = tendon.positions[-1] - tendon.positions[-2]
            tendon.set_force(-1, end / np.linalg.norm(end) * pull)
        world.step()
        assert world.report.converged
        angles, rates = np.array([p.getJointState(finger, k, client)[:2] for k in range(3)]).T
        assert angles.min() > -0.11
        assert angles.max() < 1.21
        assert np.abs(rates).max() < 60


def test_an_arm_that_a_load_pulls_onto_its_stop_gains_no_energy(make_world, client):
    """A shoulder's motor yields under 20 kg on a cord, and the arm falls onto the joint's limit.

    There the limit resists with more than motors can, and the elbow's motor yields as well.
    """
    load, yields, dt = 20.0, 120.0, 1e-3
    world = make_world(dt, (0, 0, -9.81))
    p.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
    arm = p.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True, physicsClientId=client)
    pose = [0, 1.2, 0, -0.5, 0, 0.3, 0]
    for joint, place in enumerate(pose):
        p.resetJointState(arm, joint, place, physicsClientId=client)
        force = yields if joint == 1 else 300.0
        p.setJointMotorControl2(
            arm, joint, p.POSITION_CONTROL, targetPosition=place, force=force, physicsClientId=client
        )
    wrist = np.array(p.getLinkState(arm, 6, 0, 1, client)[4])
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.03, physicsClientId=client)
    below = wrist - (0, 0, 0.3)
    weight = p.createMultiBody(load, ball, basePosition=below.tolist(), physicsClientId=client)
    tendon = world.add_tendon([wrist, below], 1e-3, bt.Material(stiffness=1e5, damping=100.0), 10)
    tendon.attach(0, arm, 6)
    tendon.attach(-1, weight)

    def energy():
        """Of arm and weight, and of the shoulder's motor, which turns it by a constant torque [J]."""
        where, _ = p.getBasePositionAndOrientation(weight, client)
        velocity = np.array(p.getBaseVelocity(weight, client)[0])
        total = load * (velocity @ velocity / 2 + 9.81 * where[2])
        for link in range(7):
            mass, _, inertia = p.getDynamicsInfo(arm, link, client)[:3]
            state = p.getLinkState(arm, link, 1, 1, client)
            turn = np.reshape(p.getMatrixFromQuaternion(state[1]), (3, 3))
            velocity, spin = np.array(state[6]), turn.T @ state[7]
            total += mass * (velocity @ velocity / 2 + 9.81 * state[0][2]) + spin @ (inertia * spin) / 2
        return total + yields * (p.getJointState(arm, 1, client)[0] - pose[1])

    most = energy()
    for _ in range(850):
        world.step()
        assert world.report.converged
        assert energy() < most + 1e-2
    assert p.getJointState(arm, 1, client)[0] == pytest.approx(2.094, abs=0.02)


CHAIN = """<robot name="chain"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="0.3"/>
<inertia ixx="1e-4" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="0.2"/>
<inertia ixx="1e-4" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="first" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0.5" effort="100" velocity="100"/></joint>
<joint name="second" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.2 0 0"/>
<axis xyz="0 1 0"/><limit lower="-0.4" upper="0.4" effort="100" velocity="100"/></joint></robot>"""


def test_an_arm_moves_as_it_does_without_an_equal_one(tmp_path):
    """Two arms of one URDF, turned differently, are drawn onto their limits: neither feels the other."""
    path = tmp_path / "chain.urdf"
    path.write_text(CHAIN)

    def angles(chosen):
        client = p.connect(p.DIRECT)
        p.setTimeStep(1 / 240, physicsClientId=client)
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        world = bt.TendonWorld(client)
        arms, grips = [], []
        for k in chosen:
            place, turn = [0, 1.0 * k, 1], p.getQuaternionFromEuler((0, 0, 1.2 * k))
            arm = p.loadURDF(str(path), place, turn, useFixedBase=True, physicsClientId=client)
            for joint in (0, 1):
                p.setJointMotorControl2(arm, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
            tip = np.array(p.multiplyTransforms(place, turn, (0.35, 0, 0), (0, 0, 0, 1))[0])
            up = np.array([0, 0, 1.0 - 2 * k])
            cord = world.add_tendon([tip + 0.3 * up, tip], 1e-3, bt.Material(stiffness=5e3, damping=5.0), 6)
            cord.attach(-1, arm, 1)
            grips.append((cord.grip(0), tip + 0.3 * up, 0.002 * up))
            arms.append(arm)
        found = []
        for step in range(150):
            for grip, start, way in grips:
                grip.target = start + min(step, 100) * way
            world.step()
            found.append([[p.getJointState(arm, j, client)[0] for j in (0, 1)] for arm in arms])
        p.disconnect(client)
        return np.array(found)

    both = angles([0, 1])
    for k in (0, 1):
        alone = angles([k])[:, 0]
        assert np.abs(alone).max() > 0.39  # it reached a limit
        np.testing.assert_allclose(both[:, k], alone, atol=1e-9)  # 0.05 where it takes the other one's places
