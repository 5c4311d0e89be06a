"""Metrics of copies (replicates) of a drive that differ only in how they begin: mean, standard error, number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.results.statuses import DIVERGED, OK, STATUSES
from warpchain.results.window_statistics import ERROR_SUFFIX

if TYPE_CHECKING:
    import pyarrow as pa

DRIVE_COLUMN, COPY_COLUMN = "drive", "replicate"
COUNT_COLUMN = "n"
ROLE_OF_ERRORS = "error"
UNAVERAGED_COLUMNS = ("diverged", "diverged_time", "window_start", "window_end")


def metrics_with_copies(metrics: pa.Table, count: int) -> pa.Table:
    """Metrics table with numbers of drives and replicates."""
    import pyarrow as pa

    if count == 1:
        return metrics
    number = np.arange(metrics.num_rows)
    for name, values in ((DRIVE_COLUMN, number // count), (COPY_COLUMN, number % count)):
        metrics = metrics.append_column(pa.field(name, pa.int64(), metadata={"unit": "1"}), pa.array(values))
    return metrics


def summarize_copies(table: pa.Table, key: str, first: Sequence[str] = ()) -> pa.Table:
    """Table of means over replicates, a row a drive.

    Copies that are ok count; where none is, all that did not diverge.

    Args:
        table: with `status`, `reason` and, of several copies, `replicate`.
        key: column of the drive's number.
        first: columns taken from a drive's first copy.
    """
    import pyarrow as pa

    keys, place = np.unique(table[key].to_numpy(), return_inverse=True)
    at = _rows_of_copies(place, _copy_numbers(table), len(keys))
    chosen = _is_in_mean(table["status"].to_pylist(), at)
    fields, columns = [table.schema.field(key)], [pa.array(keys)]

    def add_column(field: pa.Field, values: Any, name: str = "", **facts: str) -> None:
        """Adds a column with metadata to the summary of replicates."""
        known = {k.decode(): v.decode() for k, v in (field.metadata or {}).items()}
        fields.append(pa.field(name or field.name, values.type, metadata=known | facts or None))
        columns.append(values)

    for field in table.schema:
        name = field.name
        if name == "status":
            for word, words in zip(("status", "reason"), _worst_status_and_reason(table, at), strict=True):
                add_column(table.schema.field(word), pa.array(words, pa.string()))
            add_column(pa.field(COUNT_COLUMN, pa.int64()), pa.array(chosen.sum(axis=1), pa.int64()), unit="1")
        elif name in (key, COPY_COLUMN, "reason", "variant"):
            continue
        elif name in first or name in UNAVERAGED_COLUMNS:
            add_column(field, table[name].combine_chunks().take(pa.array(_first_rows_with_value(table[name], at))))
        elif _is_averaged(field, table.column_names):
            mean, error = (
                pa.array(x, mask=np.isnan(x)) for x in _mean_and_error(_column_values(table, name), at, chosen)
            )
            add_column(field, mean)
            add_column(field, error, name + ERROR_SUFFIX, role=ROLE_OF_ERRORS)
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _first_rows_with_value(column: Any, at: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row (D,) of each drive's first replicate with a value."""
    there = np.append(~np.asarray(column.is_null().to_numpy(), dtype=bool), False)[at]
    return at[np.arange(len(at)), np.where(there.any(axis=1), there.argmax(axis=1), (at >= 0).argmax(axis=1))]


def _is_averaged(field: pa.Field, names: Sequence[str]) -> bool:
    """Whether a metric column is averaged over replicates."""
    import pyarrow.types as kinds

    if field.name.endswith(ERROR_SUFFIX) and field.name.removesuffix(ERROR_SUFFIX) in names:
        return False
    return bool(kinds.is_integer(field.type) or kinds.is_floating(field.type) or kinds.is_boolean(field.type))


def _copy_numbers(table: pa.Table) -> NDArray[np.int64]:
    """Copy (replicate) number of each row."""
    if COPY_COLUMN not in table.column_names:
        return np.zeros(table.num_rows, dtype=np.int64)
    return np.asarray(table[COPY_COLUMN].to_numpy())


def _rows_of_copies(place: NDArray[np.intp], number: NDArray[np.int64], drives: int) -> NDArray[np.int64]:
    """Rows (D, copies) of each drive's replicates, or -1."""
    order = np.lexsort((number, place))
    counts = np.bincount(place, minlength=drives)
    within = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
    at = np.full((drives, int(counts.max(initial=1))), -1, dtype=np.int64)
    at[place[order], within] = order
    return at


def _is_in_mean(status: Sequence[str], at: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(D, copies) whether each replicate counts in the mean."""
    words = np.array([*status, ""], dtype=object)[at]  # the last one stands for -1, a copy that is not there
    ok = words == OK
    ran = ~np.isin(words, ("", "infeasible", DIVERGED))
    return np.where(ok.any(axis=1)[:, None], ok, ran)


def _worst_status_and_reason(table: pa.Table, at: NDArray[np.int64]) -> tuple[list[str], list[str | None]]:
    """Worst status among each drive's replicates, and its reason."""
    status, reason = table["status"].to_pylist(), table["reason"].to_pylist()
    rank = {word: k for k, word in enumerate(STATUSES)}
    number = _copy_numbers(table)
    words, reasons = [], []
    for row in at:
        copies = [int(i) for i in row if i >= 0]
        worst = max(copies, key=lambda i: rank.get(status[i], len(rank)))
        words.append(status[worst])
        alike = sum(status[i] == status[worst] for i in copies)
        of = f"replicate {number[worst]} and {alike - 1} more of {len(copies)}: " if alike > 1 else (
            f"replicate {number[worst]} of {len(copies)}: ")  # fmt: skip
        text = reason[worst] if alike == len(copies) or not reason[worst] else of + reason[worst]
        reasons.append(text)
    return words, reasons


def _column_values(table: pa.Table, name: str) -> NDArray[np.float64]:
    """Values of a column of replicates, nan where null."""
    return np.array(table[name].cast("float64").to_numpy(), dtype=float)


def _mean_and_error(
    values: NDArray[np.float64], at: NDArray[np.int64], chosen: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard error (D,) of drives' replicates."""
    each = np.where(chosen, values[at], np.nan)
    there = np.isfinite(each)
    count = there.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = _sum_of_copies(np.where(there, each, 0.0)) / count
        square = _sum_of_copies(np.where(there, (each - mean[:, None]) ** 2, 0.0))
        error = np.sqrt(square / (count - 1) / count)
    return np.where(count > 0, mean, np.nan), np.where(count > 1, error, np.nan)


def _sum_of_copies(each: NDArray[np.float64]) -> NDArray[Any]:
    """Sum (D,) over each drive's replicates."""
    found = np.zeros(len(each))
    for column in each.T:
        found = found + column
    return found
