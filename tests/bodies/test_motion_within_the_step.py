"""Where tendons take bodies to be within a step: in its parts, on a base that is led, after a blow."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED, misfit

import bullet_tendon as bt

DT = 1 / 240
CORD = bt.Material(stiffness=3e3, damping=1.0, friction=0.0)


def off_centre(client, mass, offset, at=(0, 0, 0)):
    """A free ball whose centre of mass is away from its frame."""
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    frame = {"baseInertialFramePosition": offset, "basePosition": at, "physicsClientId": client}
    body = p.createMultiBody(mass, ball, **frame)
    p.changeDynamics(body, -1, localInertiaDiagonal=[mass * 0.1] * 3, **UNDAMPED, physicsClientId=client)
    return body


def shots_at_a_ball(world, client):
    """Far away, a ball and a tendon: a function that shoots it, so that the next step is taken in parts."""
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.2, physicsClientId=client)
    body = p.createMultiBody(0, ball, -1, (1.015, 0, -0.2), physicsClientId=client)
    world.add_obstacle(body, friction=0.0)
    shot = world.add_tendon([[1, 0, 0.006], [1.03, 0, 0.006]], 0.002, CORD, 4)
    place = shot.positions
    return lambda: shot.set_positions(place, np.tile([0, 0, -20.0], (4, 1)))


@pytest.mark.parametrize("shot", [False, True])
@pytest.mark.parametrize("spin", [(0, 3.0, 0), (1.0, -2.0, 1.5)])
def test_a_body_spins_about_its_centre_in_parts_of_a_step_as_well(make_world, client, shot, spin):
    """A heavy body with an inertial offset takes an end of a tendon along, exactly to where pybullet puts it.

    It is off by what the tangent of its turn is. Something else that moves fast has the step taken in parts.
    """
    world = make_world(DT)
    body = off_centre(client, 1e4, (0.12, 0.03, 0))
    p.resetBaseVelocity(body, [0.1, 0, 0.2], spin, client)
    t = world.add_tendon([[-0.02, 0.05, 0.06], [-0.05, 0.09, 0.06]], 0.002, CORD, 4)
    tie, arm = t.attach(0, body), np.linalg.norm(t.positions[0] - [0.12, 0.03, 0])
    shoot = shots_at_a_ball(world, client) if shot else lambda: None
    parts = []
    for _ in range(6):
        shoot()
        world.step()
        parts.append(world.report.counts["substeps"])
        assert misfit(t, tie, client) <= 0.6 * arm * (np.linalg.norm(spin) * DT) ** 2
    assert (min(parts) > 1) == shot


ARM = """<robot name="arm"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="forearm"><inertial><origin xyz="0.05 0 0"/><mass value="2"/>
<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="forearm"/><origin xyz="0.3 0 0.1"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="10" velocity="100"/></joint></robot>"""


@pytest.mark.parametrize("velocity", [(0, 0, 0), (0.2, -0.1, 0.3)])
def test_a_base_that_is_led_in_a_turn_takes_its_links_along(make_world, client, tmp_path, velocity):
    """resetBaseVelocity of an arm with a fixed base: a point of a link goes with the base's v + w x r."""
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    arm = p.loadURDF(str(path), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world = make_world(DT)
    point = np.array([0.38, 0.02, 0.1])
    t = world.add_tendon([point, point + [0, 0.05, 0]], 0.002, CORD, 4)
    t.attach(0, arm, 0)
    spin = np.array([0.2, 0.1, 0.8])
    p.resetBaseVelocity(arm, velocity, spin.tolist(), client)
    world.step()
    expected = velocity + np.cross(spin, point)
    np.testing.assert_allclose(
        (t.positions[0] - point) / DT, expected, atol=1e-3 * np.linalg.norm(spin) * 0.38
    )


@pytest.mark.parametrize("gravity", [(0, 0, -9.81), (0, 0, 0)])
@pytest.mark.parametrize("blow", [(0.4, 0, 0), (0, 0, -0.5), (0.3, -0.2, 0.1)])
def test_a_single_blow_is_not_taken_for_a_lasting_push(make_world, client, gravity, blow):
    """A body on a taut cord is struck in one step; in the next ones it goes where it was foreseen to.

    A push that is taken to last moves the body, in the plan of the next step, as far as the blow did.
    """
    world, mass = make_world(DT, gravity), 0.2
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(mass, ball, -1, (0, 0, -0.1), physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    t = world.add_tendon([[0, 0, 0], [0, 0, -0.1]], 0.002, CORD, 6)
    t.grip(0)
    tie = t.attach(-1, body)
    world.step(100)
    centre = p.getBasePositionAndOrientation(body, client)[0]
    p.applyExternalForce(body, -1, blow, centre, p.WORLD_FRAME, client)
    world.step()
    thrown = np.linalg.norm(blow) / mass * DT**2
    assert misfit(t, tie, client) == pytest.approx(thrown, rel=1e-6)
    off = []
    for _ in range(4):
        world.step()
        off.append(misfit(t, tie, client))
    assert max(off) <= 1e-3 * thrown


SLIDER = """<robot name="slider"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="carriage"><inertial><mass value="2"/>
<inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="0" velocity="100"/></joint></robot>"""


def slider(client, folder):
    (folder / "slider.urdf").write_text(SLIDER)
    body = p.loadURDF(str(folder / "slider.urdf"), useFixedBase=True, physicsClientId=client)
    p.changeDynamics(body, 0, **UNDAMPED, jointDamping=0, physicsClientId=client)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body, 0


@pytest.mark.parametrize("line", ["tendon", "ligament"])
@pytest.mark.parametrize("kind", ["free", "articulated"])
@pytest.mark.parametrize("loaded_by", ["gravity", "force"])
def test_a_weight_in_balance_hangs_still_in_steps_that_are_divided(
    make_world, client, tmp_path, line, kind, loaded_by
):
    """A fast tendon elsewhere has the steps divided. What holds the weight carries exactly its load."""
    mass, pull = 2.0, 19.62
    world = make_world(DT, gravity=(0, 0, -pull / mass if loaded_by == "gravity" else 0))
    body, link = (
        slider(client, tmp_path) if kind == "articulated" else (off_centre(client, mass, (0, 0, 0)), -1)
    )
    if line == "tendon":
        cord = world.add_tendon([[0, 0, 0.2], [0, 0, 0]], 0.002, CORD, 4)
        cord.grip(0)
        tie = cord.attach(-1, body, link, (0, 0, 0))
    else:
        post = p.createMultiBody(0, basePosition=(0, 0, 0.2), physicsClientId=client)
        law = bt.Material.ligament(3e3, 0.06)
        cord = world.add_ligament([(post, -1, (0, 0, 0)), (body, link, (0, 0, 0))], law, 0.2)
    load = [(body, link, (0, 0, -pull), (0, 0, 0), p.LINK_FRAME)] if loaded_by == "force" else []
    world.relax(1e-9, bodies=[body], forces=load)
    shoot = shots_at_a_ball(world, client)
    for _ in range(12):
        shoot()
        for told in load:
            world.apply_external_force(*told)
        world.step()
        assert world.report.counts["substeps"] > 1
        held = tie.force[2] if line == "tendon" else cord.force
        assert held == pytest.approx(pull, rel=1e-6)
        state = p.getLinkState(body, 0, 1, physicsClientId=client)[6] if link == 0 else None
        velocity = p.getBaseVelocity(body, client)[0] if state is None else state
        assert np.abs(velocity).max() <= 1e-7


@pytest.mark.parametrize(("mass", "pull"), [(1e-3, 20.0), (5e-3, 100.0), (1e-2, 5.0), (5e-2, 200.0)])
def test_a_light_body_is_not_expected_to_fly_off_when_its_load_ends(make_world, client, mass, pull):
    """What held it would move it by metres. It goes no farther than the strand contracts."""
    world = make_world(DT)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(mass, ball, -1, [0, 0, -0.11], physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    world.add_obstacle(body, friction=0.0)
    law = bt.Material(stiffness=20 * pull, damping=0.05 * pull)
    strand = world.add_tendon([[0, 0, 0], [0, 0, -0.1]], 0.001, law, 21)
    strand.grip(0)
    tie = strand.attach(-1, body, -1, [0, 0, 0.01])
    for _ in range(240):
        world.apply_external_force(body, -1, (0, 0, -pull), (0, 0, 0), p.LINK_FRAME)
        world.step()
    assert tie.force[2] == pytest.approx(pull, rel=1e-6)
    assert not world.report.reasons
    world.step()
    assert world.report.converged
    assert world.report.counts["substeps"] == 1
