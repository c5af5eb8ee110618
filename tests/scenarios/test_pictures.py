"""The pictures of the READMEs are made by one script, and by the code that there is now."""

import re
from pathlib import Path

import numpy as np
import pytest
from bullet_tendon.scenarios import make_pictures
from bullet_tendon.scenarios.benchmarks import harness

from bullet_tendon import view

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "scenarios" / "pictures"  # an installed package has none


def shown() -> set[str]:
    """Names of the pictures that READMEs show."""
    pages = [
        page.read_text(encoding="utf-8") for page in ROOT.rglob("README.md") if "build" not in page.parts
    ]
    return {name for page in pages for name in re.findall(r"!\[[^]]*\]\([^)]*pictures/(\w+)\.png\)", page)}


def test_every_picture_that_is_shown_can_be_made():
    known = {*make_pictures.SCENARIOS, *make_pictures.TASKS, *make_pictures.BENCHMARKS}
    assert shown() <= known
    assert {path.stem for path in PICTURES.glob("*.png")} == known


@pytest.mark.parametrize("name", (*make_pictures.SCENARIOS, *make_pictures.TASKS, *make_pictures.BENCHMARKS))
def test_no_picture_is_older_than_what_it_is_drawn_from(name):
    command = f"python -m bullet_tendon.scenarios.make_pictures {name}"
    assert make_pictures.stamp(PICTURES / f"{name}.png") == make_pictures.digest(name), command


@pytest.mark.parametrize("name", make_pictures.BENCHMARKS)
def test_a_picture_of_a_benchmark_is_drawn_from_its_record_alone(name, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    record = harness.read_record(name)
    assert (record["benchmark"], record["quick"]) == (name, False)
    monkeypatch.setattr(harness.known()[name], "run", None)
    make_pictures.make(name, tmp_path / "it.png")
    assert make_pictures.stamp(tmp_path / "it.png") == make_pictures.digest(name)


def test_a_picture_is_stale_where_its_record_is_another(tmp_path, monkeypatch):
    record, before = harness.read_record("haptic"), make_pictures.digest("haptic")
    monkeypatch.setattr(harness, "record_file", lambda name: tmp_path / f"{name}.json")
    harness.write_json(record, str(tmp_path / "haptic.json"))
    assert make_pictures.digest("haptic") == before
    record["rows"][0]["as_measured"]["rest_ms"][0] += 1e-6
    harness.write_json(record, str(tmp_path / "haptic.json"))
    assert make_pictures.digest("haptic") != before


def test_a_picture_without_a_record_is_refused_with_the_command_that_measures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(harness, "record_file", lambda name: tmp_path / f"{name}.json")
    with pytest.raises(SystemExit) as stop:
        make_pictures.main(["haptic"])
    assert stop.value.code == 2
    assert "benchmarks haptic --json" in capsys.readouterr().err


def test_a_stamp_is_read_back_and_leaves_the_picture_as_it_was(tmp_path):
    image_module = pytest.importorskip("matplotlib.image")
    view.save_png(tmp_path / "a.png", np.arange(60, dtype=np.uint8).reshape(4, 5, 3))
    before = image_module.imread(tmp_path / "a.png")
    assert make_pictures.stamp(tmp_path / "a.png") == ""
    (tmp_path / "a.png").write_bytes(make_pictures._stamped((tmp_path / "a.png").read_bytes(), "0123abcd"))
    assert make_pictures.stamp(tmp_path / "a.png") == "0123abcd"
    np.testing.assert_array_equal(image_module.imread(tmp_path / "a.png"), before)


def test_the_stamp_follows_code_and_not_comments():
    text = '"""About."""\n\n\ndef f(x):\n    """More."""\n    return x + 1  # why\n'
    assert make_pictures._code(text) == make_pictures._code("def f(x):\n    return (x + 1)\n")
    assert make_pictures._code(text) != make_pictures._code(text.replace("+ 1", "+ 2"))


def test_an_unknown_name_is_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        make_pictures.main(["mona_lisa"])
    assert stop.value.code == 2
    assert "mona_lisa" in capsys.readouterr().err
