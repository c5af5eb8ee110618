"""Replays: one file, without a request, in which a browser shows tendons where the simulation had them."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import runner
from bullet_tendon.scenarios.scene import Options
from chromium import EXECUTABLE, Browser

import bullet_tendon as bt
from bullet_tendon import errors, framing, replay

try:
    from bullet_tendon.scenarios.tasks import TASKS
    from bullet_tendon.scenarios.tasks import __main__ as command_line
except ImportError:  # without gymnasium
    TASKS = []
from bullet_tendon.visuals import TAUT_COLOR, TENDON_COLOR

WIDTH, HEIGHT, BAR = 900, 700, 45  # pixels of the window, and of the bar at its lower edge
READY = "document.body && document.body.dataset.ready"
MOST_BYTES = 3e6
VIEWS = "document.querySelector('select[title=\"what is looked at\"]')"

needs_browser = pytest.mark.skipif(EXECUTABLE is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def browser():
    with Browser(WIDTH, HEIGHT) as one:
        yield one


def pixels(points, camera) -> np.ndarray:
    """(k, 2) row and column at which points (k, 3) [m] are seen, by the matrices of pybullet."""
    axis = {"y": 1, "z": 2}[camera.get("up", "z")]
    target, angles = list(camera["target"]), (camera["yaw"], camera["pitch"])
    seen = p.computeViewMatrixFromYawPitchRoll(target, camera["distance"], *angles, 0.0, axis)
    lens = p.computeProjectionMatrixFOV(camera.get("fov", 40.0), WIDTH / HEIGHT, 0.01, 10.0)
    both = np.reshape(lens, (4, 4)).T @ np.reshape(seen, (4, 4)).T
    clip = np.c_[points, np.ones(len(points))] @ both.T
    across, up = (clip[:, :2] / clip[:, 3:]).T
    return np.c_[(1 - up) / 2 * HEIGHT, (1 + across) / 2 * WIDTH]


def lines(recording) -> list[tuple]:
    """Tracks of tendons and of ligaments, each with the tensions (frames, segments) [N] of its segments."""
    found = [(track, track.tension) for track in recording.tendons]
    for track in recording.ligaments:  # the tension of a ligament is the same all along
        found.append((track, np.repeat(track.force[:, None], track.positions.shape[1] - 1, axis=1)))
    return found


def in_window(found) -> np.ndarray:
    """Which of the pixels (m, 2) are in the window, and above the bar."""
    return (found > 4).all(axis=1) & (found[:, 0] < HEIGHT - BAR) & (found[:, 1] < WIDTH - 4)


def places(recording, k) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (m, 2) of segments' middles in the window in frame k, and colours (m, 3) of their tensions."""
    full = replay._rounded_up(max(tension.max() for _, tension in lines(recording)))
    found, colors = [], []
    for track, tension in lines(recording):
        row = np.flatnonzero(track.frames == k)
        if not len(row):
            continue
        share = np.clip(tension[row[0]] / full, 0, 1)[:, None]
        line = track.positions[row[0]]
        found.append(pixels((line[1:] + line[:-1]) / 2, recording.camera))
        colors.append((1 - share) * TENDON_COLOR[:3] + share * np.array(TAUT_COLOR[:3]))
    found, colors = np.vstack(found), np.vstack(colors)
    inside = in_window(found)
    return found[inside].astype(int), colors[inside]


def places_of_bodies(recording, k) -> np.ndarray:
    """Pixels (m, 2) in the window of the middles of the bodies' triangles in frame k."""
    found = [np.zeros((0, 2))]
    for track in recording.links:
        row = np.flatnonzero(track.frames == k)
        if not len(row):
            continue
        turn = np.reshape(p.getMatrixFromQuaternion(track.orientation[row[0]].tolist()), (3, 3))
        for mesh in track.meshes:
            if mesh.color[3] > 0:
                middles = mesh.vertices[mesh.triangles].mean(axis=1)
                found.append(pixels(middles @ turn.T + track.position[row[0]], recording.camera))
    found = np.vstack(found)
    return found[in_window(found)].astype(int)


def has_color(image, place, color) -> bool:
    """Whether one of 3 x 3 pixels has the hue of a colour, lit, or seen through something translucent."""
    row, column = place
    patch = image[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3) / 255
    hue, seen = color - color.mean(), patch - patch.mean(axis=1, keepdims=True)
    strength = np.linalg.norm(seen, axis=1)
    similar = seen @ hue / np.maximum(strength * np.linalg.norm(hue), 1e-9)
    return bool(((similar > 0.95) & (strength > 0.25 * np.linalg.norm(hue))).any())


def is_drawn(image, place) -> bool:
    """Whether one of 3 x 3 pixels is not of the background."""
    row, column = place
    ground = [replay.BACKGROUND >> shift & 255 for shift in (16, 8, 0)]
    patch = image[row - 1 : row + 2, column - 1 : column + 2].astype(int)
    return bool((np.abs(patch - ground) > 5).any())


def shown(browser, module, path, options) -> float:
    """Write a scenario's replay, and hold it to the recording; the file's size [bytes]."""
    scene = runner.run(module, options, replay=str(path)).scene
    held_to(browser, scene.recording, path)
    return path.stat().st_size


def held_to(browser, recording, path) -> None:
    """Open a replay: at three moments all is where the recording has it; nothing else is opened."""
    browser.requests.clear()
    browser.open(path.as_uri(), READY)
    times = browser.value("replay.times")
    for moment in (times[0], times[len(times) // 2], times[-1]):
        browser.value(f"replay.show({moment}).then(() => true)")
        image = browser.screenshot()
        k = int(np.argmin(np.abs(recording.times - moment)))
        found, colors = places(recording, k)
        shown = sum(has_color(image, *one) for one in zip(found, colors, strict=True))
        # Tendons may be behind a body, or another tendon. Ligaments are seen through the translucent bones.
        assert shown >= (5 if recording.tendons else max(5, 0.9 * len(found))), f"{shown} of {len(found)}"
        bodies = places_of_bodies(recording, k)
        drawn = sum(is_drawn(image, place) for place in bodies)
        # A white body is as white as the background where the light meets it.
        assert drawn >= 0.9 * len(bodies), f"{drawn} of {len(bodies)}"
    outside = [url for url in browser.requests if not url.startswith(("data:", "blob:"))]
    assert outside == [path.as_uri()]
    assert browser.errors == []


@needs_browser
@pytest.mark.parametrize("name", ["graft_passage", "two_tendons", "wrap_condyle"])
def test_the_beginning_of_a_scenario_is_shown_where_it_was(browser, tmp_path, name):
    pytest.importorskip("k3d")
    options = Options(steps=240, replay=True)
    assert shown(browser, runner.known()[name], tmp_path / "run.html", options) < MOST_BYTES


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_an_episode_of_a_task_is_shown_where_it_was(browser, tmp_path, name):
    pytest.importorskip("k3d")
    recording = command_line.record_episode(name, "expert", 0)
    recording.save(tmp_path / "run.html")
    held_to(browser, recording, tmp_path / "run.html")
    size = (tmp_path / "run.html").stat().st_size
    print(f"{name}: {size / 1e6:.2f} MB")
    assert size < MOST_BYTES


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("name", list(runner.known()))
def test_a_whole_scenario_is_shown_where_it_was(browser, tmp_path, name):
    pytest.importorskip("k3d")
    size = shown(browser, runner.known()[name], tmp_path / "run.html", Options(replay=True))
    print(f"{name}: {size / 1e6:.2f} MB")
    assert size < MOST_BYTES


@needs_browser
def test_a_replay_can_be_looked_at_from_near_and_in_narrow_windows(browser, make_world, tmp_path):
    pytest.importorskip("k3d")
    world = make_world(1 / 240, (0, 0, -9.81))
    solid = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=world.physicsClientId)
    world.add_obstacle(p.createMultiBody(0, solid, physicsClientId=world.physicsClientId))
    tendon = world.add_tendon([(-0.3, 0, 0.022), (0.3, 0, 0.022)], 0.002, bt.Material(stiffness=1e4), 61)
    tendon.grip(0), tendon.grip(-1)
    with bt.Recorder(world, every=1, camera={"yaw": 0, "pitch": 0}) as recorder:
        world.step(60)
    recorder.save(tmp_path / "run.html")
    browser.open((tmp_path / "run.html").as_uri(), READY)
    recording = recorder.recording
    for chosen, camera in (
        ("whole", replay.start_camera(recording)),
        ("closer", framing.closeup(recording, replay.start_camera(recording))),
    ):
        browser.value(f"(() => {{ {VIEWS}.value = '{chosen}'; {VIEWS}.onchange(); }})()")
        eye = np.array(camera["target"]) - (0, camera["distance"], 0)
        np.testing.assert_allclose(browser.value("replay.camera()"), 1000 * eye, atol=0.01)
    shape = {"height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
    try:
        narrow = round(HEIGHT * framing.ASPECT / 2)
        browser.call("Emulation.setDeviceMetricsOverride", width=narrow, **shape)
        browser.value(f"{VIEWS}.onchange()")
        away = np.array(browser.value("replay.camera()")) / 1000 - camera["target"]
        np.testing.assert_allclose(away, (0, -2 * camera["distance"], 0), rtol=2e-3, atol=1e-5)
    finally:
        browser.call("Emulation.setDeviceMetricsOverride", width=WIDTH, **shape)


def one_tendon(make_world):
    world = make_world(1 / 240, (0, 0, -9.81))
    world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.004, bt.Material(stiffness=1e4), 8, "a").grip(0)
    return world


def test_the_file_forbids_requests_and_names_no_address(make_world, tmp_path):
    pytest.importorskip("k3d")
    world = one_tendon(make_world)
    with bt.Recorder(world, every=1, title="<b> & c") as recorder:
        world.step(10)
    recorder.save(tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    assert "default-src 'none'" in page.partition("<title>")[0]
    assert "<title>&lt;b&gt; &amp; c</title>" in page
    assert not any(f'{tag}="http' in page or f"{tag}='http" in page for tag in ("src", "href"))


def test_a_run_of_one_frame_can_be_written(make_world, tmp_path):
    pytest.importorskip("k3d")
    bt.Recorder(one_tendon(make_world), every=1).save(tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 1e6


def test_frames_are_kept_by_the_time_that_they_are_played():
    times = np.arange(0, 1001) / 1000
    kept = replay._kept(times, 25.0)
    assert kept[0] == 0 and kept[-1] == 1000
    assert set(np.diff(kept)) == {40}
    assert [replay._speed(span) for span in (5.0, 1.0, 0.2, 0.01, 1e-9, 0.0)] == [1, 1, 0.1, 0.01, 0.001, 1]


def test_the_highest_tension_is_rounded_up_to_two_digits():
    assert [replay._rounded_up(x) for x in (0.0, 3e-12, 1.0, 1.01, 99.0, 1234.0)] == pytest.approx(
        [1, 1, 1, 1.1, 99, 1300]
    )


def test_lines_are_drawn_by_their_corners():
    """A line that is bent by now and then keeps the points at its bends, and the others lie near it."""
    angle = np.linspace(0, np.pi / 2, 17)
    arc = 0.018 * np.c_[np.sin(angle), np.cos(angle) - 1, 0 * angle]
    straight = np.c_[np.linspace(0, 0.018, 17), np.zeros((17, 2))]
    assert replay._corners(np.stack([straight, straight + 1.0]), 2e-4) == [0, 16]
    corners = replay._corners(np.stack([straight, arc]), 2e-4)
    assert corners[0] == 0
    assert corners[-1] == 16
    assert 4 <= len(corners) <= 8
    drawn = arc[corners]
    chords = drawn[1:] - drawn[:-1]
    for x in arc:
        share = np.clip(((x - drawn[:-1]) * chords).sum(1) / (chords**2).sum(1), 0, 1)
        assert np.linalg.norm(drawn[:-1] + share[:, None] * chords - x, axis=1).min() <= 2e-4


def test_refusals(make_world, tmp_path, monkeypatch):
    recorder = bt.Recorder(one_tendon(make_world))
    with pytest.raises(errors.InvalidValue, match="recording"):
        recorder.save(tmp_path / "run.html")
    recorder.frame()
    for name, value in {"fps": 0.0, "full_tension": -1.0}.items():
        with pytest.raises(errors.InvalidValue, match=name):
            recorder.save(tmp_path / "run.html", **{name: value})
    monkeypatch.setitem(__import__("sys").modules, "k3d", None)
    with pytest.raises(errors.MissingExtra, match="replay"):
        recorder.save(tmp_path / "run.html")
    assert not (tmp_path / "run.html").exists()
