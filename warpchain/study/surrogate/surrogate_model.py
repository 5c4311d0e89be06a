"""Surrogates of metrics behind one interface: rows of factors in, mean and standard deviation out.

A quadratic surface, with terms t(x), residual variance s^2 and weights W (Montgomery 2017, 10.5), is normal with

    mean t' b,      variance s^2 t' (T' W T)^-1 t,                                                          (a)

and a run there has s^2 more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from warpchain.errors import StudyError
from warpchain.progress import raise_if_stopped
from warpchain.study.analysis.pure_error import row_standard_errors, row_weights
from warpchain.study.analysis.surface import TRUSTED_R2, Surface, fit_surface, polynomial_terms, scaled_values
from warpchain.study.results import Array, Results
from warpchain.study.surrogate.gaussian_process import GaussianProcess, fit_gaussian_process

if TYPE_CHECKING:
    import pyarrow as pa

SurrogateRows: TypeAlias = "pa.Table | Mapping[str, Sequence[Any]] | Iterable[Mapping[str, Any]]"
SURROGATE_KINDS = ("gaussian", "quadratic")


@dataclass(frozen=True)
class FactorAxis:
    """Factor as coordinates of a surrogate."""

    name: str
    low: float = 0.0  # becomes 0 of a numeric factor
    high: float = 1.0  # becomes 1
    words: tuple[str, ...] = ()  # of a factor; each has a coordinate, 1 if the factor is that word

    @property
    def coordinate_count(self) -> int:
        """Number of a factor's coordinates in a surrogate."""
        return len(self.words) or 1

    def coordinates_of_values(self, column: Sequence[Any]) -> Array:
        """Surrogate coordinates of a factor's values (R,)."""
        if self.words:
            names = [str(value) for value in column]
            for word in sorted(set(names) - set(self.words)):
                raise StudyError(f"factor {self.name!r}: {word!r} was not run; there are {', '.join(self.words)}")
            return np.array([[float(name == word) for word in self.words] for name in names]).reshape(
                -1, self.coordinate_count
            )
        try:
            values = np.asarray(column, dtype=float)
        except (TypeError, ValueError):
            raise StudyError(f"factor {self.name!r}: numbers are needed") from None
        return ((values - self.low) / (self.high - self.low))[:, None]


@dataclass(frozen=True)
class RowCoordinates:
    """Coordinates of a study's rows for a surrogate."""

    axes: tuple[FactorAxis, ...]

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors that are a surrogate's coordinates."""
        return tuple(axis.name for axis in self.axes)

    def of_rows(self, rows: SurrogateRows) -> Array:
        """Surrogate coordinates (R, D) of rows."""
        columns = columns_of_rows(rows, self.factors)
        return np.hstack([axis.coordinates_of_values(columns[axis.name]) for axis in self.axes])


def columns_of_rows(rows: SurrogateRows, names: Iterable[str]) -> dict[str, list[Any]]:
    """Columns by name of a surrogate's rows."""
    import pyarrow as pa

    if isinstance(rows, pa.Table):
        found = {name: rows[name].to_pylist() for name in names if name in rows.column_names}
    elif isinstance(rows, Mapping):
        found = {name: list(values) for name, values in rows.items()}
    else:
        listed = [dict(row) for row in rows]
        found = {name: [row[name] for row in listed] for name in names if all(name in row for row in listed)}
    for name in names:
        if name not in found:
            raise StudyError(f"rows: factor {name!r} is missing")
    return found


def coordinates_of_results(results: Results) -> RowCoordinates:
    """Surrogate coordinates of results' factors that vary."""
    tied = results.factor_ties()
    axes = []
    for name in (factor for factor in results.factors if factor not in tied):
        if results.is_numeric(name):
            values = results.values(name)
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            if high > low:
                axes.append(FactorAxis(name, low, high))
        elif len(words := sorted(set(results.text_values(name)))) > 1:
            axes.append(FactorAxis(name, words=tuple(words)))
    if not axes:
        raise StudyError("surrogate: no factor varies")
    return RowCoordinates(tuple(axes))


@dataclass(frozen=True)
class QuadraticFit:
    """Quadratic surface with what its predictions' variance takes."""

    surface: Surface
    x: Array  # (N, A) rows that were fitted
    y: Array  # (N,) values
    factor: Array  # (T, T) upper triangle of W^1/2 T = Q R
    run_variance: float  # s^2, in the metric's unit squared
    weights: Array  # (N,) of rows
    errors: Array | None  # (N,) standard errors

    def _surface_terms(self, x: Array) -> Array:
        """Terms (R, T) of the quadratic surface at rows."""
        low, high = self.surface.low, self.surface.high
        return polynomial_terms(scaled_values(x, low, high), self.surface.powers)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and deviation (R,) of the quadratic surface, (a)."""
        leverage = np.linalg.solve(self.factor.T, self._surface_terms(x).T)
        return self.surface.predict(x), np.sqrt(self.run_variance * np.einsum("ij,ij->j", leverage, leverage))

    def leave_one_out(self) -> tuple[Array, Array]:
        """Mean and deviation (N,) of rows by the others."""
        inner = np.linalg.solve(self.factor.T, self._surface_terms(self.x).T)
        left = np.maximum(1.0 - self.weights * np.einsum("ij,ij->j", inner, inner), 1e-9)
        residual = self.y - self.surface.predict(self.x)
        return self.y - residual / left, np.sqrt(self.run_variance / self.weights / left)


def fit_quadratic(results: Results, metric: str) -> QuadraticFit:
    """Quadratic surface fitted to a metric over its numeric factors."""
    surface = fit_surface(results, metric)
    rows = results.usable_rows(metric, surface.factors)
    x = np.stack([results.values(name)[rows] for name in surface.factors], axis=1)
    y = results.values(metric)[rows]
    errors = row_standard_errors(results, metric)
    terms = polynomial_terms(scaled_values(x, surface.low, surface.high), surface.powers)
    weight = surface.weights
    variance = float(weight @ (y - surface.predict(x)) ** 2) / max(len(y) - len(surface.powers), 1)
    factor = np.linalg.qr(np.sqrt(weight)[:, None] * terms)[1]
    return QuadraticFit(surface, x, y, factor, variance, weight, None if errors is None else errors[rows])


@dataclass(frozen=True)
class CrossValidation:
    """Cross-validation of a surrogate: rows predicted by others."""

    observed: Array  # (R,) the metric as it was run
    predicted: Array  # (R,) from the other rows
    deviation: Array  # (R,) of a run there
    errors: Array | None = None  # (R,) standard errors of rows

    @property
    def q2(self) -> float:
        """Share Q2 of the variance that a surrogate predicts [-]."""
        missed = self.observed - self.predicted
        weight = row_weights(self.errors, missed)
        total = float(weight @ (self.observed - np.average(self.observed, weights=weight)) ** 2)
        return 1.0 - float(weight @ missed**2) / total if total > 0.0 else 1.0

    @property
    def coverage(self) -> float:
        """Share of rows within 1.96 predicted deviations [-]."""
        return float(np.mean(np.abs(self.observed - self.predicted) <= 1.96 * self.deviation))


@dataclass(frozen=True)
class Surrogate:
    """Surrogate of a metric between the variants run."""

    metric: str
    kind: str  # of `SURROGATE_KINDS`
    model: GaussianProcess | QuadraticFit
    features: RowCoordinates | None  # coordinates of rows; None takes factors as they are
    logarithm: bool = False  # whether the fit is of the metric's logarithm

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors that a surrogate's rows must have."""
        return self.features.factors if self.features is not None else self.model.surface.factors  # type: ignore[union-attr]

    @property
    def row_count(self) -> int:
        """Number of variants that were fitted."""
        return len(self.model.x)

    @property
    def kind_text(self) -> str:
        """Kind of surrogate, in words."""
        return {"gaussian": "Gaussian process with noise", "quadratic": "quadratic surface"}[self.kind]

    def predict(self, rows: SurrogateRows, run: bool = False) -> tuple[Array, Array]:
        """Mean and deviation (R,) of a surrogate's metric at rows.

        Args:
            run: of a single further run, with its noise.

        Raises:
            StudyError: a factor is missing, or a word that was not run.
        """
        if self.features is not None:
            x = self.features.of_rows(rows)
        else:
            columns = columns_of_rows(rows, self.factors)
            x = np.stack([np.asarray(columns[name], dtype=float) for name in self.factors], axis=1)
        mean, deviation = self.model.predict(x)
        if run:
            deviation = np.sqrt(deviation**2 + self.model.run_variance)
        return _moments_of_exponential(mean, deviation) if self.logarithm else (mean, deviation)

    def cross_validated(self) -> CrossValidation:
        """Cross-validation of the surrogate over its rows."""
        mean, deviation = self.model.leave_one_out()
        if isinstance(self.model, GaussianProcess):
            observed = self.model.center + self.model.scale * self.model.z
        else:
            observed = self.model.y
        errors = self.model.errors
        if self.logarithm:
            observed = np.exp(observed)
            errors = None if errors is None else errors * observed
            return CrossValidation(observed, *_moments_of_exponential(mean, deviation), errors)
        return CrossValidation(observed, mean, deviation, errors)


def _moments_of_exponential(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Mean and deviation of exp of a normal variable."""
    center = np.exp(mean + 0.5 * deviation**2)
    return center, center * np.sqrt(np.expm1(deviation**2))


def fit_surrogate(
    results: Results,
    metric: str,
    kind: str = "gaussian",
    logarithm: bool = False,
) -> Surrogate:
    """Surrogate of a metric, fitted to ok variants.

    Args:
        results: a column `METRIC_se` has standard errors.
        kind: "gaussian", of words and numbers, or "quadratic", of numbers.
        logarithm: fit the metric's logarithm.

    Raises:
        StudyError: too few variants, an unknown column, values not above 0 with `logarithm`, no scikit-learn.
    """
    if kind not in SURROGATE_KINDS:
        raise StudyError(f"surrogate: kind {kind!r}: allowed are {', '.join(SURROGATE_KINDS)}")
    values, errors = results.values(metric), row_standard_errors(results, metric)
    rows = results.usable_rows(metric)
    if logarithm and not (values[rows] > 0.0).all():
        raise StudyError(f"surrogate of {metric!r}: a logarithm needs values above 0")
    if kind == "quadratic":
        from warpchain.study.analysis.effects import transform_metric

        taken = transform_metric(results, metric, "log") if logarithm else results
        return Surrogate(metric, kind, fit_quadratic(taken, metric), None, logarithm)
    features = coordinates_of_results(results)
    rows &= results.usable_rows(metric, features.factors)
    y = values[rows]
    known = None if errors is None else errors[rows]
    if logarithm:
        known = None if known is None else known / y
        y = np.log(y)
    return Surrogate(
        metric, kind, fit_gaussian_process(features.of_rows(results.table.filter(rows)), y, known), features, logarithm
    )


MOST_PROCESS_ROWS = 300
"""Variants beyond which a quadratic surface is preferred."""


def best_surrogate(results: Results, metric: str, least: float = -np.inf) -> Surrogate:
    """Surrogate by Gaussian process or quadratic surface, whichever serves.

    Args:
        least: Q2 that it must have.
    """
    many = results.usable_rows(metric).sum() > MOST_PROCESS_ROWS
    reason = f"surrogate of {metric!r}: none has a Q\u00b2 of {least:g}"
    for kind, needed in (*((("quadratic", TRUSTED_R2),) if many else ()), ("gaussian", least), ("quadratic", least)):
        raise_if_stopped()
        try:
            found = fit_surrogate(results, metric, kind)
        except StudyError as error:
            reason = str(error)
            continue
        if found.cross_validated().q2 >= needed:
            return found
    raise StudyError(reason)
