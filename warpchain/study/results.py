"""A study's results as a table: one row a variant, a column a factor and a metric, and how each variant ended."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.schema import nearest, some_of
from warpchain.errors import StudyError
from warpchain.results.arrow_tables import export_table as export_table
from warpchain.results.arrow_tables import without_unit_heads
from warpchain.results.metric_columns import RUN, SETTLING
from warpchain.results.replicate_metrics import COUNT, ERROR, ROLE_OF_ERRORS
from warpchain.results.statuses import common_reasons
from warpchain.study.store import OUTCOME, STATUSES, check_archive_name, read_table

if TYPE_CHECKING:
    import pyarrow as pa

ARCHIVED = ("archive", "archive_variant")
"""File of a recorded variant in the study's folder, and its number there."""
ADJUSTED = ("adjusted_links", "adjusted_travel")
"""Adjustments so that the chain fits: number of links, travel of the sprocket [m]."""
OF_CHAINS = tuple(f".{name}" for name in ADJUSTED)
"""Ends of these columns, where several chains are adjusted."""
RUN_COLUMNS = tuple(column.name for column in RUN.columns if column.name not in ("variant", *OUTCOME))
"""Length of a variant's run, and the window of its metrics."""
SETTLING_COLUMNS = tuple(column.name for column in SETTLING.columns)
"""Settling of the start, where there was one."""
BOOKKEEPING = ("variant", *OUTCOME, *ARCHIVED, *ADJUSTED, *RUN_COLUMNS, *SETTLING_COLUMNS)
"""All of them."""


Array = NDArray[np.float64]
NOISE, TIED = "noise", "tied noise"
"""A noise factor, and an expression that follows one, in its field's metadata under `kind`."""
DISTRIBUTION = "distribution"
"""Key of a factor's distribution in its field's metadata: the keys of the study file, as JSON."""
SEARCH_TARGET = "search_target"
"""Key of what rows look for where they are no sample of the noise, in its factors' field metadata: "failures"."""
ROUND = "round"
"""Column of the number of a row's round in a search."""
NAMED = 12
"""Most columns that an error lists."""
SHOWN = 6
"""Metrics that notebooks show."""


def search_target_of(table: pa.Table) -> str:
    """Target of a table's rows that are no sample of the noise, such as "failures"; "" where they are one."""
    noted = ((field.metadata or {}).get(SEARCH_TARGET.encode(), b"") for field in table.schema)
    return next((word.decode() for word in noted if word), "")


@dataclass(frozen=True)
class Results:
    """A study's table with its columns by kind.

    Attributes:
        table: one row a variant.
        factors: names of the columns that were varied.
        metrics: names of the numeric columns that were measured.
    """

    table: pa.Table
    factors: tuple[str, ...]
    metrics: tuple[str, ...]

    def _repr_html_(self) -> str:
        """A table for notebooks: how the rows ended, and factors and metrics of the first ones."""
        from warpchain.view.notebook import SHOWN_ROWS, notebook_table, status_html, value_with_unit

        words = self.status
        counts = ", ".join(f"{words.count(word)} {word}" for word in STATUSES if word in words)
        names = [*self.factors, *self.metrics[:SHOWN]]
        rows = [
            [
                str(self.variants[k]),
                status_html(words[k]),
                *(value_with_unit(row[name], self.unit(name)) for name in names),
            ]
            for k, row in enumerate(self.table.slice(0, SHOWN_ROWS).to_pylist())
        ]
        caption = f"{len(words)} rows: {counts}; {len(self.factors)} factors, {len(self.metrics)} metrics"
        return notebook_table(("variant", "status", *names), rows, caption)

    @property
    def variants(self) -> NDArray[np.int64]:
        """Number of each row's variant; the row's own number where the table has none."""
        if "variant" in self.table.column_names:
            return np.asarray(self.table["variant"].to_pylist(), dtype=np.int64)
        return np.arange(self.table.num_rows)

    @property
    def counts(self) -> NDArray[np.int64]:
        """(R,) how many runs each row's metrics are the mean of; 1 where the table has none."""
        if not self.replicated:
            return np.ones(self.table.num_rows, dtype=np.int64)
        return np.asarray(self.table[COUNT].to_numpy(), dtype=np.int64)

    @property
    def replicated(self) -> bool:
        """Whether rows are means of several runs."""
        names = self.table.column_names
        return COUNT in names and any(_is_error(self.table, name) for name in names)

    def errors(self, metric: str) -> Array:
        """(R,) standard error of a metric's means between equal runs, NaN where there is none."""
        name = metric + ERROR
        if not (self.replicated and name in self.table.column_names and _is_error(self.table, name)):
            return np.full(self.table.num_rows, np.nan)
        return self.values(name)

    @cached_property
    def status(self) -> list[str]:
        """Status of each variant; "ok" where the table has none."""
        if "status" not in self.table.column_names:
            return ["ok"] * self.table.num_rows
        return [str(word) for word in self.table["status"].to_pylist()]

    @cached_property
    def ok(self) -> NDArray[np.bool_]:
        """Whether each variant ran to its end and nothing of it is suspect (R,)."""
        return np.array([word == "ok" for word in self.status], dtype=bool)

    def reasons(self) -> list[tuple[str, str, int]]:
        """(status, reason, how many) of the variants that are not ok, the most frequent first.

        Reasons that differ in their numbers only count as one, named by its first.
        """
        rows = np.flatnonzero(~self.ok).tolist()
        return common_reasons((self.status[row], self.reason(row)) for row in rows)

    def reason(self, row: int) -> str:
        """Why a row is not ok, in words."""
        held = self.table["reason"][row].as_py() if "reason" in self.table.column_names else None
        return held or "no reason given"

    def numeric(self, name: str) -> bool:
        """Whether a column holds numbers.

        Raises:
            StudyError: no such column.
        """
        self._known(name)
        return _is_numeric(self.table, name)

    def _known(self, name: str) -> None:
        if name not in self.table.column_names:
            raise StudyError(f"column {name!r}: not in the table; {nearest(name, self.table.column_names, NAMED)}")

    def values(self, name: str) -> Array:
        """A numeric column (R,), NaN where it is empty.

        Raises:
            StudyError: no such column, or not a column of numbers.
        """
        if not self.numeric(name):
            raise StudyError(f"column {name!r}: holds {self.table.schema.field(name).type}, numbers are needed here")
        return np.array(self.table[name].cast("float64").to_numpy(), dtype=float)

    def labels(self, name: str) -> list[str]:
        """Any column as words."""
        self._known(name)
        return [str(value) for value in self.table[name].to_pylist()]

    def unit(self, name: str) -> str:
        """Unit of a column: its field's metadata, or else what the name of a metric says; "" for none."""
        from warpchain.results.metric_columns import unit_of

        noted = (self.table.schema.field(name).metadata or {}).get(b"unit")
        unit = noted.decode() if noted else unit_of(name) if name in self.metrics else ""
        return "" if unit == "1" else unit

    @property
    def noise(self) -> tuple[str, ...]:
        """The factors that nobody can choose, those that follow others by an expression among them."""
        return tuple(name for name in self.factors if self._kind(name) in (NOISE, TIED))

    @property
    def noise_sources(self) -> tuple[str, ...]:
        """The noise factors that follow no others."""
        return tuple(name for name in self.factors if self._kind(name) == NOISE)

    @property
    def search_target(self) -> str:
        """Target of the rows; see `search_target_of`."""
        return search_target_of(self.table)

    def check_sample(self) -> None:
        """Refuses rows that are no sample of the noise.

        Raises:
            StudyError: they look for something.
        """
        if self.search_target:
            raise StudyError(
                f"noise: these rows look for {self.search_target} and are no sample of the noise: their shares, means, "
                "quantiles and effects tell nothing about it"
            )

    def sample(self) -> Results:
        """The rows that are a sample of the factors: all of a study's; of a search those of its design, the first
        round, as the others crowd where it looked.

        Raises:
            StudyError: all look for something.
        """
        self.check_sample()
        if ROUND not in self.table.column_names:
            return self
        rounds = self.values(ROUND)
        return Results(self.table.take(np.flatnonzero(rounds == rounds.min())), self.factors, self.metrics)

    def _kind(self, factor: str) -> str:
        return (self.table.schema.field(factor).metadata or {}).get(b"kind", b"").decode()

    def distribution(self, factor: str) -> dict[str, Any] | None:
        """The keys of a study file that say how a factor is distributed; None where the table has none."""
        noted = (self.table.schema.field(factor).metadata or {}).get(DISTRIBUTION.encode())
        return None if noted is None else dict(json.loads(noted))

    def rows_for(self, metric: str, factors: Iterable[str] = ()) -> NDArray[np.bool_]:
        """Rows that are ok and have a finite value of a metric, and of numeric factors (R,)."""
        rows = self.ok & np.isfinite(self.values(metric))
        for factor in factors:
            if self.numeric(factor):
                rows &= np.isfinite(self.values(factor))
        return rows

    def numeric_factors(self) -> tuple[str, ...]:
        """The factors that hold numbers and take more than one value."""
        return tuple(f for f in self.factors if self.numeric(f) and varies(self.values(f)))

    def ties(self) -> dict[str, str]:
        """The numeric factors that go along with an earlier one in a straight line, and with which."""
        kept: dict[str, Array] = {}
        tied: dict[str, str] = {}
        for name in self.numeric_factors():
            x = _normal(self.values(name))
            with_one = next((other for other, y in kept.items() if abs(float(x @ y)) > 1.0 - 1e-9), None)
            if with_one is None:
                kept[name] = x
            else:
                tied[name] = with_one
        return tied

    def independent_factors(self) -> tuple[str, ...]:
        """The numeric factors without those tied to others."""
        tied = self.ties()
        return tuple(name for name in self.numeric_factors() if name not in tied)

    def varying_metrics(self) -> tuple[str, ...]:
        """The metrics that take more than one value among the variants that are ok."""
        return tuple(m for m in self.metrics if varies(self.values(m)[self.ok]))


def _normal(values: Array) -> Array:
    """Values less their mean, of length one, so that a product of two is their correlation; nothing where empty."""
    x = np.nan_to_num(values - np.nanmean(values))
    return x / np.sqrt(x @ x)


def varies(values: Array) -> bool:
    """Whether at least two finite values differ by more than round-off."""
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and bool(np.ptp(finite) > 1e-12 * np.abs(finite).max())


def _is_numeric(table: pa.Table, name: str) -> bool:
    import pyarrow.types as kinds

    kind = table.schema.field(name).type
    return bool(kinds.is_integer(kind) or kinds.is_floating(kind) or kinds.is_boolean(kind))


def _is_error(table: pa.Table, name: str) -> bool:
    """Whether a column is the error of a metric's mean between equal runs; in tables without roles, by its name."""
    role = (table.schema.field(name).metadata or {}).get(b"role")
    if role is not None:
        return bool(role == ROLE_OF_ERRORS.encode())
    return name.endswith(ERROR) and name.removesuffix(ERROR) in table.column_names and COUNT in table.column_names


def read_results(
    source: pa.Table | str | Path, factors: Iterable[str] | None = None, metrics: Iterable[str] | None = None
) -> Results:
    """A study's results from a table.

    Args:
        source: a pyarrow table, or the path of a Parquet or CSV file.
        factors: the columns that were varied; None takes those whose field says role = "factor".
        metrics: the columns that were measured; None takes every other numeric column, but for those of metrics that
            qualify others (`results.metric_columns.Column.aside`).

    Raises:
        StudyError: a table that cannot be read, a column that it lacks, or factors that are not marked.
    """
    import pyarrow as pa

    from warpchain.results.metric_columns import column_of

    table = source if isinstance(source, pa.Table) else read_table(Path(source))
    if not isinstance(source, pa.Table) and Path(source).suffix == ".csv":
        table = without_unit_heads(table)
    chosen = tuple(factors) if factors is not None else _with_role(table, b"factor")
    if not chosen:
        raise StudyError(
            f"factors: none given, and the table marks none; its columns are {some_of(table.column_names, NAMED)}"
        )
    noted = _with_role(table, b"metric")
    if metrics is not None:
        measured = tuple(metrics)
    else:
        names = noted or table.column_names
        held = {name for name in names if name == COUNT or _is_error(table, name)}
        held = held if len(held) > 1 else set()
        aside = {*chosen, *held, *(n for n in names if n in BOOKKEEPING or n.endswith(OF_CHAINS))}
        named = (n for n in names if n not in aside and _is_numeric(table, n))
        measured = tuple(name for name in named if not ((of := column_of(name)) and of.aside))
    for kind, names in (("factors", chosen), ("metrics", measured)):
        for name in names:
            if name not in table.column_names:
                raise StudyError(f"{kind}: {name!r} is not in the table; {nearest(name, table.column_names, NAMED)}")
    results = Results(table, chosen, measured)
    for word in sorted(set(results.status) - set(STATUSES)):
        raise StudyError(f"column 'status': {word!r} is unknown; allowed are {', '.join(STATUSES)}")
    if ARCHIVED[0] in table.column_names:
        for name in set(table[ARCHIVED[0]].to_pylist()) - {None}:
            check_archive_name(name)
    return results


def _with_role(table: pa.Table, role: bytes) -> tuple[str, ...]:
    return tuple(field.name for field in table.schema if (field.metadata or {}).get(b"role") == role)
