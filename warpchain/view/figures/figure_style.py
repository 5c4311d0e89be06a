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
"""Colors of sprockets in figures where they must differ."""
LINE_COLORS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown")
_STEADY = 0.01
"""Share of the top speed within which a mean speed is that."""
CURVE_SPELLS = 4000
"""Spells of a figure's curve, of each the smallest and largest value drawn."""


def strand_label(name: str) -> str:
    """A strand's name with an arrow sign for "->"."""
    return name.replace("->", " \N{RIGHTWARDS ARROW} ")


def run_line(of: Drive | Trajectory) -> str:
    """Figure's title line of a drive or run: links, pitch, driver's speed, temperature."""
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
    """The driver's name and speed in words, of a run its mean if not the top speed."""
    parts = of if isinstance(of, Drive) else of.parts
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
    """Revolutions a minute of an angular speed [rad/s]."""
    return speed * 30.0 / np.pi


def panel_column(
    rows: int, height: float, title: str, of: Drive | Trajectory | None, share: bool = True
) -> tuple[Figure, list[Any]]:
    """An empty figure of panels below each other, each figure `height` [in] high, with its axes."""
    from warpchain.view.figures.plain_figure import PlainFigure

    figure = PlainFigure(figsize=(10.0, height), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=share, squeeze=False)[:, 0]
    if title:
        figure.suptitle(title if of is None else f"{title}\n{run_line(of)}", fontsize=12)
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.margins(x=0.0)
    return figure, list(axes)


def draw_legend(axis: Any) -> None:
    """Draws a panel's legend on its right, if curves have names."""
    if axis.get_legend_handles_labels()[0]:
        beside: Any = {"loc": "upper left", "bbox_to_anchor": (1.005, 1.0), "borderaxespad": 0.0}
        axis.legend(fontsize=8, frameon=False, handlelength=1.4, **beside)


def draw_tooth_orders(axis: Any, teeth: int) -> None:
    """Draws dotted lines at a driver's tooth-passing orders into a spectrum."""
    for k in range(1, TOOTH_PASSINGS + 1):
        label = f"tooth passing, multiples of {teeth}" if k == 1 else None
        axis.axvline(k * teeth, color="black", lw=0.8, ls=":", label=label)


def panel_grid(count: int, columns: int, width: float, height: float) -> tuple[Figure, list[Any]]:
    """An empty figure of panels of `width` by `height` [in] in `columns`, with its axes."""
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
    """Draws a curve into a panel, thinned to its peaks."""
    kept = peak_frames(y, CURVE_SPELLS)
    axis.plot(x[kept], y[kept], **{"lw": 0.8, **style})


def save_figure(figure: Figure, path: Path) -> None:
    """Writes a figure as its path's ending says, whole or not at all; raises ArchiveError."""
    with refusals_as_errors(path, ArchiveError), whole_file(path) as file:
        figure.savefig(file, format=path.suffix[1:], dpi=130)


def save_figures(figures: Mapping[str, Figure], folder: str | Path, kinds: str | Sequence[str]) -> list[Path]:
    """Writes figures to a folder as NAME.png or NAME.svg and returns the paths.

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
                    metadata = {"Date": None} if kind == "svg" else None
                    figure.savefig(file, format=kind, dpi=130, metadata=metadata)
    return paths
