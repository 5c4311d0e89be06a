"""Cutting an archive: some variants, between two times, as one of its own."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from warpchain.archive.archive_names import archive_files
from warpchain.archive.options import ArchiveOptions
from warpchain.archive.read import Archive, read_archive
from warpchain.archive.writer import ArchiveWriter
from warpchain.errors import ArchiveError
from warpchain.results.run import Trajectory


def cut_archive(
    source: str | Path,
    output: str | Path,
    start: float | None = None,
    end: float | None = None,
    variants: Sequence[int] | None = None,
    overwrite: bool = False,
    compression: str = "zstd",
) -> dict[int, int]:
    """Cuts an archive, bit by bit as recorded; returns numbers of frames by variant.

    Drives, metrics, attachments and provenance come along.

    Args:
        source: of a split archive its name or any of its files.
        start, end: first and last time of frames [s]; None is the recording's.
        variants: recorded variants to keep; None keeps all, recorded or not.
        compression: "zstd", "lz4" or "none".

    Raises:
        ArchiveError: an archive that cannot be read or written, or a variant without a frame between these times.
        SimulationError: a variant that was not recorded.
    """
    run = read_archive(source)
    there = [path for path in archive_files(Path(output)) if os.path.exists(path)]
    if any(os.path.samefile(path, file) for path in there for file in run.files):
        raise ArchiveError(f"{output}: is the archive that is cut; name another one")
    if start is not None and end is not None and start > end:
        raise ArchiveError(f"start = {start:g}: must be at most end, {end:g}")
    chosen = list(run) if variants is None else sorted(set(variants))
    for variant in chosen:
        run.blocks(variant, start, end, [])  # refuses one that was not recorded
    if not chosen:
        raise ArchiveError(f"{source}: has no recorded variant")
    numbers = list(run.numbers) if variants is None else chosen
    rows = [run.row_of(number) for number in numbers]
    options = _cut_options(run, numbers, chosen[0], compression)
    frames = dict.fromkeys(chosen, 0)
    drives = [run.drives[row] for row in rows]
    recorded = [numbers.index(variant) for variant in chosen]
    with ArchiveWriter(output, drives, recorded, run.info, options, overwrite) as writer:
        for variant, place in zip(chosen, recorded, strict=True):
            for part in _whole_precision_blocks(run, variant, start, end):
                writer.append(place, part)
                frames[variant] += len(part.time)
            if not frames[variant]:
                times = [block.time for block in run.blocks(variant, channels=[])]
                raise ArchiveError(
                    f"{source}: variant {variant} has no frame from {_time_text(start, 'its start')} to "
                    f"{_time_text(end, 'its end')}; it has {times[0][0]:g} to {times[-1][-1]:g} s"
                )
        writer.finish(run.metrics.take(rows), run.info)
    return frames


def _time_text(time: float | None, word: str) -> str:
    """Text of a cut's time; `word` for none."""
    return word if time is None else f"{time:g} s"


def _cut_options(run: Archive, numbers: Sequence[int], variant: int, compression: str) -> ArchiveOptions:
    """Options that write a cut as its archive was written."""
    content = run.trajectories.chunk_layout(variant).content
    packed = content.values == "float32" and content.precision == "float64"
    return ArchiveOptions(
        compression=compression,  # type: ignore[arg-type]  # which it checks
        values="float32" if packed else "run",
        exact_positions=content.has_exact_positions,
        numbers=None if numbers == list(range(len(numbers))) else numbers,
        seed=run.info.seed,
        attachments={name: run.attachment(name) for name in run.attachments},
    )


def _whole_precision_blocks(run: Archive, variant: int, start: float | None, end: float | None) -> Iterator[Trajectory]:
    """Frames of an archived variant by chunk, in the run's precision."""
    precision = run.trajectories.chunk_layout(variant).content.precision
    for block in run.blocks(variant, start, end):
        held = {name: np.array(values, dtype=precision) for name, values in block.channels().items()}
        yield Trajectory(block.drive, np.array(block.time), **held)
