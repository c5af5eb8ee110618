"""A step that is solved again: what it is solved with, and what is read of its forces."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball, links_on_joints

import bullet_tendon as bt

GRAVITY = np.array([0, 0, -9.81])  # m/s^2


def by_step(world):
    world.step()


def by_apply(world):
    world.apply()
    p.stepSimulation(world.physicsClientId)


def dragged(client, world, take, dt):
    """Force of a sled of 10.7 kg on its tendon by step, and its weight times friction [N]."""
    mass, friction, stiffness = 10.681415, 0.593194, 6722.43
    for size, weight, height, mu in ([20, 20, 0.5], 0, -0.5, 1.0), ([0.1, 0.1, 0.03], mass, 0.03, friction):
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=size, physicsClientId=client)
        body = p.createMultiBody(weight, shape, -1, [0, 0, height], physicsClientId=client)
        p.changeDynamics(
            body, -1, lateralFriction=mu, linearDamping=0, angularDamping=0, physicsClientId=client
        )
    law = {"damping": 0.05 * stiffness, "density": 10, "tension_only": True}
    material = bt.Material(stiffness=stiffness, **law)
    line = world.add_tendon([(0.1, 0, 0.005), (0.5, 0, 0.005)], 1e-3, material, 2, collides=False)
    knot, hand = line.attach(0, body), line.grip(-1)
    read = []
    for i in range(int(1.25 / dt)):
        hand.target = (0.5 + 0.55 * (i + 1) * dt, 0, 0.005)
        take(world)
        read.append([knot.force[0], world.wrench(body)[0], -hand.force[0]])
    return np.array(read), mass * friction * 9.81


def test_a_dragged_sled_pulls_by_its_friction_in_a_loop_of_ones_own_too(client, make_world):
    """No step of it has to be solved again.

    By contacts of where the sled was a step before, it was held and released again and again.
    """
    dt = 0.006309348942501808
    world = make_world(dt, GRAVITY)
    own, friction = dragged(client, world, by_apply, dt)
    assert "released" not in world.report.reasons
    p.resetSimulation(client)
    world = make_world(dt, GRAVITY)
    whole, _ = dragged(client, world, by_step, dt)
    half = len(own) // 2
    np.testing.assert_allclose(own[half:].mean(axis=0), friction, rtol=1e-3)
    np.testing.assert_allclose(own, whole, rtol=0, atol=1e-6 * friction)


def hung(client, world, mass):
    """A ball on a tendon that a hand holds: ball, attachment, hand."""
    ball = free_ball(client, mass)
    material = bt.Material(stiffness=1e4, density=10.0)
    line = world.add_tendon([(0, 0, 0.2), (0, 0, 0)], 1e-3, material, 3)
    return ball, line.attach(-1, ball), line.grip(0)


def pull_down(client, ball, force=100.0):
    """In the next step the user pulls by this force [N], which the world is not told of."""
    place, _ = p.getBasePositionAndOrientation(ball, client)
    p.applyExternalForce(ball, -1, [0, 0, -force], place, p.WORLD_FRAME, client)


@pytest.mark.parametrize("take", [by_step, by_apply])
def test_impulses_between_readings_are_those_that_act(client, make_world, take):
    """A sudden pull that nobody told of is found in the next step: m dv = (F + R + m g) dt between readings.

    Those of a hand at the tendon's other end are the same: the tendon has next to no mass.
    """
    dt, mass = 1 / 240, 1.0
    world = make_world(dt, GRAVITY)
    ball, knot, hand = hung(client, world, mass)
    world.step(240)
    for k in range(30):
        before = np.array(p.getBaseVelocity(ball, client)[0])
        pull = 100.0 * (k % 6 > 2)
        pull_down(client, ball, pull)
        take(world)
        gained = mass * (np.array(p.getBaseVelocity(ball, client)[0]) - before)
        read = knot.force
        np.testing.assert_allclose(gained, dt * (read - [0, 0, pull] + mass * GRAVITY), rtol=0, atol=1e-6)
        np.testing.assert_allclose(world.wrench(ball)[:3], read, rtol=0, atol=1e-9)
        np.testing.assert_allclose(hand.force, -read, rtol=0, atol=0.02)


def test_what_is_read_is_saved(client, make_world):
    """A step that follows a restored state reads the same late impulse."""
    world = make_world(1 / 240, GRAVITY)
    ball, knot, _ = hung(client, world, 1.0)
    world.step(240)
    pull_down(client, ball)
    world.step()
    state, bullet, read = world.save_state(), p.saveState(client), []
    for _ in range(2):
        world.restore_state(state)
        p.restoreState(bullet, physicsClientId=client)
        before = knot.force
        world.step()
        read.append((before, knot.force, world.wrench(ball)[:3]))
    np.testing.assert_array_equal(*read)
    assert np.linalg.norm(read[0][1] - read[0][0]) > 10


def test_a_failed_step_keeps_what_was_not_read_yet(client, make_world):
    """It is read with the next step that is solved."""
    world = make_world(1 / 240, GRAVITY)
    ball, knot, _ = hung(client, world, 1.0)
    world.step(240)
    before = p.getBaseVelocity(ball, client)[0][2]
    pull_down(client, ball)
    world.step()
    impulse, line = knot.force[2], world.tendons[0]
    line.set_force(1, [1e300, 0, 0])
    with pytest.raises(bt.StepFailed):
        world.apply()
    assert knot.force[2] == impulse
    line.set_force(1, [0, 0, 0])
    world.step()
    gained = p.getBaseVelocity(ball, client)[0][2] - before
    assert impulse + knot.force[2] - 100 - 2 * 9.81 == pytest.approx(240 * gained, abs=1e-3)


def test_a_hand_leads_a_step_that_is_solved_again_where_it_led_it(client, make_world):
    """Targets that are set since are those of the next step."""

    def run(moves):
        world = make_world(1 / 240, GRAVITY)
        ball, _, hand = hung(client, world, 1.0)
        world.step(240)
        pull_down(client, ball)
        world.step()
        if moves:
            hand.target = (0, 0, 0.21)
        world.apply()
        found = p.getBasePositionAndOrientation(ball, client)[0], world.tendons[0].positions[0, 2]
        p.resetSimulation(client)
        return found

    (still, _), (led, top) = run(False), run(True)
    np.testing.assert_allclose(led, still, rtol=0, atol=1e-12)  # the correction of the step before
    assert top == 0.21


@pytest.mark.parametrize("first, then", [(0.5, 50.0), (50.0, 0.5)])
def test_a_tensioner_holds_as_stiffly_as_its_tension_says(client, make_world, first, then):
    """The spring that goes with its tension is not taken back with a step.

    A particle that has come to the device is held within a thousandth of the radius at that tension.
    """
    world = make_world(1 / 240, GRAVITY)
    ball, _, _ = hung(client, world, 1.0)
    block = p.createMultiBody(0, physicsClientId=client)
    radius = 2e-3
    material = bt.Material(stiffness=1e4, density=1000.0, tension_only=True)
    points = [(0.1, 0, 0), (0.149, 0, 0)]
    graft = world.add_tendon(points, radius, material, 2, rest_length=0.06, collides=False)
    device = graft.pull(-1, first, block, -1, (0.15, 0, 0))
    graft.set_force(-1, [-0.2, 0, 0])  # what the device holds against
    graft.grip(0)
    world.step(240)
    pull_down(client, ball)
    world.step()
    device.force = then
    world.step()
    assert world.report.reasons.get("released", 0) > 0  # the step before was solved again
    world.step(240)
    [line] = [h for h in graft.holds if h.particle == 1]
    away = np.linalg.norm(graft.positions[-1] - (0.15, 0, 0))
    assert 0 < line.tension < then
    assert away == pytest.approx(1e-3 * radius * line.tension / then, rel=1e-3)


def test_a_motor_whose_aim_changes_is_not_taken_for_one_that_yields(client, make_world):
    """A trolley is led from speed to speed at 3 m/s^2; its motor can give five times what it needs."""
    world = make_world(1 / 240, GRAVITY)
    rail = links_on_joints(client, p.JOINT_PRISMATIC, [1.0], [(1, 0, 0)])
    weight = free_ball(client, 0.5, at=(0, 0, -0.2))
    rope = world.add_tendon([(0, 0, 0), (0, 0, -0.2)], 1e-3, bt.Material(stiffness=1e4, damping=5.0), 11)
    rope.attach(0, rail, 0)
    rope.attach(-1, weight)
    random = np.random.default_rng(0)
    speed, wanted, solved_again = 0.0, 0.0, 0
    for step in range(480):
        if step % 10 == 0:
            wanted = random.uniform(-0.3, 0.3)
        speed += np.clip(wanted - speed, -3 / 240, 3 / 240)
        p.setJointMotorControl2(rail, 0, p.VELOCITY_CONTROL, 0.0, float(speed), 40.0, physicsClientId=client)
        world.step()
        solved_again += world.report.reasons.get("released", 0)
        assert p.getJointState(rail, 0, client)[1] == pytest.approx(speed, abs=1e-3)
    assert solved_again <= 5


@pytest.mark.parametrize("load", [1.6, 2.0, 3.0])
def test_a_motor_holds_a_load_that_would_throw_its_joint_at_more_than_pybullet_allows(
    client, make_world, load
):
    """A light crank lifts a weight whose snatches give it 60 to 200 rad/s in a step, were there no motor.

    pybullet cuts off the rate before its motor acts, and reports the force for what is left of it.
    """
    dt, arm, speed = 1 / 130, 0.025, 0.7
    world = make_world(dt, GRAVITY)
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.008, height=0.03, physicsClientId=client)
    crank = links_on_joints(client, p.JOINT_REVOLUTE, [0.6], [(0, -1, 0)], shape)
    p.setJointMotorControl2(crank, 0, p.VELOCITY_CONTROL, 0.0, speed, 1e5, physicsClientId=client)
    cord = bt.Material(stiffness=1e6, exponent=2.0, toe_strain=0.03, tension_only=True, damping=200.0)
    tendon = world.add_tendon([(arm, 0, 0), (arm, 0, -0.2)], 0.002, cord, 16)
    pin = tendon.attach(0, crank, 0)
    tendon.set_point_mass(-1, load)
    for step in range(120):
        world.step()
        turned = p.getJointState(crank, 0, client)[0]
        assert turned == pytest.approx(speed * dt * (step + 1), abs=1e-6)
        if step > 1:
            away = np.linalg.norm(tendon.positions[0] - arm * np.array([np.cos(turned), 0, np.sin(turned)]))
            assert away < 1e-6
    assert -pin.force[2] == pytest.approx(load * 9.81, rel=0.01)
