"""Designs compared over noise: a row a design with means, deviations and quantiles of its runs.

A run's contribution to a statistic T is its jackknife pseudo-value (Efron 1982), T_k the statistic without run k,

    J_k = T + (n - 1) (mean(T_1 .. T_n) - T_k);                                                               (a)

T's standard error is the deviation of T_k times sqrt(n - 1). Designs are compared by differences of J over the same
noise. For a fit y = sum f_i(z_i) of p_i terms each and scatter s^2, noise factor i has the part (Li et al. 2010)

    S_i = cov(f_i, y) / var(y) - p_i s^2 / ((n - 1) var(y)).                                                 (b)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.results.replicate_metrics import ERROR_SUFFIX, ROLE_OF_ERRORS
from warpchain.study.analysis.paired import FEWEST_PAIRS, MeanDifference, mean_difference
from warpchain.study.analysis.pareto import SENSE_SIGNS, Goals
from warpchain.study.analysis.pure_error import CONFIDENCE
from warpchain.study.results import ARCHIVE_COLUMNS, TODAY_COLUMN, Array, Results
from warpchain.study.spec.noise_table import Statistic, metric_from_name, statistic_from_name
from warpchain.study.spec.study_tables import Bound, Objective

SHOWN_STATISTICS = ("mean", "std", "q5", "q50", "q95")
STATUS_SEVERITY = ("ok", "suspect", "diverged", "infeasible")
FEWEST_RUNS = 4


@dataclass(frozen=True)
class Designs(Results):
    """Designs over noise, a row each, statistics as metrics."""

    runs: Results  # results of all runs
    rows: tuple[NDArray[np.intp], ...]  # of `runs`, for each design
    bounds: tuple[Bound, ...]  # limits that each run is held to

    def kept_counts(self, design: int) -> tuple[int, int]:
        """Numbers of a design's runs within limits, and of all."""
        held = np.zeros(len(self.runs.status), dtype=bool)
        held[self.rows[design]] = True
        kept = Goals((), self.bounds).goal_values(self.runs).limits_kept if self.bounds else self.runs.ok
        return int((kept & held).sum()), int(held.sum())

    def kept_text(self, design: int) -> str:
        """Clause on a design's chance to keep limits over noise."""
        from scipy.stats import binomtest

        kept, count = self.kept_counts(design)
        interval = binomtest(kept, count).proportion_ci(0.95)
        return (
            f"keeps the limits with a probability of {100.0 * kept / count:.0f} % over the noise: in {kept} of {count} "
            f"runs; {100.0 * interval.low:.0f} to {100.0 * interval.high:.0f} % with 95 % confidence"
        )

    @cached_property
    def _rows_by_noise(self) -> list[dict[tuple[Any, ...], int]]:
        """Row of `runs` by noise values, for each design."""
        columns = [self.runs.table[name].to_pylist() for name in self.runs.free_noise_factors]
        return [{tuple(column[row] for column in columns): row for row in rows.tolist()} for rows in self.rows]

    def paired_values(self, first: int, second: int, metric: str) -> Array:
        """Metric (n, 2) of two designs over the same noise."""
        one, other = self._rows_by_noise[first], self._rows_by_noise[second]
        rows = np.array([(row, other[key]) for key, row in one.items() if key in other], dtype=np.intp).reshape(-1, 2)
        values = _ok_values(self.runs, metric)[rows]
        return values[np.isfinite(values).all(axis=1)]

    def statistic_difference(self, first: int, second: int, statistic: Statistic) -> MeanDifference:
        """Difference of two designs' statistic over the same noise, (a)."""
        before, after = (
            _jackknife_pseudo_values(of, statistic) for of in self.paired_values(first, second, statistic.metric).T
        )
        return mean_difference(after - before, CONFIDENCE)

    def sure_sign(self, first: int, second: int, name: str) -> int | None:
        """Sign of two designs' difference in a statistic, 0 if unsure, or None."""
        statistic = statistic_from_name(name)
        if statistic is None:
            return None
        values = self.paired_values(first, second, statistic.metric)
        if len(values) < FEWEST_PAIRS:
            return None
        ways = np.sign(values[:, 1] - values[:, 0])
        if statistic.word != "std" and (ways == ways[0]).all():
            return int(ways[0])
        return self.statistic_difference(first, second, statistic).shown_sign


@dataclass(frozen=True)
class NoiseSpread:
    """Spread of a design's metric over the noise."""

    metric: str
    statistics: dict[str, tuple[float, float]]  # value and standard error, of `SHOWN_STATISTICS`
    parts: dict[str, float]  # of the variance by noise factor [-], (b); empty if runs are too few

    @property
    def unexplained_part(self) -> float:
        """Part of the variance that noise factors leave unexplained."""
        return max(0.0, 1.0 - sum(self.parts.values()))

    def parts_text(self) -> str:
        """Text of each noise factor's part of a spread."""
        if not self.parts:
            return "too few runs to tell" if self.statistics["std"][0] > 0.0 else "it does not spread"
        ordered = sorted(self.parts.items(), key=lambda part: -part[1])
        words = [f"{name} {100.0 * part:.0f} %" for name, part in ordered]
        return ", ".join([*words, f"together or by chance {100.0 * self.unexplained_part:.0f} %"])


def goals_of_designs(goals: Goals, chosen: Sequence[str]) -> Goals:
    """Goals of designs, statistics over noise, from goals of runs."""

    def is_plain(name: str) -> bool:
        """Whether a goal is a design factor or statistic already."""
        return name in chosen or statistic_from_name(name) is not None

    objectives = tuple(
        o if is_plain(o.metric) else Objective(metric=f"mean({o.metric})", sense=o.sense) for o in goals.objectives
    )
    bounds: list[Bound] = []
    for bound in goals.bounds:
        if is_plain(bound.metric):
            bounds.append(bound)
            continue
        share = 100.0 * goals.keep
        for level, end in ((share, {"max": bound.max}), (100.0 - share, {"min": bound.min})):
            if None not in end.values():
                bounds.append(Bound(metric=f"q{round(level, 6):g}({bound.metric})", **end))
    return replace(goals, objectives=objectives, bounds=tuple(bounds))


def designs_over_noise(results: Results, goals: Goals, noise: Sequence[str] | None = None) -> tuple[Results, Goals]:
    """Designs over noise from results of runs, and their goals.

    Args:
        noise: names of noise factors; None takes those marked in the table.

    Raises:
        StudyError: a metric that the table lacks, too few runs, or runs of a search.
    """
    import pyarrow as pa

    results.check_sampled()
    noise = results.noise_factors if noise is None else noise
    if not noise:
        return results, goals
    chosen = tuple(name for name in results.factors if name not in noise)
    rows = _design_rows(results, chosen)
    least = min(len(of) for of in rows)
    if least < FEWEST_RUNS:
        raise StudyError(f"noise: a design has {least} runs; to compare designs, each needs at least {FEWEST_RUNS}")
    over = goals_of_designs(goals, chosen)
    worst = [_worst_run(results, of, goals) for of in rows]
    kept = ("variant", *chosen, *ARCHIVE_COLUMNS, *results.adjustment_columns, "round")
    kept = tuple(name for name in kept if name in results.table.column_names)
    table = results.table.select(kept).take(worst)
    for name in ("status", "reason"):
        if name in results.table.column_names:
            table = table.append_column(name, results.table[name].take(worst))
    if TODAY_COLUMN in results.table.column_names:
        marks = results.table[TODAY_COLUMN].to_pylist()
        own = [next((marks[row] for row in of.tolist() if marks[row] is not None), None) for of in rows]
        table = table.append_column(TODAY_COLUMN, pa.array(own, pa.bool_()))
    metrics = []
    for statistic in _statistics_of_goals(over):
        values = _ok_values(results, statistic.metric)
        found = np.array([_statistic_with_error(values[of], statistic) for of in rows])
        name = f"{statistic.word}({statistic.metric})"
        facts = {"unit": results.column_unit(statistic.metric)}
        for suffix, role, column in (("", "metric", found[:, 0]), (ERROR_SUFFIX, ROLE_OF_ERRORS, found[:, 1])):
            field = pa.field(name + suffix, pa.float64(), metadata={"role": role, **facts})
            table = table.append_column(field, pa.array(np.where(np.isfinite(column), column, np.nan)))
        metrics.append(name)
    each = tuple(bound for bound in goals.bounds if bound not in over.bounds)
    return Designs(table, chosen, tuple(metrics), results, rows, each), over


def noise_spread(designs: Designs, design: int, metric: str) -> NoiseSpread:
    """Spread of a design's metric over noise, with factors' parts."""
    runs, rows = designs.runs, designs.rows[design]
    found = {}
    for word in SHOWN_STATISTICS:
        found[word] = _statistic_with_error(_ok_values(runs, metric)[rows], _statistic_of_word(word, metric))
    return NoiseSpread(metric, found, _variance_parts(runs, rows[runs.usable_rows(metric)[rows]], metric))


def _design_rows(results: Results, chosen: Sequence[str]) -> tuple[NDArray[np.intp], ...]:
    """Rows of results (n,) of each design."""
    found: dict[tuple[Any, ...], list[int]] = {}
    columns = [results.table[name].to_pylist() for name in chosen]
    for row in range(results.table.num_rows):
        key = tuple(column[row] for column in columns)
        found.setdefault(key, []).append(row)
    return tuple(np.array(rows, dtype=np.intp) for rows in found.values())


def _worst_run(results: Results, rows: NDArray[np.intp], goals: Goals) -> int:
    """Row of a design's worst run over noise."""
    grave = [
        STATUS_SEVERITY.index(results.status[row]) if results.status[row] in STATUS_SEVERITY else 1
        for row in rows.tolist()
    ]
    if max(grave) > 0:
        return int(rows[int(np.argmax(grave))])
    towards = [(o.metric, SENSE_SIGNS[o.sense]) for o in goals.objectives]
    towards += [(b.metric, 1.0 if b.max is not None else -1.0) for b in goals.bounds]
    for name, sign in towards:
        values = sign * results.values(metric_from_name(name))[rows]
        if np.isfinite(values).all() and np.ptp(values) > 0.0:
            return int(rows[int(np.argmax(values))])
    return int(rows[0])


def _statistic_of_word(word: str, metric: str) -> Statistic:
    """Statistic of a metric by word, such as "q95"."""
    found = statistic_from_name(f"{word}({metric})")
    assert found is not None  # a word of SHOWN
    return found


def _statistics_of_goals(goals: Goals) -> list[Statistic]:
    """Statistics over noise in goals or tables, each once."""
    named = [found for name in goals.named_metrics if (found := statistic_from_name(name)) is not None]
    shown = [_statistic_of_word(word, of.metric) for of in named for word in SHOWN_STATISTICS]
    return list(dict.fromkeys([*named, *shown]))


def _ok_values(results: Results, metric: str) -> Array:
    """Metric (R,) of all runs over noise, NaN if not ok."""
    if metric not in results.table.column_names and not results.ok.any():
        return np.full(len(results.status), np.nan)  # nothing ran: no metric has a column yet
    return np.where(results.ok, results.values(metric), np.nan)


def _statistic_with_error(values: Array, statistic: Statistic) -> tuple[float, float]:
    """Statistic of ok runs over noise, and standard error."""
    values = values[np.isfinite(values)]
    if len(values) < FEWEST_RUNS:
        return float("nan"), float("nan")
    whole, without = _leave_one_out_statistics(values, statistic)
    return whole, float(np.sqrt(len(values) - 1) * without.std())


def _jackknife_pseudo_values(values: Array, statistic: Statistic) -> Array:
    """Jackknife pseudo-values (n,) of a statistic, (a)."""
    whole, without = _leave_one_out_statistics(values, statistic)
    return np.asarray(whole + (len(values) - 1) * (without.mean() - without))


def _leave_one_out_statistics(values: Array, statistic: Statistic) -> tuple[float, Array]:
    """Statistic of values (n,), and without each (n,)."""
    n, mean = len(values), float(values.mean())
    if np.ptp(values) == 0.0:
        return (0.0 if statistic.word == "std" else float(values[0])), np.zeros(n)
    if statistic.word == "mean":
        return mean, (n * mean - values) / (n - 1)
    if statistic.level is None:
        squares = (values - mean) ** 2
        left = (squares.sum() - squares * n / (n - 1)) / (n - 2)
        return float(values.std(ddof=1)), np.sqrt(np.maximum(left, 0.0))
    order = np.argsort(values, kind="stable")
    ordered, weights = values[order], _harrell_davis_weights(n - 1, statistic.level)
    below = np.append(0.0, np.cumsum(weights * ordered[:-1]))
    above = np.append(np.cumsum((weights * ordered[1:])[::-1])[::-1], 0.0)
    without = np.empty(n)
    without[order] = below + above
    return float(_harrell_davis_weights(n, statistic.level) @ ordered), without


def _harrell_davis_weights(count: int, level: float) -> Array:
    """Weights (count,) of sorted values in Harrell-Davis quantiles."""
    from scipy.special import betainc

    return np.diff(betainc((count + 1) * level, (count + 1) * (1.0 - level), np.arange(count + 1) / count))


def _variance_parts(results: Results, rows: NDArray[np.intp], metric: str) -> dict[str, float]:
    """Each noise factor's part of a metric's variance, (b)."""
    terms = {name: of for name in results.free_noise_factors if (of := _noise_terms(results, rows, name)).shape[1]}
    y = results.values(metric)[rows]
    y = y - y.mean() if len(y) else y
    count = sum(of.shape[1] for of in terms.values())
    total = float(y @ y)
    if not terms or len(y) < count + FEWEST_RUNS or total == 0.0:
        return {}
    whole = np.hstack(list(terms.values()))
    weights = np.linalg.lstsq(whole, y, rcond=None)[0]
    residual = y - whole @ weights
    scatter = float(residual @ residual) / (len(y) - 1 - count)
    found, at = {}, 0
    for name, of in terms.items():
        width = of.shape[1]
        found[name] = max(0.0, float((of @ weights[at : at + width]) @ y - width * scatter) / total)
        at += width
    return found


def _noise_terms(results: Results, rows: NDArray[np.intp], name: str) -> Array:
    """Terms (n, p) of a noise factor in (b), of mean 0."""
    if not results.is_numeric(name):
        words = np.array(results.text_values(name))[rows]
        of = np.array([words == word for word in np.unique(words)[1:]], dtype=float).reshape(-1, len(rows))
    else:
        values = results.values(name)[rows]
        levels = np.unique(values)
        z = (values - values.mean()) / values.std() if len(levels) > 1 else values
        of = np.stack([z, z * z])[: min(2, len(levels) - 1)]
    return np.asarray((of - of.mean(axis=1, keepdims=True)).T)
