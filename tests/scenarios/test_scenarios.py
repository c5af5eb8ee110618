"""The runner of scenarios, and every scenario with its own check, some of them shortened."""

import json
import os
import subprocess
import sys

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import (
    acl_reconstruction,
    hanging_weight,
    knee_laxity,
    measure,
    motor_hold,
    passive_flexion,
    release,
    runner,
    step_limit,
    super_elasticity,
    suspended_plate,
    table1,
    tendon_finger,
    tunnel_placement,
    twisted_tendon,
    two_tendons,
)
from bullet_tendon.scenarios.scene import Check, CutShort, Options, Scene
from scene_runs import holds, with_options

import bullet_tendon as bt
from bullet_tendon import scenarios

FAKE = '''"""A tendon that hangs.

More about it.
"""
import bullet_tendon as bt
from scene_runs import holds, with_options
from bullet_tendon.scenarios.scene import Check, Scene


def build(options):
    scene = Scene(options)
    tendon = scene.world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.004, bt.Material(stiffness=1e3), 8, "it")
    tendon.grip(0)
    return scene


def drive(scene, progress):
    for _ in progress(range(6), "hanging"):
        scene.step()
        scene.record("length", scene.tendons[0].length)
    scene.measure("length", scene.tendons[0].length, "m")
    scene.measure("nothing", float("nan"))


def check(scene):
    return [*scene.health(), Check.at_least("length", scene.measured["length"], LIMIT)]
'''


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Makes a scenario `fake_scene` known whose check wants a length of at least `limit` [m]."""

    def make(limit):
        (tmp_path / "fake_scene.py").write_text(FAKE + f"\n\nLIMIT = {limit}\n")
        monkeypatch.setattr(scenarios, "__path__", [*scenarios.__path__, str(tmp_path)])
        monkeypatch.delitem(sys.modules, "bullet_tendon.scenarios.fake_scene", raising=False)

    yield make
    sys.modules.pop("bullet_tendon.scenarios.fake_scene", None)


def test_command_without_a_name_lists_all_scenarios():
    command = [sys.executable, "-m", "bullet_tendon.scenarios"]
    paths = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": paths}, check=True
    )
    names = [line.split()[0] for line in done.stdout.splitlines()]
    assert {"two_tendons", "twisted_tendon", "table1", "step_limit"} <= set(names)
    assert not {"runner", "scene", "measure", "benchmarks"} & set(names)


def test_the_list_gives_the_first_line_of_each_docstring(fake, capsys):
    fake(0.0)
    assert runner.main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(None, 1)[1] for line in lines if line.startswith("fake_scene ")] == [
        "A tendon that hangs."
    ]
    assert all(len(line.split()) > 3 for line in lines)


@pytest.mark.parametrize(
    "arguments", [["nonsense"], ["two_tendons", "--steps", "0"], ["two_tendons", "--nonsense"]]
)
def test_bad_usage_exits_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        runner.main(arguments)
    assert stop.value.code == 2
    message = capsys.readouterr().err
    assert arguments[-1] in message
    if arguments == ["nonsense"]:
        assert "two_tendons" in message


def test_a_check_that_holds_gives_0_and_a_table_with_units(fake, capsys):
    fake(0.0)
    assert runner.main(["fake_scene"]) == 0
    out = capsys.readouterr().out
    assert "6 steps" in out
    assert any(line.split()[0] == "length" and line.endswith(" m") for line in out.splitlines() if line)
    assert "FAILED" not in out


def test_a_check_that_fails_gives_1_and_is_named_with_value_and_bound(fake, capsys):
    fake(0.2)
    assert runner.main(["fake_scene"]) == 1
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("FAILED: length = 0.1") and last.endswith(">= 0.2")


def test_printed_json_is_all_that_is_printed(fake, capsys):
    fake(0.2)
    assert runner.main(["fake_scene", "--json"]) == 1
    said = capsys.readouterr()
    record = json.loads(said.out)
    assert record["scenario"] == "fake_scene" and record["finished"] and not record["ok"]
    assert record["measured"]["length"]["unit"] == "m"
    assert record["measured"]["nothing"]["value"] == "nan"
    assert [check["name"] for check in record["checks"] if not check["ok"]] == ["length"]
    assert "length" in said.err


def test_steps_limit_cuts_short_without_checking(fake, tmp_path, capsys):
    fake(0.2)
    path = tmp_path / "out.json"
    assert runner.main(["fake_scene", "--steps", "4", "--json", str(path)]) == 0
    assert "cut short after 4 steps" in capsys.readouterr().out
    record = json.loads(path.read_text())
    assert record["steps"] == 4 and not record["finished"] and record["checks"] == []


def test_steps_limit_that_is_just_enough_lets_it_finish(fake):
    fake(0.2)
    assert runner.main(["fake_scene", "--steps", "6"]) == 1


def test_picture_is_drawn(fake, tmp_path):
    pytest.importorskip("matplotlib")
    fake(0.0)
    path = tmp_path / "picture.png"
    assert runner.main(["fake_scene", "--picture", str(path)]) == 0
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_client_is_closed_afterwards(fake):
    fake(0.0)
    outcome = runner.run(runner.known()["fake_scene"])
    assert outcome.status == 0
    assert not p.isConnected(outcome.scene.client)


def test_a_step_that_is_not_converged_or_not_finite_fails_the_health_checks():
    with Scene(Options(steps=1)) as scene:
        tendon = scene.world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.004, bt.Material(stiffness=1e3), 8)
        scene.world.options = bt.SolverOptions(max_linear_solves=1, tolerance=1e-15)
        tendon.grip(0)
        tendon.set_force(-1, (0, 50, 0))
        scene.step()
        assert not scene.world.report.converged
        assert [check.ok for check in scene.health()] == [True, False, True]
        with pytest.raises(CutShort):
            scene.step()


@pytest.mark.parametrize("make", [Check.at_least, Check.at_most, Check.above, Check.equal])
def test_what_is_not_a_number_fails_every_check(make):
    assert not make("x", np.nan, 1.0).ok


@pytest.mark.parametrize(("value", "oks"), [(0.9, "FTFF"), (1.0, "TTFT"), (1.1, "TFTF")])
def test_checks_compare_as_they_say(value, oks):
    kinds = (Check.at_least, Check.at_most, Check.above, Check.equal)
    assert ["FT"[make("x", value, 1.0).ok] for make in kinds] == list(oks)


def test_lowest_and_highest_do_not_lose_what_is_not_a_number():
    with Scene() as scene:
        for value in (2.0, np.nan, 1.0):
            scene.lowest("low", value)
            scene.highest("high", value)
        assert np.isnan(scene.measured["low"]) and np.isnan(scene.measured["high"])


def test_distances_of_segments_agree_with_a_fine_grid():
    corners = np.random.default_rng(1).normal(size=(40, 4, 3))
    corners[:8, 3] = corners[:8, 2] + (corners[:8, 1] - corners[:8, 0])  # parallel
    corners[8:12, 1] = corners[8:12, 0]  # a point
    found = measure.segment_distances(*corners.transpose(1, 0, 2))
    share = np.linspace(0, 1, 201)[:, None]
    for (a0, a1, b0, b1), distance in zip(corners, found, strict=True):
        one, other = a0 + share * (a1 - a0), b0 + share * (b1 - b0)
        grid = np.linalg.norm(one[:, None] - other[None], axis=2).min()
        assert distance <= grid + 1e-12
        # The grid's nearest pair is at most half a spacing off along each of the segments.
        spacing = (np.linalg.norm(a1 - a0) + np.linalg.norm(b1 - b0)) / 400
        assert distance >= grid - spacing


def test_distance_to_itself_leaves_neighbours_aside():
    line = np.array([(0, 0, 0), (1, 0, 0), (1, 0.5, 0), (0, 0.5, 0)], dtype=float)
    assert measure.with_itself(line, 0.4) == pytest.approx(0.5)
    assert measure.with_itself(line, 0.6) == np.inf


SHORTENED = [
    (two_tendons, {}),
    (twisted_tendon, {}),
    (table1, {"BLOCKS": 4, "FRAMES": 30}),
    (step_limit, {"STEPS": 200, "BISECTIONS": 3}),
    (super_elasticity, {"PARTICLES": (20, 60)}),
    (hanging_weight, {}),
    (motor_hold, {}),
    (release, {}),
    (suspended_plate, {}),
    (tendon_finger, {}),
    (knee_laxity, {}),
    (passive_flexion, {"INCREMENT": 15}),
    (tunnel_placement, {"DEEP": (0.2, 0.4), "LOW": (0.06, 0.5)}),
    (acl_reconstruction, {"ANGLES": (30, 90), "CYCLES": 1}),
]


@pytest.mark.parametrize(("module", "changes"), SHORTENED, ids=lambda x: getattr(x, "__name__", "")[24:])
def test_scenario_holds_its_own_check(module, changes, monkeypatch):
    holds(module, monkeypatch, **changes)


COMPARE_METHODS = {"table1", "step_limit", "super_elasticity"}
TAKE_MINUTES = {"acl_reconstruction"}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TAKE_MINUTES))
def test_whole_scenario_holds_its_own_check(name):
    outcome = runner.run(runner.known()[name])
    assert outcome.checks and not outcome.failed and not outcome.failure and not outcome.cut


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in TAKE_MINUTES else name
        for name in sorted(runner.known().keys() - COMPARE_METHODS)
    ],
)
def test_scenario_holds_its_own_check_by_bdf2(name):
    outcome = runner.run(runner.known()[name], Options(integrator="bdf2"))
    assert outcome.scene.world.options.integrator == "bdf2"
    assert outcome.checks and not outcome.failed and not outcome.failure and not outcome.cut


@pytest.mark.parametrize("arguments", [[], ["--integrator", "bdf2"]])
def test_the_integrator_is_that_of_the_command(fake, monkeypatch, arguments):
    fake(0.0)
    asked = []
    run = runner.run
    monkeypatch.setattr(
        runner, "run", lambda module, options, *rest: asked.append(options) or run(module, options, *rest)
    )
    assert runner.main(["fake_scene", *arguments]) == 0
    assert asked[0].integrator == (arguments[-1] if arguments else "implicit_euler")


def test_tendons_that_pass_through_each_other_are_noticed(monkeypatch):
    """The check of the crossing fails where the tendons' contact is far too soft."""
    monkeypatch.setattr(two_tendons, "STEPS", 150)
    with_options(two_tendons, monkeypatch, contact_stiffness=1.0)
    outcome = runner.run(two_tendons)
    assert "nearest, crosswise" in [check.name for check in outcome.failed]
    assert outcome.status == 1


def test_the_largest_way_of_a_sudden_pull_agrees_with_its_closed_form():
    """At small strain U ~ z^(2(p+1)), so that the largest way is (2(p+1))^(1/(2p+1)) times that at rest."""
    for law, exponent in (("linear", 1), ("power", 2)):
        material, middle = super_elasticity.LAWS[law], super_elasticity.LENGTH / 2
        ratio = super_elasticity.largest_way(material, middle, 0.01) / super_elasticity.way_at_rest(
            material, middle, 0.01
        )
        assert ratio == pytest.approx((2 * (exponent + 1)) ** (1 / (2 * exponent + 1)), rel=1e-3)


def test_maps_are_drawn_with_images_and_curves(tmp_path):
    pytest.importorskip("matplotlib")
    with Scene() as scene:
        for k in range(4):
            scene.map(f"map {k}", np.arange(5.0), np.arange(3.0), np.full((3, 5), float(k)))
        scene.record("curve", 1.0)
        path = tmp_path / "picture.png"
        scene.draw(str(path))
        assert path.read_bytes().startswith(b"\x89PNG")
