"""Recorder of the frames that kernels write, launch by launch, in memory or in an archive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.errors import SimulationError
from warpchain.results.chains import trajectory_of_chains
from warpchain.results.channels import CHANNEL_NAMES, PartCounts, channels_of_drive, drive_frame_width
from warpchain.results.run import Record, RunInfo, Trajectory
from warpchain.results.schedule import Schedule

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.archive.options import ArchiveOptions
    from warpchain.archive.writer import ArchiveWriter
    from warpchain.engine.chain_rows import ChainRows
    from warpchain.engine.packed_ensemble import PackedEnsemble

BUFFER_FRACTION = 0.25
"""Part of the memory budget for two frame buffers."""


@dataclass(frozen=True)
class RecordingOptions:
    """Options of a run's recording: trajectories, memory, archive."""

    record: Record
    precision: str
    memory: int  # budget for state, buffers and kept trajectories [bytes]
    archive: str | Path | None = None  # file that frames go to instead of memory
    options: ArchiveOptions | None = None
    overwrite: bool = False
    measured: tuple[str, ...] = ()  # channels whose frames in the window plug-ins' metrics need, of all variants

    @property
    def frames(self) -> Record:
        """Recorded frames' options, with metrics' channels."""
        if not self.measured:
            return self.record
        return replace(self.record, variants="all", channels=self.channels_with_measured)

    @property
    def channels_with_measured(self) -> tuple[str, ...]:
        """Recorded channels and those that metrics need."""
        wanted = {*self.record.channels, *self.measured}
        return tuple(name for name in CHANNEL_NAMES if name in wanted)

    def open_archive(self, drives: Sequence[Drive], info: RunInfo) -> AbstractContextManager[ArchiveWriter | None]:
        """Context of a run's archive writer, or None."""
        if self.archive is None:
            return nullcontext()
        from warpchain.archive import ArchiveWriter

        indices = self.record.indices(len(drives))
        return ArchiveWriter(self.archive, drives, indices, info, self.options, self.overwrite, salvage=True)

    def finished_trajectories(
        self, writer: ArchiveWriter | None, metrics: pa.Table, info: RunInfo, frames: Mapping[int, Trajectory]
    ) -> Mapping[int, Trajectory]:
        """Trajectories of a run, from memory or archive."""
        if self.archive is None or writer is None:
            return frames
        from warpchain.archive import read_archive

        writer.finish(metrics, info)
        return read_archive(self.archive).trajectories


def _memory_beside_statistics(packed: PackedEnsemble, memory: int) -> int:
    """Memory budget [bytes] beside sums, or SimulationError."""
    from warpchain.engine.arrays import sums_bytes

    taken = sums_bytes(packed)
    if taken > memory:
        raise SimulationError(
            f"the statistics of {packed.variants} variants take {taken / 2**30:.3g} GiB, more than the memory budget "
            f"has for them, {memory / 2**30:.3g} GiB; simulate fewer variants at a time, or raise memory="
        )
    return memory - taken


class Recorder:
    """Recorder of variants' frames, which lays out buffers.

    Args:
        numbers: (V,) of variants in the run.
        recording: of the run, whose memory they share.
        rows: their chains.
        count: of the run's variants.
        archive: where frames go, instead of memory.

    Raises:
        SimulationError: trajectories, or a frame of each variant, exceed the memory budget.
    """

    def __init__(
        self,
        schedules: Sequence[Schedule],
        numbers: NDArray[np.int64],
        packed: PackedEnsemble,
        recording: RecordingOptions,
        rows: ChainRows,
        count: int,
        archive: ArchiveWriter | None = None,
    ) -> None:
        memory = _memory_beside_statistics(packed, recording.memory * len(numbers) // count)
        self.drives, self.schedules, self.numbers, self.packed = (
            rows.drives,
            schedules,
            numbers.tolist(),
            packed,
        )
        self.channels, self._measured_channels = tuple(recording.record.channels), recording.measured
        self._frame_channels = tuple(recording.frames.channels)
        self._recorded = frozenset(recording.record.indices(count))
        recorded = recording.frames.indices(count)
        self.indices = np.flatnonzero(np.isin(numbers, recorded)).tolist()
        if self.indices:  # of what statistics leave in all, by the variants that are recorded
            memory = memory * count * len(self.indices) // (len(numbers) * len(recorded))
        self.rows, self.begins = rows, rows.first_rows
        self.owners = [v for v in self.indices for _ in range(self.begins[v], self.begins[v + 1])]
        self.written = [r for v in self.indices for r in range(self.begins[v], self.begins[v + 1])]
        self.widths = np.array([drive_frame_width(rows.models[r], packed.frame) for r in self.written], dtype=np.int64)
        self.every = np.array([schedules[v].frame_interval for v in self.owners], dtype=np.int64)
        self.bytes_per_value = np.dtype(recording.precision).itemsize
        self._kept: dict[int, list[Trajectory]] = {v: [] for v in self.indices if self.numbers[v] in self._recorded}
        self._measured: dict[int, list[Trajectory]] = {v: [] for v in self.indices if recording.measured}
        self._archive = archive
        self._budget = recording.memory
        self._buffer_values = int(BUFFER_FRACTION * memory) // (2 * self.bytes_per_value)
        if self.widths.sum() > min(self._buffer_values, 2**31 - 1):
            raise SimulationError(
                f"record: one frame of {len(self.indices)} variants takes more than a quarter of the memory budget of "
                f"{self._budget / 2**30:.3g} GiB; record fewer variants or raise memory="
            )
        if archive is None or recording.measured:
            self._check_memory(memory)

    def _check_memory(self, memory: int) -> None:
        """Raises SimulationError for trajectories that do not fit in memory."""
        frames = np.array([self.schedules[v].frames for v in self.owners], dtype=np.int64)
        wanted = float((frames * self.widths).sum()) * self.bytes_per_value
        if wanted > memory:
            raise SimulationError(
                f"record: the trajectories of {len(self.indices)} variants take {wanted / 2**30:.3g} GiB, more than "
                f"the memory budget of {self._budget / 2**30:.3g} GiB leaves; write them to an archive, record fewer "
                "variants, lower the rate, or raise memory="
            )

    def launch_step_limit(self, limit: int, most: int | None = None) -> int:
        """Most steps of a launch whose recorded frames fit."""
        if not self.indices:
            return limit
        values = self._buffer_values if most is None else min(self._buffer_values, most // self.bytes_per_value)
        room = max(min(values, 2**31 - 1) - int(self.widths.sum()), 0)
        return int(max(1, min(limit, room / float((self.widths / self.every).sum()))))

    def lay_out_buffer(self, steps: int) -> int:
        """Lays out a buffer of recorded frames; returns its length."""
        counts = steps // self.every + 1 if self.indices else np.zeros(0, dtype=np.int64)
        ends = np.cumsum(counts * self.widths)
        self.first = ends - counts * self.widths
        self.packed.drives["first_value"][self.written] = self.first
        return int(ends[-1]) if self.indices else 0

    def take_frames(self, buffer: NDArray[np.floating], before: NDArray[Any], after: NDArray[Any]) -> None:
        """Takes the frames of a launch from the recorder's buffer."""
        parts: dict[int, list[Trajectory]] = {}
        for k, (v, r) in enumerate(zip(self.owners, self.written, strict=True)):
            every, width = int(self.every[k]), int(self.widths[k])
            start = -(-int(before["step"][r]) // every)
            stop_step = int(after["step"][r]) + int(after["diverged"][r]) * (1 - int(before["diverged"][r]))
            stop = -(-stop_step // every)
            if stop <= start:
                continue
            first = int(self.first[k])
            values = buffer[first : first + (stop - start) * width].reshape(stop - start, width)
            time = (np.arange(start, stop) * every).astype(np.float64) * self.schedules[v].step
            parts.setdefault(v, []).append(self._trajectory(r, time, values))
        for v, chains in parts.items():
            self._keep_chunk(v, trajectory_of_chains(self.drives[v], chains))

    def _trajectory(self, r: int, time: NDArray[np.float64], values: NDArray[np.floating]) -> Trajectory:
        """Trajectory of row r's recorded frames, copied."""
        model = self.rows.models[r]
        channels = self.packed.frame.split_frames(values, PartCounts.of_drive(model))
        held = {name: np.array(channels[name], order="C") for name in channels_of_drive(model, self._frame_channels)}
        return Trajectory(self.drives[self.rows.variant_of_row[r]], time, **held, chain=model)

    def _keep_chunk(self, v: int, chunk: Trajectory) -> None:
        """Appends recorded frames to archive or memory; the window's for metrics."""
        if self._measured_channels:
            schedule = self.schedules[v]
            first, last = ((step - 0.5 * way) * schedule.step
                           for step, way in ((schedule.window_start, 1), (schedule.window_end, -1)))  # fmt: skip
            inside = (chunk.time > first) & (chunk.time < last)
            self._measured[v].append(_with_channels(chunk.at(np.flatnonzero(inside)), self._measured_channels))
        if self.numbers[v] not in self._recorded:
            return
        if self._measured_channels:
            chunk = _with_channels(chunk, self.channels)
        if self._archive is not None:
            self._archive.append(self.numbers[v], chunk)
        else:
            self._kept[v].append(chunk)

    def kept_trajectories(self) -> Mapping[int, Trajectory]:
        """Recorded trajectories in memory, by variants' numbers; empties it."""
        if self._archive is not None:
            return {}
        return {self.numbers[v]: self._joined_trajectory(v, self._kept, self.channels) for v in list(self._kept)}

    def measured_trajectories(self) -> Mapping[int, Trajectory]:
        """Frames of the window for plug-ins' metrics, by variants' numbers; the recorder keeps them no longer."""
        held, channels = self._measured, self._measured_channels
        return {self.numbers[v]: self._joined_trajectory(v, held, channels) for v in list(held)}

    def _joined_trajectory(self, v: int, held: dict[int, list[Trajectory]], wanted: tuple[str, ...]) -> Trajectory:
        """Trajectory joined of a variant's recorded chunks."""
        chunks = held.pop(v)
        if not chunks:
            rows = range(self.begins[v], self.begins[v + 1])
            widths = [drive_frame_width(self.rows.models[r], self.packed.frame) for r in rows]
            parts = [self._trajectory(r, np.zeros(0), np.zeros((0, w))) for r, w in zip(rows, widths, strict=True)]
            return _with_channels(trajectory_of_chains(self.drives[v], parts), wanted)
        if len(chunks) == 1:
            return chunks[0]
        time = np.concatenate([chunk.time for chunk in chunks])
        names = channels_of_drive(chunks[0].drive, wanted)
        joined = {name: np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in names}
        return Trajectory(chunks[0].drive, time, **joined)


def _with_channels(trajectory: Trajectory, wanted: Sequence[str]) -> Trajectory:
    """Trajectory with the `wanted` of its channels alone."""
    dropped: dict[str, Any] = {name: None for name in trajectory.channels() if name not in wanted}
    return replace(trajectory, **dropped)
