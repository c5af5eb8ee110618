"""The pictures of the READMEs are made by one script, and by the code that there is now."""

import re
from pathlib import Path

import numpy as np
import pytest
from bullet_tendon.scenarios import make_pictures

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


@pytest.mark.parametrize("name", (*make_pictures.SCENARIOS, *make_pictures.TASKS))
def test_no_picture_is_older_than_its_code(name):
    command = f"python -m bullet_tendon.scenarios.make_pictures {name}"
    assert make_pictures.stamp(PICTURES / f"{name}.png") == make_pictures.digest(name), command


@pytest.mark.parametrize("name", make_pictures.BENCHMARKS)
def test_no_picture_of_a_benchmark_is_older_than_its_code(name):
    stamp = make_pictures.stamp(PICTURES / f"{name}.png")
    if not stamp:
        pytest.skip("measured before pictures were stamped")
    command = f"python -m bullet_tendon.scenarios.make_pictures {name}"
    assert stamp == make_pictures.digest(name), command


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
