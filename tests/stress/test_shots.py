"""Nothing passes through anything: tendons shot at plates and at other tendons, at 1 to 100 m/s."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import measure

import bullet_tendon as bt
from bullet_tendon import _core

RADIUS = 0.5e-3  # m, of the tendons; and half the plate's thickness
SAMPLES = np.linspace(0, 1, 17)  # of a part of a step, in which nothing near goes farther than its radius


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def random_tendon(world, random, points, name):
    material = bt.Material(
        stiffness=10 ** random.uniform(2, 4.5), damping=random.uniform(0, 1), friction=random.uniform(0, 0.5)
    )
    return world.add_tendon(points, RADIUS, material, int(random.integers(10, 41)), name=name)


def rod(random, above):
    """A straight line in a random direction whose lowest point is at the height `above` [m]."""
    way = random.standard_normal(3)
    line = np.array([[-0.5], [0.5]]) * random.uniform(0.05, 0.3) * way / np.linalg.norm(way)
    line[:, 2] += above - line[:, 2].min()
    return line


def shoot(tendon, velocity):
    tendon.set_positions(tendon.positions, np.tile(velocity, (len(tendon.positions), 1)))


@pytest.mark.parametrize(("count", "seed"), [(40, 1), slow(5000, 2)])
def test_plates(client, count, seed):
    """A plate of 1 mm, hit at up to 70 degrees from its normal."""
    random = np.random.default_rng(seed)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[20, 20, RADIUS], physicsClientId=client)
    plate = p.createMultiBody(0, box, physicsClientId=client)
    unsolved = steps = 0
    for _ in range(count):
        world = bt.TendonWorld(client)
        world.add_obstacle(plate)
        away, speed = random.uniform(0.002, 0.3), 10 ** random.uniform(0, 2)
        tilt, yaw = random.uniform(0, 1.2), random.uniform(0, 2 * np.pi)
        t = random_tendon(world, random, rod(random, away + 3 * RADIUS), "shot")
        flat = np.sin(tilt) * np.array([np.cos(yaw), np.sin(yaw)])
        shoot(t, speed * np.array([*flat, -np.cos(tilt)]))
        for _ in range(min(40, int(np.ceil(240 * away / (speed * np.cos(tilt)))) + 4)):
            world.step()
            unsolved, steps = unsolved + (not world.report.converged), steps + 1
            assert np.abs(t.positions[:, :2]).max() < 20
            assert t.positions[:, 2].min() > RADIUS  # the centreline above the plate's face
        world.remove_tendon(t)
    print(f"{count} shots at plates: {unsolved} of {steps} steps not converged")
    assert unsolved <= 0.02 * steps


def watched(core):
    """List to which the positions of both tendons are added after every substep."""
    seen = []
    _core.testing.watch_substeps(core, lambda: seen.append([core.positions(slot) for slot in (0, 1)]))
    return seen


def least_distance(before, after):
    """Of two tendons on straight ways, or less where they are far."""
    least = measure.between(*before) - sum(
        np.linalg.norm(a - b, axis=1).max() for b, a in zip(before, after, strict=True)
    )
    if least > 2 * RADIUS:
        return least
    least = np.inf
    for share in SAMPLES:
        x, y = ((1 - share) * b + share * a for b, a in zip(before, after, strict=True))
        least = min(least, measure.between(x, y))
    return least


@pytest.mark.parametrize(("count", "seed"), [(30, 1), slow(5000, 2)])
def test_other_tendons(client, count, seed):
    """A tendon of 1 mm that is held at its ends, hit by another one: centrelines never cross in any part."""
    random = np.random.default_rng(seed)
    unsolved = steps = 0
    for _ in range(count):
        world = bt.TendonWorld(client)
        target = random_tendon(world, random, rod(random, 0.0) * [1, 1, 0.3], "target")
        target.grip(0)
        target.grip(-1)
        away, speed = random.uniform(0.002, 0.3), 10 ** random.uniform(0, 2)
        top = target.positions[:, 2].max() + 3 * RADIUS
        t = random_tendon(
            world, random, rod(random, top + away) + [*random.uniform(-0.03, 0.03, 2), 0], "shot"
        )
        shoot(t, (0.0, 0.0, -speed))
        seen = watched(world._core)
        last = [target.positions, t.positions]
        for _ in range(min(40, int(np.ceil(240 * away / speed)) + 4)):
            seen.clear()
            world.step()
            unsolved, steps = unsolved + (not world.report.converged), steps + 1
            for now in [*seen, [target.positions, t.positions]]:
                assert least_distance(last, now) > 0.2 * 2 * RADIUS
                last = now
        world.remove_tendon(t)
        world.remove_tendon(target)
    print(f"{count} shots at tendons: {unsolved} of {steps} steps not converged")
    assert unsolved <= 0.02 * steps
