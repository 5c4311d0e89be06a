"""Charts with axes of their own in Rerun's 2D views: images, spectra, scatters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.view.palette import Color
from warpchain.view.rerun.streams import ComponentValues, entity_path, line_strip_array, list_array, send_columns

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

INK_COLOR, GRID_COLOR = (200, 200, 200), (60, 60, 60)
BACKGROUND_COLOR = (13, 14, 16)
WIDE_CHART = 4.4
"""Width over height of charts that fill a tab."""
BAR_WIDTH = 0.06
"""Width of a color bar over the chart's height."""
MOST_INPUTS, MOST_METRICS = 3, 4
"""Most inputs and metrics of scatters by default."""
SCATTER_WIDTH = 1.1


@dataclass(frozen=True)
class ChartAxis:
    """Axis of a Rerun chart: label, ends, linear or logarithmic."""

    label: str
    low: float
    high: float
    logarithmic: bool = False

    def axis_shares(self, values: Any) -> NDArray[np.float64]:
        """Places of values along a chart's axis, from 0 to 1."""
        scale: Callable[[Any], Any] = np.log10 if self.logarithmic else np.asarray
        low, high = scale(self.low), scale(self.high)
        held = np.maximum(values, self.low) if self.logarithmic else values
        return np.asarray((scale(held) - low) / (high - low), dtype=float)

    def tick_values(self, most: int) -> NDArray[np.float64]:
        """Round values for a chart axis's ticks, about `most`."""
        from matplotlib.ticker import LogLocator, MaxNLocator

        locator = LogLocator(numticks=8) if self.logarithmic else MaxNLocator(most)
        values = np.asarray(locator.tick_values(self.low, self.high))
        slack = 1e-9 * (self.high - self.low)
        return values[(values >= self.low - slack) & (values <= self.high + slack)]


def axis_around(values: Any, label: str) -> ChartAxis:
    """Linear chart axis around all finite values."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    room = 0.05 * (high - low) or 0.05 * abs(high) or 0.5
    return ChartAxis(label, low - room, high + room)


@dataclass(frozen=True)
class Chart:
    """Chart in a Rerun view: a rectangle of `width` by 1 with axes, below one entity.

    `beside` is room for a key on its right; `few` lets it have few ticks.
    """

    stream: rr.RecordingStream
    path: tuple[str, ...]
    x: ChartAxis
    y: ChartAxis
    width: float = 1.8
    beside: float = 0.1
    few: bool = False

    def _chart_points(self, x: Any, y: Any) -> NDArray[np.float32]:
        """Points (..., 2) in the Rerun view of a chart's values."""
        return np.stack(
            np.broadcast_arrays(self.width * self.x.axis_shares(x), 1.0 - self.y.axis_shares(y)), -1
        ).astype(np.float32)

    def log_frame(self, grid: bool = True) -> None:
        """Logs the chart's border, ticks, labels and grid to Rerun."""
        import rerun as rr

        across, up = self.x.tick_values(3 if self.few else 8), self.y.tick_values(4)
        rules = [self._chart_points([v, v], [self.y.low, self.y.high]) for v in across if grid]
        rules += [self._chart_points([self.x.low, self.x.high], [v, v]) for v in up if grid]
        w = self.width
        lines = rr.LineStrips2D(
            [*rules, np.array([[0, 0], [w, 0], [w, 1], [0, 1], [0, 0]])],
            colors=[GRID_COLOR] * len(rules) + [INK_COLOR],
            radii=rr.Radius.ui_points(0.5),
        )
        self.stream.log(
            entity_path(*self.path, "frame"), lines, rr.LineStrips2D.from_fields(draw_order=-1.0), static=True
        )
        below = self._chart_points(across, self.y.low) + np.array([0.0, 0.05])
        beside = self._chart_points(self.x.low, up) - np.array([0.06, 0.035])
        titles = np.array([[0.5 * w, 1.13], [0.0, -0.06]], dtype=np.float32)
        words = [f"{v:g}" for v in across] + [f"{v:g}" for v in up]
        self._log_words("ticks", np.vstack([below, beside]), words, INK_COLOR)
        named = [(at, label) for at, label in zip(titles, (self.x.label, self.y.label), strict=True) if label]
        self._log_words("labels", np.array([at for at, _ in named]), [label for _, label in named], INK_COLOR)

    def _log_words(self, name: str, at: Any, words: Sequence[str], color: tuple[int, int, int]) -> None:
        """Logs words at points of the chart to Rerun."""
        import rerun as rr

        dots = rr.Points2D(at, labels=words, colors=[color], radii=rr.Radius.ui_points(0.0), show_labels=True)
        self.stream.log(entity_path(*self.path, name), dots, static=True)

    def log_line(self, name: str, x: Any, y: Any, color: tuple[int, int, int]) -> None:
        """Logs a curve of the chart to Rerun."""
        import rerun as rr

        curve = rr.LineStrips2D([self._chart_points(x, y)], colors=[color], radii=rr.Radius.ui_points(0.8))
        self.stream.log(entity_path(*self.path, name), curve, static=True)

    def log_verticals(self, name: str, x: Any, words: Sequence[str], color: tuple[int, int, int]) -> None:
        """Logs upright lines with words to the chart in Rerun."""
        import rerun as rr

        lines = [self._chart_points([v, v], [self.y.low, self.y.high]) for v in x]
        upright = rr.LineStrips2D(lines, colors=[color], radii=rr.Radius.ui_points(0.6))
        self.stream.log(entity_path(*self.path, name), upright, static=True)
        self._log_words(f"{name} names", self._chart_points(x, self.y.high) + np.array([0.0, 0.04]), words, color)

    def log_key(self, row: int, words: str, color: tuple[int, int, int]) -> None:
        """Logs a row of the chart's key to Rerun."""
        at = np.array([[self.width + 0.5 * self.beside, 0.05 + 0.07 * row]], dtype=np.float32)
        self._log_words(f"key {row}", at, [words], color)

    def log_dots(
        self, name: str, x: Any, y: Any, words: Sequence[str], color: tuple[int, int, int], size: float
    ) -> None:
        """Logs points with words to the chart in Rerun."""
        import rerun as rr

        at = self._chart_points(x, y)
        points = rr.Points2D(at, labels=words, colors=[color], radii=rr.Radius.ui_points(size), show_labels=False)
        self.stream.log(entity_path(*self.path, name), points, static=True)

    def log_image(self, name: str, pixels: NDArray[np.uint8]) -> None:
        """Logs an image (rows, columns, 3) over the chart to Rerun."""
        import rerun as rr

        path = entity_path(*self.path, name)
        scale = rr.Transform3D(scale=[self.width / pixels.shape[1], 1.0 / pixels.shape[0], 1.0])
        self.stream.log(path, scale, rr.Image(pixels, draw_order=-10.0), static=True)

    def log_color_bar(self, pixels: NDArray[np.uint8], values: ChartAxis) -> None:
        """Logs a color bar (rows, 1, 3) right of the chart, with ticks, to Rerun."""
        import rerun as rr

        left = self.width + 0.08
        scale = rr.Transform3D(translation=[left, 0.0, 0.0], scale=[BAR_WIDTH, 1.0 / len(pixels), 1.0])
        self.stream.log(entity_path(*self.path, "color bar"), scale, rr.Image(pixels, draw_order=-10.0), static=True)
        ticks = values.tick_values(4)
        at = np.stack([np.full(len(ticks), left + BAR_WIDTH + 0.13), 1.0 - values.axis_shares(ticks) - 0.035], axis=1)
        self._log_words("color ticks", at, [f"{tick:g}" for tick in ticks], INK_COLOR)
        self._log_words("color label", np.array([[left + 0.5 * BAR_WIDTH, -0.06]]), [values.label], INK_COLOR)

    def log_cursor(self, name: str, time: NDArray[np.floating]) -> None:
        """Logs a cursor to Rerun that follows the playback along the chart."""
        import rerun as rr

        line = self._chart_points(np.asarray(time)[:, None], np.array([self.y.low, self.y.high]))
        path = entity_path(*self.path, name)
        style = rr.LineStrips2D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(1.0))
        self.stream.log(path, style, static=True)
        send_columns(
            self.stream,
            path,
            time,
            [ComponentValues(rr.LineStrips2D.descriptor_strips(), list_array(line_strip_array(line), 1, len(time)))],
        )

    def chart_view(self, name: str) -> rrb.Spatial2DView:
        """2D view of Rerun that shows the whole chart."""
        import rerun.blueprint as rrb

        bounds = rrb.VisualBounds2D(x_range=[-0.2, self.width + self.beside], y_range=[-0.1, 1.2])
        return rrb.Spatial2DView(
            origin=entity_path(*self.path), name=name, visual_bounds=bounds, background=BACKGROUND_COLOR
        )


@dataclass(frozen=True)
class AxisQuantity:
    """Quantity on a Rerun scatter's axis: name, values (R,), unit."""

    name: str
    values: NDArray[np.float64]
    unit: str = ""

    @property
    def title(self) -> str:
        """Name of a scatter's quantity with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class DotGroup:
    """Dots of one kind in a Rerun scatter, of rows (K,)."""

    kind: str
    color: Color
    size: float
    rows: NDArray[np.intp]


def log_scatter(
    stream: rr.RecordingStream,
    root: str,
    x: AxisQuantity,
    y: AxisQuantity,
    groups: Sequence[DotGroup],
    variants: NDArray[np.integer],
    ranged: NDArray[np.bool_] | None = None,
) -> Chart:
    """Logs a scatter of two quantities to Rerun; returns its chart.

    `variants` (R,) numbers each row's variant; `ranged` (R,) are the rows that the vertical axis holds.
    """
    held = y.values if ranged is None else y.values[ranged]
    axes = axis_around(x.values, x.name), axis_around(held, "")
    chart = Chart(stream, (root, x.name, y.title), *axes, SCATTER_WIDTH, few=True)
    chart.log_frame()
    for dots in groups:
        rows = dots.rows[np.isfinite(x.values[dots.rows]) & np.isfinite(y.values[dots.rows])]
        if len(rows):
            words = [
                f"variant {variants[r]}: {x.name} = {x.values[r]:.6g}, {y.name} = {y.values[r]:.6g} {y.unit}".rstrip()
                for r in rows
            ]
            chart.log_dots(dots.kind, x.values[rows], y.values[rows], words, dots.color, dots.size)
    return chart
