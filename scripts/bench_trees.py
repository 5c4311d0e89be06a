"""GPU benchmark of this tree beside another checkout of it, in one run on one GPU.

    git worktree add ../before REV
    python scripts/bench_trees.py ../before

For each drive of `bench_gpu.py` and both precisions, bare and with metrics: 1e9 roller-steps a second of either tree,
each the best of several, and their ratio. Every tree runs in processes of its own with its own `bench_gpu.py`; a first
round, all of it at once, compiles the kernels.
"""

import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
COUNTS = (1, 1056, 4224, 16896)
STEPS = 2000
PRECISIONS = ("float64", "float32")
ROWS = """
import sys
tree, drive, precision, steps = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
sys.path[:0] = [tree, f"{tree}/scripts"]
import warp as wp
wp.config.log_level = wp.LOG_ERROR
import bench_gpu
from pathlib import Path
import warpchain
assert Path(warpchain.__file__).resolve().is_relative_to(Path(tree).resolve()), warpchain.__file__
chosen = list(bench_gpu.DRIVES.values())[drive]
for count in map(int, sys.argv[5:]):
    for metrics in (False, True):
        best = min(bench_gpu.bare(chosen, count, precision, steps, metrics)[0] for _ in range(1 if steps < 100 else 2))
        print(count * chosen.chain.links * steps / 1e9 / best)
"""


def rates(tree: Path, drive: int, precision: str, steps: int) -> list[float]:
    """1e9 roller-steps a second of a tree: bare and with metrics for each number of variants."""
    words = [sys.executable, "-c", ROWS, str(tree), str(drive), precision, str(steps), *map(str, COUNTS)]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{tree}: {(done.stderr.strip() or 'no output').splitlines()[-1]}")
    return [float(line) for line in done.stdout.splitlines()[-2 * len(COUNTS) :]]


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("other", metavar="TREE", type=Path, help="the other checkout")
    return made


def main() -> None:
    """Runs both trees and prints the table."""
    other = parser().parse_args().other
    if not (other / "scripts" / "bench_gpu.py").exists():
        raise SystemExit(f"{other}: not a checkout of warpchain; make one with: git worktree add {other} REV")
    cases = list(product(("two equal 30-tooth sprockets", "marine drive"), PRECISIONS))
    with ThreadPoolExecutor(8) as pool:
        list(
            pool.map(
                lambda job: rates(*job), [(t, c // 2, PRECISIONS[c % 2], 64) for c in range(4) for t in (other, HERE)]
            )
        )
    print("drive                         precision  variants            there     here  here/there")
    for c, (title, precision) in enumerate(cases):
        theirs, ours = (rates(tree, c // 2, precision, STEPS) for tree in (other, HERE))
        for k, (count, kind) in enumerate(product(COUNTS, ("bare", "metrics"))):
            line = f"{title:29s} {precision}  {count:9d} {kind:8s} {theirs[k]:9.2f} {ours[k]:8.2f}"
            print(f"{line} {ours[k] / theirs[k]:8.3f}", flush=True)


if __name__ == "__main__":
    main()
