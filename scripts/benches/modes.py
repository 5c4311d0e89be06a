"""Modes of many drives that differ."""

import argparse
import os
import time
from collections.abc import Iterator

from common.cases import Line, case, case_option

from benches.drives import drive_by_name, varied_designs
from warpchain import modes as modes_of_drives
from warpchain.engine.simulation import available_cores


def cpu_seconds() -> float:
    """CPU time of this process and of those that it has ended [s]."""
    return sum(os.times()[:4])


@case(
    case_option("--count", type=int, default=64, help="drives (default 64)"),
    case_option("--modes", type=int, default=10, help="of each (default 10)"),
    case_option(
        "--workers", type=int, nargs="+", default=[1, available_cores()], help="processes (default 1, all cores)"
    ),
)
def modes(asked: argparse.Namespace) -> Iterator[Line]:
    """Seconds that modes of marine drives take, which differ as designs do, in places among others.

    python scripts/bench.py modes

    CPU time is that of all processes, their starts of a second or two included, so that what else runs on the machine
    counts little; the last column is what 10,000 drives take at this rate on 16 cores.
    """
    drives = varied_designs(drive_by_name("marine"), "marine", asked.count)
    modes_of_drives(drives[:1], asked.modes)
    yield ("processes", "a second of time", "a drive, CPU time [s]", "10,000 drives on 16 cores [s]")
    for workers in asked.workers:
        begin, spent = time.perf_counter(), cpu_seconds()
        modes_of_drives(drives, asked.modes, workers=workers)
        each = (cpu_seconds() - spent) / asked.count
        yield (workers, asked.count / (time.perf_counter() - begin), each, each * 10_000 / 16)
