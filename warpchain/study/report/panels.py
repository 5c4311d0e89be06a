"""Panels, figures of a study as data, and the HTML page whose script draws them.

A panel has `title`, `x` and `y` (each with `label`, `words` or `range`), and `series` of a `kind` that `page.js` draws.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.files import read_text_file
from warpchain.results.units import display_unit_word, distinguishing_decimals
from warpchain.study.analysis import Correlation, Effect
from warpchain.study.analysis.effects import MedianEffect, factor_groups
from warpchain.study.analysis.interactions import Interaction
from warpchain.study.analysis.over_noise import Designs
from warpchain.study.analysis.sensitivity import SobolIndices
from warpchain.study.results import Array, Results
from warpchain.study.surrogate import CrossValidation, Surrogate
from warpchain.view import html

_FOLDER = Path(__file__).parent
Panel = dict[str, Any]
INK, ACCENT, MARK, PALE, OTHER = "#33475b", "#1f77b4", "#d1495b", "#b4bcc4", "#6a4c93"
LEVEL_COLORS = ("#1f77b4", "#6a4c93", "#d1495b")
MOST_DOTS = 300


def report_page_html(
    title: str,
    sections: Sequence[html.PageSection],
    rows: Mapping[str, Any] | None = None,
    about: Sequence[str] = (),
) -> str:
    """HTML document of a report: sections, data, script."""
    style, script = (read_text_file(_FOLDER / name, "text", StudyError) for name in ("page.css", "page.js"))
    end = (
        f'<div id="tip"></div>\n<script type="application/json" id="report-data">{json_script_text(rows)}</script>\n'
        f"<script>\n{script}</script>\n"
    )
    return html.page_html(title, sections, style, end, about)


def json_script_text(values: Any) -> str:
    """JSON text of values for an HTML script element."""
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c")


def panels_html(panels: Sequence[Mapping[str, Any]], words: str) -> str:
    """HTML of panels' data, with a label."""
    if not panels:
        return ""
    inside = f'<script type="application/json">{json_script_text(panels)}</script>'
    return f'<div class="panels" role="group" aria-label="{escape(words)}">{inside}</div>'


def hint_html(words: str) -> str:
    """HTML of a report's hint, not printed."""
    return f'<p class="muted screen">{escape(words)}</p>'


def placeholder_html(name: str, words: str = "") -> str:
    """HTML of a place that a report's script fills."""
    return f'<div id="{escape(name)}" aria-label="{escape(words)}"></div>'


def rounded_numbers(values: Any, digits: int = 5) -> list[float | None]:
    """Panel's numbers to significant digits, None if not finite."""
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in np.asarray(values, dtype=float).tolist()]


class ShownColumn:
    """Results column in panels, its unit and decimals.

    Args:
        rows: that are shown; None takes all, of a metric those that are ok.

    Attributes:
        factor: shown over SI value.
        decimals: of shown values.
    """

    def __init__(self, results: Results, column: str, rows: Sequence[int] | None = None) -> None:
        values = results.values(column) if results.is_numeric(column) else np.zeros(0)
        if rows is not None:
            values = values[list(rows)] if values.size else values
        elif column not in results.factors and values.size and results.usable_rows(column).any():
            values = values[results.usable_rows(column)]
        self.unit, self.factor = display_unit_word(results.column_unit(column), values)
        self.decimals = distinguishing_decimals(values * self.factor)
        self.name = f"{column} [{self.unit}]" if self.unit else column

    def shown_values(self, values: Any) -> list[float | None]:
        """Values in the shown unit from SI values, rounded."""
        shown = np.asarray(values, dtype=float) * self.factor
        largest = float(np.abs(shown[np.isfinite(shown)]).max(initial=0.0))
        return rounded_numbers(shown, max(5, html.significant_digits(largest, self.decimals)))

    def value_text(self, value: float) -> str:
        """Text of an SI value in the shown unit."""
        return html.column_number(self.factor * value, self.decimals)

    def group_text(self, label: str) -> str:
        """Text of a factor group in the shown unit, "8 to 10"."""
        ends = [f"{self.factor * float(end):.4g}" for end in label.split(" to ")]
        return f"{' to '.join(ends)} {self.unit}".rstrip()


def histogram_panels(results: Results, metrics: Sequence[str]) -> list[Panel]:
    """Panels of each metric's histogram, with its median."""
    panels = []
    for k, metric in enumerate(metrics):
        axis = ShownColumn(results, metric)
        values = results.values(metric)[results.usable_rows(metric)]
        counts, edges = np.histogram(values, bins=min(40, max(6, int(np.sqrt(len(values))))))
        label = {"label": "median"} if k == 0 else {}
        series = [
            {
                "kind": "columns",
                "low_x": axis.shown_values(edges[:-1]),
                "high_x": axis.shown_values(edges[1:]),
                "y": counts.tolist(),
            },
            {"kind": "upright", "x": axis.shown_values([np.median(values)]), "color": MARK, **label},
        ]
        top = float(1.08 * counts.max())
        panels.append({"x": {"label": axis.name}, "y": {"label": "variants", "range": [0, top]}, "series": series})
    return panels


def noise_panels(designs: Designs, chosen: Sequence[int], letters: Sequence[str]) -> list[Panel]:
    """Panels of designs' runs over noise, one a metric."""
    panels = []
    for k, metric in enumerate(dict.fromkeys(name[5:-1] for name in designs.metrics if name.startswith("mean("))):
        axis, x = ShownColumn(designs.runs, metric), np.arange(len(chosen))
        values = [designs.runs.values(metric)[designs.rows[row]] for row in chosen]
        at = np.concatenate([place + np.linspace(-0.28, 0.28, len(of)) for place, of in zip(x, values, strict=True)])
        mean, low, high = (designs.values(f"{word}({metric})")[list(chosen)] for word in ("mean", "q5", "q95"))
        named = [{"label": label} if k == 0 else {} for label in ("runs, by noise row", "5 to 95 %", "mean")]
        series: list[dict[str, Any]] = [
            {
                "kind": "points",
                "x": rounded_numbers(at),
                "y": axis.shown_values(np.concatenate(values)),
                "color": PALE,
                "size": 1.8,
            },
            {
                "kind": "errors",
                "x": x.tolist(),
                "low": axis.shown_values(low),
                "high": axis.shown_values(high),
                "color": ACCENT,
            },
            {"kind": "points", "x": x.tolist(), "y": axis.shown_values(mean), "color": MARK, "size": 3.2},
        ]
        series = [one | name for one, name in zip(series, named, strict=True)]
        ends = [end for b in designs.bounds if b.metric == metric for end in (b.min, b.max)]
        for end in (end for end in ends if end is not None):
            series.append({"kind": "level", "x": [0], "y": axis.shown_values([end]), "color": INK, "label": "limit"})
        panels.append({"x": {"label": "design", "words": list(letters)}, "y": {"label": axis.name}, "series": series})
    return panels


def effect_panels(
    results: Results, metric: str, found: Sequence[Effect], medians: Sequence[MedianEffect], shares: bool
) -> list[Panel]:
    """Panels of a metric's means and medians over factor groups."""
    axis = ShownColumn(results, metric)
    shown = list(found)[:8]
    bars = [2.0 * np.nan_to_num(effect.errors) for effect in shown]
    of_medians = {effect.factor: effect for effect in medians}
    low = min(float((e.means - b).min()) for e, b in zip(shown, bars, strict=True))
    high = max(float((e.means + b).max()) for e, b in zip(shown, bars, strict=True))
    inside = [m.medians for e in shown if (m := of_medians.get(e.factor)) is not None]
    low, high = min(low, *(float(m.min()) for m in inside)), max(high, *(float(m.max()) for m in inside))
    pad = 0.06 * ((high - low) or abs(high) or 1.0)
    all_rows = results.values(metric)[results.usable_rows(metric)]
    panels = []
    for k, (effect, bar) in enumerate(zip(shown, bars, strict=True)):
        words = not results.is_numeric(effect.factor)
        across = ShownColumn(results, effect.factor)
        x = effect.centers.tolist() if words else across.shown_values(effect.centers)
        first = k == 0
        series: list[dict[str, Any]] = [
            {"kind": "level", "x": [x[0]], "y": axis.shown_values([all_rows.mean()]), "color": PALE}
        ]
        named = {"label": "mean, ± 2 standard errors"} if first else {}
        if not words:
            series.append({"kind": "line", "x": x, "y": axis.shown_values(effect.means)})
        series += [
            {
                "kind": "errors",
                "x": x,
                "low": axis.shown_values(effect.means - bar),
                "high": axis.shown_values(effect.means + bar),
            },
            {"kind": "points", "x": x, "y": axis.shown_values(effect.means), "size": 3.2, **named},
        ]
        median = of_medians.get(effect.factor)
        if median is not None and len(median.medians) == len(x):
            named = {"label": "median"} if first else {}
            series.append(
                {"kind": "points", "x": x, "y": axis.shown_values(median.medians), "size": 2.4, "color": OTHER, **named}
            )
        panels.append(
            {
                "title": f"{effect.row_count} variants: share not known"
                if np.isnan(effect.adjusted_share) or not shares
                else f"explains {100.0 * effect.adjusted_share:.0f} %",
                "x": {"label": across.name} | ({"words": list(effect.labels)} if words else {}),
                "y": {"label": axis.name if first else "", "range": axis.shown_values([low - pad, high + pad])},
                "series": series,
                "width": 280,
                "height": 230,
            }
        )
    return panels


def interaction_panels(
    results: Results, metric: str, found: Sequence[Effect], together: Sequence[Interaction]
) -> list[Panel]:
    """Panels of a metric's means over two factors."""
    axis, panels = ShownColumn(results, metric), []
    factors = [effect.factor for effect in found if results.is_numeric(effect.factor)]
    pairs = [(one.first, one.second) for one in together if {one.first, one.second} <= set(factors)]
    pairs += [pair for pair in combinations(factors[:3], 2) if pair not in pairs and pair[::-1] not in pairs]
    y = results.values(metric)
    for a, b in pairs[:3]:
        rows = results.usable_rows(metric, [a, b])
        if rows.sum() < 24:
            continue
        z = results.values(b)[rows]
        levels = np.unique(z)
        cuts = levels[:-1] if len(levels) <= 3 else np.quantile(z, (1 / 3, 2 / 3))
        part = np.searchsorted(cuts, z, side="left")
        group, _, centers = factor_groups(results, a, rows)
        across, other = ShownColumn(results, a), ShownColumn(results, b)
        series = []
        for p, color in zip(np.unique(part), LEVEL_COLORS, strict=False):
            held = [y[rows][(part == p) & (group == g)] for g in range(len(centers))]
            means = np.array([h.mean() if len(h) else np.nan for h in held])
            errors = np.array([2.0 * h.std(ddof=1) / np.sqrt(len(h)) if len(h) > 1 else np.nan for h in held])
            ends = other.shown_values([z[part == p].min(), z[part == p].max()])
            label = f"{b} {ends[0]:g}" if ends[0] == ends[1] else f"{b} {ends[0]:g} to {ends[1]:g}"
            points = {"x": across.shown_values(centers), "y": axis.shown_values(means), "color": color}
            series += [
                {"kind": "line", **points, "label": f"{label} {other.unit}".rstrip()},
                {
                    "kind": "errors",
                    **points,
                    "low": axis.shown_values(means - errors),
                    "high": axis.shown_values(means + errors),
                },
            ]
        panels.append({"x": {"label": across.name}, "y": {"label": axis.name}, "series": series})
    return panels


def variance_share_panels(
    metrics: Sequence[str], shares: Sequence[float], chances: Sequence[float | None]
) -> list[Panel]:
    """Panels of the parts of metrics' variance."""
    at = np.arange(len(metrics))[::-1]
    by_factors = np.clip(shares, 0.0, 1.0)
    chance = np.array([chance or 0.0 for chance in chances])
    chance = np.minimum(chance, 1.0 - by_factors)
    parts = (
        ("main effects of factors", by_factors, np.zeros(len(at)), ACCENT),
        ("scatter between equal runs", chance, by_factors, MARK),
        ("interactions, and what the table does not tell", 1.0 - by_factors - chance, by_factors + chance, PALE),
    )
    series = [
        {"kind": "rows", "y": at.tolist(), "x": rounded_numbers(x), "from": rounded_numbers(start), "color": color}
        | {"label": label, "thick": 0.6}
        for label, x, start, color in parts
    ]
    height = 70 + 30 * len(metrics)
    y = {"words": list(metrics)[::-1]}
    return [
        {
            "x": {"label": "part of the variance", "range": [0, 1]},
            "y": y,
            "series": series,
            "width": 860,
            "height": height,
        }
    ]


def correlation_panels(both: Correlation) -> list[Panel]:
    """Panels of rank correlations of factors with metrics."""
    a, b = np.meshgrid(np.arange(len(both.factors)), np.arange(len(both.metrics))[::-1], indexing="ij")
    values, noise = both.spearman.ravel(), both.noise_level()
    series = [
        {
            "kind": "cells",
            "x": a.ravel().tolist(),
            "y": b.ravel().tolist(),
            "value": rounded_numbers(values, 3),
            "faint": (np.abs(values) < noise).tolist(),
        }
    ]
    x, y = {"words": list(both.factors), "turned": True}, {"words": list(both.metrics)[::-1]}
    size = {"width": max(520, 350 + 62 * len(both.factors)), "height": 110 + 22 * len(both.metrics)}
    return [{"x": x, "y": y, "series": series, "cells": True, **size}]


def _middle_row(results: Results, surrogate: Surrogate) -> dict[str, Any]:
    """Row midway in factors, for a surrogate's cuts."""
    row: dict[str, Any] = {}
    for name in surrogate.factors:
        if results.is_numeric(name):
            values = results.values(name)
            row[name] = 0.5 * (float(np.nanmin(values)) + float(np.nanmax(values)))
        else:
            words, counts = np.unique(results.text_values(name), return_counts=True)
            row[name] = str(words[int(counts.argmax())])
    return row


def _dot_rows(rows: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Numbers of rows that a panel's dots show, evenly spaced."""
    held = np.flatnonzero(rows)
    return held[np.unique(np.linspace(0, len(held) - 1, min(len(held), MOST_DOTS)).astype(int))] if len(held) else held


def surrogate_panels(results: Results, found: Surrogate, checked: CrossValidation) -> list[Panel]:
    """Panels of a surrogate's cuts and cross-validation."""
    axis, middle = ShownColumn(results, found.metric), _middle_row(results, found)
    cuts: list[tuple[float, Panel]] = []
    dots = _dot_rows(results.usable_rows(found.metric))
    y = results.values(found.metric)
    least, most_y = float(y[dots].min()), float(y[dots].max())
    pad = 0.5 * (most_y - least)
    left_out = ~results.ok & np.isfinite(y)
    drawn = left_out & (y >= least - pad) & (y <= most_y + pad)
    near, far = _dot_rows(drawn), int((left_out & ~drawn).sum())
    for name in (factor for factor in found.factors if results.is_numeric(factor)):
        values = results.values(name)
        x = np.linspace(float(np.nanmin(values)), float(np.nanmax(values)), 41)
        mean, deviation = found.predict([middle | {name: float(v)} for v in x])
        _, of_run = found.predict([middle | {name: float(v)} for v in x], run=True)
        across = ShownColumn(results, name)
        band = {"kind": "band", "x": across.shown_values(x), "color": MARK}
        series = [
            {
                "kind": "points",
                "x": across.shown_values(values[dots]),
                "y": axis.shown_values(y[dots]),
                "color": PALE,
                "size": 1.6,
            },
            {**band, "low": axis.shown_values(mean - 1.96 * of_run), "high": axis.shown_values(mean + 1.96 * of_run)},
            {
                **band,
                "low": axis.shown_values(mean - 1.96 * deviation),
                "high": axis.shown_values(mean + 1.96 * deviation),
            },
            {"kind": "line", "x": across.shown_values(x), "y": axis.shown_values(mean), "color": MARK},
        ]
        if left_out.any():
            series.append(
                {
                    "kind": "points",
                    "x": across.shown_values(values[near]),
                    "y": axis.shown_values(y[near]),
                    "color": OTHER,
                    "size": 2.4,
                }
            )
        panel = {"x": {"label": across.name}, "y": {"label": ""}, "series": series, "width": 280, "height": 230}
        cuts.append((-float(np.ptp(mean)), panel))
    panels = [panel for _, panel in sorted(cuts, key=lambda cut: cut[0])[:4]]
    if panels:
        panels[0]["y"]["label"] = axis.name
        beyond = f", {far} more beyond the picture" if far else ""
        labels = ("variants", "95 % of single runs", "95 % of the metric", "surrogate", f"not ok, not fitted{beyond}")
        for series, label in zip(panels[0]["series"], labels, strict=False):
            series["label"] = label
    return [*panels, _cross_validation_panel(axis, checked)]


def _cross_validation_panel(axis: ShownColumn, checked: CrossValidation) -> Panel:
    """Panel of a surrogate's predictions over simulated values."""
    some = _dot_rows(np.ones(len(checked.observed), dtype=bool))
    observed, predicted, deviation = (v[some] for v in (checked.observed, checked.predicted, checked.deviation))
    ends = axis.shown_values([min(observed.min(), predicted.min()), max(observed.max(), predicted.max())])
    low, high = predicted - 1.96 * deviation, predicted + 1.96 * deviation
    x, faint = axis.shown_values(observed), {"color": PALE}
    series = [
        {"kind": "errors", "x": x, "low": axis.shown_values(low), "high": axis.shown_values(high), **faint},
        {"kind": "points", "x": x, "y": axis.shown_values(predicted), "size": 2.0},
        {"kind": "line", "x": ends, "y": ends, "color": INK, "width": 1, "dash": "4 3"},
    ]
    title = f"left out: Q² = {checked.q2:.3f}, {100.0 * checked.coverage:.0f} % within the 95 % bars"
    labels = {"x": {"label": f"run: {axis.name}"}, "y": {"label": "as the others predict it"}}
    return {"title": title, **labels, "series": series, "width": 330, "height": 250}


def sobol_panels(found: Sequence[SobolIndices]) -> list[Panel]:
    """Panels of each metric's Sobol' indices, with intervals."""
    factors = found[0].factors
    at: Array = np.arange(len(factors))[::-1].astype(float)
    panels = []
    for k, one in enumerate(found):
        series = []
        for values, errors, shift, color, label in (
            (one.first, one.first_error, 0.19, ACCENT, "alone (first order)"),
            (one.total, one.total_error, -0.19, MARK, "with interactions (total)"),
        ):
            named = {"label": label} if k == 0 else {}
            bars = {"kind": "rows", "y": (at + shift).tolist(), "x": rounded_numbers(values), "color": color, **named}
            series.append(bars | ({"error": rounded_numbers(errors)} if errors.any() else {}))
        top = max(1.0, 1.05 * float((one.total + one.total_error).max()))
        x = {"label": "part of the variance", "range": [0, top]}
        y = {"words": list(factors)[::-1]}
        panels.append({"title": one.metric, "x": x, "y": y, "series": series, "height": 90 + 30 * len(factors)})
    return panels
