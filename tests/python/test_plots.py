"""plot: what is drawn is what was recorded, with units; the table has the extremes."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon import errors, plots


@pytest.fixture
def recorder(make_world):
    """Of a tendon that falls onto a box, with a named scalar."""
    pytest.importorskip("matplotlib")
    world = make_world(1 / 240, (0, 0, -9.81))
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.02, 0.02], physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, basePosition=(0, 0, -0.03), physicsClientId=client))
    material = bt.Material(stiffness=1e4, damping=1.0)
    tendon = world.add_tendon([(-0.06, 0, 0), (0.06, 0, 0)], 0.004, material, 25, "rope")
    tendon.grip(0)
    with bt.Recorder(world, every=3, scalars={"length": lambda: tendon.length}, title="A rope") as recorder:
        world.step(60)
    return recorder


def test_every_axis_has_a_unit_and_its_curves_are_the_recording(recorder, tmp_path):
    figure = bt.plot(recorder, tmp_path / "run.png")
    recording = recorder.recording
    assert (tmp_path / "run.png").stat().st_size > 10_000
    drawn = {axes.get_title(): axes for axes in figure.axes if axes.get_title()}
    assert set(drawn) == {
        "rope",
        "Forces at the ends",
        "Sum of the normal contact forces",
        "Elastic and kinetic energy",
        "length",
    }
    for title in set(drawn) - {"length"}:
        assert drawn[title].get_xlabel() == "time [s]"
        assert drawn[title].get_ylabel().endswith("]")
    track = recording.tendon("rope")
    image = drawn["rope"].collections[0].get_array()
    np.testing.assert_array_equal(np.asarray(image).reshape(24, -1), track.tension.T)
    first, last = drawn["Forces at the ends"].lines
    np.testing.assert_array_equal(first.get_ydata(), track.tension[:, 0])
    np.testing.assert_array_equal(last.get_ydata(), track.tension[:, -1])
    np.testing.assert_allclose(first.get_xdata(), recording.times)
    (energy,) = drawn["Elastic and kinetic energy"].lines
    np.testing.assert_allclose(energy.get_ydata(), 1e3 * track.energy)
    (force,) = drawn["Sum of the normal contact forces"].lines
    (total,) = recording.body_forces().values()
    np.testing.assert_array_equal(force.get_ydata(), total)
    assert total.max() > 0


def test_the_table_has_the_extremes_and_their_times(recorder):
    recording = recorder.recording
    rows = {name: (value, unit, time, place) for name, value, unit, time, place in plots.extremes(recording)}
    tension = recording.tendon("rope").tension
    frame, segment = np.unravel_index(tension.argmax(), tension.shape)
    found = rows["rope: highest tension"]
    assert found == (tension.max(), "N", recording.times[frame], f"segment {segment}")
    lengths = recording.scalar("length")[1]
    assert rows["length: lowest"][0] == lengths.min()
    assert rows["rope: greatest length"][0] == pytest.approx(1e3 * lengths.max(), rel=1e-5)
    (total,) = recording.body_forces().values()
    assert rows["contact on body 0: most"][:2] == (total.max(), "N")


def test_the_strongest_ligaments_are_drawn(make_world):
    pytest.importorskip("matplotlib")
    world = make_world()
    client = world.physicsClientId
    stand, ball = (
        p.createMultiBody(m, basePosition=(0, 0, -0.1 * m), physicsClientId=client) for m in (0, 1)
    )
    for k in range(10):
        path = [(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))]
        world.add_ligament(path, bt.Material(stiffness=10.0 * (k + 1)), 0.08, f"strand {k}")
    recorder = bt.Recorder(world, every=1)
    world.step(3)
    figure = bt.plot(recorder)
    (axes,) = (axes for axes in figure.axes if axes.get_title() == "Strongest ligaments")
    assert [line.get_label() for line in axes.lines] == [f"strand {k}" for k in range(9, 1, -1)]
    tracks = {track.name: track.force for track in recorder.recording.ligaments}
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), tracks["strand 9"])
    rows = {row[0]: row[1] for row in plots.extremes(recorder.recording)}
    assert rows["strand 9: highest force"] == tracks["strand 9"].max() > 0


def test_a_recording_of_one_frame_without_tendons_is_drawn(make_world):
    pytest.importorskip("matplotlib")
    figure = bt.plot(bt.Recorder(make_world(), every=1))
    assert figure.axes


def test_refusals(make_world, monkeypatch):
    with pytest.raises(errors.InvalidType, match="recording"):
        bt.plot(3)
    recorder = bt.Recorder(make_world())
    with pytest.raises(errors.InvalidValue, match="recording"):
        bt.plot(recorder)
    recorder.frame()
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(errors.MissingExtra, match="view"):
        bt.plot(recorder)
