"""A recorded variant as a file for other programs: numpy, CSV, Parquet, HDF5, MATLAB; its metrics as a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.archive.housing_export import measured_data, universal
from warpchain.errors import ArchiveError
from warpchain.extras import require_extra
from warpchain.files import refusals_as_errors, whole_file
from warpchain.results.arrow_tables import export_table, unit_table, with_unit_heads
from warpchain.results.channels import AXES, CHANNEL, UNITS
from warpchain.version import installed_version

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.drive import Drive
    from warpchain.results.run import Trajectory


def export_metrics(archive: str | Path, output: str | Path) -> Path:
    """Writes an archive's table of metrics, a row a variant, as CSV or Parquet by the file's ending.

    Raises:
        ArchiveError: an archive that cannot be read, another ending, or a file that cannot be written.
    """
    from warpchain.archive.writer import read_archive

    return export_table(read_archive(archive).metrics, output, ArchiveError)


def export_orders(archive: str | Path, output: str | Path, variant: int | None = None) -> Path:
    """Writes levels of the loads on the housing over orders in dB, as CSV or Parquet (`results.housing.order_levels`).

    Raises:
        ArchiveError, SimulationError: as `export`; or a driver that does not turn one way.
    """
    from warpchain.results.housing import order_levels

    return export_table(order_levels(_recorded(archive, variant)), output, ArchiveError)


def _recorded(archive: str | Path, variant: int | None) -> Trajectory:
    """The trajectory of a variant, None for the first recorded.

    Raises:
        ArchiveError: an archive that cannot be read, or that lacks the frames.
        SimulationError: a variant that was not recorded, or none at all.
    """
    from warpchain.archive.writer import read_archive

    run = read_archive(archive)
    return run[run.first if variant is None else variant]


def export(archive: str | Path, output: str | Path, variant: int | None = None) -> Path:
    """Writes one variant's trajectory in the format that the file's ending names, one of `FORMATS`.

    All values are in SI units, angles in radians, which each format states. In .npz, .h5 and .mat every channel is an
    array (F, ...) of its name; in .csv and .parquet every number has a column of its own, such as `position.12.x` or
    `sprocket_speed.camshaft`, one row a frame. Universal files (.unv, .uff) and MDF4 (.mf4) hold the loads on the
    housing instead (`warpchain.archive.housing_export`).

    Args:
        archive: the MCAP archive.
        output: the file; it appears under this name only when whole.
        variant: which variant; None is the first recorded.

    Returns:
        The file written.

    Raises:
        ArchiveError: an archive that cannot be read, a file that cannot be written, or another ending.
        SimulationError: a variant that was not recorded.
        WarpchainError: HDF5 without the package h5py, a universal file without pyuff, MDF4 without asammdf.
    """
    path = Path(output)
    if path.suffix.lower() not in FORMATS:
        raise ArchiveError(f"{path}: ending {path.suffix!r}: allowed are {', '.join(FORMATS)}")
    ending = path.suffix.lower()
    if ending in EXTRAS:
        require_extra(EXTRAS[ending], ending, ArchiveError)
    trajectory = _recorded(archive, variant)
    with refusals_as_errors(path, ArchiveError), whole_file(path) as file:
        FORMATS[ending](file, trajectory)
    return path


def flat(trajectory: Trajectory) -> pa.Table:
    """A table with a column for every number of a frame, named CHANNEL.INDEX or CHANNEL.NAME, with .x or .y behind
    it for vectors; fields' metadata have the `unit`."""
    import pyarrow as pa

    columns: dict[str, NDArray[Any]] = {"time": trajectory.time}
    units = {"time": UNITS["time"]}
    drive = trajectory.drive
    named = {kind: [part.name for part in parts] for kind, parts in _bodies(drive).items()}
    for channel, array in trajectory.channels().items():
        of = named.get(CHANNEL[channel].per) or [str(i) for i in range(array.shape[1])]
        for i, part in enumerate(of):
            if array.ndim == 2:
                parts = {f"{channel}.{part}": array[:, i]}
            else:
                parts = {f"{channel}.{part}.{axis}": array[:, i, k] for k, axis in enumerate(AXES)}
            columns |= parts
            units |= dict.fromkeys(parts, UNITS[channel])
    arrays = {name: pa.array(np.ascontiguousarray(column)) for name, column in columns.items()}
    return unit_table(arrays, units).replace_schema_metadata({"warpchain": installed_version()})


def _bodies(drive: Drive) -> dict[str, Sequence[Any]]:
    """The parts with channels of their own beside rollers and links, by kind, of which there are any."""
    held = {
        "sprocket": drive.sprockets,
        "arm": drive.arms,
        "tensioner": drive.tensioners,
        "shaft": drive.shafts,
        "coupling": drive.couplings,
        "valve": drive.valves,
    }
    return {kind: parts for kind, parts in held.items() if parts}


def _npz(file: IO[bytes], trajectory: Trajectory) -> None:
    """An array a channel; `units` has rows of name and unit."""
    arrays: dict[str, Any] = {"time": trajectory.time, **trajectory.channels()}
    np.savez_compressed(file, units=np.array([(name, UNITS[name]) for name in arrays]), **arrays)


def _csv(file: IO[bytes], trajectory: Trajectory) -> None:
    """A first line of names with units in brackets, such as `tension.12 [N]`; numbers in full."""
    from pyarrow import csv

    csv.write_csv(with_unit_heads(flat(trajectory)), file)


def _parquet(file: IO[bytes], trajectory: Trajectory) -> None:
    import pyarrow.parquet as pq

    pq.write_table(flat(trajectory), file, compression="zstd")


def _hdf5(file: IO[bytes], trajectory: Trajectory) -> None:
    """A dataset a channel with the attributes `units`, `description` and dimension labels; time as their scale."""
    import h5py

    # in memory first: where a disk refuses, the library's own writing ends the process when it is cleaned up
    with h5py.File("trajectory", "w", driver="core", backing_store=False) as root:
        root.attrs["warpchain"] = installed_version()
        for kind, parts in _bodies(trajectory.drive).items():
            root.attrs[f"{kind}s"] = [part.name for part in parts]
        root.attrs["drive"] = trajectory.drive.as_read.model_dump_json(exclude_none=True)
        time = root.create_dataset("time", data=trajectory.time)
        time.attrs["units"] = UNITS["time"]
        time.make_scale("time")
        for name, values in trajectory.channels().items():
            held = root.create_dataset(name, data=values, compression="gzip", shuffle=True)
            held.attrs["units"], held.attrs["description"] = UNITS[name], CHANNEL[name].description
            held.dims[0].attach_scale(time)
            for k, label in enumerate(CHANNEL[name].dimensions):
                held.dims[k].label = label
        root.flush()
        file.write(root.id.get_file_image())


def _matlab(file: IO[bytes], trajectory: Trajectory) -> None:
    """A variable a channel, of MATLAB's format 5; a struct `units` of their units; the bodies' names as cells."""
    from scipy.io import savemat

    channels = trajectory.channels()
    held: dict[str, Any] = {"time": trajectory.time[:, None], **channels}
    for kind, parts in _bodies(trajectory.drive).items():
        held[f"{kind}s"] = np.array([part.name for part in parts], dtype=object)
    held["units"] = {name: UNITS[name] for name in ("time", *channels)}
    savemat(file, held, do_compression=True)


FORMATS: dict[str, Callable[[IO[bytes], Trajectory], None]] = {
    ".npz": _npz,
    ".csv": _csv,
    ".parquet": _parquet,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
    ".mat": _matlab,
    ".unv": universal,
    ".uff": universal,
    ".mf4": measured_data,
}
"""Writers of a trajectory, by the file's ending."""
EXTRAS = {".h5": "hdf5", ".hdf5": "hdf5", ".unv": "uff", ".uff": "uff", ".mf4": "mdf"}
"""Extras that writers need, by the file's ending."""
