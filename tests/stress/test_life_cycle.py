"""pybullet's life under the plug-in: bodies come and go, ids are used again, clients close."""

import numpy as np
import pybullet as p
import pytest
from brute_force import torus
from threads import at_once

import bullet_tendon as bt

MATERIAL = bt.Material(stiffness=1e3, damping=1.0)


def ball(client, mass=1.0, position=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=client)
    return p.createMultiBody(mass, shape, basePosition=position, physicsClientId=client)


def test_a_reused_id_gets_no_force_meant_for_another_body(client, make_world):
    world = make_world()
    first = ball(client)
    t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.004, MATERIAL, 6)
    hold = t.attach(0, first)
    t.grip(-1, target=(0.3, 0, 0))
    world.step(3)
    p.removeBody(first, client)
    second = ball(client)
    assert second == first
    before = world.state_hash()
    with pytest.raises(bt.UnknownId, match="removed"):
        world.step()
    assert world.state_hash() == before
    assert p.getBaseVelocity(second, client) == ((0.0,) * 3, (0.0,) * 3)
    assert not world.wrench(second).any()
    hold.release()
    world.step(3)
    assert p.getBaseVelocity(second, client) == ((0.0,) * 3, (0.0,) * 3)
    t.attach(0, second)
    world.step(3)
    assert np.any(p.getBaseVelocity(second, client)[0])


@pytest.mark.parametrize("reused", [False, True])
def test_parts_of_a_removed_body_are_nowhere(client, make_world, reused):
    """Also where another body has its id."""
    world = make_world()
    first, other = ball(client), ball(client)
    tendon = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.004, MATERIAL, 6)
    bore = world.add_tunnel(first, -1, (0, 0, 0), (0.1, 0, 0), 0.01)
    line = world.add_ligament([(first, -1, (0, 0, 0)), (other, -1, (0.1, 0, 0))], MATERIAL)
    p.removeBody(first, client)
    if reused:
        assert ball(client) == first
    for call in (
        lambda: bore.ends,
        lambda: line.points,
        lambda: line.line,
        lambda: line.length,
        lambda: tendon.fix(bore, "screw", stiffness=1e5, slip_load=1e3),
    ):
        with pytest.raises(bt.UnknownId, match="bodyUniqueId = 0"):
            call()


def test_after_a_reset_obstacles_and_tunnels_of_old_bodies_are_noticed(client, make_world):
    world = make_world()
    world.add_obstacle(ball(client, 0.0))
    t = world.add_tendon([[0, 0, 0.1], [0.2, 0, 0.1]], 0.004, MATERIAL, 6)
    world.step()
    p.resetSimulation(physicsClientId=client)
    other = ball(client, 0.0, (5, 0, 0))
    with pytest.raises(bt.UnknownId):
        world.step()
    world.add_obstacle(other)  # takes the place of the body that had its id
    world.step()
    assert np.isfinite(t.positions).all()


def test_a_closed_client_is_refused(client):
    other = p.connect(p.DIRECT)
    world = bt.TendonWorld(other)
    t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.004, MATERIAL, 6)
    p.disconnect(other)
    for call in (world.step, world.apply, world.relax, lambda: t.attach(0, 0), lambda: world.add_obstacle(0)):
        with pytest.raises(bt.UnknownId, match="connected"):
            call()
    assert np.isfinite(t.positions).all()


def test_a_teleported_body_gets_no_spurious_velocity(client, make_world):
    """Bone and tendon are put elsewhere together: both stay at rest. An obstacle alone: it stays at rest."""
    world = make_world()
    bone, free = ball(client, 0.0), ball(client, 1.0, (0.2, 0, 0))
    world.add_obstacle(bone)
    t = world.add_tendon([[0, 0, 0.0245], [0.2, 0, 0]], 0.004, MATERIAL, 6)
    t.attach(-1, free)
    world.step(5)
    shift = np.array([1.0, 2.0, 3.0])
    for body in (bone, free):
        where, turn = p.getBasePositionAndOrientation(body, client)
        p.resetBasePositionAndOrientation(body, shift + where, turn, client)
    t.set_positions(t.positions + shift, t.velocities)
    world.step(20)
    assert world.report.converged
    assert np.abs(t.velocities).max() < 1e-6
    assert np.abs(p.getBaseVelocity(free, client)).max() < 1e-6
    p.resetBasePositionAndOrientation(bone, (9, 9, 9), (0, 0, 0, 1), client)
    world.step(20)
    assert np.abs(t.velocities).max() < 1e-6


def test_gravity_and_time_step_may_change_and_nonsense_is_refused(client, make_world):
    world = make_world(gravity=(0, 0, -9.81), integrator="bdf2")
    t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.004, MATERIAL, 6)
    t.grip(0)
    for dt, g in ((1 / 240, -9.81), (1 / 1000, 9.81), (0.4, -9.81), (1 / 240, 0.0)):
        p.setTimeStep(dt, client)
        p.setGravity(0, 0, g, client)
        world.step(20)
        assert np.isfinite(t.positions).all()
        assert t.length < 0.5
    before = world.state_hash()
    p.setGravity(0, 0, float("nan"), client)
    with pytest.raises(bt.InvalidValue, match="gravity"):
        world.step()
    assert world.state_hash() == before


def torus_on_a_shelf(client, world, scale):
    """A static ring of triangles, of which distances come from FCL; the number of queries is listed."""
    vertices, triangles = torus(0.1 * scale, 0.03 * scale)
    indices = triangles.ravel().tolist()
    shape = p.createCollisionShape(p.GEOM_MESH, vertices=vertices, indices=indices, physicsClientId=client)
    ring = p.createMultiBody(0, shape, basePosition=(0.1, 0, -0.05), physicsClientId=client)
    world.add_obstacle(ring, meshes=[(vertices, triangles)])


def run_on_a_mesh(steps, scale):
    """The state's hash after some steps of a tendon that falls on a ring, and what was inside on the way."""
    client = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    world = bt.TendonWorld(client)
    torus_on_a_shelf(client, world, scale)
    t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.004, MATERIAL, 40)
    t.grip(0)
    lying = world.add_tendon([[0, 0.01, -0.05], [0.2, 0.01, -0.05]], 0.004, MATERIAL, 40)  # partly inside
    lying.grip(0)
    queried, inside = 0, []
    for _ in range(steps):
        world.step()
        queried += world.report.counts["pairs_queried"]
        inside += [world.penetrations().tobytes() for _ in range(3)]
    found = world.state_hash(), inside
    p.disconnect(client)
    assert queried > 10
    return found


def test_one_world_a_thread():
    """Two worlds stepped at the same time end where each ends alone; both measure meshes, by FCL."""
    cases = (15, 1.0), (20, 1.2)
    found = [None] * 2

    def run(k):
        found[k] = run_on_a_mesh(*cases[k])

    at_once(run, 2)
    assert found == [run_on_a_mesh(*case) for case in cases]


OFTEN = ["load", "load", "remove", "attach", "attach", "obstacle", "tendon", "release"]
SELDOM = ["step", "step", "step", "substeps", "save", "restore", "reset", "drop", "reconnect", "fail"]


class Life:
    """Random operations on two clients, with a list of what every tendon was attached to."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.clients = [p.connect(p.DIRECT) for _ in range(2)]
        self.worlds = [bt.TendonWorld(c) for c in self.clients]
        self.saved = [[], []]
        self.holds = [[], []]  # (attachment, body object), the body known by its own user data
        self.bodies = [{}, {}]  # id: (mark, how often this body may have been pushed)
        self.count = self.failed = 0

    def close(self):
        for c in self.clients:
            p.disconnect(c)

    def act(self):
        k = int(self.rng.integers(2))
        name = self.rng.choice(OFTEN)
        if self.rng.random() < 0.4:
            name = self.rng.choice(SELDOM)
        if name in ("reset", "reconnect") and self.rng.random() > 0.1:
            name = "step"
        getattr(self, name)(k, self.worlds[k], self.clients[k])

    def load(self, k, world, client):
        if len(self.bodies[k]) < 8:
            self.count += 1
            body = ball(client, float(self.rng.choice([0.0, 1.0])), tuple(self.rng.uniform(-5, 5, 3) * 100))
            self.bodies[k][body] = self.count

    def remove(self, k, world, client):
        if self.bodies[k]:
            body = int(self.rng.choice(list(self.bodies[k])))
            del self.bodies[k][body]
            p.removeBody(body, client)

    def tendon(self, k, world, client):
        if len(world.tendons) < 4:
            x = self.rng.uniform(-1, 1, (2, 3))
            world.add_tendon(x, 0.004, MATERIAL, 5).grip(0)

    def drop(self, k, world, client):
        if world.tendons:
            world.remove_tendon(world.tendons[0])

    def attach(self, k, world, client):
        body = int(self.rng.integers(0, 9))
        if not world.tendons:
            return
        t = world.tendons[int(self.rng.integers(len(world.tendons)))]
        try:
            hold = t.attach(-1, body)
        except bt.UnknownId:
            assert body not in self.bodies[k]
        except bt.InvalidValue:
            assert any(h.particle == 4 for h in t.holds)
        else:
            self.holds[k].append((hold, body, self.bodies[k][body]))

    def obstacle(self, k, world, client):
        body = int(self.rng.integers(0, 9))
        try:
            world.add_obstacle(body)
        except bt.UnknownId:
            assert body not in self.bodies[k]

    def release(self, k, world, client):
        for hold, _, _ in self.holds[k]:
            hold.release()

    def step(self, k, world, client):
        stale = [h for h, body, mark in self.holds[k] if not h.released and self.bodies[k].get(body) != mark]
        before = world.state_hash()
        try:
            world.step()
        except bt.UnknownId:
            assert world.state_hash() == before
            for hold in stale:
                hold.release()
            for key in world._obstacles.listing():
                world.remove_obstacle(key[0])
        except bt.StepFailed:
            assert world.state_hash() == before
        else:
            assert not stale
            self.nobody_else_was_pushed(k, world, client)

    def fail(self, k, world, client):
        """A step under a force that no step can be solved with: tendons stay as they were."""
        if not world.tendons:
            return
        t = world.tendons[int(self.rng.integers(len(world.tendons)))]
        t.set_force(2, (1e308, 0, 1e308))
        before = [(u.positions, u.velocities, u.tension) for u in world.tendons]
        try:
            world.step()
        except bt.UnknownId:
            pass
        except bt.StepFailed:
            self.failed += 1
        else:
            raise AssertionError("a step was solved")
        for u, was in zip(world.tendons, before, strict=True):
            for now, then in zip((u.positions, u.velocities, u.tension), was, strict=True):
                np.testing.assert_array_equal(now, then)
        t.set_force(2, (0, 0, 0))

    def nobody_else_was_pushed(self, k, world, client):
        held = {body for h, body, mark in self.holds[k] if not h.released}
        for body in set(self.bodies[k]) - held:
            assert not world.wrench(body).any()
        self.holds[k] = [row for row in self.holds[k] if not row[0].released]

    def substeps(self, k, world, client):
        p.setPhysicsEngineParameter(numSubSteps=int(self.rng.integers(0, 4)), physicsClientId=client)

    def save(self, k, world, client):
        self.saved[k] = [*self.saved[k][-3:], (world.save_state(), list(self.holds[k]))]

    def restore(self, k, world, client):
        if self.saved[k]:
            state, holds = self.saved[k][int(self.rng.integers(len(self.saved[k])))]
            try:
                world.restore_state(state)
            except bt.StateMismatch:
                return
            self.holds[k] = holds + [h for h in self.holds[k] if h not in holds]

    def reset(self, k, world, client):
        p.resetSimulation(physicsClientId=client)
        self.bodies[k] = {}

    def reconnect(self, k, world, client):
        p.disconnect(client)
        self.clients[k] = p.connect(p.DIRECT)
        if self.clients[k] != client or world._links_in_use():
            with pytest.raises(bt.UnknownId):
                world.step()
        self.worlds[k] = bt.TendonWorld(self.clients[k])
        self.bodies[k], self.saved[k], self.holds[k] = {}, [], []


@pytest.mark.parametrize("operations", [400, pytest.param(10_000, marks=pytest.mark.slow)])
def test_random_operations(operations):
    life = Life(seed=5)
    for _ in range(operations):
        life.act()
    life.close()
    assert life.failed > 0
