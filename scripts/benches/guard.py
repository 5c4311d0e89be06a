"""Speed of one tree beside another's, in one run."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from itertools import product
from pathlib import Path
from typing import Any

from common.cases import ROOT, Line, case, case_option
from common.drives import SMOOTH
from common.drives import TWO as TWO_FILE
from common.timing import second_best_rate

from benches.drives import TWO

PRECISIONS = ("float64", "float32")
LIMIT = 0.97
"""Rounds of the same commit differ by less."""
USUAL: dict[str, list[Any]] = {
    "drives": [["two", "marine"], ["two", "smooth"]],
    "variants": [[1, 8], [1, 1056, 4224, 16896]],
    "steps": [40_000, 2000],
    "assembled": [200, 0],
    "rounds": [5, 3],
}
"""The values of options that are not given, on the CPU and on a GPU."""


def tree_rates(tree: Path, asked: Mapping[str, Any]) -> dict[str, float]:
    """Rates of a tree by case, measured by `probe.py` in a process of its own.

    Raises:
        SystemExit: it failed, with its last line.
    """
    done = subprocess.run(
        [sys.executable, "-P", str(ROOT / "scripts" / "benches" / "probe.py")],
        input=json.dumps({"tree": str(tree), **asked}),
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tree), os.environ.get("PYTHONPATH", "")])},
        cwd=tree,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise SystemExit(f"{tree.name}: {(done.stderr.strip() or 'no output').splitlines()[-1]}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


@contextmanager
def tree_checkout(folder: Path, name: str, commit: str) -> Iterator[Path]:
    """Folder of a tree: a folder as it is, or a commit's files in a temporary one."""
    if Path(commit).is_dir():
        yield Path(commit).resolve()
        return
    git, tree = ["git", "-C", str(ROOT), "worktree"], folder / name
    done = subprocess.run([*git, "add", "--detach", str(tree), commit], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{commit}: {done.stderr.strip().splitlines()[-1]}")
    try:
        yield tree
    finally:
        subprocess.run([*git, "remove", "--force", str(tree)], capture_output=True)


def guard_drives(tree: Path, names: Sequence[str]) -> dict[str, tuple[str, dict[str, Any]]]:
    """File and values of the drives that both trees run; the files are those of one tree."""
    examples = tree / "warpchain" / "drive" / "examples"
    special = {"two": (str(TWO_FILE), TWO), "smooth": (str(examples / "marine.toml"), SMOOTH)}
    return {name: special.get(name, (str(examples / f"{name}.toml"), {})) for name in names}


def guard_table(a: Mapping[str, float], b: Mapping[str, float], limit: float) -> list[tuple[Any, ...]]:
    """A row for each case; those where B is slower than `limit` times A end in a mark."""
    head = ("drive, precision, variants", "A", "B", "B/A", "")
    rows = [(name, a[name], b[name], f"{b[name] / a[name]:.3f}") for name in a]
    return [head, *((*row, "slower" if b[row[0]] / a[row[0]] < limit else "") for row in rows)]


def compile_in_trees(trees: Sequence[Path], asked: Mapping[str, Any]) -> None:
    """Compiles the kernels that trees run, a drive and a precision in each process."""
    short = {**asked, "steps": 64, "after": 0, "repeats": 1, "assemble": 0}
    jobs = [
        (tree, {**short, "drives": {name: drive}, "precisions": [precision]})
        for name, drive in asked["drives"].items()
        for tree, precision in product(trees, asked["precisions"])
    ]
    with ThreadPoolExecutor(min(8, len(os.sched_getaffinity(0)))) as pool:
        list(pool.map(lambda job: tree_rates(*job), jobs))


@case(
    case_option("a", metavar="A", help="a commit, or the folder of a tree"),
    case_option("b", metavar="B", nargs="?", default=str(ROOT), help="what to hold against it (default this tree)"),
    case_option("--device", default="cpu", help="cpu (one core, CPU time; default) or such as cuda:0"),
    case_option("--drives", nargs="+", metavar="NAME", help="two, smooth (marine without friction), or examples"),
    case_option("--variants", nargs="+", type=int, metavar="N", help="how many at once"),
    case_option("--steps", type=int, help="of a launch (of one variant on the CPU, of any number on a GPU)"),
    case_option("--after", type=int, default=0, help="steps before them, which the metrics leave out"),
    case_option("--rounds", type=int, help="of which the best but one counts"),
    case_option("--assembled", type=int, help="variants of each drive that are assembled"),
    case_option("--limit", type=float, default=LIMIT, help=f"least B over A (default {LIMIT})"),
)
def guard(asked: argparse.Namespace) -> Iterator[Line]:
    """Speed of one tree beside another's in one run: what a change has cost.

    python scripts/bench.py guard main~1 main
    python scripts/bench.py guard ../before --device cuda:0

    Both are run in processes of their own, in turns A B A B: the time loop of drives without and with metrics, at both
    precisions, and on the CPU the assembly of variants that differ. Both run the drive files of A. Rates are
    1e6 roller-steps a second (of CPU time on the CPU, so that others on the machine hardly count), and drives a
    second. The exit status is 1 where B is below `--limit` times A. Metrics are taken from step `--after` on: near a
    run's start extremes are surpassed often, and rollers touch fewer teeth or more.
    """
    on_gpu = asked.device != "cpu"
    chosen = {name: getattr(asked, name) or usual[on_gpu] for name, usual in USUAL.items()}
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        trees = [stack.enter_context(tree_checkout(Path(name), side, getattr(asked, side))) for side in ("a", "b")]
        what = {
            "drives": guard_drives(trees[0], chosen["drives"]),
            "precisions": PRECISIONS,
            "variants": chosen["variants"],
            "device": asked.device,
            "steps": chosen["steps"],
            "after": asked.after,
            "repeats": 2 if on_gpu else 1,
            "assemble": chosen["assembled"],
        }
        compile_in_trees(trees, what)
        found: list[dict[str, list[float]]] = [{}, {}]
        for _ in range(chosen["rounds"]):
            for tree, mine in zip(trees, found, strict=True):
                for row, rate in tree_rates(tree, what).items():
                    mine.setdefault(row, []).append(rate)
    before, after = ({row: second_best_rate(of) for row, of in mine.items()} for mine in found)
    yield f"A: {asked.a}, B: {asked.b}; {asked.device}"
    rows = guard_table(before, after, asked.limit)
    yield from rows
    if any(row[-1] for row in rows):
        raise SystemExit(1)
