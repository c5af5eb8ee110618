"""Worlds and their handles are not copied: copy and pickle say what to use instead."""

import copy
import pickle

import pybullet as p
import pytest

import bullet_tendon as bt

ROPE = bt.Material(stiffness=3e3, damping=3.0)


@pytest.fixture
def parts(make_world, client):
    """A world, and one of each of its handles."""
    world = make_world()
    body = p.createMultiBody(0, physicsClientId=client)
    tunnel = world.add_tunnel(body, -1, [0, 0, 0], [0.1, 0, 0], 0.01, 0.1)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 0.002, ROPE, 11)
    return world, t, t.grip(0), t.attach(-1, body), tunnel


WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": pickle.dumps,
    "in a pickled list": lambda part: pickle.dumps([part], 2),
    "in a dict": lambda part: copy.deepcopy({"it": part}),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("which", range(5), ids=["world", "tendon", "grip", "attachment", "tunnel"])
def test_nothing_of_a_world_is_copied(parts, way, which):
    world, before = parts[0], parts[0].state_hash()
    with pytest.raises(bt.CannotCopy, match="snapshot") as caught:
        WAYS[way](parts[which])
    assert isinstance(caught.value, (bt.TendonError, TypeError))
    assert type(parts[which]).__name__ in str(caught.value)
    assert world.state_hash() == before
    world.step()


def test_values_are_copied(parts):
    world, t, *_ = parts
    world.step()
    for value in (t.material, world.options, t.positions, world.report, world.snapshot()):
        for way in (copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))):
            assert type(way(value)) is type(value)
    assert pickle.loads(pickle.dumps(ROPE)) == ROPE
