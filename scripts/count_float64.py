"""How many float64 operations stand in the time loop of the block kernels at float32, by what a drive has.

    python scripts/count_float64.py [NAME ...]

Compiles each kernel for CUDA (sm_89; no GPU is needed) and counts arithmetic, comparisons and conversions on float64 in
its intermediate code: in the time loop, and with metrics in what is done at looks and at the window's ends.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import warp as wp

from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kind import BlockKind
from warpchain.results.channels import FRAME

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from ptx import compiled, float64_arithmetic, loop_without_float64, time_loop

SHAPE = (wp.float32, 32, 4)
KINDS = {
    "two sprockets": BlockKind(*SHAPE, 2, 0, curved=False),
    "guide-bar, friction": BlockKind(*SHAPE, 2, 1, sliding=True, bending=True, uneven=True, curved=False),
    "tables": BlockKind(*SHAPE, 2, 0),
    "profiles": BlockKind(*SHAPE, 2, 2, profiles=True, sliding=True, curved=False),
    "moving": BlockKind(*SHAPE, 2, 0, moving=True, curved=False),
    "rk4": BlockKind(*SHAPE, 2, 0, rk4=True, curved=False),
    "tensioner on a sprocket": BlockKind(*SHAPE, 2, 1, moving=True, tensioners=1, curved=False),
    "tensioner on an arm": BlockKind(*SHAPE, 3, 2, arms=1, tensioners=1, profiles=True, sliding=True, curved=False),
    "metrics": BlockKind(*SHAPE, 2, 1, measuring=True, sliding=True, bending=True, curved=False),
    "metrics, moving": BlockKind(*SHAPE, 2, 0, measuring=True, moving=True, curved=False),
}


def counts(kind: BlockKind) -> tuple[int, list[int]]:
    """Operations on float64 in the loop that all steps go around, and in each of the branches beside it."""
    with tempfile.TemporaryDirectory() as folder:
        ptx = compiled(block_kernel(kind, 12, FRAME), Path(folder))
    _, loop = time_loop(ptx)
    _, branches = loop_without_float64(ptx)
    beside = [sum(float64_arithmetic(branch).values()) for branch in branches]
    return sum(float64_arithmetic(loop).values()), sorted(beside, reverse=True)


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("names", metavar="NAME", nargs="*", choices=[[], *KINDS])
    return made


def main() -> None:
    """Prints the table."""
    names = parser().parse_args().names or list(KINDS)
    wp.config.log_level = wp.LOG_ERROR
    for name in names:
        loop, branches = counts(KINDS[name])
        print(f"{name:26s} {loop:6d}   of these in branches: {', '.join(map(str, branches))}", flush=True)


if __name__ == "__main__":
    main()
