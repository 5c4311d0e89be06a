"""Runs a study: the shards that are left, the worst variants again to record them, the whole table."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.argument_checks import Count, Index, Workers, check_arguments
from warpchain.drive.plugins import loaded_plugins
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError, warn_caller
from warpchain.extras import require_extra
from warpchain.files import leftover_files, remove_leftovers
from warpchain.gc_tuning import rare_collections
from warpchain.progress import (
    RECORDING,
    RUNNING,
    Progress,
    ProgressReport,
    completed_futures,
    ignore_progress,
    interruptible_work,
    partial_report,
    progress_reporter,
    raise_if_stopped,
)
from warpchain.results.arrow_tables import table_with_column
from warpchain.results.fatigue import Woehler
from warpchain.results.replicate_metrics import COPY_COLUMN, summarize_copies
from warpchain.study.results import ARCHIVE_COLUMNS, read_results
from warpchain.study.run.prepare import prepare_folder
from warpchain.study.run.recordings import results_with_objectives
from warpchain.study.run.shards import record_worst_variants, run_shard
from warpchain.study.run.study_folder import REPLICATES_FILE, StudyFolder, StudyStatus, open_folder, study_status
from warpchain.study.store import read_table

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.study.spec import Study

__all__ = ["StudyStatus", "merge_study", "run_study", "study_status"]

CONNECT_SECONDS = 5.0
SCHEDULER_SECONDS = 30.0
PARTIAL_FILE = "partial.parquet"


@contextmanager
def dask_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """Executor of a Dask scheduler, and its number of workers.

    Raises:
        StudyError: no dask.distributed, no answer, or a shard has ended several workers.
    """
    require_extra("dask", "--scheduler", StudyError)
    from distributed import Client, KilledWorker

    _check_listener(address)
    try:
        client = Client(address, timeout=SCHEDULER_SECONDS)
    except (OSError, ValueError) as error:
        raise StudyError(f"--scheduler {address}: no Dask scheduler answers ({_error_line(error)})") from None
    try:
        workers = len(client.nthreads())
        if not workers:
            warn_caller(f"--scheduler {address}: has no workers yet; shards wait for them")
        yield client.get_executor(pure=False), workers
    except KilledWorker as error:
        raise StudyError(f"--scheduler {address}: {_error_line(error)}; run again to go on") from None
    finally:
        client.close()


def _check_listener(address: str) -> None:
    """Raises StudyError for a TCP address where nobody listens."""
    scheme, _, place = address.rpartition("://")
    host, _, port = place.strip("/").rpartition(":")
    if scheme not in ("", "tcp", "tls") or not (host and port.isdecimal()):
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_SECONDS).close()
    except (OSError, OverflowError) as error:
        raise StudyError(f"--scheduler {address}: no Dask scheduler answers ({_error_line(error)})") from None


def _error_line(error: Exception) -> str:
    """First line of an error's message, or its type."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


@interruptible_work()
def merge_study(out: str | os.PathLike[str], *, workers: int | None = None, memory: int = MEMORY) -> StudyStatus:
    """Makes a finished study's results table; returns its status."""
    folder = open_folder(Path(out))
    missing = [shard for shard in folder.shard_numbers if not folder.is_done(shard)]
    if missing:
        some = ", ".join(map(str, missing[:8])) + (", ..." if len(missing) > 8 else "")
        raise StudyError(
            f"{folder.path}: {len(missing)} of {len(folder.shard_numbers)} shards are missing ({some}); finish with: "
            "warpchain study run"
        )
    return finish_study(folder, None, {"workers": workers, "memory": memory})


def finish_study(
    folder: StudyFolder, executor: Executor | None, options: Mapping[str, Any], report: ProgressReport = ignore_progress
) -> StudyStatus:
    """Records worst variants, writes results; returns the study's status."""
    table = read_runs(folder)
    if folder.study.record.worst is not None:
        chosen = worst_variants(folder.study, table)
        if not folder.is_done(folder.worst_shard):
            if executor is None:
                count = float(len(chosen))
                record_worst_variants(
                    folder.path, chosen, options, partial_report(report, RECORDING, 0.0, count, count)
                )
            else:
                with lost_workers_as_study_errors(folder):
                    (future,) = completed_futures(
                        [executor.submit(record_worst_variants, folder.path.resolve(), chosen, options)]
                    )
                    future.result()
            table = _table_with_archives(table, folder.read_shard(folder.worst_shard))
    for name in _archive_names(table):
        raise_if_stopped()
        folder.check_archive(name)
    if folder.copies > 1:
        folder.write_table(folder.path / REPLICATES_FILE, table)
        table = means_of_replicates(table)
    fatigue = folder.study.fatigue
    if fatigue is not None:
        curve = Woehler(fatigue.exponent, fatigue.range, fatigue.cycles)
        table = results_with_objectives(read_results(table), folder.path, curve).table
    raise_if_stopped()
    folder.write_table(folder.results_path, table)
    remove_leftovers(leftover_files(folder.path))
    return study_status(folder.path)


def read_runs(folder: StudyFolder) -> pa.Table:
    """Table of all runs in a study's done shards."""
    table = _concatenated_shards(folder, [shard for shard in folder.shard_numbers if folder.is_done(shard)])
    for name, identity in folder.earlier_worst_shards:
        if folder.is_done(name):
            table = _table_with_archives(table, read_table(folder.table_path(name), study=identity))
    if folder.is_done(folder.worst_shard):
        table = _table_with_archives(table, folder.read_shard(folder.worst_shard))
    return table


def _archive_names(table: pa.Table) -> list[str]:
    """Names of archives of a table's recorded variants."""
    name, _ = ARCHIVE_COLUMNS
    return sorted(set(table[name].to_pylist()) - {None}) if name in table.column_names else []


def _concatenated_shards(folder: StudyFolder, shards: Sequence[int]) -> pa.Table:
    """Table of the runs of shards, by variant and copy."""
    import pyarrow as pa
    import pyarrow.compute as pc

    tables = [folder.read_shard(shard) for shard in shards]
    table = pa.concat_tables(tables, promote_options="default").combine_chunks()
    if folder.copies > 1 and COPY_COLUMN not in table.column_names:
        table = table.add_column(1, COPY_COLUMN, pa.array(np.zeros(table.num_rows, dtype=np.int64)))
    if folder.copies > 1:
        copies = pc.fill_null(table[COPY_COLUMN], 0)  # of shards from before there were several
        place = table.column_names.index(COPY_COLUMN)
        table = table.set_column(place, COPY_COLUMN, copies)
        table = table.select(
            ["variant", COPY_COLUMN, *(name for name in table.column_names if name not in ("variant", COPY_COLUMN))]
        )
    if len(folder.plans) > 1:
        keys = [("variant", "ascending"), *([(COPY_COLUMN, "ascending")] if folder.copies > 1 else [])]
        table = table.take(pc.sort_indices(table, sort_keys=keys)).combine_chunks()
    return table


def write_partial_table(out: str | os.PathLike[str]) -> Path:
    """Writes the table of done shards; returns its path."""
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shard_numbers if folder.is_done(shard)]
    if not done:
        raise StudyError(f"{folder.path}: no shard is done yet; run it with: warpchain study run")
    table = _concatenated_shards(folder, done)
    path = folder.path / PARTIAL_FILE
    folder.write_table(path, means_of_replicates(table) if folder.copies > 1 else table)
    return path


def means_of_replicates(table: pa.Table) -> pa.Table:
    """Table of variants' means over their replicates."""
    first = [field.name for field in table.schema if (field.metadata or {}).get(b"role") != b"metric"]
    return summarize_copies(table, "variant", first)


def worst_variants(study: Study, table: pa.Table) -> list[tuple[int, int]]:
    """Runs (variant, copy) of extreme metrics, to record."""
    worst = study.record.worst
    assert worst is not None  # asked for
    if worst.metric not in table.column_names:
        return []
    sign = -1.0 if worst.side == "largest" else 1.0
    values: dict[int, list[tuple[float, int]]] = {}
    recorded: set[int] = set()
    judged: dict[int, bool] = {}
    names = ("variant", "status", worst.metric, "archive")
    copies = table[COPY_COLUMN].to_pylist() if COPY_COLUMN in table.column_names else [0] * table.num_rows
    for n, status, v, archive, copy in zip(*(table[name].to_pylist() for name in names), copies, strict=True):
        judged[n] = judged.get(n, True) and status == "ok"
        if v is not None:
            values.setdefault(n, []).append((sign * v, copy))
        if archive is not None:
            recorded.add(n)
    means = {n: sum(v for v, _ in each) / len(each) for n, each in values.items() if judged[n]}
    chosen = sorted(means, key=lambda n: (means[n], n))[: worst.count]
    return sorted((n, min(values[n])[1]) for n in chosen if n not in recorded)


def _table_with_archives(table: pa.Table, second: pa.Table) -> pa.Table:
    """Table of runs with recordings of a second pass."""
    import pyarrow as pa

    keys = ["variant", COPY_COLUMN] if COPY_COLUMN in table.column_names else ["variant"]
    if keys[1:] and COPY_COLUMN not in second.column_names:
        second = second.append_column(COPY_COLUMN, pa.array(np.zeros(second.num_rows, dtype=np.int64)))
    place_of = {key: i for i, key in enumerate(zip(*(table[key].to_pylist() for key in keys), strict=True))}
    for name in ARCHIVE_COLUMNS:
        values = table[name].to_pylist()
        for row in second.select(["variant", *keys[1:], name]).to_pylist():
            values[place_of[tuple(row[key] for key in keys)]] = row[name]
        table = table_with_column(table, name, values)
    return table


@contextmanager
def lost_workers_as_study_errors(folder: StudyFolder) -> Iterator[None]:
    """Context that turns lost workers into a StudyError."""
    try:
        yield
    except (BrokenExecutor, CancelledError) as error:
        text = str(error) or type(error).__name__
        raise StudyError(f"{folder.path}: a worker ended before its shard ({text}); run again to go on") from None


@check_arguments(StudyError)
@interruptible_work()
def run_study(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    part: tuple[Index, Count] | None = None,
    parts: Count = 1,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Progress = False,
    grow: bool = False,
) -> StudyStatus:
    """Runs what is left of a study; returns its status.

    Args:
        out: the study's folder; made if there is none.
        executor: runs the shards, such as Dask's; its workers must see the folder under the same name. None runs them
            here.
        part: (i, n) runs only the shards k with k mod n = i, and leaves the rest to `merge_study`.
        parts: workers to keep busy: a new folder's shards have at most rows / parts rows.
        workers: CPU threads of a shard; None takes all cores.
        memory: budget of a shard [bytes].
        grow: let a folder of fewer points or replicates, or another duration or window, grow.
        progress: True shows a bar; a function gets (phase, done, total): "compiling", in kernels; "running" and
            "recording", in variants.

    Raises:
        StudyError: an error of the file, or a folder of another study.
        WarpchainError: what stopped a shard; what is done stays.
        KeyboardInterrupt: what is done stays.
    """
    if part is not None and not 0 <= part[0] < part[1]:
        raise StudyError(f"--shard {part[0]}/{part[1]}: must be i/n with 0 <= i < n")
    folder = prepare_folder(source, out, max(parts, part[1] if part else 1), workers, memory, grow)
    return run_folder(folder, executor=executor, part=part, workers=workers, memory=memory, progress=progress)


@rare_collections()
@interruptible_work()
def run_folder(
    folder: StudyFolder,
    *,
    executor: Executor | None = None,
    part: tuple[int, int] | None = None,
    workers: int | None = None,
    memory: int = MEMORY,
    progress: Progress = False,
) -> StudyStatus:
    """Runs what is left of a study's folder; returns its status."""
    options = {"workers": workers, "memory": memory, "plugins": [str(of.path) for of in loaded_plugins()]}
    mine = [shard for shard in folder.shard_numbers if part is None or shard % part[1] == part[0]]
    left = [shard for shard in mine if not folder.is_done(shard)]
    total, rest = (float(sum(map(folder.shard_run_count, shards))) for shards in (mine, left))
    bar = {"name": folder.study.study.name or "study", "initial": total - rest}
    with progress_reporter(progress, **{RUNNING: bar}) as report:
        run = partial_report(report, RUNNING, total - rest, total, total)
        if executor is None:
            _run_shards_here(folder, left, options, run)
        else:
            _run_shards_on_executor(folder, left, executor, options, run)
        if part is not None:
            return study_status(folder.path)
        return finish_study(folder, executor, options, report)


def _run_shards_here(
    folder: StudyFolder, shards: Sequence[int], options: Mapping[str, Any], report: ProgressReport
) -> None:
    """Runs a study's shards in this process."""
    done, total = 0, float(sum(map(folder.shard_run_count, shards)))
    for shard in shards:
        raise_if_stopped()
        begin, done = done, done + folder.shard_run_count(shard)
        run_shard(folder.path, shard, options, partial_report(report, RUNNING, begin, done, total))
        report(RUNNING, done, total)


def _run_shards_on_executor(
    folder: StudyFolder, shards: Sequence[int], executor: Executor, options: Mapping[str, Any], report: ProgressReport
) -> None:
    """Runs a study's shards on an executor."""
    futures: dict[Future[int], int] = {}
    done, total = 0, float(sum(map(folder.shard_run_count, shards)))
    try:
        with lost_workers_as_study_errors(folder):
            for shard in shards:
                futures[executor.submit(run_shard, folder.path.resolve(), shard, options)] = shard
            for future in completed_futures(futures):
                future.result()
                done += folder.shard_run_count(futures[future])
                report(RUNNING, done, total)
    finally:
        for future in futures:
            future.cancel()
