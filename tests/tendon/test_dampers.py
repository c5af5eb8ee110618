"""Dampers, against their formulas: of a tension-only tendon near zero strain, and of a soft grip."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

K, C, LENGTH, DT = 1000.0, 2.0, 0.1, 1 / 240


def stretching_force(make_world, start, rate, toe=None) -> float:
    """Force on the hand [N] in one step that stretches from the strain `start` at a rate [1/s]."""
    world = make_world(DT)
    law = bt.Material(stiffness=K, damping=C, tension_only=True, toe_strain=toe)
    t = world.add_tendon([[0, 0, 0], [LENGTH / 2, 0, 0], [LENGTH, 0, 0]], 0.002, law)
    ends = np.array([[0, 0, 0], [LENGTH / 2, 0, 0], [LENGTH, 0, 0]])
    t.set_positions(ends * (1 + start))
    for i in range(3):
        t.grip(i, target=ends[i] * (1 + start + rate * DT))
    world.step()
    return t.holds[0].force[0]


@pytest.mark.parametrize(("toe", "full"), [(None, 0.01), (0.004, 0.004), (0.2, 0.01)])
@pytest.mark.parametrize("share", [0.0, 1e-3, 0.25, 0.5, 0.999, 1.0, 3.0])
def test_damping_fades_in_with_the_strain(make_world, toe, full, share):
    """T = K s + C ds/dt min(1, s_0/e), e the toe strain or 0.01, s_0 the strain as the step began."""
    rate, start = 1.2, share * full
    end = start + rate * DT
    expected = K * end + C * rate * min(1, share)
    assert stretching_force(make_world, start, rate, toe) == pytest.approx(expected, rel=1e-9)


def test_damping_is_continuous_at_zero_strain(make_world):
    """A hand feels no jump where a tendon that is being stretched gets taut."""
    rate, off = 1.2, 1e-7
    slack, taut = (stretching_force(make_world, s, rate) for s in (-off, off))
    assert abs(taut - slack) <= 1e-3 * C * rate


@pytest.mark.parametrize("damping", [0.0, 0.05, 5.0])
def test_a_soft_grip_is_a_spring_and_a_damper(make_world, damping):
    """Two particles led alike move as one mass on each hand: m v' = -k x - c v, by implicit Euler."""
    stiffness = 3.0
    world = make_world(DT)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], 0.002, bt.Material(stiffness=K))
    mass, start = t.masses[0], t.positions
    hands = [t.grip(i, start[i], stiffness, damping) for i in (0, 1)]
    v = 0.3
    t.set_positions(start, np.tile([0, v, 0], (2, 1)))
    y = 0.0
    for _ in range(12):
        world.step()
        v = (v - DT * stiffness * y / mass) / (1 + DT * damping / mass + DT**2 * stiffness / mass)
        y += DT * v
        np.testing.assert_allclose(t.velocities, np.tile([0, v, 0], (2, 1)), rtol=0, atol=3e-9)
        for hand in hands:
            felt = stiffness * y + damping * v
            np.testing.assert_allclose(hand.force, [0, felt, 0], rtol=0, atol=1e-8 * (stiffness + damping))


@pytest.mark.parametrize("damping", [3.0, 30.0, 300.0])
@pytest.mark.parametrize(("strands", "particles"), [(3, 4), (3, 10), (3, 30), (13, 5)])
def test_damped_strands_that_get_slack_take_few_iterations(make_world, client, damping, strands, particles):
    """A body swings on tension-only strands. Dampers hold some at zero force while they are stretched."""
    most = 0
    for seed in range(3):
        world = make_world(gravity=(0, 0, -9.81))
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.04, 0.03, 0.02], physicsClientId=client)
        body = p.createMultiBody(2.0, shape, -1, [0.2 * seed, 0, 0], physicsClientId=client)
        rng = np.random.default_rng(seed)
        material = bt.Material.ligament(1e4, 0.06, damping=damping)
        for _ in range(strands):
            end = np.array([0.2 * seed, 0, 0.02]) + rng.normal(size=3) * [0.002, 0.002, 0]
            top = [0.2 * seed + 0.01 * rng.normal(), 0.01 * rng.normal(), 0.07]
            t = world.add_tendon([top, end], 3e-4, material, particles, collides=False)
            t.grip(0)
            t.attach(-1, body, -1)
        for _ in range(60):
            world.step()
            assert world.report.converged
            most = max(most, world.report.iterations)
    assert most <= 150
