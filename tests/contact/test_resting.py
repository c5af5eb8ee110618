"""Bodies at rest under tendons: contacts with what does not move hold them."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED

import bullet_tendon as bt

BLOCK = [0.05] * 3  # half lengths [m]


@pytest.fixture
def draped(make_world, client):
    """A tendon over a block of 0.1 kg that it presses at a table: world, tendon, table, block."""
    slab = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 0.1], physicsClientId=client)
    table = p.createMultiBody(0, slab, basePosition=[0, 0, -0.1], physicsClientId=client)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=BLOCK, physicsClientId=client)
    block = p.createMultiBody(0.1, box, basePosition=[0, 0, 0.05], physicsClientId=client)
    p.changeDynamics(block, -1, **UNDAMPED, physicsClientId=client)
    world = make_world(1 / 240, (0, 0, -9.81))
    world.add_obstacle(block)
    cord = bt.Material(stiffness=3e4, damping=1.0, friction=0.3)
    t = world.add_tendon([[-0.15, 0, 0.09], [0, 0, 0.105], [0.15, 0, 0.09]], 0.002, cord, 30)
    hands = t.grip(0), t.grip(-1)
    for _ in range(20):
        for hand in hands:
            hand.target = hand.target - [0, 0, 0.0005]
        world.step()
    world.step(200)
    return world, t, table, block


def test_what_rests_under_a_tendon_stays_and_carries_it(draped):
    world, t, _, block = draped
    before = t.positions
    world.step(100)
    assert world.wrench(block, -1)[2] < -50
    assert np.abs(t.positions - before).max() < 1e-4


def test_what_rests_is_free_once_its_table_is_gone(draped, client):
    """A step that took it for held would throw it down by what the tendon presses over its mass."""
    world, t, table, block = draped
    stored = t.energy
    p.removeBody(table, client)
    most = 0.0
    for k in range(30):
        world.step()
        speed = np.linalg.norm(p.getBaseVelocity(block, client)[0])
        most = max(most, 0.05 * max(0.0, speed - 9.81 * (k + 1) / 240) ** 2)
    assert most <= 1.05 * stored


@pytest.mark.parametrize("solver", ["banded", "pcg"])
def test_table_that_gets_mass_is_no_table(draped, client, solver):
    """The tendon pushes it away together with the block."""
    world, t, table, block = draped
    world.options = bt.SolverOptions(linear_solver=solver)
    world.step(5)
    pressed, high = world.wrench(block, -1)[2], p.getBasePositionAndOrientation(block, client)[0][2]
    p.changeDynamics(table, -1, mass=1.0, physicsClientId=client)
    world.step(10)
    assert world.report.converged
    assert p.getBasePositionAndOrientation(block, client)[0][2] < high - 1e-3
    assert abs(world.wrench(block, -1)[2]) < 0.5 * abs(pressed)


def test_what_rests_goes_on_with_the_same_bits(draped, client):
    """What its contacts tell, and how they pushed, is restored with it."""
    world, t, *_ = draped
    state, bullet = world.save_state(), p.saveState(client)
    hashes = []
    for _ in range(2):
        world.restore_state(state)
        p.restoreState(bullet, physicsClientId=client)
        for k in range(30):
            t.holds[0].target = t.holds[0].target + [0, 0, 1e-5 * (-1) ** (k // 5)]
            world.step()
        hashes.append(world.state_hash())
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize("shape", [p.GEOM_BOX, p.GEOM_SPHERE])
def test_unknowns_pulled_at_here_and_there_are_solved_for_as_by_conjugate_gradients(
    make_world, client, shape
):
    """A body falls on a tendon that is hung up below: it touches edges far apart, or all along."""
    found = []
    for solver in ("banded", "pcg"):
        size = {"halfExtents": BLOCK} if shape == p.GEOM_BOX else {"radius": 0.05}
        collision = p.createCollisionShape(shape, **size, physicsClientId=client)
        body = p.createMultiBody(0.2, collision, basePosition=[0, 0.003, 0], physicsClientId=client)
        world = make_world(1 / 240, (0, 0, -9.81))
        world.options = bt.SolverOptions(linear_solver=solver)
        world.add_obstacle(body)
        cord = bt.Material(stiffness=1e4, damping=1.0, shear_stiffness=5e2, friction=0.2)
        t = world.add_tendon([[-0.15, 0, -0.05], [0, 0, -0.056], [0.15, 0, -0.05]], 0.002, cord, 41)
        t.grip(0), t.grip(-1)
        world.step(40)
        assert len(world.contacts) > 1
        found.append(t.positions)
        p.removeBody(body, client)
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def bundle(world, client, solver):
    """Three bodies under two tendons each, joined by others: eighteen unknowns of one solution."""
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.04, 0.03], physicsClientId=client)
    world.options = bt.SolverOptions(linear_solver=solver)
    cord = bt.Material(stiffness=1e4, damping=1.0)
    bodies = []
    for k in range(3):
        x = 0.3 * k
        bodies.append(p.createMultiBody(0.5 + k, box, basePosition=[x, 0, 0], physicsClientId=client))
        for side in (-1, 1):
            ends = [[x, 0.02 * side, 0.3], [x + 0.03, 0.04 * side, 0.03]]
            t = world.add_tendon(ends, 0.002, cord, 12)
            t.grip(0), t.attach(-1, bodies[k])
        if k:
            t = world.add_tendon([[x - 0.25, 0, 0], [x - 0.05, 0, 0]], 0.002, cord, 9)
            t.attach(0, bodies[k - 1]), t.attach(-1, bodies[k])
    world.step(60)
    return np.concatenate([t.positions for t in world.tendons]), bodies


def test_many_unknowns_are_solved_for_as_by_conjugate_gradients(make_world, client):
    direct, bodies = bundle(make_world(1 / 240, (0, 0, -9.81)), client, "banded")
    for body in bodies:
        p.removeBody(body, client)
    assert direct == pytest.approx(bundle(make_world(1 / 240, (0, 0, -9.81)), client, "pcg")[0], abs=1e-9)


@pytest.mark.parametrize(
    ("mass", "rate", "share"), [(20.0, 240, 0.0), (1.0, 240, 0.5), (20.0, 960, 0.5), (1.0, 960, 0.0)]
)
def test_a_body_that_lies_on_slack_strands_comes_to_rest(make_world, client, mass, rate, share):
    """The strands are lighter by a factor of 1e4; share: of the load at which they slide that pulls them."""
    radius, friction = 2e-3, 0.4
    world = make_world(1 / rate, (0, 0, -9.81))
    bodies = []
    for height, weight, half in ((-0.02, 0, (0.3, 0.3, 0.02)), (2 * radius + 0.02, mass, (0.03, 0.03, 0.02))):
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
        bodies.append(p.createMultiBody(weight, shape, -1, (0, 0, height), physicsClientId=client))
        world.add_obstacle(bodies[-1], friction=1.0)
    p.setCollisionFilterPair(*bodies, -1, -1, 0, client)
    p.changeDynamics(bodies[1], -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    material = bt.Material(stiffness=2e3, damping=2, density=1000, friction=friction)
    lines = [[(-0.08, y, radius), (0.08, y, radius)] for y in (-0.02, 0.02)]
    strands = [world.add_tendon(line, radius, material, 33) for line in lines]
    most = friction * (mass / 2 + strands[0].masses.sum()) * 9.81
    for k in range(2 * rate):
        for strand in strands:
            strand.set_force(-1, (min(1.0, 4 * k / rate) * share * most, 0, 0))
        world.step()
    velocity, spin = p.getBaseVelocity(bodies[1], client)
    assert np.abs(velocity).max() < 1e-6 and np.abs(spin).max() < 1e-5
    height = p.getBasePositionAndOrientation(bodies[1], client)[0][2]
    assert height == pytest.approx(2 * radius + 0.02, abs=5e-4 * radius)
    assert world.wrench(bodies[1])[2] == pytest.approx(mass * 9.81, rel=1e-6)
