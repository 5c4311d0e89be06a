"""Main effects of factors on metrics, as means and medians, and correlations, over ok variants.

A factor with G groups that takes up the part E of a metric's variance among R rows has

    F = E / (1 - E) (R - G) / (G - 1),                                                                        (a)

of noncentrality R E' / (1 - E'), E' the part of infinitely many rows (Steiger 2004). Intervals of medians are binomial
(Conover 1999, 3.2).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.results.replicate_metrics import ERROR_SUFFIX
from warpchain.study.analysis.pure_error import CONFIDENCE, pure_error, student_quantile
from warpchain.study.results import Array, Results, is_varying

MOST_GROUPS = 8
FEWEST_GROUP_ROWS = 5
TRANSFORMS = ("rank", "log")


@dataclass(frozen=True)
class Effect:
    """Main effect of a factor: a metric's mean in groups.

    Attributes:
        labels: (G,) names of groups.
        centers: (G,) mean factor values; counts from 0 of words.
        means: (G,) of the metric.
        errors: (G,) standard errors; NaN for one variant.
        counts: (G,) variants.
        explained: part of the metric's variance between groups [-].
        scatter: (G,) standard errors from equal runs alone; None without replicates.
    """

    factor: str
    labels: tuple[str, ...]
    centers: Array
    means: Array
    errors: Array
    counts: NDArray[np.int64]
    explained: float
    scatter: Array | None = None

    @property
    def row_count(self) -> int:
        """Number of variants in a main effect's groups."""
        return int(self.counts.sum())

    @property
    def intervals(self) -> Array:
        """Half widths (G,) of group means' 95 % intervals."""
        t = np.array([student_quantile(count - 1) if count > 1 else np.nan for count in self.counts.tolist()])
        return np.asarray(t * self.errors)

    @property
    def chance(self) -> float:
        """Probability that chance explains as much as the factor."""
        from scipy.special import fdtrc

        between, within = len(self.counts) - 1, self.row_count - len(self.counts)
        if between < 1 or within < 1:
            return float("nan")
        return float(fdtrc(between, within, self._f_ratio()))

    @property
    def adjusted_share(self) -> float:
        """Share of the variance that the factor explains beyond chance (Ezekiel 1930)."""
        freedom = self.row_count - len(self.counts)
        return max(0.0, 1.0 - (1.0 - self.explained) * (self.row_count - 1) / freedom) if freedom > 0 else float("nan")

    @property
    def explained_interval(self) -> tuple[float, float]:
        """95 % interval of the factor's explained share."""
        between, within = len(self.counts) - 1, self.row_count - len(self.counts)
        if between < 1 or within < 1:
            return 0.0, 1.0
        ends = [
            _noncentrality_of_share(between, within, self._f_ratio(), 0.5 + s * 0.5 * CONFIDENCE) for s in (1.0, -1.0)
        ]
        low, high = (end / (end + self.row_count) if np.isfinite(end) else 1.0 for end in ends)
        return low, high

    def _f_ratio(self) -> float:
        """F ratio of a factor's effect, (a)."""
        between, within = len(self.counts) - 1, self.row_count - len(self.counts)
        left = 1.0 - self.explained
        return self.explained / left * within / between if left > 0.0 else float("inf")

    @property
    def mean_span(self) -> float:
        """Difference of the largest and smallest group mean."""
        return float(np.ptp(self.means))


def main_effects(results: Results, metric: str, factors: tuple[str, ...] | None = None) -> list[Effect]:
    """Main effects of factors on a metric, the largest first.

    Tied factors are left out unless asked for.

    Raises:
        StudyError: too few usable variants, an unknown column, or rows of a search.
    """
    results.check_sampled()
    rows = results.usable_rows(metric)
    if rows.sum() < 2:
        raise StudyError(f"metric {metric!r}: {int(rows.sum())} variants have a value, at least 2 are needed")
    y = results.values(metric)
    effects = []
    runs, deviation = None, 0.0
    if results.has_replicates:
        with suppress(StudyError):
            deviation = pure_error(results, metric).deviation
            runs = lambda group, held: np.bincount(group, results.run_counts[held])  # noqa: E731
    tied = results.factor_ties()
    for factor in [f for f in results.factors if f not in tied] if factors is None else factors:
        held = results.usable_rows(metric, [factor])
        group, labels, centers = factor_groups(results, factor, held)
        if len(labels) > 1:
            effect = _group_effect(factor, labels, centers, group, y[held])
            effects.append(effect if runs is None else replace(effect, scatter=deviation / np.sqrt(runs(group, held))))
    return sorted(effects, key=lambda effect: -effect.mean_span)


def factor_groups(
    results: Results, factor: str, rows: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], tuple[str, ...], Array]:
    """Groups (R,) of rows by a factor's value, labels and centers (G,)."""
    if not results.is_numeric(factor):
        words = [word for word, row in zip(results.text_values(factor), rows, strict=True) if row]
        labels, group = np.unique(words, return_inverse=True)
        return group, tuple(labels.tolist()), np.arange(len(labels), dtype=float)
    x = results.values(factor)[rows]
    values, group = np.unique(x, return_inverse=True)
    if len(values) <= MOST_GROUPS:
        return group, tuple(f"{value:.6g}" for value in values), values
    bins = max(2, min(MOST_GROUPS, len(x) // FEWEST_GROUP_ROWS))
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    group = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    held, group = np.unique(group, return_inverse=True)
    centers = np.array([x[group == g].mean() for g in range(len(held))])
    return group, tuple(f"{edges[g]:.4g} to {edges[g + 1]:.4g}" for g in held), centers


def _group_effect(factor: str, labels: tuple[str, ...], centers: Array, group: NDArray[np.intp], y: Array) -> Effect:
    """Main effect of a factor from grouped metric values (R,)."""
    counts = np.bincount(group)
    means = np.bincount(group, y) / counts
    inside = np.bincount(group, (y - means[group]) ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        errors = np.where(counts > 1, np.sqrt(inside / (counts - 1) / counts), np.nan)
    total = float(((y - y.mean()) ** 2).sum())
    explained = 1.0 - float(inside.sum()) / total if total > 0.0 else 0.0
    return Effect(factor, labels, centers, means, errors, counts, explained)


def _noncentrality_of_share(between: int, within: int, ratio: float, share: float) -> float:
    """Noncentrality with probability `share` of F below `ratio`."""
    from scipy.optimize import brentq
    from scipy.special import ncfdtr

    if not np.isfinite(ratio):
        return float("inf")

    def share_error(noncentrality: float) -> float:
        """Probability of F below `ratio`, less `share`."""
        return float(ncfdtr(between, within, noncentrality, ratio)) - share

    if share_error(0.0) <= 0.0:
        return 0.0
    top = 1.0
    while share_error(top) > 0.0:
        top *= 2.0
        if top > 1e9:
            return float("inf")
    return float(brentq(share_error, 0.0, top, xtol=1e-9, rtol=1e-10))


@dataclass(frozen=True)
class Correlation:
    """Correlation coefficients of A numeric factors with B metrics.

    Attributes:
        pearson: (A, B) linear.
        spearman: (A, B) of ranks.
        counts: (B,) variants.
    """

    factors: tuple[str, ...]
    metrics: tuple[str, ...]
    pearson: Array
    spearman: Array
    counts: NDArray[np.int64]

    def noise_level(self) -> float:
        """Correlation that chance exceeds in 5 % of cases."""
        least = int(self.counts.min()) if len(self.counts) else 0
        return float(min(1.0, 1.96 / np.sqrt(max(least - 1, 1))))


def correlation(results: Results, metrics: tuple[str, ...] | None = None) -> Correlation:
    """Pearson and Spearman correlations of numeric factors with metrics.

    Raises:
        StudyError: no numeric factor that varies, too few usable variants, or rows of a search.
    """
    from scipy.stats import rankdata

    results.check_sampled()
    factors = results.independent_factors()
    chosen = tuple(m for m in metrics or results.metrics if is_varying(results.values(m)[results.ok]))
    if not factors or not chosen:
        raise StudyError("correlation: needs a factor and a metric that hold numbers and vary")
    shape = (len(factors), len(chosen))
    pearson, spearman, counts = np.zeros(shape), np.zeros(shape), np.zeros(len(chosen), dtype=np.int64)
    inputs = [results.values(factor) for factor in factors]
    ranks: dict[bytes, list[Array]] = {}  # of the factors, by which rows a metric has
    for b, metric in enumerate(chosen):
        rows, y = results.usable_rows(metric, factors), results.values(metric)
        counts[b] = rows.sum()
        if counts[b] < 3:
            raise StudyError(f"metric {metric!r}: {counts[b]} variants have a value, at least 3 are needed")
        known = ranks.setdefault(rows.tobytes(), [])
        known += [] if known else [rankdata(x[rows]) for x in inputs]
        ranked = rankdata(y[rows])
        for a, x in enumerate(inputs):
            pearson[a, b] = _pearson_coefficient(x[rows], y[rows])
            spearman[a, b] = _pearson_coefficient(known[a], ranked)
    return Correlation(factors, chosen, pearson, spearman, counts)


def _pearson_coefficient(x: Array, y: Array) -> float:
    """Pearson correlation coefficient of x and y (R,)."""
    x, y = x - x.mean(), y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else float("nan")


def transform_metric(results: Results, metric: str, how: str) -> Results:
    """Results with a metric's rank or logarithm in its place.

    Args:
        how: "rank" (of the ok variants, 1 the lowest) or "log".

    Raises:
        StudyError: another word, or values without a logarithm.
    """
    import pyarrow as pa
    from scipy.stats import rankdata

    values, rows = results.values(metric), results.usable_rows(metric)
    found, errors = np.full(len(values), np.nan), np.full(len(values), np.nan)
    if how == "rank":
        found[rows] = rankdata(values[rows])
    elif how == "log":
        if not (values[rows] > 0.0).all():
            raise StudyError(f"metric {metric!r}: has values that are not above 0, of which there is no logarithm")
        found[rows] = np.log(values[rows])
        if metric + ERROR_SUFFIX in results.table.column_names:
            errors[rows] = results.values(metric + ERROR_SUFFIX)[rows] / values[rows]
    else:
        raise StudyError(f"transform {how!r}: allowed are {', '.join(TRANSFORMS)}")
    table = results.table
    for name, of in ((metric, found), (metric + ERROR_SUFFIX, errors)):
        if name in table.column_names:
            held = dict(table.schema.field(name).metadata or {}) | {b"unit": b"1"}
            column = pa.array(of, pa.float64(), mask=np.isnan(of))
            table = table.set_column(
                table.column_names.index(name), pa.field(name, pa.float64(), metadata=held), column
            )
    return replace(results, table=table)


@dataclass(frozen=True)
class MedianEffect:
    """Medians of a metric in groups of a factor.

    Attributes:
        labels: (G,) names of groups.
        centers: (G,) mean factor values; counts from 0 of words.
        low, high: (G,) 95 % intervals; infinite for fewer than 6 variants.
    """

    factor: str
    labels: tuple[str, ...]
    centers: Array
    medians: Array
    low: Array
    high: Array
    counts: NDArray[np.int64]

    @property
    def median_span(self) -> float:
        """Difference of the largest and smallest group median."""
        return float(np.ptp(self.medians))


def median_interval(values: Array) -> tuple[float, float]:
    """95 % interval of a median; infinite below 6 values."""
    from scipy.stats import binom

    n = len(values)
    k = int(binom.ppf(0.025, n, 0.5)) if n else 0
    if k < 1 or binom.cdf(k - 1, n, 0.5) > 0.025:
        return -np.inf, np.inf
    ordered = np.sort(values)
    return float(ordered[k - 1]), float(ordered[n - k])


def median_effects(results: Results, metric: str) -> list[MedianEffect]:
    """Median effects: medians of a metric in groups of each factor.

    Raises:
        StudyError: too few usable variants, an unknown column, or rows of a search.
    """
    results.check_sampled()
    y, tied = results.values(metric), results.factor_ties()
    if results.usable_rows(metric).sum() < 2:
        raise StudyError(f"metric {metric!r}: fewer than 2 variants have a value")
    effects = []
    for factor in (name for name in results.factors if name not in tied):
        rows = results.usable_rows(metric, [factor])
        group, labels, centers = factor_groups(results, factor, rows)
        if len(labels) < 2:
            continue
        parts = [y[rows][group == g] for g in range(len(labels))]
        ends = np.array([median_interval(part) for part in parts])
        medians = np.array([np.median(part) for part in parts])
        counts = np.array([len(part) for part in parts])
        effects.append(MedianEffect(factor, labels, centers, medians, ends[:, 0], ends[:, 1], counts))
    return sorted(effects, key=lambda effect: -effect.median_span)
