"""Response surface, quadratic, of a metric over the factors, by least squares.

With x the factors scaled to -1 .. 1 over the range that was run,

    y(x) = b + sum_i b_i x_i + sum_i b_ii x_i^2 + sum_{i<j} b_ij x_i x_j.                                    (a)

With m rows, T terms, weights W, residuals e and s_r^2 = sum w_i e_i^2 / (m - T), coefficients have the covariance
s_r^2 (X' W X)^-1. If equal runs scatter with the variance s^2, the surface's form is tested by

    F = [sum n_i e_i^2 / (m - T)] / s^2.                                                                     (b)
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.analysis.pure_error import pure_error, row_standard_errors, row_weights, student_quantile
from warpchain.study.results import Array, Results

WEIGHTING_ROUNDS = 4
TRUSTED_R2 = 0.8


@dataclass(frozen=True)
class Surface:
    """Response surface of a metric, fitted to A factors.

    Attributes:
        low, high: (A,) smallest and largest value of factors.
        powers: (T, A) exponent of each scaled factor in each term.
        coefficients: (T,) b of (a), in the metric's unit.
        r2: explained part of the variance [-].
        r2_predicted: part predicted of variants left out one by one [-]; can be negative.
        weights: (N,) of variants.
        covariance: (T, T) of the coefficients.
        freedom: degrees of freedom; 0 for as many terms as variants.
    """

    metric: str
    factors: tuple[str, ...]
    low: Array
    high: Array
    powers: NDArray[np.int64]
    coefficients: Array
    r2: float
    r2_predicted: float
    rows: int
    weights: Array
    covariance: Array | None = None
    freedom: int = 0

    @property
    def coefficient_errors(self) -> Array:
        """Standard errors (T,) of the response surface's coefficients."""
        if self.covariance is None or not self.freedom:
            return np.full(len(self.coefficients), np.nan)
        return np.sqrt(np.diag(self.covariance))

    @property
    def coefficient_intervals(self) -> Array:
        """Half widths (T,) of coefficients' 95 % intervals."""
        return np.asarray(student_quantile(max(self.freedom, 1)) * self.coefficient_errors)

    def factor_effects(self) -> list[tuple[str, float, float]]:
        """Factors, their effects over their ranges, and half widths."""
        halves = self.coefficient_intervals
        found = []
        for a, factor in enumerate(self.factors):
            term = int(np.flatnonzero((self.powers[:, a] == 1) & (self.powers.sum(axis=1) == 1))[0])
            found.append((factor, 2.0 * float(self.coefficients[term]), 2.0 * float(halves[term])))
        return sorted(found, key=lambda effect: -abs(effect[1]))

    @property
    def is_trusted(self) -> bool:
        """Whether the response surface predicts well enough."""
        return self.r2_predicted >= TRUSTED_R2

    def predict(self, values: Array) -> Array:
        """Response surface at factor values (..., A)."""
        x = scaled_values(np.asarray(values, dtype=float), self.low, self.high)
        flat = polynomial_terms(x.reshape(-1, len(self.factors)), self.powers) @ self.coefficients
        return flat.reshape(x.shape[:-1])

    def factor_slice(self, factor: str, points: int = 41) -> tuple[Array, Array]:
        """Values (P,) of one factor, and the response surface there."""
        a = self.factors.index(factor)
        values = np.tile(0.5 * (self.low + self.high), (points, 1))
        values[:, a] = np.linspace(self.low[a], self.high[a], points)
        return values[:, a], self.predict(values)


def scaled_values(values: Array, low: Array, high: Array) -> Array:
    """Factor values scaled to -1 .. 1 for a response surface."""
    return (2.0 * values - low - high) / (high - low)


def polynomial_terms(x: Array, powers: NDArray[np.int64]) -> Array:
    """Terms (R, T) of a response surface at scaled values."""
    terms = np.ones((len(x), len(powers)))
    for t, row in enumerate(powers):
        for a in np.flatnonzero(row):
            terms[:, t] *= x[:, a] ** row[a]
    return terms


def _polynomial_powers(levels: list[int], order: int) -> NDArray[np.int64]:
    """Exponents (T, A) of a response surface's terms."""
    unit = np.eye(len(levels), dtype=np.int64)
    rows = [np.zeros(len(levels), dtype=np.int64), *unit]
    if order == 2:
        rows += [2 * unit[a] for a, count in enumerate(levels) if count > 2]
        rows += [unit[a] + unit[b] for a, b in combinations(range(len(levels)), 2)]
    return np.array(rows)


def fit_surface(results: Results, metric: str, factors: tuple[str, ...] | None = None) -> Surface:
    """Response surface fitted to a metric, quadratic or a plane.

    Args:
        factors: None takes all numeric ones that vary independently.

    Raises:
        StudyError: no numeric factor, too few variants, or factors that the design does not separate.
    """
    chosen = tuple(factors or results.independent_factors())
    rows = results.usable_rows(metric, chosen)
    if not chosen:
        raise StudyError(f"response surface of {metric!r}: no factor holds numbers that vary")
    values = np.stack([results.values(factor)[rows] for factor in chosen], axis=1)
    y = results.values(metric)[rows]
    if len(y) < len(chosen) + 2:
        raise StudyError(
            f"response surface of {metric!r}: {len(y)} variants, {len(chosen)} factors need {len(chosen) + 2}"
        )
    low, high = values.min(axis=0), values.max(axis=0)
    for factor, a, b in zip(chosen, low, high, strict=True):
        if not b > a:
            raise StudyError(f"response surface of {metric!r}: factor {factor!r} has one value, {a:g}")
    levels = [len(np.unique(column)) for column in values.T]
    x = scaled_values(values, low, high)
    for order in (2, 1):
        powers = _polynomial_powers(levels, order)
        terms = polynomial_terms(x, powers)
        if len(powers) < len(y) and np.linalg.matrix_rank(terms) == len(powers):
            break
    else:
        raise StudyError(f"response surface of {metric!r}: the design does not tell {', '.join(chosen)} apart")
    errors = row_standard_errors(results, metric)
    known = None if errors is None else errors[rows]
    weight = row_weights(known, np.zeros(len(y)))
    for last in range(1 if known is None else WEIGHTING_ROUNDS):
        q, r = np.linalg.qr(np.sqrt(weight)[:, None] * terms)
        coefficients = np.linalg.solve(r, q.T @ (np.sqrt(weight) * y))
        residual = y - terms @ coefficients
        leverage = np.clip((q * q).sum(axis=1), 0.0, 1.0)
        if last < WEIGHTING_ROUNDS - 1:
            weight = row_weights(known, residual, 1.0 - leverage)
    total = float(weight @ (y - np.average(y, weights=weight)) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        press = np.where(leverage < 1.0 - 1e-9, residual / (1.0 - leverage), np.inf)
    freedom = len(y) - len(powers)
    inverse = np.linalg.inv(r)
    variance = float(weight @ residual**2) / freedom
    return Surface(
        metric,
        chosen,
        low,
        high,
        powers,
        coefficients,
        1.0 - float(weight @ residual**2) / total if total > 0.0 else 1.0,
        1.0 - float(weight @ press**2) / total if total > 0.0 else 1.0,
        len(y),
        weight,
        variance * inverse @ inverse.T,
        freedom,
    )


@dataclass(frozen=True)
class LackOfFit:
    """Lack of fit of a response surface beyond scatter.

    Attributes:
        ratio: F of (b).
        chance: probability of so large a ratio.
        freedom: degrees of freedom of residuals and scatter.
    """

    ratio: float
    chance: float
    freedom: tuple[int, int]


def lack_of_fit(results: Results, surface: Surface) -> LackOfFit:
    """Lack of fit of a response surface beyond scatter, (b).

    Raises:
        StudyError: no replicates, or as many terms as rows.
    """
    from scipy.special import fdtrc

    rows = results.usable_rows(surface.metric, surface.factors)
    pure = pure_error(results, surface.metric, rows)
    if not surface.freedom:
        raise StudyError(f"response surface of {surface.metric!r}: has as many terms as variants: nothing is left over")
    values = np.stack([results.values(factor)[rows] for factor in surface.factors], axis=1)
    missed = results.values(surface.metric)[rows] - surface.predict(values)
    square, freedom = float(results.run_counts[rows] @ missed**2), surface.freedom
    if not results.has_replicates:  # rows are single runs, and what they miss holds their scatter
        square, freedom = square - pure.freedom * pure.deviation**2, freedom - pure.freedom
    if freedom < 1:
        raise StudyError(f"response surface of {surface.metric!r}: has as many terms as unlike variants")
    ratio = square / freedom / pure.deviation**2
    return LackOfFit(ratio, float(fdtrc(freedom, pure.freedom, ratio)), (freedom, pure.freedom))
