"""How a benchmark's cases are done: by processes that see some GPUs each, up to a time, and what they found is kept."""

import json
import math
import multiprocessing
import os
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any

Found = tuple[str, dict[str, float]]
"""A line for the reader, and figures by name."""


@dataclass(frozen=True)
class Task:
    """What a worker is to do: a case of a part."""

    part: str
    case: tuple[Any, ...]
    folder: Path  # of the reference's program
    compile_only: bool = False
    quick: bool = False  # fewer repetitions

    @property
    def steps(self) -> int:
        """Steps of a measured launch."""
        return 64 if self.compile_only else 2000

    @property
    def rounds(self) -> int:
        """How often it is measured; the best counts."""
        return 1 if self.compile_only else 2 if self.quick else 3

    @property
    def key(self) -> str:
        """Its name in a store."""
        return " ".join(map(str, (self.part, *self.case)))


def failure(task: Task, reason: object) -> Found:
    """The line of a task that was stopped, with the first line of the reason."""
    words = str(reason).strip() or type(reason).__name__
    return f"{task.key}: failed: {words.splitlines()[0]}", {}


class Store:
    """What was measured, kept in a file if there is one."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.lines: dict[str, Found] = {}
        self._lock = Lock()
        if path is not None and path.exists():
            self.lines = {name: (line, figures) for name, (line, figures) in json.loads(path.read_text()).items()}

    def put(self, task: Task, found: Found) -> None:
        """Adds a case; one that failed is measured again the next time."""
        with self._lock:
            self.lines[task.key] = found
            if self.path is not None:
                kept = {name: (line, figures) for name, (line, figures) in self.lines.items() if figures}
                beside = self.path.with_name(f"{self.path.name}.new")
                beside.write_text(json.dumps(kept))
                beside.replace(self.path)

    @property
    def figures(self) -> dict[str, dict[str, float]]:
        """The figures of each case."""
        return {name: figures for name, (_, figures) in self.lines.items()}


Measure = Callable[[Task], Found]
"""What does a task; an exception is its failure."""


def _serve(connection: Connection, gpus: str, measure: Measure) -> None:
    """A worker's process, which sees these GPUs: one task after the other."""
    import warp as wp

    os.environ["CUDA_VISIBLE_DEVICES"] = gpus
    wp.config.log_level = wp.LOG_ERROR
    warnings.simplefilter("ignore")
    while (task := connection.recv()) is not None:
        try:
            found = measure(task)
        except Exception as error:  # the other cases go on
            found = failure(task, error)
        connection.send(found)


class Worker:
    """A process that does tasks."""

    def __init__(self, gpus: str, measure: Measure) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, gpus, measure))
        self._process.start()
        theirs.close()

    def do(self, task: Task, until: float) -> Found | None:
        """What comes of a task; None if it is not done by `until`, or died: the worker is gone then."""
        try:
            self._connection.send(task)
            if self._connection.poll(None if math.isinf(until) else max(until - time.monotonic(), 0.0)):
                found: Found = self._connection.recv()
                return found
        except (EOFError, OSError):
            pass
        self._process.kill()
        self._process.join()
        return None

    def close(self) -> None:
        """Ends the process."""
        self._connection.send(None)
        self._process.join(10.0)
        if self._process.is_alive():
            self._process.kill()


def results(
    tasks: Sequence[Task],
    workers: Sequence[str],
    measure: Measure,
    until: float = math.inf,
    keep: Callable[[Task, Found], None] = lambda task, found: None,
) -> list[Future[Found]]:
    """What comes of tasks, each done by whichever worker is free; `keep` is told as soon as it is there.

    Args:
        tasks: in the order in which they are begun.
        workers: the GPUs that each of them sees, as CUDA names them.
        measure: does a task in a worker's process.
        until: when all ends, whatever is left (`time.monotonic`).
        keep: may be called by several threads at once.
    """
    waiting: SimpleQueue[tuple[Task, Future[Found]] | None] = SimpleQueue()
    futures: list[Future[Found]] = [Future() for _ in tasks]
    for pair in zip(tasks, futures, strict=True):
        waiting.put(pair)

    def serve(gpus: str) -> None:
        worker = None
        while (pair := waiting.get()) is not None:
            task, future = pair
            found = failure(task, "no time was left for it")
            if time.monotonic() < until:
                worker = worker or Worker(gpus, measure)
                done = worker.do(task, until)
                if done is None:
                    worker = None
                    found = failure(task, "cut off" if time.monotonic() >= until else "its process died")
                else:
                    found = done
            keep(task, found)
            future.set_result(found)
        if worker is not None:
            worker.close()

    for gpus in workers:
        waiting.put(None)
        Thread(target=serve, args=(gpus,), daemon=True).start()
    return futures
