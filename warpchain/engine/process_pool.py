"""Pool of processes for many small things that Python's lock keeps from threads."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any

from warpchain.drive.plugins import load_plugins_of_parent, plugins_environment
from warpchain.errors import SimulationError
from warpchain.progress import ProgressReport, completed_futures, ignore_progress, raise_if_stopped
from warpchain.python_process import can_start_python, start_python

FEWEST_THINGS = 16
"""Things that are worth a process's start."""


def map_in_processes(
    work: Callable[[Any], Any],
    things: Sequence[Any],
    workers: int,
    phase: str = "",
    report: ProgressReport = ignore_progress,
) -> list[Any]:
    """Results, or exceptions, of a module's function for many things, in at most `workers` processes.

    `phase` and `report` are for progress.

    Raises:
        SimulationError: a process ended early.
        KeyboardInterrupt: the user asked to stop.
    """
    workers = min(workers, len(things) // FEWEST_THINGS)
    if workers < 2 or not can_start_python():
        found = []
        for thing in things:
            raise_if_stopped()
            found.append(_result_or_error(work, thing))
            report(phase, len(found), len(things))
        return found
    processes = [start_python(__name__, subprocess.PIPE, plugins_environment()) for _ in range(workers)]
    idle: SimpleQueue[subprocess.Popen[bytes]] = SimpleQueue()
    for process in processes:
        idle.put(process)

    def ask(thing: Any) -> Any:
        """Result of work on a thing, by an idle process."""
        process = idle.get()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump((work, thing), process.stdin)
            process.stdin.flush()
            return pickle.load(process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise SimulationError(f"a process ended before its work (exit status {process.wait()})") from None
        finally:
            idle.put(process)

    pool = ThreadPoolExecutor(workers)
    try:
        futures = [pool.submit(ask, thing) for thing in things]
        for done, future in enumerate(completed_futures(futures), 1):
            future.result()
            report(phase, done, len(things))
        return [future.result() for future in futures]
    finally:
        for process in processes:
            process.kill()
        pool.shutdown(cancel_futures=True)
        for process in processes:
            with contextlib.suppress(BrokenPipeError), process:
                process.wait()


def _result_or_error(work: Callable[[Any], Any], thing: Any) -> Any:
    """Result of `work(thing)`, or the exception that it raises."""
    try:
        return work(thing)
    except Exception as error:
        return error


def serve_requests() -> None:
    """Does pickled work from standard input, in a pool's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who asks ends it
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        load_plugins_of_parent()
        while True:
            try:
                work, thing = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            pickle.dump(_result_or_error(work, thing), answers)
            answers.flush()


if __name__ == "__main__":
    serve_requests()
