"""Runs a study: the folder, the shards that are left, the second pass for the worst variants, the whole table.

Shards run one after the other in this process, each on all cores or the device, or on any executor of
`concurrent.futures`. Whatever ends a run, the same call goes on where it was.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive, load_drive
from warpchain.errors import DriveError, StudyError
from warpchain.examples import drive_path
from warpchain.simulation import MEMORY, available_cores
from warpchain.study.design import make_design
from warpchain.study.folder import WORST, Folder, make_folder, open_folder
from warpchain.study.shards import run_shard, run_worst
from warpchain.study.spec import Study, check_drive, load_study
from warpchain.study.tables import read_table, write_table
from warpchain.timestep import resolve_step

if TYPE_CHECKING:
    import pyarrow as pa

Report = Callable[[float, float], None]
"""Called with (variants done, variants of the whole study)."""
Advance = Callable[[float], object]
"""Called with the number of further variants done, also parts of one."""

SHARD_SECONDS = 30.0
"""Work that a shard should hold, so that little is lost when a run is killed."""
CORE_RATE, GPU_RATE = 1e8, 2e10
"""Roller-steps a second to size shards by."""
FEWEST, GPU_FEWEST = 8, 4224
"""Variants that a core, and a GPU, should have at once."""
ROLLER_BYTES, VARIANT_BYTES = 500, 100_000
"""Memory that a roller and a variant take while a shard is simulated, roughly."""


@dataclass(frozen=True)
class Outcome:
    """How a study stands.

    Attributes:
        folder: its folder.
        counts: number of variants by status, of the shards that are done.
        shards: (done, all).
        table: the whole table's file, once there is one.
    """

    folder: Path
    counts: Mapping[str, int]
    shards: tuple[int, int]
    table: Path | None


def run_study(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    part: tuple[int, int] | None = None,
    parts: int = 1,
    workers: int | None = None,
    memory: int = MEMORY,
    progress: bool | Report = False,
) -> Outcome:
    """Runs a study, or what is left of it.

    Args:
        source: the study file.
        out: the study's folder; made if there is none.
        executor: runs the shards; its workers must see the folder under the same name. None runs them here.
        part: (i, n) runs only the shards k with k mod n = i, 0 <= i < n, and leaves the second pass and the whole table
            to `merge_study`.
        parts: a new folder gets at least this many shards, for as many workers.
        workers: CPU threads of a shard; None takes all cores.
        memory: budget of a shard [bytes].
        progress: True shows a bar; a function is called with (variants done, all variants).

    Returns:
        How the study stands.

    Raises:
        StudyError: an error of the file, or a folder of another study; one line each.
        WarpchainError: what stopped a shard; what is done stays.
        KeyboardInterrupt: the user stopped it; what is done stays.
    """
    if part is not None and not 0 <= part[0] < part[1]:
        raise StudyError(f"--shard {part[0]}/{part[1]}: must be i/n with 0 <= i < n")
    folder = prepare(source, out, max(parts, part[1] if part else 1), workers, memory)
    options = {"workers": workers, "memory": memory}
    mine = [shard for shard in folder.shards if part is None or shard % part[1] == part[0]]
    with _bar(progress, folder, mine) as report:
        left = [shard for shard in mine if not folder.done(shard)]
        if executor is None:
            _run_here(folder, left, options, report)
        else:
            _run_there(folder, left, executor, options, report)
    if part is not None:
        return study_status(out)
    return merge_study(out, workers=workers, memory=memory)


def prepare(
    source: str | os.PathLike[str], out: str | os.PathLike[str], parts: int, workers: int | None, memory: int
) -> Folder:
    """Reads and checks a study, and makes or opens its folder; see `run_study`."""
    study = load_study(source)
    word = study.study.drive
    beside = Path(source).parent / word
    try:
        drive = load_drive(beside if beside.exists() or beside.suffix == ".toml" else drive_path(word))
    except DriveError as error:
        raise StudyError("\n".join(f'{source}: study.drive = "{word}": {line}' for line in error.errors)) from None
    check_drive(study, drive, str(source))
    design = make_design(study, Path(source))
    _check_names(study, drive, design.num_rows, source)
    size = study.run.shard or shard_size(study, drive, design.num_rows, parts, workers or available_cores(), memory)
    return make_folder(Path(out), study, drive, design, size)


def shard_size(study: Study, drive: Drive, rows: int, parts: int, cores: int, memory: int) -> int:
    """Rows of a shard: about half a minute's work of the device, enough to fill it, within the memory.

    Args:
        parts: the fewest shards wanted.
        cores: CPU threads of a shard.
        memory: budget of a shard [bytes].
    """
    links = drive.chain.links
    fits = memory // (ROLLER_BYTES * links + VARIANT_BYTES)
    try:
        step = resolve_step(drive, study.run.step)
    except DriveError:
        step = 1e-5
    rate, fewest = (GPU_RATE, GPU_FEWEST) if _on_gpu(study.run.device) else (CORE_RATE * cores, FEWEST * cores)
    work = links * (study.run.duration or drive.run.duration) / step
    wanted = max(int(SHARD_SECONDS * rate / work), fewest)
    return max(1, min(wanted, fits, -(-rows // parts)))


def _on_gpu(device: str | None) -> bool:
    if device is not None:
        return device.startswith("cuda")
    import warp as wp

    return bool(wp.get_cuda_device_count())


def _check_names(study: Study, drive: Drive, rows: int, source: str | os.PathLike[str]) -> None:
    """Checks what a study says of metrics and variants.

    Raises:
        StudyError: one line for each error.
    """
    names, lines = metric_names(drive), []
    for i, pattern in enumerate(study.metrics.keep):
        if not any(fnmatchcase(name, pattern) for name in names):
            lines.append(f'metrics.keep.{i} = "{pattern}": no such metric; there are {_some(names)}')
    worst = study.record.worst
    if worst is not None and worst.metric not in names:
        lines.append(f'record.worst.metric = "{worst.metric}": no such metric; there are {_some(names)}')
    for factor in study.factors:
        if factor.name in names:
            lines.append(f'factors.{factor.name}.name = "{factor.name}": must not be the name of a metric')
    for variant in study.record.variants:
        if variant >= rows:
            lines.append(f"record.variants = {variant}: must be below the number of rows, {rows}")
    if lines:
        raise StudyError("\n".join(f"{source}: {line}" for line in lines))


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def metric_names(drive: Drive) -> list[str]:
    """Names of the metrics that a drive has."""
    from warpchain.ensemble import Schedule
    from warpchain.kernels import structs
    from warpchain.metrics import row_of

    wheels, bars = len(drive.sprockets), len(drive.guides)
    counts = {"chain": (), "strand": wheels, "sprocket": wheels, "contact": wheels + bars}
    kinds = {"chain": "ChainSums", "strand": "StrandSums", "sprocket": "SprocketSums", "contact": "ContactSums"}
    sums = {name: np.ones(counts[name], getattr(structs, kind).numpy_dtype()) for name, kind in kinds.items()}
    row = row_of(drive, Schedule(1e-6, 2, 0, 1, 0), sums, 3, False)
    dropped = ("diverged", "diverged_time", "window_start", "window_end")
    settled = ["settle_steps", "settle_residual"] if drive.run.settle else []
    return [name for name in row if name not in dropped] + settled


def _run_here(folder: Folder, shards: Sequence[int], options: Mapping[str, Any], report: Advance) -> None:
    """Runs shards one after the other in this process."""
    for shard in shards:
        size, told = folder.size(shard), 0.0

        def tell(part: float, size: int = size) -> None:
            nonlocal told
            report(part * size - told)
            told = part * size

        run_shard(folder.path, shard, options, tell)
        report(size - told)


def _run_there(
    folder: Folder, shards: Sequence[int], executor: Executor, options: Mapping[str, Any], report: Advance
) -> None:
    """Runs shards on an executor.

    Raises:
        StudyError: a worker of the executor died, and the executor does not run its shard again.
    """
    futures: dict[Future[int], int] = {}
    try:
        for shard in shards:
            futures[executor.submit(run_shard, str(folder.path.resolve()), shard, options)] = shard
        for future in as_completed(futures):
            future.result()
            report(folder.size(futures[future]))
    except (BrokenExecutor, CancelledError) as error:
        text = str(error) or type(error).__name__
        raise StudyError(f"{folder.path}: a worker ended before its shard ({text}); run again to go on") from None
    finally:
        for future in futures:
            future.cancel()


@contextmanager
def _bar(progress: bool | Report, folder: Folder, shards: Sequence[int]) -> Iterator[Advance]:
    """What is told how many further variants are done: nobody, a bar with rate and time left, or the caller."""
    total = float(sum(folder.size(shard) for shard in shards))
    done = float(sum(folder.size(shard) for shard in shards if folder.done(shard)))
    if callable(progress):

        def tell(more: float) -> None:
            nonlocal done
            done += more
            progress(done, total)

        yield tell
    elif not progress:
        yield lambda more: None
    else:
        from tqdm import tqdm

        text = "{desc}: {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} [{elapsed}<{remaining}, {rate_fmt}]"
        name = folder.study.study.name or "study"
        with tqdm(total=total, initial=done, desc=name, unit=" variants", bar_format=text, dynamic_ncols=True) as bar:
            yield bar.update


def study_status(out: str | os.PathLike[str]) -> Outcome:
    """How a study's folder stands.

    Raises:
        StudyError: no such folder, or a damaged one.
    """
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shards if folder.done(shard)]
    counts = dict.fromkeys(("ok", "diverged", "infeasible"), 0)
    for shard in done:
        for status in read_table(folder.table_path(shard), ["status"])["status"].to_pylist():
            counts[status] += 1
    table = folder.results if folder.results.exists() else None
    return Outcome(folder.path, counts, (len(done), len(folder.shards)), table)


def merge_study(out: str | os.PathLike[str], *, workers: int | None = None, memory: int = MEMORY) -> Outcome:
    """Makes the whole table of a study whose shards are all done; records the worst variants first, if that is wanted.

    Raises:
        StudyError: shards are missing.
    """
    folder = open_folder(Path(out))
    missing = [shard for shard in folder.shards if not folder.done(shard)]
    if missing:
        some = ", ".join(map(str, missing[:8])) + (", ..." if len(missing) > 8 else "")
        raise StudyError(
            f"{folder.path}: {len(missing)} of {len(folder.shards)} shards are missing ({some}); finish with: "
            "warpchain study run"
        )
    table = _joined(folder)
    if folder.study.record.worst is not None:
        chosen = worst_variants(folder.study, table)
        if not folder.done(WORST):
            run_worst(folder.path, chosen, {"workers": workers, "memory": memory})
        table = _with_archives(table, read_table(folder.table_path(WORST)))
    write_table(folder.results, table)
    for leftover in folder.path.glob("**/.*.partial"):
        leftover.unlink(missing_ok=True)
    return study_status(out)


def _joined(folder: Folder) -> pa.Table:
    """The tables of all shards, one after the other."""
    import pyarrow as pa

    tables = [read_table(folder.table_path(shard)) for shard in folder.shards]
    return pa.concat_tables(tables, promote_options="default").combine_chunks()


def worst_variants(study: Study, table: pa.Table) -> list[int]:
    """The variants that are recorded in a second pass: the most extreme ones, without those recorded already."""
    worst = study.record.worst
    assert worst is not None  # asked for
    if worst.metric not in table.column_names:
        return []
    sign = -1.0 if worst.side == "largest" else 1.0
    names = ("variant", "status", worst.metric, "archive")
    rows = zip(*(table[name].to_pylist() for name in names), strict=True)
    found = sorted((sign * v, n, archive) for n, status, v, archive in rows if status == "ok" and v is not None)
    return sorted(n for _, n, archive in found[: worst.count] if archive is None)


def _with_archives(table: pa.Table, second: pa.Table) -> pa.Table:
    """The table with the places of the variants that the second pass recorded."""
    import pyarrow as pa

    for name in ("archive", "archive_variant"):
        values = table[name].to_pylist()
        for row in second.select(["variant", name]).to_pylist():
            values[row["variant"]] = row[name]
        place = table.column_names.index(name)
        table = table.set_column(place, table.schema.field(name), pa.array(values, table.schema.field(name).type))
    return table
