"""Export of loads on the housing for acoustics codes: Universal File Format (datasets 15, 58, 164) and MDF4."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from warpchain.results.channels import CHANNEL_BY_NAME
from warpchain.results.housing import housing_components, housing_loads
from warpchain.version import installed_version

if TYPE_CHECKING:
    from warpchain.results.run import Trajectory

UFF_FORCE, UFF_TIME, UFF_TIME_RESPONSE, UFF_MOMENT_ABOUT_Z = 13, 17, 1, 6


def write_universal_file(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes housing loads as a Universal File: a node a place, a function a component."""
    import pyuff

    time, loads = np.asarray(trajectory.time, dtype=float), housing_loads(trajectory)
    nodes, places = list(range(1, len(loads) + 1)), np.array([load.place for load in loads]).reshape(-1, 2)
    zeros = [0] * len(loads)
    common: dict[str, Any] = {
        "binary": 1, "func_type": UFF_TIME_RESPONSE, "id2": installed_version(), "id3": "on the housing", "id4": "NONE",
        "id5": "NONE", "rsp_ent_name": "housing", "ref_ent_name": "NONE", "ref_node": 0, "ref_dir": 0, "x": time,
        "ord_data_type": 4, "abscissa_spacing": 1, "abscissa_spec_data_type": UFF_TIME, "abscissa_axis_units_lab": "s",
        "ordinate_spec_data_type": UFF_FORCE, "ordinate_force_unit_exp": 1, "orddenom_spec_data_type": 0,
    }  # fmt: skip
    sets: list[Any] = [
        pyuff.prepare_164(1, "SI", temp_mode=1, length=1.0, force=1.0, temp=1.0, temp_offset=0.0),
        pyuff.prepare_15(nodes, zeros, zeros, zeros, *places.T, np.zeros(len(loads))),
    ]
    for node, load in zip(nodes, loads, strict=True):
        parts = {1: ("x", "N", load.force[:, 0]), 2: ("y", "N", load.force[:, 1])}
        if load.moment is not None:
            parts[UFF_MOMENT_ABOUT_Z] = ("moment", "N m", load.moment)
        for direction, (axis, unit, values) in parts.items():
            own = {"id1": f"{load.name} {axis}"[:80], "rsp_node": node, "rsp_dir": direction}
            own |= {"ordinate_axis_units_lab": unit, "ordinate_len_unit_exp": int(direction == UFF_MOMENT_ABOUT_Z)}
            sets.append(pyuff.prepare_58(**common, **own, data=np.ascontiguousarray(values, dtype=float)))
    _copy_written_file(file, ".unv", lambda path: pyuff.UFF(str(path)).write_sets(sets, "overwrite"))


def _mdf_signals(trajectory: Trajectory) -> Iterator[tuple[str, str, Any]]:
    """Name, unit and values of MDF4 signals: housing loads, sprockets' motion."""
    for name, values in housing_components(trajectory).items():
        yield name, "N*m" if name.endswith(".moment") else "N", values
    for channel in ("sprocket_angle", "sprocket_speed"):
        held = getattr(trajectory, channel)
        for s, sprocket in enumerate(trajectory.drive.sprockets):
            yield f"{channel}.{sprocket.name}", CHANNEL_BY_NAME[channel].unit, held[:, s]


def write_mdf4(file: IO[bytes], trajectory: Trajectory) -> None:
    """Writes housing loads, and sprockets' angles and speeds, as MDF4."""
    import asammdf

    time = np.asarray(trajectory.time, dtype=float)
    signals = [
        asammdf.Signal(np.ascontiguousarray(values, dtype=float), time, unit=unit, name=name)
        for name, unit, values in _mdf_signals(trajectory)
    ]
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append(signals, acq_name="loads on the housing", comment=installed_version(), common_timebase=True)
        _copy_written_file(file, ".mf4", lambda path: mdf.save(path, overwrite=True, compression=2))


def _copy_written_file(file: IO[bytes], ending: str, write: Any) -> None:
    """Copies what a library writes into an export's file; raises OSError."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"loads{ending}"
        try:
            write(path)
        except Exception as error:
            cause: BaseException | None = error
            while cause is not None and not isinstance(cause, OSError):
                cause = cause.__context__
            if cause is None:
                raise
            raise cause from None
        with path.open("rb") as written:
            shutil.copyfileobj(written, file)
