"""HTML report of a study: one page that needs nothing beside it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from warpchain.errors import StudyError
from warpchain.results.units import quantity_words
from warpchain.study.analysis import Effect, correlation, main_effects
from warpchain.study.analysis.effects import median_effects
from warpchain.study.analysis.interactions import Interaction, interactions
from warpchain.study.analysis.left_out import LeftOut
from warpchain.study.analysis.over_noise import designs_over_noise
from warpchain.study.analysis.pure_error import CONFIDENCE, has_equal_rows, pure_error, scatter_share
from warpchain.study.analysis.sensitivity import SobolIndices
from warpchain.study.analysis.surface import TRUSTED_R2
from warpchain.study.optimize.recommend import RecommendedDesign
from warpchain.study.report import panels
from warpchain.study.report.decision_sections import (
    ReportGoals,
    explorer_data,
    has_study_files,
    pareto_section,
    recommended_section,
    report_goals,
    statuses_section,
    variants_table_html,
    write_recommended_drives,
)
from warpchain.study.report.search_section import search_section
from warpchain.study.results import ROUND_COLUMN, ROW_STATUSES, Results, added_rows, read_results
from warpchain.study.spec.noise_table import metric_from_name
from warpchain.study.spec.study_tables import Objective
from warpchain.study.store import write_study_text
from warpchain.study.surrogate import Surrogate, best_surrogate
from warpchain.study.surrogate.indices import best_indices
from warpchain.view import html

if TYPE_CHECKING:
    import pyarrow as pa

TELLING_METRICS = (
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
MOST_SHOWN_METRICS = 6
MOST_NAMED_PAIRS = 3
EXTREME_VARIANTS = 3


def telling_metrics(results: Results) -> tuple[str, ...]:
    """Names of metrics that a report shows by default."""
    enough = results.ok.sum() / 2
    varying = [m for m in results.varying_metrics() if results.usable_rows(m).sum() > enough]
    ordered = [m for pattern in TELLING_METRICS for m in varying if _is_of_pattern(m, pattern)] + list(varying)
    return tuple(dict.fromkeys(ordered))[:MOST_SHOWN_METRICS]


def _is_of_pattern(metric: str, pattern: str) -> bool:
    """Whether a metric's name matches one of `TELLING_METRICS`."""
    of_chain = "*" not in pattern and "->" not in metric
    return fnmatch(metric, pattern) or (of_chain and fnmatch(metric, f"*.{pattern}"))


def study_report_html(
    results: Results,
    title: str = "Study",
    metrics: tuple[str, ...] = (),
    objectives: Mapping[str, str] | None = None,
    notes: Mapping[str, str] | None = None,
    wanted: ReportGoals | None = None,
) -> str:
    """HTML report of a study.

    Args:
        metrics: to show; none takes the objectives and the telling ones.
        objectives: "min" or "max" by metric; None takes those of `wanted`.
        notes: further lines about the study, by name.
        wanted: objectives and limits of the study file, and its folder.

    Raises:
        StudyError: an unknown metric or sense, or a table without a variant.
    """
    return _report_parts(results, title, metrics, objectives, notes, wanted)[0]


def _report_parts(
    results: Results,
    title: str,
    metrics: tuple[str, ...],
    objectives: Mapping[str, str] | None,
    notes: Mapping[str, str] | None,
    wanted: ReportGoals | None,
    about: Sequence[str] = (),
) -> tuple[str, Results, list[RecommendedDesign]]:
    """HTML report of a study, compared rows, recommended designs."""
    if not results.table.num_rows:
        raise StudyError("the study has no variant yet: nothing to report")
    for metric in metrics:
        results.values(metric)
    wanted = report_goals(results, objectives, wanted)
    wished = dict.fromkeys(metric_from_name(metric) for metric in wanted.goals.named_metrics)
    named = tuple(metric for metric in wished if metric not in results.factors)
    shown = (
        tuple(metrics)
        or tuple(dict.fromkeys((*named, *telling_metrics(results))))[: max(MOST_SHOWN_METRICS, len(named))]
    )
    sought = wanted if wanted.objectives else replace(wanted, objectives=tuple(Objective(metric=m) for m in shown[:2]))
    designs, over = designs_over_noise(results, sought.goals)
    chosen = over.objective_senses
    enough = tuple(m for m in shown if results.usable_rows(m).sum() >= 3)
    sample = results.sampled_rows()
    analyzed = tuple(m for m in enough if sample.usable_rows(m).sum() >= 3)
    left_out = LeftOut(sample)
    unranked = frozenset(metric for metric in analyzed if left_out.is_unranked(metric))
    effects = {metric: _ordered_effects(sample, metric, metric not in unranked) for metric in analyzed}
    chances = {metric: scatter_share(sample, metric) for metric in analyzed}
    pairs = {metric: interactions(sample, metric) for metric in analyzed}
    of_design = _sample_note(results, sample)
    notes = dict(notes or {}) | ({"effects": of_design} if of_design else {})
    summary = _study_summary(results, left_out, (effects, pairs, chances, unranked), notes)
    ends = statuses_section(results, left_out)
    if not enough:
        few = html.page_section(
            "none", "No analysis", html.paragraph_html("Fewer than three variants have a metric that varies.")
        )
        return panels.report_page_html(title, [summary, few, _factors_section(results), ends], about=about), designs, []
    judged = replace(wanted, objectives=over.objectives if wanted.objectives else (), bounds=over.bounds)
    first, recommended = recommended_section(designs, judged)
    surrogates = _surrogates_of_metrics(results, enough)
    sections = [
        first,
        summary,
        pareto_section(designs, chosen, not wanted.objectives),
        search_section(designs, judged, recommended),
        html.page_section(
            "explore",
            "Explore the variants",
            panels.hint_html(EXPLORE_HINT),
            panels.placeholder_html("work", "variants"),
        ),
        _factors_section(results),
        ends,
        html.page_section(
            "distributions",
            "How the metrics are distributed",
            html.paragraph_html(of_design, muted=True) if of_design else "",
            _left_out_note(left_out, unranked),
            panels.panels_html(panels.histogram_panels(sample, analyzed), "histograms of the metrics"),
            _quantiles_table(sample, analyzed),
        ),
        _effects_section(sample, left_out, (effects, pairs, chances, unranked)),
        _correlation_section(sample, shown, _left_out_note(left_out, unranked)),
        _surrogates_section(results, surrogates, _left_out_note(left_out, unranked)),
        _sobol_section(results, surrogates, wanted.folder),
        _extremes_section(results, enough, _left_out_note(left_out, unranked)),
    ]
    ranked = {metric: found for metric, found in effects.items() if metric not in unranked}
    telling = [name for name in _telling_factors(ranked) or results.factors if name in designs.factors]
    explored = designs.metrics if results.noise_factors else shown
    data = explorer_data(designs, explored, telling, chosen, judged, recommended)
    open_names = ("designs", "summary", "front")
    pages = [section._replace(folded=section.name not in open_names) for section in sections if section]
    return panels.report_page_html(title, pages, data, about), designs, recommended


def _sample_note(results: Results, sample: Results) -> str:
    """Note on the rows that a report's statistics cover."""
    some, today = len(sample.status), int(added_rows(results.table).sum())
    crowded = len(results.status) - some - today
    if not crowded + today:
        return ""
    of = "search's" if crowded else "study's"
    lines = [f"Distributions, effects and correlations are of the {some} variants of the {of} design."]
    if today:
        lines.append(f"Those of today's design, {today}, are no part of it.")
    if crowded:
        lines.append(f"The other {crowded} crowd where it looked, and are no sample of the factors.")
    return " ".join(lines)


EXPLORE_HINT = (
    "Draw along an axis to keep a range, click it to let it go; draw a box in the scatter matrix to keep it in both "
    "of its columns. Point at a dot to see its variant and the command that plays it; click it to mark it. Red dots "
    "are on the Pareto front of those that are kept. The study's limits are set at first."
)


def _telling_factors(effects: Mapping[str, list[Effect]]) -> list[str]:
    """Names of factors, those that explain most first."""
    weight: dict[str, float] = {}
    for found in effects.values():
        for effect in found:
            weight[effect.factor] = max(weight.get(effect.factor, 0.0), effect.explained)
    return sorted(weight, key=lambda name: -weight[name])


MetricAnalyses: TypeAlias = (
    "tuple[Mapping[str, list[Effect]], Mapping[str, list[Interaction]], Mapping[str, float | None], frozenset[str]]"
)
"""Effects, interactions and scatter by metric, and unranked metrics."""


def _ordered_effects(results: Results, metric: str, ranked: bool) -> list[Effect]:
    """Main effects on a metric, by span if ranked."""
    found = main_effects(results, metric)
    return found if ranked else sorted(found, key=lambda effect: results.factors.index(effect.factor))


def _left_out_note(left_out: LeftOut, unranked: frozenset[str]) -> str:
    """HTML line on rows that a report leaves out."""
    return html.paragraph_html(f"{left_out.rest_text()}: see How the variants ended.") if unranked else ""


def _study_summary(
    results: Results, left_out: LeftOut, analyzed: MetricAnalyses, notes: Mapping[str, str]
) -> html.PageSection:
    """Study page's section in short."""
    effects, pairs, chances, unranked = analyzed
    status = results.status
    counts = [(word, status.count(word)) for word in ROW_STATUSES]
    boxes = html.key_numbers_html(
        [("", str(len(status)), "variants"), *((word if count else "", str(count), word) for word, count in counts)]
    )
    lines = left_out.lines()
    for metric, found in effects.items():
        words = "variants that are left out may lie beyond, so no factor is ranked."
        if metric not in unranked:
            words = _verdict_text(results, metric, found, pairs[metric], chances[metric])
        lines.append(f"{_range_text(results, metric)}; {words}")
    noted = html.table_html(("about the study", ""), list(notes.items())) if notes else ""
    return html.page_section("summary", "In short", boxes, html.bullets_html(lines) if lines else "", noted)


def _range_text(results: Results, metric: str) -> str:
    """Text of a metric's range, with variants."""
    rows = np.flatnonzero(results.usable_rows(metric))
    values, unit = results.values(metric)[rows], results.column_unit(metric)
    low, high = int(values.argmin()), int(values.argmax())
    return (
        f"{metric}: from {quantity_words(float(values[low]), unit)} (variant {results.variants[rows[low]]}) "
        f"to {quantity_words(float(values[high]), unit)} (variant {results.variants[rows[high]]})"
    )


def _verdict_text(
    results: Results, metric: str, effects: list[Effect], pairs: list[Interaction], chance: float | None
) -> str:
    """Sentence on the factor that stands out in a metric."""
    scatter = "" if chance is None else f"scatter between equal runs makes {100.0 * chance:.0f} % of the variance"
    if not effects:
        return f"no factor varies; {scatter}." if scatter else "no factor varies."
    best = max(effects, key=lambda effect: np.nan_to_num(effect.adjusted_share, nan=-1.0))
    if not len(effects) * best.chance < 1.0 - CONFIDENCE:
        if chance is not None and chance >= 0.5:
            return f"no factor stands out: {scatter}."
        if np.isnan(best.adjusted_share):
            groups = f"{best.row_count} variants in {len(best.counts)} groups of {best.factor}"
            return f"what each factor explains is not known from {groups}; {scatter}".removesuffix("; ") + "."
        alone = (
            f"no factor stands out alone: {best.factor} explains most, {100.0 * best.adjusted_share:.0f} %, "
            f"as chance may with {best.row_count} variants"
        )
        if named := [str(one) for one in pairs if one.is_sure][:MOST_NAMED_PAIRS]:
            return f"{alone}, but {'; '.join(named)}; {scatter}".removesuffix("; ") + "."
        together = "three or more factors act together, or all in ways that so few variants do not tell"
        return f"{alone}, yet {scatter} only, and no pair shows: {together}." if scatter else f"{alone}."
    axis = panels.ShownColumn(results, best.factor) if results.is_numeric(best.factor) else None
    unit = results.column_unit(metric)
    least, most = (
        f"{quantity_words(float(best.means[g]), unit)} "
        f"({best.labels[g] if axis is None else axis.group_text(best.labels[g])})"
        for g in (int(best.means.argmin()), int(best.means.argmax()))
    )
    line = (
        f"{best.factor} matters most, with {100 * best.adjusted_share:.0f} % of the variance: "
        f"the mean goes from {least} to {most}"
    )
    return f"{line}; {scatter}." if scatter else f"{line}."


def _factors_section(results: Results) -> html.PageSection:
    """Study page's section on factors: units, ranges, ties, noise."""
    rows, tied = [], results.factor_ties()
    for factor in results.factors:
        words = results.text_values(factor)
        distinct, unit = len(set(words)), ""
        if not results.is_numeric(factor):
            span = ", ".join(sorted(set(words))[:8])
        else:
            values = results.values(factor)
            axis = panels.ShownColumn(results, factor)
            ends = [axis.value_text(float(value)) for value in (np.nanmin(values), np.nanmax(values))]
            unit = axis.unit
            span = ends[0] if distinct == 1 else " to ".join(ends)
        note = f"goes along with {tied[factor]}" if factor in tied else "" if distinct > 1 else "held"
        note = "noise" if factor in results.noise_factors else note
        rows.append((factor, unit, span, distinct, note))
    return html.page_section(
        "inputs", "What was varied", html.table_html(("factor", "unit", "range", "values", ""), rows)
    )


def _quantiles_table(results: Results, metrics: tuple[str, ...]) -> str:
    """HTML table of metrics' quantiles."""
    rows = []
    for metric in metrics:
        values = results.values(metric)[results.usable_rows(metric)]
        axis = panels.ShownColumn(results, metric)
        parts = [axis.value_text(value) for value in np.percentile(values, (0, 5, 50, 95, 100)).tolist()]
        rows.append((metric, axis.unit, *parts, len(values)))
    return html.table_html(("metric", "unit", "least", "5 %", "median", "95 %", "most", "variants"), rows)


def _effects_section(results: Results, left_out: LeftOut, analyzed: MetricAnalyses) -> html.PageSection:
    """Study page's section on main effects and interactions."""
    effects, pairs, chances, unranked = analyzed
    shown = {metric: found for metric, found in effects.items() if found}
    fair = {metric: found for metric, found in shown.items() if metric not in unranked}
    shares = [min(1.0, float(np.nansum([effect.adjusted_share for effect in found]))) for found in fair.values()]
    parts = [
        html.paragraph_html(
            "Mean of the metric in each group of a factor's values, with two standard errors, and its median, which a "
            "few wild values do not move; the gray line is the mean of all. A factor explains the part of the variance "
            "that lies between its groups, less what as many groups take up by chance. It is not known where each "
            "group has one variant.",
            muted=True,
        ),
        _expressions_note(results),
        _left_out_note(left_out, unranked),
        html.heading_html("Scatter against effect"),
        panels.panels_html(
            panels.variance_share_panels(list(fair), shares, [chances[metric] for metric in fair]) if fair else [],
            "parts of the variance",
        ),
        html.bullets_html(_pure_error_line(results, m, chances[m]) for m in shown)
        if has_equal_rows(results)
        else html.paragraph_html(NO_REPLICATES_NOTE),
    ]
    for metric, found in shown.items():
        parts.append(html.heading_html(metric))
        means = panels.effect_panels(results, metric, found, median_effects(results, metric), metric in fair)
        parts.append(panels.panels_html(means, f"main effects on {metric}"))
        sure = [one for one in pairs[metric] if one.is_sure and metric in fair]
        parts.append(
            html.paragraph_html(f"Significant: {'; '.join(map(str, sure[:MOST_NAMED_PAIRS]))}.") if sure else ""
        )
        parts.append(
            panels.panels_html(panels.interaction_panels(results, metric, found, sure), f"interactions in {metric}")
        )
    return html.page_section("effects", "Effects and interactions", *parts)


NO_REPLICATES_NOTE = (
    "No two variants are equal runs, so the table does not tell how far they scatter: give the study replicates."
)


def _expressions_note(results: Results) -> str:
    """HTML line on factors of expressions, left out, or ""."""
    found = [f"{name} (of {' and '.join(others)})" for name, others in results.expression_factors().items()]
    text = f"Left out, as expressions of other factors: {', '.join(found)}."
    return html.paragraph_html(text, muted=True) if found else ""


def _pure_error_line(results: Results, metric: str, chance: float | None) -> str:
    """Line on a metric's scatter between equal runs."""
    try:
        error = pure_error(results, metric)
    except StudyError as refused:
        return str(refused)
    scatter = quantity_words(error.deviation, results.column_unit(metric))
    means = chance is not None and results.has_replicates
    rows = f", as of single runs; of the rows' means {100.0 * (chance or 0.0):.0f} %" if means else ""
    return f"{error}{rows}; one run has a standard deviation of {scatter} ({error.freedom} degrees of freedom)."


MOST_CORRELATED = 40


def _correlation_section(results: Results, first: tuple[str, ...], rest: str) -> html.PageSection | None:
    """Study page's section on rank correlations."""
    names = tuple(dict.fromkeys((*first, *results.varying_metrics())))
    usable = tuple(m for m in names if results.usable_rows(m).sum() >= 3)
    if not results.numeric_factors() or not usable:
        return None
    both = correlation(results, usable[:MOST_CORRELATED])
    return html.page_section(
        "correlation",
        "Correlation",
        rest,
        html.paragraph_html(
            f"Rank correlation: +1 where the metric always rises with the factor, -1 where it always falls. Values "
            f"below {both.noise_level():.2f} in size are gray: chance alone stays below that in 19 of 20 cases.",
            muted=True,
        ),
        panels.panels_html(panels.correlation_panels(both), "heat map of rank correlations of factors and metrics"),
        html.paragraph_html(f"The first {MOST_CORRELATED} of {len(usable)} metrics are shown.")
        if len(usable) > MOST_CORRELATED
        else "",
    )


def _surrogates_of_metrics(results: Results, metrics: tuple[str, ...]) -> dict[str, Surrogate | StudyError]:
    """Surrogate of each metric, or the error instead."""
    found: dict[str, Surrogate | StudyError] = {}
    for metric in metrics:
        try:
            found[metric] = best_surrogate(results, metric)
        except StudyError as error:
            found[metric] = error
    return found


def _surrogates_section(
    results: Results, surrogates: Mapping[str, Surrogate | StudyError], rest: str
) -> html.PageSection:
    """Study page's section on the metrics' surrogates: cuts, cross-validation."""
    parts, refused = [], []
    for metric, found in surrogates.items():
        if isinstance(found, StudyError):
            refused.append(str(found))
            continue
        checked = found.cross_validated()
        parts.append(html.heading_html(f"{metric}: {found.kind_text} of {found.row_count} variants"))
        parts.append(panels.panels_html(panels.surrogate_panels(results, found, checked), f"surrogate of {metric}"))
        if checked.q2 < TRUSTED_R2:
            parts.append(html.paragraph_html(f"{metric}: Q\u00b2 is below {TRUSTED_R2}: take the cuts as a hint only."))
    return html.page_section(
        "surface",
        "Between the variants",
        rest,
        html.paragraph_html(
            "Surrogates of the metrics, cut along each factor with the others midway between their ends. The inner "
            "band is where the metric is with 95 %, the outer one where a single run would come out. Q\u00b2 tells how "
            "well variants left out one at a time are met: 1 is perfect, 0 no better than the mean. "
            "Variants are weighted by their standard errors, where these are known.",
            muted=True,
        ),
        *parts,
        html.bullets_html(refused) if refused else "",
    )


def _sobol_section(
    results: Results, surrogates: Mapping[str, Surrogate | StudyError], folder: str | None
) -> html.PageSection:
    """Study page's section on Sobol' indices of the metrics."""
    found: list[SobolIndices] = []
    lines, refused = [], False
    for metric, surrogate in surrogates.items():
        try:
            indices, words = best_indices(results, metric, None if isinstance(surrogate, StudyError) else surrogate)
        except StudyError as error:
            lines.append(str(error))
            refused = True
            continue
        found.append(indices)
        lines.append(f"{metric}: {words}.")
    return html.page_section(
        "sobol",
        "Sobol' indices",
        html.paragraph_html(
            "The part of a metric's variance that each factor causes: alone, and together with its interactions. Where "
            "both bars are alike, the factor acts on its own.",
            muted=True,
        ),
        _expressions_note(results),
        panels.panels_html(panels.sobol_panels(found) if found else [], "Sobol' indices of the metrics"),
        html.bullets_html(lines),
        html.paragraph_html(_sobol_advice(results, folder or "DIR")) if refused else "",
    )


def _sobol_advice(results: Results, folder: str) -> str:
    """Advice on commands that lead to Sobol' indices."""
    if ROUND_COLUMN in results.table.column_names:
        going_on = f"raise optimize.count in the study file and go on: warpchain optimize STUDY.toml -o {folder}"
    else:
        going_on = (
            "of a sobol, halton or latin-hypercube design raise design.count in the study file and run it again, which "
            f"keeps what was run: warpchain study run STUDY.toml -o {folder} --grow"
        )
    return (
        f"More variants: {going_on}. More replicates: raise design.replicates likewise. "
        "A Saltelli design takes no surrogate: "
        'warpchain.study.analysis.sensitivity.saltelli_table makes the table for design.kind = "table".'
    )


def _extremes_section(results: Results, metrics: tuple[str, ...], rest: str) -> html.PageSection:
    """Study page's section on variants with metrics' extreme values."""
    parts = [rest]
    for metric in metrics:
        rows = np.flatnonzero(results.usable_rows(metric))
        order = rows[np.argsort(results.values(metric)[rows], kind="stable")]
        ends = dict.fromkeys([*order[:EXTREME_VARIANTS].tolist(), *order[-EXTREME_VARIANTS:].tolist()])
        parts += [html.heading_html(metric), variants_table_html(results, list(ends), (metric, *results.factors))]
    return html.page_section("extremes", "Lowest and highest variants", *parts)


def write_report(
    source: pa.Table | Results | str | Path,
    output: str | Path,
    title: str | None = None,
    factors: tuple[str, ...] = (),
    metrics: tuple[str, ...] = (),
    objectives: Mapping[str, str] | None = None,
    notes: Mapping[str, str] | None = None,
    wanted: ReportGoals | None = None,
) -> list[Path]:
    """Writes a study's HTML report; returns page and drive files.

    Args:
        source: results, a table, or the path of a Parquet or CSV file.
        output: the HTML file.
        title: None takes the table's file name.
        factors: columns that were varied; none takes those marked.
        metrics, objectives, notes, wanted: see `study_report_html`.

    Raises:
        StudyError: a table that cannot be read or lacks a column, or a folder that refuses.
    """
    results = source if isinstance(source, Results) else read_results(source, factors or None)
    heading = title or (Path(source).stem if isinstance(source, str | Path) else "Study")
    target = Path(output)
    if wanted is not None and has_study_files(wanted.folder):
        wanted = replace(wanted, page=target.stem)
    about = _about_lines(source, wanted)
    text, designs, recommended = _report_parts(results, heading, metrics, objectives, notes, wanted, about)
    files = []
    if wanted is not None and wanted.folder is not None and wanted.page is not None:
        files = write_recommended_drives(wanted.folder, target, designs, recommended)
    write_study_text(target, text)
    return [target, *files]


TABLE_FILES = ("results.parquet", "results.csv")


def _about_lines(source: object, wanted: ReportGoals | None) -> list[str]:
    """Lines on a report's source file: name, digest, date."""
    path = source if isinstance(source, str | Path) else None
    if path is None and wanted is not None and wanted.folder is not None:
        path = next((file for name in TABLE_FILES if (file := Path(wanted.folder) / name).is_file()), None)
    if path is None or not Path(path).is_file():
        return []
    with Path(path).open("rb") as data:
        digest = hashlib.file_digest(data, "sha256").hexdigest()[:16]
    changed = datetime.fromtimestamp(Path(path).stat().st_mtime, UTC)
    return [f"{path} (SHA-256 {digest})", f"{changed:%Y-%m-%d %H:%M} UTC"]
