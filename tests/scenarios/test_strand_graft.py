"""A graft of four strands in a knee: passed, tensioned, fixed; balance of its forces on the bones."""

import numpy as np
import pytest
from bullet_tendon.scenarios.knee import KneeRig
from bullet_tendon.scenarios.strand_graft import BORE, StrandGraft

import bullet_tendon as bt

FLEXION = np.radians(20)


@pytest.fixture(scope="module")
def fixed():
    """A rig, its graft, and the tension before the screw."""
    with KneeRig() as rig:
        rig.cut("ACL")
        rig.flex(FLEXION)
        rig.settle()
        graft = StrandGraft(rig)
        unsolved = []
        graft.pass_through(lambda done: unsolved.append(not rig.world.report.converged))
        assert not any(unsolved)
        graft.pull(80.0)
        assert rig.come_to_rest()
        tension = graft.force
        pulled = [float(strand.tension[-1]) for strand in graft.bundle.strands]
        graft.fix()
        assert rig.come_to_rest()
        yield rig, graft, tension, pulled


def test_the_tensioner_tensions_all_strands_alike(fixed):
    _, _, tension, pulled = fixed
    assert pulled == pytest.approx([20.0] * 4, rel=0.01)  # at rest but for micrometres
    # Between the tunnels: friction of a capstan, of less than a right angle in all.
    assert 80 * np.exp(-0.05 * np.pi / 2) < tension < 80 * np.exp(0.05 * np.pi / 2)


def test_screw_and_button_hold_what_the_strands_pull(fixed):
    _, graft, _, _ = fixed
    assert not graft.tensioners
    # Along the bore: the lines to the button press the strands' ends together across it.
    mouth, cortex = graft.tunnels[1].ends
    axis = (cortex - mouth) / np.linalg.norm(cortex - mouth)
    held = sum(strand.holds[0].force for strand in graft.bundle.strands) @ axis
    first = [np.diff(strand.positions[:2], axis=0)[0] for strand in graft.bundle.strands]
    ways = [way / np.linalg.norm(way) for way in first]
    pulled = sum(s.tension[0] * way for s, way in zip(graft.bundle.strands, ways, strict=True)) @ axis
    assert held == pytest.approx(pulled, rel=1e-3)
    assert sum(screw.force for screw in graft.screws) > 0.5 * graft.force
    assert graft.shares.sum() == pytest.approx(1.0)


def test_the_strands_lie_in_both_tunnels_and_do_not_overlap(fixed):
    _, graft, _, _ = fixed
    radius = graft.bundle.strands[0].radius
    for tunnel in graft.tunnels:
        start, end = tunnel.ends
        axis = (end - start) / np.linalg.norm(end - start)
        for strand in graft.bundle.strands:
            held = [hold.particle for hold in strand.holds]  # anchors overrule contacts
            away = np.delete(strand.positions, held, axis=0) - start
            height = away @ axis
            oblique = 2 * BORE  # a mouth's rim is lower on one side
            inner = (height > oblique) & (height < (end - start) @ axis - oblique)
            beside = np.linalg.norm(away - np.outer(height, axis), axis=1)[inner]
            within = beside[beside < 2 * BORE]
            assert len(within) >= 1
            assert within.max() < BORE - radius + 0.05 * radius
    contacts = graft.rig.world.contacts
    assert contacts["distance"].min() > -0.05 * radius


def test_a_drawer_tightens_the_graft_and_leaves_it(fixed):
    rig, graft, _, _ = fixed
    slack, rested = graft.force, rig.coordinates.anterior
    for k in range(1, 13):
        rig.load(anterior=90.0 * k / 12)
        rig.step()
    assert rig.come_to_rest()
    assert graft.force > slack + 50
    assert 0.003 < rig.coordinates.anterior - rested < 0.010
    rig.load()
    assert rig.come_to_rest()
    assert rig.coordinates.anterior == pytest.approx(rested, abs=5e-4)


def test_settling_leaves_the_graft_whole(fixed):
    """`relax` may not find where they balance."""
    rig, graft, _, _ = fixed
    before = graft.force
    rig.settle(max_steps=2)
    assert graft.force == pytest.approx(before, rel=0.05)
    assert rig.come_to_rest()


@pytest.mark.parametrize("stiffness, least, most", [(1e7, 0.99, 1.01), (None, 0.6, 0.8)])
def test_the_screw_alone_takes_tension_when_the_tensioner_goes(stiffness, least, most):
    """A rigid screw keeps the tension. The published one yields by its load over its stiffness."""
    with KneeRig() as rig:
        rig.cut("ACL")
        rig.flex(FLEXION)
        rig.settle()
        graft = StrandGraft(rig)
        graft.pass_through()
        graft.pull(80.0)
        assert rig.come_to_rest()
        tension = graft.force
        screwed = [list(strand.positions) for strand in graft.bundle.strands]
        graft.fix(stiffness)
        axis = np.subtract(*graft.tunnels[0].ends[::-1])
        axis /= np.linalg.norm(axis)
        placed = rig.joints
        assert rig.come_to_rest()
        assert least * tension < graft.force < most * tension
        if stiffness is None:
            return
        for strand, screw, before in zip(graft.bundle.strands, graft.screws, screwed, strict=True):
            moved = [(strand.positions[k] - before[k]) @ axis for k in screw.particles]
            assert np.abs(moved).max() < 2e-5
        assert np.abs(rig.joints - placed)[[0, 1, 3]].max() < 2e-5


def test_what_cannot_be_a_graft_is_refused():
    with KneeRig() as rig:
        for bad in ({"radius": 0.0}, {"radius": float("nan")}, {"slope": -1.0}):
            with pytest.raises(bt.InvalidValue):
                StrandGraft(rig, **bad)
        assert not rig.world.tunnels and not rig.world.tendons
