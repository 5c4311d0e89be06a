"""HTML page of a risk estimate: probability of failure, what fails, how, over which noise."""

from __future__ import annotations

from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.results.units import quantity_words
from warpchain.study.analysis.failure_probability import FailureEstimate
from warpchain.study.optimize.risk import NOT_OK_LIMIT, DesignPoint, LimitEnd, RiskEstimate
from warpchain.study.report.panels import (
    ACCENT,
    MARK,
    PALE,
    Panel,
    ShownColumn,
    panels_html,
    report_page_html,
    rounded_numbers,
)
from warpchain.study.spec.factor import Factor
from warpchain.study.store import write_study_text
from warpchain.view import html

PAGE_FILE = "risk.html"
SUBSET_NAME = "subset simulation"
MOST_RUN_DOTS = 1500
LEAST_SHARE = 0.001


def write_risk_page(found: RiskEstimate, page: str | Path | None = None, title: str | None = None) -> Path:
    """Writes a risk estimate's HTML page; returns the file."""
    target = found.folder / PAGE_FILE if page is None else Path(page)
    name = title or found.study.study.name or found.folder.resolve().name
    rest = [_failures_section(found), _noise_section(found), _methods_section(found)]
    sections = [_risk_summary(found), *(section._replace(folded=True) for section in rest)]
    write_study_text(target, report_page_html(name, sections, about=[str(found.folder)]))
    return target


def risk_lines(found: RiskEstimate) -> list[str]:
    """Lines on a risk estimate."""
    results, row = found.results, _row_of_variant(found, found.variant)
    held = _named_values(found, row, [name for name in results.factors if name not in results.noise_factors])
    at = f", at {', '.join(f'{name} = {value}' for name, value in held)}" if held else ""
    lines = [
        f"drive: {found.drive}, over the noise of {', '.join(results.noise_factors)}{at}",
        *(f"limit: {words}" for words in _limit_texts(found)),
        *(
            f"P(a limit is exceeded) = {_estimate_text(of)}: {way}"
            for way, of in _named_estimates(found)
            if not isinstance(of, str)
        ),
        *(f"{way}: {of}" for way, of in _named_estimates(found) if isinstance(of, str)),
        _headline_text(found),
        *risk_warning_lines(found),
        f"what fails: {_failures_text(found)}",
        f"most likely way to fail: variant {found.variant}, {found.distance:.3g} standard deviations from the medians",
    ]
    lines += [f"  {name} = {value}" for name, value in _named_values(found, row, results.noise_factors)]
    for metric in dict.fromkeys(bound.metric for bound in found.study.bounds):
        lines.append(f"  {metric}: {quantity_words(float(results.values(metric)[row]), results.column_unit(metric))}")
    return [*lines, f"  play it: warpchain view {found.archive} --variant {found.variant}", *today_lines(found)]


def today_lines(found: RiskEstimate) -> list[str]:
    """Lines on a risk beside today's design."""
    if found.today is None:
        return []
    verdict = {
        -1: f"{found.drive} surely fails less often than today's design: the 95 % intervals do not overlap",
        0: "which of the two fails less often is not known: their 95 % intervals overlap, or one is unknown",
        1: f"{found.drive} surely fails more often than today's design: the 95 % intervals do not overlap",
    }
    return [
        f"today's design, {found.today.drive}: {_headline_text(found.today)}",
        f"what fails today: {_failures_text(found.today)}",
        verdict[found.sign_beside_today or 0],
    ]


def risk_warning_lines(found: RiskEstimate) -> list[str]:
    """Lines on what a risk's interval does not cover."""
    lines = []
    if isinstance(found.sampled, str) and not isinstance(found.joint, str):
        lines.append("LOOK AT: only subset simulation tells the probability; importance sampling does not check it")
    lost, results = int((~found.results.ok).sum()), found.results
    if lost:
        lines.append(
            f"LOOK AT: {lost} of {len(results.status)} runs are not ok and count as failures: "
            f"{results.reason_counts()[0][1]}"
        )
    return lines


def _headline_text(found: RiskEstimate) -> str:
    """Text of a risk's probability of failure, as headline."""
    if isinstance(found.joint, str):
        return f"probability of failure: {found.joint}"
    by = SUBSET_NAME if isinstance(found.sampled, str) else "importance sampling"
    return f"probability of failure: {_estimate_text(found.joint, runs=False)}, by {by}"


def _estimate_text(of: FailureEstimate, runs: bool = True) -> str:
    """Text of a probability of failure, with its interval."""
    words = f"{of.probability:.2g}, {of.low:.2g} to {of.high:.2g} with 95 % confidence"
    return f"{words}, {of.evaluations} runs" if runs else words


def _named_estimates(found: RiskEstimate) -> tuple[tuple[str, FailureEstimate | str], ...]:
    """Names and risk estimates of both methods."""
    return ((SUBSET_NAME, found.subset), ("importance sampling", found.sampled))


def _stated_estimates(found: RiskEstimate) -> tuple[tuple[str, FailureEstimate | str], ...]:
    """Names and risk estimates of drive and today's design."""
    beside = () if found.today is None else ((f"today's design, {found.today.drive}", found.today.joint),)
    return ((f"stated: {found.drive}", found.joint), *beside)


def _row_of_variant(found: RiskEstimate, variant: int) -> int:
    """Row of a variant in a risk's results."""
    return found.results.variants.tolist().index(variant)


def _named_values(found: RiskEstimate, row: int, names: Any) -> list[tuple[str, str]]:
    """Names and values of factors in a risk's run."""
    cells = [(name, found.results.table[name][row].as_py()) for name in names]
    return [(n, quantity_words(v, found.results.column_unit(n)) if isinstance(v, float) else str(v)) for n, v in cells]


def _limit_texts(found: RiskEstimate) -> list[str]:
    """Texts of limits at risk, "tension_max at most 900 N"."""
    lines = []
    for bound in found.study.bounds:
        ends = [(word, end) for word, end in (("at least", bound.min), ("at most", bound.max)) if end is not None]
        words = " and ".join(
            f"{word} {quantity_words(end, found.results.column_unit(bound.metric))}" for word, end in ends
        )
        lines.append(f"{bound.metric} {words}")
    return lines


def _failure_text(limit: LimitEnd) -> str:
    """Text of a limit that failures break."""
    metric, end = limit
    return "run not ok" if limit == NOT_OK_LIMIT else f"{metric} {'above its max' if end == 'max' else 'below its min'}"


def _frequent_failures(found: RiskEstimate) -> list[tuple[LimitEnd, float]]:
    """Limits that failures break, with shares, most frequent first."""
    seen = [(limit, share) for limit, share in found.shares.items() if share >= LEAST_SHARE]
    return sorted(seen, key=lambda one: -one[1])


def _failures_text(found: RiskEstimate) -> str:
    """Text of limits that failures break, with shares."""
    return "; ".join(
        f"{_failure_text(limit)} in {100.0 * share:.3g} % of failures" for limit, share in _frequent_failures(found)
    )


def _risk_summary(found: RiskEstimate) -> html.PageSection:
    """HTML section with a risk in short."""
    joint, results = found.joint, found.results
    boxes = [("unknown", "probability of failure")]
    if not isinstance(joint, str):
        boxes = [
            (f"{joint.probability:.2g}", "probability of failure"),
            (f"{joint.low:.2g} to {joint.high:.2g}", "95 % interval"),
            (f"1 in {float(f'{1.0 / joint.probability:.2g}'):,.0f}", "drives fails"),
        ]
    boxes.append((str(len(results.status)), "runs"))
    cells = "".join(f"<div><b>{escape(value)}</b>{escape(words)}</div>" for value, words in boxes)
    lines = [
        *([f"{_headline_text(found)}."] if isinstance(joint, str) else []),
        *(f"Limit: {words}." for words in _limit_texts(found)),
        f"What fails: {_failures_text(found)}.",
        f"The likeliest failure is {found.distance:.3g} standard deviations from the medians of the noise.",
        *risk_warning_lines(found),
        *(f"{line[0].upper()}{line[1:]}." for line in today_lines(found)),
    ]
    rows = [
        (way, *((of, "", "", "") if isinstance(of, str) else _estimate_cells(of)))
        for way, of in (*_named_estimates(found), *_stated_estimates(found))
    ]
    return html.page_section(
        "summary",
        "In short",
        f'<div class="counts">{cells}</div>',
        html.bullets_html(lines),
        html.table_html(("estimate", "P", "95 % from", "to", "runs"), rows),
        panels_html(_interval_panels(found), "95 % intervals of the probability of failure"),
        html.paragraph_html(
            f"{results.table.num_rows} runs look for failures. They are no sample of the noise, so that their shares, "
            "means and quantiles tell nothing about drives in the field; only the estimates above do.",
            muted=True,
        ),
    )


def _estimate_cells(of: FailureEstimate) -> tuple[str, str, str, str]:
    """Table cells of a risk estimate: probability, interval, runs."""
    return f"{of.probability:.3g}", f"{of.low:.3g}", f"{of.high:.3g}", str(of.evaluations)


def _interval_panels(found: RiskEstimate) -> list[Panel]:
    """Panels of risks' intervals over log probability."""
    named = (*_named_estimates(found), *_stated_estimates(found)[1:])
    known = [(way, of) for way, of in named if not isinstance(of, str)][::-1]
    low, middle, high = (
        rounded_numbers(np.log10([getattr(of, name) for _, of in known])) for name in ("low", "probability", "high")
    )
    at = list(range(len(known)))
    series = [
        {"kind": "spans", "y": at, "low_x": low, "high_x": high, "color": ACCENT},
        {"kind": "points", "y": at, "x": middle, "color": ACCENT, "size": 3.0},
    ]
    x = {"label": "log10 of the probability of failure"}
    size = {"width": 860, "height": 70 + 36 * len(known)}
    return [{"x": x, "y": {"words": [way for way, _ in known]}, "series": series, **size}]


def _failures_section(found: RiskEstimate) -> html.PageSection:
    """HTML section on broken limits and design points."""
    rows = [(_failure_text(limit), f"{100.0 * share:.3g} %") for limit, share in _frequent_failures(found)]
    parts = [html.table_html(("what fails", "of the failures"), rows)]
    for k, point in enumerate(found.points, 1):
        parts += [html.heading_html(f"Design point {k} of {len(found.points)}: variant {point.variant}")]
        parts += _design_point_html(found, point)
    return html.page_section(
        "failures",
        "What fails, and how",
        html.paragraph_html(
            "Design points are the likeliest values that fail, in directions that differ. A deviation is where a value "
            "is among all of its factor, as standard deviations of a normal distribution.",
            muted=True,
        ),
        *parts,
        html.paragraph_html(f"Play the likeliest failure: warpchain view {found.archive} --variant {found.variant}"),
        panels_html(_failure_panels(found), "failures over the two factors that deviate most"),
    )


def _design_point_html(found: RiskEstimate, point: DesignPoint) -> list[str]:
    """HTML of a design point: distance, noise, metrics."""
    results, row = found.results, _row_of_variant(found, point.variant)
    first = ", ".join(_failure_text(limit) for limit in point.broken)
    members = {of.name: of.group or of.name for of in found.study.noise_study.factors}
    deviations = {name: point.deviations.get(axis) for name, axis in members.items()}
    values = [
        (name, value, "" if (off := deviations.get(name)) is None else f"{off:+.2f}")
        for name, value in _named_values(found, row, results.noise_factors)
    ]
    metrics = [
        (
            bound.metric,
            quantity_words(float(results.values(bound.metric)[row]), results.column_unit(bound.metric)),
            words,
        )
        for bound, words in zip(found.study.bounds, _limit_texts(found), strict=True)
    ]
    return [
        html.paragraph_html(f"{point.distance:.3g} standard deviations from the medians; fails first: {first}."),
        html.table_html(("noise", "value", "deviation"), values),
        html.table_html(("metric", "there", "limit"), metrics),
    ]


def _failure_panels(found: RiskEstimate) -> list[Panel]:
    """Panels of failed and other runs over noise factors."""
    results, sizes = found.results, found.points[0].deviations
    members = {of.name: of.group or of.name for of in found.study.noise_study.factors}
    numeric = [name for name in members if name in results.numeric_factors() and members[name] in sizes]
    chosen = sorted(numeric, key=lambda name: -abs(sizes[members[name]]))[:2]
    if len(chosen) < 2:
        return []
    x, y = (ShownColumn(results, name) for name in chosen)
    fails = ~results.ok
    for bound in found.study.bounds:
        values = results.values(bound.metric)
        for end, way in ((bound.max, 1.0), (bound.min, -1.0)):
            fails |= np.full(len(values), False) if end is None else way * (values - end) >= 0.0
    points = [_row_of_variant(found, point.variant) for point in found.points]
    series: list[dict[str, Any]] = []
    for rows, color, size, label in (
        (np.flatnonzero(~fails), PALE, 1.8, "runs that keep the limits"),
        (np.flatnonzero(fails), MARK, 1.8, "runs that fail"),
        (np.array(points), ACCENT, 4.0, "design points"),
    ):
        some = rows[:: max(1, -(-len(rows) // MOST_RUN_DOTS))]
        along, up = (
            rounded_numbers(axis.shown_values(results.values(name)[some]))
            for axis, name in zip((x, y), chosen, strict=True)
        )
        series.append({"kind": "points", "x": along, "y": up, "color": color, "size": size, "label": label})
    return [{"x": {"label": x.name}, "y": {"label": y.name}, "series": series, "width": 620, "height": 420}]


def _noise_section(found: RiskEstimate) -> html.PageSection:
    """HTML section on a risk's noise and held values."""
    results, noise = found.results, found.study.noise
    factors = [of for of in found.study.factors if of.name in found.study.noise_names]
    rows = [
        (of.name, _target_text(of), _distribution_text(of, "" if of.hidden else results.column_unit(of.name)))
        for of in factors
    ]
    held = _named_values(
        found,
        _row_of_variant(found, found.variant),
        [name for name in results.factors if name not in results.noise_factors],
    )
    lines = ["Factors are independent of each other."]
    if noise is not None and noise.correlated:
        pairs = combinations(range(len(noise.correlated)), 2)
        words = [f"{noise.correlated[a]} and {noise.correlated[b]} {noise.ranks[a][b]:g}" for a, b in pairs]
        lines = [f"Rank correlations: {', '.join(words)}; other factors are independent."]
    lines += [
        *([f"Held: {', '.join(f'{name} = {value}' for name, value in held)}."] if held else []),
        "What is not in this table has the drive's value in every run, and each run begins as that drive does.",
        "A run that is not ok counts as a failure.",
        "P is as right as these distributions are in their tails, where the failures lie, and as the drive's model.",
    ]
    return html.page_section(
        "noise",
        "What is assumed about the noise",
        html.table_html(("noise", "of", "distribution"), rows),
        html.bullets_html(lines),
    )


def _target_text(factor: Factor) -> str:
    """Text of drive values that a noise factor sets."""
    paths = ", ".join(path for _, path in factor.target_paths()) or factor.shift or factor.expression or ""
    way = "times " if factor.relative else "added to " if factor.offset else "moves " if factor.shift else ""
    return way + paths


def _distribution_text(factor: Factor, unit: str) -> str:
    """Text of a noise factor's distribution, with units."""
    if factor.value_source == "expression":
        return "follows other factors"
    words = [factor.value_source or "as the table of rows has it"]
    if factor.range is not None:
        words.append(" to ".join(quantity_words(end, unit) for end in factor.range))
    words += [
        f"{key} {quantity_words(v, unit)}" for key, v in (("mean", factor.mean), ("std", factor.std)) if v is not None
    ]
    if factor.listed_values is not None:
        words.append(
            ", ".join(quantity_words(v, unit) if isinstance(v, float) else str(v) for v in factor.listed_values)
        )
    if factor.sample is not None:
        words.append(f"{len(factor.sample)} values")
    return ", ".join(words)


def _methods_section(found: RiskEstimate) -> html.PageSection:
    """HTML section on a risk's methods and their runs."""
    sampled = 0 if isinstance(found.sampled, str) else found.sampled.evaluations
    rest = len(found.results.status) - found.subset.evaluations - sampled - found.search_runs
    rows = [
        (
            SUBSET_NAME,
            "thresholds approach the limit; the interval is of independent repetitions",
            found.subset.evaluations,
        ),
        (
            "importance sampling",
            "from a mixture fitted to the failures found, its weights held against failures it was not fitted to",
            sampled + rest,
        ),
        ("search for design points", "steps along the limit towards the medians", found.search_runs),
    ]
    return html.page_section("methods", "How it was found", html.table_html(("step", "method", "runs"), rows))
