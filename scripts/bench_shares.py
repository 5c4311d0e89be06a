"""GPU benchmark: many marine drives from their list to the table of metrics, packed all at once and in shares.

    python scripts/bench_shares.py [--each 16896] [--duration 0.2] [--precision float64]

On one GPU and on all, with so many variants a GPU, without settling: seconds from list to table with all packed before
anything is stepped, with one share a GPU, and with as many as `simulate` takes; then, of the last, what each part took
of the CPU, and when the first of it was begun and the last done. Kernels are compiled before.
"""

import argparse
import time
from typing import Any
from unittest.mock import patch

import warp as wp
from bench.clock import Part, noted
from bench_cpu import bench_drives
from bench_gpu import DEVICE, different

from warpchain import Drive, Record, simulate
from warpchain.engine import share, shares, simulation

DIFFERENT = 4096
"""Drives that differ; more are the same ones again."""

PARTS = (
    (simulation, "stacks_of", "sorted into kinds"),
    (share, "pack", "assembled and packed"),
    (share, "settle", "settled"),
    (share, "engine_on", "to the GPU"),
    (share, "_march", "stepped"),
    (share, "engaged", "rollers on teeth"),
    (share, "metrics_blocks", "metrics"),
    (simulation, "metrics_table", "table"),
)


def timed(drives: list[Drive], most: int, options: dict[str, Any]) -> tuple[float, list[Part]]:
    """Seconds from list to table with `most` shares a GPU, 0 for all at once, and the parts, from the begin on."""
    worth = shares.WORTH if most else len(drives) + 1
    with patch.object(shares, "MOST", max(most, 1)), patch.object(shares, "WORTH", worth), noted(PARTS) as found:
        begin = time.perf_counter()
        simulate(drives, record=Record("none"), **options)
        total = time.perf_counter() - begin
    return total, [part._replace(begin=part.begin - begin, end=part.end - begin) for part in found]


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--each", metavar="N", type=int, default=16_896, help="variants a GPU")
    made.add_argument("--duration", metavar="S", type=float, default=0.2, help="simulated time of each")
    made.add_argument("--precision", choices=("float64", "float32"), default="float64")
    return made


def main() -> None:
    """Measures and prints."""
    asked = parser().parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    some = different(bench_drives()["marine drive"].with_values({"run.settle": False}), min(DIFFERENT, asked.each))
    gpus = wp.get_cuda_device_count()
    print(f"{gpus} x {wp.get_device(DEVICE).name}; seconds from list to table, {asked.duration:g} s, {asked.precision}")
    for count, device in dict.fromkeys([(1, DEVICE), (gpus, "cuda")]):
        drives = (some * (count * asked.each // len(some) + 1))[: count * asked.each]
        options = {"device": device, "precision": asked.precision, "duration": asked.duration}
        simulate(drives, record=Record("none"), **(options | {"duration": 0.0002}))  # compiles
        seconds = {most: timed(drives, most, options) for most in (0, 1, shares.MOST)}
        ways = ("at once", "one share a GPU", f"{shares.MOST} shares a GPU")
        told = ", ".join(f"{way} {total:.2f}" for way, (total, _) in zip(ways, seconds.values(), strict=True))
        print(f"{len(drives)} variants on {device}: {told}", flush=True)
        parts = seconds[shares.MOST][1]
        for word in dict.fromkeys(word for _, _, word in PARTS):
            mine = [part for part in parts if part.word == word]
            first, last = min(part.begin for part in mine), max(part.end for part in mine)
            print(f"    {word:22s} {sum(part.cpu for part in mine):6.2f} of CPU, from {first:5.2f} to {last:5.2f}")


if __name__ == "__main__":
    main()
