"""Figures of a study: distributions, main effects, correlation, Pareto front, slices of a response surface."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.study.analysis import Correlation, Effect
from warpchain.study.analysis.pareto import pareto_front
from warpchain.study.analysis.sensitivity import Indices
from warpchain.study.analysis.surface import Surface
from warpchain.study.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, ACCENT, MARK = "#33475b", "#1f77b4", "#d1495b"
RASTER_POINTS = 2000
"""Scatters of more points are drawn as pixels inside a vector figure."""


def name_of(results: Results, column: str, width: int = 30) -> str:
    """A column's name with its unit, broken behind its dots and underscores for an axis."""
    unit = results.unit(column)
    lines = [""]
    for word in re.findall(r"[^._]+[._]?", column) + ([f" [{unit}]"] if unit else []):
        if len(lines[-1]) + len(word) > width and lines[-1]:
            lines.append("")
        lines[-1] += word
    return "\n".join(line.strip() for line in lines)


def _panels(count: int, columns: int, width: float, height: float) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels in rows of `columns`, each of a size in inches."""
    from matplotlib.figure import Figure

    columns = min(columns, count)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis in axes[:count]:
        axis.grid(alpha=0.25)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes[:count]


def _engineer(axis: Any) -> None:
    """A few ticks, with SI prefixes where numbers are large or small: 25k, 3m."""
    from matplotlib.ticker import EngFormatter, MaxNLocator

    low, high = axis.get_view_interval()
    size = max(abs(low), abs(high))
    axis.set_major_locator(MaxNLocator(5 if axis.axis_name == "y" else 4))
    if size >= 1e4 or 0.0 < size < 1e-2:
        axis.set_major_formatter(EngFormatter(sep="", places=None))


def distributions_figure(results: Results, metrics: tuple[str, ...]) -> Figure:
    """A histogram of each metric over the variants that are ok, with its median."""
    figure, axes = _panels(len(metrics), 3, 3.7, 2.6)
    for axis, metric in zip(axes, metrics, strict=True):
        values = results.values(metric)[results.rows_for(metric)]
        axis.hist(values, bins=min(40, max(6, int(np.sqrt(len(values))))), color=ACCENT, alpha=0.8)
        axis.axvline(float(np.median(values)), color=MARK, lw=1.2, label="median")
        axis.set_xlabel(name_of(results, metric), fontsize=9)
        axis.set_ylabel("variants", fontsize=9)
        _engineer(axis.xaxis)
    axes[0].legend(fontsize=8)
    return figure


def effects_figure(results: Results, metric: str, effects: list[Effect], most: int = 8) -> Figure:
    """Mean of a metric in each group of each factor, with two standard errors; all panels share the metric's axis."""
    shown = effects[:most]
    figure, axes = _panels(len(shown), 4, 2.9, 2.6)
    values = results.values(metric)[results.rows_for(metric)]
    low = min(float((e.means - 2.0 * np.nan_to_num(e.errors)).min()) for e in shown)
    high = max(float((e.means + 2.0 * np.nan_to_num(e.errors)).max()) for e in shown)
    pad = 0.06 * ((high - low) or abs(high) or 1.0)
    for axis, effect in zip(axes, shown, strict=True):
        axis.axhline(float(values.mean()), color="0.6", lw=0.9, ls="--")
        bars = 2.0 * np.nan_to_num(effect.errors)
        words = not results.numeric(effect.factor)
        axis.errorbar(
            effect.centers,
            effect.means,
            bars,
            fmt="o" if words else "o-",
            color=ACCENT,
            ecolor="0.55",
            ms=4,
            capsize=2,
            lw=1.4,
        )
        axis.set_ylim(low - pad, high + pad)
        axis.set_xlabel(name_of(results, effect.factor, 26), fontsize=8)
        axis.set_title(f"explains {100 * effect.explained:.0f} %", fontsize=8, loc="right", color="0.35")
        if words:
            axis.set_xticks(effect.centers, effect.labels, fontsize=7)
            axis.margins(x=0.25)
        else:
            _engineer(axis.xaxis)
        _engineer(axis.yaxis)
        axis.tick_params(labelsize=8)
    axes[0].set_ylabel(f"mean of\n{name_of(results, metric)}", fontsize=8)
    return figure


def correlation_figure(both: Correlation) -> Figure:
    """Rank correlation of factors with metrics as a heat map; coefficients that chance explains are gray."""
    from matplotlib.figure import Figure

    factors, metrics = both.factors, both.metrics
    wide, high = 3.4 + 0.55 * len(factors), 2.2 + 0.27 * len(metrics)
    figure = Figure(figsize=(max(wide, 5.0), max(high, 2.8)), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(both.spearman.T, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    axis.set_xticks(range(len(factors)), factors, rotation=40, ha="right", fontsize=8)
    axis.set_yticks(range(len(metrics)), metrics, fontsize=8)
    noise = both.noise()
    for a in range(len(factors)):
        for b in range(len(metrics)):
            value = both.spearman[a, b]
            if np.isfinite(value):
                color = "0.6" if abs(value) < noise else "white" if abs(value) > 0.6 else "black"
                axis.text(a, b, f"{value:+.2f}", ha="center", va="center", fontsize=7, color=color)
    figure.colorbar(image, ax=axis, label="rank correlation (Spearman)", shrink=0.8)
    return figure


def front_figure(results: Results, objectives: Mapping[str, str]) -> Figure:
    """The variants over the first two objectives, those on the Pareto front marked with their numbers."""
    first, second, *_ = objectives
    front = pareto_front(results, objectives)
    x, y = results.values(first), results.values(second)
    rows = results.rows_for(first) & results.rows_for(second)
    figure, (axis,) = _panels(1, 1, 7.0, 4.6)
    label = f"{int(rows.sum())} variants that are ok"
    axis.scatter(x[rows], y[rows], s=12, color="0.65", lw=0, rasterized=rows.sum() > RASTER_POINTS, label=label)
    plain = len(objectives) == 2
    axis.plot(
        x[front],
        y[front],
        "o-" if plain else "o",
        color=MARK,
        ms=5,
        lw=1.0,
        label=f"Pareto front: {len(front)} variants",
    )
    spot = np.stack([x[front] / np.ptp(x[rows]), y[front] / np.ptp(y[rows])], axis=1)
    labeled: list[int] = []
    for k, row in enumerate(front):
        if all(np.abs(spot[k] - spot[j]).max() > 0.04 for j in labeled):  # numbers do not cover each other
            labeled.append(k)
            number = f"{results.variants[row]}"
            axis.annotate(number, (x[row], y[row]), fontsize=8, xytext=(4, 4), textcoords="offset points")
    for metric, set_label, ticks in ((first, axis.set_xlabel, axis.xaxis), (second, axis.set_ylabel, axis.yaxis)):
        better = "lower" if objectives[metric] == "min" else "higher"
        set_label(f"{name_of(results, metric, 60)}, {better} is better")
        _engineer(ticks)
    axis.legend(fontsize=8)
    return figure


def surface_figure(results: Results, surface: Surface, most: int = 7) -> Figure:
    """Slices of a response surface along each factor, the others midway, over the variants themselves.

    The last panel is the surface over the two factors of the widest slices.
    """
    slices = {factor: surface.slice(factor) for factor in surface.factors}
    by_span = sorted(slices, key=lambda factor: -float(np.ptp(slices[factor][1])))[:most]
    figure, axes = _panels(len(by_span) + (len(by_span) > 1), 4, 2.9, 2.7)
    rows = results.rows_for(surface.metric)
    y = results.values(surface.metric)[rows]
    for axis, factor in zip(axes, by_span, strict=False):
        axis.scatter(results.values(factor)[rows], y, s=6, color="0.7", lw=0, rasterized=len(y) > RASTER_POINTS)
        axis.plot(*slices[factor], color=MARK, lw=1.8)
        axis.set_xlabel(name_of(results, factor, 26), fontsize=8)
        _engineer(axis.xaxis)
        _engineer(axis.yaxis)
        axis.tick_params(labelsize=8)
    axes[0].set_ylabel(name_of(results, surface.metric), fontsize=8)
    if len(by_span) > 1:
        x, z, values = surface.plane(by_span[0], by_span[1])
        lines = axes[-1].contourf(x, z, values, 12, cmap="cividis")
        axes[-1].set_xlabel(name_of(results, by_span[0], 26), fontsize=8)
        axes[-1].set_ylabel(name_of(results, by_span[1], 26), fontsize=8)
        axes[-1].tick_params(labelsize=8)
        for ticks in (axes[-1].xaxis, axes[-1].yaxis):
            _engineer(ticks)
        bar = figure.colorbar(lines, ax=axes[-1])
        bar.ax.tick_params(labelsize=7)
        _engineer(bar.ax.yaxis)
    figure.suptitle(
        f"{surface.metric}: R\u00b2 = {surface.r2:.3f}, predicted R\u00b2 = {surface.r2_predicted:.3f} "
        f"({surface.rows} variants, {len(surface.coefficients)} terms)",
        fontsize=9,
    )
    return figure


def indices_figure(found: Sequence[Indices]) -> Figure:
    """First-order and total Sobol' indices of each metric as bars, with confidence intervals where there are any."""
    factors = found[0].factors
    figure, axes = _panels(len(found), 3, 3.9, 1.2 + 0.36 * len(factors))
    at = np.arange(len(factors))[::-1]
    for k, (axis, one) in enumerate(zip(axes, found, strict=True)):
        for values, errors, shift, color, label in (
            (one.first, one.first_error, 0.19, ACCENT, "alone (first order)"),
            (one.total, one.total_error, -0.19, MARK, "with interactions (total)"),
        ):
            bars = errors if errors.any() else None
            axis.barh(at + shift, values, 0.36, xerr=bars, color=color, ecolor="0.4", capsize=2, label=label)
        axis.set_yticks(at, factors if k % 3 == 0 else [""] * len(factors), fontsize=8)
        axis.set_xlim(0.0, max(1.0, 1.05 * float((one.total + one.total_error).max())))
        axis.set_title(one.metric, fontsize=8)
        axis.set_xlabel("part of the variance [-]", fontsize=8)
        axis.tick_params(labelsize=8)
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=8, loc="outside upper right", ncols=2)
    return figure
