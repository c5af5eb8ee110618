"""Tendons that stand on a plate and are pushed at both ends: stiff ones and slack ones."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RODS = [
    {
        "dt": 1 / 300,
        "radius": 1.5e-3,
        "n": 54,
        "stiffness": 185,
        "exponent": 2,
        "bending": 5.4e-4,
        "push": 0.045,
    },
    {
        "dt": 1 / 200,
        "radius": 1.2e-3,
        "n": 54,
        "stiffness": 6e4,
        "exponent": 2,
        "bending": 4.6e-4,
        "push": 0.45,
    },
    {
        "dt": 1 / 66,
        "radius": 1.8e-3,
        "n": 46,
        "stiffness": 87,
        "exponent": 1,
        "bending": 2.2e-4,
        "push": 0.011,
    },
    {
        "dt": 1 / 150,
        "radius": 8e-4,
        "n": 30,
        "stiffness": 270,
        "exponent": 1,
        "bending": 2.4e-4,
        "push": 0.028,
    },
    {
        "dt": 1 / 66,
        "radius": 1.2e-3,
        "n": 40,
        "stiffness": 340,
        "exponent": 1,
        "bending": 1.5e-4,
        "push": 0.04,
    },
]


def plate(world, client):
    """A plate whose upper face is z = 0."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.2, 0.2, 0.02], physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, -1, [0, 0, -0.02], physicsClientId=client))


@pytest.mark.parametrize("slant", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("rod", RODS)
def test_a_pushed_end_gains_no_energy(client, make_world, rod, slant):
    """Energy grows by the work of both pushes at most."""
    world = make_world(rod["dt"])
    plate(world, client)
    way, foot = np.array([np.sin(slant), 0, np.cos(slant)]), np.array([0, 0, 1.05 * rod["radius"]])
    material = bt.Material(
        stiffness=rod["stiffness"],
        exponent=rod["exponent"],
        damping=2e-4 * rod["stiffness"],
        bending_stiffness=rod["bending"],
        friction=0.6,
    )
    t = world.add_tendon([foot, foot + 0.025 * way], rod["radius"], material, rod["n"])
    pushes = {0: np.array([0, 0, -rod["push"]]), -1: -rod["push"] * way}
    for end, force in pushes.items():
        t.set_force(end, force)
    at_start = t.energy
    work = turnover = 0.0
    for _ in range(60):
        before = t.positions
        world.step()
        done = [force @ (t.positions[end] - before[end]) for end, force in pushes.items()]
        work += sum(done)
        turnover += sum(map(abs, done))
        assert t.energy - at_start - work <= 0.01 * turnover + 1e-9


# radius, length [m], particles, stiffness, push [N], friction, tilt, time step [s]
SLACK = [
    (2.2e-3, 0.017, 55, 446, 0.05, 0.1, 0.05, 1 / 240),
    (1.13e-3, 0.013, 55, 154, 0.025, 0.6, 0.0, 1 / 63),
    (2e-3, 0.012, 60, 200, 0.02, 0.0, 0.1, 1 / 240),
    (2.5e-3, 0.02, 23, 1000, 0.3, 0.5, 0.02, 1 / 100),
]


@pytest.mark.parametrize(("radius", "length", "n", "stiffness", "push", "friction", "tilt", "dt"), SLACK)
def test_a_slack_tendon_is_pushed_together(
    client, make_world, radius, length, n, stiffness, push, friction, tilt, dt
):
    """Its segments lose their length. What is left of one touches the others at both of its ends."""
    world = make_world(dt)
    plate(world, client)
    way, foot = np.array([np.sin(tilt), 0, np.cos(tilt)]), np.array([0, 0, 1.05 * radius])
    material = bt.Material(
        stiffness=stiffness, exponent=2, toe_strain=0.03, tension_only=True, friction=friction
    )
    t = world.add_tendon([foot, foot + length * way], radius, material, n)
    t.set_force(-1, -push * way)
    t.set_force(0, (0, 0, -push))
    solves, shortest = 0, np.inf
    for _ in range(20):
        world.step()
        assert world.report.converged
        solves += world.report.counts["linear_solves"]
        lengths = np.linalg.norm(np.diff(t.positions, axis=0), axis=1)
        shortest = min(shortest, lengths.min() / (length / (n - 1)))
    assert shortest < 0.05
    assert solves < 20 * 200
    assert t.positions[:, 2].min() > 0.99 * radius


@pytest.mark.parametrize("dt", [0.013, 0.01328, 0.0135, 0.014])
def test_segments_in_a_row_do_not_stretch_a_tendon_that_turns(client, make_world, dt):
    """A step carries it as far as it is long, and turns it. Its segments are shorter than it is thick."""
    world = make_world(dt)
    plate(world, client)
    elastic = {"stiffness": 83.36611, "exponent": 1.389, "bending_stiffness": 1.875e-5}
    material = bt.Material(**elastic, density=1329.0, friction=0.0)
    line = [[0, 0, 0.00156765], [0.01826965, 0, 0.03160838]]
    t = world.add_tendon(line, 1.493e-3, material, 23)
    push = 0.01793
    t.set_force(0, (0, 0, -push))
    t.set_force(-1, (-0.009316693, 0, -0.0153194))
    for _ in range(5):
        world.step()
        assert np.abs(t.tension).max() <= 3 * push
