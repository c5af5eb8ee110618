"""Strands beside each other in a bore: their contacts begin and end together, whatever their resolution.

A taut strand that leaves another one leaves all its contacts at once. Where each iteration released only the
last of them, a step took as many linear solutions as there are particles.
"""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

LENGTH, BORE, RADIUS = 0.1, 0.04, 0.0016  # m
PULL = 20.0  # N
STEPS, LEAD, HOLD = 120, 60, 30  # steps; while strands are led aside; before they are pulled
DT, SPEED = 1 / 240, 0.01  # s, m/s


def pulled(make_world, client, strands: int, particles: int, friction: float, **options):
    """Lead strands aside at the mouth of a bore and pull them out slowly. Yields (world, hands) each step."""
    around = (1.0 if strands == 2 else np.sqrt(2)) * 1.03 * RADIUS
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[BORE / 2, 0.02, 0.02], physicsClientId=client)
    body = p.createMultiBody(0, shape, physicsClientId=client)
    world = make_world(DT, **options)
    world.add_obstacle(body, friction=friction)
    wall = 1.02 * (around + RADIUS)
    world.add_tunnel(body, -1, [-BORE / 2, 0, 0], [BORE / 2, 0, 0], wall, friction=friction)
    material = bt.Material.ligament(2e4, 0.03, friction=friction)
    hands = []
    for k in range(strands):
        angle = 2 * np.pi * k / strands + 0.3
        aside = around * np.array([0, np.cos(angle), np.sin(angle)])
        shift = 0.37 * k * LENGTH / (particles - 1)  # no particle is beside one of another strand
        ends = [[-LENGTH / 2 + shift, 0, 0] + aside, [LENGTH / 2 + shift, 0, 0] + aside]
        tendon = world.add_tendon(ends, RADIUS, material, particles)
        tendon.set_force(0, [-PULL, 0, 0])
        hands.append(tendon.grip(-1))
    starts = [np.array(hand.target) for hand in hands]
    for step in range(STEPS):
        way = [max(0, step - HOLD) * DT * SPEED, 0, 0.0127 * min(1, step / LEAD)]
        for hand, start in zip(hands, starts, strict=True):
            hand.target = start + way
        world.step()
        p.stepSimulation(physicsClientId=client)
        yield world, hands


@pytest.mark.parametrize(("strands", "most"), [(2, 15), (4, 25)])
def test_solutions_do_not_grow_as_the_particles(make_world, client, strands, most):
    """One contact an iteration would take a mean of 27 and 56 linear solutions a step."""
    steps = pulled(make_world, client, strands, 100, 0.3)
    solves = [world.report.counts["linear_solves"] for world, _ in steps]
    assert np.mean(solves) <= most


@pytest.mark.parametrize("particles", [60, 100])
def test_smooth_strands_carry_their_load_around_the_mouth(make_world, client, particles):
    """Without friction every strand has the tension that pulls at its other end."""
    for world, hands in pulled(make_world, client, 2, particles, 0.0):
        assert world.report.converged
        tensions = [np.linalg.norm(hand.force) for hand in hands]
    assert tensions == pytest.approx([PULL, PULL], rel=0.03)


def test_the_users_stiffness_is_kept_where_contacts_alternate(make_world, client):
    """It is so large that depths are far below those at which a contact by multipliers is softened."""
    stiffness, largest = 1e8, 0.0
    for world, _ in pulled(make_world, client, 2, 60, 0.3, contact_stiffness=stiffness):
        assert world.report.converged
        forces, depths = world.contacts["normal_force"], np.maximum(0, -world.contacts["distance"])
        np.testing.assert_allclose(forces, stiffness * depths, rtol=1e-9)
        largest = max(largest, forces.max(initial=0))
    assert largest > PULL / 4
