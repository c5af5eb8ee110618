"""What contacts do from one step to the next: depth, impact, sticking, and bodies that move beneath."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G, R, DT = 9.81, 0.003, 1 / 240
ROPE = bt.Material(stiffness=2e3, damping=1.0, friction=1.0)
STEPS = {"euler": {}, "bdf2": {"integrator": "bdf2"}}


def floor(client, kind, at=(0, 0, 0), turn=(0, 0, 0, 1), **body):
    """A static body whose upper face is at z = 0 in its own frame."""
    if kind == "plane":
        shape = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
        return p.createMultiBody(0, shape, -1, at, turn, physicsClientId=client)
    place = {"collisionFramePosition": [0, 0, -0.1], "physicsClientId": client}
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.2, 0.2, 0.1], **place)
    return p.createMultiBody(0, shape, -1, at, turn, physicsClientId=client)


@pytest.mark.parametrize("kind", ["plane", "box"])
@pytest.mark.parametrize("depth", [0.3, 0.9])
def test_distances_of_what_begins_deep_are_true(make_world, client, kind, depth):
    """The table tells what is left of the depth, measured from the positions that it tells."""
    world = make_world(DT)
    world.add_obstacle(floor(client, kind), friction=0.0)
    height = R * (1 - depth)
    t = world.add_tendon([[-0.02, 0, height], [0.02, 0, height]], R, ROPE, 9)
    deep = 0
    for _ in range(5):
        world.step()
        contacts = world.contacts
        heights = contacts["position"][:, 2]
        np.testing.assert_allclose(heights, np.interp(contacts["position"][:, 0], *t.positions.T[[0, 2]]))
        np.testing.assert_allclose(contacts["distance"], heights - R, atol=1e-9 * R)
        deep += (contacts["distance"] < -0.1 * R).any()
    assert deep == (depth > 0.6)
    assert t.positions[:, 2].min() >= 0.999 * R


@pytest.mark.parametrize("options", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("depth", [1.5, 4.0])
def test_what_begins_deep_is_not_thrown_out(make_world, client, depth, options):
    """What was put beneath a plane comes out by half a radius a step at most, and rests there."""
    world = make_world(DT, **options)
    world.add_obstacle(floor(client, "plane"), friction=0.0)
    height = R * (1 - depth)
    t = world.add_tendon([[-0.02, 0, height], [0.02, 0, height]], R, ROPE, 9)
    for _ in range(int(2 * depth) + 8):
        before = t.positions
        world.step()
        assert np.abs(t.positions - before).max() <= 0.501 * R
    assert t.positions[:, 2].min() >= 0.999 * R
    assert t.positions[:, 2].max() <= 1.1 * R and np.abs(t.velocities).max() <= 1e-3 * R / DT


@pytest.mark.parametrize("kind", ["plane", "box"])
@pytest.mark.parametrize("speed", [0.05, 0.4, 3.0])
def test_an_impact_is_inelastic(make_world, client, kind, speed):
    """What strikes a face stops there: the force of the blow does not act again in the steps after it."""
    world = make_world(DT)
    world.add_obstacle(floor(client, kind), friction=0.0)
    t = world.add_tendon([[-0.02, 0, 2.3 * R], [0.02, 0, 2.3 * R]], R, ROPE, 9)
    t.set_positions(t.positions, np.tile([0, 0, -speed], (9, 1)))
    for _ in range(5 + int(1.3 * R / (speed * DT))):
        world.step()
        assert t.velocities[:, 2].max() <= 1e-3 * (speed + R / DT)
    assert np.abs(t.velocities).max() <= 1e-3 * (speed + R / DT)


@pytest.mark.parametrize("options", STEPS.values(), ids=STEPS)
@pytest.mark.parametrize("after", [1 / 2000, 1 / 480, 1 / 239, 1 / 120, 1 / 60])
def test_what_sticks_does_not_slip_as_the_step_changes(make_world, client, after, options):
    """A tendon lies on a slope of 0.3 with mu = 0.5; with another time step it lies there still."""
    world = make_world(DT, (0, 0, -G), sleep=False, **options)
    angle = np.arctan(0.3)
    turn = p.getQuaternionFromEuler([0, angle, 0])
    body = floor(client, "plane", turn=turn)
    world.add_obstacle(body, friction=0.5)
    down, up = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])
    t = world.add_tendon([R * up, R * up + 0.04 * down], R, ROPE, 9)
    world.step(300)
    lies, weight = t.positions, t.masses.sum() * G
    p.setTimeStep(after, client)
    for _ in range(5):
        world.step()
        np.testing.assert_allclose(world.wrench(body)[:3], [0, 0, -weight], atol=1e-5 * weight)
        assert np.abs(t.positions - lies).max() <= 1e-6 * R


@pytest.mark.parametrize("kind", ["plane", "box"])
@pytest.mark.parametrize("moves", [(0.5, 0, 0), (0.1, -0.2, 0)])
def test_a_belt_drags_what_lies_on_it(make_world, client, kind, moves):
    """A surface that moves within itself: mu m g, and nothing once the tendon is as fast."""
    mu, speed = 0.4, np.linalg.norm(moves)
    world = make_world(DT, (0, 0, -G), sleep=False)
    belt = floor(client, kind)
    world.add_obstacle(belt, friction=mu)
    t = world.add_tendon([[-0.02, 0, R], [0.02, 0, R]], R, ROPE, 9)
    world.step(5)
    weight, direction = t.masses.sum() * G, np.array(moves) / speed
    slips = int(speed / (mu * G * DT))  # steps
    for k in range(1, slips + 10):
        p.resetBaseVelocity(belt, moves, [0, 0, 0], client)
        world.step()
        expected = min(mu * G * DT * k, speed)
        np.testing.assert_allclose(t.velocities, np.tile(expected * direction, (9, 1)), atol=1e-3 * speed)
        if k <= slips:
            np.testing.assert_allclose(world.wrench(belt)[:2], -mu * weight * direction[:2], rtol=1e-4)
    assert np.abs(world.wrench(belt)[:2]).max() <= 1e-3 * mu * weight


@pytest.mark.parametrize("kind", ["sphere", "edge"])
def test_a_small_body_is_felt_between_two_particles(make_world, client, kind):
    """A coarse tendon is drawn over what is smaller than its segments: it bears on their insides."""
    size = 0.004
    world = make_world(DT, (0, 0, -G))
    if kind == "sphere":
        top, turn = size, (0, 0, 0, 1)
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=size, physicsClientId=client)
    else:
        top, turn = size * np.sqrt(2), p.getQuaternionFromEuler([0, np.pi / 4, 0])
        half = [size, 0.05, size]
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    body = p.createMultiBody(0, shape, -1, (0, 0, 0), turn, physicsClientId=client)
    world.add_obstacle(body, friction=0.0)
    t = world.add_tendon([[-0.15, 0, top + 1.5 * R], [0.17, 0, top + 1.5 * R]], R, ROPE, 9)
    hands = [t.grip(0), t.grip(-1)]
    for _ in range(150):
        for hand in hands:
            hand.target = hand.target - [0, 0, 2e-4]
        world.step()
        x = t.positions
        k = np.searchsorted(x[:, 0], 0.0)
        along = (x[k] - x[k - 1]) / np.linalg.norm(x[k] - x[k - 1])
        centre, rounding = (np.zeros(3), size) if kind == "sphere" else (np.array([0, 0, top]), 0.0)
        assert np.linalg.norm(np.cross(along, x[k] - centre)) >= rounding + 0.99 * R
    pressed = world.contacts[world.contacts["normal_force"] > 0]
    away = np.linalg.norm(pressed["position"][:, None] - t.positions, axis=2).min(1)
    assert len(pressed) and away.min() > 1e-3
    ends = sum(hand.force for hand in hands)
    assert ends[2] > 1.0  # the hands are drawn up: it is tight
    np.testing.assert_allclose((ends + world.wrench(body)[:3])[2], -t.masses.sum() * G, rtol=0.05)
