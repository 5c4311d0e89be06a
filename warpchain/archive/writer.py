"""Writing MCAP archives: recorded variants frame by frame, their drives, the metrics, and how the run was made."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from warpchain.archive import archive_format
from warpchain.archive.archive_parts import ArchiveParts, variant_numbers
from warpchain.archive.chunk_layout import ChunkLayout, FrameContent, layout_of_content, message_record
from warpchain.archive.mcap_write import PackedChunk, pack_chunk
from warpchain.archive.options import ArchiveOptions
from warpchain.archive.ordered_work import OrderedWork
from warpchain.archive.read import read_archive
from warpchain.archive.scene_message import scene_update_bytes
from warpchain.argument_checks import check_arguments
from warpchain.drive import Drive
from warpchain.errors import ArchiveError
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.results.tension_colors import tension_scale_end

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ArchiveOptions", "ArchiveWriter", "read_archive", "write_archive"]

CHUNK_BYTES = 2**20
MOST_PENDING_CHUNKS = 32
MOST_WAITING_BYTES = 64 * 2**20
COLOR_SAMPLES = 4096


@dataclass
class _WaitingFrames:
    """Frames of an archive's variant that wait for a full chunk."""

    variant: int
    layout: ChunkLayout
    channels: tuple[int, ...]
    full_scale: float
    frames: int = 0
    waiting: list[Trajectory] = field(default_factory=list)
    count: int = 0


class _ChunkJob(NamedTuple):
    """Frames of a variant that become an archive's chunk."""

    track: _WaitingFrames
    chunks: list[Trajectory]
    first: int


class ArchiveWriter:
    """Writer of an archive while a run goes on.

    Args:
        path: with a split, `run.mcap` becomes `run.part0000.mcap` and so on.
        drives: all drives of the run.
        recorded: indices of the variants to record.
        salvage: keep what was written of an unfinished archive, and name it in the error or a warning.

    Raises:
        ArchiveError: an existing file, a folder or disk that refuses, too many variants for one file.
    """

    def __init__(
        self,
        path: str | Path,
        drives: Sequence[Drive],
        recorded: Sequence[int],
        info: RunInfo,
        options: ArchiveOptions | None = None,
        overwrite: bool = False,
        salvage: bool = False,
    ) -> None:
        self.options = options or ArchiveOptions()
        self._numbers = variant_numbers(self.options, drives)
        self._position = {self._numbers[variant]: k for k, variant in enumerate(recorded)}
        self._lock = Lock()
        self._tracks: dict[int, _WaitingFrames] = {}
        self._waiting = 0
        self._ended = self._named = False
        self._parts = ArchiveParts(Path(path), drives, recorded, info, self.options, overwrite, salvage)
        threads = self.options.encoders or min(4, os.cpu_count() or 1)
        self._pipeline: OrderedWork[_ChunkJob, tuple[_ChunkJob, list[PackedChunk]]] = OrderedWork(
            self._encode_chunk, self._write_chunks, threads, MOST_PENDING_CHUNKS
        )

    def append(self, variant: int, chunk: Trajectory) -> None:
        """Appends consecutive frames of a variant to an archive; waits for room.

        Any thread may call it. Leave the arrays as they are until `finish`.

        Raises:
            ArchiveError: a disk that is full or gone, now or since an earlier call.
        """
        if len(chunk.time) == 0:
            return
        try:
            with self._lock:
                self._append_frames(variant, chunk)
        except ArchiveError as error:
            self._named = True
            raise self._parts.refusal_error(error) from None

    def _append_frames(self, variant: int, chunk: Trajectory) -> None:
        """Adds a variant's frames to an archive's chunks; sends full ones."""
        number = self._numbers[variant]
        track = self._tracks.get(number) or self._begin_variant(number, chunk)
        size = track.layout.frame_bytes
        per_chunk = max(1, CHUNK_BYTES // size)
        start, total = 0, len(chunk.time)
        while track.count + total - start >= per_chunk:
            stop = start + per_chunk - track.count
            self._add_waiting(track, _slice_frames(chunk, start, stop))
            self._send_waiting(track)
            start = stop
        if start < total:
            self._add_waiting(track, _slice_frames(chunk, start, total, copy=start > 0))
        if self._waiting > MOST_WAITING_BYTES:
            self._send_all_waiting()

    def _add_waiting(self, track: _WaitingFrames, frames: Trajectory) -> None:
        """Adds frames to those waiting for an archive's chunk."""
        track.waiting.append(frames)
        track.count += len(frames.time)
        self._waiting += len(frames.time) * track.layout.frame_bytes

    def _send_waiting(self, track: _WaitingFrames) -> None:
        """Sends a variant's waiting frames to the archive's encoders."""
        job = _ChunkJob(track, track.waiting, track.frames)
        self._waiting -= track.count * track.layout.frame_bytes
        track.frames += track.count
        track.waiting, track.count = [], 0
        self._pipeline.submit_job(job)

    def _send_all_waiting(self) -> None:
        """Sends all waiting frames to the archive's encoders."""
        for track in self._tracks.values():
            if track.count:
                self._send_waiting(track)

    def _begin_variant(self, variant: int, chunk: Trajectory) -> _WaitingFrames:
        """Begins a variant of an archive with its frames' layout."""
        values = None if self.options.values == "run" else self.options.values
        content = FrameContent.from_trajectory(variant, chunk, values, self.options.exact_positions)
        numbers = archive_format.channel_numbers(self._parts.place_in_part(self._position[variant]))
        channels = tuple(numbers[topic] for topic in content.topics)
        track = _WaitingFrames(variant, layout_of_content(content), channels, _color_scale_end(chunk))
        self._tracks[variant] = track
        return track

    def _encode_chunk(self, job: _ChunkJob) -> tuple[_ChunkJob, list[PackedChunk]]:
        """Compressed chunks of an archive's job, outlines first."""
        track = job.track
        frames = track.layout.encode_frames(job.chunks, job.first, track.channels, track.full_scale)
        starts = np.arange(len(frames), dtype=np.uint64) * np.uint64(track.layout.frame_bytes)
        stamps = frames["state"]["head"]["log_time"]
        indexes = {}
        for topic, channel in zip(track.layout.content.topics, track.channels, strict=True):
            offset = track.layout.topic_offset(topic)
            indexes[channel] = np.stack([stamps, starts + np.uint64(offset)], axis=1)
        chunk = pack_chunk(memoryview(frames.view(np.uint8)), indexes, self.options.compression)
        return job, [chunk] if job.first else [self._scene_chunk(job, int(stamps[0])), chunk]

    def _scene_chunk(self, job: _ChunkJob, stamp: int) -> PackedChunk:
        """Compressed chunk of an archived variant's outlines."""
        number = archive_format.channel_numbers(self._parts.place_in_part(self._position[job.track.variant]))["scene"]
        record = message_record(number, 0, stamp, scene_update_bytes(job.track.layout.content, job.chunks[0].drive))
        return pack_chunk(record, {number: np.array([[stamp, 0]], dtype=np.uint64)}, self.options.compression)

    def _write_chunks(self, result: tuple[_ChunkJob, list[PackedChunk]]) -> None:
        """Writes chunks to their archive file, all in one thread."""
        job, chunks = result
        track = job.track
        facts = {"color_tension_max": repr(track.full_scale)}
        position = self._position[track.variant]
        part = self._parts.part_for_chunk(position)
        part.open_variant(
            track.variant, self._parts.place_in_part(position), track.layout.content, job.chunks[0].drive, facts
        )
        for chunk in chunks:
            part.file.add_chunk(chunk)

    def finish(self, metrics: pa.Table, info: RunInfo) -> None:
        """Ends the archive with metrics and the run's end, and names its files.

        Raises:
            ArchiveError: a disk that is full or gone, or a file that has appeared under that name.
        """
        try:
            self._send_all_waiting()
            self._pipeline.wait_for_jobs()
            self._parts.finish_archive(metrics, info)
        except ArchiveError as error:
            self._named = True
            raise self._parts.refusal_error(error) from None
        self._ended = True

    def abort(self) -> None:
        """Drops an unfinished archive, or keeps it with `salvage`."""
        if not self._ended:
            self._ended = True
            self._pipeline.wait_for_jobs(drop=True)
            self._parts.close_unfinished(self._named)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.abort()


def _slice_frames(chunk: Trajectory, start: int, stop: int, copy: bool = False) -> Trajectory:
    """Frames start to stop of a trajectory, as views or copies."""
    if start == 0 and stop == len(chunk.time):
        return chunk
    held = {"time": chunk.time, **chunk.channels()}
    parts: dict[str, Any] = {name: values[start:stop] for name, values in held.items()}
    return replace(chunk, **{name: part.copy() if copy else part for name, part in parts.items()})


def _color_scale_end(chunk: Trajectory) -> float:
    """Tension [N] where an archived variant's color scale ends."""
    if chunk.tension is None:
        return 1.0
    values = chunk.tension.reshape(-1)
    return tension_scale_end(values[:: max(1, values.size // COLOR_SAMPLES)])


@check_arguments(ArchiveError)
def write_archive(run: Run, path: str | Path, overwrite: bool = False, options: ArchiveOptions | None = None) -> Path:
    """Writes a run to an MCAP archive; returns the path for `read_archive`.

    Raises:
        ArchiveError: an existing file, a folder or disk that refuses.
    """
    options = options or ArchiveOptions()
    if options.numbers is None and list(run.numbers) != list(range(len(run.drives))):
        options = replace(options, numbers=run.numbers)
    rows = {variant: run.row_of(variant) for variant in run}
    with ArchiveWriter(path, run.drives, list(rows.values()), run.info, options, overwrite) as writer:
        for variant, row in rows.items():
            writer.append(row, run[variant])
        writer.finish(run.metrics, run.info)
    return Path(path)
