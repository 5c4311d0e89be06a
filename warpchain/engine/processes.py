"""Work in processes of its own: kernels to compile, and many small things, which Python's lock keeps from threads."""

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

from warpchain.errors import SimulationError
from warpchain.progress import ProgressReport, completed_futures, ignore_progress, raise_if_stopped
from warpchain.python_process import can_start_python, start_python

FEWEST = 16
"""Things for which a process is worth its start, which takes a second or two."""


def each(
    work: Callable[[Any], Any],
    things: Sequence[Any],
    workers: int,
    phase: str = "",
    report: ProgressReport = ignore_progress,
) -> list[Any]:
    """A function's answers for many things, in their order; an exception is the answer where it raises one.

    Few things are done here, one after the other.

    Args:
        work: a function of a module, or `functools.partial` of one; it, things and answers can be pickled.
        workers: processes at most.
        phase, report: what is told as they are done, in things.

    Raises:
        SimulationError: a process ended before its work, as for lack of memory.
        KeyboardInterrupt: the user asked to stop.
    """
    workers = min(workers, len(things) // FEWEST)
    if workers < 2 or not can_start_python():
        found = []
        for thing in things:
            raise_if_stopped()
            found.append(_tried(work, thing))
            report(phase, len(found), len(things))
        return found
    processes = [start_python(__name__, subprocess.PIPE) for _ in range(workers)]
    idle: SimpleQueue[subprocess.Popen[bytes]] = SimpleQueue()
    for process in processes:
        idle.put(process)

    def ask(thing: Any) -> Any:
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


def _tried(work: Callable[[Any], Any], thing: Any) -> Any:
    try:
        return work(thing)
    except Exception as error:
        return error


def serve() -> None:
    """Answers what is asked on standard input, on what was standard output, until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who asks ends it
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        while True:
            try:
                work, thing = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            pickle.dump(_tried(work, thing), answers)
            answers.flush()


if __name__ == "__main__":
    serve()
