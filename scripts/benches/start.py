"""The start of a command."""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

from common.cases import ROOT, Line, case, case_option

COMMAND = ("run", "industrial", "--duration", "0.001", "--quiet", "--overwrite")


def command_seconds(tree: Path, folder: Path, device: str) -> tuple[float, float]:
    """CPU and clock seconds of the command in a tree, whose kernels are cached in `folder`."""
    command = [sys.executable, "-m", "warpchain", *COMMAND, "--device", device, "-o", str(folder / "run.mcap")]
    caches = {"WARP_CACHE_PATH": str(folder / "kernels"), "PYTHONPYCACHEPREFIX": str(folder / "python")}
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(tree), os.environ.get("PYTHONPATH", "")]),
        "PYTHONDONTWRITEBYTECODE": "",
        **caches,
    }
    begin = time.monotonic()
    process = subprocess.Popen(command, cwd=tree, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{tree}: the command failed")
    return used.ru_utime + used.ru_stime, time.monotonic() - begin


@case(
    case_option("trees", nargs="*", type=Path, help="other checkouts"),
    case_option("--device", default="cpu", help="such as cuda:0 (default cpu)"),
    case_option("--empty", type=int, default=3, help="times with an empty cache (default 3)"),
    case_option("--compiled", type=int, default=4, help="times with compiled kernels (default 4)"),
)
def start(asked: argparse.Namespace) -> Iterator[Line]:
    """CPU and clock time of a short command, in this tree and in others: with compiled kernels, and with none.

    python scripts/bench.py start ../before --empty 3 --compiled 4

    Runs `warpchain run industrial --duration 0.001` in all trees at once with empty kernel caches, so that what else
    the machine does slows all of them alike, then in turns with these caches. Python, too, keeps what it compiles
    there, as it does for users. Prints the least CPU time, of all cores, and the least by the clock; the latter counts
    little with an empty cache where trees and others share few cores.
    """
    trees = [ROOT, *(tree.resolve() for tree in asked.trees)]
    empty: list[list[tuple[float, float]]] = []
    compiled: list[list[tuple[float, float]]] = []
    devices = [asked.device] * len(trees)
    with ThreadPoolExecutor(len(trees)) as pool:
        for _ in range(asked.empty):
            with TemporaryDirectory() as place:
                folders = [Path(place) / str(number) for number in range(len(trees))]
                for folder in folders:
                    folder.mkdir()
                empty.append(list(pool.map(command_seconds, trees, folders, devices)))
                if len(empty) == asked.empty:
                    compiled += [list(map(command_seconds, trees, folders, devices)) for _ in range(asked.compiled)]
    yield ("cache", "CPU [s]", "clock [s]", "tree")
    for title, rounds in (("empty", empty), ("compiled", compiled)):
        for number, tree in enumerate(trees):
            cpu, clock = (min(of[number][which] for of in rounds) for which in (0, 1))
            yield (title, cpu, clock, tree)


RUNS = """
import sys, time
from warpchain import Record, load_drive, simulate
from warpchain.examples import drive_path
name, count, device, precision = sys.argv[1], int(sys.argv[2]), *sys.argv[3:]
begin = time.perf_counter()
simulate([load_drive(drive_path(name))] * count, device=device, precision=precision, record=Record("none"))
print(time.perf_counter() - begin)
"""
ENSEMBLES = (("car", 2000), ("marine", 2000), ("marine", 1))


@case(case_option("--device", default="cuda:0", help="such as cpu (default cuda:0)"))
def cold(asked: argparse.Namespace) -> Iterator[Line]:
    """Seconds of whole runs with no kernel compiled, and of the same drive in another number with these.

    python scripts/bench.py cold
    """
    yield ("drives", "precision", "no kernel compiled [s]", "seven more [s]")
    for (name, count), precision in product(ENSEMBLES, ("float64", "float32")):
        with TemporaryDirectory() as folder:
            found = []
            for many in (count, count + 7):
                words = [name, str(many), asked.device, precision]
                done = subprocess.run(
                    [sys.executable, "-c", RUNS, *words],
                    env=os.environ | {"WARP_CACHE_PATH": folder},
                    stdout=subprocess.PIPE,
                    text=True,
                    check=True,
                )
                found.append(float(done.stdout.splitlines()[-1]))
        yield (f"{count} {name}", precision, *found)
