"""The study command."""

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from common.cases import Line, case, option

from warpchain import Record, Run, load_drive, simulate
from warpchain.drive.examples import drive_path

STUDY = """
[study]
drive = "marine"
[design]
kind = "latin-hypercube"
count = {count}
[[factors]]
name = "torque"
path = "sprockets.camshaft.load.torque"
range = [6e3, 12e3]
[[factors]]
name = "speed"
path = "sprockets.crankshaft.prescribed.speed"
range = [8.0, 11.0]
[[factors]]
name = "indentation"
path = "guides.0.start.0"
range = [-0.835, -0.825]
{adjust}
[run]
duration = {duration}
shard = {shard}
precision = "{precision}"
{device}
"""
ADJUST = '[adjust]\nsprocket = "tightener"\ndirection = [1.0, 0.0]\npreload = 2500.0\n'


def study_text(arguments: argparse.Namespace, count: int) -> str:
    """The study file."""
    return STUDY.format(
        count=count,
        duration=arguments.duration,
        shard=-(-count // arguments.shards),
        precision=arguments.precision,
        adjust=ADJUST if arguments.adjust else "",
        device=f'device = "{arguments.device}"' if arguments.device else "",
    )


def study_seconds(arguments: argparse.Namespace, count: int) -> tuple[float, float, list[dict]]:
    """Time of a study from its file to its table, the part of it outside `simulate`, and the table's rows."""
    from pyarrow import parquet

    from warpchain.study.run import run_study

    inside = 0.0

    def timed(*drives: Any, **settings: Any) -> Run:
        nonlocal inside
        begun = time.perf_counter()
        run = simulate(*drives, **settings)
        inside += time.perf_counter() - begun
        return run

    with tempfile.TemporaryDirectory() as name, mock.patch("warpchain.engine.simulation.simulate", timed):
        folder = Path(name)
        (folder / "study.toml").write_text(study_text(arguments, count))
        begun = time.perf_counter()
        outcome = run_study(folder / "study.toml", folder / "out")
        seconds = time.perf_counter() - begun
        return seconds, seconds - inside, parquet.read_table(outcome.table).to_pylist()


def bare_seconds(arguments: argparse.Namespace, drives: list) -> float:
    """Time of `simulate` for the same drives."""
    size = -(-len(drives) // arguments.shards)
    settings = {"device": arguments.device, "precision": arguments.precision, "duration": arguments.duration}
    begun = time.perf_counter()
    for first in range(0, len(drives), size):
        simulate(drives[first : first + size], record=Record("none"), **settings)
    return time.perf_counter() - begun


@dataclass(frozen=True)
class Times:
    """Seconds of each round: `simulate` and its table, the study, the study outside `simulate`; CPU time of both."""

    asked: argparse.Namespace
    bare: list[float]
    study: list[float]
    own: list[float]
    busy: tuple[float, float]

    @property
    def overhead(self) -> float:
        """What the study takes more, as a part of `simulate`."""
        return statistics.median(self.study) / statistics.median(self.bare) - 1.0

    def lines(self) -> list[str]:
        """For the reader."""
        count, (alone, whole) = self.asked.count, (statistics.median(s) for s in (self.bare, self.study))
        part = statistics.median(own / (study - own) for own, study in zip(self.own, self.study, strict=True))
        each = 1e3 * statistics.median(self.own) / count
        bare, study = self.busy
        return [
            f"simulate: {' '.join(f'{s:.2f}' for s in self.bare)} s, median {count / alone:.1f} variants/s",
            f"study: {' '.join(f'{s:.2f}' for s in self.study)} s, median {count / whole:.1f} variants/s",
            f"overhead: {100.0 * self.overhead:+.1f} % of simulate",
            f"CPU time: {bare:.2f} s, {study:.2f} s: {100.0 * (study / bare - 1.0):+.1f} %",
            f"outside simulate: {100.0 * part:.1f} % of it, {each:.2f} ms a variant",
        ]


def same_drives(arguments: argparse.Namespace, rows: list[dict]) -> list:
    """The drives of a study's rows."""
    base = load_drive(drive_path("marine"))
    places = {
        "torque": "sprockets.camshaft.load.torque",
        "speed": "sprockets.crankshaft.prescribed.speed",
        "indentation": "guides.0.start.0",
    }
    drives = []
    for row in rows:
        values = {path: row[name] for name, path in places.items()}
        if arguments.adjust:
            values["sprockets.tightener.center.0"] = base.sprockets[1].center[0] + row["adjusted_travel"]
        drives.append(base.with_values(values))
    return drives


def times_of(arguments: argparse.Namespace) -> Times:
    """Runs both in turns, after a short study that compiles and tells the rows."""
    short = argparse.Namespace(**vars(arguments) | {"duration": min(arguments.duration, 0.001)})
    *_, rows = study_seconds(short, arguments.count)
    drives = same_drives(arguments, rows)
    bare, study, own, busy = [], [], [], [0.0, 0.0]
    for _ in range(arguments.repeats):
        marks = [time.process_time()]
        bare.append(bare_seconds(arguments, drives))
        marks.append(time.process_time())
        seconds, outside, rows = study_seconds(arguments, arguments.count)
        marks.append(time.process_time())
        study.append(seconds)
        own.append(outside)
        busy = [total + end - begun for total, begun, end in zip(busy, marks, marks[1:], strict=False)]
    assert all(row["status"] != "infeasible" for row in rows)
    return Times(arguments, bare, study, own, (busy[0], busy[1]))


@case(
    option("--count", type=int, default=1000, help="variants (default 1000)"),
    option("--duration", type=float, default=0.005, help="simulated seconds (default 0.005)"),
    option("--shards", type=int, default=2, help="number of shards (default 2)"),
    option("--repeats", type=int, default=3, help="times that each is taken (default 3)"),
    option("--precision", default="float64", choices=["float64", "float32"]),
    option("--device", help="as in simulate; default the best there is"),
    option("--adjust", action="store_true", help="also adjust the tightener to a preload"),
)
def study(asked: argparse.Namespace) -> Iterator[Line]:
    """Variants a second from study file to table, beside bare `simulate` of the same drives.

    python scripts/bench.py study                          # 1,000 marine variants of 5 ms on the CPU
    python scripts/bench.py study --count 200 --shards 4
    python scripts/bench.py study --count 10000 --duration 2 --shards 1 --repeats 1 --device cuda

    Bare `simulate` is one call with drives that are there already, in shards of the same size, metrics for all, nothing
    recorded. A study reads its file, makes the design, the drives, the shards' files and the table. Both are timed in
    turns in one process, after a warm-up that compiles; the median of each counts. The study's own work is also timed
    apart, as what its runs spend outside `simulate`, and the process's CPU time: other work disturbs both less.
    """
    times = times_of(asked)
    yield f"{asked.count} marine variants of {asked.duration:g} s, {asked.shards} shards, {asked.precision}"
    yield from times.lines()
