"""world.relax goes on to the tolerance that it is given, where there is something to touch as well."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G, R = 9.81, 0.003
ROPE = bt.Material(stiffness=3e3, exponent=1.5, friction=0.0)


def imbalance(t, world) -> float:
    """Largest sum of forces on a particle that is neither held nor touched, over the largest tension [-].

    Tensions along the segments, and the weight, from the read-outs.
    """
    along = np.diff(t.positions, axis=0)
    pull = along * (t.tension / np.linalg.norm(along, axis=1))[:, None]
    force = np.outer(t.masses, [0, 0, -G])
    force[:-1] += pull
    force[1:] -= pull
    free = np.ones(t.particles, bool)
    free[[h.particle for h in t.holds]] = False
    for row in world.contacts[(world.contacts["tendon"] == t.name) & (world.contacts["normal_force"] > 0)]:
        free[row["segment"] : row["segment"] + 2] = False
    assert free.sum() > 4
    return np.linalg.norm(force[free], axis=1).max() / np.abs(t.tension).max()


@pytest.mark.parametrize("tolerance", [1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("scene", ["two tendons", "over a ball"])
def test_forces_balance_to_the_tolerance(make_world, client, scene, tolerance):
    """At every free particle; and the hands and the ball carry the weight."""
    world = make_world(1 / 240, (0, 0, -G), tolerance=1e-12)
    t = world.add_tendon([[0, 0, 0], [0.3, 0, 0]], R, ROPE, 24)
    ball = None
    if scene == "two tendons":
        other = world.add_tendon([[0, 1, 0], [0.1, 1, 0]], R, ROPE, 8)
        other.grip(0), other.grip(-1)
    else:
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.03, physicsClientId=client)
        ball = p.createMultiBody(0, shape, -1, (0.13, 0, -0.05), physicsClientId=client)
        world.add_obstacle(ball, friction=0.0)
    hands = [t.grip(0), t.grip(-1, target=(0.28, 0, 0))]
    world.relax(tolerance)
    assert world.report.converged and world.report.residual <= tolerance
    assert imbalance(t, world) <= 2 * tolerance
    carried = sum(hand.force for hand in hands)
    if ball is not None:
        carried = carried + world.wrench(ball)[:3]
    weight = t.masses.sum() * G
    np.testing.assert_allclose(carried, [0, 0, -weight], atol=50 * tolerance * np.abs(t.tension).max())


def test_a_smaller_tolerance_takes_more_iterations(make_world):
    """From the same start: the tolerance decides when to end."""
    done = []
    for tolerance in (1e-4, 1e-10):
        world = make_world(1 / 240, (0, 0, -G))
        for y in (0.0, 1.0):
            t = world.add_tendon([[0, y, 0], [0.3, y, 0]], R, ROPE, 24)
            t.grip(0), t.grip(-1, target=(0.28, y, 0))
        world.relax(tolerance)
        assert world.report.converged
        done.append(world.report.iterations)
    assert done[0] < done[1]
