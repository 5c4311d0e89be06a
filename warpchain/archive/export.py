"""A recorded variant as a compressed numpy file, and an archive's metrics as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warpchain.errors import ArchiveError
from warpchain.files import refusals, whole_file


def export_metrics(archive: str | Path, output: str | Path) -> Path:
    """Writes an archive's table of metrics, a row a variant, as CSV or Parquet by the file's ending.

    Raises:
        ArchiveError: an archive that cannot be read, another ending, or a file that cannot be written.
    """
    from warpchain.archive.write import read_archive

    path = Path(output)
    if path.suffix not in (".csv", ".parquet"):
        raise ArchiveError(f"{path}: metrics are written as .csv or .parquet")
    table = read_archive(archive).metrics
    with refusals(path, ArchiveError), whole_file(path) as file:
        if path.suffix == ".csv":
            from pyarrow import csv

            csv.write_csv(table, file)
        else:
            from pyarrow import parquet

            parquet.write_table(table, file)
    return path


def export_npz(archive: str | Path, output: str | Path, variant: int | None = None) -> Path:
    """Writes one variant's trajectory to `output`: the arrays `time` and every recorded channel, by name, in SI units.

    Args:
        archive: the MCAP archive.
        output: the .npz file; it appears under this name only when whole.
        variant: which variant; None is the first recorded.

    Returns:
        The file written.

    Raises:
        ArchiveError: an archive that cannot be read, or a file that cannot be written.
        SimulationError: a variant that was not recorded.
    """
    from warpchain.archive.write import read_archive

    if Path(output).suffix not in ("", ".npz"):
        raise ArchiveError(f"{output}: trajectories are written as .npz; metrics as .csv or .parquet, with --metrics")
    run = read_archive(archive)
    recorded = list(run)
    if not recorded:
        raise ArchiveError(f"{archive}: holds no trajectory to export")
    trajectory = run[recorded[0] if variant is None else variant]
    path = Path(output)
    arrays: dict[str, Any] = {"time": trajectory.time, **trajectory.channels()}
    with refusals(path, ArchiveError), whole_file(path) as file:
        np.savez_compressed(file, **arrays)
    return path
