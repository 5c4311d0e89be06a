"""Writing an MCAP archive: recorded variants frame by frame, their drives, the metrics, and how the run was made.

The layout is described in `docs/archive.md`. A file appears under its name only when it is whole: it is written under a
temporary name in the same folder, flushed to the disk and renamed.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from warpchain import archive_schema as schema
from warpchain.archive_read import read_archive
from warpchain.drive import Drive, dumps_drive
from warpchain.errors import ArchiveError
from warpchain.record import CHANNELS, Run, RunInfo, Trajectory

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ArchiveWriter", "read_archive", "write_archive"]

COMPRESSIONS = ("zstd", "lz4", "none")
JOINT_ARRAYS = {"position": "sprocket_angle", "velocity": "sprocket_speed", "effort": "sprocket_moment"}
"""Channel of a trajectory that each array of a JointState carries."""
COLOR_PERCENTILE = 99.9
"""Percentile of the first chunk's tension that the color scale ends at."""


def _refused(path: Path, error: OSError) -> ArchiveError:
    return ArchiveError(f"{path}: cannot be written ({error.strerror or error})")


class ArchiveWriter:
    """Writes an archive while a run goes on.

    Args:
        path: the file to write.
        drives: all drives of the run.
        recorded: indices of the variants that frames will come for.
        info: how the run is made; `finish` tells how it ended.
        compression: of the chunks, "zstd", "lz4" or "none".
        overwrite: replace a file of that name.

    Raises:
        ArchiveError: an existing file, a folder that cannot be written, an unknown compression, a full disk.
    """

    def __init__(
        self,
        path: str | Path,
        drives: Sequence[Drive],
        recorded: Sequence[int],
        info: RunInfo,
        compression: str = "zstd",
        overwrite: bool = False,
    ) -> None:
        from mcap.writer import CompressionType, Writer

        self.path, self.overwrite = Path(path), overwrite
        if compression not in COMPRESSIONS:
            raise ArchiveError(f'compression = {compression!r}: allowed are "zstd", "lz4" and "none"')
        self._check_free()
        self._partial = self.path.with_name(f".{self.path.name}.{os.getpid()}.partial")
        self._tracks: dict[int, _Track] = {}
        self._schemas: dict[str, int] = {}
        try:
            self._stream: io.BufferedWriter | None = self._partial.open("wb")
        except OSError as error:
            raise _refused(self.path, error) from None
        kind = getattr(CompressionType, compression.upper())
        self._writer = Writer(self._stream, chunk_size=2**20, compression=kind)
        self._drives, self._recorded = tuple(drives), tuple(recorded)
        try:
            self._begin(info)
        except OSError as error:
            self.abort()
            raise _refused(self.path, error) from None

    def _check_free(self) -> None:
        if self.path.is_dir():
            raise ArchiveError(f"{self.path}: is a folder; give a file name such as {self.path / 'run.mcap'}")
        if self.path.exists() and not self.overwrite:
            raise ArchiveError(f"{self.path}: exists already; give another name, or --overwrite (overwrite=True)")

    def _begin(self, info: RunInfo) -> None:
        self._writer.start(profile="", library=f"warpchain {info.version}")
        head = {
            "format_version": schema.FORMAT_VERSION,
            "variants": str(len(self._drives)),
            "recorded": " ".join(map(str, self._recorded)),
        }
        made = {name: str(value) for name, value in asdict(info).items() if name not in ("ended", "wall_time")}
        self._writer.add_metadata(schema.RUN_METADATA, head | made)
        for variant, drive in enumerate(self._drives):
            text = dumps_drive(drive).encode()
            self._writer.add_attachment(0, 0, schema.drive_attachment(variant), "application/toml", text)

    def append(self, variant: int, chunk: Trajectory) -> None:
        """Appends consecutive frames of one variant.

        Raises:
            ArchiveError: a disk that is full or gone.
        """
        try:
            if variant not in self._tracks:
                self._tracks[variant] = _Track(self._writer, self._schemas, variant, chunk)
            self._tracks[variant].write(chunk)
        except OSError as error:
            raise _refused(self.path, error) from None

    def finish(self, metrics: pa.Table, info: RunInfo) -> None:
        """Ends the archive and gives it its name.

        Args:
            metrics: one row a variant.
            info: how the run was made and ended.

        Raises:
            ArchiveError: a disk that is full or gone, or a file that has appeared under that name.
        """
        assert self._stream is not None
        try:
            for track in self._tracks.values():
                track.finish()
            self._writer.add_attachment(
                0, 0, schema.METRICS_ATTACHMENT, "application/vnd.apache.arrow.file", _arrow_bytes(metrics)
            )
            self._writer.add_metadata(
                schema.END_METADATA, {"ended": info.ended, "wall_time": repr(float(info.wall_time))}
            )
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
            self._stream.close()
            self._stream = None
            self._check_free()
            self._partial.replace(self.path)
            _sync_folder(self.path.parent)
        except OSError as error:
            raise _refused(self.path, error) from None

    def abort(self) -> None:
        """Drops what was written."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None
        self._partial.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream is not None:
            self.abort()


def _sync_folder(folder: Path) -> None:
    """Flushes a folder's entries, where the system lets one."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _arrow_bytes(table: pa.Table) -> bytes:
    import pyarrow as pa

    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as file:
        file.write_table(table)
    return bytes(sink.getvalue())


class _Track:
    """The topics of one recorded variant."""

    def __init__(self, writer: Any, schemas: dict[str, int], variant: int, chunk: Trajectory) -> None:
        self.writer, self.schemas, self.variant, self.frames = writer, schemas, variant, 0
        self.channels = frozenset(chunk.channels())
        held = next(iter(chunk.channels().values()), chunk.time)
        self.precision = str(held.dtype)
        self.layout = schema.roller_layout(self.channels, self.precision)
        self.constant = schema.point_cloud_constant(self.layout)
        self.full_scale = _full_scale(chunk)
        self.arrays = {array: name for array, name in JOINT_ARRAYS.items() if name in self.channels}
        names = [sprocket.name for sprocket in chunk.drive.sprockets]
        self.template, self.offsets, self.stamp = schema.joint_state_template(names, list(self.arrays))
        topics = schema.variant_topics(variant)
        cloud, state = schema.message_type("foxglove.PointCloud"), schema.message_type("warpchain.State")
        self.state = state
        self.rollers_id = self._channel(topics.rollers, "foxglove.PointCloud", "protobuf", schema.schema_bytes(cloud))
        self.state_id = self._channel(topics.state, "warpchain.State", "protobuf", schema.schema_bytes(state))
        joint = schema.JOINT_STATE.encode()
        self.joints_id = self._channel(topics.sprockets, "sensor_msgs/msg/JointState", "ros2msg", joint)

    def _channel(self, topic: str, name: str, encoding: str, data: bytes) -> int:
        if name not in self.schemas:
            self.schemas[name] = self.writer.register_schema(name=name, encoding=encoding, data=data)
        message = "cdr" if encoding == "ros2msg" else "protobuf"
        return int(self.writer.register_channel(topic=topic, message_encoding=message, schema_id=self.schemas[name]))

    def write(self, chunk: Trajectory) -> None:
        """Writes frames."""
        points = self._points(chunk)
        joints = {array: np.asarray(getattr(chunk, name), dtype="<f8") for array, name in self.arrays.items()}
        stamps = np.rint(chunk.time * 1e9).astype(np.int64)
        for frame, (time, stamp) in enumerate(zip(chunk.time.tolist(), stamps.tolist(), strict=True)):
            data = points[frame].tobytes()
            body = schema.timestamp_bytes(stamp) + self.constant + schema.data_bytes(data)
            self._message(self.rollers_id, stamp, body)
            self._message(self.state_id, stamp, self._state(chunk, frame, time))
            if self.arrays:
                joint = bytearray(self.template)
                struct.pack_into("<iI", joint, self.stamp, stamp // 10**9, stamp % 10**9)
                for array, offset in self.offsets.items():
                    values = joints[array][frame].tobytes()
                    joint[offset : offset + len(values)] = values
                self._message(self.joints_id, stamp, bytes(joint))
        self.frames += len(chunk.time)

    def _message(self, channel: int, stamp: int, data: bytes) -> None:
        self.writer.add_message(channel, log_time=stamp, publish_time=stamp, data=data)

    def _points(self, chunk: Trajectory) -> NDArray[Any]:
        """(frames, rollers) packed rollers."""
        points = np.zeros((len(chunk.time), chunk.drive.chain.links), dtype=self.layout)
        for channel, parts in schema.ROLLER_FIELDS.items():
            values = getattr(chunk, channel)
            if values is not None:
                for k, part in enumerate(parts):
                    points[part] = values[..., k] if len(parts) > 1 else values
        tension = chunk.tension if chunk.tension is not None else np.full(points.shape, np.nan)
        colors = schema.tension_color(tension, self.full_scale)
        for k, field in enumerate(schema.COLOR_FIELDS):
            points[field] = colors[..., k]
        return points

    def _state(self, chunk: Trajectory, frame: int, time: float) -> bytes:
        """The frame's exact time and sprocket values."""
        state = self.state(time=time)
        for name in ("sprocket_angle", "sprocket_speed", "sprocket_moment"):
            values = getattr(chunk, name)
            if values is not None:
                getattr(state, name).extend(values[frame].tolist())
        if chunk.sprocket_center is not None:
            state.sprocket_center_x.extend(chunk.sprocket_center[frame, :, 0].tolist())
            state.sprocket_center_y.extend(chunk.sprocket_center[frame, :, 1].tolist())
        return bytes(state.SerializeToString())

    def finish(self) -> None:
        """Notes what the topics hold."""
        self.writer.add_metadata(
            schema.variant_metadata(self.variant),
            {
                "frames": str(self.frames),
                "channels": " ".join(name for name in CHANNELS if name in self.channels),
                "precision": self.precision,
                "color_tension_max": repr(self.full_scale),
            },
        )


def _full_scale(chunk: Trajectory) -> float:
    """Where the color scale ends [N]."""
    if chunk.tension is None or not np.isfinite(chunk.tension).any():
        return 1.0
    return max(float(np.nanpercentile(chunk.tension, COLOR_PERCENTILE)), 1.0)


def write_archive(run: Run, path: str | Path, overwrite: bool = False, compression: str = "zstd") -> Path:
    """Writes a run to an MCAP archive.

    Args:
        run: what `simulate` returned.
        path: the file to write; it appears under this name only when whole.
        overwrite: replace a file of that name.
        compression: "zstd", "lz4" or "none".

    Returns:
        The file written.

    Raises:
        ArchiveError: an existing file, an unknown compression, a folder or disk that refuses.
    """
    with ArchiveWriter(path, run.drives, list(run), run.info, compression, overwrite) as writer:
        for variant in run:
            writer.append(variant, run[variant])
        writer.finish(run.metrics, run.info)
    return Path(path)
