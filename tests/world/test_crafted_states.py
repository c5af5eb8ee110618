"""States that somebody made up: refused, or taken without harm, and never a crash."""

import contextlib
import struct

import numpy as np
import pybullet as p
import pytest
from state_scenes import build

import bullet_tendon as bt
from bullet_tendon import _core


@pytest.fixture
def world(client):
    world, _ = build(client, bodies=True)
    world.step(20)
    return world


def restored(world, data: bytes) -> bool:
    """Whether the core takes it."""
    try:
        world._core.restore(data)
    except RuntimeError:
        return False
    return True


@pytest.mark.parametrize("seed", range(4))
def test_changed_bytes(world, client, seed):
    """Single bytes and words changed: what is refused changes nothing, what is taken can be stepped."""
    random = np.random.default_rng(seed)
    good = world._core.save()
    refused = 0
    for _ in range(100):
        data = bytearray(good)
        at = int(random.integers(len(data)))
        width = int(random.choice([1, 4, 8]))
        value = [0, 1, 2**31 - 1, 2**63 - 1, 2**64 - 1, int(random.integers(2**62))][random.integers(6)]
        data[at : at + width] = value.to_bytes(8, "little")[:width]
        if not restored(world, bytes(data)):
            refused += 1
            assert world._core.save() == good
            continue
        with contextlib.suppress(RuntimeError, ValueError, TypeError):
            world._core.step(1 / 240, (0.0, 0.0, -9.81), False, None)
        world._core.contacts()
        assert restored(world, good)
    assert refused > 0


def tag(name: str) -> bytes:
    """What stands in a state before the field of that name (world/archive.h)."""
    value = 2166136261
    for byte in name.encode():
        value = (value ^ byte) * 16777619 % 2**32
    return value.to_bytes(4, "little")


@pytest.mark.parametrize(
    ("fields", "value"),
    [
        (("last_step", "dt"), -1.0),
        (("last_step", "dt"), np.nan),
        (("last_step", "dt", "gravity"), np.inf),
        (("model", "force"), np.nan),
        (("point_mass",), -1.0),
        (("rest",), 0.0),
    ],
)
def test_numbers_that_cannot_be(world, fields, value):
    """The first number of a field, in the order in which a state is written."""
    good = world._core.save()
    at = 0
    for name in fields:
        at = good.index(tag(name), at) + 4
    at += 0 if "last_step" in fields else 8  # the length of a list comes first
    data = bytearray(good)
    data[at : at + 8] = np.float64(value).tobytes()
    assert not restored(world, bytes(data))
    assert world._core.save() == good


def test_an_observer_of_more_coordinates_than_its_body_has(world):
    good = world._core.save()
    at = good.index(tag("n_") + (6).to_bytes(4, "little"), good.index(tag("observer"))) + 4
    for count in (-1, 3, 7, 1000):
        data = bytearray(good)
        data[at : at + 4] = count.to_bytes(4, "little", signed=True)
        assert not restored(world, bytes(data))
        assert world._core.save() == good


@pytest.mark.parametrize(("field", "slot"), [("segment", 10), ("segment", -1), ("tunnel", 1), ("tunnel", -1)])
def test_a_segment_or_a_tunnel_that_is_not_there(client, field, slot):
    """Of a cord with ten segments, the fifth of which runs through the only tunnel."""
    world = bt.TendonWorld(client)
    bead = p.createMultiBody(0, physicsClientId=client)
    world.add_tunnel(bead, -1, (-0.01, 0, 0), (0.01, 0, 0), 0.01)
    world.add_tendon([(-0.45, 0, 0), (0.55, 0, 0)], 0.005, bt.Material(stiffness=1e3), 11)
    world.step()
    good = world._core.save()
    at = good.index(tag("threaded")) + 4
    assert good[at : at + 24] == struct.pack("<Q4sI4sI", 1, tag("segment"), 4, tag("tunnel"), 0)
    data = bytearray(good)
    at = good.index(tag(field), at) + 4
    data[at : at + 4] = slot.to_bytes(4, "little", signed=True)
    assert not restored(world, bytes(data))
    assert world._core.save() == good


@pytest.mark.parametrize("part", ["contacts", "memory"])
@pytest.mark.parametrize(
    ("field", "value"),
    [("kind", 4), ("kind", -1), ("tendon", 1), ("feature", 21), ("other", 1), ("other", -1)],
)
def test_a_contact_with_what_is_not_there(client, part, field, value):
    """A rope of eleven particles on the only obstacle, with an index past the last or before the first."""
    world = bt.TendonWorld(client)
    half = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 0.1], physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, half, physicsClientId=client))
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    world.add_tendon([(-0.5, 0, 0.105), (0.5, 0, 0.105)], 0.005, bt.Material(stiffness=1e3), 11)
    world.step(5)
    good = world._core.save()
    data = bytearray(good)
    at = good.index(tag("key") + tag("kind"), good.index(tag(part)))
    at = good.index(tag(field), at) + 4
    data[at : at + 4] = value.to_bytes(4, "little", signed=True)
    assert not restored(world, bytes(data))
    assert world._core.save() == good


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.999])
def test_cut_off(world, share):
    good = world._core.save()
    assert not restored(world, good[: int(share * len(good))])
    assert not restored(world, good + b"\0")
    assert world._core.save() == good


def test_of_another_world(world, client):
    """The same bytes in a world of other parts."""
    good = world._core.save()
    other = _core.World()
    with pytest.raises(RuntimeError, match="same parts"):
        other.restore(good)
    world.add_tendon([[5, 0, 0], [6, 0, 0]], 0.01, bt.Material(stiffness=1e4), 5)
    with pytest.raises(RuntimeError, match="same parts"):
        world._core.restore(good)


def test_saved_is_restored_whole(world, client):
    """Save, step, restore, save: the same bytes."""
    good = world._core.save()
    saved = p.saveState(client)
    world.step(3)
    p.restoreState(saved, physicsClientId=client)
    world._core.restore(good)
    assert world._core.save() == good


@pytest.mark.parametrize("pair", [-1.0, np.nan, 1e300])
def test_a_pair_of_links_that_cannot_be(client, make_world, pair):
    """Friction of a box with a hinge, seven rates, which stands on a floor: a row ends with its pair."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1] * 3, physicsClientId=client)
    floor = p.createMultiBody(0, shape, basePosition=(0, 0, -0.1), physicsClientId=client)
    link = {
        "linkMasses": [0.1],
        "linkCollisionShapeIndices": [-1],
        "linkVisualShapeIndices": [-1],
        "linkPositions": [(0, 0, 0.2)],
        "linkOrientations": [(0, 0, 0, 1)],
        "linkInertialFramePositions": [(0, 0, 0)],
        "linkInertialFrameOrientations": [(0, 0, 0, 1)],
        "linkParentIndices": [0],
        "linkJointTypes": [p.JOINT_REVOLUTE],
        "linkJointAxis": [(0, 1, 0)],
    }
    box = p.createMultiBody(1, shape, basePosition=(0, 0, 0.1), **link, physicsClientId=client)
    p.setJointMotorControl2(box, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    for body in (floor, box):
        p.changeDynamics(body, -1, lateralFriction=1, physicsClientId=client)
    world = make_world(1 / 240, (0, 0, -9.81))
    cord = world.add_tendon([(0, 0, 0.3), (0.3, 0, 0.3)], 1e-3, bt.Material(stiffness=1e3), 4)
    cord.attach(0, box)
    cord.grip(-1)
    world.step(20)
    good = world._core.save()
    at = good.index(tag("frictions")) + 4
    (length,) = struct.unpack_from("<Q", good, at)
    assert length and length % 10 == 0
    data = bytearray(good)
    struct.pack_into("<d", data, at + 8 + 8 * 9, pair)
    assert not restored(world, bytes(data))
    assert world._core.save() == good
