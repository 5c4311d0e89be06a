"""Figures of test rigs: a measured signal over the simulated one; a tensioner's force loops and sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.results.measured import SignalComparison
from warpchain.results.run import Trajectory
from warpchain.results.signals import SPECTRUM_FLOOR, TOOTH_PASSINGS
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import (
    LINE_COLORS,
    draw_curve,
    draw_legend,
    draw_tooth_orders,
    panel_column,
    set_log_scale,
    strand_label,
)

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

SIGNAL_COLORS = (("simulated", "tab:blue"), ("measured", "tab:orange"))
BAR, MILLI = 1e-5, 1e3
SHOWN_CYCLES = 2
"""Last cycles of a tensioner that are drawn."""


def measured_figure(trajectory: Trajectory, found: SignalComparison) -> Figure:
    """Figure of a measured and a simulated signal over time and order."""
    measured = found.measured
    signals = [(found.time, found.simulated), (measured.time, measured.values)]
    first, last = max(time[0] for time, _ in signals), min(time[-1] for time, _ in signals)
    if last > first:
        signals = [(t[(t >= first) & (t <= last)], values[(t >= first) & (t <= last)]) for t, values in signals]
    unit, factor = display_unit(measured.unit, *(values for _, values in signals))
    spectra = any(spectrum is not None for spectrum in found.spectra)
    title = f"{strand_label(measured.name)}: simulated and measured"
    figure, axes = panel_column(1 + spectra, 3.6 + 3.4 * spectra, title, trajectory, share=False)
    for (word, color), (time, values) in zip(SIGNAL_COLORS, signals, strict=True):
        draw_curve(axes[0], time, factor * values, color=color, label=word)
    axes[0].set_xlabel("time [s]")
    quantity = measured.name.rsplit(".", 1)[-1]
    axes[0].set_ylabel(f"{quantity} [{unit}]")
    draw_legend(axes[0])
    if spectra:
        _draw_order_spectra(axes[1], trajectory.drive, found, factor)
        axes[1].set_ylabel(f"amplitude of {quantity} [{unit}]")
    return figure


def _draw_order_spectra(axis: Any, drive: Drive, found: SignalComparison, factor: float) -> None:
    """Draws order spectra of a rig's and a run's signals into a panel."""
    driver = drive.sprockets[drive.driver]
    last = (TOOTH_PASSINGS + 0.5) * driver.teeth
    peak = 0.0
    for (word, color), spectrum in zip(SIGNAL_COLORS, found.spectra, strict=True):
        if spectrum is not None:
            shown = (spectrum[0] > 0.0) & (spectrum[0] <= last)
            amplitude = factor * spectrum[1][shown]
            draw_curve(axis, spectrum[0][shown], amplitude, color=color, label=word)
            peak = max(peak, float(amplitude.max(initial=0.0)))
    draw_tooth_orders(axis, driver.teeth)
    if peak > 0.0:
        set_log_scale(axis)
        axis.set_ylim(SPECTRUM_FLOOR * peak, 2.0 * peak)
    axis.set_xlim(0.0, last)
    axis.set_xlabel(f"order [multiples of the revolutions of {driver.name}]")
    draw_legend(axis)


def _arrays_by_column(table: pa.Table) -> dict[str, NDArray[np.float64]]:
    """Columns of a rig's tensioner table as arrays, by name."""
    return {name: np.asarray(table[name]) for name in table.column_names}


def tensioner_loop_figure(tables: Mapping[str, pa.Table], cycles: int, title: str) -> Figure:
    """Figure of tensioners' force, pressure and valve lift over displacement, from samples by label."""
    from warpchain.view.figures.plain_figure import PlainFigure

    figure = PlainFigure(figsize=(11.0, 5.2), layout="constrained")
    axes = figure.subplot_mosaic([["loop", "pressure"], ["loop", "lift"]], width_ratios=[1.15, 1.0])
    loop, pressure, lift = axes["loop"], axes["pressure"], axes["lift"]
    oil = any(_arrays_by_column(table)["pressure"].any() for table in tables.values())
    colors = _ride_colors(len(tables))
    for (label, table), color in zip(tables.items(), colors, strict=True):
        of = _arrays_by_column(table)
        cycle = (len(of["time"]) - 1) // cycles
        last = slice(-cycle - 1, None)
        loop.plot(MILLI * of["extension"][last], of["force"][last], color=color, lw=1.3, label=label)
        _draw_loop_arrow(loop, MILLI * of["extension"][last], of["force"][last], color)
        shown = slice(-min(SHOWN_CYCLES, cycles) * cycle - 1, None)
        turns = np.arange(len(of["time"]))[shown] / cycle
        upper = BAR * of["pressure"] if oil else of["force"]
        pressure.plot(turns, upper[shown], color=color, lw=1.1)
        lift.plot(turns, MILLI * of["valve_lift"][shown], color=color, lw=1.1)
    loop.set(xlabel="extension [mm], out \N{RIGHTWARDS ARROW}", ylabel="force [N]", title="last cycle")
    last_cycles = f"last {min(SHOWN_CYCLES, cycles)} cycles" if cycles > 1 else "the cycle"
    pressure.set(ylabel="pressure [bar]" if oil else "force [N]", title=last_cycles)
    lift.set(xlabel="cycle", ylabel="valve lift [mm]")
    lift.sharex(pressure)
    for axis in axes.values():
        axis.grid(alpha=0.3)
    if len(tables) > 1:
        loop.legend(fontsize=9)
    figure.suptitle(title, fontsize=12)
    return figure


def _draw_loop_arrow(axis: Any, x: NDArray[np.float64], y: NDArray[np.float64], color: Any) -> None:
    """Draws an arrow along a force loop at its steepest step."""
    at = int(np.argmax(np.abs(np.diff(y)))) + 1
    axis.annotate(
        "",
        xy=(x[at], y[at]),
        xytext=(x[at - 1], y[at - 1]),
        arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.3, "mutation_scale": 16},
    )


SWEEP_PANELS: tuple[tuple[str, str, Sequence[tuple[str, str]], float], ...] = (
    ("force", "force [N]", (("force_max", "-"), ("force_min", "--")), 1.0),
    ("pressure", "pressure [bar]", (("pressure_max", "-"), ("pressure_min", "--")), BAR),
    ("work", "energy [J/cycle]", (("work", "-"),), 1.0),
    ("leaked", "leaked [mm\N{SUPERSCRIPT THREE}/cycle]", (("leaked", "-"),), 1e9),
)
"""Panels of a tensioner's sweep: name, label, columns with line styles, unit factor."""


def tensioner_sweep_figure(rides: Mapping[str, pa.Table], x: Sequence[float], axis: str, title: str) -> Figure:
    """Figure of a tensioner's forces, pressures, work and leakage over frequency or temperature.

    `rides` are tables by label, a curve each, with rows at `x`.
    """
    from warpchain.view.figures.plain_figure import PlainFigure

    figure = PlainFigure(figsize=(11.0, 7.0), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True).ravel()
    colors = _ride_colors(len(rides))
    for panel, (name, label, columns, factor) in zip(axes, SWEEP_PANELS, strict=True):
        for (who, table), color in zip(rides.items(), colors, strict=True):
            of = _arrays_by_column(table)
            for column, style in columns:
                panel.plot(x, factor * of[column], style, color=color, lw=1.3, label=who if style == "-" else None)
        heads = {"force": "largest and smallest (dashed) force", "pressure": "largest and smallest (dashed) pressure"}
        heads |= {"work": "work on the plunger", "leaked": "through the gap"}
        panel.set(ylabel=label, title=heads[name])
        panel.grid(alpha=0.3, which="both")
        if "Hz" in axis:
            panel.set_xscale("log")
            panel.xaxis.set_major_formatter("{x:g}")
    for panel in axes[:2]:
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter("{x:g}")
    if len(rides) > 1:
        axes[0].legend(fontsize=9)
    for panel in axes[2:]:
        panel.set_xlabel(axis)
    figure.suptitle(title, fontsize=12)
    return figure


def _ride_colors(count: int) -> list[Any]:
    """Colors of a tensioner's rides."""
    if count <= len(LINE_COLORS):
        return list(LINE_COLORS[:count])
    from matplotlib import colormaps

    return [colormaps["viridis"](k / (count - 1)) for k in range(count)]
