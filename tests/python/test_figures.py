"""Picture files, progress bars, and what happens without the optional packages."""

import sys

import numpy as np
import pytest

from bullet_tendon import view
from bullet_tendon.errors import InvalidValue, MissingExtra
from bullet_tendon.figures import outline


def test_png_is_read_back(tmp_path):
    image_module = pytest.importorskip("matplotlib.image")
    image = np.random.default_rng(0).integers(0, 256, (7, 13, 3)).astype(np.uint8)
    view.save_png(tmp_path / "a.png", image)
    read = np.round(image_module.imread(tmp_path / "a.png") * 255).astype(np.uint8)
    np.testing.assert_array_equal(read[..., :3], image)


def test_figure_is_composed(tmp_path):
    pytest.importorskip("matplotlib")
    images = [("before", np.zeros((30, 40, 3), np.uint8)), ("after", np.full((30, 40, 3), 200, np.uint8))]
    curves = [{"x": [0, 1, 2], "y": [0, 1, 4], "label": "tension", "linestyle": "--"}]
    sizes = []
    for name, arguments in {"both": (images, curves), "images": (images, []), "curves": ([], curves)}.items():
        view.figure(tmp_path / f"{name}.png", *arguments, "time [s]", "force [N]", "Passage")
        sizes.append((tmp_path / f"{name}.png").stat().st_size)
    assert sizes[0] > sizes[1] > 1000


def test_a_map_with_a_label_has_gaps_marks_and_a_scale_of_its_own(tmp_path):
    """Two maps of three values, one ten times the other: three colours, or six on a common scale."""
    image_module = pytest.importorskip("matplotlib.image")

    def colours(values, **further):
        """Those of at least 3,000 pixels that are no grey."""
        one = {"title": "one", "x": [0, 1], "y": [0, 1], "values": values, **further}
        view.figure(tmp_path / "a.png", maps=[one, {**one, "values": 10 * values}])
        pixels = np.round(255 * image_module.imread(tmp_path / "a.png")[..., :3]).astype(int).reshape(-1, 3)
        found, count = np.unique(pixels[np.ptp(pixels, axis=1) > 20], axis=0, return_counts=True)
        return {tuple(colour) for colour in found[count > 3000].tolist()}

    values = np.array([[1.0, 2.0], [4.0, 4.0]])
    assert len(colours(values)) == 6
    own = colours(values, label="[mm]", marks={"here": (0, 1)}, down=True)
    assert len(own) == 3
    gap = np.array([[1.0, np.nan], [4.0, 4.0]])
    assert len(own - colours(gap, label="[mm]")) == 1


def test_missing_packages(tmp_path, monkeypatch, capsys):
    for package in ("tqdm", "matplotlib", "matplotlib.figure"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtra, match=r"bullet_tendon\[view\]"):
        view.figure(tmp_path / "a.png", curves=[{"x": [0], "y": [0]}])
    steps = range(3)
    assert view.progress(steps, "steps") is steps
    view.save_png(tmp_path / "b.png", np.zeros((2, 2, 3), np.uint8))
    assert capsys.readouterr().err == ""


def test_progress_writes_to_stderr(capsys):
    pytest.importorskip("tqdm")
    assert list(view.progress(range(3), "passage")) == [0, 1, 2]
    out, err = capsys.readouterr()
    assert "passage" in err
    assert out == ""


def test_outline_is_where_the_parts_meet():
    image = np.zeros((20, 30, 3), np.uint8)
    other = image.copy()
    other[:, 15:] = 9
    line = outline(image, other)[..., 0]
    assert line[:, 14:16].min() > 0.8
    assert (line[:, :14] == 0).all() and (line[:, 16:] == 0).all()
    assert not outline(image, image).any()


def test_refusals(tmp_path):
    with pytest.raises(InvalidValue, match="image"):
        view.save_png(tmp_path / "a.png", np.zeros((2, 2, 3)))
    with pytest.raises(InvalidValue, match="images"):
        view.figure(tmp_path / "a.png")
