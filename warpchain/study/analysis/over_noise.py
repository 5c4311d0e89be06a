"""Designs compared over noise: a row for each design with means, deviations and quantiles of its runs.

Quantiles are weighted sums of the sorted runs (Harrell and Davis 1982). What each run contributes to a statistic T is
its jackknife pseudo-value (Efron 1982), with T_k the statistic without run k,

    J_k = T + (n - 1) (mean(T_1 .. T_n) - T_k),                                                               (a)

which for a mean is the run itself. J has the mean T, and the standard error of T is the deviation of T_k about their
mean times sqrt(n - 1). Two designs that were run over the same rows of noise are compared by the differences of their
J, row by row (`analysis.paired`). A design whose runs are not all ok counts as its worst one does.

The part of a design's spread that comes of a noise factor i is (Li et al. 2010), for an additive fit y = sum f_i(z_i)
of straight lines and parabolas to its runs,

    S_i = cov(f_i, y) / var(y) - p_i s^2 / ((n - 1) var(y)),                                                 (b)

also where factors are correlated; the second term is what p_i terms take up of mere scatter s^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.results.replicate_metrics import ERROR, ROLE_OF_ERRORS
from warpchain.study.analysis.paired import LEAST as FEWEST_PAIRS
from warpchain.study.analysis.paired import MeanDifference, mean_difference
from warpchain.study.analysis.pareto import SENSES, Goals
from warpchain.study.analysis.pure_error import CONFIDENCE
from warpchain.study.results import ARCHIVE_COLUMNS, Array, Results
from warpchain.study.spec.noise_table import Statistic, metric_from_name, statistic_from_name
from warpchain.study.spec.study_tables import Bound, Objective

SHOWN = ("mean", "std", "q5", "q50", "q95")
"""Statistics that are words of each metric."""
SEVERITY = ("ok", "suspect", "diverged", "infeasible")
LEAST = 4
"""Fewest runs of a design that statistics are taken of."""


@dataclass(frozen=True)
class Designs(Results):
    """Designs, a row each, with statistics of their runs as metrics.

    Attributes:
        runs: all runs.
        rows: of each design, its rows of `runs`.
        bounds: limits that each run is held to.
    """

    runs: Results
    rows: tuple[NDArray[np.intp], ...]
    bounds: tuple[Bound, ...]

    def kept(self, design: int) -> tuple[int, int]:
        """Number of a design's runs that are ok and keep the limits, and of all its runs."""
        held = np.zeros(len(self.runs.status), dtype=bool)
        held[self.rows[design]] = True
        kept = Goals((), self.bounds).measured(self.runs).kept if self.bounds else self.runs.ok
        return int((kept & held).sum()), int(held.sum())

    def kept_words(self, design: int) -> str:
        """The probability of keeping the limits over the noise, with its 95 % interval (Clopper and Pearson 1934)."""
        from scipy.stats import binomtest

        kept, count = self.kept(design)
        interval = binomtest(kept, count).proportion_ci(0.95)
        return (
            f"keeps the limits with a probability of {100.0 * kept / count:.0f} % over the noise: in {kept} of {count} "
            f"runs; {100.0 * interval.low:.0f} to {100.0 * interval.high:.0f} % with 95 % confidence"
        )

    @cached_property
    def _by_noise(self) -> list[dict[tuple[Any, ...], int]]:
        """Row of `runs` of each design, by its values of the noise factors."""
        columns = [self.runs.table[name].to_pylist() for name in self.runs.free_noise_factors]
        return [{tuple(column[row] for column in columns): row for row in rows.tolist()} for rows in self.rows]

    def pairs(self, first: int, second: int, metric: str) -> Array:
        """Values (n, 2) of a metric in runs of two designs with the same noise, of pairs that are ok."""
        one, other = self._by_noise[first], self._by_noise[second]
        rows = np.array([(row, other[key]) for key, row in one.items() if key in other], dtype=np.intp).reshape(-1, 2)
        values = _values(self.runs, metric)[rows]
        return values[np.isfinite(values).all(axis=1)]

    def difference(self, first: int, second: int, statistic: Statistic) -> MeanDifference:
        """A statistic of the second design less that of the first, by their `pairs` (two at least), eq. (a)."""
        before, after = (_pseudo_values(of, statistic) for of in self.pairs(first, second, statistic.metric).T)
        return mean_difference(after - before, CONFIDENCE)

    def surely(self, first: int, second: int, name: str) -> int | None:
        """1 where a statistic of the second design is surely above that of the first, -1 where below, else 0.

        Sure is what the `difference` shows with 95 %, and of means and quantiles what all pairs agree in.

        Args:
            first, second: rows of the designs.
            name: of the statistic, such as "q95(tension_max)".

        Returns:
            None of a design factor, or where there are fewer pairs than tell a sign.
        """
        statistic = statistic_from_name(name)
        if statistic is None:
            return None
        values = self.pairs(first, second, statistic.metric)
        if len(values) < FEWEST_PAIRS:
            return None
        ways = np.sign(values[:, 1] - values[:, 0])
        if statistic.word != "std" and (ways == ways[0]).all():
            return int(ways[0])
        return self.difference(first, second, statistic).sign


@dataclass(frozen=True)
class Spread:
    """A metric of one design over the noise.

    Attributes:
        metric: its name.
        statistics: value and standard error by word of `SHOWN`.
        parts: part of the variance by noise factor [-], eq. (b); empty where runs are too few to tell.
    """

    metric: str
    statistics: dict[str, tuple[float, float]]
    parts: dict[str, float]

    @property
    def rest(self) -> float:
        """Part of the variance that no factor explains alone [-]: interactions, and scatter between equal runs."""
        return max(0.0, 1.0 - sum(self.parts.values()))

    def parts_words(self) -> str:
        """Where the spread comes from, in words."""
        if not self.parts:
            return "too few runs to tell" if self.statistics["std"][0] > 0.0 else "it does not spread"
        ordered = sorted(self.parts.items(), key=lambda part: -part[1])
        words = [f"{name} {100.0 * part:.0f} %" for name, part in ordered]
        return ", ".join([*words, f"together or by chance {100.0 * self.rest:.0f} %"])


def goals_over(goals: Goals, chosen: Sequence[str]) -> Goals:
    """Goals of runs as goals of designs: means of objectives, quantiles of metrics that each run is held to.

    Args:
        goals: of the study file.
        chosen: names of its design factors.
    """

    def plain(name: str) -> bool:
        return name in chosen or statistic_from_name(name) is not None

    objectives = tuple(
        o if plain(o.metric) else Objective(metric=f"mean({o.metric})", sense=o.sense) for o in goals.objectives
    )
    bounds: list[Bound] = []
    for bound in goals.bounds:
        if plain(bound.metric):
            bounds.append(bound)
            continue
        share = 100.0 * goals.keep
        for level, end in ((share, {"max": bound.max}), (100.0 - share, {"min": bound.min})):
            if None not in end.values():
                bounds.append(Bound(metric=f"q{round(level, 6):g}({bound.metric})", **end))
    return replace(goals, objectives=objectives, bounds=tuple(bounds))


def designs_of(results: Results, goals: Goals, noise: Sequence[str] | None = None) -> tuple[Results, Goals]:
    """Results as designs over their noise, with the goals as these have them; both as they are without noise.

    Args:
        results: all runs.
        goals: of the study file.
        noise: names of the noise factors; None takes those that the table marks.

    Raises:
        StudyError: a metric that the table lacks, designs of too few runs, or runs that are no sample of the noise.
    """
    import pyarrow as pa

    results.check_sampled()
    noise = results.noise_factors if noise is None else noise
    if not noise:
        return results, goals
    chosen = tuple(name for name in results.factors if name not in noise)
    rows = _groups(results, chosen)
    least = min(len(of) for of in rows)
    if least < LEAST:
        raise StudyError(f"noise: a design has {least} runs; to compare designs, each needs at least {LEAST}")
    over = goals_over(goals, chosen)
    worst = [_worst(results, of, goals) for of in rows]
    kept = [name for name in ("variant", *chosen, *ARCHIVE_COLUMNS, "round") if name in results.table.column_names]
    table = results.table.select(kept).take(worst)
    for name in ("status", "reason"):
        if name in results.table.column_names:
            table = table.append_column(name, results.table[name].take(worst))
    metrics = []
    for statistic in _statistics(over):
        values = _values(results, statistic.metric)
        found = np.array([_taken(values[of], statistic) for of in rows])
        name = f"{statistic.word}({statistic.metric})"
        facts = {"unit": results.column_unit(statistic.metric)}
        for suffix, role, column in (("", "metric", found[:, 0]), (ERROR, ROLE_OF_ERRORS, found[:, 1])):
            field = pa.field(name + suffix, pa.float64(), metadata={"role": role, **facts})
            table = table.append_column(field, pa.array(np.where(np.isfinite(column), column, np.nan)))
        metrics.append(name)
    each = tuple(bound for bound in goals.bounds if bound not in over.bounds)
    return Designs(table, chosen, tuple(metrics), results, rows, each), over


def spread(designs: Designs, design: int, metric: str) -> Spread:
    """A metric of a design over the noise, and what part of its variance comes of which noise factor.

    Args:
        designs: of `designs_of`.
        design: row of a design.
        metric: one that runs have.
    """
    runs, rows = designs.runs, designs.rows[design]
    found = {}
    for word in SHOWN:
        found[word] = _taken(_values(runs, metric)[rows], _statistic(word, metric))
    return Spread(metric, found, _parts(runs, rows[runs.usable_rows(metric)[rows]], metric))


def _groups(results: Results, chosen: Sequence[str]) -> tuple[NDArray[np.intp], ...]:
    """Rows of each design, in the order of their first ones."""
    found: dict[tuple[Any, ...], list[int]] = {}
    columns = [results.table[name].to_pylist() for name in chosen]
    for row in range(results.table.num_rows):
        key = tuple(column[row] for column in columns)
        found.setdefault(key, []).append(row)
    return tuple(np.array(rows, dtype=np.intp) for rows in found.values())


def _worst(results: Results, rows: NDArray[np.intp], goals: Goals) -> int:
    """The run that stands for a design: the one that ended worst; of those that are ok, the worst in the first goal."""
    grave = [SEVERITY.index(results.status[row]) if results.status[row] in SEVERITY else 1 for row in rows.tolist()]
    if max(grave) > 0:
        return int(rows[int(np.argmax(grave))])
    towards = [(o.metric, SENSES[o.sense]) for o in goals.objectives]
    towards += [(b.metric, 1.0 if b.max is not None else -1.0) for b in goals.bounds]
    for name, sign in towards:
        values = sign * results.values(metric_from_name(name))[rows]
        if np.isfinite(values).all() and np.ptp(values) > 0.0:
            return int(rows[int(np.argmax(values))])
    return int(rows[0])


def _statistic(word: str, metric: str) -> Statistic:
    found = statistic_from_name(f"{word}({metric})")
    assert found is not None  # a word of SHOWN
    return found


def _statistics(goals: Goals) -> list[Statistic]:
    """The statistics that goals name, and of each of their metrics what is shown, each once."""
    named = [found for name in goals.metrics if (found := statistic_from_name(name)) is not None]
    shown = [_statistic(word, of.metric) for of in named for word in SHOWN]
    return list(dict.fromkeys([*named, *shown]))


def _values(results: Results, metric: str) -> Array:
    """A metric of all runs (R,), NaN where they are not ok."""
    if metric not in results.table.column_names and not results.ok.any():
        return np.full(len(results.status), np.nan)  # nothing ran: no metric has a column yet
    return np.where(results.ok, results.values(metric), np.nan)


def _taken(values: Array, statistic: Statistic) -> tuple[float, float]:
    """A statistic of the runs that are ok, and its standard error; NaN where fewer than `LEAST` are."""
    values = values[np.isfinite(values)]
    if len(values) < LEAST:
        return float("nan"), float("nan")
    whole, without = _jackknife(values, statistic)
    return whole, float(np.sqrt(len(values) - 1) * without.std())


def _pseudo_values(values: Array, statistic: Statistic) -> Array:
    """Contributions (n,) of each of the values (n,) to a statistic, eq. (a)."""
    whole, without = _jackknife(values, statistic)
    return np.asarray(whole + (len(values) - 1) * (without.mean() - without))


def _jackknife(values: Array, statistic: Statistic) -> tuple[float, Array]:
    """A statistic of values (n,), and the same without each of them in turn (n,)."""
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
    ordered, weights = values[order], _quantile_weights(n - 1, statistic.level)
    below = np.append(0.0, np.cumsum(weights * ordered[:-1]))
    above = np.append(np.cumsum((weights * ordered[1:])[::-1])[::-1], 0.0)
    without = np.empty(n)
    without[order] = below + above
    return float(_quantile_weights(n, statistic.level) @ ordered), without


def _quantile_weights(count: int, level: float) -> Array:
    """Weights (n,) of sorted values in Harrell and Davis's quantile."""
    from scipy.special import betainc

    return np.diff(betainc((count + 1) * level, (count + 1) * (1.0 - level), np.arange(count + 1) / count))


def _parts(results: Results, rows: NDArray[np.intp], metric: str) -> dict[str, float]:
    """Part of a metric's variance over runs of one design by noise factor, eq. (b)."""
    terms = {name: of for name in results.free_noise_factors if (of := _terms(results, rows, name)).shape[1]}
    y = results.values(metric)[rows]
    y = y - y.mean() if len(y) else y
    count = sum(of.shape[1] for of in terms.values())
    total = float(y @ y)
    if not terms or len(y) < count + LEAST or total == 0.0:
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


def _terms(results: Results, rows: NDArray[np.intp], name: str) -> Array:
    """Terms (n, p) of a noise factor, each of mean 0: its value and its square, or one for each word but the first."""
    if not results.is_numeric(name):
        words = np.array(results.text_values(name))[rows]
        of = np.array([words == word for word in np.unique(words)[1:]], dtype=float).reshape(-1, len(rows))
    else:
        values = results.values(name)[rows]
        levels = np.unique(values)
        z = (values - values.mean()) / values.std() if len(levels) > 1 else values
        of = np.stack([z, z * z])[: min(2, len(levels) - 1)]
    return np.asarray((of - of.mean(axis=1, keepdims=True)).T)
