"""Results of a study as a table: a row a variant, columns of factors, metrics, and how it ended."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.plugins import missing_plugins
from warpchain.drive.schema import names_text, nearest_key_text
from warpchain.errors import StudyError, warn_caller
from warpchain.results.arrow_tables import export_table as export_table
from warpchain.results.arrow_tables import table_without_unit_heads
from warpchain.results.metric_columns import RUN_METRICS, SETTLING_METRICS
from warpchain.results.own_metrics import PLUGINS_KEY
from warpchain.results.replicate_metrics import COUNT_COLUMN, ERROR_SUFFIX, ROLE_OF_ERRORS
from warpchain.results.statuses import common_reasons
from warpchain.study.store import OUTCOME_COLUMNS, ROW_STATUSES, check_archive_name, read_table

if TYPE_CHECKING:
    import pyarrow as pa

ARCHIVE_COLUMNS = ("archive", "archive_variant")
ADJUSTMENT_COLUMNS = {"adjusted_links": "", "adjusted_travel": "m"}
CHAIN_ADJUSTMENT_ENDINGS = tuple(f".{name}" for name in ADJUSTMENT_COLUMNS)
TODAY_COLUMN = "today"
"""Column of today's design: true if added to the design."""
RUN_COLUMNS = tuple(column.name for column in RUN_METRICS.columns if column.name not in ("variant", *OUTCOME_COLUMNS))
SETTLING_COLUMNS = tuple(column.name for column in SETTLING_METRICS.columns)
BOOKKEEPING_COLUMNS = (
    "variant",
    TODAY_COLUMN,
    *OUTCOME_COLUMNS,
    *ARCHIVE_COLUMNS,
    *ADJUSTMENT_COLUMNS,
    *RUN_COLUMNS,
    *SETTLING_COLUMNS,
)


Array = NDArray[np.float64]
NOISE, TIED_NOISE = "noise", "tied noise"
DISTRIBUTION_KEY = "distribution"
EXPRESSION_KEY = "expression_of"
SEARCH_TARGET_KEY = "search_target"
ROUND_COLUMN = "round"
MOST_LISTED = 12
MOST_METRICS = 6


def search_target_of(table: pa.Table) -> str:
    """Target of the search that chose a table's rows, or ""."""
    noted = ((field.metadata or {}).get(SEARCH_TARGET_KEY.encode(), b"") for field in table.schema)
    return next((word.decode() for word in noted if word), "")


def added_rows(table: pa.Table) -> NDArray[np.bool_]:
    """(R,) whether each row was added as today's design."""
    if TODAY_COLUMN not in table.column_names:
        return np.zeros(table.num_rows, dtype=bool)
    return np.array([mark is True for mark in table[TODAY_COLUMN].to_pylist()], dtype=bool)


@dataclass(frozen=True)
class Results:
    """Results of a study: table, factors, metrics.

    Attributes:
        factors: names of columns that were varied.
        metrics: names of numeric columns that were measured.
    """

    table: pa.Table
    factors: tuple[str, ...]
    metrics: tuple[str, ...]

    def _repr_html_(self) -> str:
        """HTML of study results for notebooks."""
        from warpchain.view.notebook import SHOWN_ROWS, notebook_table, status_html, value_with_unit

        words = self.status
        counts = ", ".join(f"{words.count(word)} {word}" for word in ROW_STATUSES if word in words)
        names = [*self.factors, *self.metrics[:MOST_METRICS]]
        rows = [
            [
                str(self.variants[k]),
                status_html(words[k]),
                *(value_with_unit(row[name], self.column_unit(name)) for name in names),
            ]
            for k, row in enumerate(self.table.slice(0, SHOWN_ROWS).to_pylist())
        ]
        caption = f"{len(words)} rows: {counts}; {len(self.factors)} factors, {len(self.metrics)} metrics"
        return notebook_table(("variant", "status", *names), rows, caption)

    @property
    def variants(self) -> NDArray[np.int64]:
        """Variant number (R,) of each row."""
        if "variant" in self.table.column_names:
            return np.asarray(self.table["variant"].to_pylist(), dtype=np.int64)
        return np.arange(self.table.num_rows)

    @property
    def run_counts(self) -> NDArray[np.int64]:
        """Number (R,) of runs of each row."""
        if not self.has_replicates:
            return np.ones(self.table.num_rows, dtype=np.int64)
        return np.asarray(self.table[COUNT_COLUMN].to_numpy(), dtype=np.int64)

    @property
    def adjustment_columns(self) -> tuple[str, ...]:
        """Names of the columns of adjustments."""
        names = self.table.column_names
        return tuple(n for n in names if n in ADJUSTMENT_COLUMNS or n.endswith(CHAIN_ADJUSTMENT_ENDINGS))

    @property
    def has_replicates(self) -> bool:
        """Whether rows of results are means of several runs."""
        names = self.table.column_names
        return COUNT_COLUMN in names and any(_is_error_column(self.table, name) for name in names)

    def standard_errors(self, metric: str) -> Array:
        """Standard errors (R,) of a metric over equal runs."""
        name = metric + ERROR_SUFFIX
        if not (self.has_replicates and name in self.table.column_names and _is_error_column(self.table, name)):
            return np.full(self.table.num_rows, np.nan)
        return self.values(name)

    @cached_property
    def status(self) -> list[str]:
        """Status of each row; "ok" without a column."""
        if "status" not in self.table.column_names:
            return ["ok"] * self.table.num_rows
        return [str(word) for word in self.table["status"].to_pylist()]

    @cached_property
    def ok(self) -> NDArray[np.bool_]:
        """(R,) whether each row of results is "ok"."""
        return np.array([word == "ok" for word in self.status], dtype=bool)

    def reason_counts(self) -> list[tuple[str, str, int]]:
        """Statuses, reasons without numbers, and counts of rows not ok."""
        rows = np.flatnonzero(~self.ok).tolist()
        return common_reasons((self.status[row], self.reason(row)) for row in rows)

    def reason(self, row: int) -> str:
        """Reason why a row of results is not ok."""
        held = self.table["reason"][row].as_py() if "reason" in self.table.column_names else None
        return held or "no reason given"

    def is_numeric(self, name: str) -> bool:
        """Whether a column of results holds numbers."""
        self._check_column(name)
        return _is_number_column(self.table, name)

    def _check_column(self, name: str) -> None:
        """Raises StudyError for a column that results lack."""
        if name not in self.table.column_names:
            raise StudyError(
                f"column {name!r}: not in the table; {nearest_key_text(name, self.table.column_names, MOST_LISTED)}"
            )

    def values(self, name: str) -> Array:
        """Values (R,) of a numeric results column, NaN if empty.

        Raises:
            StudyError: no such column, or not of numbers.
        """
        if not self.is_numeric(name):
            raise StudyError(f"column {name!r}: holds {self.table.schema.field(name).type}, numbers are needed here")
        return np.array(self.table[name].cast("float64").to_numpy(), dtype=float)

    def text_values(self, name: str) -> list[str]:
        """Values of a results column as strings."""
        self._check_column(name)
        return [str(value) for value in self.table[name].to_pylist()]

    def column_unit(self, name: str) -> str:
        """Unit of a results column; "" for none."""
        from warpchain.results.metric_columns import unit_of_metric

        noted = (self.table.schema.field(name).metadata or {}).get(b"unit")
        unit = noted.decode() if noted else unit_of_metric(name) if name in self.metrics else ""
        return "" if unit in ("1", "-") else unit

    @property
    def noise_factors(self) -> tuple[str, ...]:
        """Names of noise factors, tied ones among them."""
        return tuple(name for name in self.factors if self._noise_kind(name) in (NOISE, TIED_NOISE))

    @property
    def free_noise_factors(self) -> tuple[str, ...]:
        """Names of noise factors that are not tied."""
        return tuple(name for name in self.factors if self._noise_kind(name) == NOISE)

    @property
    def search_target(self) -> str:
        """Target of the search for the rows, or ""."""
        return search_target_of(self.table)

    def check_sampled(self) -> None:
        """Raises StudyError for rows of a search, no sample of noise."""
        if self.search_target:
            raise StudyError(
                f"noise: these rows look for {self.search_target} and are no sample of the noise: their shares, means, "
                "quantiles and effects tell nothing about it"
            )

    def sampled_rows(self) -> Results:
        """Results of the rows that no search chose.

        Raises:
            StudyError: a search chose all rows.
        """
        self.check_sampled()
        rows = ~added_rows(self.table)
        if ROUND_COLUMN in self.table.column_names:
            rounds = self.values(ROUND_COLUMN)
            rows &= rounds == rounds.min()
        return self if rows.all() else Results(self.table.filter(rows), self.factors, self.metrics)

    @property
    def row_of_today(self) -> int | None:
        """Index of today's design's first row, or None."""
        if TODAY_COLUMN not in self.table.column_names:
            return None
        marks = self.table[TODAY_COLUMN].to_pylist()
        return next((row for row, mark in enumerate(marks) if mark is not None), None)

    def _noise_kind(self, factor: str) -> str:
        """Kind of noise in a factor's metadata, or ""."""
        return (self.table.schema.field(factor).metadata or {}).get(b"kind", b"").decode()

    def distribution(self, factor: str) -> dict[str, Any] | None:
        """Distribution of a factor as in study files, or None."""
        noted = (self.table.schema.field(factor).metadata or {}).get(DISTRIBUTION_KEY.encode())
        return None if noted is None else dict(json.loads(noted))

    def usable_rows(self, metric: str, factors: Iterable[str] = ()) -> NDArray[np.bool_]:
        """(R,) whether each row is ok, with finite values."""
        rows = self.ok & np.isfinite(self.values(metric))
        for factor in factors:
            if self.is_numeric(factor):
                rows &= np.isfinite(self.values(factor))
        return rows

    def numeric_factors(self) -> tuple[str, ...]:
        """Names of factors that hold numbers and vary."""
        return tuple(f for f in self.factors if self.is_numeric(f) and is_varying(self.values(f)))

    def expression_factors(self) -> dict[str, tuple[str, ...]]:
        """Factors of expressions, with the factors in each."""
        found = {}
        for name in self.factors:
            noted = (self.table.schema.field(name).metadata or {}).get(EXPRESSION_KEY.encode(), b"[]")
            others = tuple(json.loads(noted))
            if others and set(others) <= set(self.factors):
                found[name] = others
        return found

    def factor_ties(self) -> dict[str, str]:
        """Words on factors that follow from others, by factor."""
        kept: dict[str, Array] = {}
        tied = {name: " and ".join(others) for name, others in self.expression_factors().items()}
        for name in self.numeric_factors():
            if name in tied:
                continue
            x = _standardized_values(self.values(name))
            with_one = next((other for other, y in kept.items() if abs(float(x @ y)) > 1.0 - 1e-9), None)
            if with_one is None:
                kept[name] = x
            else:
                tied[name] = with_one
        return tied

    def independent_factors(self) -> tuple[str, ...]:
        """Names of numeric factors that are linearly independent."""
        tied = self.factor_ties()
        return tuple(name for name in self.numeric_factors() if name not in tied)

    def varying_metrics(self) -> tuple[str, ...]:
        """Names of metrics that vary among ok rows."""
        return tuple(m for m in self.metrics if is_varying(self.values(m)[self.ok]))


def _standardized_values(values: Array) -> Array:
    """Values (R,) of mean 0 and length 1."""
    x = np.nan_to_num(values - np.nanmean(values))
    return x / np.sqrt(x @ x)


def is_varying(values: Array) -> bool:
    """Whether finite values vary by more than round-off."""
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and bool(np.ptp(finite) > 1e-12 * np.abs(finite).max())


def _is_number_column(table: pa.Table, name: str) -> bool:
    """Whether a table's column holds numbers or switches."""
    import pyarrow.types as kinds

    kind = table.schema.field(name).type
    return bool(kinds.is_integer(kind) or kinds.is_floating(kind) or kinds.is_boolean(kind))


def _is_error_column(table: pa.Table, name: str) -> bool:
    """Whether a table's column holds a metric's standard errors."""
    role = (table.schema.field(name).metadata or {}).get(b"role")
    if role is not None:
        return bool(role == ROLE_OF_ERRORS.encode())
    return (
        name.endswith(ERROR_SUFFIX)
        and name.removesuffix(ERROR_SUFFIX) in table.column_names
        and COUNT_COLUMN in table.column_names
    )


def read_results(
    source: pa.Table | str | Path, factors: Iterable[str] | None = None, metrics: Iterable[str] | None = None
) -> Results:
    """Results of a study read from a table.

    Args:
        source: a pyarrow table, or the path of a Parquet or CSV file.
        factors: columns that were varied; None takes those of role "factor".
        metrics: columns that were measured; None takes the other numeric ones.

    Raises:
        StudyError: a table that cannot be read, a missing column, or no factors marked.
    """
    import pyarrow as pa

    from warpchain.results.metric_columns import column_of_metric

    table = source if isinstance(source, pa.Table) else read_table(Path(source))
    words = (table.schema.metadata or {}).get(PLUGINS_KEY.encode(), b"").decode()
    if not isinstance(source, pa.Table) and (missing := missing_plugins(words)) is not None:
        warn_caller(f"{source}: made with a plug-in that is not here: {missing}")
    if not isinstance(source, pa.Table) and Path(source).suffix == ".csv":
        table = table_without_unit_heads(table)
    chosen = tuple(factors) if factors is not None else _columns_with_role(table, b"factor")
    if not chosen:
        columns = names_text(table.column_names, MOST_LISTED)
        raise StudyError(f"factors: none given, and the table marks none; its columns are {columns}")
    noted = _columns_with_role(table, b"metric")
    if metrics is not None:
        measured = tuple(metrics)
    else:
        names = noted or table.column_names
        held = {name for name in names if name == COUNT_COLUMN or _is_error_column(table, name)}
        held = held if len(held) > 1 else set()
        aside = {
            *chosen,
            *held,
            *(n for n in names if n in BOOKKEEPING_COLUMNS or n.endswith(CHAIN_ADJUSTMENT_ENDINGS)),
        }
        named = (n for n in names if n not in aside and _is_number_column(table, n))
        measured = tuple(name for name in named if not ((of := column_of_metric(name)) and of.is_aside))
    for kind, names in (("factors", chosen), ("metrics", measured)):
        for name in names:
            if name not in table.column_names:
                raise StudyError(
                    f"{kind}: {name!r} is not in the table; {nearest_key_text(name, table.column_names, MOST_LISTED)}"
                )
    results = Results(table, chosen, measured)
    for word in sorted(set(results.status) - set(ROW_STATUSES)):
        raise StudyError(f"column 'status': {word!r} is unknown; allowed are {', '.join(ROW_STATUSES)}")
    if ARCHIVE_COLUMNS[0] in table.column_names:
        for name in set(table[ARCHIVE_COLUMNS[0]].to_pylist()) - {None}:
            check_archive_name(name)
    return results


def _columns_with_role(table: pa.Table, role: bytes) -> tuple[str, ...]:
    """Names of columns with a role in metadata."""
    return tuple(field.name for field in table.schema if (field.metadata or {}).get(b"role") == role)
