"""Ensembles on GPUs: the time loop, whole runs, and which device is taken."""

import argparse
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from common.cases import Line, case, option
from common.workers import one_by_one, side_by_side

from benches.drives import JOINT_FRICTION, different, kinds_of, named, of_length
from benches.probe import launch, packed_of, schedule
from benches.reference import cuda_program, cuda_seconds
from warpchain import Drive, Record, simulate
from warpchain.assembly.timestep import resolve_step

DEVICE = "cuda:0"
DRIVES = ("two", "smooth")
PRECISIONS = ("float64", "float32")
VARIANTS = (1, 132, 1056, 4224, 16896)
LINKS = (62, 94, 118, 158, 190, 254, 382, 510, 766, 1022, 2000, 4000)
QUICK = {1, 1056, 16896, 118, 510, 1022, 4000}
"""Numbers of variants and lengths of chain that `--quick` keeps."""
NONE = Record(variants="none")
Row = tuple[Any, ...]


@dataclass(frozen=True)
class Effort:
    """How much is measured: steps of a launch, how often, whether it is only to compile; where the CUDA program is."""

    steps: int
    rounds: int
    compiles: bool
    folder: str

    def length(self, seconds: float) -> float:
        """Simulated time of a whole run [s]."""
        return 0.001 if self.compiles else seconds

    def launched(self, variants: int) -> int:
        """Steps of a launch: few variants take more, as in runs, whose launches are still longer."""
        return self.steps if self.compiles else min(10, max(1, VARIANTS[-1] // variants)) * self.steps


def loop(drive: Drive, variants: int, precision: str, steps: int, metrics: bool, rounds: int) -> tuple[float, ...]:
    """Seconds of `steps` steps, the least of some; of the first launch; and GiB that the ensemble takes."""
    packed = packed_of(drive, variants, precision, schedule(drive, metrics))
    free = wp.get_device(DEVICE).free_memory
    found = [launch(packed, DEVICE, steps) for _ in range(rounds)]
    taken = (free - wp.get_device(DEVICE).free_memory) / 2**30
    return min(seconds for seconds, _ in found), found[0][1], taken


def table(name: str, precision: str, variants: int, effort: Effort) -> Row:
    """The time loop bare and with metrics, beside CUDA C++."""
    drive, steps = named(name), effort.launched(variants)
    work = variants * drive.chain.links * steps / 1e9
    theirs = cuda_seconds(drive, precision, steps, variants, Path(effort.folder))
    bare, begin, _ = loop(drive, variants, precision, steps, False, effort.rounds)
    metrics, *_ = loop(drive, variants, precision, steps, True, effort.rounds)
    return work / theirs, work / bare, theirs / bare, 1e6 * bare / steps, work / metrics, bare / metrics, begin


def joints(name: str, precision: str, variants: int, metrics: bool, effort: Effort) -> Row:
    """The time loop with joint friction, beside the same drive without."""
    drive = named(name)
    work = variants * drive.chain.links * effort.steps / 1e9
    plain, rubbed = (
        loop(kind, variants, precision, effort.steps, metrics, effort.rounds)[0]
        for kind in (drive, drive.with_values(JOINT_FRICTION))
    )
    return work / plain, work / rubbed, plain / rubbed


def rollers(links: int, precision: str, effort: Effort) -> Row:
    """The time loop by length of chain, about 500,000 rollers in all; one variant alone."""
    drive, variants, steps = of_length(links), 500_000 // links, max(1, effort.steps // 4)
    work = variants * links * steps / 1e9
    many, metrics = (loop(drive, variants, precision, steps, on, effort.rounds)[0] for on in (False, True))
    some = effort.launched(1)
    alone, *_ = loop(drive, 1, precision, some, False, effort.rounds)
    return variants, work / many, work / metrics, 1e6 * alone / some


def timed(drives: list[Drive], rounds: int, **options: Any) -> float:
    """Seconds of a whole run without recordings, the best of some."""
    return min(simulate(drives, **({"record": NONE} | options)).info.wall_time for _ in range(rounds))


def last_step(drive: Drive, length: float) -> tuple[float, float]:
    """The window of a run of `length` [s] that is to go without metrics."""
    return length - resolve_step(drive), length


def runs(name: str, precision: str, effort: Effort) -> Row:
    """Whole runs of 16,896 variants with metrics over the second half, as is usual, and without; no settling."""
    drive = named(name).with_values({"run.settle": False})
    length = effort.length(drive.run.duration)
    drives = [drive] * VARIANTS[-1]
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "duration": length}
    without, measured = math.inf, math.inf
    for _ in range(min(effort.rounds, 2)):  # in turns
        without = min(without, timed(drives, 1, window=last_step(drive, length), **options))
        measured = min(measured, timed(drives, 1, **options))
    work = len(drives) * drive.chain.links * length / resolve_step(drive) / 1e9
    return length, without, measured, without / measured, work / without, work / measured


def recording(precision: str, effort: Effort) -> Row:
    """2,112 variants of the marine drive, 2 s: bare, 16 of them in full at 5 kHz, with metrics over all of it."""
    drive = named("smooth").with_values({"run.settle": False})
    drives, length = [drive] * 2112, effort.length(2.0)
    some = Record(variants=range(0, 2112, 132), rate=5000.0)
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "duration": length}
    last, rounds = last_step(drive, length), min(effort.rounds, 2)
    bare = timed(drives, rounds, window=last, **options)
    recorded = timed(drives, rounds, record=some, window=last, **options)
    metrics = timed(drives, rounds, window=(0.0, length), **options)
    return bare, recorded, recorded / bare, metrics, metrics / bare


def whole(drives: list[Drive], precision: str, effort: Effort, duration: float) -> Row:
    """From a list of drives to the table of metrics [s], what of it is not the run, how many diverged, mean tension."""
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "record": NONE}
    simulate(drives, duration=0.001, **options)  # loads the kernels
    begin = time.perf_counter()
    run = simulate(drives, duration=effort.length(duration), **options)
    total = time.perf_counter() - begin
    mean = float(np.mean(run.metrics["tension_mean"].to_numpy()))
    return total, total - run.info.wall_time, sum(run.metrics["diverged"].to_pylist()), mean


def headline(name: str, how: str, precision: str, effort: Effort) -> Row:
    """10,000 marine drives, 2 s each, that differ in five values (tables packed anew), or in a load alone."""
    drive, count = named(name), 10 if effort.compiles else 10_000
    if how == "five values":
        drives = different(drive, count)
    else:
        drives = [drive.with_values({"sprockets.camshaft.load.torque": 8000.0 + 0.2 * k}) for k in range(count)]
    return whole(drives, precision, effort, 2.0)


def kinds(precision: str, effort: Effort) -> Row:
    """8,000 two-sprocket drives of 224 kinds beside 8,000 of one, 1 s each."""
    base = named("two")
    many, count = kinds_of(base), 224 if effort.compiles else 8_000
    drives = [many[k % len(many)] for k in range(count)]
    one, every = (whole(some, precision, effort, 1.0)[0] for some in ([base] * count, drives))
    work = sum(drive.chain.links for drive in drives) / (count * base.chain.links)
    return one, every, every / one, work


def gpus(effort: Effort) -> Row:
    """16,896 marine variants a GPU, 0.2 s each, on one GPU and on all: the run, and from drives to table [s]."""
    count = wp.get_cuda_device_count()
    drives = [named("smooth").with_values({"run.settle": False})] * (VARIANTS[-1] * count)
    simulate(drives, duration=0.0002, record=NONE, device="cuda")  # loads the kernels
    found = []
    for device in (DEVICE, "cuda"):
        begin = time.perf_counter()
        run = simulate(drives, duration=effort.length(0.2), record=NONE, device=device)
        found.append((run.info.wall_time, time.perf_counter() - begin))
    (one, one_all), (every, every_all) = found
    return count, one, every, one / every, one_all, every_all, one_all / every_all


def choice(variants: int, effort: Effort) -> Row:
    """Which device finishes 0.1 s of the two sprockets first, and which one is taken by itself."""
    drives = [named("two").with_values({"run.settle": False})] * variants
    options: dict[str, Any] = {"duration": effort.length(0.1), "record": NONE}
    seconds = {device: timed(drives, 2, device=device, **options) for device in ("cpu", DEVICE)}
    taken = simulate(drives, **options).info.device
    return *seconds.values(), taken, seconds[DEVICE if "cuda" in taken else "cpu"] / min(seconds.values())


@dataclass(frozen=True)
class Part:
    """Rows that are measured alike: what measures one, of which words, and the columns' heads."""

    measure: Callable[..., Row]
    words: Sequence[tuple[Any, ...]]
    head: tuple[str, ...]


MANY = ("drive", "precision", "variants")
EACH = [(precision,) for precision in PRECISIONS]
FROM_TABLE = ("s", "of which packing and table", "diverged", "mean tension [N]")
PARTS = {
    "table": Part(
        table,
        list(product(DRIVES, PRECISIONS, VARIANTS)),
        (*MANY, "CUDA", "bare", "of CUDA", "us/step", "metrics", "of bare", "first launch [s]"),
    ),
    "joints": Part(
        joints,
        list(product(DRIVES, PRECISIONS, VARIANTS, (False, True))),
        (*MANY, "metrics", "without", "with friction", "ratio"),
    ),
    "rollers": Part(
        rollers,
        list(product(LINKS, PRECISIONS)),
        ("links", "precision", "variants", "bare", "metrics", "alone [us/step]"),
    ),
    "runs": Part(
        runs,
        list(product(DRIVES, PRECISIONS)),
        (*MANY[:2], "simulated [s]", "without [s]", "metrics [s]", "of bare", "rate without", "with"),
    ),
    "recording": Part(
        recording, EACH, ("precision", "bare [s]", "recorded [s]", "of bare", "metrics [s]", "of bare")
    ),
    "headline": Part(
        headline,
        [(*how, p) for how in (("marine", "a load"), ("marine", "five values"), ("smooth", "five values"))
         for p in PRECISIONS],
        ("drive", "they differ in", "precision", *FROM_TABLE),
    ),
    "kinds": Part(kinds, EACH, ("precision", "one kind [s]", "224 kinds [s]", "ratio", "of roller-steps")),
    "gpus": Part(
        gpus, [()], ("GPUs", "run on one [s]", "on all [s]", "ratio", "whole on one [s]", "on all [s]", "ratio")
    ),
    "choice": Part(
        choice, [(n,) for n in (1, 8, 64, 512)], ("variants", "cpu [s]", "GPU [s]", "taken", "over the faster one")
    ),
}  # fmt: skip


def rows_of(name: str, quick: bool) -> list[tuple[Any, ...]]:
    """The rows of a part."""
    keeps = {16896} if name == "joints" else QUICK
    sizes = {*VARIANTS, *LINKS} if name in ("table", "joints", "rollers") else set()
    return [words for words in PARTS[name].words if not quick or (sizes & set(words)) <= keeps]


def part(word: str) -> str:
    """The name of a part."""
    if word not in PARTS:
        raise argparse.ArgumentTypeError(f"{word!r}: allowed are {', '.join(PARTS)}")
    return word


@case(
    option("parts", nargs="*", type=part, metavar="PART", help=f"of {', '.join(PARTS)}; without any all of them"),
    option("--quick", action="store_true", help="fewer lengths and numbers of variants, less often"),
    option("--steps", type=int, default=2000, help="of a measured launch of many variants (default 2000)"),
    option("--seconds", type=float, default=math.inf, help="after how many it ends, whatever is left"),
    option("--compile-only", action="store_true", help="compile what they run, and end"),
)
def gpu(asked: argparse.Namespace) -> Iterator[Line]:
    """Ensembles on GPUs, in 1e9 roller-steps a second, the time loop beside hand-written CUDA C++.

    python scripts/bench.py gpu table --quick
    python scripts/bench.py gpu [PART ...]

    First all kernels are compiled, side by side on all cores; then rows are measured one after another, each several
    times, of which the best counts, in a process of their own: one that fails is named, and the exit status is then 1.
    Without nvcc the CUDA program is left out. Drives are `two` equal sprockets and `smooth`, the marine drive without
    friction.
    """
    if not wp.is_cuda_available():
        raise SystemExit("no CUDA device here")
    with tempfile.TemporaryDirectory() as folder:
        if cuda_program(Path(folder)) is None:
            yield "no nvcc here: the CUDA program is left out"
        effort = Effort(asked.steps, 2 if asked.quick else 3, False, folder)
        begin, failed = time.monotonic(), 0
        plan = {name: rows_of(name, asked.quick) for name in asked.parts or PARTS}
        short = replace(effort, steps=64, rounds=1, compiles=True)
        for name, rows in plan.items():
            side_by_side(PARTS[name].measure, [(*words, short) for words in rows])
        yield f"compiled in {time.monotonic() - begin:.0f} s"
        for name, rows in plan.items() if not asked.compile_only else ():
            chosen = PARTS[name]
            yield f"\n{name}: {(chosen.measure.__doc__ or '').splitlines()[0]}"
            yield chosen.head
            left = asked.seconds - (time.monotonic() - begin)
            results = one_by_one(chosen.measure, [(*words, effort) for words in rows], left)
            for words, found in zip(rows, results, strict=True):
                failed += isinstance(found, str)
                yield (*words, found) if isinstance(found, str) else (*words, *found)
    if failed:
        raise SystemExit(1)
