"""A drive as an FMU beside `stepping`: size, start, time a step."""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common.cases import Line, case, case_option
from common.drives import example_drive
from common.timing import job_seconds

from warpchain import Drive, export_fmu, stepping

CHUNK = 10_000
"""Steps between two readings of the clock."""


def started_slave(path: Path, folder: Path) -> tuple[Any, list[int], float]:
    """Initialized instance of an FMU, value references of its outputs, and the seconds that its start takes."""
    from fmpy import extract, read_model_description
    from fmpy.fmi3 import FMU3Slave

    described, unpacked = read_model_description(str(path)), extract(str(path), str(folder))
    begin = time.perf_counter()
    slave = FMU3Slave(
        guid=described.guid,
        unzipDirectory=unpacked,
        modelIdentifier=described.coSimulation.modelIdentifier,
        instanceName="one",
    )
    slave.instantiate()
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    seconds = time.perf_counter() - begin
    return slave, [each.valueReference for each in described.modelVariables if each.causality == "output"], seconds


def microseconds_a_step(advance: Any, h: float, turns: int, piece: int) -> float:
    """Least time of a step [us] of `turns` times `CHUNK` steps in pieces; `advance` takes from t on by dt [s]."""
    found, step = [], 0
    for _ in range(turns):
        begin = time.thread_time()  # which others on the machine do not lengthen
        for _ in range(CHUNK // piece):
            advance(step * h, piece * h)
            step += piece
        found.append(time.thread_time() - begin)
    return 1e6 * min(found) / CHUNK


def measured_row(name: str, drive: Drive, turns: int, piece: int) -> tuple[str, ...]:
    """Row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"{name}.fmu")
        export_fmu(drive, path)  # so that kernels are compiled
        made = job_seconds(lambda: export_fmu(drive, path))
        size = path.stat().st_size
        slave, outputs, start = started_slave(path, Path(folder, "unpacked"))

        def do_step(time: float, size: float) -> None:
            """A communication step, with all outputs."""
            slave.doStep(time, size)
            slave.getFloat64(outputs)

        begin = time.perf_counter()
        with stepping(drive, device="cpu", workers=1, duration=2.0, window=(1.9, 2.0)) as run:
            settled, h = time.perf_counter() - begin, run.step
            longest = microseconds_a_step(do_step, h, turns, CHUNK)
            slave.reset()
            slave.enterInitializationMode()
            slave.exitInitializationMode()
            short = microseconds_a_step(do_step, h, turns, piece)
            own = microseconds_a_step(lambda _, size: run.advance(size), h, turns, CHUNK)
    return (
        name,
        f"{size / 1e3:.0f} kB",
        f"{made:.1f} s",
        f"{1e3 * start:.1f} ms",
        f"{longest:.2f}",
        f"{short:.2f}",
        f"{1e3 * settled:.0f} ms",
        f"{own:.2f}",
    )


@case(
    case_option("--drives", nargs="+", default=["conveyor", "car", "v6"], metavar="NAME", help="examples"),
    case_option("--steps", type=int, default=30, help="of a communication step (default 30)"),
    case_option("--turns", type=int, default=10, help="times 10000 steps, the fastest of which count (default 10)"),
)
def fmu(asked: argparse.Namespace) -> Iterator[Line]:
    """A drive as an FMU in FMPy: size, time of the export with compiled kernels, start, and time a step.

    python scripts/bench.py fmu

    Steps are in pieces of 10000 and of 30, of which each ends with all outputs. Beside them is a run of `stepping`,
    which steps as `simulate` does: how long it takes until it is packed and settled, and its step, both without metrics
    on one core. Needs the extra fmu.
    """
    steps = f"of {asked.steps}"
    yield ("drive", "file", "export", "start", "us a step", steps, "start of stepping", "us a step")
    for name in asked.drives:
        yield measured_row(name, example_drive(name), asked.turns, asked.steps)
