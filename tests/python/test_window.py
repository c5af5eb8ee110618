"""pybullet's window: tendons are where they are, in the colours of their tension; keys pause and step."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon import errors, view

SCRIPT = Path(__file__).parents[1] / "window_run.py"


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What window_run.py saw in a window on a virtual screen."""
    server = shutil.which("Xvfb")
    if server is None:
        pytest.skip("no Xvfb on this machine")
    folder = tmp_path_factory.mktemp("screen")
    reader, writer = os.pipe()
    command = [server, "-displayfd", str(writer), "-screen", "0", "1024x768x24", "-fbdir", str(folder)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    screen = subprocess.Popen(command, pass_fds=[writer], **quiet)
    os.close(writer)
    try:
        number = os.read(reader, 20).decode().strip()
        if not number:
            pytest.skip("Xvfb does not start here")
        paths = os.pathsep.join(os.path.abspath(path) for path in sys.path)
        surroundings = {**os.environ, "DISPLAY": f":{number}", "PYTHONPATH": paths}
        run = [sys.executable, str(SCRIPT), str(folder / "Xvfb_screen0")]
        done = subprocess.run(run, capture_output=True, text=True, env=surroundings, timeout=120)
        told = [line for line in done.stdout.splitlines() if line.startswith("{")]
        if not told and "GL" in done.stdout + done.stderr:
            pytest.skip("no OpenGL on this machine's virtual screen")
        assert told, done.stdout[-500:] + done.stderr[-1000:]
        yield json.loads(told[0])
    finally:
        os.close(reader)
        screen.kill()
        screen.wait()


def test_tendons_are_seen_where_they_are_in_the_colours_of_their_tension(seen):
    slack, taut = (np.array(seen["pixels"][name], float) for name in ("slack", "taut"))
    beige, red = np.array(view.TENDON_COLOR[:3]), np.array(view.TAUT_COLOR[:3])
    for pixels, color in ((slack, beige), (taut, red)):
        hue = pixels / np.linalg.norm(pixels, axis=1)[:, None] @ color / np.linalg.norm(color)
        assert (hue > 0.99).all()
    beside = np.array(seen["beside"], float)
    assert (np.abs(beside - taut).max(axis=1) > 60).all()


def test_the_space_bar_pauses_and_the_arrow_takes_single_steps(seen):
    running, paused, once, twice, again = seen["steps"]
    assert running >= 5
    assert (once, twice) == (paused + 1, paused + 2)
    assert again >= twice + 5


def keys_of(monkeypatch, *moments):
    """Let pybullet tell these keys, one dict after the other, then none."""
    left = list(moments)
    monkeypatch.setattr(p, "getKeyboardEvents", lambda client: left.pop(0) if left else {})


def test_paused_it_waits_for_a_step_or_to_go_on(make_world, monkeypatch):
    world = make_world()
    world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.004, bt.Material(stiffness=1e3), 4)
    space, right = {p.B3G_SPACE: p.KEY_WAS_TRIGGERED}, {p.B3G_RIGHT_ARROW: p.KEY_WAS_TRIGGERED}
    keys_of(monkeypatch, {}, space, {}, {}, right, {}, space, {})
    window = view.Window(world)
    assert window.update() and not window.paused
    start = time.monotonic()
    assert window.update() and window.paused  # space, nothing twice, and the arrow
    assert time.monotonic() - start > 0.015
    assert window.update() and not window.paused  # nothing, then space
    assert p.getNumBodies(world.physicsClientId) == 4
    window.close()
    window.close()
    assert p.getNumBodies(world.physicsClientId) == 0


def test_it_ends_with_its_client():
    client = p.connect(p.DIRECT)
    window = view.Window(bt.TendonWorld(client))
    p.disconnect(client)
    assert window.update() is False
    window.close()


def test_tendons_come_and_go_and_the_scale_grows_with_the_highest_tension(make_world):
    world = make_world()
    tendon = world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.004, bt.Material(stiffness=1e3), 4)
    tendon.grip(0), tendon.grip(-1, target=(0.11, 0, 0))
    with view.Window(world) as window:
        world.step(50)
        window.update()
        bodies = window._visuals[tendon].bodies
        reds = [p.getVisualShapeData(body, physicsClientId=world.physicsClientId)[0][7][1] for body in bodies]
        np.testing.assert_allclose(reds, view.TAUT_COLOR[1], atol=0.01)
        other = world.add_tendon([(0, 0.1, 0), (0.1, 0.1, 0)], 0.004, bt.Material(stiffness=1e3), 4)
        world.remove_tendon(tendon)
        window.update()
        assert set(window._visuals) == {other}


def test_refusals(make_world):
    world = make_world()
    with pytest.raises(errors.InvalidType, match="world"):
        view.Window(world.physicsClientId)
    for name, value in {"colors": [], "full_tension": 0.0}.items():
        with pytest.raises(errors.InvalidValue, match=name):
            view.Window(world, **{name: value})
