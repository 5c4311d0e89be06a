"""How a study stands, and its end: the second pass for the worst variants, and the whole table."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.files import leftovers, sweep
from warpchain.results.fatigue import Woehler
from warpchain.results.judgement import common_reasons
from warpchain.study.columns import ARCHIVED, OUTCOME
from warpchain.study.results import STATUSES, read_results
from warpchain.study.run.folder import WORST, Folder, open_folder
from warpchain.study.run.recordings import with_recorded_objectives
from warpchain.study.run.shards import run_worst
from warpchain.study.spec import Study

if TYPE_CHECKING:
    import pyarrow as pa

LATEST = 20
"""Shards that the rate of a study is taken from."""
REASONS = 3
"""Most reasons that an outcome tells."""


@dataclass(frozen=True)
class Outcome:
    """How a study stands.

    Attributes:
        folder: its folder.
        counts: number of variants by status, of the shards that are done.
        reasons: the most frequent (reason, how many) of variants that are not ok; alike in all but numbers is one.
        shards: (done, all).
        left: number of variants of the shards that are not done.
        rate: variants a second, as the latest shards came in; None where too few are there to tell.
        table: the whole table's file, once there is one.
    """

    folder: Path
    counts: Mapping[str, int]
    reasons: tuple[tuple[str, int], ...]
    shards: tuple[int, int]
    left: int
    rate: float | None
    table: Path | None


def study_status(out: str | os.PathLike[str]) -> Outcome:
    """How a study's folder stands.

    Raises:
        StudyError: no such folder, or a damaged one.
    """
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shards if folder.done(shard)]
    counts = dict.fromkeys(STATUSES, 0)
    ended: list[tuple[str, str]] = []
    for shard in done:
        for row in folder.table(shard, list(OUTCOME)).to_pylist():
            counts[row["status"]] = counts.get(row["status"], 0) + 1
            if row["reason"] is not None:
                ended.append((row["status"], row["reason"]))
    table = folder.results if folder.results.exists() else None
    often = tuple((reason, number) for _, reason, number in common_reasons(ended)[:REASONS])
    left = folder.rows - sum(folder.size(shard) for shard in done)
    return Outcome(folder.path, counts, often, (len(done), len(folder.shards)), left, _rate(folder, done), table)


def _rate(folder: Folder, done: Sequence[int]) -> float | None:
    """Variants a second of the shards that came in last, by the times of their files."""
    landed = sorted((folder.table_path(shard).stat().st_mtime, folder.size(shard)) for shard in done)[-LATEST:]
    if len(landed) < 3 or landed[-1][0] <= landed[0][0]:
        return None
    return sum(size for _, size in landed[1:]) / (landed[-1][0] - landed[0][0])


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


def finish(folder: Folder, executor: Executor | None, options: Mapping[str, Any]) -> Outcome:
    """The second pass, and the whole table; what processes have left behind that have ended is swept away."""
    table = _joined(folder)
    if folder.study.record.worst is not None:
        chosen = worst_variants(folder.study, table)
        if not folder.done(WORST):
            if executor is None:
                run_worst(folder.path, chosen, options)
            else:
                with workers_named(folder):
                    executor.submit(run_worst, folder.path.resolve(), chosen, options).result()
        table = _with_archives(table, folder.table(WORST))
    for name in _archives(table):
        folder.check_archive(name)
    fatigue = folder.study.fatigue
    if fatigue is not None:
        curve = Woehler(fatigue.exponent, fatigue.range, fatigue.cycles)
        table = with_recorded_objectives(read_results(table), folder.path, curve).table
    folder.write(folder.results, table)
    sweep(leftovers(folder.path))
    return study_status(folder.path)


def _archives(table: pa.Table) -> list[str]:
    """The archives that hold a table's recorded variants."""
    name, _ = ARCHIVED
    return sorted(set(table[name].to_pylist()) - {None}) if name in table.column_names else []


def _joined(folder: Folder) -> pa.Table:
    """The tables of all shards, one after the other."""
    import pyarrow as pa

    tables = [folder.table(shard) for shard in folder.shards]
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

    for name in ARCHIVED:
        values = table[name].to_pylist()
        for row in second.select(["variant", name]).to_pylist():
            values[row["variant"]] = row[name]
        place = table.column_names.index(name)
        table = table.set_column(place, table.schema.field(name), pa.array(values, table.schema.field(name).type))
    return table


@contextmanager
def workers_named(folder: Folder) -> Iterator[None]:
    """Tells the loss of an executor's workers in one line."""
    try:
        yield
    except (BrokenExecutor, CancelledError) as error:
        text = str(error) or type(error).__name__
        raise StudyError(f"{folder.path}: a worker ended before its shard ({text}); run again to go on") from None
