"""Speed of one commit on the CPU beside another's, in one run: what a change has cost.

    python scripts/bench_guard.py main~1 main

Checks both out into a temporary folder, runs each in processes of its own, in turns A B A B, and takes of each case the
best but one of the rounds in CPU time, so that others on the machine hardly count: the time loop of two drives, bare,
with metrics and at float32, of one variant and of eight; assembly of 200 different variants. Both run the drives of A.
Prints B over A, and exits 1 where a case of B is slower than `--limit` allows.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench_cpu import TWO_SPROCKETS, best_but_one

HERE = Path(__file__).resolve().parents[1]
LIMIT = 0.97
"""Rounds of the same commit differ by less (docs/performance.md)."""

RATES = """
import json, sys, time
asked = json.load(sys.stdin)
sys.path.append(asked["tree"] + "/scripts")
import warp as wp
wp.config.log_level = wp.LOG_ERROR
from bench_cpu import schedule
from pathlib import Path
import warpchain
from warpchain import loads_drive
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.pack import pack
from warpchain.results.schedule import Schedule
assert Path(warpchain.__file__).resolve().is_relative_to(Path(asked["tree"]).resolve()), warpchain.__file__
found = {}
for title, text in asked["drives"].items():
    drive = loads_drive(text)
    for kind, precision in (("bare", "float64"), ("metrics", "float64"), ("float32", "float32")):
        when = schedule(drive, kind == "metrics")
        for variants in (1, 8):
            engine = CpuEngine(pack([drive] * variants, [when] * variants).at_precision(precision), 1)
            frames = engine.frame_buffer(1)
            def run(steps):
                begin = time.process_time()
                for future in engine.advance(steps, frames):
                    future.result()
                return time.process_time() - begin
            run(64)
            steps = asked["steps"] // variants
            found[f"{title}, {kind}, {variants}"] = variants * drive.chain.links * steps / run(steps) / 1e6
            engine.close()
base = loads_drive(asked["drives"]["marine"])
names = [sprocket.name for sprocket in base.sprockets]
drives = []
for k in range(asked["assembled"]):
    sprocket = base.sprockets[-1]
    x, y = sprocket.center
    mass = base.chain.roller_mass * (1.0 + 1e-5 * k)
    drives.append(base.with_values({f"sprockets.{sprocket.name}.center": [x + 1e-7 * k, y], "chain.roller_mass": mass}))
begin = time.process_time()
pack(drives, [Schedule(1e-6, 10, 0, 10, 0)] * len(drives))
found[f"assembly of {len(drives)}, variants a second"] = len(drives) / (time.process_time() - begin)
print(json.dumps(found))
"""


def rates(tree: Path, drives: dict[str, str], steps: int, assembled: int) -> dict[str, float]:
    """What a tree does, by case: millions of roller-steps a second of CPU time, and variants assembled a second."""
    asked = {"tree": str(tree), "drives": drives, "steps": steps, "assembled": assembled}
    done = subprocess.run(
        [sys.executable, "-c", RATES],
        input=json.dumps(asked),
        env=os.environ | {"PYTHONPATH": str(tree)},
        cwd=tree,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise SystemExit(f"{tree.name}: {(done.stderr.strip() or 'no output').splitlines()[-1]}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


@contextmanager
def checkout(folder: Path, name: str, commit: str) -> Iterator[Path]:
    """A commit's tree in a folder of its own, while it is wanted."""
    tree = folder / name
    done = subprocess.run(
        ["git", "-C", str(HERE), "worktree", "add", "--detach", str(tree), commit], capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"{commit}: {done.stderr.strip().splitlines()[-1]}")
    try:
        yield tree
    finally:
        subprocess.run(["git", "-C", str(HERE), "worktree", "remove", "--force", str(tree)], capture_output=True)


def drives_of(tree: Path) -> dict[str, str]:
    """The drives that both run, as text."""
    marine = (tree / "warpchain" / "drive" / "examples" / "marine.toml").read_text(encoding="utf-8")
    return {"two equal 30-tooth sprockets": TWO_SPROCKETS, "marine": marine}


def table(a: dict[str, float], b: dict[str, float], limit: float) -> list[str]:
    """A line for each case; those where B is slower than `limit` times A end in a mark."""
    lines = [f"{'case':46s} {'A':>9s} {'B':>9s}    B/A"]
    for case, before in a.items():
        ratio = b[case] / before
        lines.append(f"{case:46s} {before:9.1f} {b[case]:9.1f} {ratio:6.3f}{'  slower' if ratio < limit else ''}")
    return lines


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("a", metavar="A", help="a commit")
    made.add_argument("b", metavar="B", help="the commit to hold against it")
    made.add_argument("--rounds", type=int, default=5, help="rounds, of which the best but one counts (default 5)")
    made.add_argument("--steps", type=int, default=40_000, help="steps of each timed run (default 40000)")
    made.add_argument("--assembled", type=int, default=200, help="variants assembled (default 200)")
    made.add_argument("--limit", type=float, default=LIMIT, help=f"least B over A (default {LIMIT})")
    return made


def main() -> int:
    """Runs both and prints the table."""
    asked = parser().parse_args()
    with (
        tempfile.TemporaryDirectory() as name,
        checkout(Path(name), "a", asked.a) as a,
        checkout(Path(name), "b", asked.b) as b,
    ):
        drives = drives_of(a)
        found: dict[Path, dict[str, list[float]]] = {a: {}, b: {}}
        for tree in (a, b):
            rates(tree, drives, 64, 2)  # compiles
        for _ in range(asked.rounds):
            for tree in (a, b):
                for case, rate in rates(tree, drives, asked.steps, asked.assembled).items():
                    found[tree].setdefault(case, []).append(rate)
        before, after = ({case: best_but_one(of) for case, of in found[tree].items()} for tree in (a, b))
        lines = table(before, after, asked.limit)
    print("\n".join([f"A: {asked.a}, B: {asked.b}; million roller-steps a second of CPU time, one thread", *lines]))
    return int(any(line.endswith("slower") for line in lines))


if __name__ == "__main__":
    sys.exit(main())
