"""Tendons at rest sleep: they cost nothing, change nothing, and wake for whatever they can feel."""

import dataclasses

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

R = 0.002
MATERIAL = bt.Material(stiffness=500.0, damping=0.5, friction=0.7)
REST = 400  # steps


def static(client, shape, at, turn=(0, 0, 0, 1), mass=0.0):
    return p.createMultiBody(mass, shape, basePosition=at, baseOrientation=turn, physicsClientId=client)


@pytest.fixture
def scene(make_world, client):
    """scene(sleep=): a tendon held over a bar, two on a plane across each other, and one far off."""

    def build(**options):
        p.resetSimulation(physicsClientId=client)
        world = make_world(1 / 240, (0, 0, -9.81), **options)
        world.add_obstacle(
            static(client, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), (0, 0, 0))
        )
        bar = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.1, 0.02], physicsClientId=client)
        world.bar = static(client, bar, (0, 0, 0.1))
        world.add_obstacle(world.bar)
        line = [[-0.08, 0, 0.09], [-0.023, 0, 0.123], [0.023, 0, 0.123], [0.08, 0, 0.09]]
        over = world.add_tendon(line, R, MATERIAL, 24, name="over")
        over.grip(0), over.grip(-1)
        for name, z, d in (("under", R, (0.05, 0, 0)), ("across", 3 * R, (0, 0.05, 0))):
            middle = np.array([0.3, 0, z])
            world.add_tendon([middle - d, middle + d], R, MATERIAL, 16, name=name)
        hanging = world.add_tendon([[0, 1, 1], [0, 1, 0.9]], R, MATERIAL, 8, name="hanging")
        hanging.attach(0, world.bar)
        return world

    return build


def by_name(world):
    return {t.name: t for t in world.tendons}


def asleep(world):
    return sum(t.asleep for t in world.tendons)


def settle(world, integrator):
    """All at rest, which takes long without the damping of implicit Euler."""
    world.step(REST)
    world.options = dataclasses.replace(world.options, integrator=integrator)
    world.step(REST)


def test_what_rests_sleeps_and_stays_as_it_was(scene):
    world = scene()
    world.step(REST)
    counts = world.report.counts
    assert (counts["tendons_asleep"], counts["contacts"], counts["islands"], world.report.iterations) == (
        4,
        0,
        0,
        0,
    )
    at_rest = [(t.positions, t.tension, [h.force for h in t.holds]) for t in world.tendons]
    contacts, wrench = world.contacts, world.wrench(world.bar)
    assert contacts["normal_force"].sum() > 0 and np.abs(wrench).max() > 0
    world.step(50)
    for t, (x, tension, forces) in zip(world.tendons, at_rest, strict=True):
        np.testing.assert_array_equal(t.positions, x)
        np.testing.assert_array_equal(t.velocities, 0)
        np.testing.assert_array_equal(t.tension, tension)
        np.testing.assert_array_equal([h.force for h in t.holds], forces)
    np.testing.assert_array_equal(world.contacts, contacts)
    np.testing.assert_array_equal(world.wrench(world.bar), wrench)


def test_it_is_where_it_would_be_awake(scene):
    ends = []
    for sleep in (True, False):
        world = scene(sleep=sleep)
        world.step(3 * REST)
        assert (asleep(world) > 0) == sleep
        ends.append([t.positions for t in world.tendons])
        load = world.contacts["normal_force"] * world.contacts["normal"][:, 2]
        weight = sum(t.masses.sum() for n, t in by_name(world).items() if n in ("under", "across")) * 9.81
        on_plane = np.isin(world.contacts["tendon"], ["under", "across"]) & (
            world.contacts["bodyUniqueId"] >= 0
        )
        assert load[on_plane].sum() == pytest.approx(weight, rel=1e-4)
    for a, b in zip(*ends, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3 * R)


def ball(world, client, at, mass, velocity):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(mass, shape, basePosition=at, physicsClientId=client)
    p.resetBaseVelocity(body, velocity, physicsClientId=client)
    world.add_obstacle(body)


def falling_tendon(world, client):
    world.add_tendon([[0.28, -0.02, 0.06], [0.33, 0.03, 0.06]], R, MATERIAL, 16)


def move_bar(world, client):
    p.resetBasePositionAndOrientation(world.bar, (0, 0, 0.11), (0, 0, 0, 1), physicsClientId=client)


def lead_bar(world, client):
    p.resetBaseVelocity(world.bar, (0, 0, 0.05), physicsClientId=client)


def remove_bar(world, client):
    world.tendons[3].holds[0].release()
    world.remove_obstacle(world.bar)


def change_options(world, client):
    world.options = bt.SolverOptions(contact_threshold=1e-4, sleep=world.options.sleep)


DISTURBANCES = {
    "target": lambda w, c: setattr(w.tendons[0].holds[0], "target", (-0.09, 0, 0.14)),
    "soft grip": lambda w, c: setattr(w.tendons[0].holds[0], "stiffness", 10.0),
    "release": lambda w, c: w.tendons[0].holds[0].release(),
    "grip": lambda w, c: w.tendons[1].grip(3, target=(0.29, 0, 0.02)),
    "attach": lambda w, c: w.tendons[0].attach(12, w.bar, -1, (0, 0.01, 0.025)),
    "force": lambda w, c: w.tendons[2].set_force(5, (0, 0, 0.05)),
    "mass": lambda w, c: w.tendons[3].set_point_mass(-1, 0.1),
    "shorten": lambda w, c: w.tendons[0].shorten(0.02),
    "positions": lambda w, c: w.tendons[1].set_positions(w.tendons[1].positions + (0, 0, 0.01)),
    "gravity": lambda w, c: p.setGravity(1.0, 0, -9.0, physicsClientId=c),
    "body moved": move_bar,
    "body led": lead_bar,
    "friction": lambda w, c: p.changeDynamics(w.bar, -1, lateralFriction=0.0, physicsClientId=c),
    "obstacle removed": remove_bar,
    "threshold": change_options,
    "tunnel": lambda w, c: w.add_tunnel(w.bar, -1, (-0.03, 0, 0.0), (0.03, 0, 0.0), 0.01),
    "tendon removed": lambda w, c: w.remove_tendon(w.tendons[1]),
    "tendon falls": falling_tendon,
    "slow ball": lambda w, c: ball(w, c, (0.3, 0.03, 0.05), 0.01, (0, 0, 0)),
    "fast ball": lambda w, c: ball(w, c, (-0.04, 0.0, 0.16), 0.1, (0, 0, -3)),
}


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("disturbance", DISTURBANCES)
def test_what_it_feels_wakes_it(scene, client, disturbance, integrator):
    """The motion is that of a world whose tendons never sleep."""
    ends = []
    for sleep in (True, False):
        world = scene(sleep=sleep)
        settle(world, integrator)
        assert asleep(world) == 4 * sleep
        start = {t.name: t.positions for t in world.tendons}
        DISTURBANCES[disturbance](world, client)
        world.step(30)
        assert world.report.converged
        assert asleep(world) < 4
        ends.append({t.name: t.positions for t in world.tendons})
    moved = max(np.abs(x - start.get(name, x)).max() for name, x in ends[1].items())
    for name, x in ends[0].items():
        np.testing.assert_allclose(x, ends[1][name], atol=max(0.02 * moved, 1e-3 * R), err_msg=name)


def test_only_what_is_near_wakes(scene, client):
    world = scene()
    world.step(REST)
    by_name(world)["across"].set_force(0, (0, 0, 1e-3))
    world.step(5)
    assert [t.name for t in world.tendons if t.asleep] == ["over", "hanging"]
    ball(world, client, (0.3, 0.03, 0.05), 0.01, (0, 0, 0))
    # All are roused by a further obstacle, and those that it does not reach sleep again. It rolls off later.
    world.step(REST // 2)
    assert [t.name for t in world.tendons if t.asleep] == ["over", "hanging"]
    grip = by_name(world)["over"].holds[0]
    grip.target = grip.target
    world.step()
    assert by_name(world)["over"].asleep


@pytest.mark.parametrize("speed", [1.0, 10.0, 50.0])
def test_shots_wake_in_time(make_world, client, speed):
    """A tendon shot at one that sleeps, from beyond where a step begins: it does not pass."""
    world = make_world(1 / 240)
    target = world.add_tendon(
        [[-0.05, 0, 0], [0.05, 0, 0]], 1e-3, bt.Material(stiffness=1e4, damping=1.0), 20
    )
    target.grip(0), target.grip(-1)
    world.step(200)
    assert asleep(world) == 1
    line = np.array([[0, -0.02, 0.003], [0, 0.02, 0.003]]) + (0, 0, 0.7 * speed / 240)
    shot = world.add_tendon(line, 1e-3, bt.Material(stiffness=1e4, damping=1.0), 10)
    shot.set_positions(shot.positions, np.tile([0, 0, -speed], (10, 1)))
    assert target.asleep
    moved = 0
    for _ in range(12):
        world.step()
        middle, held = shot.positions[4:6].mean(0), target.positions[9:11].mean(0)
        assert middle[2] - held[2] > 0
        moved = max(moved, np.abs(target.positions[:, 2]).max())
    assert moved > 1e-4


def test_a_swing_does_not_sleep_at_its_turning_points(make_world):
    ends = []
    for sleep in (True, False):
        world = make_world(1 / 1000, (0, 0, -9.81), sleep=sleep)
        t = world.add_tendon([[0, 0, 0], [1e-3, 0, -0.1]], R, MATERIAL, 2)
        t.grip(0)
        for _ in range(2000):
            world.step()
            assert asleep(world) == 0
        ends.append(t.positions)
    np.testing.assert_array_equal(*ends)


def test_what_creeps_or_pulls_at_a_body_does_not_sleep(make_world, client):
    world = make_world(1 / 240, (0, 0, -9.81))
    hung = world.add_tendon([[0, 0, 0], [0, 0, -0.1]], R, MATERIAL, 6)
    hung.grip(0)
    hung.attach(-1, p.createMultiBody(0.1, basePosition=(0, 0, -0.1), physicsClientId=client))
    slow = world.add_tendon([[1, 0, 0], [1.1, 0, 0]], R, bt.Material(stiffness=10.0, damping=1e4), 6)
    slow.grip(0), slow.grip(-1, target=(1.11, 0, 0), stiffness=1.0)
    world.step(1500)
    assert asleep(world) == 0


def test_what_nothing_holds_goes_on(make_world):
    world = make_world(1 / 240)
    free = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], R, MATERIAL, 6)
    free.set_positions(free.positions, np.full((6, 3), 1e-9))
    x = free.positions
    world.step(480)
    assert asleep(world) == 0
    np.testing.assert_allclose(free.positions - x, 2e-9, rtol=1e-6)


@pytest.mark.parametrize("when", [REST, REST + 37])
def test_states_of_sleep_go_on_the_same(scene, client, when):
    """Restored, or loaded into another world, sleepers are roused by the same things to the same bits."""

    def go_on(world):
        by_name(world)["across"].set_force(5, (0, 0, 0.05))
        world.step(20)
        return world.state_hash()

    world = scene()
    world.step(when)
    kept, packed, sleepers = world.save_state(), world.snapshot(), asleep(world)
    assert sleepers == 4
    first = go_on(world)
    world.restore_state(kept)
    assert go_on(world) == first
    other = scene()
    other.load_snapshot(packed)
    other.step()
    assert asleep(other) == 4
    other.load_snapshot(packed)
    assert go_on(other) == first


def test_a_failed_step_leaves_sleepers_asleep(scene):
    world = scene()
    world.step(REST)
    x = by_name(world)["across"].positions
    t = by_name(world)["over"]
    t.set_force(3, (1e308, 0, 1e308))
    with pytest.raises(bt.StepFailed):
        world.step(5)
    t.set_force(3, (0, 0, 0))
    world.step()
    assert asleep(world) == 3
    np.testing.assert_array_equal(by_name(world)["across"].positions, x)


def test_relaxing_wakes_all(make_world):
    world = make_world(1 / 240, (0, 0, -9.81))
    t = world.add_tendon([[0, 0, 0], [0.05, 0, -0.02], [0.1, 0, 0]], R, MATERIAL, 20)
    t.grip(0), t.grip(-1)
    world.step(1000)
    assert asleep(world) == 1
    world.relax()
    assert world.report.converged and asleep(world) == 0


@pytest.mark.parametrize("place", [(0, 0, 0.05), (1, 0, 0.1)])
def test_what_lay_on_a_body_that_was_taken_away_falls(make_world, client, place):
    """Farther in one step than the tendon reaches."""
    world = make_world(1 / 240, (0, 0, -9.81))
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.05, 0.01], physicsClientId=client)
    bar = static(client, box, (0, 0, 0.1))
    world.add_obstacle(bar)
    t = world.add_tendon([(-0.03, 0, 0.112), (0.03, 0, 0.112)], R, MATERIAL, 16)
    world.step(REST)
    assert t.asleep
    start = t.positions
    p.resetBasePositionAndOrientation(bar, place, (0, 0, 0, 1), physicsClientId=client)
    world.step(20)
    fallen = 9.81 * 20 * 21 / 2 / 240**2
    np.testing.assert_allclose(start[:, 2] - t.positions[:, 2], fallen, rtol=1e-6)
