"""Bodies on which forces act at their centre of mass alone: nodes between a tendon and a line."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt


def chain_of(client, inertia, offset=0.0):
    """A weight on a line below a node on a tendon of a hand: world, tendon, node, weight."""
    p.setGravity(0, 0, -9.81, client)
    p.setTimeStep(1 / 240, client)
    world = bt.TendonWorld(client)
    tendon = world.add_tendon([(0, 0, 0), (0, 0, -0.1)], 0.002, bt.Material(stiffness=1e4, damping=5.0), 8)
    tendon.grip(0)
    bodies = []
    for mass, height in ((0.002, -0.1), (0.5, -0.2)):
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.002, physicsClientId=client)
        body = p.createMultiBody(mass, shape, -1, (0, 0, height), physicsClientId=client)
        p.setCollisionFilterGroupMask(body, -1, 0, 0, physicsClientId=client)
        p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
        bodies.append(body)
    node, weight = bodies
    p.changeDynamics(node, -1, localInertiaDiagonal=[inertia] * 3, physicsClientId=client)
    tendon.attach(-1, node, -1, (0, 0, 0))
    line = bt.Material(stiffness=1e4, damping=5.0)
    world.add_ligament([(node, -1, (offset, 0, 0)), (weight, -1, (0, 0, 0))], line, 0.1)
    p.resetBaseVelocity(weight, (0.5, 0, 0), physicsClientId=client)
    return world, tendon, node, weight


def path_of(client, inertia, offset=0.0, steps=240):
    world, _, node, weight = chain_of(client, inertia, offset)
    places = []
    for _ in range(steps):
        world.step()
        assert world.report.converged
        places.append([p.getBasePositionAndOrientation(body, client)[0] for body in (node, weight)])
    return np.array(places)


@pytest.fixture
def clients():
    made = [p.connect(p.DIRECT) for _ in range(2)]
    yield made
    for client in made:
        p.disconnect(client)


def test_what_acts_at_the_centre_of_mass_does_not_feel_the_inertia(clients):
    light, heavy = (path_of(client, inertia) for client, inertia in zip(clients, (1e-9, 1e-5), strict=True))
    assert np.abs(light - heavy).max() < 1e-9
    assert np.ptp(light[:, 1, 0]) > 0.02  # it swings


def test_what_acts_beside_it_does(clients):
    light, heavy = (
        path_of(client, inertia, 0.002) for client, inertia in zip(clients, (1e-9, 1e-5), strict=True)
    )
    assert np.abs(light - heavy).max() > 1e-5


def test_the_node_is_where_a_point_mass_is_in_the_tendon(clients):
    """At rest: the tendon carries node and weight."""
    world, tendon, node, weight = chain_of(clients[0], 1e-7)
    p.resetBaseVelocity(weight, (0, 0, 0), physicsClientId=clients[0])
    world.step(960)
    tension = tendon.tension[-1]
    assert tension == pytest.approx(0.502 * 9.81, rel=1e-2)
    momentum = sum(
        m * np.array(p.getBaseVelocity(body, clients[0])[0]) for m, body in ((0.002, node), (0.5, weight))
    )
    assert np.abs(momentum).max() < 1e-3


def test_a_body_between_two_lines_without_a_tendon_keeps_its_freedom(clients):
    """Elements alone tell no directions: a body that only ligaments hold moves as before."""
    client = clients[0]
    p.setGravity(0, 0, -9.81, client)
    world = bt.TendonWorld(client)
    stand = p.createMultiBody(0, physicsClientId=client)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    ball = p.createMultiBody(1.0, shape, -1, (0, 0, -0.1), physicsClientId=client)
    law = bt.Material(stiffness=1e3, damping=10.0)
    for x in (-0.1, 0.1):
        world.add_ligament([(stand, -1, (x, 0, 0)), (ball, -1, (0, 0, 0))], law)
    world.step(960)
    assert [line.force > 1.0 for line in world.ligaments] == [True, True]
    (_, _, height), _ = p.getBasePositionAndOrientation(ball, client)
    # 2 T cos = m g, with the strain of the stretched line.
    length = np.hypot(0.1, height)
    tension = 1e3 * (length / np.hypot(0.1, 0.1) - 1)
    assert 2 * tension * -height / length == pytest.approx(9.81, rel=1e-3)
