"""A study's report: one HTML page that needs nothing beside it."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.analysis import Effect, correlation, main_effects
from warpchain.study.analysis.pareto import pareto_front
from warpchain.study.analysis.sensitivity import Indices, best_indices
from warpchain.study.analysis.surface import TRUSTED, fit_surface
from warpchain.study.report import charts
from warpchain.study.results import STATUSES, Results, read_results
from warpchain.study.store import write_text
from warpchain.view import html as page

if TYPE_CHECKING:
    import pyarrow as pa

TELLING = (
    "tension_max",
    "peak_factor",
    "damage_per_hour_max",
    "tension_equivalent_range",
    "*.transmission_error_rms",
    "contact_energy_per_revolution",
    "*.impact_impulse",
    "*.displacement_std",
    "*.displacement_rms",
    "*.force_max",
    "tension_mean",
    "tension_std",
)
"""Metrics that a report shows where none are named, the first ones first."""
SHOWN = 6
"""Most metrics that a report shows in figures where none are named."""
EXTREMES = 3
"""Variants listed at each end of a metric."""


def telling_metrics(results: Results) -> tuple[str, ...]:
    """The metrics to show: what `TELLING` names, then the others, of those that vary and most variants have."""
    enough = results.ok.sum() / 2
    varying = [m for m in results.varying_metrics() if results.rows_for(m).sum() > enough]
    ordered = [m for pattern in TELLING for m in varying if fnmatch(m, pattern)] + list(varying)
    return tuple(dict.fromkeys(ordered))[:SHOWN]


def report_html(
    results: Results,
    title: str = "Study",
    metrics: tuple[str, ...] = (),
    objectives: Mapping[str, str] | None = None,
    notes: Mapping[str, str] | None = None,
) -> str:
    """The page.

    Args:
        results: the study's results.
        title: heading of the page.
        metrics: those to show; none takes the objectives and the telling ones.
        objectives: "min" or "max" by metric, for the Pareto front; None takes the first two metrics, both low.
        notes: further lines about the study, by name: its design, its drive, its seed.

    Raises:
        StudyError: an unknown metric or sense, or a table without a variant.
    """
    if not results.table.num_rows:
        raise StudyError("the study has no variant yet: nothing to report")
    for metric in metrics:
        results.values(metric)
    wanted = tuple(metric for metric in objectives or () if metric not in results.factors)
    shown = tuple(metrics) or tuple(dict.fromkeys((*wanted, *telling_metrics(results))))[: max(SHOWN, len(wanted))]
    chosen = dict(objectives or {metric: "min" for metric in shown[:2]})
    enough = tuple(m for m in shown if results.rows_for(m).sum() >= 3)
    effects = {metric: main_effects(results, metric) for metric in enough}
    sections: list[page.Section | None] = [_summary(results, effects, notes or {}), _inputs(results), _ends(results)]
    if enough:
        sections += [
            page.section(
                "distributions",
                "How the metrics are distributed",
                page.picture(charts.distributions_figure(results, enough), "histograms of the metrics"),
                _spread(results, enough),
            ),
            _effects(results, effects),
            _correlation(results, shown),
            _surfaces(results, enough),
            _sobol(results, enough),
            _front(results, chosen, objectives is None),
            _extremes(results, enough),
        ]
    else:
        sections.append(
            page.section("none", "No analysis", page.text("Fewer than three variants have a metric that varies."))
        )
    return page.page(title, [section for section in sections if section])


def _summary(results: Results, effects: Mapping[str, list[Effect]], notes: Mapping[str, str]) -> page.Section:
    status = results.status
    boxes = f'<div class="counts"><div><b>{len(status)}</b>variants</div>' + "".join(
        f'<div class="{word}"><b>{status.count(word)}</b>{word}</div>' for word in STATUSES
    )
    lines = [_verdict(results, metric, found) for metric, found in effects.items()]
    noted = page.table(("about the study", ""), list(notes.items())) if notes else ""
    return page.section("summary", "In short", boxes + "</div>", page.bullets(lines) if lines else "", noted)


def _verdict(results: Results, metric: str, effects: list[Effect]) -> str:
    """One line on a metric: its range, and the factor that matters most."""
    rows = np.flatnonzero(results.rows_for(metric))
    values, unit = results.values(metric)[rows], f" {results.unit(metric)}".rstrip()
    low, high = int(values.argmin()), int(values.argmax())
    line = (
        f"{metric}: from {page.number(values[low], 4)}{unit} (variant {results.variants[rows[low]]}) "
        f"to {page.number(values[high], 4)}{unit} (variant {results.variants[rows[high]]})"
    )
    telling = [e for e in effects if e.explained > 3.0 * (len(e.counts) - 1) / max(len(rows) - 1, 1)]
    if not telling:
        return f"{line}; no factor stands out of the scatter."
    best = max(telling, key=lambda effect: effect.explained)
    least, most = (
        f"{page.number(best.means[g], 4)}{unit} ({best.labels[g]})"
        for g in (int(best.means.argmin()), int(best.means.argmax()))
    )
    return (
        f"{line}. {best.factor} matters most, with {100 * best.explained:.0f} % of the variance: "
        f"the mean goes from {least} to {most}."
    )


def _inputs(results: Results) -> page.Section:
    rows, tied = [], results.ties()
    for factor in results.factors:
        words = results.labels(factor)
        distinct = len(set(words))
        if not results.numeric(factor):
            span = ", ".join(sorted(set(words))[:8])
        else:
            values = results.values(factor)
            ends = [page.number(float(value)) for value in (np.nanmin(values), np.nanmax(values))]
            span = ends[0] if distinct == 1 else " to ".join(ends)
        note = f"goes along with {tied[factor]}" if factor in tied else "" if distinct > 1 else "held"
        rows.append((factor, results.unit(factor), span, distinct, note))
    return page.section("inputs", "What was varied", page.table(("factor", "unit", "range", "values", ""), rows))


def _ends(results: Results) -> page.Section:
    reasons = results.reasons()
    if not reasons:
        return page.section("ends", "How the variants ended", page.text("Every variant is ok."))
    return page.section(
        "ends",
        "How the variants ended",
        page.text(
            "Infeasible variants could not be run as drawn; diverged ones were stopped when their motion ran away; "
            "suspect ones are beyond a limit of the study. None of them takes part in what follows."
        ),
        page.table(("status", "reason (of the first one, where only its numbers differ)", "variants"), reasons[:25]),
        page.text(f"{len(reasons) - 25} further reasons are in the table.") if len(reasons) > 25 else "",
    )


def _spread(results: Results, metrics: tuple[str, ...]) -> str:
    rows = []
    for metric in metrics:
        values = results.values(metric)[results.rows_for(metric)]
        rows.append((metric, results.unit(metric), *np.percentile(values, (0, 5, 50, 95, 100)).tolist(), len(values)))
    return page.table(("metric", "unit", "least", "5 %", "median", "95 %", "most", "variants"), rows)


def _effects(results: Results, effects: Mapping[str, list[Effect]]) -> page.Section:
    parts = [
        page.text(
            "Mean of the metric in each group of a factor's values, with two standard errors; the dashed line is the "
            "mean of all. A factor explains the part of the variance that lies between its groups; without "
            "interactions the parts add up to one, less what is scatter.",
            muted=True,
        )
    ]
    for metric, found in effects.items():
        if found:
            parts.append(page.heading(metric))
            parts.append(page.picture(charts.effects_figure(results, metric, found), f"main effects on {metric}"))
    return page.section("effects", "Main effects", *parts)


def _correlation(results: Results, first: tuple[str, ...], most: int = 40) -> page.Section | None:
    names = tuple(dict.fromkeys((*first, *results.varying_metrics())))
    usable = tuple(m for m in names if results.rows_for(m).sum() >= 3)
    if not results.numeric_factors() or not usable:
        return None
    both = correlation(results, usable[:most])
    return page.section(
        "correlation",
        "Correlation",
        page.text(
            f"Rank correlation: +1 where the metric always rises with the factor, -1 where it always falls. Values "
            f"below {both.noise():.2f} in size are gray: chance alone stays below that in 19 of 20 cases.",
            muted=True,
        ),
        page.picture(charts.correlation_figure(both), "heat map of rank correlations of factors and metrics"),
        page.text(f"The first {most} of {len(usable)} metrics are shown.") if len(usable) > most else "",
    )


def _surfaces(results: Results, metrics: tuple[str, ...]) -> page.Section:
    parts, refused = [], []
    for metric in metrics:
        try:
            surface = fit_surface(results, metric)
        except StudyError as error:
            refused.append(str(error))
            continue
        parts.append(page.picture(charts.surface_figure(results, surface), f"response surface of {metric}"))
        if not surface.trusted:
            parts.append(page.text(f"{metric}: predicted R\u00b2 is below {TRUSTED}: take the slices as a hint only."))
    return page.section(
        "surface",
        "Response surfaces",
        page.text(
            "Quadratic surfaces by least squares, cut along each factor with the others midway between their ends; "
            "gray points are the variants. Predicted R\u00b2 tells how well variants left out one at a time are met.",
            muted=True,
        ),
        *parts,
        page.bullets(refused) if refused else "",
    )


def _sobol(results: Results, metrics: tuple[str, ...]) -> page.Section:
    found: list[Indices] = []
    lines = []
    for metric in metrics:
        try:
            indices, words = best_indices(results, metric)
        except StudyError as error:
            lines.append(str(error))
            continue
        found.append(indices)
        lines.append(f"{metric}: {words}.")
    return page.section(
        "sobol",
        "Sobol' indices",
        page.text(
            "The part of a metric's variance that each factor causes: alone, and together with its interactions. Where "
            "both bars are alike, the factor acts on its own.",
            muted=True,
        ),
        page.picture(charts.indices_figure(found), "Sobol' indices of the metrics") if found else "",
        page.bullets(lines),
    )


def _front(results: Results, objectives: Mapping[str, str], by_default: bool) -> page.Section | None:
    if len(objectives) < 2:
        return None
    front = pareto_front(results, objectives)
    words = " and ".join(f"{metric} {'low' if sense == 'min' else 'high'}" for metric, sense in objectives.items())
    hint = " (taken for want of chosen objectives)" if by_default else ""
    heads = ("variant", *objectives, *results.factors)
    return page.section(
        "front",
        "Pareto front",
        page.text(
            f"Wanted: {words}{hint}. No other variant beats those on the front in one without losing in another."
        ),
        page.picture(charts.front_figure(results, objectives), f"Pareto front of {words}"),
        page.table(heads, (_row(results, int(row), tuple(objectives)) for row in front[:30])),
        page.text(f"{len(front) - 30} further variants are on the front.") if len(front) > 30 else "",
    )


def _row(results: Results, row: int, metrics: tuple[str, ...]) -> list[object]:
    """Variant, metrics and factors of a row, for a table."""
    values = [results.table[name][row].as_py() for name in (*metrics, *results.factors)]
    return [int(results.variants[row]), *values]


def _extremes(results: Results, metrics: tuple[str, ...]) -> page.Section:
    parts = []
    for metric in metrics:
        rows = np.flatnonzero(results.rows_for(metric))
        order = rows[np.argsort(results.values(metric)[rows], kind="stable")]
        ends = dict.fromkeys([*order[:EXTREMES].tolist(), *order[-EXTREMES:].tolist()])
        unit = f" [{results.unit(metric)}]" if results.unit(metric) else ""
        parts.append(page.heading(metric))
        parts.append(
            page.table(("variant", f"{metric}{unit}", *results.factors), (_row(results, r, (metric,)) for r in ends))
        )
    return page.section("extremes", "Lowest and highest variants", *parts)


def write_report(
    source: pa.Table | Results | str | Path,
    output: str | Path,
    title: str | None = None,
    factors: tuple[str, ...] = (),
    metrics: tuple[str, ...] = (),
    objectives: Mapping[str, str] | None = None,
    notes: Mapping[str, str] | None = None,
) -> Path:
    """Writes the report of a study; it appears under its name only when whole.

    Args:
        source: results, a table, or the path of a Parquet or CSV file.
        output: the HTML file.
        title: heading; None takes the table's file name.
        factors: columns that were varied; none takes those that the table marks.
        metrics, objectives, notes: see `report_html`.

    Raises:
        StudyError: a table that cannot be read or lacks a column, or a folder that cannot be written.
    """
    results = source if isinstance(source, Results) else read_results(source, factors or None)
    heading = title or (Path(source).stem if isinstance(source, str | Path) else "Study")
    html = report_html(results, heading, metrics, objectives, notes)
    target = Path(output)
    write_text(target, html)
    return target
