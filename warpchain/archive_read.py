"""Reading an MCAP archive back: drives, metrics, how the run was made, and each variant's trajectory when asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain import archive_schema as schema
from warpchain.drive import Drive, loads_drive
from warpchain.errors import ArchiveError, DriveError
from warpchain.record import Run, RunInfo, Trajectory

if TYPE_CHECKING:
    import pyarrow as pa


def read_archive(path: str | Path) -> Run:
    """Opens an archive.

    Drives, metrics and metadata are read at once; a variant's trajectory is read when it is first asked for, bitwise as
    it was written.

    Args:
        path: an MCAP file written by warpchain.

    Returns:
        The run; `run[i]` for each recorded variant.

    Raises:
        ArchiveError: a file that is missing, not an MCAP, cut short, damaged, or not warpchain's; one line.
    """
    file = Path(path)
    with _Reader(file) as reader:
        head = reader.metadata(schema.RUN_METADATA)
        if head is None:
            raise ArchiveError(f"{file}: an MCAP file, but not an archive of warpchain")
        if head.get("format_version") != schema.FORMAT_VERSION:
            raise ArchiveError(
                f"{file}: archive format {head.get('format_version')!r} is not known to this version "
                f"(it reads {schema.FORMAT_VERSION!r})"
            )
        end = reader.metadata(schema.END_METADATA) or {"ended": "cut short", "wall_time": "0"}
        drives = reader.drives(int(head["variants"]))
        metrics = reader.metrics()
        info = RunInfo(
            version=head["version"],
            device=head["device"],
            precision=head["precision"],
            created=head["created"],
            ended=end["ended"],
            wall_time=float(end["wall_time"]),
        )
        tracks = {int(v): reader.metadata(schema.variant_metadata(int(v))) for v in head["recorded"].split()}
    present = {v: track for v, track in tracks.items() if track is not None}
    return Run(drives, metrics, _Trajectories(file, drives, present), info)


class _Trajectories(Mapping[int, Trajectory]):
    """Recorded variants, read on first access."""

    def __init__(self, path: Path, drives: tuple[Drive, ...], tracks: dict[int, dict[str, str]]) -> None:
        self._path, self._drives, self._tracks = path, drives, tracks
        self._read: dict[int, Trajectory] = {}

    def __iter__(self) -> Iterator[int]:
        return iter(self._tracks)

    def __len__(self) -> int:
        return len(self._tracks)

    def __getitem__(self, variant: int) -> Trajectory:
        if variant not in self._read:
            track = self._tracks[variant]
            with _Reader(self._path) as reader:
                self._read[variant] = reader.trajectory(variant, self._drives[variant], track)
        return self._read[variant]


class _Reader:
    """An open MCAP file; every failure of its bytes becomes one line."""

    def __init__(self, path: Path) -> None:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader

        self.path = path
        try:
            self._stream = path.open("rb")
        except OSError as error:
            raise ArchiveError(f"{path}: cannot be read ({error.strerror})") from None
        try:
            self._reader = make_reader(self._stream, validate_crcs=True)
            self._summary = self._reader.get_summary()
        except (McapError, ValueError, EOFError, OSError) as error:
            self._stream.close()
            raise self._broken(error) from None
        if self._summary is None:
            self._stream.close()
            raise ArchiveError(f"{path}: is cut short (no summary at its end)")

    def _broken(self, error: Exception) -> ArchiveError:
        self_magic = b"\x89MCAP0\r\n"
        with self.path.open("rb") as stream:
            whole = stream.read(len(self_magic)) == self_magic
        if not whole:
            return ArchiveError(f"{self.path}: is not an MCAP file")
        return ArchiveError(f"{self.path}: is damaged or cut short ({type(error).__name__}: {error})")

    def __enter__(self) -> _Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def metadata(self, name: str) -> dict[str, str] | None:
        """A metadata record, or None."""
        for index in self._summary.metadata_indexes:  # type: ignore[union-attr]
            if index.name == name:
                record = self._record(index.offset)
                return dict(record.metadata)
        return None

    def _record(self, offset: int) -> Any:
        """The record at an offset of the file."""
        from mcap.exceptions import McapError
        from mcap.stream_reader import StreamReader

        self._stream.seek(offset)
        try:
            return next(iter(StreamReader(self._stream, skip_magic=True, emit_chunks=True).records))
        except (McapError, ValueError, EOFError, StopIteration) as error:
            raise self._broken(error) from None

    def _attachment(self, name: str) -> bytes:
        for index in self._summary.attachment_indexes:  # type: ignore[union-attr]
            if index.name == name:
                return bytes(self._record(index.offset).data)
        raise ArchiveError(f"{self.path}: lacks its attachment {name}")

    def drives(self, count: int) -> tuple[Drive, ...]:
        """All drives of the run."""
        names = [schema.drive_attachment(v) for v in range(count)]
        at = {index.name: index.offset for index in self._summary.attachment_indexes}  # type: ignore[union-attr]
        missing = next((name for name in names if name not in at), None)
        if missing is not None:
            raise ArchiveError(f"{self.path}: lacks its attachment {missing}")
        try:
            return tuple(loads_drive(self._record(at[name]).data.decode(), f"{self.path}: {name}") for name in names)
        except (DriveError, UnicodeDecodeError) as error:
            raise ArchiveError(f"{self.path}: a drive of it cannot be read ({error})") from None

    def metrics(self) -> pa.Table:
        """The metrics table."""
        import pyarrow as pa

        data = self._attachment(schema.METRICS_ATTACHMENT)
        try:
            return pa.ipc.open_file(pa.BufferReader(data)).read_all()
        except pa.ArrowInvalid as error:
            raise ArchiveError(f"{self.path}: its metrics are damaged ({error})") from None

    def _messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        from mcap.exceptions import McapError

        try:
            for _, _, message in self._reader.iter_messages(topics=[topic], log_time_order=False):
                yield message.log_time, message.data
        except (McapError, ValueError, EOFError) as error:
            raise self._broken(error) from None

    def trajectory(self, variant: int, drive: Drive, track: dict[str, str]) -> Trajectory:
        """All frames of a variant."""
        topics = schema.variant_topics(variant)
        channels, precision = track["channels"].split(), track["precision"]
        frames, links, wheels = int(track["frames"]), drive.chain.links, len(drive.sprockets)
        layout = schema.roller_layout(frozenset(channels), precision)
        time = np.zeros(frames)
        values: dict[str, Any] = {}
        for name in channels:
            pair = (2,) if name in ("position", "velocity", "sprocket_center") else ()
            per = wheels if name.startswith("sprocket_") and name != "sprocket_force" else links
            values[name] = np.zeros((frames, per, *pair), dtype=precision)
        cloud, state = schema.message_type("foxglove.PointCloud")(), schema.message_type("warpchain.State")()
        found = 0
        for found, (_, data) in enumerate(self._messages(topics.rollers), start=1):
            cloud.ParseFromString(data)
            points = np.frombuffer(cloud.data, dtype=layout)
            for channel, parts in schema.ROLLER_FIELDS.items():
                if channel in values:
                    for k, part in enumerate(parts):
                        target = values[channel][found - 1]
                        (target[:, k] if len(parts) > 1 else target)[...] = points[part]
        for frame, (_, data) in enumerate(self._messages(topics.state)):
            state.ParseFromString(data)
            time[frame] = state.time
            for name in ("sprocket_angle", "sprocket_speed", "sprocket_moment"):
                if name in values:
                    values[name][frame] = getattr(state, name)
            if "sprocket_center" in values:
                values["sprocket_center"][frame, :, 0] = state.sprocket_center_x
                values["sprocket_center"][frame, :, 1] = state.sprocket_center_y
        if found != frames:
            raise ArchiveError(f"{self.path}: variant {variant} has {found} of its {frames} frames")
        return Trajectory(drive, time, **values)
