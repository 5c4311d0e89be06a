"""Pure error: scatter of a metric between equal runs, its share of the variance, and the precision of means.

Row i of R is the mean of n_i runs with the standard error e_i; N = sum n_i. One run of a row scatters with

    s^2 = sum (n_i - 1) n_i e_i^2 / nu,    nu = N - R degrees of freedom.                                       (a)

Scatter is the part s^2 / (s^2 + b^2) of runs' variance, b^2 that between rows (Searle 1971, chapter 9):

    b^2 = (B - s^2) / n_0,   B = sum n_i (y_i - y)^2 / (R - 1),   n_0 = (N - sum n_i^2 / N) / (R - 1).          (b)

With d_i = n_i - 1, variances s_i^2 = n_i e_i^2 are moderated (Smyth 2004):

    s~_i^2 = (d_0 s_0^2 + d_i s_i^2) / (d_0 + d_i).                                                             (c)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import number_text
from warpchain.errors import StudyError
from warpchain.results.replicate_metrics import ERROR_SUFFIX
from warpchain.study.results import Array, Results

CONFIDENCE = 0.95


@dataclass(frozen=True)
class PureError:
    """Pure error of a metric: its scatter between equal runs."""

    metric: str
    rows: int  # R
    runs: int  # N
    deviation: float  # s of one run, in the metric's unit (a)
    freedom: int  # degrees of freedom nu
    share: float  # part of the metric's variance that is scatter [-] (b)
    share_low: float  # of its 95 % interval
    share_high: float

    @property
    def low(self) -> float:
        """Lower end of the pure error's 95 % interval."""
        return self.deviation * math.sqrt(self.freedom / _chi_square_quantile(0.5 + 0.5 * CONFIDENCE, self.freedom))

    @property
    def high(self) -> float:
        """Upper end of the pure error's 95 % interval."""
        return self.deviation * math.sqrt(self.freedom / _chi_square_quantile(0.5 - 0.5 * CONFIDENCE, self.freedom))

    def interval(self, count: int = 1) -> float:
        """Half width of a 95 % interval of `count` runs' mean."""
        return student_quantile(self.freedom) * self.deviation / math.sqrt(count)

    def replicates_for(self, precision: float) -> int:
        """Number of runs for a mean to +- `precision`.

        Raises:
            StudyError: a precision that is not positive.
        """
        _check_precision(precision)
        return max(1, math.ceil((self.interval() / precision) ** 2 * (1.0 - 1e-12)))

    def window_for(self, precision: float, window: float, count: int = 1) -> float:
        """Window [s] for a mean to +- `precision`.

        Args:
            window: of the runs [s].

        Raises:
            StudyError: a precision that is not positive.
        """
        _check_precision(precision)
        return window * (self.interval(count) / precision) ** 2

    def __str__(self) -> str:
        return (
            f"{self.metric}: {100.0 * self.share:.0f} % of its variance is scatter between equal runs "
            f"({100.0 * self.share_low:.0f} to {100.0 * self.share_high:.0f} %)"
        )


def _check_precision(precision: float) -> None:
    """Raises StudyError for a precision that is not positive."""
    if not (math.isfinite(precision) and precision > 0.0):
        raise StudyError(f"precision = {number_text(precision)}: must be a positive number")


def student_quantile(freedom: float) -> float:
    """Student's t of a 95 % interval, by freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE))


def _chi_square_quantile(share: float, freedom: int) -> float:
    """Chi-square below which a share of its distribution lies."""
    from scipy.special import chdtri

    return float(chdtri(freedom, 1.0 - share))


def pure_error(results: Results, metric: str, rows: NDArray[np.bool_] | None = None) -> PureError:
    """Pure error of a metric, its scatter between equal runs.

    Args:
        results: with replicates, or several rows of equal factors.
        rows: (R,) rows to use; None takes those that are ok.

    Raises:
        StudyError: no row has several runs, all are the same, or rows of a search.
    """
    from scipy.special import fdtri

    results.check_sampled()
    chosen = results.usable_rows(metric) if rows is None else rows
    means, counts, freedom, variance = _row_means(results, metric, chosen)
    if not freedom:
        raise StudyError(f"metric {metric!r}: no row was run several times; give design.replicates to the study")
    if not variance > 0.0:
        raise StudyError(f"metric {metric!r}: equal runs give equal values; there is no scatter")
    total, rows_held = int(counts.sum()), len(means)
    share, low, high = 1.0, 0.0, 1.0
    if rows_held > 1:
        weight = (total - float((counts**2).sum()) / total) / (rows_held - 1)
        center = float(counts @ means) / total
        ratio = float(counts @ (means - center) ** 2) / (rows_held - 1) / variance
        ends = [fdtri(rows_held - 1, freedom, 0.5 + sign * 0.5 * CONFIDENCE) for sign in (1.0, -1.0)]
        share, high, low = (_share_of_ratio(f, weight) for f in (ratio, *(ratio / end for end in ends)))
    return PureError(metric, rows_held, total, math.sqrt(variance), freedom, share, low, high)


def _share_of_ratio(ratio: float, weight: float) -> float:
    """Share of scatter in runs' variance from B / s^2, (b)."""
    return 1.0 / (1.0 + max(ratio - 1.0, 0.0) / weight)


def _row_means(results: Results, metric: str, chosen: NDArray[np.bool_]) -> tuple[Array, Array, int, float]:
    """Row means, numbers of runs, degrees of freedom, run variance, (a)."""
    values = results.values(metric)[chosen]
    if results.has_replicates:
        counts, errors = results.run_counts[chosen].astype(float), results.standard_errors(metric)[chosen]
        replicated = np.isfinite(errors) & (counts > 1)
        counts = np.where(replicated, counts, 1.0)
        freedom = float((counts - 1.0).sum())
        square = float(((counts - 1.0) * counts * np.where(replicated, errors, 0.0) ** 2).sum())
        return values, counts, round(freedom), square / freedom if freedom else 0.0
    labels = list(zip(*(results.text_values(factor) for factor in results.factors), strict=True))
    known: dict[tuple[str, ...], int] = {}
    group = np.array([known.setdefault(label, len(known)) for label, row in zip(labels, chosen, strict=True) if row])
    counts = np.bincount(group).astype(float)
    means = np.bincount(group, values) / counts
    freedom = len(values) - len(counts)
    square = float(((values - means[group]) ** 2).sum())
    return means, counts, freedom, square / freedom if freedom else 0.0


def pure_errors(results: Results) -> list[PureError]:
    """Pure errors of metrics that scatter, the noisiest first."""
    found = []
    for metric in results.metrics:
        try:
            found.append(pure_error(results, metric))
        except StudyError:
            continue
    return sorted(found, key=lambda error: -error.share)


def row_standard_errors(results: Results, metric: str) -> Array | None:
    """Standard errors (R,) of a metric's rows, (c), or None."""
    name = metric + ERROR_SUFFIX
    if not (name in results.table.column_names and results.is_numeric(name)):
        return None
    if not results.has_replicates:
        return results.values(name)
    rows = results.usable_rows(metric)
    found = results.standard_errors(metric)
    found[rows] = _moderated_errors(found[rows], results.run_counts[rows].astype(float))
    return found


def _moderated_errors(errors: Array, counts: Array) -> Array:
    """Standard errors (R,) of means of `counts` runs, (c)."""
    from scipy.optimize import brentq
    from scipy.special import digamma, polygamma

    replicated = np.isfinite(errors) & (counts > 1)
    if not replicated.any():
        return errors
    counts = np.where(replicated, counts, 1.0)
    freedom = counts - 1.0
    squares = np.where(replicated, counts * np.where(replicated, errors, 0.0) ** 2, 0.0)
    prior, prior_freedom = float(freedom @ squares / freedom.sum()), math.inf
    d = freedom[replicated]
    if prior > 0.0 and len(d) > 1:
        logs = np.log(np.maximum(squares[replicated], 1e-6 * prior)) - digamma(0.5 * d) + np.log(0.5 * d)
        excess = float(logs.var(ddof=1) - polygamma(1, 0.5 * d).mean())
        if excess > polygamma(1, 1e6):
            half = brentq(lambda half: float(polygamma(1, half)) - excess, 1e-3, 1e6) if excess < 1e6 else 1e-3
            prior, prior_freedom = math.exp(float(logs.mean()) + digamma(half) - math.log(half)), 2.0 * half
    if math.isinf(prior_freedom):
        return np.sqrt(prior / counts)
    return np.asarray(np.sqrt((prior_freedom * prior + freedom * squares) / (prior_freedom + freedom) / counts))


def row_weights(errors: Array | None, missed: Array, left: Array | float = 1.0) -> Array:
    """Weights (R,) of rows in a fit by pure errors, 1 / (t^2 + e^2).

    Args:
        errors: (R,) standard errors e; None or a NaN weighs all rows alike.
        missed: (R,) residuals of the fit, of variance t^2.
        left: part of a row's variance in its residual.
    """
    from scipy.optimize import brentq

    if errors is None or not np.isfinite(errors).all() or np.ptp(errors) == 0.0:
        return np.ones(len(missed))
    left = np.broadcast_to(left, len(missed))
    squares = np.maximum(errors**2, 1e-12 * float((errors**2).max()))

    def likelihood_slope(beyond: float) -> float:
        """Slope of the fit's likelihood at a variance t^2."""
        variance = beyond + squares
        return float((missed**2 / variance**2 - left / variance).sum())

    most = 2.0 * float(missed @ missed) / max(float(left.sum()), 1e-9)
    beyond = (
        float(brentq(likelihood_slope, 0.0, most))
        if most > 0.0 and likelihood_slope(0.0) > 0.0 > likelihood_slope(most)
        else 0.0
    )
    inverse = 1.0 / (beyond + squares)
    return np.asarray(inverse / inverse.mean())


def has_equal_rows(results: Results) -> bool:
    """Whether rows are means of runs, or repeat equal factors."""
    if results.has_replicates:
        return True
    group = np.zeros(len(results.status), dtype=np.intp)
    for name in results.factors:
        column = results.values(name) if results.is_numeric(name) else np.array(results.text_values(name))
        values, place = np.unique(column, return_inverse=True)
        held, group = np.unique(group * len(values) + place, return_inverse=True)
        if len(held) == len(group):
            return False
    return True


def scatter_share(results: Results, metric: str) -> float | None:
    """Part of rows' variance that is scatter, or None."""
    if not has_equal_rows(results):
        return None
    try:
        error = pure_error(results, metric)
    except StudyError:
        return None
    rows = results.usable_rows(metric)
    spread = float(results.values(metric)[rows].var(ddof=1))
    chance = error.deviation**2 * float(np.mean(1.0 / results.run_counts[rows]))
    return min(1.0, chance / spread) if spread > 0.0 else 0.0
