"""Strands over a pulley that hold a mass, at rest and lifted by the steps of an encoder."""

import math

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G, RADIUS, DROP = 9.81, 0.03, 0.12  # m: of the pulley, and of the strands' ends below it


def hung_over_a_pulley(make_world, client, mass, strands, thickness, friction, dt=1 / 240):
    """A world, its hands and the mass that hangs on strands over a fixed pulley along y."""
    world = make_world(dt, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=RADIUS, height=0.1, physicsClientId=client)
    turn = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
    post = p.createMultiBody(0, shape, -1, [0, 0, 0], turn, physicsClientId=client)
    world.add_obstacle(post, friction=friction)
    reach = RADIUS + thickness + 1e-4
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.01, 0.02, 0.01], physicsClientId=client)
    body = p.createMultiBody(mass, box, -1, [reach, 0, -DROP - 0.01], physicsClientId=client)
    angles = np.linspace(math.pi, 0, 40)
    hands = []
    for k in range(strands):
        y = 4 * thickness * (k - 0.5 * (strands - 1))
        over = [[reach * math.cos(a), y, reach * math.sin(a)] for a in angles]
        tendon = world.add_tendon(
            [[-reach, y, -DROP], *over, [reach, y, -DROP]],
            thickness,
            bt.Material.preset("hamstring_graft"),
            60,
        )
        hands.append(tendon.grip(0))
        tendon.attach(-1, body, -1, (0, y, 0.01))
    world.relax(bodies=[body])
    return world, hands, body


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("strands", [1, 2, 3])
@pytest.mark.parametrize("mass", [0.05, 20.0])
def test_nothing_is_detected_again_at_rest(make_world, client, mass, strands, friction):
    """The mass alone would fall in a step by more than strands may miss their prediction."""
    world, hands, body = hung_over_a_pulley(make_world, client, mass, strands, 0.0015, friction)
    start = p.getBasePositionAndOrientation(body, client)[0]
    for _ in range(24):
        world.step()
        assert world.report.converged and not world.report.reasons
    np.testing.assert_allclose(p.getBasePositionAndOrientation(body, client)[0], start, atol=2e-5)
    if friction == 0:
        assert sum(np.linalg.norm(hand.force) for hand in hands) == pytest.approx(mass * G, rel=0.01)


@pytest.mark.parametrize("mass", [0.05, 0.2])
def test_jerky_steps_that_let_the_strands_go_slack_are_solved_whole(make_world, client, mass):
    """The hand stops in each fifth step: the tension falls to a hundredth, along all of the arc at once."""
    world, hands, _ = hung_over_a_pulley(make_world, client, mass, 2, 0.0015, 0.0, dt=1e-3)
    start = [np.array(hand.target) for hand in hands]
    for k in range(200):
        risen = 5e-5 * round(0.04e-3 * (k + 1) / 5e-5)
        for hand, at in zip(hands, start, strict=True):
            hand.target = at - [0, 0, risen]
        world.step()
        assert world.report.converged and "not_converged" not in world.report.reasons
        assert world.report.counts["linear_solves"] <= 40
