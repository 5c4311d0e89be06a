"""The command `warpchain warm`: compiles the kernels that runs of drives need, before the first of them."""

from __future__ import annotations

import time
import warnings
from argparse import Namespace
from collections.abc import Iterator
from typing import TYPE_CHECKING

from warpchain.progress import COMPILING, duration_text, progress_reporter

if TYPE_CHECKING:
    from warpchain.drive import Drive

WARMED_EXAMPLES = ("marine", "balance_shafts", "transfer_case")
"""Examples with the kernels of all drives on a CPU up to `MOST_LINKS`."""
MOST_LINKS = 231
SHORT_RUN = 1e-4
"""Time simulated to compile kernels [s]."""


def warm_lines(arguments: Namespace) -> Iterator[str]:
    """Compiles the kernels of drives that arguments name; yields lines to print.

    Raises:
        WarpchainError: a drive that cannot run, or an unknown device.
    """
    from warpchain.drive import load_drive
    from warpchain.drive.examples import drive_path
    from warpchain.engine import start_warp

    start_warp(precompiled=False)
    names = arguments.drives or WARMED_EXAMPLES
    drives = [load_drive(drive_path(name)) for name in names]
    yield "kernels that are not there yet take some 10 s for a drive on two free cores, once on a machine"
    for name, drive in zip(names, drives, strict=True):
        begin = time.monotonic()
        compiled = _compile_kernels(drive, arguments)
        took = f"compiled in {duration_text(time.monotonic() - begin)}" if compiled else "there already"
        yield f"{name}: {took}"


def _compile_kernels(drive: Drive, arguments: Namespace) -> bool:
    """Warms a drive by a short run that compiles kernels; returns whether any were compiled."""
    from warpchain.engine.simulation import simulate
    from warpchain.results.run import Record

    phases = set()
    with progress_reporter(not arguments.quiet) as report, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # such a run is too short for metrics

        def report_compilation(phase: str, done: float, total: float) -> None:
            """Reports compilation while warming, and no other phase."""
            phases.add(phase)
            if phase == COMPILING:
                report(phase, done, total)

        simulate(
            drive,
            device=arguments.device,
            precision=arguments.precision,
            duration=SHORT_RUN,
            record=Record("none"),
            progress=report_compilation,
        )
    return COMPILING in phases
