"""The linear model of Newton's method against differences of forces: particles, bodies, contacts together.

A random force g is solved for by the matrix at a step's solution. The iterate then moves along the result, to
both sides, and the forces have to change by -g.
"""

import numpy as np
import pybullet as p
import pytest
from link_scenes import block

import bullet_tendon as bt
from bullet_tendon._core import testing

MOVE = 1e-8  # m; farther, third derivatives show; less far, the rounding of stiff springs


def errors_of(world, steps):
    """Errors of all solutions in so many steps, relative to the largest g; -1: the matrix is indefinite."""
    errors = []
    testing.watch_models(world._core, MOVE, errors.append)
    for _ in range(steps):
        world.step()
    assert len(errors) >= steps
    return np.array(errors)


@pytest.mark.parametrize("mass", [0, 0.05])
def test_crossed_strands_that_a_body_carries(make_world, client, mass):
    """Segments that touch and end on a body: its motion slides and turns their contact."""
    world = make_world(1 / 240, gravity=(0, 0, -9.81))
    body = p.createMultiBody(mass, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.03, 0.01, 0.005]))
    law = bt.Material(stiffness=500.0, density=1100.0, friction=0.0)
    for side in (-1, 1):
        foot, top = np.array([0.02 * side, 6e-4 * side, 0.006]), np.array([-0.02 * side, 6e-4 * side, 0.046])
        t = world.add_tendon([top, foot], 5e-4, law, particles=3)
        t.attach(-1, body)
        t.grip(0, target=top - [0, 2e-3 * side, 0])
    errors = errors_of(world, 30)
    assert len(world.contacts) > 0
    assert np.median(errors) <= 1e-5


def test_crossed_strands_whose_ends_change_bodies(make_world, client):
    """Columns of a body do not move an end that it no longer carries. Two bodies fill more than a panel."""
    world = make_world(1 / 240, gravity=(0, 0, -9.81))
    bodies = [block(client, 0.05, half=[0.03, 0.01, 0.005]) for _ in range(2)]
    law = bt.Material(stiffness=500.0, density=1100.0, friction=0.0)
    for side in (-1, 1):
        foot, top = np.array([0.02 * side, 6e-4 * side, 0.006]), np.array([-0.02 * side, 6e-4 * side, 0.052])
        world.add_tendon([top, foot], 5e-4, law, particles=3).grip(0, target=top - [0, 2e-3 * side, 0])
    for order in (1, -1):
        ends = [t.attach(-1, body) for t, body in zip(world.tendons, bodies[::order], strict=True)]
        errors = errors_of(world, 10)
        assert (world.contacts["normal_force"] > 0).any()
        assert np.median(np.abs(errors)) <= 1e-5
        for end in ends:
            end.release()


def test_a_held_bore_and_its_mouth(make_world):
    """The contact point slides along its segment and around the edge of the mouth."""
    world = make_world(1 / 240)
    block = p.createMultiBody(0, p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.02, 0.02]))
    world.add_tunnel(block, -1, (0, 0, -0.02), (0, 0, 0.02), 0.004)
    law = bt.Material(stiffness=2000.0, density=1100.0, friction=0.0)
    t = world.add_tendon([[0, 0, -0.05], [0, 0, 0.02], [0.03, 0, 0.04]], 0.0015, law, particles=24)
    t.grip(0)
    t.grip(-1, target=(0.034, 0, 0.04))
    errors = errors_of(world, 20)
    assert len(world.contacts) > 0
    assert np.median(errors) <= 1e-5


@pytest.mark.parametrize("spin", [0, 10, 40])
@pytest.mark.parametrize("mass", [0.01, 0.1, 1.0])
def test_a_bead_that_turns_on_its_mouths(make_world, client, mass, spin):
    """Force and torque of the mouths, by the motion of the particles and the turn of the body."""
    world, half = make_world(1 / 240, gravity=(0, 0, -9.81)), 0.01
    bead = block(client, mass, (0.003, 0, 0), [half] * 3)
    world.add_tunnel(bead, -1, (-half, 0, 0.004), (half, 0, 0.004), 0.003, friction=0.0)
    law = bt.Material(stiffness=2000.0, density=1100.0, damping=1.0)
    t = world.add_tendon([(-0.1, 0, 0.004), (0.1, 0, 0.0042)], 1e-3, law, particles=24, rest_length=0.2)
    t.grip(0), t.grip(-1)
    p.resetBaseVelocity(bead, [0, 0, 0], [0, spin, 0], physicsClientId=client)
    errors = errors_of(world, 30)
    assert "mouth" in set(world.contacts["kind"])
    assert np.median(errors[errors >= 0]) <= 2e-5


def test_a_bore_that_turns_along_a_cord_that_slides(make_world, client):
    """Where a particle has slid along the bore, its wall moves as the body turns there."""
    world, half = make_world(1 / 240), 0.05
    body = block(client, 0.3, half=[half, 0.01, 0.01])
    world.add_tunnel(body, -1, (-half, 0, 0), (half, 0, 0), 0.006, friction=0.0)
    law = bt.Material(stiffness=2000.0, density=1100.0, damping=1.0)
    t = world.add_tendon([(-0.04, 0, 0), (0.03, 0, 0)], 0.004, law, particles=12)
    t.set_positions(t.positions, np.tile([1.0, 0, 0], (12, 1)))
    p.resetBaseVelocity(body, [0, 0, 0], [0, 6, 3], physicsClientId=client)
    errors = []
    testing.watch_models(world._core, MOVE, errors.append)
    pressed = 0
    for _ in range(12):
        world.step()
        bores = world.contacts[world.contacts["kind"] == "bore"]
        pressed += (bores["normal_force"] > 0).any()
    assert pressed >= 6
    assert np.percentile(errors, 80) <= 1e-4


@pytest.mark.parametrize("spin", [(0, 0, 0), (3, -2, 20), (30, 10, 40)])
@pytest.mark.parametrize("touched", [False, True])
def test_a_slender_rod_that_turns_about_its_axis_first(make_world, client, spin, touched):
    """Cables pull at its ends and beside its axis, and a cord lies across it where it is touched."""
    world = make_world(1 / 240, gravity=(0, 0, -9.81))
    rod = block(client, 0.05, half=[0.004, 0.005, 0.1])
    law = bt.Material(stiffness=2000.0, density=1100.0, damping=1.0, friction=0.0)
    for place, away in (
        ((0, 0, 0.1), (0.1, 0.02, 0.1)),
        ((0, 0, -0.1), (-0.1, 0.05, -0.1)),
        ((0.004, 0, 0), (0.1, 0, 0)),
    ):
        t = world.add_tendon([np.add(place, away), place], 5e-4, law, particles=4)
        t.collides = False
        t.grip(0), t.attach(-1, rod)
    if touched:
        world.add_obstacle(rod, friction=0.0)
        cord = world.add_tendon([(0.0046, -0.1, 0.05), (0.0046, 0.1, 0.05)], 5e-4, law, particles=9)
        cord.grip(0, target=(0, -0.1, 0.05)), cord.grip(-1, target=(0, 0.1, 0.05))
    p.resetBaseVelocity(rod, [0.1, 0, 0], spin, physicsClientId=client)
    errors = errors_of(world, 30)
    assert len(world.contacts) > 0 or not touched
    assert np.median(errors[errors >= 0]) <= 5e-5
