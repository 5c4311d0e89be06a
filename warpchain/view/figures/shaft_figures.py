"""Figures of a report on shafts: hub forces, phase errors, the driver's cycle, tooth jump."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.order_tracking import CYCLE_TURNS, cycle_average, driver_turns, last_rising_frames
from warpchain.results.shaft_signals import phase_error
from warpchain.results.signals import strand_tension
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import (
    LINE_COLORS,
    Array,
    draw_curve,
    draw_legend,
    panel_column,
    panel_grid,
    strand_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HODOGRAPH_DOTS = 4000
STEADY_SPREAD = 0.2
"""Share of the largest speed within which speeds are one."""


def hub_force_figure(found: EngineeringReport) -> Figure:
    """Figure of the chain's force on each shaft as hodographs."""
    drive, hubs = found.model, found.hub_forces
    unit, factor = display_unit("N", hubs)
    figure, axes = panel_grid(len(drive.sprockets), 3, 3.6, 3.6)
    for s, (axis, sprocket) in enumerate(zip(axes, drive.sprockets, strict=True)):
        force = factor * hubs[:, s]
        thin = slice(None, None, max(len(force) // HODOGRAPH_DOTS, 1))
        axis.plot(*force[thin].T, ".", ms=1.5, color=LINE_COLORS[0], alpha=0.4, rasterized=True)
        mean = force.mean(axis=0)
        axis.annotate("", mean, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "lw": 1.6, "color": "black"})
        axis.plot(0.0, 0.0, "+", color="black", ms=8)
        size = np.hypot(*force.T)
        words = f"mean {np.hypot(*mean):.3g} {unit}, largest {size.max():.3g} {unit}"
        axis.set_title(f"{sprocket.name}\n{words}", fontsize=9)
        reach = 1.08 * max(float(np.abs(force).max()), 1e-12)
        axis.set_xlim(-reach, reach)
        axis.set_ylim(-reach, reach)
        axis.set_aspect("equal")
        axis.set_xlabel(f"to the right [{unit}]")
    axes[0].set_ylabel(f"upward [{unit}]")
    return figure


def phase_error_figure(found: EngineeringReport) -> Figure | None:
    """Figure of shafts' phase errors over time [degrees of the driver], or None."""
    drive = found.model
    driven = list(found.phase_errors)
    if not driven:
        return None
    name = drive.sprockets[drive.driver].name
    figure, (axis,) = panel_column(1, 3.2, "", None)
    for k, s in enumerate(driven):
        error = np.degrees(phase_error(found.whole, s))
        draw_curve(
            axis, found.whole.time, error, color=LINE_COLORS[k % len(LINE_COLORS)], label=drive.sprockets[s].name
        )
    axis.axvspan(found.start, found.end, color="0.93", lw=0, zorder=0, label="window of the metrics")
    axis.set_xlabel("time [s]")
    axis.set_ylabel(f"phase error\n[degrees of {name}]")
    draw_legend(axis)
    return figure


def phase_error_order_figure(found: EngineeringReport) -> Figure | None:
    """Figure of phase errors' amplitudes by order, or None."""
    phases = {s: phase for s, phase in found.phase_errors.items() if phase.amplitude is not None}
    if not phases:
        return None
    figure, (axis,) = panel_column(1, 3.0, "", None)
    width = 0.8 / len(phases)
    for k, (s, phase) in enumerate(phases.items()):
        assert phase.amplitude is not None
        at = np.arange(len(phase.orders)) + (k - 0.5 * (len(phases) - 1)) * width
        label = found.model.sprockets[s].name
        axis.bar(at, np.degrees(phase.amplitude), width, color=LINE_COLORS[k % len(LINE_COLORS)], label=label)
    orders = next(iter(phases.values())).orders
    axis.set_xticks(np.arange(len(orders)), [f"{order:g}" for order in orders])
    driver = found.model.sprockets[found.model.driver].name
    axis.set_xlabel(f"order [multiples of the revolutions of {driver}]")
    axis.set_ylabel(f"amplitude of the phase error\n[degrees of {driver}]")
    draw_legend(axis)
    return figure


def has_even_speed(found: EngineeringReport) -> bool:
    """Whether the driver keeps about one speed in the report's window."""
    speed = found.part.sprocket_speed
    if speed is None:
        return False
    own = np.abs(np.asarray(speed[:, found.model.driver], dtype=float))
    return float(own.min()) >= (1.0 - STEADY_SPREAD) * float(own.max()) > 0.0


def driver_cycle_figure(found: EngineeringReport) -> Figure | None:
    """Figure of tensions, hub forces and phase errors over two turns of the driver, or None."""
    if not has_even_speed(found):
        return None
    drive, part = found.model, found.part
    turns = driver_turns(found.whole)[
        (found.whole.time >= found.start - 1e-12) & (found.whole.time <= found.end + 1e-12)
    ]
    kept = last_rising_frames(turns)
    tensions = [strand_tension(part, k) for k in range(len(drive.strand_names))]
    hubs = [np.hypot(*found.hub_forces[:, s].T) for s in range(len(drive.sprockets))]
    inside = (found.whole.time >= found.start - 1e-12) & (found.whole.time <= found.end + 1e-12)
    errors = [np.degrees(phase_error(found.whole, s)[inside]) for s in found.phase_errors]
    driver = drive.sprockets[drive.driver].name
    groups: list[tuple[str, str, list[str], list[Array]]] = [
        ("tension at mid-strand", "N", [strand_label(name) for name in drive.strand_names], tensions),
        ("force on the hub", "N", [sprocket.name for sprocket in drive.sprockets], hubs),
        ("phase error", f"degrees of {driver}", [drive.sprockets[s].name for s in found.phase_errors], errors),
    ]
    if len(turns[kept]) < 16 or cycle_average(turns[kept], turns[kept]) is None:
        return None
    figure, axes = panel_column(len(groups), 2.9 * len(groups) + 0.3, "", None)
    count = 0
    for axis, (title, unit, names, signals) in zip(axes, groups, strict=True):
        word, factor = display_unit(unit, *signals) if unit == "N" else (unit, 1.0)
        for k, (name, values) in enumerate(zip(names, signals, strict=True)):
            average = cycle_average(turns[kept], values[kept])
            if average is None:
                continue
            color, angle, count = LINE_COLORS[k % len(LINE_COLORS)], np.degrees(average.angle), average.cycles
            axis.plot(angle, factor * average.mean, lw=1.2, color=color, label=name)
            axis.fill_between(angle, factor * average.low, factor * average.high, color=color, alpha=0.15, lw=0)
        axis.set_ylabel(f"{title}\n[{word}]")
        draw_legend(axis)
    title = f"{count} cycle{'s' * (count > 1)}: mean, and shaded from smallest to largest"
    axes[0].set_title(title, loc="left", fontsize=9)
    axes[-1].set_xlim(0.0, 360.0 * CYCLE_TURNS)
    axes[-1].set_xticks(np.arange(0.0, 360.0 * CYCLE_TURNS + 1.0, 90.0))
    axes[-1].set_xlabel(f"angle of {driver} from where it began [degrees, modulo {360.0 * CYCLE_TURNS:g}]")
    return figure


def least_finite(values: Array) -> float:
    """Smallest finite value for a figure's axis, or nan."""
    return float(np.nanmin(values)) if np.isfinite(values).any() else math.nan


def jump_margin_figure(found: EngineeringReport) -> Figure:
    """Figure of each sprocket's least margin to tooth jump over time."""
    figure, (axis,) = panel_column(1, 3.0, "", None)
    for s, (sprocket, jump) in enumerate(zip(found.model.sprockets, found.jump_margins, strict=True)):
        share = 100.0 * jump.margin / jump.height
        if np.isfinite(share).any():
            label = f"{sprocket.name}: {least_finite(share):.0f} %"
            draw_curve(axis, found.part.time, share, color=LINE_COLORS[s % len(LINE_COLORS)], label=label)
    axis.axhline(0.0, color="black", lw=0.8)
    lowest = [least_finite(100.0 * jump.margin / jump.height) for jump in found.jump_margins]
    axis.set_ylim(min([0.0, *(value for value in lowest if math.isfinite(value))]) - 3.0, 108.0)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("margin over the climb\n[%], 0: it jumps")
    draw_legend(axis, "least")
    return figure
