"""Values of factors from the unit interval and back, from coded units, a grid or expressions; quadrature nodes.

Coded units are -1 and +1 at the ends of a range, logarithmic for log-uniform factors, at mean +- std of a normal, at 16
and 84 % quantiles of an empirical one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.spec.expression import parse_expression

if TYPE_CHECKING:
    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor

Array = NDArray[np.float64]
QUADRATURE_NODES = 80
MOST_WHOLE_NODES = 100_000
FARTHEST_DEVIATIONS = 12.0
BISECTIONS = 60


@dataclass(frozen=True)
class DesignDimension:
    """Dimension of a design: factor, or group of factors."""

    name: str
    factors: tuple[Factor, ...]

    @property
    def grid_size(self) -> int | None:
        """Number of a design dimension's grid points, or None."""
        first = self.factors[0]
        return len(first.listed_values) if first.listed_values is not None else first.points


def design_dimensions(study: Study) -> tuple[DesignDimension, ...]:
    """Dimensions of a study's design: factors and groups."""
    groups: dict[str, list[Factor]] = {}
    for factor in study.factors:
        if factor.value_source != "expression":
            groups.setdefault(f"group {factor.group}" if factor.group else factor.name, []).append(factor)
    return tuple(DesignDimension(name, tuple(factors)) for name, factors in groups.items())


def values_from_probabilities(factor: Factor, u: Array) -> list[Any]:
    """Factor values at cumulated probabilities u (R,)."""
    if factor.listed_values is not None:
        return [
            factor.listed_values[i]
            for i in np.minimum((u * len(factor.listed_values)).astype(int), len(factor.listed_values) - 1)
        ]
    if factor.value_source == "empirical":
        ordered = np.sort(_empirical_sample(factor))
        return _rounded_values(factor, ordered[np.minimum((u * len(ordered)).astype(int), len(ordered) - 1)])
    if factor.value_source in ("normal", "truncated-normal"):
        from scipy.stats import norm, truncnorm

        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        inner = np.clip(u, 1e-12, 1.0 - 1e-12)  # the ends of the interval have no normal value
        if factor.range is None:
            return _rounded_values(factor, norm.ppf(inner, factor.mean, factor.std))
        low, high = ((end - factor.mean) / factor.std for end in factor.range)
        return _rounded_values(factor, truncnorm.ppf(inner, low, high, factor.mean, factor.std))
    if factor.value_source == "lognormal":
        from scipy.stats import norm

        center, width = lognormal_moments(factor)
        return _rounded_values(factor, np.exp(norm.ppf(np.clip(u, 1e-12, 1.0 - 1e-12), center, width)))
    assert factor.range is not None  # the factor's own rule
    if factor.integer and factor.value_source == "uniform":
        first, last = math.ceil(factor.range[0]), math.floor(factor.range[1])
        return [int(first + step) for step in np.floor(u * (last - first + 1))]
    return values_from_coded(factor, 2.0 * u - 1.0)


def values_from_coded(factor: Factor, x: Array) -> list[Any]:
    """Factor values at coded units x (R,)."""
    if factor.listed_values is not None:
        return [factor.listed_values[int(place >= 0.0)] for place in x]
    if factor.value_source == "empirical":
        from scipy.stats import norm

        return values_from_probabilities(factor, np.asarray(norm.cdf(x)))
    if factor.value_source == "normal":
        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        return _rounded_values(factor, factor.mean + factor.std * x)
    if factor.value_source == "lognormal":
        center, width = lognormal_moments(factor)
        return _rounded_values(factor, np.exp(center + width * x))
    assert factor.range is not None  # the factor's own rule
    low, high = factor.range
    share = 0.5 * (1.0 + x)
    if factor.value_source == "log-uniform":
        return _rounded_values(factor, low ** (1.0 - share) * high**share)
    return _rounded_values(factor, low * (1.0 - share) + high * share)


def _empirical_sample(factor: Factor) -> Array:
    """Sample (N,) of an empirical factor; raises if not read."""
    if factor.sample is None:
        raise StudyError(f"factors.{factor.name}.file: not read; load the study from its file")
    return np.array(factor.sample, dtype=float)


def values_from_grid(factor: Factor, i: NDArray[np.int64], size: int) -> list[Any]:
    """Factor values at grid points (R,) of `size`."""
    if factor.listed_values is not None:
        return [factor.listed_values[k] for k in i]
    values = values_from_coded(factor, 2.0 * i / (size - 1) - 1.0)
    return values if factor.integer else [float(f"{value:.15g}") for value in values]


def lognormal_moments(factor: Factor) -> tuple[float, float]:
    """Mean and deviation of a lognormal factor's logarithm."""
    assert factor.mean is not None and factor.std is not None  # the factor's own rule
    square = math.log1p((factor.std / factor.mean) ** 2)
    return math.log(factor.mean) - 0.5 * square, math.sqrt(square)


def _rounded_values(factor: Factor, values: Array) -> list[Any]:
    """Factor values as a list, whole ones rounded."""
    return [round(value) for value in values.tolist()] if factor.integer else values.tolist()


def tied_factors(study: Study) -> tuple[Factor, ...]:
    """Factors of expressions, each after those that it needs."""
    waiting = {factor.name: factor for factor in study.factors if factor.value_source == "expression"}
    ordered: list[Factor] = []
    while waiting:
        for name, factor in list(waiting.items()):
            assert factor.expression is not None  # its kind
            if not any(other in waiting for other in parse_expression(factor.expression).names):
                ordered.append(waiting.pop(name))
    return tuple(ordered)


def fill_tied_values(study: Study, order: Sequence[Factor], row: dict[str, Any]) -> str | None:
    """Fills a row's tied factors; returns a complaint or None."""
    reason = None
    for factor in order:
        try:
            row[factor.name] = _tied_value(factor, row)
        except StudyError as error:
            row[factor.name] = None
            reason = reason or f"{factor.name} = {factor.expression}: {error}"
    for constraint in study.constraints:
        try:
            met = reason is not None or bool(evaluate_expression(constraint.require, row))
        except StudyError as error:
            return f"constraint {constraint.require}: {error}"
        if not met:
            return f"constraint {constraint.require} is not met"
    return reason


def evaluate_expression(text: str, row: Mapping[str, Any]) -> Any:
    """Value of an expression in a design row."""
    return parse_expression(text).evaluate(row)


def _tied_value(factor: Factor, row: Mapping[str, Any]) -> Any:
    """Value of a tied factor in a design row."""
    assert factor.expression is not None  # its kind
    missing = [name for name in parse_expression(factor.expression).names if row.get(name) is None]
    if missing:
        raise StudyError(f"{missing[0]} has no value")
    value = evaluate_expression(factor.expression, row)
    if isinstance(value, (int, float)) and not math.isfinite(value):
        raise StudyError(f"{value} is not finite")
    return round(value) if factor.integer and isinstance(value, float) else value


def quadrature_nodes(factor: Factor) -> tuple[Array, Array] | None:
    """Quadrature nodes and weights (Q,) of a factor, or None."""
    if factor.listed_values is not None:
        if any(isinstance(value, (str, bool)) for value in factor.listed_values):
            return None
        return np.array(factor.listed_values, dtype=float), np.full(
            len(factor.listed_values), 1.0 / len(factor.listed_values)
        )
    if factor.value_source == "empirical":
        sample = _empirical_sample(factor)
        return sample, np.full(len(sample), 1.0 / len(sample))
    if factor.value_source in ("normal", "lognormal"):
        z, weight = np.polynomial.hermite_e.hermegauss(QUADRATURE_NODES)
        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        weight = weight / weight.sum()
        if factor.value_source == "normal":
            return factor.mean + factor.std * z, weight
        center, width = lognormal_moments(factor)
        return np.exp(center + width * z), weight
    if factor.range is None:
        return None
    low, high = factor.range
    if factor.value_source == "uniform" and factor.integer and math.floor(high) - math.ceil(low) < MOST_WHOLE_NODES:
        whole = np.arange(math.ceil(low), math.floor(high) + 1, dtype=float)
        return whole, np.full(len(whole), 1.0 / len(whole))
    if factor.value_source == "truncated-normal":
        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        near = [factor.mean - FARTHEST_DEVIATIONS * factor.std, factor.mean + FARTHEST_DEVIATIONS * factor.std]
        inner = max(low, near[0]), min(high, near[1])
        if inner[0] < inner[1]:
            low, high = inner
    x, weight = np.polynomial.legendre.leggauss(QUADRATURE_NODES)
    share = 0.5 * (1.0 + x)
    if factor.value_source == "log-uniform":
        return low ** (1.0 - share) * high**share, 0.5 * weight
    value = low * (1.0 - share) + high * share
    if factor.value_source == "truncated-normal":
        assert factor.mean is not None and factor.std is not None
        z = (value - factor.mean) / factor.std
        weight = weight * np.exp(-0.5 * (z * z - (z * z).min()))
    return value, weight / weight.sum()


class DesignCube:
    """Unit cube of a study's design dimensions."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.axes: tuple[DesignDimension, ...] = design_dimensions(study)
        for factor in study.factors:
            if factor.value_source is None:
                raise StudyError(f"factors.{factor.name}: has neither range nor values to choose from")
        if not self.axes:
            raise StudyError("factors: all are expressions; at least one must vary by itself")

    def rows_of_points(self, points: Array) -> list[dict[str, Any]]:
        """Design rows at unit-cube points (R, D)."""
        inner = np.clip(points, 0.0, 1.0 - 1e-12)
        columns = {
            f.name: values_from_probabilities(f, inner[:, k]) for k, axis in enumerate(self.axes) for f in axis.factors
        }
        return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]

    def points_of_rows(self, rows: Sequence[Mapping[str, Any]]) -> Array:
        """Unit-cube points (R, D) of design rows."""
        return np.stack(
            [
                _probabilities_of_values(axis.factors[0], [row[axis.factors[0].name] for row in rows])
                for axis in self.axes
            ],
            1,
        )

    def snapped_points(self, points: Array) -> Array:
        """Unit-cube points (R, D) moved to allowed values."""
        found = np.clip(points, 0.0, 1.0 - 1e-12)
        for k, axis in enumerate(self.axes):
            factor = axis.factors[0]
            if factor.listed_values is not None or factor.integer:
                found[:, k] = _probabilities_of_values(factor, values_from_probabilities(factor, found[:, k]))
        return found

    def model_coordinates(self, points: Array) -> Array:
        """Surrogate coordinates (R, C) of unit-cube points (R, D)."""
        parts = []
        for k, axis in enumerate(self.axes):
            choice = axis.factors[0].choice
            if choice is None:
                parts.append(points[:, [k]])
            else:
                index = np.minimum((points[:, k] * len(choice)).astype(int), len(choice) - 1)
                parts.append(np.eye(len(choice))[index])
        return np.hstack(parts)

    def is_feasible(self, points: Array) -> np.ndarray:
        """(R,) whether unit-cube points satisfy constraints."""
        if not self.study.constraints and not tied_factors(self.study):
            return np.ones(len(points), dtype=bool)
        order = tied_factors(self.study)
        return np.array(
            [fill_tied_values(self.study, order, row) is None for row in self.rows_of_points(points)], dtype=bool
        )


def _probabilities_of_values(factor: Factor, values: Sequence[Any]) -> Array:
    """Cumulated probabilities (R,) of factor values."""
    if factor.listed_values is not None:
        count = len(factor.listed_values)
        return np.array([(factor.listed_values.index(value) + 0.5) / count for value in values])
    wanted = np.asarray(values, dtype=float)
    ends = []
    for at_least in (True, False):  # where values begin to be as large, and larger
        low, high = np.zeros(len(wanted)), np.ones(len(wanted))
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            there = np.asarray(values_from_probabilities(factor, np.minimum(middle, 1.0 - 1e-12)), dtype=float)
            above = there >= wanted if at_least else there > wanted
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        ends.append(high)
    return np.clip(0.5 * (ends[0] + ends[1]), 0.0, 1.0 - 1e-12)
