"""Tables on the disk: read from Parquet and CSV, written whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain import files
from warpchain.errors import StudyError
from warpchain.files import PATIENCE, reason, refusals, whole_file

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
        raise StudyError(f"{path}: cannot be read ({reason(error)})") from None
    except pa.ArrowException as error:
        raise StudyError(f"{path}: not a table ({str(error).splitlines()[0]})") from None
    raise StudyError(f"{path}: allowed are tables that end in .parquet or .csv")


def write_table(path: Path, table: pa.Table, keep: bool = False) -> None:
    """Writes a Parquet file, whole or not at all.

    Args:
        keep: leave a file of that name as it is, so that of several processes the first one decides.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    from pyarrow import parquet

    with _kept(path, keep), whole_file(path, not keep, PATIENCE) as file:
        parquet.write_table(table, file, compression="zstd")


def write_text(path: Path, text: str, keep: bool = False) -> None:
    """Writes a text file, whole or not at all; see `write_table`.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    with _kept(path, keep):
        files.write_text(path, text, not keep)


@contextmanager
def _kept(path: Path, keep: bool) -> Iterator[None]:
    """What the system refuses in one line; that a file to be kept is there is no refusal."""
    with refusals(path, StudyError):
        try:
            yield
        except FileExistsError:
            if not keep:
                raise
