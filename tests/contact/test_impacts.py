"""Methods of second order where velocities jump: what strikes does not bounce; impulses stay opposite."""

import math

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, SPEED, DT = 0.002, 0.2, 1 / 240  # m, m/s, s
ROPE = bt.Material(stiffness=1e3, damping=0.5, friction=0.3)


def rods(world, count, gap):
    """Crosswise above each other, `gap` apart."""
    lines = []
    for k in range(count):
        end, height = np.array([0.03, 0, 0] if k % 2 == 0 else [0, 0.03, 0]), k * (2 * RADIUS + gap)
        lines.append(world.add_tendon([[0, 0, height] - end, [0, 0, height] + end], RADIUS, ROPE, 2))
    return lines


@pytest.mark.parametrize("integrator", ["bdf2"])
@pytest.mark.parametrize("phase", [0.02, 0.2, 0.4, 0.6, 0.8, 0.98])
def test_what_strikes_a_tendon_does_not_bounce(make_world, integrator, phase):
    """Wherever it is when the step begins in which it strikes. BDF2 alone throws it back by up to 5/4."""
    world = make_world(DT, integrator=integrator)
    low, high = rods(world, 2, (3 + phase) * SPEED * DT)
    low.grip(0), low.grip(-1)
    high.set_positions(high.positions, np.tile([0, 0, -SPEED], (2, 1)))
    up = []
    for _ in range(20):
        world.step()
        up.append(high.velocities[:, 2].mean())
    assert up[2] == pytest.approx(-SPEED, rel=1e-9)  # it comes unhindered
    assert max(up) <= 2e-3 * SPEED


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
@pytest.mark.parametrize("gap", [1e-4, 3e-4, 7e-4])
def test_tendons_that_strike_each_other_one_after_another_keep_their_momentum(make_world, integrator, gap):
    world = make_world(DT, integrator=integrator, tolerance=1e-12)
    tendons = rods(world, 4, gap)
    top = tendons[-1]
    top.set_positions(top.positions, np.tile([0.1 * SPEED, 0, -SPEED], (2, 1)))

    def momentum():
        return sum(t.masses @ t.velocities for t in tendons)

    before = momentum()
    for _ in range(40):
        world.step()
        np.testing.assert_allclose(momentum(), before, rtol=0, atol=1e-9 * np.linalg.norm(before))
    assert np.linalg.norm(tendons[0].velocities) > 0.05 * SPEED


def sliding_error(make_world, client, integrator, steps):
    """Error of the state after 5/4 periods of a weight on a spring that slides over a floor."""
    length, stretch, stiffness = 0.1, 0.03, 100.0
    world = make_world(1.0, (0, 0, -9.81), integrator=integrator)
    floor = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, floor, physicsClientId=client))
    material = bt.Material(stiffness=stiffness, friction=0.0)
    t = world.add_tendon([[0, 0, RADIUS], [length, 0, RADIUS]], RADIUS, material)
    t.grip(0)
    t.set_positions([[0, 0, RADIUS], [length + stretch, 0, RADIUS]])
    w = math.sqrt(stiffness / length / t.masses[1])
    p.setTimeStep(2.5 * math.pi / w / steps, physicsClientId=client)
    world.step(steps)
    assert world.contacts["normal_force"].max() > 0
    return math.hypot((t.positions[1, 0] - length) / stretch, t.velocities[1, 0] / (w * stretch) + 1)


@pytest.mark.parametrize("integrator", ["bdf2"])
def test_what_slides_swings_by_second_order(make_world, client, integrator):
    coarse, fine = (sliding_error(make_world, client, integrator, n) for n in (500, 1000))
    assert fine < 0.02
    assert math.log2(coarse / fine) >= 1.9
