"""Grips with a force limit: what they hold, how they slip, and what is refused."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G, BOB = 9.81, 1.0
ROPE = bt.Material(stiffness=1e4, damping=5.0)


def hung(world, max_force, stiffness=None, tension=0.0):
    """A weight on a tendon in a hand: tendon, grip, and the weight of both [N]."""
    slack = 0.3 / (1 + tension / ROPE.stiffness)
    t = world.add_tendon([[0, 0, 0], [0, 0, -0.3]], 1e-3, ROPE, 20, rest_length=slack)
    t.set_point_mass(-1, BOB)
    return t, t.grip(0, stiffness=stiffness, max_force=max_force), G * t.masses.sum()


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_a_weight_that_is_too_heavy_falls_by_what_is_missing(make_world, integrator, share):
    """a = g - F/m, if the tendon begins under the tension F; within the way of one step, v dt/2."""
    dt = 1 / 1000
    world = make_world(dt, (0, 0, -G), integrator=integrator)
    t, grip, weight = hung(world, 1.0, tension=share * G * BOB)
    grip.max_force = share * weight
    world.step(500)
    assert np.linalg.norm(grip.force) == pytest.approx(share * weight, rel=1e-9)
    assert grip.slipping
    fallen = 0.5 * G * (1 - share) * (500 * dt) ** 2
    assert -t.positions[-1, 2] - 0.3 == pytest.approx(fallen, abs=fallen * 4 * dt + 1e-4)


@pytest.mark.parametrize("stiffness", [None, 2e4])
def test_below_its_limit_it_holds_as_without(make_world, stiffness):
    ends = []
    for most in (None, 1.05):
        world = make_world(gravity=(0, 0, -G))
        t, grip, weight = hung(world, None, stiffness)
        grip.max_force = None if most is None else most * weight
        world.step(480)
        assert not grip.slipping
        assert np.linalg.norm(grip.force) == pytest.approx(weight, rel=1e-4)
        ends.append(t.positions)
    assert np.abs(ends[1] - ends[0]).max() <= 1e-3 * t.radius


def test_it_holds_again_when_the_load_is_gone(make_world):
    world = make_world(gravity=(0, 0, -G))
    t, grip, weight = hung(world, 20.0)
    t.set_force(-1, [0, 0, -30.0])
    world.step(24)
    assert grip.slipping
    assert t.positions[0, 2] < -0.01
    t.set_force(-1, [0, 0, 0])
    world.step(2400)  # the hand draws the weight up, which bounces under the slack tendon
    assert not grip.slipping
    assert np.abs(t.positions[0]).max() <= 1e-3 * t.radius
    bob, velocity = t.positions[-1], t.velocities[-1]  # it swings by a few degrees still
    length = np.linalg.norm(bob)
    swing = -weight * bob[2] / length + BOB * velocity @ velocity / length
    assert np.linalg.norm(grip.force) == pytest.approx(swing, rel=1e-3)


@pytest.mark.parametrize("most", [1.0, 50.0, 1000.0])
def test_it_slips_where_it_is_led_into_a_bone(make_world, client, most):
    """It presses the tendon on the bone by its limit; the bone is not entered."""
    world = make_world()
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.02], physicsClientId=client)
    body = p.createMultiBody(0, box, physicsClientId=client)
    world.add_obstacle(body)
    t = world.add_tendon(
        [[-0.05, 0, 0.03], [0.05, 0, 0.03]], 2e-3, bt.Material(stiffness=3e4, damping=5.0), 30
    )
    grips = [t.grip(i, max_force=most) for i in (0, -1)]
    for k in range(120):
        for grip, x in zip(grips, (-0.05, 0.05), strict=True):
            grip.target = [x, 0, 0.03 - 0.0005 * min(k, 80)]
        world.step()
        assert world.report.converged
    assert t.positions[:, 2].min() >= 0.022 - 1e-5
    assert all(grip.slipping for grip in grips)
    assert world.wrench(body)[2] == pytest.approx(-2 * most, rel=1e-6)


def test_one_linearisation_slips_too(make_world):
    world = make_world(1 / 1000, (0, 0, -G), iteration="single")
    t, grip, weight = hung(world, 5.0, tension=5.0)
    world.step(500)
    assert np.linalg.norm(grip.force) == pytest.approx(5.0, rel=1e-6)
    assert -t.positions[-1, 2] - 0.3 == pytest.approx(0.125 * G * (1 - 5.0 / weight), rel=0.01)


@pytest.mark.parametrize("most", [5.0, 20.0])
def test_explicit_steps_slip_too(make_world, most):
    world = make_world(1e-5, (0, 0, -G), integrator="explicit_euler")
    t = world.add_tendon([[0, 0, 0], [0, 0, -0.3]], 2e-3, bt.Material(stiffness=100.0, damping=0.1), 5)
    t.set_point_mass(-1, BOB)
    t.set_positions(t.positions * (1 + G * t.masses.sum() / 100.0))
    grip = t.grip(0, max_force=most)
    start = t.masses @ t.positions[:, 2]
    world.step(10000)
    fallen = (start - t.masses @ t.positions[:, 2]) / t.masses.sum()
    assert grip.slipping == (most < 10)
    assert fallen == pytest.approx(0.005 * max(0, G - most / t.masses.sum()), rel=0.01, abs=1e-4)


def test_its_limit_is_part_of_the_state(make_world):
    world = make_world(gravity=(0, 0, -G))
    t, grip, _ = hung(world, 5.0)
    world.step(10)
    state, data = world.save_state(), world.snapshot()
    for put_back in (lambda: world.restore_state(state), lambda: world.load_snapshot(data)):
        grip.max_force = None
        world.step(3)
        put_back()
        assert grip.max_force == 5.0
        world.step()
        assert np.linalg.norm(grip.force) == pytest.approx(5.0, rel=1e-9)
        assert grip.slipping


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, "strong"])
def test_limits_that_are_none_are_refused(make_world, value):
    world = make_world()
    t, grip, _ = hung(world, 5.0)
    with pytest.raises(bt.TendonError, match="max_force"):
        grip.max_force = value
    with pytest.raises(bt.TendonError, match="max_force"):
        t.grip(-1, max_force=value)
    assert grip.max_force == 5.0
    assert len(t.holds) == 1


@pytest.mark.parametrize("dt", [1 / 60, 1 / 240])
def test_a_soft_grip_is_as_strong_in_cut_steps(make_world, dt):
    """Another tendon is thrown at high speed past a third one, so that steps are divided. The hand carries
    the weight as its spring says, and the weight stays where it is."""
    world = make_world(dt, (0, 0, -G))
    t = world.add_tendon([[0, 0, 0], [0, 0, -0.3]], 1e-3, ROPE, 10)
    t.set_point_mass(-1, BOB)
    hand = t.grip(0, stiffness=500.0, damping=50.0)
    world.step(int(4 / dt))
    start = t.positions
    other = world.add_tendon([[1, 0, 0], [1.3, 0, 0]], 1e-3, ROPE, 20)
    other.grip(0)
    world.add_tendon([[1, 0.01, 0], [1.3, 0.01, 0]], 1e-3, ROPE, 20).grip(0)
    parts = 0
    for k in range(12):
        if k % 4 == 0:
            other.set_positions(other.positions, np.linspace(0, 1, 20)[:, None] * [0, 30.0, 5.0])
        world.step()
        parts = max(parts, world.report.counts["substeps"])
        np.testing.assert_allclose(hand.force, 500.0 * (t.positions[0] - hand.target), atol=1e-3 * G)
        assert np.abs(t.positions - start).max() < 1e-5
    assert parts > 3


@pytest.mark.parametrize(
    ("bore", "radius", "tilt", "thick", "friction", "aside", "stiffness", "particles"),
    [
        (3.5854734e-3, 3.0796191e-3, 0.771108, 0.0202046, 0.311736, (0.2897, 0.2778, -0.2815), 47881, 20),
        (3.5339827e-3, 3.3885046e-3, 0.076794, 0.0221471, 0.150595, (-0.1621, 0.0485, 0.0125), 9001, 60),
    ],
    ids=["oblique", "narrow"],
)
def test_a_hand_that_slips_at_the_wall_of_a_bore_holds_again(
    make_world, client, bore, radius, tilt, thick, friction, aside, stiffness, particles
):
    """It leads an end beside the axis into a bore, slips at the wall, and is led to the axis."""
    way, aside = np.array([np.sin(tilt), 0, np.cos(tilt)]), bore * np.array(aside)
    deep = 0.5 * thick / np.cos(tilt)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.06, 0.06, thick / 2], physicsClientId=client)
    plate = p.createMultiBody(0, shape, physicsClientId=client)
    world = make_world(1 / 1000, (0, 0, -G))
    world.add_tunnel(
        plate, -1, tuple(-deep * way), tuple(deep * way), bore, friction=friction, chamfer=0.3 * bore
    )
    start = (deep + 0.01) * way + aside
    rope = bt.Material(stiffness=stiffness, damping=1.0)
    cord = world.add_tendon([tuple(start), tuple(start + 0.1 * way)], radius, rope, particles)
    cord.set_force(-1, tuple(2.0 * way))
    hand, slipped = cord.grip(0, max_force=40.0), 0
    for step in range(1000):
        done = (step + 1) / 1600
        hand.target = start - min(1.0, 3 * done) * aside - done * (2 * deep + 0.03) * way
        world.step()
        slipped += hand.slipping
        assert world.report.converged
        assert world.report.counts["linear_solves"] < 100
    assert slipped > 10
    assert not hand.slipping
    assert np.linalg.norm(hand.force) == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("dt", [1 / 60, 1 / 1000])
@pytest.mark.parametrize("most", [20.0, 150.0, 2000.0])
def test_a_hand_presses_a_soft_cord_on_a_plate_by_no_more_than_its_limit(
    make_world, client, most, dt, integrator
):
    """The limits are up to 200 times the force that squeezes the cord flat. None of them enters the plate."""
    radius, rope = 0.0027, bt.Material(stiffness=59.0, density=1045, friction=0.2)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.05, 0.05], physicsClientId=client)
    plate = p.createMultiBody(0, shape, -1, [0, 0, -0.05], physicsClientId=client)
    world = make_world(dt, (0, 0, 0), integrator=integrator)
    world.add_obstacle(plate, friction=0.3)
    cord = world.add_tendon([(0, 0, 0.1), (0, 0, radius + 0.002)], radius, rope, 54)
    hand = cord.grip(-1, max_force=most)
    cord.grip(0, stiffness=1000.0)
    for step in range(60):
        hand.target = (0, 0, radius + 0.002 - 0.006 * (step + 1) / 60)
        world.step()
        assert world.report.converged
        assert cord.positions[:, 2].min() > (1 - 0.02) * radius
    assert hand.slipping
    assert hand.force[2] == pytest.approx(most, rel=1e-6)
