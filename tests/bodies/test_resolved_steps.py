"""A step that is solved again: what it is solved with, and what is read of its forces."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball

import bullet_tendon as bt

GRAVITY = np.array([0, 0, -9.81])  # m/s^2


def hung(client, world, mass):
    """A ball on a tendon that a hand holds: ball, attachment, hand."""
    ball = free_ball(client, mass)
    material = bt.Material(stiffness=1e4, density=10.0)
    line = world.add_tendon([(0, 0, 0.2), (0, 0, 0)], 1e-3, material, 3)
    return ball, line.attach(-1, ball), line.grip(0)


def test_a_hand_leads_a_step_that_is_solved_again_where_it_led_it(client, make_world):
    """Targets that are set since are those of the next step."""

    def run(moves):
        world = make_world(1 / 240, GRAVITY)
        ball, _, hand = hung(client, world, 1.0)
        world.step(240)
        place, _ = p.getBasePositionAndOrientation(ball, client)
        p.applyExternalForce(ball, -1, [0, 0, -100.0], place, p.WORLD_FRAME, client)
        world.step()
        if moves:
            hand.target = (0, 0, 0.21)
        world.apply()
        found = p.getBasePositionAndOrientation(ball, client)[0], world.tendons[0].positions[0, 2]
        p.resetSimulation(client)
        return found

    (still, _), (led, top) = run(False), run(True)
    np.testing.assert_allclose(led, still, rtol=0, atol=1e-12)  # the correction of the step before
    assert top == 0.21


@pytest.mark.parametrize("first, then", [(0.5, 50.0), (50.0, 0.5)])
def test_a_tensioner_holds_as_stiffly_as_its_tension_says(client, make_world, first, then):
    """The spring that goes with its tension is not taken back with a step.

    A particle that has come to the device is held within a thousandth of the radius at that tension.
    """
    world = make_world(1 / 240, GRAVITY)
    ball, _, _ = hung(client, world, 1.0)
    block = p.createMultiBody(0, physicsClientId=client)
    radius = 2e-3
    material = bt.Material(stiffness=1e4, density=1000.0, tension_only=True)
    points = [(0.1, 0, 0), (0.149, 0, 0)]
    graft = world.add_tendon(points, radius, material, 2, rest_length=0.06, collides=False)
    device = graft.pull(-1, first, block, -1, (0.15, 0, 0))
    graft.set_force(-1, [-0.2, 0, 0])  # what the device holds against
    graft.grip(0)
    world.step(240)
    place, _ = p.getBasePositionAndOrientation(ball, client)
    p.applyExternalForce(ball, -1, [0, 0, -100.0], place, p.WORLD_FRAME, client)
    world.step()
    device.force = then
    world.step()
    assert world.report.reasons.get("released", 0) > 0  # the step before was solved again
    world.step(240)
    [line] = [h for h in graft.holds if h.particle == 1]
    away = np.linalg.norm(graft.positions[-1] - (0.15, 0, 0))
    assert 0 < line.tension < then
    assert away == pytest.approx(1e-3 * radius * line.tension / then, rel=1e-3)
