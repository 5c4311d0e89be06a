"""Charts with axes of their own in Rerun's 2D views, for images, spectra and scatters, which do not run over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.view.palette import Color
from warpchain.view.rerun.streams import Column, entity, rows, send, strips

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

INK, FAINT = (200, 200, 200), (60, 60, 60)
BACKGROUND = (13, 14, 16)
"""Of 2D views, in the viewer's light theme too: their colors are made for it."""
WIDE = 3.6
"""Width of charts that have a tab's whole width, over their height."""
INPUTS, METRICS = 3, 4
"""Most inputs and metrics that scatters are drawn for where none are named."""
WIDTH = 1.1
"""Width of a scatter over its height."""


@dataclass(frozen=True)
class Axis:
    """One direction of a chart.

    Attributes:
        label: quantity and unit.
        low, high: ends, low < high; above 0 where logarithmic.
        logarithmic: whether equal lengths are equal ratios.
    """

    label: str
    low: float
    high: float
    logarithmic: bool = False

    def place(self, values: Any) -> NDArray[np.float64]:
        """Values as parts of the axis, 0 at its low end and 1 at its high end."""
        scale: Callable[[Any], Any] = np.log10 if self.logarithmic else np.asarray
        low, high = scale(self.low), scale(self.high)
        held = np.maximum(values, self.low) if self.logarithmic else values
        return np.asarray((scale(held) - low) / (high - low), dtype=float)

    def ticks(self, most: int) -> NDArray[np.float64]:
        """Round values between the ends, about `most` of them."""
        from matplotlib.ticker import LogLocator, MaxNLocator

        locator = LogLocator(numticks=8) if self.logarithmic else MaxNLocator(most)
        values = np.asarray(locator.tick_values(self.low, self.high))
        slack = 1e-9 * (self.high - self.low)
        return values[(values >= self.low - slack) & (values <= self.high + slack)]


def around(values: Any, label: str) -> Axis:
    """A linear axis that holds all finite values with a little room."""
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    room = 0.05 * (high - low) or 0.05 * abs(high) or 0.5
    return Axis(label, low - room, high + room)


@dataclass(frozen=True)
class Chart:
    """A rectangle of width `width` and height 1 with ticks and labels, below one entity.

    Attributes:
        beside: room for a key on its right.
        few: whether there is room for a few ticks only.
    """

    stream: rr.RecordingStream
    path: tuple[str, ...]
    x: Axis
    y: Axis
    width: float = 1.8
    beside: float = 0.1
    few: bool = False

    def _points(self, x: Any, y: Any) -> NDArray[np.float32]:
        return np.stack(np.broadcast_arrays(self.width * self.x.place(x), 1.0 - self.y.place(y)), -1).astype(np.float32)

    def frame(self, grid: bool = True) -> None:
        """Draws border, ticks, labels, and lines from tick to tick if asked for."""
        import rerun as rr

        across, up = self.x.ticks(3 if self.few else 8), self.y.ticks(4)
        rules = [self._points([v, v], [self.y.low, self.y.high]) for v in across if grid]
        rules += [self._points([self.x.low, self.x.high], [v, v]) for v in up if grid]
        w = self.width
        lines = rr.LineStrips2D(
            [*rules, np.array([[0, 0], [w, 0], [w, 1], [0, 1], [0, 0]])],
            colors=[FAINT] * len(rules) + [INK],
            radii=rr.Radius.ui_points(0.5),
        )
        self.stream.log(entity(*self.path, "frame"), lines, rr.LineStrips2D.from_fields(draw_order=-1.0), static=True)
        below = self._points(across, self.y.low) + np.array([0.0, 0.05])
        beside = self._points(self.x.low, up) - np.array([0.06, 0.035])
        titles = np.array([[0.5 * w, 1.13], [0.0, -0.06]], dtype=np.float32)
        words = [f"{v:g}" for v in across] + [f"{v:g}" for v in up]
        self._words("ticks", np.vstack([below, beside]), words, INK)
        named = [(at, label) for at, label in zip(titles, (self.x.label, self.y.label), strict=True) if label]
        self._words("labels", np.array([at for at, _ in named]), [label for _, label in named], INK)

    def _words(self, name: str, at: Any, words: Sequence[str], color: tuple[int, int, int]) -> None:
        import rerun as rr

        dots = rr.Points2D(at, labels=words, colors=[color], radii=rr.Radius.ui_points(0.0), show_labels=True)
        self.stream.log(entity(*self.path, name), dots, static=True)

    def line(self, name: str, x: Any, y: Any, color: tuple[int, int, int]) -> None:
        """A curve."""
        import rerun as rr

        curve = rr.LineStrips2D([self._points(x, y)], colors=[color], radii=rr.Radius.ui_points(0.8))
        self.stream.log(entity(*self.path, name), curve, static=True)

    def verticals(self, name: str, x: Any, words: Sequence[str], color: tuple[int, int, int]) -> None:
        """Upright lines with words at their tops."""
        import rerun as rr

        lines = [self._points([v, v], [self.y.low, self.y.high]) for v in x]
        upright = rr.LineStrips2D(lines, colors=[color], radii=rr.Radius.ui_points(0.6))
        self.stream.log(entity(*self.path, name), upright, static=True)
        self._words(f"{name} names", self._points(x, self.y.high) + np.array([0.0, 0.04]), words, color)

    def key(self, row: int, words: str, color: tuple[int, int, int]) -> None:
        """Words in a curve's color, in rows on the right."""
        at = np.array([[self.width + 0.5 * self.beside, 0.05 + 0.07 * row]], dtype=np.float32)
        self._words(f"key {row}", at, [words], color)

    def dots(self, name: str, x: Any, y: Any, words: Sequence[str], color: tuple[int, int, int], size: float) -> None:
        """Points whose words show when they are selected."""
        import rerun as rr

        at = self._points(x, y)
        points = rr.Points2D(at, labels=words, colors=[color], radii=rr.Radius.ui_points(size), show_labels=False)
        self.stream.log(entity(*self.path, name), points, static=True)

    def image(self, name: str, pixels: NDArray[np.uint8]) -> None:
        """An image (rows, columns, 3) over the whole rectangle, its first row at the top."""
        import rerun as rr

        path = entity(*self.path, name)
        scale = rr.Transform3D(scale=[self.width / pixels.shape[1], 1.0 / pixels.shape[0], 1.0])
        self.stream.log(path, scale, rr.Image(pixels, draw_order=-10.0), static=True)

    def cursor(self, name: str, time: NDArray[np.floating]) -> None:
        """An upright line that runs along an axis of time with the playback."""
        import rerun as rr

        line = self._points(np.asarray(time)[:, None], np.array([self.y.low, self.y.high]))
        path = entity(*self.path, name)
        style = rr.LineStrips2D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(1.0))
        self.stream.log(path, style, static=True)
        send(self.stream, path, time, [Column(rr.LineStrips2D.descriptor_strips(), rows(strips(line), 1, len(time)))])

    def view(self, name: str) -> rrb.Spatial2DView:
        """The view that shows it all."""
        import rerun.blueprint as rrb

        bounds = rrb.VisualBounds2D(x_range=[-0.2, self.width + self.beside], y_range=[-0.1, 1.2])
        return rrb.Spatial2DView(origin=entity(*self.path), name=name, visual_bounds=bounds, background=BACKGROUND)


@dataclass(frozen=True)
class Quantity:
    """Quantity of an axis.

    Attributes:
        name: a factor or metric.
        values: (R,) its values; dots are drawn where they are finite.
        unit: its unit, "" for none.
    """

    name: str
    values: NDArray[np.float64]
    unit: str = ""

    @property
    def title(self) -> str:
        """The name with its unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Dots:
    """Dots of one kind.

    Attributes:
        kind: what they are called.
        color, size: of the dots; the size in pixels.
        rows: (K,) which rows are drawn so.
    """

    kind: str
    color: Color
    size: float
    rows: NDArray[np.intp]


def log_scatter(
    stream: rr.RecordingStream,
    root: str,
    x: Quantity,
    y: Quantity,
    groups: Sequence[Dots],
    variants: NDArray[np.integer],
    ranged: NDArray[np.bool_] | None = None,
) -> Chart:
    """Logs one scatter.

    Args:
        root: first part of its path.
        x, y: what is drawn over each other.
        groups: the dots, the last ones on top.
        variants: (R,) number of each row's variant.
        ranged: (R,) rows that the vertical axis holds; None is all.
    """
    held = y.values if ranged is None else y.values[ranged]
    axes = around(x.values, x.name), around(held, "")
    chart = Chart(stream, (root, x.name, y.title), *axes, WIDTH, few=True)
    chart.frame()
    for dots in groups:
        rows = dots.rows[np.isfinite(x.values[dots.rows]) & np.isfinite(y.values[dots.rows])]
        if len(rows):
            words = [
                f"variant {variants[r]}: {x.name} = {x.values[r]:.6g}, {y.name} = {y.values[r]:.6g} {y.unit}".rstrip()
                for r in rows
            ]
            chart.dots(dots.kind, x.values[rows], y.values[rows], words, dots.color, dots.size)
    return chart
