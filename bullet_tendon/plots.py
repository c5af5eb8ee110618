"""plot: a recording on one page (matplotlib, extra `view`), and its extremes as a table.

Owns: nothing. Goes with no room of the core.
"""

from os import PathLike

import numpy as np

from . import checks
from .errors import InvalidType, InvalidValue, MissingExtra
from .recorder import Recorder
from .recording import LigamentTrack, Recording, TendonTrack

_WIDTH, _ROW = 11.0, 2.6  # of the page, and the height of a row [inch]
_MOST_LIGAMENTS = 8  # that are drawn and told
_MOST_MAPS = 6  # tendons whose tension is drawn as an image


def plot(recording: Recording | Recorder, path: str | PathLike | None = None, scalars: bool = True):
    """Draw a recording: tension along each tendon against time, forces, energies, and a table of extremes.

    Args:
        recording: a Recording, or a Recorder for what it has kept so far; with at least one frame.
        path: of a picture to write, its type by its name; None: none is written.
        scalars: whether named scalars are drawn.

    Returns:
        The matplotlib figure.

    Raises:
        InvalidType, InvalidValue: naming the argument.
        MissingExtra: without matplotlib.

    Example:
        >>> with bt.Recorder(world, every=1) as recorder:
        ...     world.step(20)
        >>> figure = bt.plot(recorder, "run.png")
        >>> [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]
        ['along the tendon [mm]', 'tension [N]', 'tension [N]', 'energy [mJ]']
    """
    if isinstance(recording, Recorder):
        recording = recording.recording
    if not isinstance(recording, Recording):
        raise InvalidType("recording", recording, "a Recording or a Recorder")
    if not len(recording):
        raise InvalidValue("recording", recording, "one with frames")
    scalars = checks.flag("scalars", scalars)
    where = None if path is None else checks.path("path", path)
    try:
        from matplotlib.figure import Figure  # without pyplot: no window, no global state
    except ImportError:
        raise MissingExtra("matplotlib", "view", "plotting a recording") from None
    curves = _curves(recording, scalars)
    maps = recording.tendons[:_MOST_MAPS]
    rows = extremes(recording)
    heights = [_ROW] * len(maps) + [_ROW * (-(-len(curves) // 2))] * bool(curves) + [0.4 + 0.25 * len(rows)]
    page = Figure(figsize=(_WIDTH, sum(heights) + 0.6), dpi=110, layout="constrained")
    if recording.title:
        page.suptitle(recording.title, fontsize=14)
    areas = page.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    for area, track in zip(areas, maps, strict=False):
        _draw_tension(area, recording, track)
    if curves:
        _draw_curves(areas[-2], curves)
    _draw_table(areas[-1], rows)
    if where is not None:
        page.savefig(where, facecolor="white")
    return page


def extremes(recording: Recording) -> list[tuple[str, float, str, float, str]]:
    """Rows of name, value, unit, time [s] and place: the highest and lowest of what was recorded."""
    rows = []
    for track in recording.tendons:
        times = recording.times[track.frames]
        rows.append(_extreme(f"{track.name}: highest tension", track.tension, "N", times, "segment"))
        rows.append(_extreme(f"{track.name}: lowest tension", track.tension, "N", times, "segment", False))
        length = np.linalg.norm(np.diff(track.positions, axis=1), axis=2).sum(axis=1)
        rows.append(_extreme(f"{track.name}: greatest length", 1e3 * length, "mm", times))
    for track in _strongest(recording):
        rows.append(_extreme(f"{track.name}: highest force", track.force, "N", recording.times[track.frames]))
    for (body, link), force in recording.body_forces().items():
        name = f"contact on {recording.link_name(body, link)}: most"
        rows.append(_extreme(name, force, "N", recording.times))
    for name, (frames, values) in recording.scalars.items():
        rows.append(_extreme(f"{name}: highest", values, "", recording.times[frames]))
        rows.append(_extreme(f"{name}: lowest", values, "", recording.times[frames], highest=False))
    return rows


def _extreme(name, values, unit, times, kind="", highest=True) -> tuple[str, float, str, float, str]:
    """A row: values (k,) or (k, m), of which the second index is told as `kind`."""
    values = np.asarray(values, float)
    at = np.unravel_index(values.argmax() if highest else values.argmin(), values.shape)
    place = f"{kind} {at[1]}" if kind else ""
    return name, float(values[at]), unit, float(times[at[0]]), place


def _curves(recording: Recording, scalars: bool) -> list[dict]:
    """Plots of lines: ylabel and curves (label, times, values)."""
    plots = []
    if recording.tendons:
        ends = [
            (f"{track.name}, {end}", recording.times[track.frames], track.tension[:, column])
            for track in recording.tendons
            for end, column in (("first segment", 0), ("last segment", -1))
        ]
        plots.append({"ylabel": "tension [N]", "title": "Forces at the ends", "curves": ends})
    forces = [
        (recording.link_name(*key), recording.times, force) for key, force in recording.body_forces().items()
    ]
    if forces:
        title = "Sum of the normal contact forces"
        plots.append({"ylabel": "force [N]", "title": title, "curves": forces})
    if recording.ligaments:
        strands = [(t.name, recording.times[t.frames], t.force) for t in _strongest(recording)]
        title = "Ligaments" if len(strands) == len(recording.ligaments) else "Strongest ligaments"
        plots.append({"ylabel": "force [N]", "title": title, "curves": strands})
    if recording.tendons:
        energies = [(t.name, recording.times[t.frames], 1e3 * t.energy) for t in recording.tendons]
        title = "Elastic and kinetic energy"
        plots.append({"ylabel": "energy [mJ]", "title": title, "curves": energies})
    for name in recording.scalars if scalars else ():
        curve = (name, *recording.scalar(name))
        plots.append({"ylabel": name, "title": name, "curves": [curve]})
    return plots


def _strongest(recording: Recording) -> list[LigamentTrack]:
    """The ligaments with the highest forces, at most _MOST_LIGAMENTS."""
    ordered = sorted(recording.ligaments, key=lambda track: -track.force.max())
    return ordered[:_MOST_LIGAMENTS]


def _draw_tension(area, recording: Recording, track: TendonTrack) -> None:
    axes = area.subplots()
    lengths = np.linalg.norm(np.diff(track.positions, axis=1), axis=2).mean(axis=0)
    along = 1e3 * (np.cumsum(lengths) - lengths / 2)
    times = recording.times[track.frames]
    image = axes.pcolormesh(times, along, track.tension.T, shading="nearest", rasterized=True)
    axes.set(xlabel="time [s]", ylabel="along the tendon [mm]", title=track.name)
    area.colorbar(image, ax=axes, label="tension [N]")


def _draw_curves(area, plots: list[dict]) -> None:
    columns = min(2, len(plots))
    grid = area.subplots(-(-len(plots) // columns), columns, squeeze=False)
    for axes, one in zip(grid.flat, plots, strict=False):
        for label, times, values in one["curves"]:
            axes.plot(times, values, label=label, linewidth=1.2)
        axes.set(xlabel="time [s]", ylabel=one["ylabel"], title=one["title"])
        axes.grid(alpha=0.3)
        if len(one["curves"]) > 1:
            axes.legend(frameon=False, fontsize=8)
    for axes in grid.flat[len(plots) :]:
        axes.remove()


def _draw_table(area, rows) -> None:
    axes = area.subplots()
    axes.axis("off")
    cells = [
        [name, f"{value:.4g} {unit}".strip(), f"{time:.4g} s", place]
        for name, value, unit, time, place in rows
    ]
    if not cells:
        return
    table = axes.table(
        cells, colLabels=["", "value", "time", "place"], colWidths=[0.5, 0.18, 0.16, 0.16], loc="center"
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    for cell in table.get_celld().values():
        cell.set_linewidth(0.3)
