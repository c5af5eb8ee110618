"""Recorder: frames are what the world was at that moment, cost memory as told, and disturb nothing."""

import dataclasses

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon import errors
from bullet_tendon.recording import CONTACTS

ROPE = bt.Material(stiffness=1e4, damping=1.0, friction=0.3)


def laid_over_a_box(make_world):
    """A world whose tendon falls onto a box and pulls a ball that it is attached to."""
    world = make_world(1 / 240, (0, 0, -9.81))
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.02, 0.02], physicsClientId=client)
    box = p.createMultiBody(0, shape, basePosition=(0, 0, -0.03), physicsClientId=client)
    world.add_obstacle(box)
    tendon = world.add_tendon([(-0.06, 0, 0), (0.06, 0, 0)], 0.004, ROPE, particles=25, name="rope")
    ball = p.createMultiBody(
        0.1,
        p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client),
        basePosition=(0.06, 0, -0.01),
        baseInertialFramePosition=(0.0, 0.0, 0.002),
        physicsClientId=client,
    )
    tendon.grip(0)
    tendon.attach(-1, ball)
    return world, tendon, box, ball


def test_frames_are_what_the_world_was(make_world):
    world, tendon, box, ball = laid_over_a_box(make_world)
    seen = []
    recorder = bt.Recorder(world, every=5)
    for k in range(61):
        if k % 5 == 0:
            place = world._bodies.frame(ball, -1)[0]
            forces = [hold.force for hold in tendon.holds]
            seen.append((tendon.positions, tendon.tension, tendon.energy, place, world.contacts, forces))
        world.step()
    found = recorder.recording
    assert len(found) == len(recorder) == 13
    np.testing.assert_allclose(found.times, np.arange(13) * 5 / 240, atol=1e-12)
    np.testing.assert_array_equal(found.steps, np.arange(13) * 5)
    track = found.tendon("rope")
    moved = next(t for t in found.links if t.bodyUniqueId == ball)
    holds = found.holds
    for k, (x, tension, energy, place, contacts, forces) in enumerate(seen):
        np.testing.assert_array_equal(track.positions[k], x.astype(np.float32))
        np.testing.assert_array_equal(track.tension[k], tension.astype(np.float32))
        assert track.energy[k] == energy
        np.testing.assert_allclose(moved.position[k], place, atol=1e-7)
        rows = found.contacts[found.contacts["frame"] == k]
        assert len(rows) == len(contacts)
        for field in set(CONTACTS.names) - {"frame", "tendon"}:
            np.testing.assert_array_equal(rows[field], contacts[field].astype(CONTACTS[field].base))
        np.testing.assert_allclose(holds["force"][holds["frame"] == k], forces, rtol=1e-6)
    assert (found.contacts["normal_force"] > 0).any()
    assert set(holds["bodyUniqueId"].tolist()) == {-1, ball}
    total = found.body_forces()[box, -1]
    assert total[-1] == pytest.approx(world_normal_force(seen[-1][4]), rel=1e-5)


def world_normal_force(contacts) -> float:
    return float(contacts["normal_force"].sum())


def pendulum(world):
    """A fixed base with two hinged links, of which the last one hangs on a tendon."""
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.005, physicsClientId=client)
    body = p.createMultiBody(
        0,
        shape,
        basePosition=(0.3, 0, 0),
        linkMasses=[0.1, 0.1],
        linkCollisionShapeIndices=[shape, shape],
        linkVisualShapeIndices=[-1, -1],
        linkPositions=[(0.03, 0, 0), (0.05, 0, 0)],
        linkOrientations=[(0, 0, 0, 1)] * 2,
        linkInertialFramePositions=[(0.01, 0, 0.002)] * 2,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2,
        linkParentIndices=[0, 1],
        linkJointTypes=[p.JOINT_REVOLUTE] * 2,
        linkJointAxis=[(0, 1, 0)] * 2,
        physicsClientId=client,
    )
    for joint in range(2):  # without friction of the motors
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    held = world.add_tendon([(0.38, 0, 0.1), (0.38, 0, 0)], 0.002, ROPE, particles=8)
    held.grip(0)
    held.attach(-1, body, 1)
    return body


def test_poses_are_those_after_the_step_whatever_moves_the_bodies(make_world):
    """Bases that stand, are led by their velocity, or are put elsewhere between steps and before frames."""
    world, _, box, ball = laid_over_a_box(make_world)
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    led = p.createMultiBody(0, shape, basePosition=(0.2, 0, 0), physicsClientId=client)
    world.add_obstacle(led)
    arm = pendulum(world)
    p.resetBaseVelocity(led, (0.1, 0, 0), physicsClientId=client)
    recorder, seen = bt.Recorder(world, every=1), []

    def look():
        poses = [p.getBasePositionAndOrientation(body, client)[0] for body in (box, led, arm)]
        poses += [state[4] for state in p.getLinkStates(arm, (0, 1), 0, 1, client)]
        seen.append(np.array(poses, np.float32))

    look()
    waits = False  # whether the frame of the last step is kept when the next one begins
    for k in range(24):
        if k % 5 == 3:
            p.resetBasePositionAndOrientation(box, (0, 0, -0.03 - 1e-4 * k), (0, 0, 0, 1), client)
        if k % 6 == 3:
            p.resetBasePositionAndOrientation(arm, (0.3, 1e-4 * k, 0), (0, 0, 0, 1), client)
        if k == 12:
            p.resetBaseVelocity(led, (0, 0, 0), physicsClientId=client)
        if waits:
            look()
        waits = k % 2 == 0
        if waits:
            world.apply()
            p.stepSimulation(client)
        else:
            world.step()
            look()
    found = recorder.recording
    tracks = {(track.bodyUniqueId, track.linkIndex): track for track in found.links}
    wanted = (box, -1), (led, -1), (arm, -1), (arm, 0), (arm, 1)
    assert len(seen) == len(found) == 25
    for key, places in zip(wanted, np.swapaxes(seen, 0, 1), strict=True):
        np.testing.assert_array_equal(tracks[key].position, places)
        assert len(np.unique(places, axis=0)) > 4


def test_steps_by_apply_are_counted_when_the_script_has_stepped(make_world):
    world, tendon, *_ = laid_over_a_box(make_world)
    recorder = bt.Recorder(world, every=3)
    places = [tendon.positions]
    for k in range(9):
        world.apply()
        p.stepSimulation(world.physicsClientId)
        if k % 3 == 2:
            places.append(tendon.positions)
    found = recorder.recording
    np.testing.assert_array_equal(found.steps, [0, 3, 6, 9])
    np.testing.assert_array_equal(found.tendons[0].positions, np.array(places, np.float32))


def test_a_step_applied_before_it_began_is_not_counted(make_world):
    world = make_world()
    client = world.physicsClientId
    tendon = world.add_tendon([(0, 0, 0), (0, 0, 0.1)], 0.002, bt.Material(stiffness=1e3), 3)
    tendon.set_force(-1, (0, 0, 1))
    heights = []

    def step():
        world.apply()
        p.stepSimulation(client)
        heights.append(tendon.positions[-1, 2])

    step()
    recorder = bt.Recorder(world, every=1)
    step()
    step()
    recording = recorder.recording
    np.testing.assert_array_equal(recording.steps, [0, 1, 2])
    np.testing.assert_allclose(recording.tendons[0].positions[:, -1, 2], heights, rtol=1e-6)


@pytest.mark.parametrize("value", [float("nan"), "text"])
def test_a_recorder_that_is_refused_records_nothing(make_world, value):
    world = make_world()
    with pytest.raises(bt.TendonError, match="pull"):
        bt.Recorder(world, every=1, scalars={"pull": lambda: value})
    world.step()


def test_a_scalar_that_raises_leaves_other_recordings_as_they_are(make_world):
    world = make_world()
    values = iter([0.0, 1.0, float("nan"), 3.0])
    first = bt.Recorder(world, every=1, scalars={"pull": lambda: next(values)})
    second = bt.Recorder(world, every=1)
    world.step()
    with pytest.raises(bt.InvalidValue, match="pull"):
        world.step()
    world.step()
    np.testing.assert_array_equal(first.recording.steps, [0, 1, 3])
    np.testing.assert_array_equal(second.recording.steps, [0, 1, 2, 3])


def test_a_recorder_disturbs_nothing():
    def run(recorded):
        client = p.connect(p.DIRECT)
        world = laid_over_a_box(lambda dt, gravity: world_in(client, dt, gravity))[0]
        recorder = bt.Recorder(world, every=1) if recorded else None
        world.step(60)
        assert recorder is None or len(recorder) == 61
        found = world.state_hash(), p.getNumBodies(client)
        p.disconnect(client)
        return found

    assert run(True) == run(False)


def world_in(client, dt, gravity):
    p.setTimeStep(dt, physicsClientId=client)
    p.setGravity(*gravity, physicsClientId=client)
    return bt.TendonWorld(client)


def test_frames_on_request_with_scalars(make_world):
    world, tendon, *_ = laid_over_a_box(make_world)
    recorder = bt.Recorder(world, scalars={"length": lambda: tendon.length})
    recorder.frame(pull=1.0)
    world.step(7)
    recorder.frame()
    world.step()
    recorder.frame(pull=3.0)
    recorder.frame(push=4.0)  # of the same moment: one frame
    found = recorder.recording
    np.testing.assert_array_equal(found.steps, [0, 7, 8])
    times, pulls = found.scalar("pull")
    np.testing.assert_allclose(times, [0, 8 / 240])
    np.testing.assert_array_equal(pulls, [1.0, 3.0])
    np.testing.assert_array_equal(found.scalar("push")[1], [4.0])
    assert len(found.scalar("length")[1]) == 3
    with pytest.raises(errors.UnknownId, match="pul"):
        found.scalar("pul")
    with pytest.raises(errors.InvalidValue, match="pull"):
        recorder.frame(pull=np.nan)


def test_memory_is_bounded_and_the_whole_run_is_covered(make_world):
    world, *_ = laid_over_a_box(make_world)
    recorder = bt.Recorder(world, every=1, memory=1e6, most_frames=40)
    world.step(300)
    found = recorder.recording
    assert 20 <= len(found) <= 40
    assert found.steps[0] == 0 and found.steps[-1] > 300 - recorder.every
    assert set(np.diff(found.steps)) == {recorder.every} == {8}
    large = bt.Recorder(world, every=1, memory=1e6)
    world.step(1800)
    assert large._bytes <= 1e6
    assert len(large) < 1800


def test_thinned_frames_are_those_that_were_kept(make_world):
    world, *_ = laid_over_a_box(make_world)
    whole, thinned = bt.Recorder(world, every=1), bt.Recorder(world, every=1, most_frames=10)
    world.step(100)
    whole, thinned = whole.recording, thinned.recording
    rows = thinned.steps
    np.testing.assert_array_equal(thinned.tendons[0].positions, whole.tendons[0].positions[rows])
    for few, all_of_them in zip(thinned.links, whole.links, strict=True):
        np.testing.assert_array_equal(few.position, all_of_them.position[rows])
    for frame, step in enumerate(rows):
        found = [r.contacts[r.contacts["frame"] == k] for r, k in ((thinned, frame), (whole, step))]
        np.testing.assert_array_equal(found[0]["position"], found[1]["position"])


def test_frames_of_the_same_moment_take_no_more_memory(make_world):
    world, tendon, *_ = laid_over_a_box(make_world)
    recorder = bt.Recorder(world, memory=1e6)
    world.step()
    recorder.frame(k=0)
    end = recorder._kept._end
    for k in range(20):
        recorder.frame(k=k)
    assert recorder._kept._end == end
    np.testing.assert_array_equal(recorder.recording.tendons[0].positions[0], tendon.positions.astype("f4"))


def test_tendons_and_bodies_that_come_and_go(make_world):
    world, tendon, box, ball = laid_over_a_box(make_world)
    client = world.physicsClientId
    recorder = bt.Recorder(world, every=1)
    world.step(2)
    other = world.add_tendon([(0, 0.1, 0), (0, 0.1, 0.05)], 0.002, ROPE, particles=4, name="other")
    shape = p.createVisualShape(p.GEOM_BOX, halfExtents=[0.01, 0.02, 0.03], physicsClientId=client)
    block = p.createMultiBody(0, -1, shape, (0.3, 0, 0), physicsClientId=client)
    world.step(2)
    world.remove_tendon(other)
    p.removeBody(block, client)
    world.step(2)
    recorder.stop()
    recorder.stop()
    world.step(2)
    found = recorder.recording
    assert len(found) == 7
    np.testing.assert_array_equal(found.tendon("other").frames, [3, 4])
    np.testing.assert_array_equal(found.tendon("rope").frames, range(7))
    track = next(t for t in found.links if t.bodyUniqueId == block)
    np.testing.assert_array_equal(track.frames, [3, 4])
    np.testing.assert_allclose(np.ptp(track.meshes[0].vertices, axis=0), [0.02, 0.04, 0.06], rtol=1e-6)
    assert found.bones == ()
    with pytest.raises(errors.UnknownId, match="nobody"):
        found.tendon("nobody")


@pytest.mark.parametrize("frame_between", [True, False])
def test_another_body_of_the_same_id_is_another_track(make_world, frame_between):
    world = make_world()
    client = world.physicsClientId
    recorder = bt.Recorder(world, every=1)
    for half in (0.01, 0.02):
        shape = p.createVisualShape(p.GEOM_BOX, halfExtents=[half] * 3, physicsClientId=client)
        body = p.createMultiBody(0, -1, shape, (half, 0, 0), physicsClientId=client)
        world.step(2)
        recorder.frame()  # reads where the bodies are, before one of them is gone
        p.removeBody(body, client)
        if frame_between:
            world.step()
    tracks = recorder.recording.links
    assert [track.bodyUniqueId for track in tracks] == [0, 0]
    for track, half, first in zip(tracks, (0.01, 0.02), (1, 4 if frame_between else 3), strict=True):
        np.testing.assert_array_equal(track.frames, [first, first + 1])
        np.testing.assert_allclose(track.position, [[half, 0, 0]] * 2, atol=1e-9)
        np.testing.assert_allclose(np.ptp(track.meshes[0].vertices, axis=0), 2 * half, rtol=1e-6)


def test_a_body_that_steps_no_longer_read_is_known_from_its_successor(make_world):
    world = make_world()
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    bodies = [p.createMultiBody(0, shape, basePosition=(x, 0, 0), physicsClientId=client) for x in (0.0, 0.1)]
    for body in bodies:
        world.add_obstacle(body)
    recorder = bt.Recorder(world, every=1)
    world.step()
    world.remove_obstacle(bodies[1])
    world.step()
    p.removeBody(bodies[1], client)
    again = p.createMultiBody(0, shape, basePosition=(0.2, 0, 0), physicsClientId=client)
    assert again == bodies[1]
    world.step(2)
    found = [(track.bodyUniqueId, track.frames.tolist()) for track in recorder.recording.links]
    assert found == [(bodies[0], [0, 1, 2, 3, 4]), (again, [0, 1, 2]), (again, [3, 4])]


def test_a_frame_that_cannot_be_read_takes_no_other_away():
    client = p.connect(p.DIRECT)
    world = world_in(client, 1 / 240, (0, 0, 0))
    recorder = bt.Recorder(world, every=1)
    world.step(3)
    before = recorder.recording.times.tolist()
    p.disconnect(client)
    with pytest.raises(bt.UnknownId, match="connected"):
        recorder.frame()
    assert recorder.recording.times.tolist() == before and len(before) == 4


def test_ligaments_are_recorded_with_their_forces_and_paths(make_world):
    world = make_world(1 / 240, (0, 0, -9.81))
    client = world.physicsClientId
    stand = p.createMultiBody(0, basePosition=(0, 0, 0.1), physicsClientId=client)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    centre = {"baseInertialFramePosition": (0.0, 0.002, 0.0)}
    ball = p.createMultiBody(0.1, shape, basePosition=(0.05, 0, 0), physicsClientId=client, **centre)
    world.step()
    path = [(stand, -1, (0, 0, 0)), (stand, -1, (0.02, 0, -0.01)), (ball, -1, (0, 0, 0.01))]
    ligament = world.add_ligament(path, ROPE, name="strand")
    recorder = bt.Recorder(world, every=2)
    seen = [(ligament.points, ligament.force)]
    for _ in range(10):
        world.step(2)
        seen.append((ligament.points, ligament.force))
    world.remove_ligament(ligament)
    world.step(2)
    (track,) = recorder.recording.ligaments
    assert track.name == "strand"
    np.testing.assert_array_equal(track.frames, range(11))
    np.testing.assert_allclose(track.positions, [points for points, _ in seen], atol=1e-7)
    np.testing.assert_array_equal(track.force, np.array([force for _, force in seen], np.float32))
    assert track.force.max() > 0.1


def test_ligaments_are_recorded_along_their_wraps(make_world):
    world = make_world()
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    stand, ball = (p.createMultiBody(mass, shape, -1, at, physicsClientId=client) for mass, at in
                   ((0.0, (0, 0, 0)), (1.0, (-0.028, 0.01, -0.02))))  # fmt: skip
    wraps = [world.add_wrap(stand, -1, ("ellipsoid", (0.016, 0.02, 0.024)), (0, 0, 0), (0, 0.1, 0, 1))]
    path = [(stand, -1, (0.03, 0.012, 0.01)), (ball, -1, (0, 0, 0))]
    ligament = world.add_ligament(path, ROPE, rest_length=0.06, wraps=wraps)
    recorder, seen = bt.Recorder(world, every=3), [ligament.line]
    for _ in range(6):
        world.step(3)
        seen.append(ligament.line)
    (track,) = recorder.recording.ligaments
    assert len(ligament.line) > len(ligament.points) == 4
    np.testing.assert_allclose(track.positions, seen, atol=1e-7)
    world.remove_ligament(ligament)


def test_a_file_gives_the_same_recording(make_world, tmp_path):
    world = make_world(1 / 240, (0, -9.81, 0))
    flags = p.URDF_USE_INERTIA_FROM_FILE
    knee = world.load_urdf(bt.data_path("knee.urdf"), useFixedBase=True, flags=flags)
    tendon = world.add_tendon([(0, -0.1, 0.2), (0, 0.1, 0.2)], 0.003, ROPE, 12)
    tendon.grip(0)
    world.add_ligament([(knee, -1, (0, 0, 0)), (knee, 0, (0, 0, 0.05))], ROPE)
    camera = {"target": (0, 0, 0), "distance": 0.3, "yaw": 30, "pitch": 0, "up": "y"}
    with bt.Recorder(world, every=2, scalars={"one": lambda: 1.0}, camera=camera, title="knee") as recorder:
        world.step(6)
    before = recorder.recording
    assert before.bones == (knee,)
    recorder.save(tmp_path / "run.npz")
    after = bt.Recorder.load(tmp_path / "run.npz")
    assert_equal(before, after)
    assert len(after.tunnels) == 2 and len(after.links) == 1 + p.getNumJoints(knee, world.physicsClientId)
    assert sum(len(mesh.triangles) for track in after.links for mesh in track.meshes) > 10_000


def assert_equal(a, b):
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            assert_equal(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, dict):
        assert list(a) == list(b)
        for key in a:
            assert_equal(a[key], b[key])
    elif isinstance(a, (tuple, list)) and not np.isscalar(a):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_equal(one, other)
    else:
        np.testing.assert_array_equal(a, b)
        assert np.asarray(a).dtype == np.asarray(b).dtype


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no recording"])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    with pytest.raises(errors.InvalidValue, match="path"):
        bt.Recording.load(path)


def test_a_file_of_other_arrays_is_refused(tmp_path):
    np.savez(tmp_path / "run.npz", x=np.zeros(3))
    with pytest.raises(errors.InvalidValue, match="path"):
        bt.Recording.load(tmp_path / "run.npz")


def test_what_was_recorded_before_a_body_was_removed_is_kept(make_world):
    """Its ligament ends there, also where another body gets the same id."""
    world = make_world(1 / 240, (0, 0, -9.81))
    client = world.physicsClientId
    stand = p.createMultiBody(0, physicsClientId=client)
    paths = []
    for x in (0.0, 0.2):
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
        ball = p.createMultiBody(1.0, shape, basePosition=(x, 0, -0.1), physicsClientId=client)
        paths.append([(stand, -1, (x, 0, 0)), (ball, -1, (0, 0, 0))])
    lines = [world.add_ligament(path, bt.Material(stiffness=1e3, damping=1e1)) for path in paths]
    recorder = bt.Recorder(world, every=1)
    world.step(10)
    p.removeBody(paths[0][1][0], client)
    recorder.frame(gone=1)
    assert len(bt.Recorder(world, every=1).recording.ligaments) == 1
    first, other = recorder.recording.ligaments
    assert (first.name, len(first.frames), len(other.frames)) == (lines[0].name, 11 - 1, 11)
    world.remove_ligament(lines[0])
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    again = p.createMultiBody(1.0, shape, basePosition=(0.5, 0, 0), physicsClientId=client)
    assert again == paths[0][1][0]
    world.step(5)
    kept, other = recorder.recording.ligaments
    np.testing.assert_array_equal(kept.positions, first.positions)
    assert len(other.frames) == 16
    np.testing.assert_allclose(other.positions[-1], lines[1].points, atol=1e-6)


def test_a_camera_of_numpy_numbers_is_saved(make_world, tmp_path):
    world = make_world()
    world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, ROPE, particles=5)
    camera = {"target": np.array([0.0, 0.1, 0.0]), "distance": np.float32(0.5), "up": "y"}
    recorder = bt.Recorder(world, every=1, camera=camera)
    recorder.save(tmp_path / "run.npz")
    found = bt.Recorder.load(tmp_path / "run.npz").camera
    assert found == {"target": [0.0, 0.1, 0.0], "distance": 0.5, "up": "y"}


def test_refusals(make_world, tmp_path):
    world = make_world()
    with pytest.raises(errors.InvalidType, match="world"):
        bt.Recorder(world.physicsClientId)
    for name, value in {"every": 0, "memory": 10.0, "most_frames": 1, "camera": {"dist": 1}}.items():
        with pytest.raises(errors.InvalidValue, match=name):
            bt.Recorder(world, **{name: value})
    for name, value in {"scalars": {"pull": 3}, "camera": 3, "bones": 3}.items():
        with pytest.raises(errors.InvalidType, match=name):
            bt.Recorder(world, **{name: value})
    with pytest.raises(errors.InvalidValue, match="distance"):
        bt.Recorder(world, camera={"distance": -1})
    with pytest.raises(errors.InvalidType, match="scalars"):
        bt.Recorder(world, scalars=[("pull", world.state_hash)])
    for body in (99, -1, True, 0.0):
        with pytest.raises(errors.UnknownId, match=r"bones = .*: must be the id of a body of this client"):
            bt.Recorder(world, every=1, bones=(body,))
    recorder = bt.Recorder(world, every=1)
    with pytest.raises(errors.InvalidValue, match="path"):
        recorder.save(tmp_path / "run.txt")
    with pytest.raises(errors.CannotCopy):
        recorder.__reduce_ex__(2)
