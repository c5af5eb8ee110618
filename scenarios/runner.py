"""Runs a scenario: build, drive, check; with a table, a picture, JSON and an exit status.

A scenario is a module of this package with

    build(options) -> Scene      the client, the world, tendons and bodies
    drive(scene, progress)       runs it; wraps its loops as in `for k in progress(range(600), "pulling")`
    check(scene) -> list[Check]  what has to hold afterwards

and a docstring whose first line says what it shows.
"""

import argparse
import dataclasses
import importlib
import json
import pkgutil
import sys
from types import ModuleType

from bullet_tendon import StepFailed, errors, scenarios, view

from .scene import Check, CutShort, Options, Scene


@dataclasses.dataclass
class Outcome:
    """What came of a run. cut: why it ended early, or ""; failure: a step that could not be solved."""

    name: str
    scene: Scene
    checks: list[Check]
    cut: str = ""
    failure: str = ""

    @property
    def failed(self) -> list[Check]:
        return [check for check in self.checks if not check.ok]

    @property
    def status(self) -> int:
        """1 where a check or a step failed, else 0."""
        return int(bool(self.failed or self.failure))

    def record(self) -> dict:
        """Everything that was measured, for JSON."""
        scene = self.scene
        return {
            "scenario": self.name,
            "steps": scene.steps,
            "simulated_seconds": scene.time,
            "finished": not (self.cut or self.failure),
            "failure": self.failure,
            "measured": {
                name: {"value": value, "unit": scene.units[name]} for name, value in scene.measured.items()
            },
            "checks": [dataclasses.asdict(check) for check in self.checks],
            "ok": not self.status,
        }


def known() -> dict[str, ModuleType]:
    """All scenarios by name."""
    return modules_with(scenarios, "build")


def modules_with(package: ModuleType, attribute: str) -> dict[str, ModuleType]:
    """A package's modules that have `attribute`, by name."""
    found = {}
    for entry in pkgutil.iter_modules(package.__path__):
        if not entry.ispkg and not entry.name.startswith("__"):
            module = importlib.import_module(f"{package.__name__}.{entry.name}")
            if hasattr(module, attribute):
                found[entry.name] = module
    return found


def run(
    module: ModuleType, options: Options | None = None, progress=None, picture: str = "", replay: str = ""
) -> Outcome:
    """Build, drive and check one scenario. The client is closed after.

    picture, replay: the files to draw and write, for which `options` have to ask.
    """
    name = module.__name__.rpartition(".")[2]
    with module.build(Options() if options is None else options) as scene:
        outcome = Outcome(name, scene, [])
        try:
            module.drive(scene, progress or (lambda iterable, *_, **__: iterable))
            outcome.checks = module.check(scene)
        except CutShort as stop:
            outcome.cut = str(stop)
        except StepFailed as problem:
            outcome.failure = str(problem)
        if picture:
            scene.draw(picture)
        if replay:
            scene.replay(replay)
    return outcome


def main(arguments: list[str] | None = None) -> int:
    """The command line. Returns the exit status: 0, 1 (a check failed), 2 (bad usage)."""
    parser = _parser()
    wanted = parser.parse_args(arguments)
    every = known()
    if wanted.name is None:
        list_modules(every)
        return 0
    if wanted.name not in every:
        parser.error(f"unknown scenario {wanted.name!r}; known: {', '.join(every)}")
    options = Options(wanted.gui, bool(wanted.picture), wanted.steps, wanted.integrator, bool(wanted.replay))
    try:
        outcome = run(every[wanted.name], options, view.progress, wanted.picture, wanted.replay)
    except errors.MissingExtra as problem:
        parser.error(str(problem))
    # Where JSON is printed, nothing else is.
    _print_table(outcome, sys.stderr if wanted.json == "-" else sys.stdout)
    if wanted.json:
        _write_json(outcome, wanted.json)
    return outcome.status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bullet_tendon.scenarios", description="Runs one scenario.")
    parser.add_argument("name", nargs="?", help="of the scenario; without one, all are listed")
    parser.add_argument("--gui", action="store_true", help="show it in pybullet's window, in real time")
    parser.add_argument("--picture", metavar="FILE", default="", help="draw moments and curves into FILE")
    parser.add_argument("--replay", metavar="FILE.html", default="", help="write a replay for a browser")
    parser.add_argument(
        "--json", metavar="FILE", nargs="?", const="-", help="write the measurements to FILE, or print them"
    )
    parser.add_argument("--steps", type=_count, help="stop after so many steps, without the checks")
    parser.add_argument(
        "--integrator",
        choices=("implicit_euler", "bdf2"),
        default=Options.integrator,
        help="of the scene's world (default: %(default)s)",
    )
    return parser


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be an integer >= 1")
    return int(text)


def list_modules(every: dict[str, ModuleType]) -> None:
    """Print each module's name and the first line of its docstring."""
    width = max(map(len, every), default=0)
    for name, module in every.items():
        print(f"{name:{width}}  {(module.__doc__ or '').strip().partition(chr(10))[0]}")


def _print_table(outcome: Outcome, file) -> None:
    scene = outcome.scene
    print(f"{outcome.name}: {scene.steps} steps, {scene.time:.4g} s simulated", file=file)
    width = max([len(name) for name in scene.measured] + [len(c.name) for c in outcome.checks], default=0)
    for name, value in scene.measured.items():
        print(f"  {name:{width}}  {value:12.6g} {scene.units[name]}".rstrip(), file=file)
    for check in outcome.checks:
        verdict = "ok" if check.ok else "FAILED"
        print(f"  {check.name:{width}}  {check.value:12.6g} ({check.bound})  {verdict}", file=file)
    for line in _remarks(outcome):
        print(line, file=file)


def _remarks(outcome: Outcome) -> list[str]:
    lines = [outcome.scene.note] if outcome.scene.note else []
    if outcome.cut:
        lines.append(f"cut short {outcome.cut}: not checked")
    if outcome.failure:
        lines.append(f"FAILED: {outcome.failure}")
    lines += [f"FAILED: {c.name} = {c.value:.6g}, must be {c.bound}" for c in outcome.failed]
    return lines


def _write_json(outcome: Outcome, path: str) -> None:
    text = json.dumps(_plain(outcome.record()), indent=2, allow_nan=False)
    if path == "-":
        print(text)
        return
    with open(path, "w", encoding="utf-8") as file:
        file.write(text + "\n")


def _plain(item):
    """JSON has no infinities and no NaN: they become text."""
    if isinstance(item, dict):
        return {key: _plain(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_plain(value) for value in item]
    if isinstance(item, float) and (item != item or item in (float("inf"), float("-inf"))):
        return str(item)
    return item
