"""GPU benchmark of this tree beside another checkout of it, in one run on one GPU.

    git worktree add ../before REV
    python scripts/bench_trees.py ../before
    python scripts/bench_trees.py ../before --drives engine car --variants 1 1056 4224 --steps 600

For the drives of `bench_gpu.py`, or examples by name, and both precisions, bare and with metrics: 1e9 roller-steps a
second of either tree, each the best of several, and their ratio. Metrics are taken from the step on that `--after`
names: near a run's start extremes are surpassed often, and rollers touch fewer teeth or more. Every tree runs in
processes of its own with its own `bench_gpu.py`; a first round, all of it at once, compiles the kernels.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
DRIVES = ("two", "marine")
COUNTS = (1, 1056, 4224, 16896)
STEPS = 2000
PRECISIONS = ("float64", "float32")
ROWS = """
import sys
tree, name, precision, steps, after = *sys.argv[1:4], *map(int, sys.argv[4:6])
sys.path[:0] = [tree, f"{tree}/scripts"]
import warp as wp
wp.config.log_level = wp.LOG_ERROR
import bench_gpu
from bench_cpu import schedule
from dataclasses import replace
from pathlib import Path
from time import perf_counter
import warpchain
assert Path(warpchain.__file__).resolve().is_relative_to(Path(tree).resolve()), warpchain.__file__
from warpchain import load_drive
from warpchain.drive.examples import drive_path
chosen = dict(zip(("two", "marine"), bench_gpu.DRIVES.values())).get(name) or load_drive(drive_path(name))
def seconds(count, metrics):
    when = schedule(chosen, metrics)
    one = bench_gpu.pack([chosen], [replace(when, window_start=after) if metrics else when])
    engine = bench_gpu.GpuEngine(bench_gpu.repeated(one.at_precision(precision), count), bench_gpu.DEVICE)
    frames = engine.frame_buffer(0)
    for taken in (64 + after, steps):
        begin = perf_counter()
        for future in engine.advance(taken, frames):
            future.result()
        last = perf_counter() - begin
    if engine.progress()["diverged"].any():
        raise SystemExit(f"{count} variants, {precision}: the run diverged")
    engine.close()
    return last
for count in map(int, sys.argv[6:]):
    for metrics in (False, True):
        best = min(seconds(count, metrics) for _ in range(1 if steps < 100 else 3))
        print(count * chosen.chain.links * steps / 1e9 / best)
"""


def rates(tree: Path, drive: str, precision: str, steps: int, after: int, counts: Sequence[int]) -> list[float]:
    """1e9 roller-steps a second of a tree: bare and with metrics for each number of variants."""
    words = [sys.executable, "-c", ROWS, str(tree), drive, precision, str(steps), str(after), *map(str, counts)]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{tree}: {(done.stderr.strip() or 'no output').splitlines()[-1]}")
    return [float(line) for line in done.stdout.splitlines()[-2 * len(counts) :]]


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("other", metavar="TREE", type=Path, help="the other checkout")
    made.add_argument(
        "--drives", metavar="NAME", nargs="+", default=DRIVES, help="two, marine (without friction), or other examples"
    )
    made.add_argument("--variants", metavar="N", nargs="+", type=int, default=COUNTS, help="how many variants")
    made.add_argument("--steps", metavar="N", type=int, default=STEPS, help=f"of a measured launch (default {STEPS})")
    made.add_argument("--after", metavar="N", type=int, default=0, help="steps before them (default 0)")
    return made


def main() -> None:
    """Runs both trees and prints the table."""
    asked = parser().parse_args()
    if not (asked.other / "scripts" / "bench_gpu.py").exists():
        raise SystemExit(
            f"{asked.other}: not a checkout of warpchain; make one with: git worktree add {asked.other} REV"
        )
    trees, cases = (asked.other, HERE), list(product(asked.drives, PRECISIONS))
    with ThreadPoolExecutor(8) as pool:
        compiling = [(tree, *case, 64, 0, asked.variants) for case in cases for tree in trees]
        list(pool.map(lambda job: rates(*job), compiling))
    print("drive             precision  variants            there     here  here/there")
    for name, precision in cases:
        theirs, ours = (rates(tree, name, precision, asked.steps, asked.after, asked.variants) for tree in trees)
        for k, (count, kind) in enumerate(product(asked.variants, ("bare", "metrics"))):
            line = f"{name:17s} {precision}  {count:9d} {kind:8s} {theirs[k]:9.2f} {ours[k]:8.2f}"
            print(f"{line} {ours[k] / theirs[k]:8.3f}", flush=True)


if __name__ == "__main__":
    main()
