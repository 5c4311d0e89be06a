"""Recommended designs out of the rows that were run, with estimates and reasons (docs/optimization.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.errors import StudyError
from warpchain.results.units import quantity_words
from warpchain.study.analysis.over_noise import Designs, NoiseSpread, noise_spread
from warpchain.study.analysis.pareto import Goals, is_non_dominated, keeping_probability
from warpchain.study.analysis.pure_error import row_standard_errors
from warpchain.study.design.noise_rows import nominal_row
from warpchain.study.results import Array, Results
from warpchain.study.spec import Study
from warpchain.study.spec.noise_table import metric_from_name, statistic_from_name
from warpchain.study.surrogate import best_surrogate

SURE_PROBABILITY = 0.95


@dataclass(frozen=True)
class MetricEstimate:
    """Estimate of a metric at R rows."""

    mean: Array  # (R,) of the metric without a run's scatter; NaN if not ok
    deviation: Array  # (R,)
    source: str  # of the estimate, in words


@dataclass(frozen=True)
class MetricChange:
    """Change of a goal's metric from today's design."""

    difference: float
    half: float  # half width of the difference's interval: 95 % over noise, else two deviations
    sign: int  # 1 or -1 if the metric is surely above or below today's, else 0
    sense: str  # "min" or "max" of an objective, "" of another metric
    pairs: tuple[int, int] | None = None  # over noise, pairs of runs that differ so, and all pairs

    @property
    def verdict(self) -> str:
        """Word for a metric's change, such as "better"."""
        if not self.sign:
            return "not known"
        if not self.sense:
            return "more" if self.sign > 0 else "less"
        return "better" if (self.sign > 0) == (self.sense == "max") else "worse"


@dataclass(frozen=True)
class RecommendedDesign:
    """Recommended design, or today's, with its reasons."""

    row: int
    variant: int
    reasons: tuple[str, ...]
    believed: dict[str, tuple[float, float]]  # mean and deviation by metric; with noise, of its runs
    measured: dict[str, float]  # results of its run, by metric
    chance: float  # probability that it keeps all limits; with noise, the share of runs
    alike: int  # other rows that are not surely different in objectives
    spreads: tuple[NoiseSpread, ...] = ()  # of its metrics over noise
    changes: Mapping[str, MetricChange] = field(default_factory=dict)  # from today's design, by metric


def metric_estimate(results: Results, metric: str) -> MetricEstimate:
    """Estimate of a metric at rows, by runs or surrogate."""
    values, rows = results.values(metric), results.usable_rows(metric)
    if metric in results.factors:
        return MetricEstimate(values, np.zeros(len(values)), "set")
    own, errors = np.where(rows, values, np.nan), row_standard_errors(results, metric)
    if isinstance(results, Designs) and errors is not None:
        return MetricEstimate(values, errors, "simulated")
    with suppress(StudyError):
        found = best_surrogate(results, metric, 0.0)  # at 0 no better than the mean of all rows
        mean, deviation = np.full(len(values), np.nan), np.full(len(values), np.nan)
        taken = rows & results.usable_rows(metric, found.factors)
        mean[taken], deviation[taken] = found.predict(results.table.filter(taken))
        if results.has_replicates and errors is not None:
            known = rows & (errors < deviation)
            mean, deviation = np.where(known, own, mean), np.where(known, errors, deviation)
        return MetricEstimate(mean, deviation, f"{found.kind} surrogate of {found.row_count} variants")
    scatter = np.full(len(values), float(values[rows].std(ddof=1)) if rows.sum() > 1 else np.nan)
    return MetricEstimate(own, scatter, "simulated; no surrogate predicts it")


@dataclass(frozen=True)
class JudgedRows:
    """Rows of results, judged by objectives and limits."""

    goals: Goals
    believed: dict[str, MetricEstimate]  # estimates by metric
    costs: Array  # (R, M) means of objectives, all to be small
    spread: Array  # (R, M) their deviations
    measured: Array  # (R, M) costs as they were run
    within: NDArray[np.bool_]  # (R,) whether a row keeps all limits as run
    chance: Array  # (R,) probability of keeping all limits; 0 if not ok
    held: NDArray[np.bool_]  # (R,) whether a row counts as keeping the limits; if none, the likeliest


def judge_rows(results: Results, goals: Goals) -> JudgedRows:
    """Rows judged by goals: costs, chances to keep limits."""
    measured = goals.goal_values(results)
    if not measured.ok.any():
        raise StudyError("objectives: no variant is ok and has all of " + ", ".join(goals.named_metrics))
    found = {name: metric_estimate(results, name) for name in goals.named_metrics}
    costs = np.stack(
        [s * found[o.metric].mean for o, s in zip(goals.objectives, goals.cost_signs, strict=True)], axis=1
    )
    spread = np.stack([found[o.metric].deviation for o in goals.objectives], axis=1)
    chance = np.where(measured.ok & np.isfinite(costs).all(axis=1), 1.0, 0.0)
    for bound in goals.bounds:
        of = found[bound.metric]
        chance = chance * np.where(
            chance > 0.0, keeping_probability(bound, np.nan_to_num(of.mean), np.nan_to_num(of.deviation)), 0.0
        )
    within = np.isfinite(costs).all(axis=1) & (measured.limit_excess <= 0.0).all(axis=1)
    held = np.zeros(len(chance), dtype=bool)
    if isinstance(results, Designs):
        kept = [np.divide(*results.kept_counts(design)) >= goals.keep for design in range(len(results.rows))]
        held = measured.limits_kept & (np.array(kept) if results.bounds else True)
    if not held.any():
        held = (chance > 0.0) & (chance >= min(SURE_PROBABILITY, float(chance.max(initial=0.0))))
    return JudgedRows(goals, found, costs, spread, measured.costs, within, chance, held)


def estimated_front(judged: JudgedRows) -> NDArray[np.intp]:
    """Rows (P,) on the Pareto front of estimated costs."""
    rows = np.flatnonzero(judged.held)
    front = rows[is_non_dominated(judged.costs[rows])] if len(rows) else rows
    both = np.intersect1d(front, rows[is_non_dominated(judged.measured[rows])]) if len(rows) else rows
    front = both if len(both) else front
    return front[np.argsort(judged.costs[front, 0], kind="stable")]


def recommend(results: Results, goals: Goals, most: int = 4) -> list[RecommendedDesign]:
    """Recommended designs: compromise, best of each objective, safe choice.

    Raises:
        StudyError: no row is ok with all metrics.
    """
    return recommend_rows(results, judge_rows(results, goals), most)


def design_of_today(results: Results, judged: JudgedRows) -> RecommendedDesign | None:
    """Today's design described as recommended ones are, or None."""
    row = results.row_of_today
    return None if row is None else _recommended_design(results, judged, row, [])


def recommend_rows(results: Results, judged: JudgedRows, most: int = 4) -> list[RecommendedDesign]:
    """Recommended designs out of judged rows, at most `most`.

    Raises:
        StudyError: no row has a chance to keep the limits.
    """
    goals = judged.goals
    front = estimated_front(judged)
    if not len(front):
        raise StudyError("objectives: no variant that is ok has any chance to keep the limits")
    names = [objective.metric for objective in goals.objectives]
    words = ["lowest" if objective.sense == "min" else "highest" for objective in goals.objectives]
    picks: list[tuple[int, str, int]] = []
    if len(names) > 1:
        low, high = judged.costs[front].min(axis=0), judged.costs[front].max(axis=0)
        scaled = (judged.costs[front] - low) / np.where(high > low, high - low, 1.0)
        middle = int(front[int(np.argmin(np.linalg.norm(scaled, axis=1)))])
        picks.append((middle, f"best compromise of {' and '.join(names)}: nearest to having the best of each", -1))
    for m, (name, word) in enumerate(zip(names, words, strict=True)):
        best = int(front[int(np.argmin(judged.costs[front, m]))])
        reason = f"{word} {name} of the variants that keep the limits" if goals.bounds else f"{word} {name}"
        picks.append((best, reason + _simulated_rival(results, judged, best, m), m))
    if not isinstance(results, Designs):
        rows, cautious = np.flatnonzero(judged.held), judged.costs + 2.0 * judged.spread
        safe = int(rows[int(np.argmin(cautious[rows, 0]))])
        picks.append((safe, f"best {names[0]} even if two standard deviations worse than estimated", 0))
    elif goals.bounds and len(rows := np.flatnonzero(judged.held & (judged.chance >= SURE_PROBABILITY))):
        of_kept = f"{words[0]} {names[0]} of the variants that keep the limits"
        safe = int(min(rows[is_non_dominated(judged.costs[rows])].tolist(), key=lambda row: judged.costs[row, 0]))
        picks.append((safe, f"{of_kept} with {100.0 * SURE_PROBABILITY:.0f} % confidence", 0))
    found: dict[int, list[tuple[str, int]]] = {}
    for row, reason, m in picks:
        if row in found or len(found) < most:
            found.setdefault(row, []).append((reason, m))
    return [_recommended_design(results, judged, row, reasons) for row, reasons in found.items()]


def _simulated_rival(results: Results, judged: JudgedRows, best: int, m: int) -> str:
    """Text on a variant simulated better than the estimated best."""
    run = np.where(judged.held & np.isfinite(judged.measured[:, m]), judged.measured[:, m], np.inf)
    rival = int(np.argmin(run))
    if not run[rival] < judged.measured[best, m]:
        return ""
    value = judged.goals.cost_signs[m] * run[rival]
    return f", by the model's estimate; simulated, variant {results.variants[rival]} is better, at {value:.4g}"


def _sure_cost_signs(results: Results, judged: JudgedRows, row: int, others: NDArray[np.intp], m: int) -> Array:
    """Signs (K,) of other rows' costs less a row's."""
    gap = judged.costs[others, m] - judged.costs[row, m]
    alike = np.abs(gap) <= 2.0 * np.hypot(judged.spread[others, m], judged.spread[row, m])
    signs = np.where(alike, 0.0, np.sign(gap))
    if isinstance(results, Designs):
        for k, other in enumerate(others.tolist()):
            sign = results.sure_sign(row, other, judged.goals.objectives[m].metric)
            if sign is not None:
                signs[k] = judged.goals.cost_signs[m] * sign
    return signs


def _beating_rows(results: Results, judged: JudgedRows, row: int, others: NDArray[np.intp]) -> NDArray[np.intp]:
    """Rows that beat a row: one cost surely better, none worse."""
    others = others[(judged.costs[others] <= judged.costs[row]).all(axis=1)]
    better = [_sure_cost_signs(results, judged, row, others, m) < 0.0 for m in range(judged.costs.shape[1])]
    return np.asarray(others[np.any(better, axis=0)])


def _passed_over_lines(results: Results, judged: JudgedRows, row: int) -> list[str]:
    """Lines on why a better design is not recommended."""
    others = _beating_rows(results, judged, row, np.flatnonzero(judged.within))
    if not len(others):
        return []
    other = int(others[int(np.argmax(judged.chance[others] + judged.held[others]))])
    better = []
    for m, objective in enumerate(judged.goals.objectives):
        if _sure_cost_signs(results, judged, row, np.array([other]), m)[0] < 0.0:
            unit, values = results.column_unit(objective.metric), results.values(objective.metric)
            better.append(f"{objective.metric} {quantity_words(float(values[other]), unit)}")
    why = (
        f"keeps the limits with {_chance_text(judged, other)} confidence only, this one with "
        f"{_chance_text(judged, row)}"
    )
    if isinstance(results, Designs) and not judged.held[other]:
        why = "keeps the limits in {} of {} runs only".format(*results.kept_counts(other))
    if not results.ok[other]:
        why = f"one of its runs is {results.status[other]}: {results.reason(other)}"
    more = f"; likewise {len(others) - 1} more" if len(others) > 1 else ""
    beats = f"{' and '.join(better)}, significantly better over the same noise"
    return [f"variant {results.variants[other]} has {beats}, but {why}{more}"]


def _chance_text(judged: JudgedRows, row: int) -> str:
    """Text of a row's probability to keep limits."""
    return f"{100.0 * judged.chance[row]:.0f} %"


def _recommended_design(
    results: Results, judged: JudgedRows, row: int, reasons: list[tuple[str, int]]
) -> RecommendedDesign:
    """Recommended design of a row, with reasons."""
    goals = judged.goals
    objectives = [m for _, m in reasons if m >= 0] or list(range(len(goals.objectives)))
    others = np.flatnonzero(judged.held)
    same = np.all([_sure_cost_signs(results, judged, row, others, m) == 0.0 for m in objectives], axis=0)
    alike = int(same.sum()) - 1
    lines = [reason for reason, _ in reasons]
    chance = float(judged.chance[row])
    spreads: tuple[NoiseSpread, ...] = ()
    if isinstance(results, Designs):
        metrics = dict.fromkeys(metric_from_name(n) for n in goals.named_metrics if n not in results.factors)
        spreads = tuple(noise_spread(results, row, metric) for metric in metrics)
    over, today = isinstance(results, Designs), results.row_of_today
    if row == today:
        lines.append("today's design, the base drive as it is")
    lines += _adjustment_lines(results, row)
    if not results.ok[row]:
        lines.append(f"{results.status[row]}: {results.reason(row)}")
    if isinstance(results, Designs) and results.bounds:
        lines.append(results.kept_text(row))
        kept, count = results.kept_counts(row)
        chance = kept / count
    elif goals.bounds:
        lines.append(f"keeps the limits with a probability of {100.0 * chance:.0f} %")
    if goals.bounds and judged.chance[row] < SURE_PROBABILITY:
        kept_in = f"in {100.0 * goals.keep:g} % of the noise"
        kept_with = f"confidence that it keeps them {kept_in}: {_chance_text(judged, row)}"
        if over and (judged.chance >= SURE_PROBABILITY).any():
            lines[-1] += f"; {kept_with} only"
        elif over:
            lines[-1] += f"; {kept_with}, and no design has {100.0 * SURE_PROBABILITY:.0f} %"
        else:
            lines[-1] += f"; no variant does so with {100.0 * SURE_PROBABILITY:.0f} %"
    if alike > 0:
        how = "over the same noise" if over else "within two standard deviations"
        lines.append(f"{alike} other variant{'s' if alike > 1 else ''} cannot be told from it {how}")
    if isinstance(results, Designs) and reasons:
        lines += _passed_over_lines(results, judged, row)
    return RecommendedDesign(
        row,
        int(results.variants[row]),
        tuple(lines),
        {name: (float(of.mean[row]), float(of.deviation[row])) for name, of in judged.believed.items()},
        {name: float(results.values(name)[row]) for name in goals.named_metrics},
        chance,
        max(alike, 0),
        spreads,
        {} if today in (None, row) else _metric_changes(results, judged, today, row),
    )


def _adjustment_lines(results: Results, row: int) -> list[str]:
    """Line on a row's adjusted links and travel, if any."""
    chosen = []
    for name in results.adjustment_columns:
        value = results.table[name][row].as_py()
        if value is not None:
            chosen.append(f"{name} {quantity_words(value, results.column_unit(name))}")
    run = " for its worst run" if isinstance(results, Designs) else ""
    return [f"[adjust] chose{run} {', '.join(chosen)}"] if chosen else []


def _metric_changes(results: Results, judged: JudgedRows, before: int, after: int) -> dict[str, MetricChange]:
    """Changes of goals' metrics between rows, by metric."""
    senses = {objective.metric: objective.sense for objective in judged.goals.objectives}
    found = {}
    for name, of in judged.believed.items():
        gap, half = of.mean[after] - of.mean[before], 2.0 * np.hypot(of.deviation[after], of.deviation[before])
        sign, statistic, pairs = int(np.sign(gap)) * int(abs(gap) > half), statistic_from_name(name), None
        if isinstance(results, Designs) and statistic is not None:
            ways = np.sign(np.diff(results.paired_values(before, after, statistic.metric))[:, 0])
            pairs = int((ways == np.sign(gap)).sum()), len(ways)
            sure = results.sure_sign(before, after, name)
            if sure is not None:
                sign, half = sure, results.statistic_difference(before, after, statistic).half
        if np.isfinite(gap):
            found[name] = MetricChange(float(gap), float(half), sign, senses.get(name, ""), pairs)
    return found


def rows_of_recommended(
    study: Study, drive: Drive, designs: Results, chosen: Sequence[RecommendedDesign]
) -> list[dict[str, Any]]:
    """Study rows of recommended designs."""
    if not isinstance(designs, Designs):
        names = [factor.name for factor in study.factors]
        return list(designs.table.select(names).take([one.row for one in chosen]).to_pylist())
    names = [factor.name for factor in study.design_study.factors]
    rows = designs.runs.table.select(names).take([designs.rows[one.row][0] for one in chosen]).to_pylist()
    return [nominal_row(study, drive, row) for row in rows]
