"""Tables of a study on disk: read from Parquet and CSV, written whole or not at all, recognized by a digest.

A note in the metadata (key `warpchain`, JSON) has a table's study, digest and shape, of a shard its rows' statuses.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from warpchain import files
from warpchain.errors import StudyError, WarpchainError
from warpchain.files import (
    WRITER_PATIENCE,
    open_regular_file,
    parse_json,
    refusal_reason,
    refusals_as_errors,
    whole_file,
)
from warpchain.results.statuses import STATUSES as JUDGED
from warpchain.results.statuses import merge_alike_reasons

if TYPE_CHECKING:
    import pyarrow as pa

OUTCOME_COLUMNS = ("status", "reason")
ROW_STATUSES = (*JUDGED, "infeasible")

_VARIANT_PREFIX = re.compile(r"^variant \d+: ")
NOTE_KEY = b"warpchain"
NOTE_HEAD = b"\x18" + bytes([len(NOTE_KEY)]) + NOTE_KEY + b"\x18"
REMEDY_RERUN = "remove it, and run the study again"
REMEDY_COPY = "copy it again, or, where a program has changed its values, drop the key warpchain of its metadata"


def reason_from_error(error: WarpchainError) -> str:
    """Message of an error in a line, without variant numbers."""
    return "; ".join(_VARIANT_PREFIX.sub("", str(error)).splitlines())


@dataclass(frozen=True)
class RowOutcomes:
    """Outcomes of a table's rows: counts of statuses, reasons."""

    counts: dict[str, int]  # rows by status
    reasons: list[tuple[str, str, int]]  # (status, reason, number of rows), the earliest first

    @staticmethod
    def of_table(table: pa.Table) -> RowOutcomes:
        """Outcomes of a study table's rows."""
        pairs = list(zip(*(table[name].to_pylist() for name in OUTCOME_COLUMNS), strict=True))
        given = ((status, reason, 1) for status, reason in pairs if reason is not None)
        return RowOutcomes(dict(Counter(status for status, _ in pairs)), merge_alike_reasons(given))


MOST_ROWS, MOST_CELLS = 10_000_000, 2**28


def read_table(
    path: Path, columns: list[str] | None = None, study: str | None = None, bounded: bool = False
) -> pa.Table:
    """Study table read from a Parquet or CSV file.

    Args:
        columns: the digest is checked only if all are read.
        study: identity that the table must have.
        bounded: whether to refuse more than `MOST_ROWS` or `MOST_CELLS`.

    Raises:
        StudyError: a missing file, another kind or study, one too long or damaged, or decimal commas.
    """
    import pyarrow as pa

    try:
        os.close(open_regular_file(path))
        if path.suffix == ".parquet":
            from pyarrow import parquet

            with parquet.ParquetFile(path, page_checksum_verification=True) as file:
                if bounded:
                    _check_table_size(file.metadata.num_rows, file.metadata.num_columns, path)
                table = file.read(columns)
            _check_unique_columns(table, path)
            if columns is None:
                table.validate(full=True)
            return _verified_table(table, path, columns is None, study)
        if path.suffix == ".csv":
            from pyarrow import csv

            table = csv.read_csv(path)
            if bounded:
                _check_table_size(table.num_rows, table.num_columns, path)
            _check_unique_columns(table, path)
            _check_decimal_points(table, path)
            return table
    except FileNotFoundError as error:
        raise StudyError(f"{path}: cannot be read ({refusal_reason(error)})") from None
    except OSError as error:  # also what a checksum finds
        raise StudyError(f"{path}: cannot be read ({refusal_reason(error)})") from None
    except (pa.ArrowException, ValueError, KeyError, TypeError, OverflowError, MemoryError) as error:
        raise StudyError(f"{path}: not a table ({(str(error).splitlines() or [type(error).__name__])[0]})") from None
    raise StudyError(f"{path}: allowed are tables that end in .parquet or .csv")


def _check_table_size(rows: int, columns: int, path: Path) -> None:
    """Raises StudyError for a stored table that is too large."""
    if rows > MOST_ROWS or rows * columns > MOST_CELLS:
        most = min(MOST_ROWS, MOST_CELLS // max(columns, 1))
        raise StudyError(f"{path}: {rows} rows of {columns} columns; allowed are at most {most} rows")


def _check_unique_columns(table: pa.Table, path: Path) -> None:
    """Raises StudyError for a stored table's repeated column names."""
    for k, name in enumerate(table.column_names):
        first = table.column_names.index(name)
        if first < k:
            raise StudyError(
                f"{path}: columns {first + 1} and {k + 1} are both named {name}; rename or remove one of them"
            )


def _check_decimal_points(table: pa.Table, path: Path) -> None:
    """Raises StudyError for a stored CSV table with decimal commas."""
    text = "cells are separated by commas, and numbers have decimal points"
    if table.num_columns == 1 and any(sign in table.column_names[0] for sign in ";\t"):
        raise StudyError(f"{path}: {table.column_names[0]!r}: {text}")
    for name in table.column_names:
        if str(table.schema.field(name).type) == "string":
            for row, cell in enumerate(table[name].to_pylist()):
                if cell is not None and re.fullmatch(r"\s*[+-]?[\d.]*,\d+(\.\d*)?([eE][+-]?\d+)?\s*", cell):
                    raise StudyError(f"{path}: column {name}, row {row}: {cell!r}: {text}")


def _verified_table(table: pa.Table, path: Path, whole: bool, study: str | None) -> pa.Table:
    """Study table without its note, which is checked."""
    held = dict(table.schema.metadata or {})
    note = parse_json(held.pop(NOTE_KEY, b"{}"))
    table = table.replace_schema_metadata(held or None)
    if study is not None and (note.get("table"), note.get("study")) != (path.stem, study):
        raise StudyError(
            f"{path}: is another table, of shard {note.get('table')!r}, or of another study; {REMEDY_RERUN}"
        )
    own = note.get("table") == path.stem
    if whole and (own or note.get("shape") == list(table.shape)) and note.get("digest") != table_digest(table):
        raise StudyError(f"{path}: is damaged (its digest is wrong); {REMEDY_RERUN if own else REMEDY_COPY}")
    return table


def read_row_outcomes(path: Path, study: str, rows: int) -> RowOutcomes:
    """Outcomes of a shard's rows, read from its note."""
    note = _footer_note(path) if study else {}
    try:
        held = note["ended"]
        known = note["mark"] == _note_digest(note) and (note["table"], note["study"]) == (path.stem, study)
        ended = RowOutcomes(dict(held["counts"]), [(status, text, int(n)) for status, text, n in held["reasons"]])
    except (KeyError, TypeError, ValueError):  # of an earlier version, or damaged
        known = False
    if not known:
        ended = RowOutcomes.of_table(read_table(path, list(OUTCOME_COLUMNS), study or None))
    if sum(ended.counts.values()) != rows:
        raise StudyError(f"{path}: has {sum(ended.counts.values())} rows, its shard {rows}")
    return ended


def _footer_note(path: Path) -> dict[str, Any]:
    """Note in a Parquet table's footer, or empty."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - 8, 0))
            length = int.from_bytes(file.read(4), "little")
            file.seek(max(size - 8 - length, 0))
            footer = file.read(length)
        at = footer.rindex(NOTE_HEAD) + len(NOTE_HEAD)
        return dict(json.JSONDecoder().raw_decode(footer[footer.index(b"{", at) :].decode("utf-8", "replace"))[0])
    except (OSError, ValueError, TypeError, RecursionError):  # said when the table is read
        return {}


def _note_digest(note: Mapping[str, Any]) -> str:
    """SHA-256 of a study table's note without its mark."""
    held = {name: value for name, value in note.items() if name != "mark"}
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


def table_digest(table: pa.Table) -> str:
    """SHA-256 of a study table's names, types, metadata and values."""
    import numpy as np
    import pyarrow as pa

    found = hashlib.sha256()
    for field, column in zip(table.schema, table.columns, strict=True):
        facts = sorted((k.decode(), v.decode()) for k, v in (field.metadata or {}).items())
        found.update(json.dumps([field.name, str(field.type), facts, len(column)]).encode())
        found.update(np.packbits(column.is_null().to_numpy()).tobytes())
        if pa.types.is_floating(field.type) or pa.types.is_integer(field.type) or pa.types.is_boolean(field.type):
            values = column.fill_null(False if pa.types.is_boolean(field.type) else 0).to_numpy()
            found.update(np.ascontiguousarray(values).tobytes())
        else:
            found.update(repr(column.to_pylist()).encode("utf-8", "surrogatepass"))
    return found.hexdigest()


def write_table(path: Path, table: pa.Table, keep: bool = False, study: str = "", note_outcomes: bool = False) -> None:
    """Writes a study table as Parquet, with a note.

    Args:
        keep: leave an existing file.
        study: its identity.
        note_outcomes: whether the note lists the rows' statuses.

    Raises:
        StudyError: a symbolic link in its place, or a folder or disk that refuses.
    """
    import pyarrow as pa
    from pyarrow import parquet

    check_no_symlink(path)
    held = {key: value for key, value in (table.schema.metadata or {}).items() if key != NOTE_KEY}
    note: dict[str, Any] = {
        "table": path.stem,
        "study": study,
        "digest": table_digest(table),
        "shape": list(table.shape),
    }
    if note_outcomes:
        note["ended"] = asdict(RowOutcomes.of_table(table))
        note["mark"] = _note_digest(note)
    noted = table.replace_schema_metadata(held | {NOTE_KEY: json.dumps(note).encode()})
    repeating = [field.name for field in noted.schema if not pa.types.is_floating(field.type)]
    with _refusals_as_study_errors(path, keep), whole_file(path, not keep, WRITER_PATIENCE) as file:
        parquet.write_table(noted, file, compression="zstd", write_page_checksum=True, use_dictionary=repeating)


def check_no_symlink(path: Path) -> None:
    """Raises StudyError for a symbolic link in a file's place."""
    if path.is_symlink():
        raise StudyError(f"{path}: is a symbolic link, where a study writes a file of its own; remove it")


def check_archive_name(name: object) -> None:
    """Raises StudyError for an archive outside the study's folder."""
    if not isinstance(name, str) or PurePath(name).is_absolute() or ".." in PurePath(name).parts:
        raise StudyError(f"column 'archive': {name!r} is no file in the study's folder")


def file_digest(path: Path) -> str:
    """SHA-256 of the bytes of a study's file."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({refusal_reason(error)})") from None


def write_study_text(path: Path, text: str, keep: bool = False) -> None:
    """Writes a study's text file, whole or not."""
    with _refusals_as_study_errors(path, keep):
        files.write_text_file(path, text, not keep)


@contextmanager
def _refusals_as_study_errors(path: Path, keep: bool) -> Iterator[None]:
    """Context in which the system's refusals become a StudyError."""
    with refusals_as_errors(path, StudyError):
        try:
            yield
        except FileExistsError:
            if not keep:
                raise
