"""Export of a recorded variant as numpy, CSV, Parquet, HDF5 or MATLAB, and of metrics as a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.archive.housing_export import write_mdf4, write_universal_file
from warpchain.errors import ArchiveError
from warpchain.extras import require_extra
from warpchain.files import refusals_as_errors, whole_file
from warpchain.results.arrow_tables import export_table, table_with_unit_heads, table_with_units
from warpchain.results.channels import AXIS_LABELS, CHANNEL_BY_NAME, CHANNEL_UNITS
from warpchain.results.own_channels import channels_with_own
from warpchain.version import installed_version

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.drive import Drive
    from warpchain.results.run import Trajectory


def export_metrics(archive: str | Path, output: str | Path) -> Path:
    """Exports an archive's metrics as CSV or Parquet; returns the path.

    Raises:
        ArchiveError: an unreadable archive, another ending, or a file that cannot be written.
    """
    from warpchain.archive.writer import read_archive

    return export_table(read_archive(archive).metrics, output, ArchiveError)


def export_orders(archive: str | Path, output: str | Path, variant: int | None = None) -> Path:
    """Exports `order_levels` of an archived variant as CSV or Parquet; returns the path.

    Raises:
        ArchiveError, SimulationError: as of `export`; or a driver that does not turn one way.
    """
    from warpchain.results.housing import order_levels

    return export_table(order_levels(_read_trajectory(archive, variant)), output, ArchiveError)


def _read_trajectory(archive: str | Path, variant: int | None) -> Trajectory:
    """Trajectory of an archive's variant, None the first recorded."""
    from warpchain.archive.writer import read_archive

    run = read_archive(archive)
    return run[run.first if variant is None else variant]


def export(archive: str | Path, output: str | Path, variant: int | None = None) -> Path:
    """Exports a variant's trajectory in the format of the ending; returns the path.

    Values are in SI units. In .npz, .h5 and .mat a channel is an array (F, ...); in .csv and .parquet every number has
    a column, such as `position.12.x` or `sprocket_speed.camshaft`, one row a frame. .unv, .uff and .mf4 hold the loads
    on the housing. `variant` None is the first recorded.

    Raises:
        ArchiveError: an unreadable archive, a file that cannot be written, or another ending.
        SimulationError: a variant that was not recorded.
        WarpchainError: the ending's package (h5py, pyuff, asammdf) is not installed.
    """
    path = Path(output)
    if path.suffix.lower() not in TRAJECTORY_WRITERS:
        raise ArchiveError(f"{path}: ending {path.suffix!r}: allowed are {', '.join(TRAJECTORY_WRITERS)}")
    ending = path.suffix.lower()
    if ending in WRITER_EXTRAS:
        require_extra(WRITER_EXTRAS[ending], ending, ArchiveError)
    trajectory = _read_trajectory(archive, variant)
    with refusals_as_errors(path, ArchiveError), whole_file(path) as file:
        TRAJECTORY_WRITERS[ending](file, trajectory)
    return path


def flat_table(trajectory: Trajectory) -> pa.Table:
    """Table of a trajectory to export, a column a number: CHANNEL.INDEX or CHANNEL.NAME."""
    import pyarrow as pa

    columns: dict[str, NDArray[Any]] = {"time": trajectory.time}
    units = {"time": CHANNEL_UNITS["time"]}
    drive = trajectory.drive
    named = {kind: [part.name for part in parts] for kind, parts in _bodies_by_kind(drive).items()}
    for channel, array in channels_with_own(trajectory).items():
        of = named.get(CHANNEL_BY_NAME[channel].per) or [str(i) for i in range(array.shape[1])]
        for i, part in enumerate(of):
            if array.ndim == 2:
                parts = {f"{channel}.{part}": array[:, i]}
            else:
                parts = {f"{channel}.{part}.{axis}": array[:, i, k] for k, axis in enumerate(AXIS_LABELS)}
            columns |= parts
            units |= dict.fromkeys(parts, CHANNEL_UNITS[channel])
    arrays = {name: pa.array(np.ascontiguousarray(column)) for name, column in columns.items()}
    return table_with_units(arrays, units).replace_schema_metadata({"warpchain": installed_version()})


def _bodies_by_kind(drive: Drive) -> dict[str, Sequence[Any]]:
    """Bodies of an exported drive, by kind of part."""
    held = {
        "sprocket": drive.sprockets,
        "arm": drive.arms,
        "tensioner": drive.tensioners,
        "shaft": drive.shafts,
        "coupling": drive.couplings,
        "valve": drive.valves,
    }
    return {kind: parts for kind, parts in held.items() if parts}


def _write_npz(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes a trajectory as .npz: an array a channel, and `units`."""
    arrays: dict[str, Any] = {"time": trajectory.time, **channels_with_own(trajectory)}
    np.savez_compressed(file, units=np.array([(name, CHANNEL_UNITS[name]) for name in arrays]), **arrays)


def _write_csv(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes a trajectory as CSV, units in heads: `tension.12 [N]`."""
    from pyarrow import csv

    csv.write_csv(table_with_unit_heads(flat_table(trajectory)), file)


def _write_parquet(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes a trajectory as Parquet."""
    import pyarrow.parquet as pq

    pq.write_table(flat_table(trajectory), file, compression="zstd")


def _write_hdf5(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes a trajectory as HDF5: a dataset a channel, `units`, `description`."""
    import h5py

    # in memory first: where a disk refuses, the library's own writing ends the process when it is cleaned up
    with h5py.File("trajectory", "w", driver="core", backing_store=False) as root:
        root.attrs["warpchain"] = installed_version()
        for kind, parts in _bodies_by_kind(trajectory.drive).items():
            root.attrs[f"{kind}s"] = [part.name for part in parts]
        root.attrs["drive"] = trajectory.drive.as_read.model_dump_json(exclude_none=True)
        time = root.create_dataset("time", data=trajectory.time)
        time.attrs["units"] = CHANNEL_UNITS["time"]
        time.make_scale("time")
        for name, values in channels_with_own(trajectory).items():
            held = root.create_dataset(name, data=values, compression="gzip", shuffle=True)
            held.attrs["units"], held.attrs["description"] = CHANNEL_UNITS[name], CHANNEL_BY_NAME[name].description
            held.dims[0].attach_scale(time)
            for k, label in enumerate(CHANNEL_BY_NAME[name].dimensions):
                held.dims[k].label = label
        root.flush()
        file.write(root.id.get_file_image())


def _write_matlab(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes a trajectory as MATLAB's format 5: a variable a channel, `units`."""
    from scipy.io import savemat

    channels = channels_with_own(trajectory)
    held: dict[str, Any] = {"time": trajectory.time[:, None], **channels}
    for kind, parts in _bodies_by_kind(trajectory.drive).items():
        held[f"{kind}s"] = np.array([part.name for part in parts], dtype=object)
    held["units"] = {name: CHANNEL_UNITS[name] for name in ("time", *channels)}
    savemat(file, held, do_compression=True)


TRAJECTORY_WRITERS: dict[str, Callable[[IO[bytes], Trajectory], None]] = {
    ".npz": _write_npz,
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".h5": _write_hdf5,
    ".hdf5": _write_hdf5,
    ".mat": _write_matlab,
    ".unv": write_universal_file,
    ".uff": write_universal_file,
    ".mf4": write_mdf4,
}
WRITER_EXTRAS = {".h5": "hdf5", ".hdf5": "hdf5", ".unv": "uff", ".uff": "uff", ".mf4": "mdf"}
