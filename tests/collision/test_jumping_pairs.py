"""Pairs of segments whose nearest points jump from one end to the other within a step."""

import numpy as np
import pytest

import bullet_tendon as bt

RADIUS, SEGMENT, LOAD, UNEVEN = 0.002, 0.01, 0.02, 0.6
MATERIAL = bt.Material(stiffness=1e3, damping=1.0, friction=0.8)


def seesaw(world, angle):
    """One segment that lies aslant on a tendon that is held."""
    beam = world.add_tendon([(-0.03, 0, 0), (0.03, 0, 0)], RADIUS, MATERIAL, 7)
    for i in range(7):
        beam.grip(i)
    half = np.array([np.cos(angle), np.sin(angle), 0]) * SEGMENT / 2
    top = np.array([0, 0, 2 * RADIUS])
    return world.add_tendon([top - half, top + half], RADIUS, MATERIAL, 2)


def centre_of_pressure(contacts):
    force = contacts["normal_force"]
    return force @ contacts["position"][:, 0] / force.sum()


@pytest.mark.parametrize("angle", [0.18, 0.22, 0.3])
def test_a_seesaw_is_borne_at_either_end(make_world, angle):
    """Loaded now at one end, now at the other: the contact is there in the same step, and bears it all."""
    world = make_world()
    board = seesaw(world, angle)
    sides = []
    for k in range(60):
        for i, end in enumerate((-1, 1)):
            board.set_force(i, (0, 0, -LOAD / 2 * (1 + end * UNEVEN * (-1) ** k)))
        world.step()
        assert world.report.converged
        contacts = world.contacts
        assert contacts["distance"].min() > -2e-3 * RADIUS
        if k < 30:  # it settles in
            continue
        pushed = contacts["normal_force"] @ np.abs(contacts["normal"][:, 2])
        assert pushed == pytest.approx(LOAD, rel=0.1)  # friction on the sides bears the rest
        sides.append(centre_of_pressure(contacts))
    at, back = np.array(sides[::2]), np.array(sides[1::2])
    reach = UNEVEN * SEGMENT / 2  # where the loads' resultant is
    assert np.all((at > 0.8 * reach) & (at < 1.05 * reach))
    assert np.all((-back > 0.8 * reach) & (-back < 1.05 * reach))
