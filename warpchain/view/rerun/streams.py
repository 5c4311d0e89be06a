"""Rerun streams: columns sent from numpy arrays, recordings as files (.rrd)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.files import refusals_as_errors, whole_file

if TYPE_CHECKING:
    import pyarrow as pa
    import rerun as rr

TIMELINE = "sim_time"


@dataclass(frozen=True)
class ComponentValues:
    """Values of a Rerun component at each time of `send_columns`."""

    descriptor: Any
    array: pa.Array

    def component_descriptor(self) -> Any:
        """Rerun's descriptor of the component."""
        return self.descriptor

    def as_arrow_array(self) -> pa.Array:
        """Arrow array of the component's elements, a list a time."""
        return self.array


def flipped_points(points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Points (..., 2) [m] with y downward, as in Rerun's 2D views."""
    out = np.empty(points.shape, dtype=np.float32)
    out[..., 0] = points[..., 0]
    np.negative(points[..., 1], out=out[..., 1], casting="same_kind")
    return out


def list_array(elements: pa.Array, lengths: int | NDArray[np.intp], count: int | None = None) -> pa.Array:
    """Arrow array for Rerun streams of elements in `count` lists."""
    import pyarrow as pa

    if isinstance(lengths, int):
        assert count is not None
        offsets = np.arange(count + 1, dtype=np.int32) * lengths
    else:
        offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), elements)


def vector_array(values: NDArray[np.float32]) -> pa.Array:
    """Arrow array for Rerun streams of D-vectors from floats (..., D)."""
    import pyarrow as pa

    kind = pa.list_(pa.field("item", pa.float32(), nullable=False), values.shape[-1])
    return pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(values, np.float32).ravel()), type=kind)


def line_strip_array(points: NDArray[np.float32]) -> pa.Array:
    """Arrow array for Rerun streams of line strips from floats (..., P, 2)."""
    import pyarrow as pa

    inner = vector_array(points)
    count, length = points.size // (2 * points.shape[-2]), points.shape[-2]
    kind = pa.list_(pa.field("item", inner.type, nullable=False))
    offsets = pa.array(np.arange(count + 1, dtype=np.int32) * length, pa.int32())
    return pa.ListArray.from_arrays(offsets, inner, type=kind)


def send_columns(
    stream: rr.RecordingStream,
    path: str,
    time: NDArray[np.floating],
    columns: Sequence[ComponentValues | rr.ComponentColumn],
) -> None:
    """Sends components' values at simulated times [s] to a Rerun stream."""
    import rerun as rr

    held: Any = list(columns)
    stream.send_columns(path, [rr.TimeColumn(TIMELINE, duration=np.asarray(time, dtype=float))], held, strict=True)


def entity_path(*parts: str) -> str:
    """Path of a Rerun entity from parts, which may hold blanks."""
    import rerun as rr

    return rr.new_entity_path(list(parts))


@contextmanager
def stream_to_file(stream: rr.RecordingStream, target: Path, error: type[Exception]) -> Iterator[None]:
    """Context that writes what is logged to a Rerun recording (.rrd), whole or not at all.

    Raises:
        error: another writer, or a folder or disk that refuses, in one line.
    """
    import rerun as rr

    with refusals_as_errors(target, error), whole_file(target) as file:
        sink = rr.binary_stream(stream)
        yield
        stream.flush()
        file.write(sink.read() or b"")
        stream.disconnect()
