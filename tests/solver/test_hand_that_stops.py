"""A hand that stops at once leaves the segment beside it slack at the guess, with its tension to come."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import graft_passage
from bullet_tendon.scenarios.benchmarks.hand_record import RATE, hand_record
from bullet_tendon.scenarios.scene import Options

import bullet_tendon as bt


def test_jerky_steps_of_a_rigid_hand_are_solved_whole():
    """At 1 kHz a graft is led through bone by the steps of an encoder. No step has to be cut."""
    reasons, most = {}, 0
    with graft_passage.build(Options()) as scene:
        p.setTimeStep(1 / RATE, scene.client)
        h = scene.handles
        h.hand.release()
        grip = h.graft.grip(0)
        along, off = hand_record(h.arc[-1], 1)
        targets = off + np.column_stack([np.interp(along, h.arc, h.way[:, c]) for c in range(3)])
        for k, target in enumerate(targets[:2000]):
            h.graft.set_force(-1, graft_passage.held_back(h, k / RATE))
            grip.target = target
            scene.world.step()
            assert scene.world.report.converged
            most = max(most, scene.world.report.counts["linear_solves"])
            for why, count in scene.world.report.reasons.items():
                reasons[why] = reasons.get(why, 0) + count
    assert "not_converged" not in reasons
    assert most <= 30


@pytest.mark.parametrize("dt", [1e-3, 1 / 240])
def test_a_taut_tendon_whose_hand_stops_needs_no_more_than_when_it_starts(make_world, dt):
    world = make_world(gravity=(0, 0, 0), dt=dt)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 0.0035, bt.Material.preset("hamstring_graft"), 40)
    hand = t.grip(0)
    t.set_force(-1, [10.0, 0, 0])
    world.relax()
    solves = []
    for k in range(30):
        hand.target = np.array([-0.01 * dt * min(k, 20), 0, 0])
        world.step()
        solves.append(world.report.counts["linear_solves"])
    assert max(solves[20:]) <= max(solves[:20]) <= 2
    assert np.linalg.norm(hand.force) == pytest.approx(10.0, rel=1e-3)
