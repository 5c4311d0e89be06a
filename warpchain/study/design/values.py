"""Values of factors: from a place in the unit interval, from coded units, from a grid, or from other factors.

A dimension of a design is a factor, or a group of factors that vary together. Coded units are -1 at the low end and +1
at the high end, in the logarithm for a log-uniform factor; a normal factor has mean - std and mean + std there, a
lognormal one likewise in the logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import StudyError
from warpchain.study.spec import Study
from warpchain.study.spec.expression import parse
from warpchain.study.spec.factor import Factor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dimension:
    """What a design varies independently.

    Attributes:
        name: of the factor, or of the group.
        factors: those that vary along it.
    """

    name: str
    factors: tuple[Factor, ...]

    @property
    def size(self) -> int | None:
        """Number of grid points; None for a distribution without points."""
        first = self.factors[0]
        return len(first.values) if first.values is not None else first.points


def dimensions(study: Study) -> tuple[Dimension, ...]:
    """The dimensions of a study, in the order of its factors."""
    groups: dict[str, list[Factor]] = {}
    for factor in study.factors:
        if factor.kind != "expression":
            groups.setdefault(f"group {factor.group}" if factor.group else factor.name, []).append(factor)
    return tuple(Dimension(name, tuple(factors)) for name, factors in groups.items())


def from_unit(factor: Factor, u: Array) -> list[Any]:
    """Values at cumulated probabilities u (R,) in [0, 1)."""
    if factor.values is not None:
        return [factor.values[i] for i in np.minimum((u * len(factor.values)).astype(int), len(factor.values) - 1)]
    if factor.kind in ("normal", "truncated-normal"):
        from scipy.stats import norm, truncnorm

        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        inner = np.clip(u, 1e-12, 1.0 - 1e-12)  # the ends of the interval have no normal value
        if factor.range is None:
            return _whole(factor, norm.ppf(inner, factor.mean, factor.std))
        low, high = ((end - factor.mean) / factor.std for end in factor.range)
        return _whole(factor, truncnorm.ppf(inner, low, high, factor.mean, factor.std))
    if factor.kind == "lognormal":
        from scipy.stats import norm

        center, width = log_moments(factor)
        return _whole(factor, np.exp(norm.ppf(np.clip(u, 1e-12, 1.0 - 1e-12), center, width)))
    assert factor.range is not None  # the factor's own rule
    if factor.integer and factor.kind == "uniform":
        first, last = math.ceil(factor.range[0]), math.floor(factor.range[1])
        return [int(first + step) for step in np.floor(u * (last - first + 1))]
    return from_coded(factor, 2.0 * u - 1.0)


def from_coded(factor: Factor, x: Array) -> list[Any]:
    """Values at coded units x (R,); of two levels or choices, the first below 0 and the second from there."""
    if factor.values is not None:
        return [factor.values[int(place >= 0.0)] for place in x]
    if factor.kind == "normal":
        assert factor.mean is not None and factor.std is not None  # the factor's own rule
        return _whole(factor, factor.mean + factor.std * x)
    if factor.kind == "lognormal":
        center, width = log_moments(factor)
        return _whole(factor, np.exp(center + width * x))
    assert factor.range is not None  # the factor's own rule
    low, high = factor.range
    share = 0.5 * (1.0 + x)
    if factor.kind == "log-uniform":
        return _whole(factor, low ** (1.0 - share) * high**share)
    return _whole(factor, low * (1.0 - share) + high * share)


def on_grid(factor: Factor, i: NDArray[np.int64], size: int) -> list[Any]:
    """Values at grid points i (R,) of `size`."""
    if factor.values is not None:
        return [factor.values[k] for k in i]
    return from_coded(factor, 2.0 * i / (size - 1) - 1.0)


def log_moments(factor: Factor) -> tuple[float, float]:
    """Mean and standard deviation of the logarithm of a lognormal factor."""
    assert factor.mean is not None and factor.std is not None  # the factor's own rule
    square = math.log1p((factor.std / factor.mean) ** 2)
    return math.log(factor.mean) - 0.5 * square, math.sqrt(square)


def _whole(factor: Factor, values: Array) -> list[Any]:
    return [round(value) for value in values.tolist()] if factor.integer else values.tolist()


def tied(study: Study) -> tuple[Factor, ...]:
    """The factors with an expression, each behind those that it needs."""
    waiting = {factor.name: factor for factor in study.factors if factor.kind == "expression"}
    ordered: list[Factor] = []
    while waiting:
        for name, factor in list(waiting.items()):
            assert factor.expression is not None  # its kind
            if not any(other in waiting for other in parse(factor.expression).names):
                ordered.append(waiting.pop(name))
    return tuple(ordered)


def complete(study: Study, order: Sequence[Factor], row: dict[str, Any]) -> str | None:
    """Adds the tied factors to a row, and holds it against the constraints.

    Returns:
        Why the row is infeasible, or None.
    """
    reason = None
    for factor in order:
        try:
            row[factor.name] = _tied_value(factor, row)
        except StudyError as error:
            row[factor.name] = None
            reason = reason or f"{factor.name} = {factor.expression}: {error}"
    for constraint in study.constraints:
        try:
            met = reason is not None or bool(evaluate(constraint.require, row))
        except StudyError as error:
            return f"constraint {constraint.require}: {error}"
        if not met:
            return f"constraint {constraint.require} is not met"
    return reason


def evaluate(text: str, row: Mapping[str, Any]) -> Any:
    """An expression's value in a row.

    Raises:
        StudyError: it has none.
    """
    return parse(text).value(row)


def _tied_value(factor: Factor, row: Mapping[str, Any]) -> Any:
    assert factor.expression is not None  # its kind
    missing = [name for name in parse(factor.expression).names if row.get(name) is None]
    if missing:
        raise StudyError(f"{missing[0]} has no value")
    value = evaluate(factor.expression, row)
    if isinstance(value, (int, float)) and not math.isfinite(value):
        raise StudyError(f"{value} is not finite")
    return round(value) if factor.integer and isinstance(value, float) else value
