"""The way of a run through the package: functions called, files passed, moves between them."""

import argparse
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from common.cases import Line, case, case_option, table_head

import warpchain
from warpchain import Record, load_drive, simulate
from warpchain.drive.examples import drive_path

PACKAGE = Path(str(warpchain.__file__)).resolve().parent
TOPS = (PACKAGE, PACKAGE.parent / "kernels")


class CallCounts:
    """Calls of a package's own functions: each function's number, and that of moves from one file to another.

    A move is a call of a function that stands in another file than the nearest caller of the package.
    """

    def __init__(self) -> None:
        self.functions: Counter[CodeType] = Counter()
        self.moves: Counter[tuple[str, str]] = Counter()
        self._files: dict[str, str | None] = {}
        self._lock = threading.Lock()

    def _file_of(self, code: CodeType) -> str | None:
        """Name of the package's file that a function stands in; None where it is of another package."""
        name = code.co_filename
        if name not in self._files:
            path = Path(name).resolve()
            known = Path(name).is_absolute() and any(path.is_relative_to(top) for top in TOPS)
            self._files[name] = str(path.relative_to(PACKAGE.parent)) if known else None
        return self._files[name]

    def _note(self, frame: FrameType, event: str, _: Any) -> None:
        """Counts one call."""
        if event != "call" or (to := self._file_of(frame.f_code)) is None:
            return
        caller, begin = frame.f_back, None
        while caller is not None and (begin := self._file_of(caller.f_code)) is None:
            caller = caller.f_back
        with self._lock:
            self.functions[frame.f_code] += 1
            if begin is not None and begin != to:
                self.moves[begin, to] += 1

    def of(self, work: Callable[[], object]) -> None:
        """Counts the calls of some work, in all its threads."""
        threading.setprofile(self._note)
        sys.setprofile(self._note)
        try:
            work()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)

    @property
    def files(self) -> set[str]:
        """The files whose functions were called."""
        return {name for code in self.functions if (name := self._file_of(code)) is not None}


@case(
    case_option("drives", nargs="*", default=["marine"], metavar="NAME", help="examples (default marine)"),
    case_option("--most", type=int, default=10, help="how many of the most frequent moves are shown (default 10)"),
)
def calls(asked: argparse.Namespace) -> Iterator[Line]:
    """The way of a run: functions that it calls, their files, and the moves between files.

    python scripts/bench.py calls
    python scripts/bench.py calls car v6 --most 20

    Runs `simulate([drive])` for 1 ms on a CPU without a recording, once to compile and load, then under a profiler that
    follows calls. A move is a call into another file of the package; what other packages call back counts for the
    package's function that called them. Kernels are not Python.
    """
    yield table_head("drive | moves between files | functions | files")
    frequent: Counter[tuple[str, str]] = Counter()
    for name in asked.drives:
        drive = load_drive(drive_path(name)).with_values({"run.duration": 1e-3})
        run_once = partial(simulate, [drive], device="cpu", record=Record("none"))
        run_once()
        counts = CallCounts()
        counts.of(run_once)
        frequent += counts.moves
        yield name, sum(counts.moves.values()), len(counts.functions), len(counts.files)
    yield ""
    yield table_head("from | to | moves")
    for (begin, to), number in frequent.most_common(asked.most):
        yield begin, to, number
