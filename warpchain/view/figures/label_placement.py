"""Placement of a picture's labels where they cover neither parts nor each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CELL = 3
"""Pixels along a cell's side."""
COVER_COST = 25.0
"""Cost of covering a cell, over that of a cell's width away."""
LEADER_LENGTH = 9.0
"""Distance of a label from its point [pt] that takes a line."""
DARK, LIGHT = 0.83, 0.98
"""Gray below which a cell is a line, and a part's inside."""
CLEARANCE = 2.0
"""Room around a label [px]."""
LEADER_TRIES = 400
"""Best places of a label among which lines may not cross others."""


class Label(NamedTuple):
    """Label of a picture: texts one below the other, annotations of one point.

    Attributes:
        radius: of the sprocket around the point, in the axes' units, within which they may stand.
    """

    texts: list[Any]
    radius: float = 0.0


class _Box(NamedTuple):
    """Label to place: texts, point, radius, sizes of texts and box [px]."""

    texts: Sequence[Any]
    point: Array
    radius: float
    sizes: Sequence[Array]
    size: Array


def place_labels(axis: Any, labels: Sequence[Label]) -> None:
    """Moves a picture's labels to the nearest places where they cover nothing, with lines to those far off."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, texts = axis.figure, [text for label in labels for text in label.texts]
    canvas = FigureCanvasAgg(figure)
    renderer = canvas.get_renderer()
    found = []
    for label in labels:
        for text in label.texts:
            text.set_parse_math(False)
            text.set_path_effects([])
        boxes = [np.array(text.get_window_extent(renderer).size) for text in label.texts]
        size = np.array([max(box[0] for box in boxes), sum(box[1] for box in boxes) + 2.0 * (len(boxes) - 1)])
        at = np.array(label.texts[0].xy, dtype=float)
        point, beside = axis.transData.transform([at, at + np.array([label.radius, 0.0])])
        found.append(_Box(label.texts, point, float(beside[0] - point[0]), boxes, size + 2.0 * CLEARANCE))
    for text in texts:
        text.set_visible(False)
    canvas.draw()
    for text in texts:
        text.set_visible(True)
    inside = np.array(axis.bbox.extents)
    lines, insides = _covered_cells(np.asarray(canvas.buffer_rgba()), inside)
    taken = np.zeros_like(lines)
    for box in sorted(found, key=lambda one: (-len(one.texts), -one.size[0])):
        corner = _nearest_free_corner(box, inside[:2], lines, insides, taken)
        _put_label(axis, box, corner, taken, inside[:2])


def _covered_cells(pixels: Any, inside: Array) -> tuple[Array, Array]:
    """Cells of a picture: 1 for a line, and 1 for a line or a part's inside."""
    left, bottom, right, top = inside.round().astype(int)
    gray = pixels[::-1, :, :3][bottom:top, left:right].min(axis=2) / 255.0
    rows, columns = (n // CELL for n in gray.shape)
    gray = gray[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL).min(axis=(1, 3))
    border = np.zeros_like(gray)
    border[[0, -1]] = border[:, [0, -1]] = 1.0
    return np.maximum(border, gray < DARK), np.maximum(border, gray < LIGHT)


def _nearest_free_corner(box: _Box, origin: Array, lines: Array, insides: Array, taken: Array) -> Array:
    """Corner [px] of the label's place that covers least and is then nearest."""
    wide, high = np.ceil(box.size / CELL).astype(int)
    rows, columns = lines.shape
    wide, high = min(wide, columns), min(high, rows)
    point, radius = (box.point - origin) / CELL, box.radius / CELL
    x, y = np.arange(columns - wide + 1), np.arange(rows - high + 1)
    off = [np.maximum(np.maximum(low - at, at - low - size), 0.0)
           for at, low, size in ((point[0], x, wide), (point[1], y, high))]  # fmt: skip
    distance = np.hypot(off[0][None, :], off[1][:, None])
    cells = insides + 2.0 * taken
    covered = _box_sums(cells, wide, high)
    if radius > 0.0:  # inside its sprocket only lines count
        reach = [np.maximum(np.abs(low - at), np.abs(low + size - at))
                 for at, low, size in ((point[0], x, wide), (point[1], y, high))]  # fmt: skip
        own = np.hypot(reach[0][None, :], reach[1][:, None]) < radius
        covered = np.where(own, _box_sums(lines + 2.0 * taken, wide, high), covered)
    cost = COVER_COST * covered + distance + 0.4 * np.abs(x + 0.5 * wide - point[0])[None, :]
    cost += 0.1 * (y + 0.5 * high - point[1])[:, None]  # rather below than above
    best = np.argpartition(cost, min(LEADER_TRIES, cost.size - 1), axis=None)[:LEADER_TRIES]
    best = best[np.argsort(cost.ravel()[best], kind="stable")]
    corners = [origin + CELL * np.array(np.unravel_index(k, cost.shape)[::-1], dtype=float) for k in best]
    free = (corner for corner in corners if not _leader_cells(box, corner, origin, taken).any())
    return next(free, corners[0])


def _leader_ends(box: _Box, corner: Array) -> Array:
    """Ends (2, 2) [px] of the line from a label's point or sprocket to its box."""
    end = np.clip(box.point, corner + CLEARANCE, corner + box.size - CLEARANCE)
    away = float(np.hypot(*(end - box.point)))
    return np.array([box.point + (end - box.point) * min(1.0, box.radius / max(away, 1e-9)), end])


def _leader_cells(box: _Box, corner: Array, origin: Array, cells: Array) -> Array:
    """Values of cells that a label's line passes."""
    start, end = _leader_ends(box, corner)
    steps = (start + np.linspace(0.0, 0.98, 60)[:, None] * (end - start) - origin) / CELL
    return cells[_numbers_within(steps[:, 1], cells.shape[0]), _numbers_within(steps[:, 0], cells.shape[1])]


def _box_sums(cells: Array, wide: int, high: int) -> Array:
    """Sums of cells in a label's boxes, by lower left corner."""
    total = np.zeros(np.add(cells.shape, 1))
    total[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    return total[high:, wide:] - total[:-high, wide:] - total[high:, :-wide] + total[:-high, :-wide]


def _put_label(axis: Any, box: _Box, corner: Array, taken: Array, origin: Array) -> None:
    """Places a label's texts in its box, with a line if far off, and marks their cells."""
    scale = axis.figure.dpi / 72.0
    middle, top = corner[0] + 0.5 * box.size[0], corner[1] + box.size[1] - CLEARANCE
    for text, size in zip(box.texts, box.sizes, strict=True):
        text.set(ha="center", va="bottom", ma="center")
        text.xyann = tuple((np.array([middle, top - size[1]]) - box.point) / scale)
        top -= size[1] + 2.0
    ends = _leader_ends(box, corner)
    if np.hypot(*(ends[1] - ends[0])) > LEADER_LENGTH * scale:
        color = box.texts[0].get_color()
        axis.plot(*axis.transData.inverted().transform(ends).T, color=color, lw=0.5, alpha=0.7, zorder=4.5)
        columns, rows = ((ends[0] + np.linspace(0.0, 1.0, 300)[:, None] * (ends[1] - ends[0]) - origin) / CELL).T
        taken[_numbers_within(rows, taken.shape[0]), _numbers_within(columns, taken.shape[1])] = 1.0
    left, bottom = ((corner - origin) / CELL).astype(int)
    right, above = np.ceil((corner + box.size - origin) / CELL).astype(int)
    taken[bottom:above, left:right] = 1.0


def _numbers_within(places: Array, count: int) -> NDArray[np.int64]:
    """Numbers of cells at places, kept within `count`."""
    return places.astype(int).clip(0, count - 1)
