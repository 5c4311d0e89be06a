"""Measured signals of MAT, MDF and TDMS files, read in a process of their own, which damage can end."""

from __future__ import annotations

import contextlib
import json
import math
import os
import pickle
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.errors import SimulationError
from warpchain.extras import require_extra
from warpchain.files import open_regular_file, refusal_reason
from warpchain.python_process import can_start_python, start_python
from warpchain.results.measured_columns import MeasuredColumn, MeasuredColumns, column_index, require_bounded_values

MOST_SIGNAL_VALUES = 2**25
MOST_MEMORY = 2**33
MOST_READING_TIME = 300.0
_MAT_NUMBER_CLASSES = (
    "int8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
    "single",
    "double",
    "logical",
)
_TIME_CHANNELS = ("time", "t", "Time")
_HDF5_HEAD, _HDF5_PLACE = b"\x89HDF\r\n\x1a\n", 512


def read_binary_columns(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of a binary file, read in another process.

    Raises:
        SimulationError: as of `read_binary_columns_here`, or a file at which that process ended.
    """
    if not can_start_python():
        return read_binary_columns_here(path, columns)
    with start_python(__name__, subprocess.PIPE) as process:
        try:
            answer, _ = process.communicate(pickle.dumps((os.fspath(path), columns)), MOST_READING_TIME)
        except subprocess.TimeoutExpired:
            process.kill()
            raise SimulationError(
                f"{path}: cannot be read: reading it takes more than {MOST_READING_TIME:g} s"
            ) from None
        except BaseException:
            process.kill()
            raise
    status = process.returncode
    if status or not answer:
        end = f"exit status {status}" if status >= 0 else f"signal {-status}, {signal.strsignal(-status)}"
        raise SimulationError(f"{path}: cannot be read: the process that read it ended ({end}); it is damaged")
    line, _, data = answer.partition(b"\n")
    words = json.loads(line)
    if len(words) == 1:
        raise SimulationError(*words)
    time, values = np.array(memoryview(data).cast("d")).reshape(2, -1)
    return (words[0], words[1], time), (words[2], words[3], values)


def read_binary_columns_here(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of a binary file.

    Raises:
        SimulationError: a file or column not understood, too many values, or a missing package.
    """
    time, signal = COLUMN_READERS[Path(path).suffix.lower()](path, columns)
    if len(time[2]) != len(signal[2]):
        raise SimulationError(f"{path}: {signal[0]} has {len(signal[2])} values, {time[0]} {len(time[2])}")
    return time, signal


@contextlib.contextmanager
def _convert_file_errors(path: str | Path, words: str) -> Iterator[None]:
    """Context that turns a measured file's errors into SimulationError."""
    try:
        yield
    except SimulationError:
        raise
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # of many kinds, where a file is damaged
        raise SimulationError(f"{path}: {words} ({refusal_reason(error)})") from None


def _columns_from_mat(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of a MAT file."""
    from scipy.io import loadmat, whosmat

    with _convert_file_errors(path, "is not a MAT file"), open(open_regular_file(path), "rb") as file:
        if file.read(_HDF5_PLACE + len(_HDF5_HEAD))[_HDF5_PLACE:] == _HDF5_HEAD:
            return _columns_from_mat_of_hdf5(path, columns)
        file.seek(0)
        listed = whosmat(file)
        twice = [name for name, count in Counter(name for name, *_ in listed).items() if count > 1]
        if twice:
            raise SimulationError(f"{path}: variable {twice[0]!r} stands twice: must stand once; rename one of the two")
        lengths = {
            name: math.prod(shape)
            for name, shape, kind in listed
            if kind in _MAT_NUMBER_CLASSES and math.prod(shape) == max(shape, default=0) > 1
        }
        wanted = _names_of_vectors(path, columns, lengths)
        file.seek(0)
        held = loadmat(file, variable_names=wanted)
        found = [np.asarray(held[name]).ravel() for name in wanted]
    time, signal = (_column_of_variable(path, name, values) for name, values in zip(wanted, found, strict=True))
    return time, signal


def _names_of_vectors(path: str | Path, columns: MeasuredColumns, lengths: dict[str, int]) -> list[str]:
    """Names of time and values among a MAT file's vectors."""
    names = [(name, name) for name in lengths]
    at = column_index(path, names, columns.time, 0, "time")
    of = column_index(path, names, columns.column, (at + 1) % max(len(names), 2))
    wanted = [names[at][0], names[of][0]]
    for name in wanted:
        _check_value_count(path, name, lengths[name])
    return wanted


def _column_of_variable(path: str | Path, name: str, values: np.ndarray) -> MeasuredColumn:
    """Measured column of a MAT variable."""
    if values.dtype.kind not in "iuf":
        raise SimulationError(f"{path}: variable {name!r}: must hold real numbers")
    return name, "", require_bounded_values(path, name, values.astype(float))


def _columns_from_mat_of_hdf5(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of a MAT file 7.3."""
    require_extra("hdf5", f"{path}: MAT of version 7.3", SimulationError)
    import h5py

    with h5py.File(path, "r") as file:
        kinds = {name: variable.attrs.get("MATLAB_class", b"") for name, variable in file.items()}
        lengths = {
            name: math.prod(file[name].shape)
            for name, kind in kinds.items()
            if isinstance(file.get(name, getlink=True), h5py.HardLink)
            and isinstance(file[name], h5py.Dataset)
            and bytes(kind).decode(errors="replace") in _MAT_NUMBER_CLASSES
            and "MATLAB_empty" not in file[name].attrs
            and math.prod(file[name].shape) == max(file[name].shape, default=0) > 1
        }
        wanted = _names_of_vectors(path, _named_columns(path, columns, list(lengths)), lengths)
        time, signal = (_column_of_variable(path, name, np.asarray(file[name]).ravel()) for name in wanted)
    return time, signal


def _named_columns(path: str | Path, columns: MeasuredColumns, names: list[str]) -> MeasuredColumns:
    """Columns by name, of a measured file without order.

    Raises:
        SimulationError: it is not clear which these are.
    """
    time = columns.time or _only_name(path, "time", [name for name in names if name in _TIME_CHANNELS], names)
    others = [name for name in names if name != time]
    return replace(columns, time=time, column=columns.column or _only_name(path, "column", others, names))


def _only_name(path: str | Path, option: str, found: list[str], names: list[str]) -> str:
    """Only name that a measured file has of a kind."""
    if len(found) != 1:
        raise SimulationError(f"{path}: its variables have no order: say --{option}, one of {', '.join(names)}")
    return found[0]


def _check_value_count(path: str | Path, name: str, count: int) -> None:
    """Raises SimulationError for too long a measured column."""
    if count > MOST_SIGNAL_VALUES:
        raise SimulationError(f"{path}: {name} has {count} values; allowed are at most {MOST_SIGNAL_VALUES}")


def _columns_from_mdf(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of an MDF file."""
    require_extra("mdf", f"{path}: MDF", SimulationError)
    import asammdf

    with _convert_file_errors(path, "is not MDF"):
        os.close(open_regular_file(path))
        with asammdf.MDF(path) as mdf:
            places = [
                (name, *at) for name, all_of in mdf.channels_db.items() for at in all_of if name not in _TIME_CHANNELS
            ]
            names = [(name, f"{name} of group {group}") for name, group, _ in places]
            name, group, channel = places[column_index(path, names, columns.column, 0)]
            _check_value_count(path, name, mdf.groups[group].channel_group.cycles_nr)
            signal = mdf.get(name, group, channel)
    if getattr(signal.samples, "dtype", np.dtype(object)).kind not in "iuf" or signal.samples.ndim != 1:
        raise SimulationError(f"{path}: channel {name!r}: must hold numbers")
    values = signal.samples.astype(float)
    if signal.invalidation_bits is not None:
        values[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
    time = require_bounded_values(path, "time", np.asarray(signal.timestamps, dtype=float))
    return ("time", "s", time), (name, signal.unit or "", require_bounded_values(path, name, values))


def _columns_from_tdms(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Time and value columns of a TDMS file."""
    require_extra("tdms", f"{path}: TDMS", SimulationError)
    import nptdms

    with (
        _convert_file_errors(path, "is not TDMS"),
        open(open_regular_file(path), "rb") as file,
        nptdms.TdmsFile.open(file) as tdms,
    ):
        channels = [channel for group in tdms.groups() for channel in group.channels()]
        names = [(channel.name, f"{channel.name} of group {channel.group_name}") for channel in channels]
        at = None if columns.time is None else column_index(path, names, columns.time, 0, "time")
        of = column_index(path, names, columns.column, 0 if at is None else (at + 1) % max(len(names), 2))
        wanted = [channels[k] for k in ([of] if at is None else [of, at])]
        for channel in wanted:
            _check_value_count(path, channel.name, len(channel))
        words = wanted[0].properties
        if at is None and not float(words.get("wf_increment", 0.0)) > 0.0:
            raise SimulationError(
                f"{path}: channel {wanted[0].name!r} has no time of its own (wf_increment): say --time, one of "
                f"{', '.join(name for name, _ in names)}"
            )
        found = [_column_of_channel(path, channel) for channel in wanted]
        if at is None:
            step = np.arange(len(wanted[0]), dtype=float)
            time = float(words.get("wf_start_offset", 0.0)) + float(words["wf_increment"]) * step
            found.append(("time", "s", require_bounded_values(path, "time", time)))
    return found[1], found[0]


def _column_of_channel(path: str | Path, channel: Any) -> MeasuredColumn:
    """Measured column of a TDMS channel, instants in seconds."""
    values, words = np.asarray(channel[:]), channel.properties
    if values.dtype.kind == "M" and len(values):
        values = (values - values[0]) / np.timedelta64(1, "s")
        return channel.name, "s", require_bounded_values(path, channel.name, values)
    if values.dtype.kind not in "iuf":
        raise SimulationError(f"{path}: channel {channel.name!r}: must hold numbers")
    unit = str(words.get("unit_string") or words.get("NI_UnitDescription") or "")
    return channel.name, unit, require_bounded_values(path, channel.name, values.astype(float))


COLUMN_READERS: dict[str, Callable[[str | Path, MeasuredColumns], tuple[MeasuredColumn, MeasuredColumn]]] = {
    ".mat": _columns_from_mat,
    ".mf4": _columns_from_mdf,
    ".mdf": _columns_from_mdf,
    ".tdms": _columns_from_tdms,
}


def answer_read_request() -> None:
    """Reads the measured file named on standard input, and answers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who asks ends it
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        path, columns = pickle.load(sys.stdin.buffer)
        _limit_memory()
        try:
            columns_read = read_binary_columns_here(path, columns)
            words, data = [word for *both, _ in columns_read for word in both], [values for *_, values in columns_read]
        except SimulationError as error:
            words, data = [str(error)], []
        answers.write(json.dumps(words).encode() + b"\n")
        for values in data:
            answers.write(np.ascontiguousarray(values).data)


def _limit_memory() -> None:
    """Bounds the memory of this process, and forbids core dumps."""
    with contextlib.suppress(ImportError, OSError, ValueError):  # a system without such bounds
        import resource

        for what, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, MOST_MEMORY)):
            hard = resource.getrlimit(what)[1]
            resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


if __name__ == "__main__":
    answer_read_request()
