"""GPU benchmark: where the time of 10,000 different marine drives goes, and what friction costs.

    python scripts/bench_headline.py [whole] [loops] [--count 10000] [--duration 2.0]

`whole`: from a list of drives that differ in five values (the camshaft's torque, the tightener's place, the chain's
elongation, roller mass and damping) to their table of metrics, with friction as the drive stands and without any, by
precision: seconds in all; then packed all at once, seconds in all, of packing, settling, steps before the window and
in it, and of the table; 1e9 roller-steps a second of the steps. `loops`: the time loop alone, from the start, bare
and with metrics: without friction, with that of the joints, of teeth and bar, and of all. Kernels are compiled
before. Without names: both.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import warp as wp
from bench.clock import noted
from bench_cpu import bench_drives
from bench_gpu import DEVICE, bare, different

from warpchain import Drive, Record, load_drive, simulate
from warpchain.drive.examples import drive_path
from warpchain.engine import share, shares, simulation
from warpchain.engine.gpu import GpuEngine

JOINTS = {"chain.joint": {"friction": 0.07, "pin_radius": 0.02224}}
TEETH = {"contact.sprocket.friction": 0.04, "contact.guide.friction": 0.1}
FRICTION: dict[str, dict[str, Any]] = {"none": {}, "joints": JOINTS, "teeth and bar": TEETH, "all": JOINTS | TEETH}


PARTS = (
    (share, "settle", "settling"),
    (share, "metrics_blocks", "table"),
    (simulation, "metrics_table", "table"),
)


@contextmanager
def step_clock(spent: dict[str, float], taken: dict[str, int]) -> Iterator[None]:
    """Adds the seconds of launches to what was spent, and counts their steps: "before" the window begins, or in it."""
    advance = GpuEngine.advance

    def wait(engine: GpuEngine, steps: int, frames: Any) -> list[Any]:
        at, start = engine.progress()["step"][0], engine.packed.drives["window_start"][0]
        word = "before" if at + steps <= start else "window"
        begin = time.perf_counter()
        futures = advance(engine, steps, frames)
        for future in futures:
            future.result()
        spent[word] += time.perf_counter() - begin
        taken[word] += int(engine.progress()["step"][0] - at)
        return list(futures)

    with patch.object(GpuEngine, "advance", wait):
        yield


def whole(title: str, drive: Drive, count: int, precision: str, duration: float) -> None:
    """One run from the list to the table, and its parts."""
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "record": Record(variants="none")}
    drives = different(drive, count)
    simulate(drives, duration=0.001, **options)  # compiles
    begin = time.perf_counter()
    simulate(drives, duration=duration, **options)
    in_shares = time.perf_counter() - begin
    spent: dict[str, float] = defaultdict(float)
    taken: dict[str, int] = defaultdict(int)
    with patch.object(shares, "MOST", 1), step_clock(spent, taken), noted(PARTS) as found:
        begin = time.perf_counter()
        simulate(drives, duration=duration, **options)
        total = time.perf_counter() - begin
    for each in found:
        spent[each.word] += each.end - each.begin
    parts = "".join(f"{spent[name]:9.2f}" for name in ("settling", "before", "window", "table"))
    rest = total - sum(spent.values())
    rates = "".join(f"{count * drive.chain.links * taken[name] / 1e9 / spent[name]:9.1f}" for name in taken)
    print(f"{title:17s} {precision} {in_shares:8.2f} {total:8.2f} {rest:9.2f}{parts} {rates}", flush=True)


def loops(drive: Drive, count: int, precision: str) -> None:
    """The time loop with friction of each kind."""
    found: dict[str, list[float]] = {}
    for name, values in FRICTION.items():
        kind = drive.with_values(values) if values else drive
        work = count * drive.chain.links * 2000 / 1e9
        found[name] = [work / bare(kind, count, precision, 2000, metrics)[0] for metrics in (False, True)]
        parts = " ".join(
            f"{mine:8.2f} ({mine / none:4.2f})" for mine, none in zip(found[name], found["none"], strict=True)
        )
        print(f"{name:17s} {precision} {parts}", flush=True)


def part(word: str) -> str:
    """The name of a part."""
    if word not in ("whole", "loops"):
        raise argparse.ArgumentTypeError(f"{word!r}: allowed are whole, loops")
    return word


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("parts", nargs="*", type=part, help="whole, loops")
    made.add_argument("--count", metavar="N", type=int, default=10_000, help="how many variants")
    made.add_argument("--duration", metavar="S", type=float, default=2.0, help="simulated time of each")
    return made


def main() -> None:
    """Measures and prints."""
    asked = parser().parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    print(wp.get_device(DEVICE).name)
    plain, rubbing = bench_drives()["marine drive"], load_drive(drive_path("marine"))
    if "loops" not in asked.parts or "whole" in asked.parts:
        print(f"\n{asked.count:,} marine drives that differ in five values, {asked.duration:g} s each: seconds")
        print(
            "friction          precision  in all  at once   packing settling   before   window    table  "
            "1e9/s: before, window"
        )
        for title, drive in (("as it stands", rubbing), ("none", plain)):
            for precision in ("float64", "float32"):
                whole(title, drive, asked.count, precision, asked.duration)
    if "whole" not in asked.parts or "loops" in asked.parts:
        print(f"\ntime loop of {asked.count:,}, 2,000 steps: 1e9 roller-steps/s, in parentheses of no friction")
        print("friction          precision     bare        with metrics")
        for precision in ("float64", "float32"):
            loops(plain, asked.count, precision)


if __name__ == "__main__":
    main()
