"""Friction against exact results: the capstan equation, slopes, two weights over a cylinder."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import atwood, capstan, curved_tunnel, incline
from link_scenes import links_on_joints
from scene_runs import holds

import bullet_tendon as bt

QUARTER, HALF = np.pi / 2, np.pi


def test_capstan(monkeypatch):
    holds(capstan, monkeypatch, FRICTIONS=(0.05, 0.5), ANGLES=(QUARTER, 4 * HALF))


def test_capstan_with_twice_the_particles(monkeypatch):
    half = capstan.SEGMENT / 2
    holds(capstan, monkeypatch, FRICTIONS=(0.05, 0.5), ANGLES=(HALF, 4 * HALF), SEGMENT=half, WITHIN=0.003)


@pytest.mark.slow
@pytest.mark.parametrize(("finer", "within"), [(1, 0.01), (2, 0.003)])
def test_capstan_at_every_coefficient_and_angle(monkeypatch, finer, within):
    changes = {"SEGMENT": capstan.SEGMENT / finer, "WITHIN": within}
    angles = np.arange(1, 9) * QUARTER
    holds(capstan, monkeypatch, FRICTIONS=(0.05, 0.1, 0.2, 0.3, 0.4, 0.5), ANGLES=angles, **changes)


def test_drawing_faster_does_not_brake(monkeypatch):
    """Planes that stay where the step begins would brake by (way in a step) / R, here 2 % a radian."""
    changes = {"SPEED": 0.16, "TRAVEL": 0.03, "LEG": 0.04, "START": 0.05}
    holds(capstan, monkeypatch, FRICTIONS=(0.0001, 0.2), ANGLES=(QUARTER, HALF), **changes)


def test_curved_tunnel(monkeypatch):
    holds(curved_tunnel, monkeypatch, FRICTIONS=(0.05, 0.5), ANGLES=(QUARTER, HALF))


@pytest.mark.slow
def test_curved_tunnels_of_every_coefficient_and_angle(monkeypatch):
    angles = np.arange(1, 4) * QUARTER
    holds(curved_tunnel, monkeypatch, FRICTIONS=(0.05, 0.1, 0.2, 0.3, 0.4, 0.5), ANGLES=angles)


def test_a_slope_just_less_steep_than_friction_holds_and_one_just_steeper_slides(monkeypatch):
    holds(incline, monkeypatch, STEPS=2000)


@pytest.mark.slow
def test_a_slope_holds_for_all_steps(monkeypatch):
    holds(incline, monkeypatch)


def test_two_weights_over_a_cylinder(monkeypatch):
    holds(atwood, monkeypatch)


def test_sliding_contacts_are_at_their_limits(make_world, client):
    """Drawn over a cylinder: every contact's friction is mu N."""
    world = make_world()
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.03, height=0.2, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, physicsClientId=client), friction=1.0)
    turned = np.radians(np.arange(0, 181, 5))
    arc = np.c_[0.032 * np.cos(turned), 0.032 * np.sin(turned), 0 * turned]
    points = np.vstack([[0.032, -0.03, 0], arc, [-0.032, -0.03, 0]])
    t = world.add_tendon(points, 0.002, bt.Material(stiffness=3e4, damping=3.0, friction=0.3), 61)
    hand = t.grip(-1)
    t.set_force(0, (0, -5.0, 0))
    for _ in range(120):
        hand.target = hand.target + (0, -1e-4, 0)
        world.step()
    c = world.contacts[world.contacts["normal_force"] > 1e-3]
    assert len(c) > 20
    np.testing.assert_allclose(c["friction_force"], 0.3 * c["normal_force"], rtol=2e-3)


@pytest.mark.parametrize(("stiffness", "after"), [(1e4, 9.0), (1e3, 7.0)])
def test_what_is_pulled_less_slides_back_near_the_pull_only(make_world, client, stiffness, after):
    """Beyond that, the tension stays as it was: it has a maximum between, where both slopes meet.

    At 1/960 s the pull, which begins at once, is resolved. At 1/240 s it overshoots by one step's motion.
    """
    mu, pull, bone, radius = 0.5, 10.0, 0.02, 0.001
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=bone, height=0.1, physicsClientId=client)
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    body = p.createMultiBody(0, shape, baseOrientation=turn, physicsClientId=client)
    world = make_world(1 / 960, (0, 0, 0))
    world.add_obstacle(body, friction=1.0)
    a = np.linspace(np.pi, 0, 61)
    arc = 1.002 * (bone + radius) * np.c_[np.cos(a), 0 * a, np.sin(a)]
    line = np.vstack([arc[0] - [0, 0, 0.04], arc, arc[-1] - [0, 0, 0.04]])
    material = bt.Material(stiffness=stiffness, damping=1e-3 * stiffness, friction=mu)
    t = world.add_tendon(line, radius, material, 80)
    t.grip(0)
    t.set_force(-1, (0, 0, -pull))
    world.step(1600)
    held = t.tension[0]
    # 1.6 times that, if contacts yield by the tension over the segment.
    assert held == pytest.approx(pull * np.exp(-mu * np.pi), rel=0.15)
    t.set_force(-1, (0, 0, -after))
    world.step(1600)
    assert t.tension[0] == pytest.approx(held, rel=0.005)
    most = np.sqrt(pull * after)  # pull e^(-mu phi) = after e^(mu phi)
    assert 0.9 * most < t.tension.max() < 1.02 * most


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_what_rests_over_an_edge_goes_on_resting(make_world, client, integrator, friction):
    """Whatever the weights of the method: it neither begins to vibrate nor starts where they change."""
    world = make_world(1 / 240, (0, 0, -9.81), sleep=False)
    half = [0.02, 0.1, 0.02]
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    world.add_obstacle(
        p.createMultiBody(0, shape, basePosition=[0, 0, 0.1], physicsClientId=client), friction=1.0
    )
    line = [[-0.08, 0, 0.09], [-0.023, 0, 0.123], [0.023, 0, 0.123], [0.08, 0, 0.09]]
    t = world.add_tendon(line, 0.002, bt.Material(stiffness=500.0, damping=0.5, friction=friction), 24)
    t.grip(0), t.grip(-1)
    world.step(500)
    x = t.positions
    world.options = bt.SolverOptions(integrator=integrator, sleep=False)
    world.step(600)
    assert np.abs(t.velocities).max() < 1e-8
    np.testing.assert_allclose(t.positions, x, atol=1e-9)


OPEN_BY = 0.004  # way of each jaw to the cord between them [m]


def gripper(client, mass, cord_radius):
    """Two jaws on sliders, on both sides of a cord along x, which open by OPEN_BY; its body id."""
    half = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.01, 0.02], physicsClientId=client)
    sides = (-1, 1)
    places = [(0, side * (0.01 + cord_radius + OPEN_BY), 0) for side in sides]
    axes = [(0, -side, 0) for side in sides]
    jaws = links_on_joints(client, p.JOINT_PRISMATIC, [mass] * 2, axes, half, places)
    for joint in (0, 1):
        p.setCollisionFilterGroupMask(jaws, joint, 0, 0, client)
    return jaws


def joint_states(body, client, which):
    return np.array([state[which] for state in p.getJointStates(body, (0, 1), client)])


@pytest.mark.parametrize(
    ("force", "mass", "stiffness"), [(10.0, 0.1, 2e4), (30.0, 0.5, 2e3), (100.0, 0.5, 2e4)]
)
def test_jaws_that_a_motor_closes_hold_a_cord_up_to_twice_mu_their_force(
    make_world, client, force, mass, stiffness
):
    """What the motor presses with is not told before the step: jaws sink in and come back, and stay."""
    mu, radius = 0.4, 0.002
    world = make_world(1 / 240)
    jaws = gripper(client, mass, radius)
    for joint in (0, 1):
        p.setJointMotorControl2(
            jaws, joint, p.VELOCITY_CONTROL, targetVelocity=0.05, force=force, physicsClientId=client
        )
    world.add_obstacle(jaws, friction=1.0)
    material = bt.Material(stiffness=stiffness, damping=1e-3 * stiffness, friction=mu)
    cord = world.add_tendon([[-0.06, 0, 0], [0.06, 0, 0]], radius, material, 49)
    world.step(144)
    np.testing.assert_allclose(joint_states(jaws, client, 0), OPEN_BY, atol=1e-3 * radius)
    start, slips_at = cord.positions[0, 0], None
    for share in np.linspace(0, 1.1, 400):
        cord.set_force(-1, (share * 2 * mu * force, 0, 0))
        world.step()
        assert world.report.converged
        if slips_at is None and cord.positions[0, 0] - start > 0.1 * radius:
            slips_at = share
    assert slips_at == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("control", [p.VELOCITY_CONTROL, p.POSITION_CONTROL])
@pytest.mark.parametrize(
    ("force", "mass", "dt", "stiffness", "tension"),
    [
        (20.0, 0.1, 1 / 240, 2e4, 1000.0),
        (2.0, 0.1, 1 / 240, 2e4, 1000.0),
        (20.0, 0.1, 1e-3, 2e4, 100.0),
        (20.0, 0.01, 1 / 240, 2e3, 1.0),
        (200.0, 1.0, 1 / 60, 2e4, 500.0),
        (260.0, 100.0, 1 / 240, 2e3, 1.0),
    ],
)
def test_jaws_close_on_a_taut_cord_with_the_force_of_their_motors(
    make_world, client, force, mass, dt, stiffness, tension, control
):
    """A motor that moved the jaw freely is trusted with no force that would throw the jaw when it yields."""
    radius, speed = 0.002, 0.05
    world = make_world(dt)
    jaws = gripper(client, mass, radius)
    for joint in (0, 1):
        goal = {"targetVelocity": speed} if control == p.VELOCITY_CONTROL else {"targetPosition": 0.0065}
        p.setJointMotorControl2(
            jaws, joint, control, force=force, maxVelocity=speed, physicsClientId=client, **goal
        )
    world.add_obstacle(jaws, friction=1.0)
    material = bt.Material(stiffness=stiffness, damping=1e-3 * stiffness, friction=0.4)
    slack = 0.12 / (1 + tension / stiffness)
    cord = world.add_tendon([[-0.06, 0, 0], [0.06, 0, 0]], radius, material, 49, rest_length=slack)
    cord.grip(0)
    cord.grip(-1)
    for _ in range(round(0.6 / dt)):
        world.step()
        assert world.report.converged
        # Pushed out of the depth of one step, it goes back by as much.
        assert np.abs(joint_states(jaws, client, 1)).max() < speed + radius / dt
    np.testing.assert_allclose(joint_states(jaws, client, 0), OPEN_BY, atol=1e-3 * radius)
    pressed = [abs(world.wrench(jaws, joint)[1]) for joint in (0, 1)]
    np.testing.assert_allclose(pressed, force, rtol=1e-3)
