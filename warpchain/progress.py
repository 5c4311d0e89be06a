"""Progress of long work: a bar with rate and time left, or a function of the caller's."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from typing import Any

Report = Callable[[str, float, float], None]
"""Called with (phase, done, total)."""

COMPILING = "compiling"
"""The phase that counts kernels, where others count roller-steps."""


class Lines:
    """A bar for what is no terminal, such as a job's log: a line every `EVERY` seconds, and none of quick work.

    Attributes:
        n: how much is done.
    """

    def __init__(self, total: float, name: str, unit: str, initial: float = 0.0) -> None:
        self.total, self.name, self.unit, self.n, self.initial = total, name, unit.strip(), initial, initial
        self.begun = self.printed = time.monotonic()

    def update(self, more: float) -> None:
        """Notes that more is done."""
        self.n += more
        now = time.monotonic()
        if now - self.printed >= EVERY:
            self.printed = now
            gone, done = now - self.begun, self.n - self.initial
            left = f"{clock(gone * (self.total - self.n) / done)} left" if done > 0.0 else "time left unknown"
            share = 100.0 * self.n / self.total if self.total else 100.0
            line = f"{self.name}: {share:.0f} % of {self.total:.4g} {self.unit}, {clock(gone)} gone, {left}"
            print(line, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends it."""

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


EVERY = 10.0
"""Seconds between lines of progress."""


def clock(seconds: float) -> str:
    """Seconds as hours, minutes and seconds."""
    whole = max(0, round(seconds))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def bar(total: float, name: str, unit: str, initial: float = 0.0, **settings: Any) -> Any:
    """A bar on standard error, with `update`, `n` and `close`; lines where that is no terminal."""
    if not sys.stderr.isatty():
        return Lines(total, name, unit, initial)
    from tqdm import tqdm

    return tqdm(total=total, initial=initial, desc=name, unit=unit, dynamic_ncols=True, **settings)


@contextmanager
def reporter(progress: bool | Report) -> Iterator[Report]:
    """A function to call as work goes on: shows nothing (False), a bar (True), or passes on to the caller's own."""
    if callable(progress):
        yield progress
        return
    if not progress:
        yield lambda phase, done, total: None
        return
    shown: dict[str, Any] = {}  # the bar of the phase that goes on

    def close() -> None:
        for of in shown.values():
            of.close()
        shown.clear()

    def report(phase: str, done: float, total: float) -> None:
        if phase not in shown:
            close()
            counts = phase == COMPILING
            shown[phase] = bar(total, phase, "kernel" if counts else "roller-step", unit_scale=not counts)
        shown[phase].update(done - shown[phase].n)

    try:
        yield report
    finally:
        close()


class Stop:
    """Whether the user asked to stop; as handler of a signal it takes the first for that, and a second one interrupts.

    An exception in the midst of anything may be lost: code in C that calls Python takes it for an error of its own, or
    goes on without it.

    Attributes:
        asked: whether the user asked to stop, here or around it.
    """

    def __init__(self, around: Stop | None = None) -> None:
        self._around, self._asked = around, False

    @property
    def asked(self) -> bool:
        return self._asked or (self._around is not None and self._around.asked)

    def ask(self) -> None:
        """Ends the work at its next look."""
        self._asked = True

    def __call__(self, signum: int, frame: object) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self.ask()


@contextmanager
def interruptible() -> Iterator[Stop]:
    """Makes the first Ctrl-C a request that work checks between its parts; a second one interrupts at once.

    Within another such block the request is to both. In a thread other than the main one, and where a shell had the
    signal ignored, signals are left as they are.
    """
    before = signal.getsignal(signal.SIGINT)
    around = before if isinstance(before, Stop) else None
    stop = Stop(around)
    aside = threading.current_thread() is not threading.main_thread()
    if aside or around is not None or before is signal.SIG_IGN:
        yield stop
        return
    signal.signal(signal.SIGINT, stop)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


def completed(futures: Iterable[Future[Any]]) -> Iterator[Future[Any]]:
    """Futures as they are done; between them it is looked whether the user asked to stop.

    Raises:
        KeyboardInterrupt: the user did.
    """
    left = set(futures)
    while left:
        done, left = wait(left, timeout=0.1, return_when=FIRST_COMPLETED)
        look_for_stop()
        yield from done


def look_for_stop() -> None:
    """Between two parts of work in an `interruptible` block: ends it if the user asked to stop.

    Raises:
        KeyboardInterrupt: the user did.
    """
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, Stop) and handler.asked:
        raise KeyboardInterrupt
