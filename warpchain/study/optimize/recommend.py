"""Designs to recommend, out of the rows that were run, with what is believed of them and why.

A row's metric scatters, and the best of many rows is the best partly by luck. So rows that were run once are compared
by surrogates that all rows speak through (`study.surrogate`): the mean of each metric, how sure it is, and with which
probability each limit is kept. A mean of several runs that is known better by itself counts as it was run. Only rows
that were run and ended well are recommended: each can be played.

With noise, rows are designs and metrics are statistics of their runs (`analysis.over_noise`). Each design is judged by
its own runs, and compared with another in pairs of runs with the same noise: one beats another where it is surely
better in one objective and, as it was run, no worse in any. Of designs that keep the limits as they were run, none is
recommended that another one beats. Beside them stands the best of those that surely keep the limits. What beats that
one, or has a run that is not ok, is named with the reason. What is recommended names design factors only, and tells how
its metrics spread and in which share of the noise it keeps the limits.
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
from warpchain.results.units import quantity
from warpchain.study.analysis.over_noise import Designs, NoiseSpread, spread
from warpchain.study.analysis.pareto import Goals, is_non_dominated, keeping_probability
from warpchain.study.analysis.pure_error import row_standard_errors
from warpchain.study.design.noise_rows import nominal_row
from warpchain.study.results import Array, Results
from warpchain.study.spec import Study
from warpchain.study.spec.noise_table import metric_from_name
from warpchain.study.surrogate import best_surrogate

SURE = 0.95
"""Probability of keeping all limits from which a row counts as keeping them."""


@dataclass(frozen=True)
class Believed:
    """A metric at the rows, as it is believed to be.

    Attributes:
        mean, deviation: (R,) of the metric itself, without the scatter of a run; NaN where rows were not ok, but of
            designs what their runs that are ok give.
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
        believed: mean and standard deviation by metric; with noise, as its runs have them.
        measured: what its run gave, by metric.
        chance: probability that it keeps all limits; with noise, the share of its runs that do.
        alike: number of other rows that cannot be told from it in what it is recommended for.
        spreads: with noise, how metrics of its runs spread.
    """

    row: int
    variant: int
    reasons: tuple[str, ...]
    believed: dict[str, tuple[float, float]]
    measured: dict[str, float]
    chance: float
    alike: int
    spreads: tuple[NoiseSpread, ...] = ()


def believed(results: Results, metric: str) -> Believed:
    """A metric at the rows: as their runs gave it where that is known, else by a surrogate, else as measured."""
    values, rows = results.values(metric), results.usable_rows(metric)
    if metric in results.factors:
        return Believed(values, np.zeros(len(values)), "set")
    own, errors = np.where(rows, values, np.nan), row_standard_errors(results, metric)
    if isinstance(results, Designs) and errors is not None:
        return Believed(values, errors, "simulated")
    with suppress(StudyError):
        found = best_surrogate(results, metric, 0.0)  # at 0 no better than the mean of all rows
        mean, deviation = np.full(len(values), np.nan), np.full(len(values), np.nan)
        taken = rows & results.usable_rows(metric, found.factors)
        mean[taken], deviation[taken] = found.predict(results.table.filter(taken))
        if results.has_replicates and errors is not None:
            known = rows & (errors < deviation)
            mean, deviation = np.where(known, own, mean), np.where(known, errors, deviation)
        return Believed(mean, deviation, f"{found.kind} surrogate of {found.row_count} variants")
    scatter = np.full(len(values), float(values[rows].std(ddof=1)) if rows.sum() > 1 else np.nan)
    return Believed(own, scatter, "simulated; no surrogate predicts it")


@dataclass(frozen=True)
class Judged:
    """All rows, judged by the goals.

    Attributes:
        goals: what is wanted.
        believed: by metric.
        costs: (R, M) means of the objectives, all to be small.
        spread: (R, M) their deviations.
        measured: (R, M) the objectives as they were run, all to be small.
        within: (R,) rows that keep all limits as they were run, whether they are ok or not.
        chance: (R,) probability of keeping all limits; 0 where a row was not ok.
        held: (R,) rows that count as keeping the limits: of designs those that do as they were run, quantiles and in
            enough runs, of others those that surely do; where there are none, those that are likeliest to.
    """

    goals: Goals
    believed: dict[str, Believed]
    costs: Array
    spread: Array
    measured: Array
    within: NDArray[np.bool_]
    chance: Array
    held: NDArray[np.bool_]


def judge(results: Results, goals: Goals) -> Judged:
    """Judges the rows by the goals.

    Raises:
        StudyError: no row is ok and has all metrics.
    """
    measured = goals.goal_values(results)
    if not measured.ok.any():
        raise StudyError("objectives: no variant is ok and has all of " + ", ".join(goals.named_metrics))
    found = {name: believed(results, name) for name in goals.named_metrics}
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
        held = (chance > 0.0) & (chance >= min(SURE, float(chance.max(initial=0.0))))
    return Judged(goals, found, costs, spread, measured.costs, within, chance, held)


def front_of(judged: Judged) -> NDArray[np.intp]:
    """Rows on the front of means among those that keep the limits, by the first objective (P,).

    Of these only the ones that are on the front as measured, too, if there are any.
    """
    rows = np.flatnonzero(judged.held)
    front = rows[is_non_dominated(judged.costs[rows])] if len(rows) else rows
    both = np.intersect1d(front, rows[is_non_dominated(judged.measured[rows])]) if len(rows) else rows
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
    if not isinstance(results, Designs):
        rows, cautious = np.flatnonzero(judged.held), judged.costs + 2.0 * judged.spread
        safe = int(rows[int(np.argmin(cautious[rows, 0]))])
        picks.append((safe, f"best {names[0]} even if two standard deviations worse than estimated", 0))
    elif goals.bounds and len(rows := np.flatnonzero(judged.held & (judged.chance >= SURE))):
        of_kept = f"{words[0]} {names[0]} of the variants that keep the limits"
        safe = int(min(rows[is_non_dominated(judged.costs[rows])].tolist(), key=lambda row: judged.costs[row, 0]))
        picks.append((safe, f"{of_kept} with {100.0 * SURE:.0f} % confidence", 0))
    found: dict[int, list[tuple[str, int]]] = {}
    for row, reason, m in picks:
        if row in found or len(found) < most:
            found.setdefault(row, []).append((reason, m))
    return [_recommended(results, judged, row, reasons) for row, reasons in found.items()]


def _compared(results: Results, judged: Judged, row: int, others: NDArray[np.intp], m: int) -> Array:
    """Sign of objective m's cost of other rows less that of a row (K,), 0 where it is not sure.

    Designs over noise are told apart by pairs of runs where these are enough, other rows by two standard deviations.
    """
    gap = judged.costs[others, m] - judged.costs[row, m]
    alike = np.abs(gap) <= 2.0 * np.hypot(judged.spread[others, m], judged.spread[row, m])
    signs = np.where(alike, 0.0, np.sign(gap))
    if isinstance(results, Designs):
        for k, other in enumerate(others.tolist()):
            sign = results.sure_sign(row, other, judged.goals.objectives[m].metric)
            if sign is not None:
                signs[k] = judged.goals.cost_signs[m] * sign
    return signs


def _beating(results: Results, judged: Judged, row: int, others: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of other rows that are surely better than a row in one objective, and no worse in any as they were run."""
    others = others[(judged.costs[others] <= judged.costs[row]).all(axis=1)]
    better = [_compared(results, judged, row, others, m) < 0.0 for m in range(judged.costs.shape[1])]
    return np.asarray(others[np.any(better, axis=0)])


def _passed_over(results: Results, judged: Judged, row: int) -> list[str]:
    """Why a recommended design stands although another one that keeps the limits as it was run beats it.

    Of several, one that counts as keeping the limits is named, and the likeliest to.
    """
    others = _beating(results, judged, row, np.flatnonzero(judged.within))
    if not len(others):
        return []
    other = int(others[int(np.argmax(judged.chance[others] + judged.held[others]))])
    better = []
    for m, objective in enumerate(judged.goals.objectives):
        if _compared(results, judged, row, np.array([other]), m)[0] < 0.0:
            unit, values = results.column_unit(objective.metric), results.values(objective.metric)
            better.append(f"{objective.metric} {quantity(float(values[other]), unit)}")
    why = f"keeps the limits with {_chance(judged, other)} confidence only, this one with {_chance(judged, row)}"
    if isinstance(results, Designs) and not judged.held[other]:
        why = "keeps the limits in {} of {} runs only".format(*results.kept_counts(other))
    if not results.ok[other]:
        why = f"one of its runs is {results.status[other]}: {results.reason(other)}"
    more = f"; likewise {len(others) - 1} more" if len(others) > 1 else ""
    beats = f"{' and '.join(better)}, significantly better over the same noise"
    return [f"variant {results.variants[other]} has {beats}, but {why}{more}"]


def _chance(judged: Judged, row: int) -> str:
    return f"{100.0 * judged.chance[row]:.0f} %"


def _recommended(results: Results, judged: Judged, row: int, reasons: list[tuple[str, int]]) -> Recommended:
    goals = judged.goals
    objectives = [m for _, m in reasons if m >= 0] or list(range(len(goals.objectives)))
    others = np.flatnonzero(judged.held)
    same = np.all([_compared(results, judged, row, others, m) == 0.0 for m in objectives], axis=0)
    alike = int(same.sum()) - 1
    lines = [reason for reason, _ in reasons]
    chance = float(judged.chance[row])
    spreads: tuple[NoiseSpread, ...] = ()
    if isinstance(results, Designs):
        metrics = dict.fromkeys(metric_from_name(n) for n in goals.named_metrics if n not in results.factors)
        spreads = tuple(spread(results, row, metric) for metric in metrics)
    over = isinstance(results, Designs)
    if isinstance(results, Designs) and results.bounds:
        lines.append(results.kept_text(row))
        kept, count = results.kept_counts(row)
        chance = kept / count
    elif goals.bounds:
        lines.append(f"keeps the limits with a probability of {100.0 * chance:.0f} %")
    if goals.bounds and judged.chance[row] < SURE:
        kept_in = f"in {100.0 * goals.keep:g} % of the noise"
        kept_with = f"confidence that it keeps them {kept_in}: {_chance(judged, row)}"
        if over and (judged.chance >= SURE).any():
            lines[-1] += f"; {kept_with} only"
        elif over:
            lines[-1] += f"; {kept_with}, and no design has {100.0 * SURE:.0f} %"
        else:
            lines[-1] += f"; no variant does so with {100.0 * SURE:.0f} %"
    if alike > 0:
        how = "over the same noise" if over else "within two standard deviations"
        lines.append(f"{alike} other variant{'s' if alike > 1 else ''} cannot be told from it {how}")
    if isinstance(results, Designs):
        lines += _passed_over(results, judged, row)
    return Recommended(
        row,
        int(results.variants[row]),
        tuple(lines),
        {name: (float(of.mean[row]), float(of.deviation[row])) for name, of in judged.believed.items()},
        {name: float(results.values(name)[row]) for name in goals.named_metrics},
        chance,
        max(alike, 0),
        spreads,
    )


def rows_of(study: Study, drive: Drive, designs: Results, chosen: Sequence[Recommended]) -> list[dict[str, Any]]:
    """Values by factor of recommended rows; of designs, noise factors are where the base drive has them."""
    if not isinstance(designs, Designs):
        names = [factor.name for factor in study.factors]
        return list(designs.table.select(names).take([one.row for one in chosen]).to_pylist())
    names = [factor.name for factor in study.design_study.factors]
    rows = designs.runs.table.select(names).take([designs.rows[one.row][0] for one in chosen]).to_pylist()
    return [nominal_row(study, drive, row) for row in rows]
