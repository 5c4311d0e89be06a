"""The end of a study: the second pass for the worst variants, and the whole table."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.engine.progress import bar as bar_of
from warpchain.engine.progress import completed
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.files import leftovers, sweep
from warpchain.results.fatigue import Woehler
from warpchain.results.replaced import with_column
from warpchain.results.replicates import COPY, summary
from warpchain.study.columns import ARCHIVED
from warpchain.study.results import read_results
from warpchain.study.run.folder import REPLICATES, Folder, open_folder
from warpchain.study.run.recordings import with_recorded_objectives
from warpchain.study.run.shards import run_worst
from warpchain.study.run.status import Outcome, study_status
from warpchain.study.spec import Study
from warpchain.study.store import read_table

if TYPE_CHECKING:
    import pyarrow as pa

PARTIAL = "partial.parquet"
"""The table of an unfinished study, as far as it is."""


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
    return finish(folder, None, {"workers": workers, "memory": memory})


def finish(folder: Folder, executor: Executor | None, options: Mapping[str, Any], progress: bool = False) -> Outcome:
    """The second pass, with a bar of its own, and the whole table; what ended processes have left is swept away."""
    table = runs_of(folder)
    if folder.study.record.worst is not None:
        chosen = worst_variants(folder.study, table)
        if not folder.done(folder.worst):
            if executor is None:
                _run_worst_here(folder, chosen, options, progress)
            else:
                with workers_named(folder):
                    (future,) = completed([executor.submit(run_worst, folder.path.resolve(), chosen, options)])
                    future.result()
            table = _with_archives(table, folder.table(folder.worst))
    for name in _archives(table):
        folder.check_archive(name)
    if folder.copies > 1:
        folder.write(folder.path / REPLICATES, table)
        table = summarized(table)
    fatigue = folder.study.fatigue
    if fatigue is not None:
        curve = Woehler(fatigue.exponent, fatigue.range, fatigue.cycles)
        table = with_recorded_objectives(read_results(table), folder.path, curve).table
    folder.write(folder.results, table)
    sweep(leftovers(folder.path))
    return study_status(folder.path)


def runs_of(folder: Folder) -> pa.Table:
    """All runs of the shards that are done, with the places of what was recorded of them, also in a second pass."""
    table = _joined(folder, [shard for shard in folder.shards if folder.done(shard)])
    for name, identity in folder.worst_before:
        if folder.done(name):
            table = _with_archives(table, read_table(folder.table_path(name), study=identity))
    if folder.done(folder.worst):
        table = _with_archives(table, folder.table(folder.worst))
    return table


def _archives(table: pa.Table) -> list[str]:
    """The archives that hold a table's recorded variants."""
    name, _ = ARCHIVED
    return sorted(set(table[name].to_pylist()) - {None}) if name in table.column_names else []


def _run_worst_here(
    folder: Folder, chosen: Sequence[tuple[int, int]], options: Mapping[str, Any], progress: bool
) -> None:
    """The second pass in this process."""
    if not (progress and chosen):
        run_worst(folder.path, chosen, options)
        return
    text = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.0f} [{elapsed}<{remaining}]"
    with bar_of(float(len(chosen)), "recording the worst", " variants", bar_format=text) as bar:
        run_worst(folder.path, chosen, options, lambda part: bar.update(max(0.0, part * len(chosen) - bar.n)))


def _joined(folder: Folder, shards: Sequence[int]) -> pa.Table:
    """The tables of shards, by variants and their copies."""
    import pyarrow as pa
    import pyarrow.compute as pc

    tables = [folder.table(shard) for shard in shards]
    table = pa.concat_tables(tables, promote_options="default").combine_chunks()
    if folder.copies > 1 and COPY not in table.column_names:
        table = table.add_column(1, COPY, pa.array(np.zeros(table.num_rows, dtype=np.int64)))
    if folder.copies > 1:
        copies = pc.fill_null(table[COPY], 0)  # of shards from before there were several
        place = table.column_names.index(COPY)
        table = table.set_column(place, COPY, copies)
        table = table.select(["variant", COPY, *(name for name in table.column_names if name not in ("variant", COPY))])
    if len(folder.parts) > 1:
        keys = [("variant", "ascending"), *([(COPY, "ascending")] if folder.copies > 1 else [])]
        table = table.take(pc.sort_indices(table, sort_keys=keys)).combine_chunks()
    return table


def partial_table(out: str | os.PathLike[str]) -> Path:
    """Writes `partial.parquet`, the table of the shards that are done; returns its path.

    Of a row that is run several times, it has the mean of the copies that are done.

    Raises:
        StudyError: no such folder, or none of its shards is done.
    """
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shards if folder.done(shard)]
    if not done:
        raise StudyError(f"{folder.path}: no shard is done yet; run it with: warpchain study run")
    table = _joined(folder, done)
    path = folder.path / PARTIAL
    folder.write(path, summarized(table) if folder.copies > 1 else table)
    return path


def summarized(table: pa.Table) -> pa.Table:
    """A row for each variant of a table with a row for each of its copies."""
    first = [field.name for field in table.schema if (field.metadata or {}).get(b"role") != b"metric"]
    return summary(table, "variant", first)


def worst_variants(study: Study, table: pa.Table) -> list[tuple[int, int]]:
    """The variants (number, copy) that are recorded in a second pass, without those recorded already.

    They are the most extreme ones; of a row that was run several times, in the mean, and of its copies the most extreme
    one.
    """
    worst = study.record.worst
    assert worst is not None  # asked for
    if worst.metric not in table.column_names:
        return []
    sign = -1.0 if worst.side == "largest" else 1.0
    values: dict[int, list[tuple[float, int]]] = {}
    recorded: set[int] = set()
    judged: dict[int, bool] = {}
    names = ("variant", "status", worst.metric, "archive")
    copies = table[COPY].to_pylist() if COPY in table.column_names else [0] * table.num_rows
    for n, status, v, archive, copy in zip(*(table[name].to_pylist() for name in names), copies, strict=True):
        judged[n] = judged.get(n, True) and status == "ok"
        if v is not None:
            values.setdefault(n, []).append((sign * v, copy))
        if archive is not None:
            recorded.add(n)
    means = {n: sum(v for v, _ in each) / len(each) for n, each in values.items() if judged[n]}
    chosen = sorted(means, key=lambda n: (means[n], n))[: worst.count]
    return sorted((n, min(values[n])[1]) for n in chosen if n not in recorded)


def _with_archives(table: pa.Table, second: pa.Table) -> pa.Table:
    """The table with the places of the variants that the second pass recorded."""
    import pyarrow as pa

    keys = ["variant", COPY] if COPY in table.column_names else ["variant"]
    if keys[1:] and COPY not in second.column_names:
        second = second.append_column(COPY, pa.array(np.zeros(second.num_rows, dtype=np.int64)))
    place_of = {key: i for i, key in enumerate(zip(*(table[key].to_pylist() for key in keys), strict=True))}
    for name in ARCHIVED:
        values = table[name].to_pylist()
        for row in second.select(["variant", *keys[1:], name]).to_pylist():
            values[place_of[tuple(row[key] for key in keys)]] = row[name]
        table = with_column(table, name, values)
    return table


@contextmanager
def workers_named(folder: Folder) -> Iterator[None]:
    """Tells the loss of an executor's workers in one line."""
    try:
        yield
    except (BrokenExecutor, CancelledError) as error:
        text = str(error) or type(error).__name__
        raise StudyError(f"{folder.path}: a worker ended before its shard ({text}); run again to go on") from None
