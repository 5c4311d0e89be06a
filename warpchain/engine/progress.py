"""Progress of long work: a bar with rate and time left, or a function of the caller's."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

Report = Callable[[str, float, float], None]
"""Called with (phase, done, total)."""


@contextmanager
def reporter(progress: bool | Report) -> Iterator[Report]:
    """A function to call as work goes on: shows nothing (False), a bar (True), or passes on to the caller's own."""
    if callable(progress):
        yield progress
        return
    if not progress:
        yield lambda phase, done, total: None
        return
    from tqdm import tqdm

    bars: dict[str, Any] = {}

    def report(phase: str, done: float, total: float) -> None:
        if phase not in bars:
            for bar in bars.values():
                bar.close()
            bars[phase] = tqdm(total=total, desc=phase, unit="roller-step", unit_scale=True, dynamic_ncols=True)
        bars[phase].update(done - bars[phase].n)

    try:
        yield report
    finally:
        for bar in bars.values():
            bar.close()


@dataclass
class Stop:
    """Whether the user asked to stop."""

    asked: bool = False


@contextmanager
def interruptible() -> Iterator[Stop]:
    """Makes the first Ctrl-C a request that work checks between its parts; a second one interrupts at once.

    In a thread other than the main one, signals are left as they are.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    previous = signal.getsignal(signal.SIGINT)

    def ask(signum: int, frame: object) -> None:
        stop.asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, ask)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, previous)
