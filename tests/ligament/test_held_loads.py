"""Bodies that are held under loads that would move them far in a step, near to a tendon."""

import pybullet as p
import pytest

import bullet_tendon as bt

HALF, RADIUS = 0.01, 0.002  # m: of the block's height, and of the tendon


def hung_above_a_tendon(make_world, client, load, gap, on_strand):
    """A world, a block, its step, how to cut what holds it, and a taut tendon.

    The block hangs on a strand, or on a strong and a weak ligament."""
    world = make_world(1 / 240, (0, 0, 0))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.02, HALF], physicsClientId=client)
    top = p.createMultiBody(0, -1, -1, (0, 0, 0.2), physicsClientId=client)
    block = p.createMultiBody(0.1, shape, physicsClientId=client)
    world.add_obstacle(block)
    height = -HALF - RADIUS - gap
    tendon = world.add_tendon(
        [(-0.1, 0, height), (0.1, 0, height)], RADIUS, bt.Material(stiffness=5e4, damping=20.0), 41
    )
    tendon.grip(0)
    tendon.grip(-1)
    if on_strand:
        path = [(0, 0, 0.2), (0, 0, HALF)]
        strand = world.add_tendon(path, RADIUS, bt.Material(stiffness=1e5, damping=20.0), 21)
        strand.grip(0)
        strand.attach(-1, block, -1, (0, 0, HALF))
    else:
        strong, weak = (
            world.add_ligament(
                [(top, -1, (0, 0, 0)), (block, -1, (0, 0, 0))], bt.Material(stiffness=k, exponent=1)
            )
            for k in (1e5, 1.0)
        )

    def cut():
        world.remove_tendon(strand) if on_strand else world.remove_ligament(strong)

    def step():
        where = p.getBasePositionAndOrientation(block, client)[0]
        world.apply_external_force(block, -1, (0, 0, -load), where, p.WORLD_FRAME)
        world.step()
        return p.getBasePositionAndOrientation(block, client)[0][2]

    for _ in range(120):
        step()
    return world, step, cut, tendon


@pytest.mark.parametrize("on_strand", [False, True])
@pytest.mark.parametrize("load", [100.0, 1000.0])
def test_a_load_that_is_held_divides_no_step(make_world, client, load, on_strand):
    """Alone, it would move the block by 17 or 170 mm in a step. It moves by nothing."""
    world, step, _, _ = hung_above_a_tendon(make_world, client, load, 0.004, on_strand)
    for _ in range(5):
        step()
        assert world.report.counts["substeps"] == 1
        assert world.report.iterations <= 1 and not world.report.reasons
    assert len(world.contacts) == 0


@pytest.mark.parametrize("on_strand", [False, True])
@pytest.mark.parametrize("load", [20.0, 100.0, 1000.0])
def test_what_is_cut_off_falls_on_the_tendon(make_world, client, load, on_strand):
    world, step, cut, tendon = hung_above_a_tendon(make_world, client, load, 0.004, on_strand)
    cut()
    for _ in range(30):
        height = step()
        assert world.report.converged
        assert height - tendon.positions[20, 2] > HALF + 0.9 * RADIUS
    assert height - tendon.positions[20, 2] < HALF + 1.1 * RADIUS
