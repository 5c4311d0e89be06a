"""Tables on the disk: read from Parquet and CSV, written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.errors import StudyError

if TYPE_CHECKING:
    import pyarrow as pa


def read_table(path: Path, columns: list[str] | None = None) -> pa.Table:
    """Reads a Parquet (.parquet) file, or chosen columns of it, or a CSV (.csv) file.

    Raises:
        StudyError: a file that is missing, of another kind, or damaged; one line.
    """
    import pyarrow as pa

    try:
        if path.suffix == ".parquet":
            from pyarrow import parquet

            return parquet.ParquetFile(path).read(columns)
        if path.suffix == ".csv":
            from pyarrow import csv

            return csv.read_csv(path)
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror or str(error).splitlines()[0]})") from None
    except pa.ArrowException as error:
        raise StudyError(f"{path}: not a table ({str(error).splitlines()[0]})") from None
    raise StudyError(f"{path}: allowed are tables that end in .parquet or .csv")


def write_whole(path: Path, write: Callable[[Any], None], keep: bool = False) -> None:
    """Writes a file under a temporary name, flushes it to the disk and renames it.

    Args:
        path: its name.
        write: is given the open binary file.
        keep: leave a file of that name as it is, so that of several processes the first one decides.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.{secrets.token_hex(4)}.partial")
    try:
        with partial.open("xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        if keep:
            _first(partial, path)
        else:
            partial.replace(path)
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        raise StudyError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        partial.unlink(missing_ok=True)


def _first(partial: Path, path: Path) -> None:
    """Gives a file its name unless that is taken."""
    try:
        os.link(partial, path)
    except FileExistsError:
        return
    except OSError:  # a file system without links: the last of those that write at the same moment decides
        if not path.exists():
            partial.replace(path)


def write_table(path: Path, table: pa.Table, keep: bool = False) -> None:
    """Writes a Parquet file, whole or not at all.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    from pyarrow import parquet

    write_whole(path, lambda file: parquet.write_table(table, file, compression="zstd"), keep)


def write_text(path: Path, text: str, keep: bool = False) -> None:
    """Writes a text file, whole or not at all.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    write_whole(path, lambda file: file.write(text.encode()), keep)
