"""Style of all figures: panels, titles, line colors, curves thinned to their peaks, files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.drive.body_ties import driving_body, part_of_body
from warpchain.errors import ArchiveError, SimulationError
from warpchain.files import refusals_as_errors, whole_file
from warpchain.model import Model
from warpchain.results.run import Trajectory
from warpchain.results.signals import TOOTH_PASSINGS, driver_speed_and_window, peak_frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FIGURE_KINDS = ("png", "svg")
SPROCKET_COLORS = ("tab:orange", "tab:green", "tab:purple", "tab:red", "tab:brown", "tab:cyan")
"""Colors of sprockets in figures."""
LINE_COLORS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown")
CHAIN_COLORS = ("#1f77b4", "#e8710a", "#2a9d4a", "#8b5fbf", "#c9302c", "#0fa3b1")
"""Colors of chains in figures."""
FILE_DPI = 120
"""Pixels an inch of a figure's file."""
MOST_TICKS = 6
COLUMN_WIDTH, TICK_SIZE, LEGEND_SIZE = 10.0, 9.0, 8.0
"""Width of a column of panels [in], sizes of ticks' and legends' texts [pt]."""
FIGURE_STYLE: Any = {
    "axes.titley": 1.0,  # which saves looking for a place free of ticks
    "axes.titlesize": 10,
    "axes.labelsize": 9.5,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "figure.titlesize": 11.5,
}
"""Settings of matplotlib for figures of panels."""
LEGEND_PLACE: dict[str, Any] = {
    "loc": "lower right",
    "bbox_to_anchor": (1.0, 1.0),
    "borderaxespad": 0.1,
    "borderpad": 0.2,
    "fontsize": LEGEND_SIZE,
    "frameon": False,
    "handlelength": 1.4,
    "columnspacing": 1.2,
    "labelspacing": 0.25,
}
"""Settings of a panel's legend, above it on the right."""
FILE_SETTINGS: dict[str, dict[str, Any]] = {
    "png": {"pil_kwargs": {"compress_level": 3}},  # a third of the usual time, a tenth more bytes
    "svg": {"metadata": {"Date": None}},
}
"""Settings of figures' files, by kind."""
_STEADY = 0.01
"""Relative difference up to which a mean speed counts as the top speed."""
CURVE_SPELLS = 4000
"""Spells of a curve, each drawn by its smallest and largest value."""


def strand_label(name: str) -> str:
    """Strand's name in figures, with an arrow sign for "->"."""
    return name.replace("->", " \N{RIGHTWARDS ARROW} ")


def run_line(of: Drive | Trajectory) -> str:
    """Figure's title line of a drive or run: links, pitch, speed, temperature."""
    drive = of if isinstance(of, Drive) else of.drive
    own = None if isinstance(of, Drive) or of.chain is None else f"{of.chain.name}."
    prefixed = zip(drive.chain_prefixes, drive.as_read.each_chain, strict=True)
    chains = [chain for prefix, chain in prefixed if own in (None, ".", prefix)]
    pitches = " and ".join(f"{1e3 * pitch:g}" for pitch in dict.fromkeys(chain.pitch for chain in chains))
    among = f" in {len(chains)} chains" if len(chains) > 1 else ""
    return f"{sum(chain.links for chain in chains)} links of {pitches} mm{among}, {driver_speed_text(of)}" + (
        "" if drive.temperature is None else f", {drive.temperature:g} \N{DEGREE SIGN}C"
    )


def driver_speed_text(of: Drive | Trajectory) -> str:
    """Text in figures of the driver's name and speed, of a run its mean."""
    parts = of if isinstance(of, Drive) else of.parts
    if parts.sprockets[parts.driver].is_end:
        return "nothing drives"
    name, top = parts.sprockets[parts.driver].name, (Model(parts) if isinstance(parts, Drive) else parts).driver_speed
    if isinstance(of, Drive):
        led = part_of_body(of, driving_body(of)).prescribed is not None
        return f"{name} {'at' if led else 'up to about'} {rpm_of_speed(top):.4g} rpm"
    found = driver_speed_and_window(of)
    if found is None:
        return name
    mean, start, end = found
    window = "" if abs(mean - top) <= _STEADY * top else f" in the mean of {start:.4g} to {end:.4g} s"
    return f"{name} at {rpm_of_speed(mean):.4g} rpm{window}"


def rpm_of_speed(speed: float) -> float:
    """Revolutions a minute at an angular speed [rad/s]."""
    return speed * 30.0 / np.pi


def panel_column(
    rows: int, height: float, title: str, of: Drive | Trajectory | None, share: bool = True, right: float = 0.16
) -> tuple[Figure, list[Any]]:
    """Empty figure of panels one below the other, each `height` [in] high, and its axes.

    Args:
        right: room [in] beside the panels, of a color bar or of a second axis.
    """
    from matplotlib import rc_context

    from warpchain.view.figures.plain_figure import PanelLayout, PlainFigure

    with rc_context(FIGURE_STYLE):
        figure = PlainFigure(figsize=(COLUMN_WIDTH, height))
        axes = list(figure.subplots(rows, 1, sharex=share, squeeze=False)[:, 0])
        figure.set_layout_engine(PanelLayout(axes, right))
        if title:
            figure.suptitle(title if of is None else f"{title}\n{run_line(of)}", y=1.0 - 0.06 / height, va="top")
    for axis in axes:
        axis.tick_params(labelsize=TICK_SIZE)
        axis.margins(x=0.0)
        axis.locator_params(axis="y", nbins=MOST_TICKS)
    return figure, axes


def draw_legend(axis: Any, title: str = "") -> None:
    """Draws a figure panel's legend above it, beside its title."""
    from warpchain.view.figures.plain_figure import LETTER_WIDTH, PanelLayout

    words = axis.get_legend_handles_labels()[1]
    if not words:
        return
    words = [*([title] if title else []), *words]
    head = LETTER_WIDTH * 10.0 * len(axis.get_title("left")) + 0.2
    room = COLUMN_WIDTH - 1.3 - head
    columns = next(n for n in range(len(words), 0, -1) if n == 1 or _legend_width(words, n) <= room)
    if title:  # which no curve has
        axis.plot([], [], " ", label=title)
        handles, names = axis.get_legend_handles_labels()
        axis.legend(handles[-1:] + handles[:-1], names[-1:] + names[:-1], ncols=columns, **LEGEND_PLACE)
    else:
        axis.legend(ncols=columns, **LEGEND_PLACE)
    layout = axis.figure.get_layout_engine()
    if isinstance(layout, PanelLayout):
        layout.legend_rows = max(layout.legend_rows, -(-len(words) // columns))


def _legend_width(words: Sequence[str], columns: int) -> float:
    """Width [in] of a figure's legend in a number of columns."""
    from warpchain.view.figures.plain_figure import LETTER_WIDTH

    rows = -(-len(words) // columns)
    each = [max(map(len, words[k : k + rows])) for k in range(0, len(words), rows)]
    return sum(0.36 + LETTER_WIDTH * LEGEND_SIZE * letters for letters in each)


def draw_color_bar(axis: Any, image: Any, label: str, **settings: Any) -> None:
    """Draws the color bar of a figure's image beside its panel."""
    bar = axis.figure.colorbar(image, ax=axis, fraction=0.02, pad=0.015, aspect=30, **settings)
    bar.set_label(label, fontsize=9.5)
    bar.ax.tick_params(labelsize=TICK_SIZE)


def draw_tooth_orders(axis: Any, teeth: int) -> None:
    """Draws lines at the driver's tooth-passing orders into a spectrum."""
    for k in range(1, TOOTH_PASSINGS + 1):
        label = f"tooth passing, multiples of {teeth}" if k == 1 else None
        axis.axvline(k * teeth, color="black", lw=0.8, ls=":", label=label)


def set_log_scale(axis: Any) -> None:
    """Gives a panel's upright axis a logarithmic scale, its ticks plain texts."""
    from matplotlib.ticker import FuncFormatter, NullLocator

    axis.set_yscale("log")
    axis.yaxis.set_minor_locator(NullLocator())
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: decade_text(value)))


def decade_text(value: float) -> str:
    """Text of a power of ten at a tick: plain from 0.001 to 10,000."""
    if 1e-3 <= value <= 1e4:
        return f"{value:g}"
    exponent = f"{np.log10(value):.0f}" if value > 0.0 else ""
    return "10" + exponent.translate(
        str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
    )


def panel_grid(count: int, columns: int, width: float, height: float) -> tuple[Figure, list[Any]]:
    """Empty figure of panels of `width` by `height` [in] in columns, and its axes."""
    from warpchain.view.figures.plain_figure import PlainFigure

    columns = min(columns, count)
    rows = -(-count // columns)
    figure = PlainFigure(figsize=(width * columns, height * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis in axes[:count]:
        axis.grid(alpha=0.3)
    return figure, axes[:count]


def draw_curve(axis: Any, x: NDArray[np.floating], y: NDArray[np.floating], **style: Any) -> None:
    """Draws a curve into a figure's panel, thinned to its peaks."""
    kept = peak_frames(y, CURVE_SPELLS)
    axis.plot(x[kept], y[kept], **{"lw": 0.8, **style})


def save_figure(figure: Figure, path: Path) -> None:
    """Writes a figure's file, whole or not at all; raises ArchiveError."""
    with refusals_as_errors(path, ArchiveError), whole_file(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=FILE_DPI, **FILE_SETTINGS[path.suffix[1:]])


def save_figures(figures: Mapping[str, Figure], folder: str | Path, kinds: str | Sequence[str]) -> list[Path]:
    """Writes figures to a folder as NAME.png or NAME.svg; returns their paths.

    Raises:
        ArchiveError: a folder that cannot be written.
        SimulationError: another kind.
    """
    import matplotlib

    wanted: Iterable[str] = [kinds] if isinstance(kinds, str) else kinds
    for kind in wanted:
        if kind not in FIGURE_KINDS:
            raise SimulationError(f"format {kind!r}: allowed are {', '.join(FIGURE_KINDS)}")
    target, paths = Path(folder), []
    with refusals_as_errors(target, ArchiveError):
        target.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            for kind in wanted:
                style = matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name})
                paths.append(target / f"{name}.{kind}")
                with style, whole_file(paths[-1]) as file:
                    figure.savefig(file, format=kind, dpi=FILE_DPI, **FILE_SETTINGS[kind])
    return paths
