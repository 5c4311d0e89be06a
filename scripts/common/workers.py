"""Measurements in processes of their own: what fails, dies or hangs leaves the others."""

import math
import multiprocessing
import os
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any


def _quiet() -> None:
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    warnings.simplefilter("ignore")


def pool(count: int) -> ProcessPoolExecutor:
    """Processes that begin afresh and print no warnings."""
    return ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _quiet)


def _end(workers: ProcessPoolExecutor) -> None:
    for process in list((workers._processes or {}).values()):
        process.kill()
    workers.shutdown(wait=False, cancel_futures=True)


def reason(error: BaseException) -> str:
    """The first line of what went wrong."""
    if isinstance(error, BrokenProcessPool):
        return "failed: its process died"
    if isinstance(error, TimeoutError):
        return "failed: cut off"
    return f"failed: {(str(error).strip() or type(error).__name__).splitlines()[0]}"


def _result(job: Future[Any], until: float) -> Any:
    try:
        return job.result(None if math.isinf(until) else max(until - time.monotonic(), 0.0))
    except (Exception, SystemExit) as error:  # the others go on
        return reason(error)


def side_by_side(measure: Callable[..., Any], jobs: Sequence[tuple[Any, ...]]) -> list[Any]:
    """Results of a function for each tuple of arguments, all cores at once; the reason where one failed."""
    workers = pool(max(1, min(len(jobs), len(os.sched_getaffinity(0)))))
    with workers:
        return [_result(job, math.inf) for job in [workers.submit(measure, *words) for words in jobs]]


def one_by_one(
    measure: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], seconds: float = math.inf
) -> Iterator[Any]:
    """Results of a function for each tuple of arguments, in turn in one process; the reason where one failed.

    Args:
        measure: a module's function.
        jobs: its arguments.
        seconds: after how many all ends, whatever is left.
    """
    until, workers = time.monotonic() + seconds, None
    for words in jobs:
        if time.monotonic() >= until:
            yield "failed: no time was left for it"
            continue
        workers = workers or pool(1)
        found = _result(workers.submit(measure, *words), until)
        if isinstance(found, str) and found in ("failed: cut off", "failed: its process died"):
            _end(workers)
            workers = None
        yield found
    if workers is not None:
        workers.shutdown()
