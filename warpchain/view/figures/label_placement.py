"""Placement of a picture's labels where they cover neither parts nor each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LABEL_DISTANCES, LABEL_DIRECTIONS = (3.0, 7.0, 12.0, 18.0, 26.0, 36.0, 48.0), 24
"""Distances [pt] of a label from its point to try, and number of directions."""
TEXT_COST, MOVE_COST = 20.0, 2.0
"""Cost of another label's covered pixel and of a point's move; a part's pixel costs 1."""


def move_labels(axis: Any, fixed: Array) -> None:
    """Moves a picture's labels, the widest first, to where they cover least; those at `fixed` (n, 2) stay."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure, texts = axis.figure, list(axis.texts)
    canvas = FigureCanvasAgg(figure)
    figure.draw_without_rendering()  # lays the figure out around all texts
    layout = figure.get_layout_engine()
    figure.set_layout_engine("none")
    boxes = {text: np.array(text.get_window_extent(canvas.get_renderer()).padded(1.0).extents) for text in texts}
    for text in texts:
        text.set_visible(False)
    canvas.draw()
    for text in texts:
        text.set_visible(True)
    figure.set_layout_engine(layout)
    covered = (np.asarray(canvas.buffer_rgba())[::-1, :, :3] < 255).any(axis=2).astype(float)  # rows from below
    movable = [text for text in texts if not np.isclose(fixed, text.xy).all(axis=1).any()]
    for text in set(texts) - set(movable):
        covered[_box_pixels(boxes[text])] = TEXT_COST
    inside, scale = np.array(axis.bbox.extents), figure.dpi / 72.0
    for label in sorted(movable, key=lambda label: float(boxes[label][0] - boxes[label][2])):
        box = boxes[label]
        ways = _label_moves(box, axis.transData.transform(label.xy), scale)
        costs = [_covering_cost(covered, box + np.tile(way, 2), inside) for way in ways]
        way = ways[int(np.argmin(np.add(costs, MOVE_COST / scale * np.hypot(*ways.T))))]
        label.xyann = tuple(np.add(label.xyann, way / scale))
        covered[_box_pixels(box + np.tile(way, 2))] = TEXT_COST


def _label_moves(box: Array, point: Array, scale: float) -> Array:
    """Moves (n, 2) [px] to try for a label's box."""
    half, middle = 0.5 * (box[2:] - box[:2]), 0.5 * (box[2:] + box[:2])
    angle = np.arange(LABEL_DIRECTIONS) * (2.0 * np.pi / LABEL_DIRECTIONS)
    to = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    edge = (half / np.maximum(np.abs(to), 1e-9)).min(axis=1)  # from the box's middle to its edge
    places = [point + (edge + scale * reach)[:, None] * to for reach in LABEL_DISTANCES]
    return np.concatenate([np.zeros((1, 2)), *(place - middle for place in places)])


def _box_pixels(box: Array) -> tuple[slice, slice]:
    """Rows and columns of a label box's pixels."""
    left, bottom, right, top = np.maximum(box, 0.0).round().astype(int)
    return slice(bottom, top), slice(left, right)


def _covering_cost(covered: Array, box: Array, inside: Array) -> float:
    """Pixels that a label's box covers; infinite where it leaves the axes."""
    if (box[:2] < inside[:2]).any() or (box[2:] > inside[2:]).any():
        return np.inf
    return float(covered[_box_pixels(box)].sum())
