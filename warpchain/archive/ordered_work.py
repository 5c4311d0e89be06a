"""Work in threads whose results are passed on in order."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

JobType = TypeVar("JobType")
ResultType = TypeVar("ResultType")


class OrderedWork(Generic[JobType, ResultType]):
    """Threads that call `work` on jobs, and `sink` with results in order.

    An error comes out of the next `submit_job` or of `wait_for_jobs`; later jobs are dropped. At most `room` jobs are
    under way.
    """

    def __init__(
        self, work: Callable[[JobType], ResultType], sink: Callable[[ResultType], None], threads: int, room: int
    ) -> None:
        self._work, self._sink = work, sink
        self._pool = ThreadPoolExecutor(threads, "warpchain-encode")
        self._queue: queue.Queue[Future[ResultType] | None] = queue.Queue(room)
        self._error: BaseException | None = None
        self._dropped = False
        self._thread = threading.Thread(target=self._pass_on_results, name="warpchain-write", daemon=True)
        self._thread.start()

    def _pass_on_results(self) -> None:
        """Passes jobs' results to `sink` in order, in its own thread."""
        while (future := self._queue.get()) is not None:
            if self._dropped:
                future.cancel()
                continue
            try:
                self._sink(future.result())
            except BaseException as error:  # to be raised where the user's thread can see it
                self._error, self._dropped = error, True
            del future

    def submit_job(self, job: JobType) -> None:
        """Submits a job to the threads; waits while there is no room."""
        self._raise_error()
        self._queue.put(self._pool.submit(self._work, job))

    def _raise_error(self) -> None:
        """Raises the error of an earlier job, if any."""
        if self._error is not None:
            raise self._error

    def wait_for_jobs(self, drop: bool = False) -> None:
        """Waits until all jobs are done; `drop` drops the rest and any error."""
        if drop:
            self._dropped = True
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self._pool.shutdown(cancel_futures=True)
        if not drop:
            self._raise_error()
