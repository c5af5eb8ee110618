"""save_state, restore_state, snapshots: to the bit, and refused where they do not fit."""

import hashlib
import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from state_scenes import build, disturb, run_from

import bullet_tendon as bt
from bullet_tendon import states


@pytest.mark.parametrize(
    ("options", "bodies"),
    [
        ({}, True),
        ({"integrator": "bdf2"}, True),
        ({"bone_contact": "constraint"}, False),
        ({"linear_solver": "pcg"}, False),
    ],
)
def test_a_restored_run_has_the_same_bits(client, options, bodies):
    world, _ = build(client, bodies, **options)
    world.step(20)
    state, bullet = world.save_state(), p.saveState(client)
    before = world.state_hash()
    world.step(30)
    first = world.state_hash()
    disturb(world)
    world.restore_state(state)
    p.restoreState(bullet, physicsClientId=client)
    assert world.state_hash() == before
    world.step(30)
    assert world.state_hash() == first


def test_reading_out_changes_nothing(client):
    world, tendons = build(client, bodies=True)
    for _ in range(100):
        world.step()
        if len(world.contacts):
            break
    before = world.state_hash()
    for t in tendons:
        assert np.isfinite(t.tension).all()
        assert np.isfinite([t.energy, t.length, *t.strain]).all()
    assert len(world.contacts)
    assert world.state_hash() == before


@pytest.mark.parametrize("bodies", [False, True])
def test_a_snapshot_goes_on_with_the_same_bits_in_another_process(client, tmp_path, bodies):
    world, _ = build(client, bodies)
    world.step(20)
    world.snapshot(tmp_path / "state.npz")
    p.saveBullet(str(tmp_path / "state.bullet"), physicsClientId=client)
    # pybullet itself goes on with other bits after a file: both runs start from it.
    p.restoreState(fileName=str(tmp_path / "state.bullet"), physicsClientId=client)
    world.step(50)
    command = f"import state_scenes; print(state_scenes.run_from({str(tmp_path)!r}, {bodies}, 50))"
    other = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, cwd="tests")
    assert other.stdout.split()[-1:] == [world.state_hash()], other.stderr


def test_restoring_in_the_same_process_from_a_snapshot(client):
    world, _ = build(client, bodies=False)
    world.step(20)
    data = world.snapshot()
    before = world.state_hash()
    world.step(20)
    world.load_snapshot(data)
    assert world.state_hash() == before


def test_holds_follow_a_restore(client):
    world, (t, *_) = build(client, bodies=True)
    t.grip(3, stiffness=200.0)
    kept = t.grip(5, target=(0.1, 0.0, 0.2))
    world.step(3)
    state = world.save_state()
    kept.target = (9.0, 9.0, 9.0)
    kept.release()
    later = t.grip(7)
    t.shorten(0.01)
    t.set_force(8, (0, 0, 1))
    length = t.rest_length
    world.restore_state(state)
    assert later.released
    assert not kept.released
    assert kept in t.holds
    np.testing.assert_array_equal(kept.target, (0.1, 0.0, 0.2))
    assert t.rest_length == pytest.approx(length + 0.01)
    t.grip(7)
    kept.release()
    world.step(3)


def test_refused_where_the_world_is_made_of_other_parts(client):
    world, (t, *_) = build(client, bodies=True)
    state, data = world.save_state(), world.snapshot()
    extra = world.add_tendon([[5, 0, 0], [6, 0, 0]], 0.01, bt.Material(stiffness=1e4), 5)
    before = world.state_hash()
    for restore in (lambda: world.restore_state(state), lambda: world.load_snapshot(data)):
        with pytest.raises(bt.StateMismatch, match="tendons"):
            restore()
        assert world.state_hash() == before
    world.remove_tendon(extra)
    world.restore_state(state)
    world.remove_tendon(t)
    same_name = world.add_tendon([[5, 0, 0], [6, 0, 0]], 0.01, bt.Material(stiffness=1e4), 5, name=t.name)
    with pytest.raises(bt.StateMismatch):
        world.restore_state(state)
    assert not same_name.removed


def test_refused_where_a_body_is_gone(client):
    world, (t, *_) = build(client, bodies=True)
    hold = next(h for h in t.holds if isinstance(h, bt.Attachment))
    state = world.save_state()
    hold.release()
    p.removeBody(hold.bodyUniqueId, client)
    world.step()
    with pytest.raises(bt.StateMismatch, match="still there"):
        world.restore_state(state)
    world.step()


def test_states_are_known_by_their_ids(client):
    world, _ = build(client, bodies=False)
    state = world.save_state()
    world.remove_state(state)
    for call in (world.restore_state, world.remove_state):
        with pytest.raises(bt.UnknownId):
            call(state)
        with pytest.raises(bt.InvalidType):
            call("1")


def _changed(data: bytes, **arrays) -> bytes:
    with np.load(io.BytesIO(data)) as file:
        content = {**dict(file), **arrays}
    out = io.BytesIO()
    np.savez(out, **{k: v for k, v in content.items() if v is not None})
    return out.getvalue()


def test_snapshots_are_checked_when_read(client, tmp_path):
    world, _ = build(client, bodies=False)
    world.step(5)
    data = world.snapshot()
    before = world.state_hash()
    bad = {
        "not a file": tmp_path / "missing.npz",
        "empty": b"",
        "no zip": b"PK nothing of the kind",
        "cut off": data[: len(data) // 2],
        "version": _changed(data, version=np.array(99)),
        "without an array": _changed(data, core=None),
        "of another shape": _changed(data, hold_numbers=np.zeros((3, 2))),
        "of another kind": _changed(data, core=np.zeros(10)),
        "damaged": _changed(data, core=np.zeros(10, np.uint8)),
        "pickled": _changed(data, tendons=np.array([None], dtype=object)),
    }
    for what, source in bad.items():
        with pytest.raises(bt.SnapshotError):
            world.load_snapshot(source)
        assert world.state_hash() == before, what
    for source in (None, 3):
        with pytest.raises(bt.InvalidType):
            world.load_snapshot(source)
        with pytest.raises(bt.InvalidType):
            world.snapshot(source if source else 3)


def pulled_once(client):
    """A ball on a tendon, pulled at for one step so hard that the next one solves that step again."""
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    p.setTimeStep(1 / 240, physicsClientId=client)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    body = p.createMultiBody(0.2, ball, basePosition=(0, 0, -0.08), physicsClientId=client)
    world = bt.TendonWorld(client)
    t = world.add_tendon([(0, 0, 0), (0, 0, -0.08)], 0.001, bt.Material(stiffness=2e5), 8)
    t.grip(0)
    t.attach(-1, body)
    world.step(100)
    place = p.getBasePositionAndOrientation(body, client)[0]
    p.applyExternalForce(body, -1, (0, 30, -200), place, p.WORLD_FRAME, client)
    world.step()
    return world, body


def after_a_step(world, body):
    """Everything of a tendon and a body, one step later."""
    world.step()
    places = *p.getBasePositionAndOrientation(body, world.physicsClientId), *world.tendons[0].positions
    return np.concatenate([*places, *p.getBaseVelocity(body, world.physicsClientId)])


def test_a_fresh_world_solves_the_snapshots_last_step_again(client, tmp_path):
    world, body = pulled_once(client)
    world.snapshot(tmp_path / "state.npz")
    p.saveBullet(str(tmp_path / "state.bullet"), physicsClientId=client)
    other = p.connect(p.DIRECT)
    fresh, its_body = pulled_once(other)
    fresh = bt.TendonWorld(other)
    t = fresh.add_tendon([(0, 0, 0), (0, 0, -0.08)], 0.001, bt.Material(stiffness=2e5), 8)
    t.grip(0)
    t.attach(-1, its_body)
    fresh.load_snapshot(tmp_path / "state.npz")
    for number in (client, other):  # pybullet itself goes on with other bits after a file
        p.restoreState(fileName=str(tmp_path / "state.bullet"), physicsClientId=number)
    expected = after_a_step(world, body)
    assert np.linalg.norm(expected[-6:-3]) < 1.0  # it was pulled back, not shot away
    np.testing.assert_array_equal(after_a_step(fresh, its_body), expected)
    p.disconnect(other)


def test_the_last_steps_length_and_gravity_are_restored(client):
    """With them that step is solved again, whatever steps were taken between saving and restoring."""
    world, body = pulled_once(client)
    state, bullet = world.save_state(), p.saveState(client)
    found = []
    for dt, gravity in ((1 / 240, (0, 0, -9.81)), (1 / 1000, (5, 0, 9.81))):
        p.setTimeStep(dt, physicsClientId=client)
        p.setGravity(*gravity, physicsClientId=client)
        world.step(3)
        p.setTimeStep(1 / 240, physicsClientId=client)
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        world.restore_state(state)
        p.restoreState(bullet, physicsClientId=client)
        found.append(after_a_step(world, body))
    np.testing.assert_array_equal(found[0], found[1])


def test_masses_set_after_a_step_are_kept_where_that_is_solved_again(client):
    world, _ = pulled_once(client)
    (t,) = world.tendons
    t.set_point_mass(3, 0.01)
    masses = t.masses
    world.step()
    np.testing.assert_array_equal(t.masses, masses)


def crafted(data: bytes, **arrays) -> bytes:
    """A snapshot of other arrays, with the digest that fits them."""
    with np.load(io.BytesIO(data)) as file:
        content = {k: v for k, v in {**dict(file), **arrays}.items() if k != "digest"}
    out = io.BytesIO()
    np.savez(out, **content, digest=states.digest_of(content))
    return out.getvalue()


def set_to(array, index, value):
    array = np.array(array)
    array[index] = value
    return array


# What is put where: array, index, value. In the scene, holds are of a soft grip, a rigid one and two bodies.
CRAFTED = [
    ("links", (0, 0), -5),
    ("links", (0, 0), 10**12),
    ("links", (0, 1), 4),
    ("links", (slice(None), 0), 1),
    ("hold_places", (0, 0), 7),
    ("hold_places", (0, 0), -1),
    ("hold_places", (0, 1), 10**6),
    ("hold_places", (0, 1), -1),
    ("hold_places", (0, 2), 2),
    ("hold_places", (0, 2), 1),
    ("hold_places", (0, 3), 0),
    ("hold_places", (0, 3), 999),
    ("hold_places", (0, 3), 2**40),
    ("hold_places", (slice(None), 3), 1),
    ("hold_places", (slice(None), slice(0, 2)), 1),
    ("hold_places", (0, 4), 0),
    ("hold_places", (1, 4), 99),
    ("hold_places", (1, 5), 3),
    ("hold_numbers", (0, 0), np.nan),
    ("hold_numbers", (1, 2), np.inf),
    ("hold_numbers", (0, 3), -1.0),
    ("hold_numbers", (0, 3), np.inf),
    ("hold_numbers", (0, 4), np.nan),
    ("hold_numbers", (0, 4), -1.0),
    ("hold_numbers", (0, 5), 1.0),
    ("hold_numbers", (0, slice(5, 8)), 1.0),
    ("hold_numbers", (0, 8), 0.0),
    ("hold_numbers", (0, 8), np.inf),
]


def test_crafted_tables_are_refused(client):
    """With a digest that fits: nothing of them is believed, and nothing has changed."""
    world, _ = build(client, bodies=True)
    world.step(3)
    data, before = world.snapshot(), world.state_hash()
    with np.load(io.BytesIO(data)) as file:
        arrays = dict(file)
    bad = [(name, set_to(arrays[name], index, value)) for name, index, value in CRAFTED]
    for name in ("tendons", "tendon_slots", "tunnels", "links", "hold_places", "hold_numbers"):
        bad += [(name, arrays[name][:-1]), (name, np.concatenate([arrays[name], arrays[name][-1:]]))]
    for name, kind in (("core", np.uint16), ("hold_places", float)):
        bad.append((name, arrays[name][: 2 * (len(arrays[name]) // 2)].astype(kind)))
    for name, array in bad:
        with pytest.raises((bt.SnapshotError, bt.StateMismatch)):
            world.load_snapshot(crafted(data, **{name: array}))
        assert world.state_hash() == before, (name, array)
    world.load_snapshot(crafted(data))
    assert world.state_hash() == before
    world.step(3)


def test_the_version_is_raised_where_the_core_keeps_other_fields():
    """Where this fails: raise states.VERSION, and set both here."""
    fields = Path(__file__).parents[2] / "bullet_tendon" / "core" / "world" / "state_fields.h"
    found = re.findall(r"BT_FIELDS\(([^)]*)\)", fields.read_text())
    digest = hashlib.sha256("\n".join(" ".join(struct.split()) for struct in found).encode()).hexdigest()
    assert (states.VERSION, digest[:16]) == (42, "2ecdb693ab81b203")


def test_snapshots_of_another_version_are_refused_by_its_number(client):
    world, _ = build(client, bodies=False)
    data = crafted(world.snapshot(), version=np.array(1))
    with pytest.raises(bt.SnapshotError, match=r"of version \d+, not 1"):
        world.load_snapshot(data)


def test_run_from_is_what_the_other_process_runs():
    assert callable(run_from)
