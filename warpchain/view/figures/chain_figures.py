"""Figures of a chain over a run: displacement, tension, contact forces, order spectra (the paper's Figures 8 to 12)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.results.nearest_parts import engaged_sprockets
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.signals import (
    SPECTRUM_FLOOR,
    TOOTH_PASSINGS,
    contact_angles,
    guide_forces_and_rollers,
    last_round_frames,
    order_spectra,
    peaks_over_time,
)
from warpchain.results.strand_passing import strand_displacement
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import (
    LINE_COLORS,
    SPROCKET_COLORS,
    Array,
    draw_color_bar,
    draw_curve,
    draw_legend,
    draw_tooth_orders,
    panel_column,
    set_log_scale,
    strand_label,
)
from warpchain.view.palette import tension_colormap, tension_scale_top

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WATERFALL_ROWS = 1200
"""Spells of time in the tension waterfall."""
ANGLE_BIN = 1.0
"""Width of bins of contact angles [degrees]."""
MOST_DOTS = 20_000


def hardest_pressed_roller(trajectory: Trajectory) -> int:
    """Number of the chain's roller that guides, or else sprockets, press hardest."""
    sprocket_force, guide_force = require_channels(trajectory, "sprocket_force", "guide_force")
    part = last_round_frames(trajectory)
    within = slice(1, -1) if trajectory.parts.chain.is_open else slice(None)
    by_guides, by_teeth = (force[part].max(axis=0)[within] for force in (guide_force, sprocket_force))
    return int(np.argmax(by_guides if by_guides.max() > 0.0 else by_teeth)) + int(within.start or 0)


def strand_displacement_figure(trajectory: Trajectory) -> Figure:
    """Figure of strands' transverse displacement over time (the paper's Figures 9, 10)."""
    names = trajectory.parts.strand_names
    title = "Transverse displacement of each strand at mid-span"
    figure, axes = panel_column(len(names), 2.2 * len(names) + 0.9, title, trajectory)
    for k, (axis, name) in enumerate(zip(axes, names, strict=True)):
        values = strand_displacement(trajectory, k)
        unit, factor = display_unit("m", values)
        draw_curve(axis, trajectory.time, factor * values, color="tab:blue")
        draw_window_mean(axis, trajectory, factor * values, unit, "+.3g")
        axis.set_ylabel(f"displacement [{unit}]\n(left of travel +)")
        axis.set_title(strand_label(name), loc="left", fontsize=10)
        draw_legend(axis)
    axes[-1].set_xlabel("time [s]")
    return figure


def draw_window_mean(axis: Any, trajectory: Trajectory, values: Any, unit: str, digits: str) -> None:
    """Draws the mean of values (F,) in the metrics' window into a chain's panel."""
    time = trajectory.time
    start, end = trajectory.window or (float(time[0]), float(time[-1]))
    part = np.asarray(values)[(time >= start - 1e-12) & (time <= end + 1e-12)]
    mean = float(np.nanmean(part)) if np.isfinite(part).any() else np.nan
    words = f"mean of {start:.4g} to {end:.4g} s: {mean:{digits}} {unit}"
    axis.plot((start, end), (mean, mean), color="black", lw=1.0, ls="--", label=words)


def guide_force_figure(trajectory: Trajectory) -> Figure:
    """Figure of each guide's force and rollers in contact over time."""
    parts, forces = trajectory.parts, guide_forces_and_rollers(trajectory)
    figure, axes = panel_column(
        2 * len(forces), 4.0 * len(forces) + 1.0, "Force of each guide-bar on the chain", trajectory
    )
    for g, (guide, (force, rollers)) in enumerate(zip(parts.guides, forces, strict=True)):
        above, below = axes[2 * g : 2 * g + 2]
        unit, factor = display_unit("N", force)
        draw_curve(above, trajectory.time, factor * force, color="tab:red")
        draw_window_mean(above, trajectory, factor * force, unit, ".3g")
        above.set_ylabel(f"sum over rollers [{unit}]")
        above.set_title(guide.name, loc="left", fontsize=10)
        draw_legend(above)
        draw_curve(below, trajectory.time, rollers, color="0.4")
        below.set_ylabel("rollers in contact")
    axes[-1].set_xlabel("time [s]")
    return figure


def link_tension_figure(trajectory: Trajectory, link: int) -> Figure:
    """Figure of a link's tension in the chain's last round (the paper's Figure 11)."""
    whole, trajectory = trajectory, trajectory.at(last_round_frames(trajectory))
    (tension,) = require_channels(trajectory, "tension")
    figure, (axis,) = panel_column(1, 4.4, f"Tension of link {link} over the chain's last round", whole)
    unit, factor = display_unit("N", tension[:, link])
    draw_curve(axis, trajectory.time, factor * tension[:, link], color="tab:blue")
    axis.axhline(0.0, color="black", lw=0.6)
    _shade_sprocket_spells(axis, trajectory, link)
    axis.set_xlabel("time [s]")
    axis.set_ylabel(f"link tension [{unit}]")
    return figure


def roller_contact_figure(trajectory: Trajectory, roller: int) -> Figure:
    """Figure of contact forces on a roller in the chain's last round (the paper's Figure 12)."""
    whole, trajectory = trajectory, trajectory.at(last_round_frames(trajectory))
    sprocket_force, guide_force = require_channels(trajectory, "sprocket_force", "guide_force")
    noun = "pin" if trajectory.model.chain.is_silent else "roller"
    figure, (above, below) = panel_column(
        2, 5.8, f"Contact forces on {noun} {roller} over the chain's last round", whole
    )
    of_sprockets = above, sprocket_force, "sprockets", "tab:blue"
    for axis, forces, word, color in (of_sprockets, (below, guide_force, "guide-bars", "tab:red")):
        unit, factor = display_unit("N", forces[:, roller])
        draw_curve(axis, trajectory.time, factor * forces[:, roller], color=color)
        axis.set_ylabel(f"contact with {word} [{unit}]")
    _shade_sprocket_spells(above, trajectory, roller)
    below.set_xlabel("time [s]")
    return figure


def _shade_sprocket_spells(axis: Any, trajectory: Trajectory, roller: int) -> None:
    """Shades a chain figure's panel while a roller is on each sprocket."""
    on = engaged_sprockets(trajectory, np.array([roller]))[:, 0]
    named: set[int] = set()
    frame = 0
    for s, spell in groupby(on.tolist()):
        length = len(list(spell))
        if s >= 0:
            label = None if s in named else f"on {trajectory.parts.sprockets[s].name}"
            named.add(s)
            last = min(frame + length, len(trajectory.time) - 1)
            span = trajectory.time[frame], trajectory.time[last]
            axis.axvspan(*span, color=SPROCKET_COLORS[s % len(SPROCKET_COLORS)], alpha=0.15, lw=0, label=label)
        frame += length
    draw_legend(axis)


def tension_waterfall_figure(trajectory: Trajectory, top: float | None = None) -> Figure:
    """Figure of all links' tension over time as an image, colors up to `top` [N]."""
    (tension,) = require_channels(trajectory, "tension")
    figure, (axis,) = panel_column(1, 7.0, "Tension of all links over time", trajectory, right=0.85)
    _, rows = peaks_over_time(tension, WATERFALL_ROWS)
    top = tension_scale_top([trajectory]) if top is None else top
    unit, factor = display_unit("N", top)
    extent = (-0.5, trajectory.parts.chain.links - 0.5, float(trajectory.time[-1]), 0.0)
    colors: Any = {"cmap": tension_colormap(), "vmin": 0.0, "vmax": factor * top}
    image = axis.imshow(factor * rows, aspect="auto", extent=extent, interpolation="nearest", **colors)
    axis.grid(False)
    axis.set_xlabel("link number")
    axis.set_ylabel("time [s]")
    draw_color_bar(axis, image, f"link tension, maximum in each time bin [{unit}]", extend="both")
    return figure


def order_spectrum_figure(trajectory: Trajectory) -> Figure | None:
    """Figure of order spectra of tensions and transmission errors, or None."""
    groups = order_spectra(trajectory)
    if not groups:
        return None
    parts = trajectory.parts
    driver = parts.sprockets[parts.driver]
    title = "Order spectra, latter half of the run"
    figure, axes = panel_column(len(groups), 3.4 * len(groups) + 0.9, title, trajectory)
    for axis, (label, spectra) in zip(axes, groups.items(), strict=True):
        for k, one in enumerate(spectra):
            color = LINE_COLORS[k % len(LINE_COLORS)]
            axis.plot(one.orders, one.amplitude, lw=0.8, color=color, label=strand_label(one.name))
        set_log_scale(axis)
        draw_tooth_orders(axis, driver.teeth)
        peak = max(float(one.amplitude.max()) for one in spectra)
        if peak > 0.0:
            axis.set_ylim(SPECTRUM_FLOOR * peak, 2.0 * peak)
        axis.set_xlim(0.0, (TOOTH_PASSINGS + 0.5) * driver.teeth)
        axis.set_ylabel(f"amplitude of {label}")
        draw_legend(axis)
    axes[-1].set_xlabel(f"order [multiples of the revolutions of {driver.name}]")
    return figure


def contact_angle_figure(trajectory: Trajectory) -> Figure:
    """Figure of contact forces over rollers' angle on each sprocket."""
    parts = trajectory.parts
    count = len(parts.sprockets)
    title = "Contact force against angle on the sprocket, latter half of the run"
    figure, axes = panel_column(count, 2.5 * count + 0.9, title, trajectory, share=False)
    every = [contact_angles(trajectory, s) for s in range(count)]
    unit, factor = display_unit("N", max(float(found.force.max(initial=0.0)) for found in every))
    for s, (axis, sprocket) in enumerate(zip(axes, parts.sprockets, strict=True)):
        found = every[s]
        angle, force = np.degrees(found.angle), factor * found.force
        thin = slice(None, None, max(len(angle) // MOST_DOTS, 1))
        axis.plot(
            angle[thin],
            force[thin],
            ".",
            ms=1.5,
            color="0.7",
            rasterized=True,
            label="rollers at single frames",
        )
        low, high = -1.5 * np.degrees(found.pitch), np.degrees(found.wrap + 1.5 * found.pitch)
        edges = np.arange(low, high + ANGLE_BIN, ANGLE_BIN)
        at = np.digitize(angle, edges) - 1
        centers = 0.5 * (edges[:-1] + edges[1:])
        held = _bin_quantiles(force, at, len(centers), (0.5, 0.99))
        for label, values, color in zip(("median", "99th percentile"), held, ("tab:blue", "tab:red"), strict=True):
            axis.plot(centers, values, lw=1.2, color=color, label=label)
        top = float(np.nanmax(held)) if len(angle) else 0.0
        for edge, name in ((0.0, "chain reaches the sprocket"), (np.degrees(found.wrap), "chain leaves it")):
            axis.axvline(edge, color="black", lw=0.8, ls="--" if edge == 0.0 else ":", label=name)
        axis.set_xlim(low, high)
        axis.set_ylim(0.0, 1.05 * top or 1.0)
        axis.set_ylabel(f"contact force [{unit}]")
        axis.set_title(f"{sprocket.name}, {sprocket.teeth} teeth", loc="left", fontsize=10)
    draw_legend(axes[0])
    axes[-1].set_xlabel("angle since the roller reached the sprocket, in the direction of travel [degrees]")
    return figure


def _bin_quantiles(values: Array, at: Any, bins: int, shares: Sequence[float]) -> Array:
    """Quantiles (shares, bins) of values in the bins numbered `at`, nan for empty ones."""
    order = np.argsort(at, kind="stable")
    ends = np.searchsorted(at[order], np.arange(bins + 1))
    found = np.full((len(shares), bins), np.nan)
    for k in np.flatnonzero(np.diff(ends)):
        found[:, k] = np.quantile(values[order[ends[k] : ends[k + 1]]], shares)
    return found
