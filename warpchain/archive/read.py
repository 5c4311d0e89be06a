"""Reading an archive back: lazily, so that opening is quick and a variant or a time range touches only its chunks."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.archive import archive_format
from warpchain.archive.arrow import plain_table
from warpchain.archive.file_set import archive_files, cut_files
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.tracks import LazyDrives, Tracks
from warpchain.argument_checks import FiniteNumber, check_arguments
from warpchain.errors import ArchiveError, SimulationError
from warpchain.files import is_being_written
from warpchain.results.channels import NAMES
from warpchain.results.run import Run, RunInfo, Trajectory, check_names

if TYPE_CHECKING:
    import pyarrow as pa

RECOVERED = "recovered"
"""The end of a run whose archive was cut and restored."""


@dataclass(frozen=True, repr=False)
class Archive(Run):
    """A run that lies in an archive: drives and trajectories are read when they are asked for.

    `archive[i]` is the whole trajectory of the variant that it calls i; `read` and `blocks` give parts of it.
    """

    trajectories: Tracks = field(repr=False)

    @check_arguments(SimulationError)
    def __getitem__(self, variant: int) -> Trajectory:
        self._check_frames([variant])
        return super().__getitem__(variant)

    @property
    def first(self) -> int:
        """The first recorded variant; raises SimulationError where there is none, ArchiveError where all are lost."""
        if not self.trajectories:
            self._check_frames(self.numbers)
        return super().first

    def _check_frames(self, variants: Sequence[int]) -> None:
        """Refuses variants whose frames the run recorded and the files do not have, as where a topic was left out."""
        absent = [variant for variant in variants if variant not in self.trajectories]
        recorded = self.metadata.get("recorded", "").split() if absent and self.info.ended == "complete" else ()
        for variant in absent:
            if str(variant) in recorded:
                raise ArchiveError(f"{self.files[0]}: lacks the frames of variant {variant}, which the run recorded")

    @property
    def files(self) -> tuple[Path, ...]:
        """The archive's files, in order."""
        return tuple(file.path for file in self.trajectories.files)

    @property
    def metadata(self) -> dict[str, str]:
        """The metadata record of how the run was made."""
        return self.trajectories.files[0].values(archive_format.RUN_METADATA) or {}

    @property
    def attachments(self) -> tuple[str, ...]:
        """Names of the attachments other than drives and metrics."""
        names = {name: None for file in self.trajectories.files for name in file.attachments}
        return tuple(n for n in names if n != archive_format.METRICS_ATTACHMENT and not n.startswith("drives/"))

    @check_arguments(ArchiveError)
    def attachment(self, name: str) -> bytes:
        """An attachment's data.

        Raises:
            ArchiveError: no attachment of that name, or a damaged one.
        """
        return next(
            (f for f in self.trajectories.files if name in f.attachments), self.trajectories.files[0]
        ).attachment(name)

    @check_arguments(SimulationError)
    def read(
        self,
        variant: int,
        start: FiniteNumber | None = None,
        end: FiniteNumber | None = None,
        channels: Sequence[str] = NAMES,
    ) -> Trajectory:
        """Part of a variant's trajectory; reads only the chunks that hold it.

        Args:
            variant: a recorded variant.
            start: first time [s], inclusive; None begins at the first frame.
            end: last time [s], inclusive; None goes on to the last frame.
            channels: which channels; the others are None.

        Raises:
            ArchiveError: a damaged archive.
            SimulationError: a variant that was not recorded, or an unknown channel.
        """
        return self._asked(variant, channels).read(variant, start, end, channels)

    @check_arguments(SimulationError)
    def blocks(
        self,
        variant: int,
        start: FiniteNumber | None = None,
        end: FiniteNumber | None = None,
        channels: Sequence[str] = NAMES,
    ) -> Iterator[Trajectory]:
        """The same chunk by chunk: the arrays are read-only views of the chunk's bytes, without copies.

        In an uncompressed archive they are views of the mapped file. They are neither aligned nor contiguous: a library
        that asks for that makes its copy. Sprocket channels come as float64, as they lie in the file.
        """
        return self._asked(variant, channels).blocks(variant, start, end, channels)

    def _asked(self, variant: int, channels: Sequence[str]) -> Tracks:
        check_names("channels", channels)
        if variant not in self.trajectories:
            self[variant]  # raises, and names the variants there are
        return self.trajectories


@check_arguments(ArchiveError)
def read_archive(path: str | Path) -> Archive:
    """Opens an archive.

    Only summaries, metrics and metadata are read at once; drives and trajectories when they are asked for. `run[i]` is
    variant i's whole trajectory, bitwise as it was written; `run.read` a part of it.

    Args:
        path: an MCAP file written by warpchain; of a split archive, its name or any of its files.

    Returns:
        The run.

    Raises:
        ArchiveError: a file that is missing, not an MCAP, cut short, damaged, or not warpchain's; one line.
    """
    name = Path(path)
    paths = archive_files(name)
    if not os.path.exists(paths[0]):
        _missing(name)
    return open_files(name, tuple(map(McapIndex, paths)))


def open_files(name: Path, files: tuple[McapIndex, ...]) -> Archive:
    """The archive of a name, whose files these are, in order; raises as `read_archive` does."""
    heads = [_head(file) for file in files]
    ends = [file.values(archive_format.END_METADATA) for file in files]
    _check_set(name, files, heads, ends)
    head, end, last = heads[0], ends[-1] or {}, files[-1]
    try:
        info, numbers = _info(head, end), numbers_of(head)
    except (KeyError, ValueError) as error:
        raise ArchiveError(f"{files[0].path}: is damaged (metadata: {error}); see warpchain recover") from None
    drives = LazyDrives(files, numbers, gaps=info.ended == RECOVERED)
    metrics = _metrics(last, numbers, info.ended)
    return Archive(drives, metrics, Tracks(files, drives, gaps=info.ended == RECOVERED), info)


def numbers_of(head: Mapping[str, str]) -> Sequence[int]:
    """Numbers of a run's variants, from the metadata at an archive's start; raises KeyError or ValueError."""
    variants = int(head["variants"])
    if not 1 <= variants < 2**31:
        raise ValueError(f"variants = {variants}")
    numbers = [int(word) for word in head["numbers"].split()] if "numbers" in head else range(variants)
    if len(numbers) != variants or len(set(numbers)) < variants or min(numbers) < 0:
        raise ValueError(f"numbers = {head['numbers'][:40]} for {variants} variants")
    return numbers


def _info(head: Mapping[str, str], end: Mapping[str, str]) -> RunInfo:
    """Provenance and end of the run."""
    return RunInfo(
        version=head["version"],
        device=head["device"],
        precision=head["precision"],
        created=head["created"],
        ended=end["ended"],
        wall_time=float(end["wall_time"]),
        step=float(head["step"]) if "step" in head else None,
        seed=int(head["seed"]) if "seed" in head else None,
        choice=head.get("choice"),
    )


def _missing(path: Path) -> None:
    """Error that there is no such archive, and whether a killed run left one."""
    left = cut_files(path)
    hint = ""
    if left:
        hint = f"; a run that was cut left {left[0]}: see warpchain recover"
        if is_being_written(left[-1]):
            hint = f"; a run is writing it, to {left[-1]}"
    raise ArchiveError(f"{path}: cannot be read (No such file or directory){hint}")


def _head(file: McapIndex) -> dict[str, str]:
    head = file.values(archive_format.RUN_METADATA)
    if head is None:
        raise ArchiveError(f"{file.path}: an MCAP file, but not an archive of warpchain")
    if head.get("format_version") != archive_format.FORMAT_VERSION:
        raise ArchiveError(
            f"{file.path}: archive format {head.get('format_version')!r} is not known to this version "
            f"(it reads {archive_format.FORMAT_VERSION!r})"
        )
    return head


def _check_set(
    path: Path, files: Sequence[McapIndex], heads: Sequence[Mapping[str, str]], ends: Sequence[Mapping[str, str] | None]
) -> None:
    """Refuses a set with files missing or foreign, or without its end."""
    for k, (file, head) in enumerate(zip(files, heads, strict=True)):
        if head.get("set") != heads[0].get("set"):
            raise ArchiveError(f"{file.path}: belongs to another archive than {files[0].path}")
        if head.get("part") != str(k):
            raise ArchiveError(f"{path}: its part {k} is missing (there is {file.path})")
    end = ends[-1]
    if end is None or "parts" not in end:
        raise ArchiveError(f"{path}: has no end ({files[-1].path} is not its last part); see warpchain recover")
    if end["parts"] != str(len(files)):
        raise ArchiveError(f"{path}: {len(files)} of its {end['parts']} files are there")


def _metrics(file: McapIndex, numbers: Sequence[int], ended: str) -> pa.Table:
    """The metrics table; a recovered archive has lost it and has only the column `variant`."""
    import pyarrow as pa

    if ended == RECOVERED and archive_format.METRICS_ATTACHMENT not in file.attachments:
        return pa.table({"variant": pa.array(numbers, pa.int64())})
    try:
        return metrics_of(file.attachment(archive_format.METRICS_ATTACHMENT), numbers)
    except ValueError as error:
        raise ArchiveError(f"{file.path}: its metrics are damaged ({error}); see warpchain recover") from None


def metrics_of(data: bytes, numbers: Sequence[int]) -> pa.Table:
    """The metrics table of variants of these numbers, from its attachment; raises ValueError, of one line."""
    import pyarrow as pa

    try:
        table = plain_table(data)
        if table.num_rows != len(numbers) or "variant" not in table.column_names:
            raise ValueError(f"{table.num_rows} rows for {len(numbers)} variants")
        table.validate(full=True)
    except (pa.ArrowException, OSError, ValueError, TypeError, MemoryError, StopIteration, struct.error) as error:
        raise ValueError((str(error).splitlines() or [type(error).__name__])[0]) from None
    return table
