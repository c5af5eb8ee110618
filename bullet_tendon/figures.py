"""Images: outlines, PNG files, and figures of images and curves (matplotlib, extra `view`).

Owns: nothing. Goes with no room of the core.
"""

import struct
import zlib
from collections.abc import Sequence

import numpy as np

from .errors import InvalidValue, MissingExtra

WIDTH = 11.0  # of a figure [inch]
TALLEST, LOW = 6.0, 2.0  # of a row of images, and height under which they are put into two rows [inch]
LABELS_IN_ROW = 4  # of a legend
MARGIN = 10  # pixels of white that are left around what images show
MAPS_IN_ROW = 3
MARKERS = "o^sDv"  # of the places that are marked in maps
MAP_RANGE = 30.0  # of the faintest map's highest value over the lowest that has a colour of its own


def outline(image, inside) -> np.ndarray:
    """(h, w, 1): 1 at the border of the part where two images differ, falling to 0 within two pixels."""
    part = np.pad((image != inside).any(axis=2).astype(float), 1, mode="edge")
    rows = part[:-2] + part[1:-1] + part[2:]
    share = (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9
    return (4 * share * (1 - share))[..., None]


def save_png(path, image):
    """Write an image (height, width, 3) uint8 as a PNG file; needs no further package.

    Example:
        >>> from bullet_tendon import view
        >>> view.save_png("white.png", np.full((48, 64, 3), 255, np.uint8))
    """
    image = np.ascontiguousarray(image)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        raise InvalidValue("image", image, "of shape (m, m, 3) and type uint8")
    height, width = image.shape[:2]
    rows = np.hstack([np.zeros((height, 1), np.uint8), image.reshape(height, -1)])  # 0: no filter
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in parts:
            file.write(
                struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            )


def figure(
    path,
    images: Sequence = (),
    curves: Sequence[dict] = (),
    xlabel="",
    ylabel="",
    title="",
    maps: Sequence[dict] = (),
    map_labels: Sequence[str] = ("", "", ""),
):
    """One picture file: a row of images above maps above a plot of curves dict(x=, y=, label=, ...).

    An image is (title, image), or (title, image, notes) with notes (text, column, row) to be written on it.
    White margins that all images have are cut off, if they are of one size. Further keys of a curve go to
    matplotlib's plot. A map is dict(title=, x=, y=, values=) with values (len(y), len(x)) >= 0, drawn in
    colours of one logarithmic scale, MAPS_IN_ROW side by side; map_labels: of x, of y and of the values. A
    map with a label= has a linear scale of its own, and NaN where nothing is drawn; marks= {text: (x, y)} are
    shown in it, and with down=True y points downwards. The file's type follows its name. Raises InvalidValue
    without images, maps and curves, MissingExtra without matplotlib.

    Example:
        >>> from bullet_tendon import view
        >>> curve = {"x": [0, 1], "y": [0, 9.81], "label": "weight"}
        >>> view.figure("weight.png", curves=[curve], xlabel="mass [kg]", ylabel="force [N]")
    """
    if not len(images) and not len(curves) and not len(maps):
        raise InvalidValue("images", images, "at least one image, one map, or one curve")
    try:
        from matplotlib.figure import Figure  # without pyplot: no window, no global state
    except ImportError:
        raise MissingExtra("matplotlib", "view", "composing a figure") from None
    contents = {"images": images, "maps": maps, "curves": curves}
    parts = [part for part, wanted in contents.items() if len(wanted)]
    images = _cropped([(title, image, *notes) for title, image, *notes in images])
    slopes = [image.shape[0] / image.shape[1] for _, image, _ in images]
    columns = _columns(len(images), max(slopes, default=0))
    lines = -(-len(images) // columns)
    row = lines * (0.5 + min(WIDTH / columns * max(slopes, default=0), TALLEST))
    every = {"images": row, "maps": 2.6 * -(-len(maps) // MAPS_IN_ROW), "curves": 4.2}
    heights = [every[part] for part in parts]
    page = Figure(figsize=(WIDTH, sum(heights) + 0.5 * bool(title)), dpi=130, layout="constrained")
    rows = page.subfigures(len(parts), 1, squeeze=False, height_ratios=heights)[:, 0]
    areas = dict(zip(parts, rows, strict=True))
    if title:
        page.suptitle(title, fontsize=14)
    if "images" in areas:
        _draw_images(areas["images"].subplots(lines, columns, squeeze=False), images)
    if "maps" in areas:
        _draw_maps(areas["maps"], maps, *map_labels)
    if "curves" in areas:
        _draw_curves(areas["curves"].subplots(), curves, xlabel, ylabel)
    page.savefig(path, facecolor="white")


def _columns(count: int, slope: float) -> int:
    """Images side by side: all, or half of them where they would be low; slope: height over width."""
    return max(1, count if WIDTH / max(count, 1) * slope >= LOW else -(-count // 2))


def _draw_images(grid, images):
    for axes in grid.flat[len(images) :]:
        axes.axis("off")
    for axes, (name, image, notes) in zip(grid.flat, images, strict=False):
        axes.imshow(image)
        axes.set_title(name, fontsize=10)
        axes.axis("off")
        for text, column, line in notes:
            axes.text(column, line, text, ha="center", va="center", fontsize=9, color="0.25", style="italic")


def _cropped(images) -> list[tuple]:
    """(title, image, notes) each, without the white margins that all images have."""
    full = [(title, image, notes[0] if notes else ()) for title, image, *notes in images]
    if not full or len({image.shape for _, image, _ in full}) > 1:
        return full
    drawn = np.any([(image < 255).any(axis=2) for _, image, _ in full], axis=0)
    if not drawn.any():
        return full
    spans = [np.flatnonzero(drawn.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    (top, bottom), (left, right) = ((max(0, low - MARGIN), high + 1 + MARGIN) for low, high in spans)
    return [
        (title, image[top:bottom, left:right], [(text, x - left, y - top) for text, x, y in notes])
        for title, image, notes in full
    ]


def _draw_maps(area, maps, xlabel, ylabel, label):
    norm = _common_scale([one["values"] for one in maps if "label" not in one])
    rows = -(-len(maps) // MAPS_IN_ROW)
    grid = area.subplots(rows, min(len(maps), MAPS_IN_ROW), squeeze=False, sharex=True, sharey=True)
    for axes, one in zip(grid.flat, maps, strict=False):
        scale = None if "label" in one else norm
        drawn = axes.pcolormesh(
            one["x"], one["y"], one["values"], norm=scale, shading="nearest", rasterized=True
        )
        axes.set_title(one["title"], fontsize=10)
        if "label" in one:
            area.colorbar(drawn, ax=axes, label=one["label"])
        for (text, place), marker in zip(one.get("marks", {}).items(), MARKERS, strict=False):
            axes.plot(*place, marker, color="white", markeredgecolor="black", markersize=8, label=text)
        if one.get("down") and not axes.yaxis_inverted():
            axes.invert_yaxis()
    for axes in grid.flat[len(maps) :]:
        axes.axis("off")
    for axes in grid[-1]:
        axes.set_xlabel(xlabel)
    for axes in grid[:, 0]:
        axes.set_ylabel(ylabel)
    if norm is not None:
        area.colorbar(drawn, ax=grid, label=label)
    marks, texts = grid[0, 0].get_legend_handles_labels()
    if marks:
        area.legend(marks, texts, loc="outside lower center", ncols=len(marks), fontsize=9, frameon=False)


def _common_scale(tables):
    """One logarithmic scale of colours for all of these values; None without any."""
    from matplotlib.colors import LogNorm

    peaks = [max(float(np.max(table)), np.finfo(float).tiny) for table in tables]
    return LogNorm(min(peaks) / MAP_RANGE, max(peaks), clip=True) if peaks else None


def _draw_curves(axes, curves, xlabel, ylabel):
    for curve in curves:
        axes.plot(curve["x"], curve["y"], **{key: curve[key] for key in curve.keys() - {"x", "y"}})
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(alpha=0.3)
    labels = [curve["label"] for curve in curves if curve.get("label")]
    if labels:  # above the axes, where it covers no line
        above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
        axes.legend(**above, ncols=min(len(labels), LABELS_IN_ROW), frameon=False)
