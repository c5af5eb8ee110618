"""What contacts remember from one step to the next is theirs alone, however many there are."""

import numpy as np
import pybullet as p

import bullet_tendon as bt

RADIUS = 0.002
MATERIAL = bt.Material(stiffness=300.0, damping=0.3, friction=1.0)


def load_on_table(make_world, client, between):
    """Positions of a light and a heavy tendon on a table; `between` others were made between them."""
    world = make_world(gravity=(0, 0, -9.81), sleep=False)
    plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    table = p.createMultiBody(0, plane, physicsClientId=client)
    world.add_obstacle(table, friction=0.5)
    light = world.add_tendon([[0, 0, RADIUS], [0.02, 0, RADIUS]], RADIUS, MATERIAL)
    others = []
    for k in range(between):
        z = 1 + 0.1 * k
        others.append(world.add_tendon([[0, 0, z], [0.02, 0, z]], RADIUS, MATERIAL))
    heavy = world.add_tendon([[0, 1, RADIUS], [0.02, 1, RADIUS]], RADIUS, MATERIAL)
    heavy.set_point_mass(0, 0.5)
    for t in others:
        world.remove_tendon(t)
    light.set_force(0, (0.002, 0, 0))
    world.step(30)
    out = light.positions, heavy.positions
    p.removeBody(table, physicsClientId=client)
    return out


def test_tendons_4096_slots_apart_do_not_share_their_contacts_memory(make_world, client):
    alone = load_on_table(make_world, client, 0)
    apart = load_on_table(make_world, client, 4095)
    for one, other in zip(alone, apart, strict=True):
        np.testing.assert_array_equal(one, other)


def creep_in_a_second(make_world, client, disturb):
    """How far a tendon at rest along a slope goes in a second [m] while disturb(far) is called each step.

    `far` lies on the same slope.
    """
    world = make_world(1 / 240, (0, 0, -9.81), sleep=False)
    angle = np.arctan(0.45)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.3, 0.01], physicsClientId=client)
    turn = p.getQuaternionFromEuler([0, angle, 0])
    down, up = np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])
    world.add_obstacle(
        p.createMultiBody(0, shape, -1, -0.01 * up, turn, physicsClientId=client), friction=1.0
    )
    material = bt.Material(stiffness=1e3, damping=1.0, friction=0.5)
    ends = np.outer([-0.04, 0.04], down) + 0.004 * up
    lying = world.add_tendon(ends, 0.004, material, 11)
    far = world.add_tendon(ends + [0, 0.2, 0], 0.004, material, 11)
    world.step(480)
    x = lying.positions
    for _ in range(240):
        disturb(far)
        world.step()
    return np.abs(lying.positions - x).max()


def test_what_is_put_elsewhere_takes_no_memory_from_others(make_world, client):
    """One that rests on a slope does not creep while another, far away, is put anew each step."""
    assert creep_in_a_second(make_world, client, lambda far: None) <= 1e-11
    assert creep_in_a_second(make_world, client, lambda far: far.set_positions(far.positions)) <= 1e-11


def test_what_is_put_elsewhere_wakes_what_it_lay_on_and_nothing_else(make_world, client):
    world = make_world(1 / 240, (0, 0, -9.81))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.3, 0.3, 0.01], physicsClientId=client)
    table = p.createMultiBody(0, shape, basePosition=[0, 0, -0.01], physicsClientId=client)
    world.add_obstacle(table, friction=1.0)
    along, across = np.array([[-0.05, 0, RADIUS], [0.05, 0, RADIUS]]), [[0, -0.05, 0.006], [0, 0.05, 0.006]]
    below, above, far = (
        world.add_tendon(x, RADIUS, MATERIAL, 11) for x in (along, across, along + [0, 0.2, 0])
    )
    for _ in range(2400):
        world.step()
        if all(t.asleep for t in world.tendons):
            break
    assert all(t.asleep for t in world.tendons)
    resting = below.positions
    above.set_positions(above.positions + [0, 0, 0.02])
    assert not above.asleep and not below.asleep and far.asleep
    world.step(30)
    assert not np.array_equal(below.positions, resting)
    # Where it comes down on what sleeps, that wakes as well.
    above.set_positions(far.positions + [0, 0, 2 * RADIUS])
    assert far.asleep
    world.step()
    assert not far.asleep
