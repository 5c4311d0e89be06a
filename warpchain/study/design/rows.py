"""Rows of a study from outside: from a table, from mappings, from points of the unit cube, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.design import values as values_of
from warpchain.study.design.matrix import _table
from warpchain.study.design.values import Array, Dimension, dimensions, tied
from warpchain.study.spec import Study
from warpchain.study.spec.factor import Factor

if TYPE_CHECKING:
    import pyarrow as pa

HALVINGS = 60
"""Bisections that a place in the unit interval is found by."""


def table_of_rows(study: Study, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows as `make_design` gives them: tied factors filled in, those that miss a constraint infeasible.

    Args:
        rows: values by factor; what else they hold is left aside.

    Raises:
        StudyError: a factor without expression is missing, or its values make no column.
    """
    order = tied(study)
    given = [factor.name for factor in study.factors if factor.kind != "expression"]
    columns: dict[str, list[Any]] = {factor.name: [] for factor in study.factors}
    reasons = []
    for i, values in enumerate(rows):
        for name in given:
            if values.get(name) is None:
                raise StudyError(f"rows: row {i}: factor {name!r} has no value")
        row = {name: values[name] for name in given}
        reasons.append(values_of.complete(study, order, row))
        for name, column in columns.items():
            column.append(row[name])
    return _table(study, columns, reasons)


class Cube:
    """The unit cube of a study's dimensions: one coordinate a factor without expression, or a group of them.

    Raises:
        StudyError: the values of a factor are in a table, or all factors are expressions.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        self.axes: tuple[Dimension, ...] = dimensions(study)
        for factor in study.factors:
            if factor.kind is None:
                raise StudyError(f"factors.{factor.name}: has neither range nor values to choose from")
        if not self.axes:
            raise StudyError("factors: all are expressions; at least one must vary by itself")

    def rows(self, points: Array) -> list[dict[str, Any]]:
        """Values by factor of points (R, D) in [0, 1)."""
        inner = np.clip(points, 0.0, 1.0 - 1e-12)
        columns = {
            f.name: values_of.from_unit(f, inner[:, k]) for k, axis in enumerate(self.axes) for f in axis.factors
        }
        return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]

    def points(self, rows: Sequence[Mapping[str, Any]]) -> Array:
        """Points (R, D) that rows stand for; of a whole number or a choice, the middle of its part."""
        return np.stack(
            [_places(axis.factors[0], [row[axis.factors[0].name] for row in rows]) for axis in self.axes], 1
        )

    def snapped(self, points: Array) -> Array:
        """Points (R, D) as the study's values make them: of whole numbers and choices, the middle of their part."""
        found = np.clip(points, 0.0, 1.0 - 1e-12)
        for k, axis in enumerate(self.axes):
            factor = axis.factors[0]
            if factor.values is not None or factor.integer:
                found[:, k] = _places(factor, values_of.from_unit(factor, found[:, k]))
        return found

    def coordinates(self, points: Array) -> Array:
        """Points (R, D) for a model of distances: each choice without an order has coordinates of its own."""
        parts = []
        for k, axis in enumerate(self.axes):
            choice = axis.factors[0].choice
            if choice is None:
                parts.append(points[:, [k]])
            else:
                index = np.minimum((points[:, k] * len(choice)).astype(int), len(choice) - 1)
                parts.append(np.eye(len(choice))[index])
        return np.hstack(parts)

    def feasible(self, points: Array) -> np.ndarray:
        """Which points (R,) meet the study's constraints."""
        if not self.study.constraints and not tied(self.study):
            return np.ones(len(points), dtype=bool)
        order = tied(self.study)
        return np.array([values_of.complete(self.study, order, row) is None for row in self.rows(points)], dtype=bool)


def _places(factor: Factor, values: Sequence[Any]) -> Array:
    """Places in the unit interval that a factor's values stand for (R,)."""
    if factor.values is not None:
        count = len(factor.values)
        return np.array([(factor.values.index(value) + 0.5) / count for value in values])
    wanted = np.asarray(values, dtype=float)
    ends = []
    for at_least in (True, False):  # where values begin to be as large, and larger
        low, high = np.zeros(len(wanted)), np.ones(len(wanted))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            there = np.asarray(values_of.from_unit(factor, np.minimum(middle, 1.0 - 1e-12)), dtype=float)
            above = there >= wanted if at_least else there > wanted
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        ends.append(high)
    return np.clip(0.5 * (ends[0] + ends[1]), 0.0, 1.0 - 1e-12)
