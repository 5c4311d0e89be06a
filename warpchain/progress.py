"""Progress of long work: a bar, or a function of the caller's; and an orderly end on Ctrl-C."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from typing import Any

ProgressReport = Callable[[str, float, float], None]
"""Function called with (phase, done, total), the phase a key of `PHASES`."""
Progress = bool | ProgressReport
"""Argument `progress`: False, True for a bar, or a function to call."""

COMPILING, RUNNING, RECORDING = "compiling", "running", "recording"
"""Phases of progress: kernels compile, variants run, and are recorded."""
BAR_TEXT = "{desc}: {percentage:.0f} % of {total:.4g} {unit}"
PHASES: dict[str, dict[str, Any]] = {
    COMPILING: {
        "name": "compiling kernels (the first time only, some 10 s on two free cores)",
        "unit": "kernels",
        "text": "{desc}: {n:.0f} of {total:.0f} done",
        "few": True,
    },
    "settling": {"unit": "drives"},
    "modes": {"unit": "drives"},
    "speeds": {"name": "modes", "unit": "speeds"},
    "phases": {"name": "modes", "unit": "phases"},
    "rides": {"name": "rig", "unit": "rides"},
    "simulating": {"unit": "s", "text": "{desc}: {percentage:.0f} %, {n:.3g} of {total:.4g} {unit} of simulated time"},
    RUNNING: {"unit": "variants"},
    RECORDING: {"name": "recording the worst", "unit": "variants"},
}
"""Settings of `progress_bar` for each phase of long work."""


class ProgressLines:
    """Progress bar for what is no terminal: lines, named as `tqdm`'s."""

    def __init__(
        self, total: float, name: str, unit: str, initial: float = 0.0, text: str = BAR_TEXT, few: bool = False
    ) -> None:
        self.total, self.name, self.unit, self.n, self.initial = total, name, unit, initial, initial
        self.text, self.few, self.start_t = text, few, time.monotonic()
        self.printed = self.start_t - (LINE_INTERVAL if few else 0.0)

    def update(self, more: float) -> None:
        """Adds to the progress done; prints a line when due."""
        self.n += more
        now = time.monotonic()
        if now - self.printed >= LINE_INTERVAL:
            self.printed = now
            elapsed, done = now - self.start_t, self.n - self.initial
            share = 100.0 * self.n / self.total if self.total else 100.0
            line = self.text.format(desc=self.name, percentage=share, n=self.n, total=self.total, unit=self.unit)
            line += f", {duration_text(elapsed)} elapsed"
            if not self.few:
                left = elapsed * (self.total - self.n) / done if done > 0.0 else None
                line += ", time left unknown" if left is None else f", about {duration_text(left)} left"
            print(line, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the progress, as `tqdm` does."""

    def __enter__(self) -> ProgressLines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


LINE_INTERVAL = 10.0
"""Seconds between lines of progress."""


def duration_text(seconds: float) -> str:
    """Text of a time [s], such as "2 min 5 s"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole // 60 % 60} min"


def progress_bar(
    total: float, name: str, unit: str, initial: float = 0.0, text: str = BAR_TEXT, few: bool = False
) -> Any:
    """Progress bar on standard error, or lines where that is no terminal.

    Args:
        total, initial: how much there is to do, and is done before.
        name, unit: of the work, and of `total`.
        text: words before the bar, of `desc`, `percentage`, `n`, `total` and `unit`.
        few: the work has few long parts: the bar starts at once, without a time left.
    """
    if not sys.stderr.isatty():
        return ProgressLines(total, name, unit, initial, text, few)
    from tqdm import tqdm

    shape = f"{text} |{{bar}}| {{elapsed}} elapsed" + ("" if few else ", {remaining} left")
    return tqdm(total=total, initial=initial, desc=name, unit=unit, dynamic_ncols=True, bar_format=shape)


def ignore_progress(phase: str, done: float, total: float) -> None:
    """`ProgressReport` that does nothing."""


def partial_report(report: ProgressReport, phase: str, begin: float, end: float, total: float = 1.0) -> ProgressReport:
    """`ProgressReport` of a part of some work, from `begin` to `end` of `total`."""

    def report_part(part: str, done: float, size: float) -> None:
        """Reports progress of a part as that of the whole work."""
        if part == COMPILING:
            report(part, done, size)
        else:
            report(phase, begin + (end - begin) * done / size, total)

    return report_part


@contextmanager
def progress_reporter(progress: Progress, **settings: Mapping[str, Any]) -> Iterator[ProgressReport]:
    """Context with a `ProgressReport` by a bar, the user's function, or none.

    `settings` of bars, by phase, take the place of `PHASES`.
    """
    if callable(progress):
        yield progress
        return
    if not progress:
        yield ignore_progress
        return
    shown: dict[str, Any] = {}  # the bar of the phase that goes on
    begun: dict[str, float] = {}  # phases come again, and their time goes on

    def close() -> None:
        """Closes the progress bars that are shown."""
        for of in shown.values():
            of.close()
        shown.clear()

    def report(phase: str, done: float, total: float) -> None:
        """Shows a phase's progress in its bar."""
        if phase not in shown:
            close()
            ago = time.monotonic() - begun.setdefault(phase, time.monotonic())
            shown[phase] = progress_bar(total, **{"name": phase, **PHASES[phase], **settings.get(phase, {})})
            shown[phase].start_t -= ago
        shown[phase].update(done - shown[phase].n)
        if phase == COMPILING and done >= total:  # what follows may take long to begin
            close()

    try:
        yield report
    finally:
        close()


class StopRequest:
    """Request of the user to stop; a signal's handler."""

    def __init__(self, around: StopRequest | None = None) -> None:
        self._around, self._asked = around, False

    @property
    def is_asked(self) -> bool:
        """Whether the user asked to stop, here or around."""
        return self._asked or (self._around is not None and self._around.is_asked)

    def ask_to_stop(self) -> None:
        """Asks the work to stop at its next check."""
        self._asked = True

    def __call__(self, signum: int, frame: object) -> None:
        # the first Ctrl-C raises nothing: an exception may be lost, such as in C code that calls Python
        if self._asked:
            raise KeyboardInterrupt
        self.ask_to_stop()


@contextmanager
def interruptible_work() -> Iterator[StopRequest]:
    """Context that makes the first Ctrl-C a request that work checks between its parts.

    Signals stay as they are in other threads and where a shell had them ignored.
    """
    before = signal.getsignal(signal.SIGINT)
    around = before if isinstance(before, StopRequest) else None
    stop = StopRequest(around)
    aside = threading.current_thread() is not threading.main_thread()
    if aside or around is not None or before is signal.SIG_IGN:
        yield stop
        return
    signal.signal(signal.SIGINT, stop)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


def completed_futures(futures: Iterable[Future[Any]]) -> Iterator[Future[Any]]:
    """Futures as they are done; raises KeyboardInterrupt if asked to stop."""
    left = set(futures)
    while left:
        done, left = wait(left, timeout=0.1, return_when=FIRST_COMPLETED)
        raise_if_stopped()
        yield from done


def raise_if_stopped() -> None:
    """Raises KeyboardInterrupt in an `interruptible_work` block if the user asked to stop."""
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, StopRequest) and handler.is_asked:
        raise KeyboardInterrupt
