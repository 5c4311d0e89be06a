"""Reading an archive lazily: a variant or a time range touches only its chunks."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.archive import archive_format
from warpchain.archive.archive_names import archive_files, unfinished_files
from warpchain.archive.lazy_trajectories import ArchiveTrajectories, LazyDrives
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.untrusted_arrow import table_from_untrusted_bytes
from warpchain.argument_checks import FiniteNumber, check_arguments
from warpchain.drive.plugins import missing_plugins
from warpchain.errors import ArchiveError, SimulationError, warn_caller
from warpchain.files import is_being_written
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.run import Run, RunInfo, Trajectory, check_channel_names

if TYPE_CHECKING:
    import pyarrow as pa

ENDED_RECOVERED = "recovered"


@dataclass(frozen=True, repr=False)
class Archive(Run):
    """Run in an archive, which reads drives and trajectories when asked for.

    `archive[i]` is the whole trajectory of the variant that it calls i; `read` and `blocks` give parts of it.
    """

    trajectories: ArchiveTrajectories = field(repr=False)

    @check_arguments(SimulationError)
    def __getitem__(self, variant: int) -> Trajectory:
        self._check_frames([variant])
        return super().__getitem__(variant)

    @property
    def first(self) -> int:
        """Number of the archive's first recorded variant.

        Raises:
            ArchiveError: the frames of all are lost.
            SimulationError: none was recorded.
        """
        if not self.trajectories:
            self._check_frames(self.numbers)
        return super().first

    def _check_frames(self, variants: Sequence[int]) -> None:
        """Raises ArchiveError for recorded variants whose frames are lost."""
        absent = [variant for variant in variants if variant not in self.trajectories]
        recorded = self.metadata.get("recorded", "").split() if absent and self.info.ended == "complete" else ()
        for variant in absent:
            if str(variant) in recorded:
                raise ArchiveError(f"{self.files[0]}: lacks the frames of variant {variant}, which the run recorded")

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the archive, in order."""
        return tuple(file.path for file in self.trajectories.files)

    @property
    def metadata(self) -> dict[str, str]:
        """Metadata of how the archive's run was made."""
        return self.trajectories.files[0].read_metadata(archive_format.RUN_METADATA) or {}

    @property
    def attachments(self) -> tuple[str, ...]:
        """Names of the archive's attachments but drives and metrics."""
        names = {name: None for file in self.trajectories.files for name in file.attachments}
        return tuple(n for n in names if n != archive_format.METRICS_ATTACHMENT and not n.startswith("drives/"))

    @check_arguments(ArchiveError)
    def attachment(self, name: str) -> bytes:
        """Data of an archive's attachment; raises ArchiveError if missing or damaged."""
        return next(
            (f for f in self.trajectories.files if name in f.attachments), self.trajectories.files[0]
        ).read_attachment(name)

    @check_arguments(SimulationError)
    def read(
        self,
        variant: int,
        start: FiniteNumber | None = None,
        end: FiniteNumber | None = None,
        channels: Sequence[str] = CHANNEL_NAMES,
    ) -> Trajectory:
        """Part of a variant's trajectory in an archive; reads only its chunks.

        Args:
            start, end: first and last time [s], inclusive; None is the recording's.
            channels: the others are None.

        Raises:
            ArchiveError: a damaged archive.
            SimulationError: a variant that was not recorded, or an unknown channel.
        """
        return self._checked_trajectories(variant, channels).read_trajectory(variant, start, end, channels)

    @check_arguments(SimulationError)
    def blocks(
        self,
        variant: int,
        start: FiniteNumber | None = None,
        end: FiniteNumber | None = None,
        channels: Sequence[str] = CHANNEL_NAMES,
    ) -> Iterator[Trajectory]:
        """Parts of a variant's trajectory, read-only views of a chunk each; see `read`.

        The arrays are neither aligned nor contiguous. Sprocket channels come as float64.
        """
        return self._checked_trajectories(variant, channels).iterate_blocks(variant, start, end, channels)

    def _checked_trajectories(self, variant: int, channels: Sequence[str]) -> ArchiveTrajectories:
        """Trajectories of the archive, once variant and channels are checked."""
        check_channel_names("channels", channels)
        if variant not in self.trajectories:
            self[variant]  # raises, and names the variants there are
        return self.trajectories


@check_arguments(ArchiveError)
def read_archive(path: str | Path) -> Archive:
    """Archive of a run, opened by a file's name, or by a split one's.

    Raises:
        ArchiveError: a file that is missing, not an MCAP, cut short, damaged, or not warpchain's.
    """
    name = Path(path)
    paths = archive_files(name)
    if not os.path.exists(paths[0]):
        _raise_missing_archive(name)
    return open_archive_files(name, tuple(map(McapIndex, paths)))


def open_archive_files(name: Path, files: tuple[McapIndex, ...]) -> Archive:
    """Archive of a name and open files; raises as `read_archive`."""
    starts = [_start_metadata(file) for file in files]
    ends = [file.read_metadata(archive_format.END_METADATA) for file in files]
    _check_whole_set(name, files, starts, ends)
    start, end, last = starts[0], ends[-1] or {}, files[-1]
    try:
        info, numbers = _run_info(start, end), numbers_from_metadata(start)
    except (KeyError, ValueError) as error:
        raise ArchiveError(f"{files[0].path}: is damaged (metadata: {error}); see warpchain recover") from None
    drives = LazyDrives(files, numbers, gaps=info.ended == ENDED_RECOVERED)
    missing = missing_plugins(info.plugins)
    if missing is not None:
        warn_caller(f"{name}: made with a plug-in that is not here: {missing}")
    metrics = _archived_metrics(last, numbers, info.ended)
    return Archive(drives, metrics, ArchiveTrajectories(files, drives, gaps=info.ended == ENDED_RECOVERED), info)


def numbers_from_metadata(start: Mapping[str, str]) -> Sequence[int]:
    """Numbers of an archived run's variants; raises KeyError, ValueError."""
    variants = int(start["variants"])
    if not 1 <= variants < 2**31:
        raise ValueError(f"variants = {variants}")
    numbers = [int(word) for word in start["numbers"].split()] if "numbers" in start else range(variants)
    if len(numbers) != variants or len(set(numbers)) < variants or min(numbers) < 0:
        raise ValueError(f"numbers = {start['numbers'][:40]} for {variants} variants")
    return numbers


def _run_info(start: Mapping[str, str], end: Mapping[str, str]) -> RunInfo:
    """Provenance and end of a run from an archive's metadata."""
    return RunInfo(
        version=start["version"],
        device=start["device"],
        precision=start["precision"],
        created=start["created"],
        ended=end["ended"],
        wall_time=float(end["wall_time"]),
        step=float(start["step"]) if "step" in start else None,
        seed=int(start["seed"]) if "seed" in start else None,
        choice=start.get("choice"),
        plugins=start.get("plugins"),
    )


def _raise_missing_archive(path: Path) -> None:
    """Raises the error of a missing archive, with what a killed run left."""
    left = unfinished_files(path)
    hint = ""
    if left:
        hint = f"; a run that was cut left {left[0]}: see warpchain recover"
        if is_being_written(left[-1]):
            hint = f"; a run is writing it, to {left[-1]}"
    raise ArchiveError(f"{path}: cannot be read (No such file or directory){hint}")


def _start_metadata(file: McapIndex) -> dict[str, str]:
    """Metadata of an archive file's start; raises for another program's."""
    start = file.read_metadata(archive_format.RUN_METADATA)
    if start is None:
        raise ArchiveError(f"{file.path}: an MCAP file, but not an archive of warpchain")
    if start.get("format_version") != archive_format.FORMAT_VERSION:
        raise ArchiveError(
            f"{file.path}: archive format {start.get('format_version')!r} is not known to this version "
            f"(it reads {archive_format.FORMAT_VERSION!r})"
        )
    return start


def _check_whole_set(
    path: Path,
    files: Sequence[McapIndex],
    starts: Sequence[Mapping[str, str]],
    ends: Sequence[Mapping[str, str] | None],
) -> None:
    """Raises ArchiveError for a set of archive files that is not whole."""
    for k, (file, start) in enumerate(zip(files, starts, strict=True)):
        if start.get("set") != starts[0].get("set"):
            raise ArchiveError(f"{file.path}: belongs to another archive than {files[0].path}")
        if start.get("part") != str(k):
            raise ArchiveError(f"{path}: its part {k} is missing (there is {file.path})")
    end = ends[-1]
    if end is None or "parts" not in end:
        raise ArchiveError(f"{path}: has no end ({files[-1].path} is not its last part); see warpchain recover")
    if end["parts"] != str(len(files)):
        raise ArchiveError(f"{path}: {len(files)} of its {end['parts']} files are there")


def _archived_metrics(file: McapIndex, numbers: Sequence[int], ended: str) -> pa.Table:
    """Metrics table of an archive; only `variant` if it was lost."""
    import pyarrow as pa

    if ended == ENDED_RECOVERED and archive_format.METRICS_ATTACHMENT not in file.attachments:
        return pa.table({"variant": pa.array(numbers, pa.int64())})
    try:
        return metrics_from_attachment(file.read_attachment(archive_format.METRICS_ATTACHMENT), numbers)
    except ValueError as error:
        raise ArchiveError(f"{file.path}: its metrics are damaged ({error}); see warpchain recover") from None


def metrics_from_attachment(data: bytes, numbers: Sequence[int]) -> pa.Table:
    """Metrics table of variants from an archive's attachment; raises ValueError."""
    import pyarrow as pa

    try:
        table = table_from_untrusted_bytes(data)
        if table.num_rows != len(numbers) or "variant" not in table.column_names:
            raise ValueError(f"{table.num_rows} rows for {len(numbers)} variants")
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError, TypeError, MemoryError, StopIteration, struct.error) as error:
        raise ValueError((str(error).splitlines() or [type(error).__name__])[0]) from None
    return table
