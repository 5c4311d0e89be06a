"""What factors do to metrics: main effects and correlations, over the variants that ran to their end.

A factor with G groups that takes up the part E of a metric's variance among R rows has

    F = E / (1 - E) (R - G) / (G - 1).                                                                        (a)

Where rows come at random as far as this factor goes, F is noncentral F-distributed with the noncentrality
R E' / (1 - E'), E' the part that it would take up of infinitely many rows; the interval of E' is where F lies between
the 2.5 % and 97.5 % points (Steiger 2004).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.analysis.pure_error import CONFIDENCE, pure_error, student
from warpchain.study.results import Array, Results, varies

BINS = 8
"""Most groups that a factor of many values is cut into; they hold equally many variants each."""
ROWS_A_BIN = 5
"""Fewest variants of a group, where groups are cut."""


@dataclass(frozen=True)
class Effect:
    """The main effect of one factor on one metric: the metric's mean in each group of the factor's values.

    Attributes:
        factor: name of the factor.
        labels: what each group is called (G,).
        centers: mean factor value of each group (G,); counts from 0 where the factor holds words.
        means: mean of the metric in each group (G,).
        errors: standard error of each mean (G,); NaN where a group has one variant.
        counts: number of variants in each group (G,).
        explained: part of the metric's variance that lies between the groups [-] (the correlation ratio).
        scatter: standard error of each mean from what equal runs scatter alone (G,); None without replicates. `errors`
            holds what the other factors do, too.
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
    def rows(self) -> int:
        """Number of variants in all groups."""
        return int(self.counts.sum())

    @property
    def intervals(self) -> Array:
        """Half width of each mean's 95 % interval (G,), by Student's t; NaN where a group has one variant."""
        t = np.array([student(count - 1) if count > 1 else np.nan for count in self.counts.tolist()])
        return np.asarray(t * self.errors)

    @property
    def chance(self) -> float:
        """How probable it is that so large a part is explained by chance alone; NaN where nothing is left to tell."""
        from scipy.special import fdtrc

        between, within = len(self.counts) - 1, self.rows - len(self.counts)
        if between < 1 or within < 1:
            return float("nan")
        return float(fdtrc(between, within, self._ratio()))

    @property
    def explained_interval(self) -> tuple[float, float]:
        """95 % interval of the part that the factor would explain of infinitely many variants; (0, 1) where nothing is
        left to tell."""
        between, within = len(self.counts) - 1, self.rows - len(self.counts)
        if between < 1 or within < 1:
            return 0.0, 1.0
        ends = [_noncentrality(between, within, self._ratio(), 0.5 + s * 0.5 * CONFIDENCE) for s in (1.0, -1.0)]
        low, high = (end / (end + self.rows) if np.isfinite(end) else 1.0 for end in ends)
        return low, high

    def _ratio(self) -> float:
        between, within = len(self.counts) - 1, self.rows - len(self.counts)
        left = 1.0 - self.explained
        return self.explained / left * within / between if left > 0.0 else float("inf")

    @property
    def span(self) -> float:
        """Largest less smallest mean, in the metric's unit."""
        return float(np.ptp(self.means))


def main_effects(results: Results, metric: str, factors: tuple[str, ...] | None = None) -> list[Effect]:
    """Main effects of the factors on a metric, the largest span first.

    Factors that are tied to another are left out, unless asked for. Numeric factors of up to `BINS` values are grouped
    by value, others by quantiles; words are grouped as they are.

    Raises:
        StudyError: fewer than two usable variants, or an unknown column.
    """
    rows = results.rows_for(metric)
    if rows.sum() < 2:
        raise StudyError(f"metric {metric!r}: {int(rows.sum())} variants have a value, at least 2 are needed")
    y = results.values(metric)
    effects = []
    runs, deviation = None, 0.0
    if results.replicated:
        with suppress(StudyError):
            deviation = pure_error(results, metric).deviation
            runs = lambda group, held: np.bincount(group, results.counts[held])  # noqa: E731
    tied = results.ties()
    for factor in [f for f in results.factors if f not in tied] if factors is None else factors:
        held = results.rows_for(metric, [factor])
        group, labels, centers = _groups(results, factor, held)
        if len(labels) > 1:
            effect = _effect(factor, labels, centers, group, y[held])
            effects.append(effect if runs is None else replace(effect, scatter=deviation / np.sqrt(runs(group, held))))
    return sorted(effects, key=lambda effect: -effect.span)


def _groups(results: Results, factor: str, rows: NDArray[np.bool_]) -> tuple[NDArray[np.intp], tuple[str, ...], Array]:
    """Group of each chosen row, with the groups' labels and centers."""
    if not results.numeric(factor):
        words = [word for word, row in zip(results.labels(factor), rows, strict=True) if row]
        labels, group = np.unique(words, return_inverse=True)
        return group, tuple(labels.tolist()), np.arange(len(labels), dtype=float)
    x = results.values(factor)[rows]
    values, group = np.unique(x, return_inverse=True)
    if len(values) <= BINS:
        return group, tuple(f"{value:.6g}" for value in values), values
    bins = max(2, min(BINS, len(x) // ROWS_A_BIN))
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    group = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    held, group = np.unique(group, return_inverse=True)
    centers = np.array([x[group == g].mean() for g in range(len(held))])
    return group, tuple(f"{edges[g]:.4g} to {edges[g + 1]:.4g}" for g in held), centers


def _effect(factor: str, labels: tuple[str, ...], centers: Array, group: NDArray[np.intp], y: Array) -> Effect:
    counts = np.bincount(group)
    means = np.bincount(group, y) / counts
    inside = np.bincount(group, (y - means[group]) ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        errors = np.where(counts > 1, np.sqrt(inside / (counts - 1) / counts), np.nan)
    total = float(((y - y.mean()) ** 2).sum())
    explained = 1.0 - float(inside.sum()) / total if total > 0.0 else 0.0
    return Effect(factor, labels, centers, means, errors, counts, explained)


def _noncentrality(between: int, within: int, ratio: float, share: float) -> float:
    """The noncentrality at which a share of noncentral F lies below `ratio`; 0 where even the central one has less."""
    from scipy.optimize import brentq
    from scipy.special import ncfdtr

    if not np.isfinite(ratio):
        return float("inf")

    def miss(noncentrality: float) -> float:
        return float(ncfdtr(between, within, noncentrality, ratio)) - share

    if miss(0.0) <= 0.0:
        return 0.0
    top = 1.0
    while miss(top) > 0.0:
        top *= 2.0
        if top > 1e9:
            return float("inf")
    return float(brentq(miss, 0.0, top, xtol=1e-9, rtol=1e-10))


@dataclass(frozen=True)
class Correlation:
    """Correlation of numeric factors (rows) with metrics (columns).

    Attributes:
        factors: (A,) names.
        metrics: (B,) names.
        pearson: (A, B) linear correlation coefficients.
        spearman: (A, B) rank correlation coefficients.
        counts: (B,) variants that each metric's coefficients stand on.
    """

    factors: tuple[str, ...]
    metrics: tuple[str, ...]
    pearson: Array
    spearman: Array
    counts: NDArray[np.int64]

    def noise(self) -> float:
        """Size of coefficient that chance alone exceeds in 5 % of cases: 1.96 / sqrt(n - 1)."""
        least = int(self.counts.min()) if len(self.counts) else 0
        return float(min(1.0, 1.96 / np.sqrt(max(least - 1, 1))))


def correlation(results: Results, metrics: tuple[str, ...] | None = None) -> Correlation:
    """Pearson and Spearman correlation of every independent numeric factor with every metric that varies.

    Raises:
        StudyError: no numeric factor that varies, or fewer than three usable variants.
    """
    from scipy.stats import rankdata

    factors = results.independent_factors()
    chosen = tuple(m for m in metrics or results.metrics if varies(results.values(m)[results.ok]))
    if not factors or not chosen:
        raise StudyError("correlation: needs a factor and a metric that hold numbers and vary")
    shape = (len(factors), len(chosen))
    pearson, spearman, counts = np.zeros(shape), np.zeros(shape), np.zeros(len(chosen), dtype=np.int64)
    inputs = [results.values(factor) for factor in factors]
    ranks: dict[bytes, list[Array]] = {}  # of the factors, by which rows a metric has
    for b, metric in enumerate(chosen):
        rows, y = results.rows_for(metric, factors), results.values(metric)
        counts[b] = rows.sum()
        if counts[b] < 3:
            raise StudyError(f"metric {metric!r}: {counts[b]} variants have a value, at least 3 are needed")
        known = ranks.setdefault(rows.tobytes(), [])
        known += [] if known else [rankdata(x[rows]) for x in inputs]
        ranked = rankdata(y[rows])
        for a, x in enumerate(inputs):
            pearson[a, b] = _pearson(x[rows], y[rows])
            spearman[a, b] = _pearson(known[a], ranked)
    return Correlation(factors, chosen, pearson, spearman, counts)


def _pearson(x: Array, y: Array) -> float:
    """Linear correlation coefficient; NaN where one of both is constant."""
    x, y = x - x.mean(), y - y.mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else float("nan")
