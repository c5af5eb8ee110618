"""Sphinx extension of the manual: a page for each scenario, made by running it, and the pictures of recipes.

What came of a scenario is kept beside the generated pages. It is made anew when a file of the package or of
the scenarios has changed.
"""

import hashlib
import inspect
import json
from pathlib import Path

import pybullet as p
from bullet_tendon.scenarios import runner
from bullet_tendon.scenarios.scene import Options
from PIL import Image, ImageChops, ImageOps
from sphinx_gallery.scrapers import figure_rst

import bullet_tendon as bt

PROCESSES = 2  # that run scenarios
REPLAYS = "replays"  # folder beside the pages; Sphinx copies what is in it beside the first page
MOST_CLIENTS = 16  # of pybullet, that a recipe may leave open
MARGIN = 12  # pixels around what pictures of recipes show
RECIPES = (
    "graft_in_my_knee",
    "ligament_with_slack",
    "pretension_and_fixation",
    "multi_strand_graft",
    "tissue_over_time",
    "cartilage_of_my_joint",
    "laxity_of_my_knee",
    "tendon_over_pulley",
    "suture_and_knot",
    "finger_from_my_urdf",
    "torque_controlled_arm",
    "forces_contact_tension",
    "record_and_replay",
    "saved_states",
    "haptic_device",
    "many_worlds",
    "learn_a_task",
    "choosing_a_resolution",
    "when_a_step_does_not_converge",
)
INDEX = """# Scenarios

A scenario builds a scene, runs it, measures it and checks it. All were run when this manual was built.
[Their README](../../../README.md) tells how to run one and how to write one.

| | |
| --- | --- |
"""
TOCTREE = """
```{toctree}
:hidden:
:maxdepth: 1
"""


def setup(app) -> dict:
    app.add_config_value("scenario_pages", "scenarios", "env")
    app.connect("builder-inited", _write_scenario_pages)
    return {"parallel_read_safe": True}


class RecipeOrder:
    """A sort key of sphinx-gallery: recipes as they are listed here."""

    def __init__(self, folder: str):
        self.folder = folder

    def __call__(self, file: str) -> int:
        return RECIPES.index(Path(file).stem)


def take_pictures(block, block_vars, gallery_conf) -> str:
    """A scraper of sphinx-gallery: the PNG files that a block of a recipe wrote into its folder."""
    taken = []
    for picture in sorted(Path(block_vars["src_file"]).parent.glob("*.png")):
        target = next(block_vars["image_path_iterator"])
        _move_cropped(picture, Path(target))
        taken.append(target)
    return figure_rst(taken, gallery_conf["src_dir"])


def _move_cropped(picture: Path, target: Path) -> None:
    """Move a picture, with white margins of MARGIN."""
    with Image.open(picture) as file:
        image = file.convert("RGB")
    drawn = ImageChops.invert(image).getbbox()  # None: all is white
    ImageOps.expand(image.crop(drawn), MARGIN, "white").save(target)
    picture.unlink()


def close_clients(gallery_conf, fname) -> None:
    """Recipes end as programs do, without disconnecting. The next one expects to be the first client."""
    for client in range(MOST_CLIENTS):
        if p.isConnected(client):
            p.disconnect(client)


def _write_scenario_pages(app) -> None:
    folder = Path(app.srcdir, app.config.scenario_pages)
    (folder / REPLAYS).mkdir(parents=True, exist_ok=True)
    modules = runner.known()
    records = _records(folder, list(modules))
    rows = [_row(name, module) for name, module in modules.items()]
    _write(folder / "index.md", "\n".join([INDEX + "\n".join(rows), TOCTREE, *modules, "```", ""]))
    for name, module in modules.items():
        _write(folder / f"{name}.md", _page(name, module, records[name]))


def _records(folder: Path, names: list[str]) -> dict[str, dict]:
    """What was measured by name, of runs of the present sources. Raises RuntimeError where a step fails."""
    key = _key()
    stale = [name for name in names if not _kept(folder, name, key)]
    for name, record in zip(stale, _run_all(folder, stale), strict=True):
        (folder / f"{name}.json").write_text(json.dumps({"key": key, "record": record}), encoding="utf-8")
    records = {name: _kept(folder, name, key) for name in names}
    failed = [name for name, record in records.items() if record["failure"]]
    if failed:
        raise RuntimeError(f"scenarios with a step that failed: {', '.join(failed)}")
    return records


def _run_all(folder: Path, names: list[str]) -> list[dict]:
    cases = [(name, str(folder)) for name in names]
    return bt.sweep(_run, cases, executor=PROCESSES, progress=False) if cases else []


def _run(case, rng) -> dict:
    name, folder = case
    files = {"picture": f"{folder}/{name}.png", "replay": f"{folder}/{REPLAYS}/{name}.html"}
    outcome = runner.run(runner.known()[name], Options(picture=True, replay=True), **files)
    return {**outcome.record(), "note": outcome.scene.note}


def _kept(folder: Path, name: str, key: str) -> dict | None:
    """The record of a run with the same sources."""
    file = folder / f"{name}.json"
    made = (file, file.with_suffix(".png"), folder / REPLAYS / f"{name}.html")
    if not all(one.exists() for one in made):
        return None
    kept = json.loads(file.read_text(encoding="utf-8"))
    return kept["record"] if kept["key"] == key else None


def _key() -> str:
    """A hash of all that a scenario's outcome depends on."""
    digest = hashlib.sha256()
    package, scenarios = Path(bt.__file__).parent, Path(runner.__file__).parent
    for file in [*sorted(package.glob("*.py")), *sorted(scenarios.glob("*.py")), Path(bt._core.__file__)]:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _row(name: str, module) -> str:
    says = inspect.getdoc(module).partition("\n")[0]
    return f"| [![{name}]({name}.png){{w=260px}}]({name}.md) | **[{name}]({name}.md)**<br>{says} |"


def _page(name: str, module, record: dict) -> str:
    title, _, text = inspect.getdoc(module).partition("\n")
    measured = [f"| {what} | {_number(m['value'])} | {m['unit']} |" for what, m in record["measured"].items()]
    checks = [
        f"| {c['name']} | {_number(c['value'])} | {c['bound']} | {'yes' if c['ok'] else '**no**'} |"
        for c in record["checks"]
    ]
    return "\n".join(
        [
            f"# {name}",
            title,
            text,
            f"![{title}]({name}.png)",
            f'\n<a href="../../../../{name}.html">Replay in the browser</a>. {record["steps"]} steps, '
            f"{record['simulated_seconds']:.4g} s simulated.",
            *(["\n| measured | value | unit |", "| --- | ---: | --- |", *measured] if measured else []),
            *(
                ["\n| checked | value | must be | holds |", "| --- | ---: | --- | --- |", *checks]
                if checks
                else []
            ),
            *(["\n```text", record["note"], "```"] if record["note"] else []),
            f"\n```sh\npython -m bullet_tendon.scenarios {name} --gui\n```",
            f"\n## Program\n\n```{{literalinclude}} ../../../{name}.py\n:language: python\n```\n",
        ]
    )


def _number(value: float) -> str:
    return f"{value:.5g}"


def _write(file: Path, text: str) -> None:
    """Sphinx reads a page anew when its file was written."""
    if not file.exists() or file.read_text(encoding="utf-8") != text:
        file.write_text(text, encoding="utf-8")
