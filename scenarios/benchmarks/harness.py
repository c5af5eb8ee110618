"""Runs a benchmark: measure, print a table, write JSON, draw a plot.

A benchmark is a module of this package with

    run(quick, progress) -> dict    measures; numbers, text, lists and dicts, None for what is not known
    table(record) -> list[str]      the lines that are printed
    panels(record) -> list[dict]    plots, logarithmic: title, xlabel, ylabel, curves dict(x=, y=, label=);
                                    over a map, cells: the arguments of _draw_cells

and a docstring whose first line says what it measures. Nothing here is judged: what counts is
ratios of times within one run, which a noisy computer disturbs least. Panels come from the record alone, so
that a picture can be drawn again without measuring (make_pictures).
"""

import argparse
import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from bullet_tendon.scenarios import benchmarks
from bullet_tendon.scenarios.runner import list_modules, modules_with

from bullet_tendon import errors, view


def known() -> dict[str, ModuleType]:
    """All benchmarks by name."""
    return modules_with(benchmarks, "run")


def main(arguments: list[str] | None = None) -> int:
    """The command line. Returns the exit status: 0, or 2 for bad usage."""
    parser = _parser()
    wanted = parser.parse_args(arguments)
    every = known()
    if wanted.name is None:
        list_modules(every)
        return 0
    if wanted.name not in every:
        parser.error(f"unknown benchmark {wanted.name!r}; known: {', '.join(every)}")
    module = every[wanted.name]
    record = {"benchmark": wanted.name, "quick": wanted.quick, **module.run(wanted.quick, view.progress)}
    print("\n".join(module.table(record)), file=sys.stderr if wanted.json == "-" else sys.stdout)
    if wanted.json:
        write_json(record, wanted.json)
    try:
        if wanted.plot:
            draw(wanted.plot, module.panels(record))
    except errors.MissingExtra as problem:
        parser.error(str(problem))
    return 0


def record_file(name: str) -> Path:
    """Where the checkout keeps the record of a benchmark, from which its picture is drawn."""
    return Path(__file__).resolve().parent / "records" / f"{name}.json"


def read_record(name: str) -> dict:
    """The record that the checkout keeps of a benchmark. Raises InvalidValue where there is none."""
    path = record_file(name)
    if not path.is_file():
        command = f"python -m {benchmarks.__name__} {name} --json {path}"
        raise errors.InvalidValue("benchmark", name, f"one with a record, which this writes: {command}")
    return json.loads(path.read_text(encoding="utf-8"))


def write_json(record: dict, path: str) -> None:
    """Write the record to a file, or print it ("-"). Raises ValueError for infinities and NaN."""
    text = json.dumps(record, indent=2, allow_nan=False)
    if path == "-":
        print(text)
        return
    with open(path, "w", encoding="utf-8") as file:
        file.write(text + "\n")


def draw(path: str, panels: list[dict]) -> None:
    """Write one picture with the panels side by side. Raises MissingExtra without matplotlib."""
    try:
        from matplotlib.figure import Figure  # without pyplot: no window, no global state
    except ImportError:
        raise errors.MissingExtra("matplotlib", "view", "drawing a benchmark") from None
    columns = 3 if len(panels) == 9 else min(len(panels), 2)
    rows = -(-len(panels) // columns)
    page = Figure(figsize=(6.5 * columns, 4.8 * rows), dpi=130, layout="constrained")
    grid = page.subplots(rows, columns, squeeze=False)
    for axes, panel in zip(grid.flat, panels, strict=False):
        _draw_panel(axes, panel)
    if any("cells" in panel for panel in panels):  # which fill their panels
        page.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    page.savefig(path, facecolor="white")


def _draw_panel(axes, panel) -> None:
    marker = "" if "cells" in panel else "o"
    for curve in panel["curves"]:
        axes.loglog(curve["x"], curve["y"], marker=marker, markersize=4, label=curve["label"])
    if "cells" in panel:
        _draw_cells(axes, **panel["cells"])
    axes.set(title=panel["title"], xlabel=panel["xlabel"], ylabel=panel["ylabel"])
    axes.grid(alpha=0.3)
    if "cells" not in panel:
        axes.legend(frameon=False, fontsize=8)


def _draw_cells(axes, x, y, values, marked, label, mark, limits) -> None:
    """Colours of positive values (rows by y, columns by x; None: blank), and crosses where `marked`."""
    from matplotlib.colors import LogNorm

    edges = _edges(x), _edges(y)
    colours = np.ma.masked_invalid(np.array(values, float))
    mesh = axes.pcolormesh(*edges, colours, norm=LogNorm(*limits), cmap="viridis_r")
    axes.figure.colorbar(mesh, ax=axes, label=label, extend="both")
    rows, columns = np.nonzero(marked)
    axes.plot(np.array(x)[columns], np.array(y)[rows], "x", color="tab:red", label=mark)
    axes.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])


def _edges(middles) -> np.ndarray:
    """(n + 1,) bounds of cells around (n,) middles, on a logarithmic scale."""
    logs = np.log(middles)
    inner = (logs[1:] + logs[:-1]) / 2
    return np.exp(np.concatenate([[2 * logs[0] - inner[0]], inner, [2 * logs[-1] - inner[-1]]]))


def _parser() -> argparse.ArgumentParser:
    name = "python -m bullet_tendon.scenarios.benchmarks"
    parser = argparse.ArgumentParser(name, description="Runs one benchmark.")
    parser.add_argument("name", nargs="?", help="of the benchmark; without one, all are listed")
    parser.add_argument(
        "--json", metavar="FILE", nargs="?", const="-", help="write the record to FILE, or print it"
    )
    parser.add_argument("--plot", metavar="FILE", default="", help="draw the curves into FILE")
    parser.add_argument("--quick", action="store_true", help="a small part of it, to see that it works")
    return parser
