"""The study command."""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from common.cases import Line, case, case_option
from common.timing import function_times, job_seconds

from warpchain import Record, open_study, run_study, simulate
from warpchain.engine import simulation

STUDY = """
factors = [
  {{ name = "torque", path = "sprockets.camshaft.load.torque", range = [6e3, 12e3] }},
  {{ name = "speed", path = "sprockets.crankshaft.prescribed.speed", range = [8.0, 11.0] }},
  {{ name = "indentation", path = "guides.0.start.0", range = [-0.835, -0.825] }},
]
[study]
drive = "marine"
[design]
kind = "latin-hypercube"
count = {count}
{adjust}
[run]
duration = {duration}
shard = {shard}
precision = "{precision}"
{device}
"""
ADJUST = '[adjust]\nsprocket = "tightener"\ndirection = [1.0, 0.0]\npreload = 2500.0\n'


def both_clocks(job: Callable[[], object]) -> tuple[float, float]:
    """Seconds of a job, and of CPU time."""
    begin = time.process_time()
    return job_seconds(job), time.process_time() - begin


@case(
    case_option("--count", type=int, default=1000, help="variants (default 1000)"),
    case_option("--duration", type=float, default=0.005, help="simulated seconds (default 0.005)"),
    case_option("--shards", type=int, default=2, help="number of shards (default 2)"),
    case_option("--repeats", type=int, default=3, help="times that each is taken (default 3)"),
    case_option("--precision", default="float64", choices=["float64", "float32"]),
    case_option("--device", help="as in simulate; default the best there is"),
    case_option("--adjust", action="store_true", help="also adjust the tightener to a preload"),
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
    shard = -(-asked.count // asked.shards)
    more = {"adjust": ADJUST if asked.adjust else "", "device": f'device = "{asked.device}"' if asked.device else ""}
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "study.toml"
        file.write_text(STUDY.format(**vars(asked) | more, shard=shard))
        known = open_study(file)
        drives = known.drives(known.design_rows())

        def simulate_drives(duration: float = asked.duration) -> None:
            """Simulates the study's drives without a study."""
            options = {"device": asked.device, "precision": asked.precision, "duration": duration}
            for first in range(0, asked.count, shard):
                simulate(drives[first : first + shard], record=Record("none"), **options)

        simulate_drives(0.001)
        alone, whole, own = [], [], []
        for turn in range(asked.repeats):
            alone.append(both_clocks(simulate_drives))
            with function_times(time.perf_counter, (simulation, "simulate")) as runs:
                whole.append(both_clocks(partial(run_study, file, Path(name) / f"{turn}")))
            own.append(whole[-1][0] - sum(runs))
    yield f"{asked.count} marine variants of {asked.duration:g} s, {asked.shards} shards, {asked.precision}"
    yield ("", "s", "variants/s", "CPU time [s]")
    middle = []
    for what, times in (("simulate", alone), ("study", whole)):
        wall, busy = (statistics.median(of) for of in zip(*times, strict=True))
        middle.append((wall, busy))
        yield (what, " ".join(f"{taken:.2f}" for taken, _ in times), asked.count / wall, busy)
    above = [100.0 * (theirs / ours - 1.0) for ours, theirs in zip(*middle, strict=True)]
    yield f"more of the study: {above[0]:+.1f} % of the time, {above[1]:+.1f} % of CPU time"
    outside, inside = statistics.median(own), middle[1][0] - statistics.median(own)
    each = 1e3 * outside / asked.count
    yield f"outside simulate: {100.0 * outside / inside:.1f} % of it, {each:.2f} ms a variant"
