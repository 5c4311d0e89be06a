"""Measured signals of MAT and MDF4 files, read in a process of their own.

A damaged file can end the process that reads it, take all memory, or never end.
"""

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
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from warpchain.errors import SimulationError
from warpchain.extras import require_extra
from warpchain.files import open_regular_file, refusal_reason
from warpchain.python_process import can_start_python, start_python
from warpchain.results.measured_columns import MeasuredColumn, MeasuredColumns, column_index, require_finite_values

MOST_SIGNAL_VALUES = 2**25
MOST_MEMORY = 2**33
"""Address space of the reading process [bytes]."""
MOST_READING_TIME = 300.0
"""Time for reading a file [s]."""
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
_MDF_TIME_CHANNELS = ("time", "t", "Time")
"""Channels of MDF4 that are other channels' time."""


def read_binary_columns(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Columns of time and values of a MAT or MDF4 file, read in a process of its own where possible.

    Raises:
        SimulationError: as `read_binary_columns_here`, or a file at which that process ended.
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
    """Columns of time and values of a MAT or MDF4 file, read in this process.

    Raises:
        SimulationError: a file or column that is not understood, too many values, or no package asammdf.
    """
    time, signal = (_columns_from_mat if Path(path).suffix.lower() == ".mat" else _columns_from_mdf)(path, columns)
    if len(time[2]) != len(signal[2]):
        raise SimulationError(f"{path}: {signal[0]} has {len(signal[2])} values, {time[0]} {len(time[2])}")
    return time, signal


@contextlib.contextmanager
def _convert_file_errors(path: str | Path, words: str) -> Iterator[None]:
    """Turns what keeps a file from being read into a SimulationError; `words` are for damage."""
    try:
        yield
    except SimulationError:
        raise
    except OSError as error:
        raise SimulationError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # of many kinds, where a file is damaged
        raise SimulationError(f"{path}: {words} ({refusal_reason(error)})") from None


def _columns_from_mat(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Columns of time and values of a MAT file."""
    from scipy.io import loadmat, whosmat

    with (
        _convert_file_errors(path, "is not a MAT file of version 4 to 7.2"),
        open(open_regular_file(path), "rb") as file,
    ):
        listed = whosmat(file)
        twice = [name for name, count in Counter(name for name, *_ in listed).items() if count > 1]
        if twice:
            raise SimulationError(f"{path}: variable {twice[0]!r} stands twice: must stand once; rename one of the two")
        lengths = {
            name: math.prod(shape)
            for name, shape, kind in listed
            if kind in _MAT_NUMBER_CLASSES and math.prod(shape) == max(shape, default=0) > 1
        }
        names = [(name, name) for name in lengths]
        at = column_index(path, names, columns.time, 0, "time")
        of = column_index(path, names, columns.column, 1 if at == 0 else 0)
        wanted = [names[at][0], names[of][0]]
        for name in wanted:
            _check_value_count(path, name, lengths[name])
        file.seek(0)
        held = loadmat(file, variable_names=wanted)
        found = [np.asarray(held[name]).ravel() for name in wanted]
    for name, values in zip(wanted, found, strict=True):
        if values.dtype.kind not in "iuf":
            raise SimulationError(f"{path}: variable {name!r}: must hold real numbers")
    time, signal = (
        (name, "", require_finite_values(path, name, values.astype(float)))
        for name, values in zip(wanted, found, strict=True)
    )
    return time, signal


def _check_value_count(path: str | Path, name: str, count: int) -> None:
    """Refuses more values than a signal may have, before they are read."""
    if count > MOST_SIGNAL_VALUES:
        raise SimulationError(f"{path}: {name} has {count} values; allowed are at most {MOST_SIGNAL_VALUES}")


def _columns_from_mdf(path: str | Path, columns: MeasuredColumns) -> tuple[MeasuredColumn, MeasuredColumn]:
    """Columns of time and values of an MDF4 file."""
    require_extra("mdf", "MDF4", SimulationError)
    import asammdf

    with _convert_file_errors(path, "is not MDF4"):
        os.close(open_regular_file(path))
        with asammdf.MDF(path) as mdf:
            places = [
                (name, *at)
                for name, all_of in mdf.channels_db.items()
                for at in all_of
                if name not in _MDF_TIME_CHANNELS
            ]
            names = [(name, f"{name} of group {group}") for name, group, _ in places]
            name, group, channel = places[column_index(path, names, columns.column, 0)]
            _check_value_count(path, name, mdf.groups[group].channel_group.cycles_nr)
            signal = mdf.get(name, group, channel)
    if getattr(signal.samples, "dtype", np.dtype(object)).kind not in "iuf" or signal.samples.ndim != 1:
        raise SimulationError(f"{path}: channel {name!r}: must hold numbers")
    time = require_finite_values(path, "time", np.asarray(signal.timestamps, dtype=float))
    return ("time", "s", time), (
        name,
        signal.unit or "",
        require_finite_values(path, name, signal.samples.astype(float)),
    )


def answer_read_request() -> None:
    """Reads the file that standard input names, in bounded memory, and answers on standard output."""
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
    """Bounds this process's memory, and lets it leave no image."""
    with contextlib.suppress(ImportError, OSError, ValueError):  # a system without such bounds
        import resource

        for what, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, MOST_MEMORY)):
            hard = resource.getrlimit(what)[1]
            resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


if __name__ == "__main__":
    answer_read_request()
