"""Tables on the disk: read from Parquet and CSV, written whole or not at all, recognized by a digest.

The pages of a Parquet file have checksums. A note in the schema's metadata (key `warpchain`, JSON) covers the rest:
`table`, the name that the file was written under, `study`, which one it belongs to, and `digest`, the SHA-256 of names,
types, metadata and values, and `shape`, its rows and columns. A table of another name and another shape is somebody's
own, and its note counts for nothing. The note of a shard's table also has in short how its rows ended (`ended`), so
that a study's status is read without the tables.
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
from warpchain.files import PATIENCE, open_regular, parse_json, reason, refusals, whole_file
from warpchain.results.statuses import STATUSES as JUDGED
from warpchain.results.statuses import alike_reasons

if TYPE_CHECKING:
    import pyarrow as pa

OUTCOME = ("status", "reason")
"""Columns of a study's table: how a variant ended, and why where that is not "ok"."""
STATUSES = (*JUDGED, "infeasible")
"""Statuses of a row: those of a variant as it is judged, or of a row that gives none."""

_VARIANT = re.compile(r"^variant \d+: ")
NOTE = b"warpchain"
"""Key of the note in a table's metadata."""
PAIR = b"\x18" + bytes([len(NOTE)]) + NOTE + b"\x18"
"""Beginning of the note in a file's footer: a pair of strings in Thrift's compact protocol, each after its length."""
AGAIN = "remove it, and run the study again"
AFRESH = "copy it again, or, where a program has changed its values, drop the key warpchain of its metadata"


def reason_of(error: WarpchainError) -> str:
    """An error in one line, without the number that the variant had among those simulated with it."""
    return "; ".join(_VARIANT.sub("", str(error)).splitlines())


@dataclass(frozen=True)
class Ended:
    """Statuses of a table's rows, and reasons.

    Attributes:
        counts: number of rows by status.
        reasons: (status, reason, how many), those that differ in their numbers only as one, the earliest first.
    """

    counts: dict[str, int]
    reasons: list[tuple[str, str, int]]

    @staticmethod
    def of(table: pa.Table) -> Ended:
        """Statuses and reasons of a table with the columns `OUTCOME`."""
        pairs = list(zip(*(table[name].to_pylist() for name in OUTCOME), strict=True))
        given = ((status, reason, 1) for status, reason in pairs if reason is not None)
        return Ended(dict(Counter(status for status, _ in pairs)), alike_reasons(given))


MOST_ROWS, MOST_CELLS = 10_000_000, 2**28
"""Rows and cells of a table that is given to a study, at most; 2 GiB of numbers."""


def read_table(
    path: Path, columns: list[str] | None = None, study: str | None = None, bounded: bool = False
) -> pa.Table:
    """Reads a Parquet (.parquet) file, or chosen columns of it, or a CSV (.csv) file.

    Args:
        columns: which; the digest is checked only where all are read.
        study: the study that a table must belong to, under the name that it has; None takes any table.
        bounded: whether to refuse more than `MOST_ROWS` or `MOST_CELLS`; those of Parquet before they are read.

    Raises:
        StudyError: a file that is missing, of another kind, another one's, too long, or damaged, a name that several
            columns have, or numbers with decimal commas; one line.
    """
    import pyarrow as pa

    try:
        os.close(open_regular(path))
        if path.suffix == ".parquet":
            from pyarrow import parquet

            with parquet.ParquetFile(path, page_checksum_verification=True) as file:
                if bounded:
                    _check_length(file.metadata.num_rows, file.metadata.num_columns, path)
                table = file.read(columns)
            _check_names(table, path)
            if columns is None:
                table.validate(full=True)
            return _known(table, path, columns is None, study)
        if path.suffix == ".csv":
            from pyarrow import csv

            table = csv.read_csv(path)
            if bounded:
                _check_length(table.num_rows, table.num_columns, path)
            _check_names(table, path)
            _check_points(table, path)
            return table
    except FileNotFoundError as error:
        raise StudyError(f"{path}: cannot be read ({reason(error)})") from None
    except OSError as error:  # also what a checksum finds
        raise StudyError(f"{path}: cannot be read ({reason(error)})") from None
    except (pa.ArrowException, ValueError, KeyError, TypeError, OverflowError, MemoryError) as error:
        raise StudyError(f"{path}: not a table ({(str(error).splitlines() or [type(error).__name__])[0]})") from None
    raise StudyError(f"{path}: allowed are tables that end in .parquet or .csv")


def _check_length(rows: int, columns: int, path: Path) -> None:
    """Refuses more rows or cells than a table that is given may have; a small file can say any number of equal ones."""
    if rows > MOST_ROWS or rows * columns > MOST_CELLS:
        most = min(MOST_ROWS, MOST_CELLS // max(columns, 1))
        raise StudyError(f"{path}: {rows} rows of {columns} columns; allowed are at most {most} rows")


def _check_names(table: pa.Table, path: Path) -> None:
    """Refuses a name that stands twice."""
    for k, name in enumerate(table.column_names):
        first = table.column_names.index(name)
        if first < k:
            raise StudyError(
                f"{path}: columns {first + 1} and {k + 1} are both named {name}; rename or remove one of them"
            )


def _check_points(table: pa.Table, path: Path) -> None:
    """Refuses a CSV file with decimal commas, which would be texts, or with semicolons, which would be one column."""
    text = "cells are separated by commas, and numbers have decimal points"
    if table.num_columns == 1 and any(sign in table.column_names[0] for sign in ";\t"):
        raise StudyError(f"{path}: {table.column_names[0]!r}: {text}")
    for name in table.column_names:
        if str(table.schema.field(name).type) == "string":
            for row, cell in enumerate(table[name].to_pylist()):
                if cell is not None and re.fullmatch(r"\s*[+-]?[\d.]*,\d+(\.\d*)?([eE][+-]?\d+)?\s*", cell):
                    raise StudyError(f"{path}: column {name}, row {row}: {cell!r}: {text}")


def _known(table: pa.Table, path: Path, whole: bool, study: str | None) -> pa.Table:
    """A table without its note, which is right."""
    held = dict(table.schema.metadata or {})
    note = parse_json(held.pop(NOTE, b"{}"))
    table = table.replace_schema_metadata(held or None)
    if study is not None and (note.get("table"), note.get("study")) != (path.stem, study):
        raise StudyError(f"{path}: is another table, of shard {note.get('table')!r}, or of another study; {AGAIN}")
    own = note.get("table") == path.stem
    if whole and (own or note.get("shape") == list(table.shape)) and note.get("digest") != digest_of(table):
        raise StudyError(f"{path}: is damaged (its digest is wrong); {AGAIN if own else AFRESH}")
    return table


def read_ended(path: Path, study: str, rows: int) -> Ended:
    """Statuses and reasons of one of a study's tables, from its note; from the table itself where that has none.

    Args:
        study: the study that it must belong to; "" takes any table.
        rows: how many it must have.

    Raises:
        StudyError: a file that is missing, another one's, or damaged; one line.
    """
    note = _note(path) if study else {}
    try:
        held = note["ended"]
        known = note["mark"] == _mark(note) and (note["table"], note["study"]) == (path.stem, study)
        ended = Ended(dict(held["counts"]), [(status, text, int(n)) for status, text, n in held["reasons"]])
    except (KeyError, TypeError, ValueError):  # of an earlier version, or damaged
        known = False
    if not known:
        ended = Ended.of(read_table(path, list(OUTCOME), study or None))
    if sum(ended.counts.values()) != rows:
        raise StudyError(f"{path}: has {sum(ended.counts.values())} rows, its shard {rows}")
    return ended


def _note(path: Path) -> dict[str, Any]:
    """The note in a Parquet file's footer, found without reading the file; empty where there is none."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - 8, 0))
            length = int.from_bytes(file.read(4), "little")
            file.seek(max(size - 8 - length, 0))
            footer = file.read(length)
        at = footer.rindex(PAIR) + len(PAIR)
        return dict(json.JSONDecoder().raw_decode(footer[footer.index(b"{", at) :].decode("utf-8", "replace"))[0])
    except (OSError, ValueError, TypeError, RecursionError):  # said when the table is read
        return {}


def _mark(note: Mapping[str, Any]) -> str:
    """Digest of a note, without itself."""
    held = {name: value for name, value in note.items() if name != "mark"}
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


def digest_of(table: pa.Table) -> str:
    """SHA-256 of a table's names, types, metadata and values, however they lie in memory."""
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


def write_table(path: Path, table: pa.Table, keep: bool = False, study: str = "", ended: bool = False) -> None:
    """Writes a Parquet file, whole or not at all, with checksums and a note.

    Args:
        keep: leave a file of that name as it is, so that of several processes the first one decides.
        study: the study that it belongs to.
        ended: whether to note how its rows ended.

    Raises:
        StudyError: a symbolic link in its place, or a folder or disk that refuses.
    """
    import pyarrow as pa
    from pyarrow import parquet

    check_no_link(path)
    held = {key: value for key, value in (table.schema.metadata or {}).items() if key != NOTE}
    note: dict[str, Any] = {"table": path.stem, "study": study, "digest": digest_of(table), "shape": list(table.shape)}
    if ended:
        note["ended"] = asdict(Ended.of(table))
        note["mark"] = _mark(note)
    noted = table.replace_schema_metadata(held | {NOTE: json.dumps(note).encode()})
    repeating = [field.name for field in noted.schema if not pa.types.is_floating(field.type)]
    with _kept(path, keep), whole_file(path, not keep, PATIENCE) as file:
        parquet.write_table(noted, file, compression="zstd", write_page_checksum=True, use_dictionary=repeating)


def check_no_link(path: Path) -> None:
    """Refuses to write through a symbolic link, which in a folder made elsewhere could lead anywhere.

    Raises:
        StudyError: in one line.
    """
    if path.is_symlink():
        raise StudyError(f"{path}: is a symbolic link, where a study writes a file of its own; remove it")


def check_archive_name(name: object) -> None:
    """Refuses the file of a recorded variant that does not lie in its study's folder.

    Raises:
        StudyError: in one line.
    """
    if not isinstance(name, str) or PurePath(name).is_absolute() or ".." in PurePath(name).parts:
        raise StudyError(f"column 'archive': {name!r} is no file in the study's folder")


def file_digest(path: Path) -> str:
    """SHA-256 of a file's bytes.

    Raises:
        StudyError: it cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({reason(error)})") from None


def write_text(path: Path, text: str, keep: bool = False) -> None:
    """Writes a text file, whole or not at all; see `write_table`.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    with _kept(path, keep):
        files.write_text(path, text, not keep)


@contextmanager
def _kept(path: Path, keep: bool) -> Iterator[None]:
    """Reports refusals of the system in one line; that a file to be kept is there is none."""
    with refusals(path, StudyError):
        try:
            yield
        except FileExistsError:
            if not keep:
                raise
