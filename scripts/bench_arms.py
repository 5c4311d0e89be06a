"""Many variants of the example `car`, with an arm and a hydraulic tensioner: how long they take, and how they end.

    python scripts/bench_arms.py 256 --device cuda

They differ in the preload of the tensioner's spring, 60 to 120 N, and run 20 ms with metrics at both precisions.
"""

import argparse
import time
from collections.abc import Sequence

import numpy as np

from warpchain import Record, load_drive, simulate
from warpchain.drive.examples import drive_path


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("count", type=int, nargs="?", default=256, metavar="N", help="variants; default 256")
    made.add_argument("--device", help="such as cuda or cpu; default what `simulate` takes")
    return made


def main(words: Sequence[str] | None = None) -> None:
    """Runs and prints."""
    chosen = parser().parse_args(words)
    base = load_drive(drive_path("car"))
    name = base.tensioners[0].name
    preloads = np.linspace(60.0, 120.0, chosen.count).tolist()
    drives = [base.with_values({f"tensioners.{name}.spring.preload": n, "run.duration": 0.02}) for n in preloads]
    for precision in ("float64", "float32"):
        best = float("inf")
        for _ in range(2):  # the first compiles
            begin = time.perf_counter()
            run = simulate(drives, device=chosen.device, precision=precision, record=Record("none"))
            best = min(best, time.perf_counter() - begin)
        residual = np.abs(np.array(run.metrics["energy_residual_relative"].to_pylist(), dtype=float)).max()
        force = np.mean(run.metrics[f"{name}.force_mean"].to_pylist())
        ended = f"{run.ok.sum()} of {chosen.count} ok, residual {residual:.1e}"
        print(f"{precision}: {best:.2f} s, {ended}, mean push {force:.4f} N")


if __name__ == "__main__":
    main()
