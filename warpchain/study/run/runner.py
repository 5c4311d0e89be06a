"""Runs a study: the folder, the shards that are left, the second pass for the worst variants, the whole table.

Shards run one after the other in this process, each on all cores or the device, or on any executor of
`concurrent.futures`. Whatever ends a run, the same call goes on where it was.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from warpchain.engine.progress import bar as bar_of
from warpchain.engine.progress import completed, interruptible, look_for_stop
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.garbage import rare_collections
from warpchain.study.run.folder import Folder
from warpchain.study.run.merge import finish, merge_study, workers_named
from warpchain.study.run.prepare import prepare
from warpchain.study.run.shards import run_shard
from warpchain.study.run.status import Outcome, study_status

__all__ = ["Outcome", "merge_study", "run_study", "study_status"]

Report = Callable[[float, float], None]
"""Called with (variants done, variants of the whole study)."""
Advance = Callable[[float], object]
"""Called with the number of further variants done, also parts of one."""


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
    grow: bool = False,
) -> Outcome:
    """Runs a study, or what is left of it.

    Args:
        source: the study file.
        out: the study's folder; made if there is none.
        executor: runs the shards; its workers must see the folder under the same name. None runs them here.
        part: (i, n) runs only the shards k with k mod n = i, 0 <= i < n, and leaves the second pass and the whole table
            to `merge_study`.
        parts: workers to keep busy: in a new folder, unless the study states `run.shard`, no shard has more than
            rows / parts rows, rounded up (10 rows in 6 parts make 5 shards of 2).
        workers: CPU threads of a shard; None takes all cores.
        memory: budget of a shard [bytes].
        grow: let a folder grow that holds the same study with fewer points of its design, fewer replicates, or another
            duration or window (`study.run.grow`).
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
    folder = prepare(source, out, max(parts, part[1] if part else 1), workers, memory, grow)
    return run_folder(folder, executor=executor, part=part, workers=workers, memory=memory, progress=progress)


@rare_collections()
@interruptible()
def run_folder(
    folder: Folder,
    *,
    executor: Executor | None = None,
    part: tuple[int, int] | None = None,
    workers: int | None = None,
    memory: int = MEMORY,
    progress: bool | Report = False,
) -> Outcome:
    """Runs what is left of a study's folder; see `run_study`."""
    options = {"workers": workers, "memory": memory}
    mine = [shard for shard in folder.shards if part is None or shard % part[1] == part[0]]
    with _bar(progress, folder, mine) as report:
        left = [shard for shard in mine if not folder.done(shard)]
        if executor is None:
            _run_here(folder, left, options, report)
        else:
            _run_there(folder, left, executor, options, report)
    if part is not None:
        return study_status(folder.path)
    return finish(folder, executor, options, progress is True)


def _run_here(folder: Folder, shards: Sequence[int], options: Mapping[str, Any], report: Advance) -> None:
    """Runs shards one after the other in this process."""
    for shard in shards:
        look_for_stop()
        size, reported = folder.size(shard), 0.0

        def tell(part: float, size: int = size) -> None:
            nonlocal reported
            report(part * size - reported)
            reported = part * size

        run_shard(folder.path, shard, options, tell)
        report(size - reported)


def _run_there(
    folder: Folder, shards: Sequence[int], executor: Executor, options: Mapping[str, Any], report: Advance
) -> None:
    """Runs shards on an executor.

    Raises:
        StudyError: a worker of the executor died, and the executor does not run its shard again.
    """
    futures: dict[Future[int], int] = {}
    try:
        with workers_named(folder):
            for shard in shards:
                futures[executor.submit(run_shard, folder.path.resolve(), shard, options)] = shard
            for future in completed(futures):
                future.result()
                report(folder.size(futures[future]))
    finally:
        for future in futures:
            future.cancel()


@contextmanager
def _bar(progress: bool | Report, folder: Folder, shards: Sequence[int]) -> Iterator[Advance]:
    """What hears how many further variants are done: nobody, a bar with rate and time left, or the caller."""
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
        text = "{desc}: {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} [{elapsed}<{remaining}, {rate_fmt}]"
        name = folder.study.study.name or "study"
        with bar_of(total, name, " variants", done, bar_format=text) as bar:
            yield bar.update
