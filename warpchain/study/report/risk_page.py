"""Page of `warpchain risk`: the probability of failure and its interval, what fails, how, and over which noise."""

from __future__ import annotations

from html import escape
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.results.units import quantity
from warpchain.study.analysis.failure_probability import FailureEstimate
from warpchain.study.optimize.risk import NOT_OK_LIMIT, DesignPoint, LimitEnd, RiskEstimate
from warpchain.study.report.panels import ACCENT, MARK, PALE, Axis, Panel, chart, report_page, rounded
from warpchain.study.spec.factor import Factor
from warpchain.study.store import write_study_text
from warpchain.view import html

PAGE = "risk.html"
"""Its name in the folder."""
SUBSET = "subset simulation"
DOTS = 1500
"""Most runs that are drawn."""
SEEN = 0.001
"""Part of the failures from which a limit's is told."""


def write_risk(found: RiskEstimate, page: str | Path | None = None, title: str | None = None) -> Path:
    """Writes the page, into the folder unless `page` says where; returns it."""
    target = found.folder / PAGE if page is None else Path(page)
    name = title or found.study.study.name or found.folder.resolve().name
    sections = [_summary(found), _failures(found), _noise(found), _methods(found)]
    write_study_text(target, report_page(name, sections))
    return target


def risk_lines(found: RiskEstimate) -> list[str]:
    """The result, a line each: the probability by each way, what differs, what fails, and how it most likely does."""
    results, row = found.results, _row(found, found.variant)
    held = _values(found, row, [name for name in results.factors if name not in results.noise_factors])
    at = f", at {', '.join(f'{name} = {value}' for name, value in held)}" if held else ""
    lines = [
        f"over the noise of {', '.join(results.noise_factors)}{at}",
        *(f"limit: {words}" for words in _limit_words(found)),
        *(
            f"P(a limit is exceeded) = {_estimate_words(of)}: {way}"
            for way, of in _ways(found)
            if not isinstance(of, str)
        ),
        *(f"{way}: {of}" for way, of in _ways(found) if isinstance(of, str)),
        _headline(found),
        *warning_lines(found),
        f"what fails: {_shares_words(found)}",
        f"most likely way to fail: variant {found.variant}, {found.distance:.3g} standard deviations from the medians",
    ]
    lines += [f"  {name} = {value}" for name, value in _values(found, row, results.noise_factors)]
    for metric in dict.fromkeys(bound.metric for bound in found.study.bounds):
        lines.append(f"  {metric}: {quantity(float(results.values(metric)[row]), results.column_unit(metric))}")
    return [*lines, f"  play it: warpchain view {found.archive} --variant {found.variant}"]


def warning_lines(found: RiskEstimate) -> list[str]:
    """Reasons why the result is uncertain beyond its interval."""
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


def _headline(found: RiskEstimate) -> str:
    """The probability to state."""
    if isinstance(found.joint, str):
        return f"probability of failure: {found.joint}"
    by = SUBSET if isinstance(found.sampled, str) else "importance sampling"
    return f"probability of failure: {_estimate_words(found.joint, runs=False)}, by {by}"


def _way_line(way: str, of: FailureEstimate | str) -> str:
    return f"{way}: {of}" if isinstance(of, str) else f"P(a limit is exceeded) = {_estimate_words(of)}: {way}"


def _estimate_words(of: FailureEstimate, runs: bool = True) -> str:
    words = f"{of.probability:.2g}, {of.low:.2g} to {of.high:.2g} with 95 % confidence"
    return f"{words}, {of.evaluations} runs" if runs else words


def _ways(found: RiskEstimate) -> tuple[tuple[str, FailureEstimate | str], ...]:
    return ((SUBSET, found.subset), ("importance sampling", found.sampled))


def _row(found: RiskEstimate, variant: int) -> int:
    return found.results.variants.tolist().index(variant)


def _values(found: RiskEstimate, row: int, names: Any) -> list[tuple[str, str]]:
    """Values of factors in a row, with their units."""
    cells = [(name, found.results.table[name][row].as_py()) for name in names]
    return [(n, quantity(v, found.results.column_unit(n)) if isinstance(v, float) else str(v)) for n, v in cells]


def _limit_words(found: RiskEstimate) -> list[str]:
    """Each limit on a metric: "tension_max at most 900 N"."""
    lines = []
    for bound in found.study.bounds:
        ends = [(word, end) for word, end in (("at least", bound.min), ("at most", bound.max)) if end is not None]
        words = " and ".join(f"{word} {quantity(end, found.results.column_unit(bound.metric))}" for word, end in ends)
        lines.append(f"{bound.metric} {words}")
    return lines


def _failure_words(limit: LimitEnd) -> str:
    """A way to fail."""
    metric, end = limit
    return "run not ok" if limit == NOT_OK_LIMIT else f"{metric} {'above its max' if end == 'max' else 'below its min'}"


def _shares(found: RiskEstimate) -> list[tuple[LimitEnd, float]]:
    """The limits that failures break, the most frequent first."""
    seen = [(limit, share) for limit, share in found.shares.items() if share >= SEEN]
    return sorted(seen, key=lambda one: -one[1])


def _shares_words(found: RiskEstimate) -> str:
    return "; ".join(f"{_failure_words(limit)} in {100.0 * share:.3g} % of failures" for limit, share in _shares(found))


def _summary(found: RiskEstimate) -> html.PageSection:
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
        *([f"{_headline(found)}."] if isinstance(joint, str) else []),
        *(f"Limit: {words}." for words in _limit_words(found)),
        f"What fails: {_shares_words(found)}.",
        f"The likeliest failure is {found.distance:.3g} standard deviations from the medians of the noise.",
        *warning_lines(found),
    ]
    rows = [
        (way, *((of, "", "", "") if isinstance(of, str) else _cells(of)))
        for way, of in (*_ways(found), ("stated", found.joint))
    ]
    return html.page_section(
        "summary",
        "In short",
        f'<div class="counts">{cells}</div>',
        html.bullets_html(lines),
        html.table_html(("estimate", "P", "95 % from", "to", "runs"), rows),
        chart(_intervals(found), "95 % intervals of the probability of failure"),
        html.paragraph_html(
            f"{results.table.num_rows} runs look for failures. They are no sample of the noise, so that their shares, "
            "means and quantiles tell nothing about drives in the field; only the estimates above do.",
            muted=True,
        ),
    )


def _cells(of: FailureEstimate) -> tuple[str, str, str, str]:
    return f"{of.probability:.3g}", f"{of.low:.3g}", f"{of.high:.3g}", str(of.evaluations)


def _intervals(found: RiskEstimate) -> list[Panel]:
    """Intervals of both ways over the logarithm of P."""
    known = [(way, of) for way, of in _ways(found) if not isinstance(of, str)][::-1]
    low, middle, high = (
        rounded(np.log10([getattr(of, name) for _, of in known])) for name in ("low", "probability", "high")
    )
    at = list(range(len(known)))
    series = [
        {"kind": "spans", "y": at, "low_x": low, "high_x": high, "color": ACCENT},
        {"kind": "points", "y": at, "x": middle, "color": ACCENT, "size": 3.0},
    ]
    x = {"label": "log10 of the probability of failure"}
    size = {"width": 860, "height": 70 + 36 * len(known)}
    return [{"x": x, "y": {"words": [way for way, _ in known]}, "series": series, **size}]


def _failures(found: RiskEstimate) -> html.PageSection:
    """Which limits failures break, and the design points."""
    rows = [(_failure_words(limit), f"{100.0 * share:.3g} %") for limit, share in _shares(found)]
    parts = [html.table_html(("what fails", "of the failures"), rows)]
    for k, point in enumerate(found.points, 1):
        parts += [html.heading_html(f"Design point {k} of {len(found.points)}: variant {point.variant}")]
        parts += _point(found, point)
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
        chart(_plane(found), "failures over the two factors that deviate most"),
    )


def _point(found: RiskEstimate, point: DesignPoint) -> list[str]:
    results, row = found.results, _row(found, point.variant)
    first = ", ".join(_failure_words(limit) for limit in point.broken)
    members = {of.name: of.group or of.name for of in found.study.noise_study.factors}
    deviations = {name: point.deviations.get(axis) for name, axis in members.items()}
    values = [
        (name, value, "" if (off := deviations.get(name)) is None else f"{off:+.2f}")
        for name, value in _values(found, row, results.noise_factors)
    ]
    metrics = [
        (bound.metric, quantity(float(results.values(bound.metric)[row]), results.column_unit(bound.metric)), words)
        for bound, words in zip(found.study.bounds, _limit_words(found), strict=True)
    ]
    return [
        html.paragraph_html(f"{point.distance:.3g} standard deviations from the medians; fails first: {first}."),
        html.table_html(("noise", "value", "deviation"), values),
        html.table_html(("metric", "there", "limit"), metrics),
    ]


def _plane(found: RiskEstimate) -> list[Panel]:
    """Runs that fail and that do not, over the two factors that deviate most at the first design point."""
    results, sizes = found.results, found.points[0].deviations
    members = {of.name: of.group or of.name for of in found.study.noise_study.factors}
    numeric = [name for name in members if name in results.numeric_factors() and members[name] in sizes]
    chosen = sorted(numeric, key=lambda name: -abs(sizes[members[name]]))[:2]
    if len(chosen) < 2:
        return []
    x, y = (Axis(results, name) for name in chosen)
    fails = ~results.ok
    for bound in found.study.bounds:
        values = results.values(bound.metric)
        for end, way in ((bound.max, 1.0), (bound.min, -1.0)):
            fails |= np.full(len(values), False) if end is None else way * (values - end) >= 0.0
    points = [_row(found, point.variant) for point in found.points]
    series: list[dict[str, Any]] = []
    for rows, color, size, label in (
        (np.flatnonzero(~fails), PALE, 1.8, "runs that keep the limits"),
        (np.flatnonzero(fails), MARK, 1.8, "runs that fail"),
        (np.array(points), ACCENT, 4.0, "design points"),
    ):
        some = rows[:: max(1, -(-len(rows) // DOTS))]
        along, up = (rounded(axis.of(results.values(name)[some])) for axis, name in zip((x, y), chosen, strict=True))
        series.append({"kind": "points", "x": along, "y": up, "color": color, "size": size, "label": label})
    return [{"x": {"label": x.name}, "y": {"label": y.name}, "series": series, "width": 620, "height": 420}]


def _noise(found: RiskEstimate) -> html.PageSection:
    """Assumptions: distributions and correlations of the noise, values that are held, what counts as a failure."""
    results, noise = found.results, found.study.noise
    factors = [of for of in found.study.factors if of.name in found.study.noise_names]
    rows = [
        (of.name, _place(of), _distribution(of, "" if of.hidden else results.column_unit(of.name))) for of in factors
    ]
    held = _values(
        found, _row(found, found.variant), [name for name in results.factors if name not in results.noise_factors]
    )
    lines = ["Factors are independent of each other."]
    if noise is not None and noise.correlated:
        pairs = combinations(range(len(noise.correlated)), 2)
        words = [f"{noise.correlated[a]} and {noise.correlated[b]} {noise.ranks[a][b]:g}" for a, b in pairs]
        lines = [f"Rank correlations: {', '.join(words)}; other factors are independent."]
    lines += [
        *([f"Held: {', '.join(f'{name} = {value}' for name, value in held)}."] if held else []),
        "What is not in this table has the base drive's value in every run, and each run begins as that drive does.",
        "A run that is not ok counts as a failure.",
        "P is as right as these distributions are in their tails, where the failures lie, and as the drive's model.",
    ]
    return html.page_section(
        "noise",
        "What is assumed about the noise",
        html.table_html(("noise", "of", "distribution"), rows),
        html.bullets_html(lines),
    )


def _place(factor: Factor) -> str:
    """The places in the drive that a factor sets."""
    paths = ", ".join(path for _, path in factor.target_paths()) or factor.shift or factor.expression or ""
    way = "times " if factor.relative else "added to " if factor.offset else "moves " if factor.shift else ""
    return way + paths


def _distribution(factor: Factor, unit: str) -> str:
    """A factor's distribution in words, with units."""
    if factor.value_source == "expression":
        return "follows other factors"
    words = [factor.value_source or "as the table of rows has it"]
    if factor.range is not None:
        words.append(" to ".join(quantity(end, unit) for end in factor.range))
    words += [f"{key} {quantity(v, unit)}" for key, v in (("mean", factor.mean), ("std", factor.std)) if v is not None]
    if factor.listed_values is not None:
        words.append(", ".join(quantity(v, unit) if isinstance(v, float) else str(v) for v in factor.listed_values))
    if factor.sample is not None:
        words.append(f"{len(factor.sample)} values")
    return ", ".join(words)


def _methods(found: RiskEstimate) -> html.PageSection:
    """The methods, and their runs."""
    sampled = 0 if isinstance(found.sampled, str) else found.sampled.evaluations
    rest = len(found.results.status) - found.subset.evaluations - sampled - found.search_runs
    rows = [
        (SUBSET, "thresholds approach the limit; the interval is of independent repetitions", found.subset.evaluations),
        (
            "importance sampling",
            "from a mixture fitted to the failures found, its weights held against failures it was not fitted to",
            sampled + rest,
        ),
        ("search for design points", "steps along the limit towards the medians", found.search_runs),
    ]
    return html.page_section("methods", "How it was found", html.table_html(("step", "method", "runs"), rows))
