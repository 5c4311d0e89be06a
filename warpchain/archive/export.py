"""A recorded variant as a compressed numpy file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from warpchain.errors import ArchiveError
from warpchain.files import refusals, whole_file


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
