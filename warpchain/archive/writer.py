"""Writing MCAP archives: recorded variants frame by frame, their drives, the metrics, and how the run was made.

The layout is described in `docs/archive.md`. Frames are laid out and compressed in threads of their own, while the
solver goes on; a file appears under its name only when it is whole.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from warpchain.archive import archive_format
from warpchain.archive.chunk_layout import Form, FrameLayout, frame_layout, message_record
from warpchain.archive.file_parts import Parts, numbers_of
from warpchain.archive.mcap_write import Chunk, make_chunk
from warpchain.archive.options import ArchiveOptions
from warpchain.archive.ordered_work import Pipeline
from warpchain.archive.read import read_archive
from warpchain.archive.scene_message import scene_update
from warpchain.argument_checks import check_arguments
from warpchain.drive import Drive
from warpchain.errors import ArchiveError
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.results.tension_colors import full_scale

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["ArchiveOptions", "ArchiveWriter", "read_archive", "write_archive"]

CHUNK = 2**20
"""Uncompressed size that chunks have, about [bytes]."""
ROOM = 32
"""Chunks under way at most between `append` and the disk."""
WAITING = 64 * 2**20
"""Frames that wait for their chunk to fill, over all variants, at most [bytes]."""
COLOR_SAMPLES = 4096
"""Most of the first tensions of a variant, roughly, that its color scale is taken from."""


@dataclass
class _Track:
    """A variant being written, by its number: its frames' layout, and those that wait for their chunk to fill."""

    variant: int
    layout: FrameLayout
    channels: tuple[int, ...]
    full_scale: float
    frames: int = 0
    waiting: list[Trajectory] = field(default_factory=list)
    count: int = 0


class _Job(NamedTuple):
    """Consecutive frames of one variant that become a chunk."""

    track: _Track
    chunks: list[Trajectory]
    first: int


class ArchiveWriter:
    """Writes an archive while a run goes on.

    Args:
        path: the file to write; with a split, `run.mcap` becomes `run.part0000.mcap`, `run.part0001.mcap` and so on.
        drives: all drives of the run.
        recorded: indices of the variants that frames will come for.
        info: how the run is made; `finish` adds how it ended.
        options: compression, split, threads; None takes the defaults.
        overwrite: replace an archive of that name.
        salvage: of an archive that is not finished, keep what was written until then, and name it in the error that a
            refusing disk raises, else in a warning.

    Raises:
        ArchiveError: an existing file, a folder that cannot be written, a full disk, too many variants for one file.
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
        self._numbers = numbers_of(self.options, drives)
        self._position = {self._numbers[variant]: k for k, variant in enumerate(recorded)}
        self._lock = Lock()
        self._tracks: dict[int, _Track] = {}
        self._waiting = 0
        self._ended = self._named = False
        self._parts = Parts(Path(path), drives, recorded, info, self.options, overwrite, salvage)
        threads = self.options.encoders or min(4, os.cpu_count() or 1)
        self._pipeline: Pipeline[_Job, tuple[_Job, list[Chunk]]] = Pipeline(self._encode, self._store, threads, ROOM)

    def append(self, variant: int, chunk: Trajectory) -> None:
        """Appends consecutive frames of one variant, from any thread; waits while too much is under way.

        The arrays are read later, in other threads: leave them as they are until `finish`.

        Raises:
            ArchiveError: a disk that is full or gone, now or since an earlier call.
        """
        if len(chunk.time) == 0:
            return
        try:
            with self._lock:
                self._append(variant, chunk)
        except ArchiveError as error:
            self._named = True
            raise self._parts.refusal(error) from None

    def _append(self, variant: int, chunk: Trajectory) -> None:
        number = self._numbers[variant]
        track = self._tracks.get(number) or self._begin(number, chunk)
        size = track.layout.size
        per_chunk = max(1, CHUNK // size)
        start, total = 0, len(chunk.time)
        while track.count + total - start >= per_chunk:
            stop = start + per_chunk - track.count
            self._wait_for(track, _cut(chunk, start, stop))
            self._send(track)
            start = stop
        if start < total:
            self._wait_for(track, _cut(chunk, start, total, copy=start > 0))
        if self._waiting > WAITING:
            self._send_all()

    def _wait_for(self, track: _Track, frames: Trajectory) -> None:
        track.waiting.append(frames)
        track.count += len(frames.time)
        self._waiting += len(frames.time) * track.layout.size

    def _send(self, track: _Track) -> None:
        """Gives a variant's waiting frames to the encoders."""
        job = _Job(track, track.waiting, track.frames)
        self._waiting -= track.count * track.layout.size
        track.frames += track.count
        track.waiting, track.count = [], 0
        self._pipeline.put(job)

    def _send_all(self) -> None:
        for track in self._tracks.values():
            if track.count:
                self._send(track)

    def _begin(self, variant: int, chunk: Trajectory) -> _Track:
        values = None if self.options.values == "run" else self.options.values
        form = Form.of(variant, chunk, values, self.options.exact_positions)
        numbers = archive_format.channel_numbers(self._parts.place(self._position[variant]))
        channels = tuple(numbers[topic] for topic in form.topics)
        track = _Track(variant, frame_layout(form), channels, _full_scale(chunk))
        self._tracks[variant] = track
        return track

    def _encode(self, job: _Job) -> tuple[_Job, list[Chunk]]:
        """Lays out and compresses a chunk, the variant's first behind its outlines; runs in a thread of its own."""
        track = job.track
        frames = track.layout.encode(job.chunks, job.first, track.channels, track.full_scale)
        starts = np.arange(len(frames), dtype=np.uint64) * np.uint64(track.layout.size)
        stamps = frames["state"]["head"]["log_time"]
        indexes = {}
        for topic, channel in zip(track.layout.form.topics, track.channels, strict=True):
            offset = track.layout.offset(topic)
            indexes[channel] = np.stack([stamps, starts + np.uint64(offset)], axis=1)
        chunk = make_chunk(memoryview(frames.view(np.uint8)), indexes, self.options.compression)
        return job, [chunk] if job.first else [self._scene(job, int(stamps[0])), chunk]

    def _scene(self, job: _Job, stamp: int) -> Chunk:
        """The chunk that holds a variant's outlines."""
        number = archive_format.channel_numbers(self._parts.place(self._position[job.track.variant]))["scene"]
        record = message_record(number, 0, stamp, scene_update(job.track.layout.form, job.chunks[0].drive))
        return make_chunk(record, {number: np.array([[stamp, 0]], dtype=np.uint64)}, self.options.compression)

    def _store(self, result: tuple[_Job, list[Chunk]]) -> None:
        """Writes chunks; runs in the writing thread, the only one that touches the files meanwhile."""
        job, chunks = result
        track = job.track
        facts = {"color_tension_max": repr(track.full_scale)}
        position = self._position[track.variant]
        part = self._parts.part(position)
        part.open_variant(track.variant, self._parts.place(position), track.layout.form, job.chunks[0].drive, facts)
        for chunk in chunks:
            part.file.chunk(chunk)

    def finish(self, metrics: pa.Table, info: RunInfo) -> None:
        """Ends the archive and gives its files their names.

        Args:
            metrics: one row a variant.
            info: how the run was made and ended.

        Raises:
            ArchiveError: a disk that is full or gone, or a file that has appeared under that name.
        """
        try:
            self._send_all()
            self._pipeline.close()
            self._parts.finish(metrics, info)
        except ArchiveError as error:
            self._named = True
            raise self._parts.refusal(error) from None
        self._ended = True

    def abort(self) -> None:
        """Ends an archive that is not finished: what was written is kept with `salvage`, else dropped."""
        if not self._ended:
            self._ended = True
            self._pipeline.close(drop=True)
            self._parts.close(self._named)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.abort()


def _cut(chunk: Trajectory, start: int, stop: int, copy: bool = False) -> Trajectory:
    """Frames start to stop, as views or as copies."""
    if start == 0 and stop == len(chunk.time):
        return chunk
    held = {"time": chunk.time, **chunk.channels()}
    parts: dict[str, Any] = {name: values[start:stop] for name, values in held.items()}
    return replace(chunk, **{name: part.copy() if copy else part for name, part in parts.items()})


def _full_scale(chunk: Trajectory) -> float:
    """Where the color scale ends [N]."""
    if chunk.tension is None:
        return 1.0
    values = chunk.tension.reshape(-1)
    return full_scale(values[:: max(1, values.size // COLOR_SAMPLES)])


@check_arguments(ArchiveError)
def write_archive(run: Run, path: str | Path, overwrite: bool = False, options: ArchiveOptions | None = None) -> Path:
    """Writes a run to an MCAP archive.

    Args:
        run: what `simulate` or `read_archive` returned.
        path: the file to write; it appears under this name only when whole.
        overwrite: replace an archive of that name.
        options: compression, split, threads; None takes the defaults.

    Returns:
        The path, which `read_archive` takes, whether the archive is split or not.

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
