"""Rows of factors as points of a box: numbers from 0 to 1 over what was run, words as one coordinate each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from warpchain.errors import StudyError
from warpchain.study.results import Array, Results

if TYPE_CHECKING:
    import pyarrow as pa

Rows: TypeAlias = "pa.Table | Mapping[str, Sequence[Any]] | Iterable[Mapping[str, Any]]"
"""A table, a column by name, or a mapping a row."""


@dataclass(frozen=True)
class Axis:
    """How one factor becomes coordinates.

    Attributes:
        name: of the factor.
        low, high: the ends that become 0 and 1; of numbers.
        words: what it can be, where it holds words: each has a coordinate, 1 where the factor is that word.
        logarithm: whether numbers are taken in the logarithm.
    """

    name: str
    low: float = 0.0
    high: float = 1.0
    words: tuple[str, ...] = ()
    logarithm: bool = False

    @property
    def width(self) -> int:
        """Number of coordinates."""
        return len(self.words) or 1

    def coordinates(self, column: Sequence[Any]) -> Array:
        """Values (R,) as coordinates (R, width).

        Raises:
            StudyError: a word that was not run, or a word where numbers are needed.
        """
        if self.words:
            names = [str(value) for value in column]
            for word in sorted(set(names) - set(self.words)):
                raise StudyError(f"factor {self.name!r}: {word!r} was not run; there are {', '.join(self.words)}")
            return np.array([[float(name == word) for word in self.words] for name in names]).reshape(-1, self.width)
        try:
            values = np.asarray(column, dtype=float)
        except (TypeError, ValueError):
            raise StudyError(f"factor {self.name!r}: numbers are needed") from None
        if self.logarithm:
            with np.errstate(invalid="ignore", divide="ignore"):
                values = np.log(values / self.low) / np.log(self.high / self.low)
            return values[:, None]
        return ((values - self.low) / (self.high - self.low))[:, None]


@dataclass(frozen=True)
class Features:
    """The coordinates of a study's rows.

    Attributes:
        axes: one a factor.
    """

    axes: tuple[Axis, ...]

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors."""
        return tuple(axis.name for axis in self.axes)

    def of(self, rows: Rows) -> Array:
        """Coordinates (R, D) of rows: a table, a column by name, or a mapping a row.

        Raises:
            StudyError: a factor is missing or has a value that cannot be taken.
        """
        columns = columns_of(rows, self.factors)
        return np.hstack([axis.coordinates(columns[axis.name]) for axis in self.axes])


def columns_of(rows: Rows, names: Iterable[str]) -> dict[str, list[Any]]:
    """Columns by name of rows in any of their shapes.

    Raises:
        StudyError: one is missing.
    """
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


def features_of(results: Results, factors: Sequence[str] | None = None, logarithms: Iterable[str] = ()) -> Features:
    """The coordinates of a study's results: of all factors that vary, tied ones once.

    Args:
        results: the study's results.
        factors: which; None takes all.
        logarithms: factors that are taken in the logarithm.

    Raises:
        StudyError: none varies.
    """
    tied = results.ties()
    axes = []
    for name in factors or [factor for factor in results.factors if factor not in tied]:
        if results.numeric(name):
            values = results.values(name)
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            if high > low:
                axes.append(Axis(name, low, high, logarithm=name in logarithms and low > 0.0))
        elif len(words := sorted(set(results.labels(name)))) > 1:
            axes.append(Axis(name, words=tuple(words)))
    if not axes:
        raise StudyError("surrogate: no factor varies")
    return Features(tuple(axes))
