"""Constraints that the user gives to pybullet are known before a step, between bodies and with the world."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED, body_energy, free_ball, links_on_joints
from random_robots import robot, turn

import bullet_tendon as bt

ROPE = bt.Material(stiffness=3e4, tension_only=True, damping=30.0)
LENGTH, RADIUS, G = 0.3, 0.002, 9.81
ENDS = np.array([0.0, 0.0, -0.02])  # of the upper body, where the lower one is joined
KINDS = pytest.mark.parametrize("kind", [p.JOINT_POINT2POINT, p.JOINT_FIXED])
STEPS = pytest.mark.parametrize("dt", [1 / 240, 1 / 1000])


def box(client, mass, at, half=0.02):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[half] * 3, physicsClientId=client)
    body = p.createMultiBody(mass, shape, basePosition=at, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    return body


def join(client, a, b, at_a, at_b, kind=p.JOINT_POINT2POINT, link=-1):
    """A constraint of body a with body b (-1: the world), at points of their inertial frames."""
    p.setCollisionFilterPair(a, b, -1, -1, 0, physicsClientId=client)
    return p.createConstraint(a, -1, b, link, kind, [0, 0, 1], list(at_a), list(at_b), physicsClientId=client)


def hung(world, client, masses, kind, aside=0.0):
    """A tendon from the origin, a body on it, and others joined below each other; the tendon, the bodies."""
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], RADIUS, ROPE, 12)
    t.grip(0)
    bodies = [
        box(client, mass, [aside * (k > 0), 0, -LENGTH - 0.02 - 0.04 * k]) for k, mass in enumerate(masses)
    ]
    t.attach(-1, bodies[0])
    for k in range(1, len(bodies)):
        join(client, *bodies[k - 1 : k + 1], ENDS + [aside * (k == 1), 0, 0], -ENDS, kind)
    return t, bodies


@STEPS
@KINDS
@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_a_light_body_joined_to_a_heavy_one_gains_no_energy(make_world, client, kind, dt, speed):
    """20 g between a tendon and 2 kg, swung round until it falls into the tendon."""
    world = make_world(dt, (0, 0, -G))
    t, bodies = hung(world, client, [0.02, 2.0], kind)
    for body in bodies:
        rate = speed / (LENGTH + 0.06)
        height = p.getBasePositionAndOrientation(body, client)[0][2]
        p.resetBaseVelocity(body, [-rate * height, 0, 0], [0, -rate, 0], client)
    given = body_energy(client, bodies, G)
    lowest = -sum(G * mass * (LENGTH + 0.1) for mass in (0.02, 2.0))
    for _ in range(int(2 / dt)):
        world.step()
        assert world.report.converged
        assert body_energy(client, bodies, G) + t.energy <= given + 0.02 * (given - lowest)


@STEPS
@KINDS
@pytest.mark.parametrize("masses", [[0.02, 2.0], [0.05, 5.0], [0.1] * 4, [0.01] * 3 + [1.0], [0.02] * 13])
def test_joined_bodies_hang_with_their_weight(make_world, client, kind, dt, masses):
    """Thirteen bodies have more rates than are solved for as one; what the others add is learned."""
    world = make_world(dt, (0, 0, -G))
    t, _ = hung(world, client, masses, kind)
    world.step(int(1 / dt))
    np.testing.assert_allclose(t.tension[-1], G * sum(masses), rtol=1e-3)


@STEPS
@KINDS
def test_what_is_joined_while_it_hangs_is_lifted(make_world, client, kind, dt):
    """A hook of 50 g takes a load of 5 kg from a floor: no step is planned without the load."""
    world = make_world(dt, (0, 0, -G))
    box(client, 0, [0, 0, -LENGTH - 0.08 - 1.0], 1.0)
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], RADIUS, ROPE, 12)
    hand = t.grip(0)
    hook, load = (
        box(client, 0.05, [0, 0, -LENGTH - 0.01], 0.01),
        box(client, 5.0, [0, 0, -LENGTH - 0.05], 0.03),
    )
    t.attach(-1, hook)
    world.step(int(0.3 / dt))
    join(client, hook, load, [0, 0, -0.01], [0, 0, 0.03], kind)
    for k in range(int(1.5 / dt)):
        hand.target = (0, 0, 0.2 * min(k * dt, 1.0))
        world.step()
        assert world.report.converged
    np.testing.assert_allclose(np.linalg.norm(hand.force), G * (5.05 + t.masses.sum()), rtol=1e-3)
    np.testing.assert_allclose(p.getBasePositionAndOrientation(load, client)[0][2], 0.15 - LENGTH, atol=1e-3)


@STEPS
@pytest.mark.parametrize("load", [15.0, 30.0, 200.0])
def test_a_constraint_gives_no_more_than_its_force(make_world, client, load, dt):
    """Exact: what it lacks accelerates body and tendon."""
    world, most = make_world(dt), 20.0
    body = box(client, 0.5, [0, 0, 0])
    pin = join(client, body, -1, [0, 0, 0], [0, 0, 0])
    p.changeConstraint(pin, maxForce=most, physicsClientId=client)
    t = world.add_tendon([[0.02, 0, 0], [0.22, 0, 0]], RADIUS, ROPE, 10)
    t.attach(0, body)
    t.set_force(-1, [load, 0, 0])
    world.step(int(0.2 / dt))
    velocity = p.getBaseVelocity(body, client)[0][0]
    exact = 0.2 * max(load - most, 0.0) / (0.5 + t.masses.sum())
    np.testing.assert_allclose(velocity, exact, rtol=5e-3, atol=1e-6)


@STEPS
@pytest.mark.parametrize("ratio", [-1.0, 1.0, -0.5, 2.0])
def test_geared_wheels_of_two_bodies_turn_each_other(make_world, client, ratio, dt):
    """Exact at first: weights on tendons at the rims of both turn one degree of freedom."""
    world = make_world(dt, (0, 0, -G))
    arms, weights, moment = (0.05, 0.03), (1.0, 0.5), 1e-3
    wheels, tendons = [], []
    for k, (arm, weight) in enumerate(zip(arms, weights, strict=True)):
        wheel = links_on_joints(client, p.JOINT_REVOLUTE, [0.2], [[0, -1, 0]])
        p.resetBasePositionAndOrientation(wheel, [0.3 * k, 0, 0], [0, 0, 0, 1], client)
        p.changeDynamics(wheel, 0, localInertiaDiagonal=[moment] * 3, physicsClientId=client)
        p.setJointMotorControl2(wheel, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        rim = np.array([0.3 * k + arm, 0, 0])
        t = world.add_tendon([rim, rim - [0, 0, 0.2]], 1e-3, ROPE, 8)
        t.attach(0, wheel, 0, [arm, 0, 0])
        t.attach(-1, free_ball(client, weight, rim - [0, 0, 0.2]))
        wheels.append(wheel)
        tendons.append(t)
    gear = p.createConstraint(
        wheels[0], 0, wheels[1], 0, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0], physicsClientId=client
    )
    p.changeConstraint(gear, gearRatio=ratio, maxForce=1e4, physicsClientId=client)
    time, along = 0.05, np.array([1.0, -1 / ratio])  # rates of both wheels, per rate of the first one
    turning = moment * along @ along + sum(
        w * (a * s) ** 2 for w, a, s in zip(weights, arms, along, strict=True)
    )
    torque = sum(-G * w * a * s for w, a, s in zip(weights, arms, along, strict=True))
    world.step(round(time / dt))
    rates = [p.getJointState(wheel, 0, client)[1] for wheel in wheels]
    assert world.report.converged
    np.testing.assert_allclose(rates[0] + ratio * rates[1], 0, atol=1e-6 * abs(rates[0]))
    np.testing.assert_allclose(np.abs(rates), np.abs(torque / turning * time * along), rtol=0.03)


@KINDS
@pytest.mark.parametrize("seed", range(12))
def test_what_joined_bodies_do_is_planned(make_world, client, kind, seed):
    """The rates at the end of a step are those that it was solved with: of random bodies and joints."""
    world = make_world(1 / 240, (0.5, -1.0, -G), tolerance=1e-12)
    rng = np.random.default_rng(seed)
    bodies = [robot(client, rng, floating) for floating in (True, seed % 2 == 0)]
    bodies.append(box(client, 0.7, rng.normal(size=3)))
    ends = [
        p.getLinkState(bodies[0], 0, physicsClientId=client)[0],
        p.getBasePositionAndOrientation(bodies[2], client)[0],
    ]
    ends = [np.add(end, 0.05 * rng.normal(size=3)) for end in ends]
    t = world.add_tendon(ends, RADIUS, ROPE, 8)
    t.attach(0, bodies[0], 0)
    t.attach(-1, bodies[2])
    places = [p.getBasePositionAndOrientation(b, client) for b in bodies]
    for a, b in ((0, 1), (1, 2)):
        point, axes = rng.normal(size=3), turn(rng)
        frames = [p.multiplyTransforms(*p.invertTransform(*places[k]), point.tolist(), axes) for k in (a, b)]
        (at_a, turn_a), (at_b, turn_b) = frames
        p.createConstraint(bodies[a], -1, bodies[b], -1, kind, [0, 0, 1], at_a, at_b, turn_a, turn_b, client)
    p.setPhysicsEngineParameter(numSolverIterations=2000, physicsClientId=client)
    p.setPhysicsEngineParameter(solverResidualThreshold=0, physicsClientId=client)
    for _ in range(5):
        world.apply()
        (joined,) = [body for body in world._bodies._generalized() if len(body.members) == 3]
        planned = np.array(world._core.rates_at_end(joined.slot))
        p.stepSimulation(client)
        reached = [
            velocity
            for b in bodies
            if p.getDynamicsInfo(b, -1, client)[0]
            for velocity in p.getBaseVelocity(b, client)
        ]
        reached = np.concatenate(reached)
        np.testing.assert_allclose(planned[: len(reached)], reached, rtol=0, atol=2e-3)


@pytest.mark.parametrize("before", [True, False])
@STEPS
def test_a_body_is_led_by_a_constraint(make_world, client, before, dt):
    """Its target moves before each step, or in the user's own loop after `apply`: the load is lifted."""
    world = make_world(dt, (0, 0, -G))
    hand, load = box(client, 0.1, [0, 0, 0]), box(client, 1.0, [0, 0, -0.24])
    led = join(client, hand, -1, [0, 0, 0], [0, 0, 0], p.JOINT_FIXED)
    t = world.add_tendon([[0, 0, -0.02], [0, 0, -0.22]], RADIUS, ROPE, 10)
    t.attach(0, hand)
    t.attach(-1, load)
    tensions = []
    for k in range(round(1.0 / dt)):
        place = [0, 0, 0.2 * min(k * dt, 0.5)]
        if not before:
            world.apply()
        p.changeConstraint(led, jointChildPivot=place, physicsClientId=client)
        if before:
            world.apply()
        p.stepSimulation(client)
        tensions.append(t.tension[-1])
        assert world.report.converged
    assert max(tensions) < 8 * G
    np.testing.assert_allclose(tensions[-1], G, rtol=1e-3)
    np.testing.assert_allclose(p.getBasePositionAndOrientation(load, client)[0][2], -0.14, atol=1e-3)


@STEPS
def test_a_body_on_a_moving_carrier_goes_with_it(make_world, client, dt):
    """A body without mass that moves by its velocity carries what is pinned to it, and a load on a tendon."""
    world = make_world(dt)
    carrier, body, load = (
        box(client, 0, [0, 0, 0.1]),
        box(client, 0.1, [0, 0, 0]),
        free_ball(client, 1.0, [0, 0, -0.2]),
    )
    join(client, carrier, body, [0, 0, -0.1], [0, 0, 0])
    t = world.add_tendon([[0, 0, -0.02], [0, 0, -0.2]], RADIUS, ROPE, 10)
    t.attach(0, body)
    t.attach(-1, load)
    for thing in (carrier, body, load):
        p.resetBaseVelocity(thing, [0.3, -0.2, 0.5], [0, 0, 0], client)
    t.set_positions(t.positions, np.tile([0.3, -0.2, 0.5], (t.particles, 1)))
    for _ in range(round(0.5 / dt)):
        world.step()
        assert t.tension.max() < 0.05
    np.testing.assert_allclose(p.getBaseVelocity(load, client)[0], [0.3, -0.2, 0.5], atol=1e-3)


@KINDS
def test_joined_bodies_that_are_parted_conserve_momentum(make_world, client, kind):
    """A spring of tendon between the first and a wall; the second is let go at speed."""
    world = make_world(1 / 240)
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], RADIUS, bt.Material(stiffness=200.0), 10)
    t.grip(0)
    a, b = free_ball(client, 0.3, [0, 0, -LENGTH]), free_ball(client, 0.7, [0, 0, -LENGTH - 0.05])
    t.attach(-1, a)
    pin = join(client, a, b, [0, 0, -0.05], [0, 0, 0], kind)
    for body in (a, b):
        p.resetBaseVelocity(body, [0, 0, -1.0], [0, 0, 0], client)
    world.step(12)
    p.removeConstraint(pin, client)
    before = p.getBaseVelocity(b, client)[0]
    given = body_energy(client, [a], G) + t.energy + 0.3 * G * LENGTH
    for _ in range(240):
        world.step()
        np.testing.assert_allclose(p.getBaseVelocity(b, client)[0], before, atol=1e-9)
        here = 0.5 * 0.3 * np.square(p.getBaseVelocity(a, client)[0]).sum()
        assert here + t.energy <= 1.01 * given + 0.1
    assert world.report.converged


@KINDS
def test_a_saved_state_of_joined_bodies_goes_on_with_the_same_bits(make_world, client, kind):
    world = make_world(1 / 240, (0, 0, -G))
    _, bodies = hung(world, client, [0.02, 0.3, 0.1], kind, aside=0.01)
    p.resetBaseVelocity(bodies[2], [1, 0.5, 0], physicsClientId=client)
    world.step(30)
    state, bullet = world.save_state(), p.saveState(client)
    world.step(30)
    after = world.state_hash()
    world.restore_state(state)
    p.restoreState(bullet, physicsClientId=client)
    world.step(30)
    assert world.state_hash() == after


def tray(world, client, mass, at=-0.3):
    """A tray on four tendons, whose upper face is 5 mm above its centre; the tray and the tendons."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.005], physicsClientId=client)
    body = p.createMultiBody(mass, shape, basePosition=[0, 0, at], physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    tendons = []
    for x, y in ((-0.09, -0.09), (-0.09, 0.09), (0.09, -0.09), (0.09, 0.09)):
        t = world.add_tendon([[1.2 * x, 1.2 * y, 0], [x, y, at + 0.005]], 1e-3, ROPE, 8)
        t.grip(0)
        t.attach(-1, body)
        tendons.append(t)
    return body, tendons


def carried(tendons):
    """Vertical force of tendons at their upper ends [N]."""
    ways = [t.positions[0] - t.positions[1] for t in tendons]
    return sum(t.tension[0] * way[2] / np.linalg.norm(way) for t, way in zip(tendons, ways, strict=True))


@STEPS
@pytest.mark.parametrize("drop", [0.0, 0.03])
@pytest.mark.parametrize(("mass", "load"), [(0.1, 0.1), (0.1, 2.0), (0.02, 2.0), (1.0, 0.05)])
def test_a_tray_carries_what_stands_on_it(make_world, client, mass, load, drop, dt):
    world = make_world(dt, (0, 0, -G))
    body, tendons = tray(world, client, mass)
    stands = box(client, load, [0, 0, -0.275 + drop])
    world.step(round(1.5 / dt))
    assert world.report.converged
    above = np.subtract(*(p.getBasePositionAndOrientation(b, client)[0] for b in (stands, body)))
    np.testing.assert_allclose(above, [0, 0, 0.025], atol=1e-3)
    own = sum(t.masses.sum() for t in tendons)
    np.testing.assert_allclose(carried(tendons), G * (mass + load + own), rtol=5e-3)


@STEPS
def test_a_tray_swings_with_what_stands_on_it(make_world, client, dt):
    """Friction keeps the box in its place; nothing gains energy."""
    world = make_world(dt, (0, 0, -G))
    body, tendons = tray(world, client, 0.1)
    bodies = body, box(client, 2.0, [0, 0, -0.275])
    for one in bodies:
        p.changeDynamics(one, -1, lateralFriction=1.0, physicsClientId=client)
        p.resetBaseVelocity(one, [0.5, 0, 0], [0, 0, 0], client)
    given = body_energy(client, bodies, G)
    for _ in range(round(2 / dt)):
        world.step()
        assert world.report.converged
        assert body_energy(client, bodies, G) + sum(t.energy for t in tendons) <= given + 0.01
    above = np.subtract(*(p.getBasePositionAndOrientation(b, client)[0] for b in bodies[::-1]))
    assert np.linalg.norm(above[:2]) < 0.005


@STEPS
def test_a_saved_state_of_bodies_that_touch_goes_on_with_the_same_bits(make_world, client, dt):
    """pybullet does not restore its contacts: the saved ones are used, after the load has been taken off."""
    world = make_world(dt, (0, 0, -G))
    body, _ = tray(world, client, 0.1)
    load = box(client, 2.0, [0, 0, -0.275])
    world.step(30)
    state, bullet = world.save_state(), p.saveState(client)
    world.step()
    after = world.state_hash()
    p.resetBasePositionAndOrientation(load, [0, 0, 1], [0, 0, 0, 1], client)
    world.step(5)
    world.restore_state(state)
    p.restoreState(bullet, physicsClientId=client)
    world.step()
    assert world.state_hash() == after


@pytest.mark.parametrize("restored", [False, True])
@pytest.mark.parametrize("ground", [False, True])
def test_what_stood_on_a_tray_is_removed(make_world, client, restored, ground):
    """pybullet lists contacts with it for a while, and so do saved states."""
    world = make_world(1 / 240, (0, 0, -G))
    body, tendons = tray(world, client, 0.1)
    load = box(client, 0 if ground else 2.0, [0, 0, -0.275])
    world.step(30)
    state = world.save_state()
    p.removeBody(load, client)
    if restored:
        world.restore_state(state)
    world.step(240)
    own = sum(t.masses.sum() for t in tendons)
    np.testing.assert_allclose(carried(tendons), G * (0.1 + own), rtol=1e-2)


@pytest.mark.parametrize("speed", [0.4, 0.49, 0.6])
def test_a_cord_that_goes_taut_pulls_at_what_constraints_join(make_world, client, speed):
    """What pybullet left of errors of two constraints seemed to hold the bodies, and they gained energy."""
    world = make_world(0.0038, (0, 0, -9.81))
    masses, heights = (1.702, 0.1445, 0.03252), (-0.4811, -0.5211, -0.5611)
    offsets = (0.002924, -0.0018722, -0.003196)
    shapes = [
        p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.015, 0.02], physicsClientId=client),
        p.createCollisionShape(p.GEOM_CYLINDER, radius=0.01, height=0.02, physicsClientId=client),
        p.createCollisionShape(p.GEOM_CAPSULE, radius=0.01, height=0.02, physicsClientId=client),
    ]
    bodies = []
    for mass, shape, x, z in zip(masses, shapes, offsets, heights, strict=True):
        bodies.append(p.createMultiBody(mass, shape, -1, (x, 0, z), physicsClientId=client))
        p.changeDynamics(bodies[-1], -1, **UNDAMPED, physicsClientId=client)
    between = zip(bodies, bodies[1:], np.diff(offsets) / 2, np.diff(heights) / 2, strict=False)
    for upper, lower, x, z in between:
        join(client, upper, lower, (x, 0, z), (-x, 0, -z), p.JOINT_FIXED)
    stiff = bt.Material(stiffness=64533.0, exponent=2.0, toe_strain=0.06, tension_only=True, damping=23.0)
    slack = bt.Material(stiffness=28308.0, exponent=1.147, density=1361.0)
    cords = []
    for top, body, law, particles in ((0.0, 0, stiff, 15), (0.14433, 2, slack, 3)):
        foot = [offsets[body], 0, heights[body]]
        cords.append(world.add_tendon([[top, 0, 0], foot], 5e-4, law, particles))
        cords[-1].grip(0), cords[-1].attach(-1, bodies[body])
    p.resetBaseVelocity(bodies[-1], [speed, 0, 0], [0, 0, 0], client)

    def energy():
        cord_energy = sum(cord.energy + G * cord.masses @ cord.positions[:, 2] for cord in cords)
        return cord_energy + body_energy(client, bodies, G)

    start = energy()
    for _ in range(120):
        world.step()
        assert world.report.converged
        assert energy() < start + 0.01
