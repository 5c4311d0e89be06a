"""Figures of a report on parts: load of guides, friction, wear, bodies over time, probes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive
from warpchain.results.channels import CHANNELS
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.guide_load import GuideLoad
from warpchain.results.losses import Array, friction_power_by_group
from warpchain.results.run import Trajectory
from warpchain.results.signals import forward_values
from warpchain.results.units import display_unit
from warpchain.view.figures.figure_style import LINE_COLORS, draw_curve, draw_legend, panel_column, rpm_of_speed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEED_SPELLS = 24
"""Spells, sorted by speed, of mean friction power."""
STEADY_SPREAD = 0.2
"""Share of the largest speed within which speeds are one."""


def guide_load_figure(found: EngineeringReport, g: int) -> Figure:
    """Figure of a guide's load along its face: force per length, roller force, p v."""
    load: GuideLoad = found.guide_loads[g]
    inside = load.mean > 0.0
    span = load.place[inside] if inside.any() else load.place
    figure, axes = panel_column(3, 6.4, "", None, right=0.85)
    length, to_length = display_unit("m", load.place)
    x, width = to_length * load.place, to_length * float(load.place[1] - load.place[0])
    rows = (
        ("mean load", "N/m", load.mean, None),
        ("largest force\nof a roller or pin", "N", load.peak, None),
        ("p v: force times\nspeed per length", "W/m", load.pv, load.pv_peak),
    )
    for axis, (title, unit, values, peak) in zip(axes, rows, strict=True):
        word, factor = _unit_per_length(unit, values)
        axis.bar(x, factor * values, width, color=LINE_COLORS[0], lw=0, label="mean over time")
        if peak is not None:
            word_peak, factor_peak = _unit_per_length(unit, peak)
            twin = axis.twinx()
            twin.grid(False)
            twin.step(x, factor_peak * peak, where="mid", color=LINE_COLORS[3], lw=1.0)
            twin.set_ylabel(f"largest\n[{word_peak}]", color=LINE_COLORS[3])
            twin.set_ylim(0.0)
        axis.set_ylabel(f"{title}\n[{word}]")
    face = to_length * float(np.clip(span.max(), 0.0, None))
    whole = to_length * found.model.profile(g).face_length
    for axis in axes:
        for end in (0.0, whole):
            axis.axvline(end, color="black", lw=0.8, ls="--")
    axes[0].set_xlim(min(to_length * span.min(), 0.0) - width, max(face, whole) + 2.0 * width)
    axes[-1].set_xlabel(f"arc length along the face [{length}], the rounded ends beyond the dashed lines")
    return figure


def _unit_per_length(unit: str, values: Array) -> tuple[str, float]:
    """Unit and factor of a figure's values per meter or millimeter."""
    if not unit.endswith("/m"):
        return display_unit(unit, values)
    word, factor = display_unit(unit.removesuffix("/m"), 1e-3 * values)
    return f"{word}/mm", 1e-3 * factor


def friction_power_figure(found: EngineeringReport) -> Figure | None:
    """Figure of friction power by group over speed or time, or None."""
    groups = friction_power_by_group(found.model, found.friction_power)
    if not groups:
        return None
    whole, drive = found.whole, found.model
    figure, (axis,) = panel_column(1, 3.4, "", None)
    spells = 4 * SPEED_SPELLS
    x, label = _spell_means(whole.time, spells), "time [s]"
    order = np.arange(len(x))
    if whole.sprocket_speed is not None:
        speed = _spell_means(forward_values(drive, whole.sprocket_speed, drive.driver), SPEED_SPELLS)
        later = speed[len(speed) // 2 :]
        if np.ptp(later) > STEADY_SPREAD * float(np.abs(later).max()):
            spells, order, label = (
                SPEED_SPELLS,
                np.argsort(speed),
                f"speed of {drive.sprockets[drive.driver].name} [rpm]",
            )
            x = rpm_of_speed(1.0) * speed[order]
    rows = [_spell_means(values, spells)[order] for values in groups.values()]
    unit, factor = display_unit("W", np.sum(rows, axis=0))
    draw_stacked_areas(axis, x, {name: factor * values for name, values in zip(groups, rows, strict=True)})
    axis.set_xlabel(label)
    axis.set_ylabel(f"friction power [{unit}]")
    return figure


def draw_stacked_areas(axis: Any, x: Array, rows: Mapping[str, Array]) -> None:
    """Draws rows of values into a panel as stacked areas."""
    axis.stackplot(x, *rows.values(), labels=list(rows), colors=LINE_COLORS, alpha=0.75, lw=0)
    axis.set_xlim(x[0], x[-1])
    draw_legend(axis)


def variants_friction_figure(drive: Drive, speed: Array, groups: Mapping[str, Array]) -> Figure:
    """Figure of variants' mean friction power [W] by group over speed (V,) [rad/s]."""
    figure, (axis,) = panel_column(1, 3.4, "", None)
    unit, factor = display_unit("W", np.sum(list(groups.values()), axis=0))
    draw_stacked_areas(axis, rpm_of_speed(1.0) * speed, {name: factor * values for name, values in groups.items()})
    axis.set_xlabel(f"mean speed of {drive.sprockets[drive.driver].name} [rpm]")
    axis.set_ylabel(f"mean friction power [{unit}]")
    return figure


def _spell_means(values: Array, spells: int) -> Array:
    """Means of a figure's values over at most `spells` spells."""
    return np.array([part.mean() for part in np.array_split(values, min(spells, len(values)))])


def joint_wear_figure(found: EngineeringReport) -> Figure | None:
    """Figure of each joint's force times sliding speed, or None."""
    if found.joint_wear is None:
        return None
    rate = found.joint_wear.loaded / found.joint_wear.seconds
    unit, factor = display_unit("W", rate)
    figure, (axis,) = panel_column(1, 2.5, "", None)
    axis.bar(np.arange(len(rate)), factor * rate, 1.0, color=LINE_COLORS[0], lw=0)
    axis.axhline(factor * float(rate.mean()), color="black", lw=0.8, ls="--", label="mean")
    axis.set_xlim(-0.5, len(rate) - 0.5)
    axis.set_xlabel("joint number")
    axis.set_ylabel(f"force times\nsliding speed [{unit}]")
    draw_legend(axis)
    return figure


BODY_LISTS = {"arm": "arms", "tensioner": "tensioners", "shaft": "shafts", "coupling": "couplings", "valve": "valves"}
"""Lists of a drive by kind of body with channels."""


def body_channels(trajectory: Trajectory, kind: str) -> dict[str, tuple[str, Array]]:
    """Recorded channels of a kind of body by title: unit and values (F, bodies)."""
    return {
        channel.description: (channel.unit, np.asarray(values, dtype=float))
        for channel in CHANNELS
        if channel.per == kind and not channel.components
        for values in [getattr(trajectory, channel.name)]
        if values is not None
    }


def body_figure(found: EngineeringReport, kind: str, k: int) -> Figure | None:
    """Figure of body k's channels over time, or None."""
    held = body_channels(found.whole, kind)
    if not held:
        return None
    figure, axes = panel_column(len(held), 1.9 * len(held) + 0.4, "", None)
    for axis, (title, (unit, values)) in zip(axes, held.items(), strict=True):
        word, factor = display_unit(unit, values[:, k])
        draw_curve(axis, found.whole.time, factor * values[:, k], color=LINE_COLORS[0])
        axis.set_title(title, loc="left", fontsize=9)
        axis.set_ylabel(f"[{word}]")
    axes[-1].set_xlabel("time [s]")
    return figure


def probe_figure(found: EngineeringReport, name: str) -> Figure:
    """Figure of a probe's tension, chain speed and displacement over time."""
    seen = found.probe_signals[name]
    figure, axes = panel_column(3, 5.6, "", None)
    rows = (("tension", "N", seen.tension), ("speed", "m/s", seen.speed), ("displacement", "m", seen.displacement))
    for axis, (title, unit, values) in zip(axes, rows, strict=True):
        word, factor = display_unit(unit, values)
        draw_curve(axis, found.whole.time, factor * values, color=LINE_COLORS[0])
        axis.set_ylabel(f"{title}\n[{word}]")
    axes[-1].set_xlabel("time [s]")
    return figure
