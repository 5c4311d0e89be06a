"""Designs to recommend, out of the rows that were run, with what is believed of them and why.

A row's metric scatters, and the best of many rows is the best partly by luck. So rows are compared by surrogates that
all rows speak through (`study.surrogate`): the mean of each metric, how sure it is, and with which probability each
limit is kept. Only rows that were run and ended well are recommended: each can be played. With noise, rows are designs
and metrics are statistics of their runs (`analysis.over_noise`): what is recommended names design factors only, and
tells how its metrics spread and in which share of the noise it keeps the limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.errors import StudyError
from warpchain.study.analysis.over_noise import Designs, Spread, spread
from warpchain.study.analysis.pareto import Goals, keeping, non_dominated
from warpchain.study.analysis.pure_error import standard_errors
from warpchain.study.design.noise import nominal
from warpchain.study.results import Array, Results
from warpchain.study.spec import Study
from warpchain.study.spec.noise import metric_in
from warpchain.study.surrogate import best_surrogate

SURE = 0.95
"""Probability of keeping all limits from which a row counts as keeping them."""


@dataclass(frozen=True)
class Believed:
    """A metric as a surrogate has it at the rows.

    Attributes:
        mean, deviation: (R,) of the metric itself, without the noise of a run; NaN where rows were not ok.
        source: where they come from, in words.
    """

    mean: Array
    deviation: Array
    source: str


@dataclass(frozen=True)
class Recommended:
    """A design to build.

    Attributes:
        row: of the table.
        variant: its number.
        reasons: why, one line each.
        believed: mean and standard deviation by metric.
        measured: what its run gave, by metric.
        chance: probability that it keeps all limits; with noise, the share of its runs that do.
        alike: number of other rows that do not differ from it, within their deviations, in what it is recommended for.
        spreads: with noise, how metrics of its runs spread.
    """

    row: int
    variant: int
    reasons: tuple[str, ...]
    believed: dict[str, tuple[float, float]]
    measured: dict[str, float]
    chance: float
    alike: int
    spreads: tuple[Spread, ...] = ()


def believed(results: Results, metric: str) -> Believed:
    """A metric at the rows: by a Gaussian process, a quadratic surface, or as measured."""
    values, rows = results.values(metric), results.rows_for(metric)
    if metric in results.factors:
        return Believed(values, np.zeros(len(values)), "set")
    with suppress(StudyError):
        found = best_surrogate(results, metric, 0.0)  # at 0 no better than the mean of all rows
        mean, deviation = np.full(len(values), np.nan), np.full(len(values), np.nan)
        taken = rows & results.rows_for(metric, found.factors)
        mean[taken], deviation[taken] = found.predict(results.table.filter(taken))
        return Believed(mean, deviation, f"{found.kind} surrogate of {found.rows} variants")
    scatter = np.full(len(values), float(values[rows].std(ddof=1)) if rows.sum() > 1 else np.nan)
    if isinstance(results, Designs) and (errors := standard_errors(results, metric)) is not None:
        scatter = errors
    return Believed(np.where(rows, values, np.nan), scatter, "as measured; no surrogate predicts it")


@dataclass(frozen=True)
class Judged:
    """All rows, judged by the goals.

    Attributes:
        goals: what is wanted.
        believed: by metric.
        costs: (R, M) means of the objectives, all to be small.
        spread: (R, M) their deviations.
        measured: (R, M) the objectives as they were run, all to be small.
        chance: (R,) probability of keeping all limits; 0 where a row was not ok.
    """

    goals: Goals
    believed: dict[str, Believed]
    costs: Array
    spread: Array
    measured: Array
    chance: Array

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Rows that keep the limits, or where none surely does, those that are likeliest to."""
        return self.chance >= min(SURE, float(self.chance.max(initial=0.0)))


def judge(results: Results, goals: Goals) -> Judged:
    """Judges the rows by the goals.

    Raises:
        StudyError: no row is ok and has all metrics.
    """
    measured = goals.measured(results)
    if not measured.ok.any():
        raise StudyError("objectives: no variant is ok and has all of " + ", ".join(goals.metrics))
    found = {name: believed(results, name) for name in goals.metrics}
    costs = np.stack([s * found[o.metric].mean for o, s in zip(goals.objectives, goals.signs, strict=True)], axis=1)
    spread = np.stack([found[o.metric].deviation for o in goals.objectives], axis=1)
    chance = np.where(measured.ok & np.isfinite(costs).all(axis=1), 1.0, 0.0)
    for bound in goals.bounds:
        of = found[bound.metric]
        chance = chance * np.where(
            chance > 0.0, keeping(bound, np.nan_to_num(of.mean), np.nan_to_num(of.deviation)), 0.0
        )
    return Judged(goals, found, costs, spread, measured.costs, chance)


def front_of(judged: Judged) -> NDArray[np.intp]:
    """Rows on the front of means among those that keep the limits, by the first objective (P,).

    Of these only the ones that are on the front as measured, too, if there are any.
    """
    rows = np.flatnonzero(judged.sure & (judged.chance > 0.0))
    front = rows[non_dominated(judged.costs[rows])] if len(rows) else rows
    both = np.intersect1d(front, rows[non_dominated(judged.measured[rows])]) if len(rows) else rows
    front = both if len(both) else front
    return front[np.argsort(judged.costs[front, 0], kind="stable")]


def recommend(results: Results, goals: Goals, most: int = 4) -> list[Recommended]:
    """The designs to recommend, at most so many: the best of each objective, the best compromise, a safe choice.

    Raises:
        StudyError: no row is ok and has all metrics.
    """
    judged = judge(results, goals)
    front = front_of(judged)
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
        picks.append(
            (best, f"{word} {name} of the variants that keep the limits" if goals.bounds else f"{word} {name}", m)
        )
    cautious = judged.costs + 2.0 * judged.spread
    held = np.flatnonzero(judged.sure & (judged.chance > 0.0))
    safe = int(held[int(np.argmin(cautious[held, 0]))])
    picks.append((safe, f"{words[0]} {names[0]} that is sure: at two standard deviations to the worse", 0))
    found: dict[int, list[tuple[str, int]]] = {}
    for row, reason, m in picks:
        if row in found or len(found) < most:
            found.setdefault(row, []).append((reason, m))
    return [_recommended(results, judged, row, reasons) for row, reasons in found.items()]


def _recommended(results: Results, judged: Judged, row: int, reasons: list[tuple[str, int]]) -> Recommended:
    goals = judged.goals
    objectives = [m for _, m in reasons if m >= 0] or list(range(len(goals.objectives)))
    others = np.flatnonzero(judged.sure & (judged.chance > 0.0))
    gap = judged.costs[others] - judged.costs[row]
    width = np.hypot(judged.spread[others], judged.spread[row])
    alike = int((np.abs(gap) <= 2.0 * width)[:, objectives].all(axis=1).sum()) - 1
    lines = [reason for reason, _ in reasons]
    chance = float(judged.chance[row])
    spreads: tuple[Spread, ...] = ()
    if isinstance(results, Designs):
        metrics = dict.fromkeys(metric_in(n) for n in goals.metrics if n not in results.factors)
        spreads = tuple(spread(results, row, metric) for metric in metrics)
    if isinstance(results, Designs) and results.bounds:
        wanted = f"no design surely keeps them in {100.0 * goals.keep:g} % of the noise"
        lines.append(results.kept_words(row) + ("" if chance >= SURE else f"; {wanted}"))
        kept, count = results.kept(row)
        chance = kept / count
    elif goals.bounds:
        words = f"keeps the limits with a probability of {100.0 * chance:.0f} %"
        lines.append(words if chance >= SURE else f"{words}; no variant does so with {100.0 * SURE:.0f} %")
    if alike > 0:
        lines.append(
            f"{alike} other variant{'s' if alike > 1 else ''} cannot be told from it within two standard deviations"
        )
    return Recommended(
        row,
        int(results.variants[row]),
        tuple(lines),
        {name: (float(of.mean[row]), float(of.deviation[row])) for name, of in judged.believed.items()},
        {name: float(results.values(name)[row]) for name in goals.metrics},
        chance,
        max(alike, 0),
        spreads,
    )


def rows_of(study: Study, drive: Drive, designs: Results, chosen: Sequence[Recommended]) -> list[dict[str, Any]]:
    """Values by factor of recommended rows; of designs, noise factors are where the base drive has them."""
    if not isinstance(designs, Designs):
        names = [factor.name for factor in study.factors]
        return list(designs.table.select(names).take([one.row for one in chosen]).to_pylist())
    names = [factor.name for factor in study.designs.factors]
    rows = designs.runs.table.select(names).take([designs.rows[one.row][0] for one in chosen]).to_pylist()
    return [nominal(study, drive, row) for row in rows]
