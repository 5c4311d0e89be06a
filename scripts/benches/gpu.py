"""Ensembles on GPUs: the time loop and whole runs."""

import argparse
import math
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from common.cases import Line, case, case_option, table_head

from benches import drives
from benches.drives import JOINT_FRICTION, drive_by_name, two_sprockets_of_length, varied_designs
from benches.probe import endless_schedule, launch_seconds
from benches.reference import cuda_seconds
from warpchain import Drive, Record, Run, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.engine.pack import pack
from warpchain.engine.packed_ensemble import PackedEnsemble

DEVICE = "cuda:0"
DRIVES = ("two", "smooth")
PRECISIONS = ("float64", "float32")
VARIANTS = (1, 132, 1056, 4224, 16896)
LINKS = (62, 94, 118, 158, 190, 254, 382, 510, 766, 1022, 2000, 4000)
QUICK = {1, 1056, 16896, 118, 510, 1022, 4000}
"""Numbers of variants and lengths of chain that `--quick` keeps."""
EACH = (DRIVES, PRECISIONS)
HEADLINE = ("marine", "smooth", "car", "harmonics")
LISTS = ("marine", "car", "industrial", "engine")
"""Drives of which there are lists as of designs of experiments."""
DESIGNS = 10_000
"""Drives of a list; each is simulated for its own time."""
MANY = list(product(*EACH, VARIANTS))
NONE = Record(variants="none")
Row = tuple[Any, ...]


@dataclass(frozen=True)
class BenchEffort:
    """Effort of a benchmark: steps of a launch of many variants, repeats, and the folder of the CUDA program."""

    steps: int
    rounds: int
    folder: str

    def launched(self, variants: int) -> int:
        """Steps of a launch: few variants take more, as in runs, whose launches are still longer."""
        return min(10, max(1, VARIANTS[-1] // variants)) * self.steps


@dataclass(frozen=True)
class GpuPart:
    """Rows of the GPU benchmark that are measured alike: the function, its words, and the columns' heads."""

    measure: Callable[..., Row]
    words: list[tuple[Any, ...]]
    head: tuple[str, ...]


PARTS: dict[str, GpuPart] = {}
LOOPS = ("table", "joints", "rollers", "car")
"""Parts that measure the time loop."""


def gpu_part(
    columns: str, words: Iterable[tuple[Any, ...]] = ((),)
) -> Callable[[Callable[..., Row]], Callable[..., Row]]:
    """Decorator: a function measures a row of the GPU benchmark; given the heads of its columns and the words of its
    rows."""

    def add_part(measure: Callable[..., Row]) -> Callable[..., Row]:
        """Adds the function to the benchmark's parts."""
        PARTS[measure.__name__] = GpuPart(measure, list(words), table_head(columns))
        return measure

    return add_part


@cache
def packed_designs(drive: Drive, name: str, variants: int, metrics: bool) -> PackedEnsemble:
    """Designs of a drive, varied as drives of its name are, packed."""
    many = varied_designs(drive, name, variants)
    return pack(many, [endless_schedule(each, metrics) for each in many])


def time_loop_seconds(
    drive: Drive, name: str, variants: int, precision: str, steps: int, metrics: bool, rounds: int
) -> tuple[float, float]:
    """Seconds of `steps` steps of a drive's designs, the least of some, and of the first launch."""
    packed = packed_designs(drive, name, variants, metrics).at_precision(precision)
    found = [launch_seconds(packed, DEVICE, steps) for _ in range(rounds)]
    return min(seconds for seconds, _ in found), found[0][1]


@gpu_part("drive | precision | variants | CUDA | bare | of CUDA | us/step | metrics | of bare | first launch [s]", MANY)
def table(name: str, precision: str, variants: int, effort: BenchEffort) -> Row:
    """The time loop bare and with metrics, beside CUDA C++."""
    drive, steps = drive_by_name(name), effort.launched(variants)
    work = variants * drive.chain.links * steps / 1e9
    theirs = cuda_seconds(drive, precision, steps, variants, Path(effort.folder))
    bare, begin = time_loop_seconds(drive, name, variants, precision, steps, False, effort.rounds)
    metrics, _ = time_loop_seconds(drive, name, variants, precision, steps, True, effort.rounds)
    return work / theirs, work / bare, theirs / bare, 1e6 * bare / steps, work / metrics, bare / metrics, begin


@gpu_part(
    "drive | precision | variants | metrics | without | with friction | ratio", product(*EACH, VARIANTS, (False, True))
)
def joints(name: str, precision: str, variants: int, metrics: bool, effort: BenchEffort) -> Row:
    """The time loop with joint friction, beside the same drive without."""
    drive = drive_by_name(name)
    work = variants * drive.chain.links * effort.steps / 1e9
    plain, rubbed = (
        time_loop_seconds(kind, name, variants, precision, effort.steps, metrics, effort.rounds)[0]
        for kind in (drive, drive.with_values(JOINT_FRICTION))
    )
    return work / plain, work / rubbed, plain / rubbed


@gpu_part("links | precision | variants | bare | metrics | alone [us/step]", product(LINKS, PRECISIONS))
def rollers(links: int, precision: str, effort: BenchEffort) -> Row:
    """The time loop by length of chain, about 500,000 rollers in all; one variant alone."""
    drive, variants, steps = two_sprockets_of_length(links), 500_000 // links, max(1, effort.steps // 4)
    work = variants * links * steps / 1e9
    many, metrics = (
        time_loop_seconds(drive, "two", variants, precision, steps, on, effort.rounds)[0] for on in (False, True)
    )
    some = effort.launched(1)
    alone, _ = time_loop_seconds(drive, "two", 1, precision, some, False, effort.rounds)
    return variants, work / many, work / metrics, 1e6 * alone / some


@gpu_part(
    "cams | precision | variants | CUDA [us/step] | bare [us/step] | of CUDA | metrics [us/step]",
    product(("valves", "harmonics"), PRECISIONS, (1, 1056, 10_000)),
)
def car(cams: str, precision: str, variants: int, effort: BenchEffort) -> Row:
    """The time loop of `car`: curved guides, an arm, friction by speed, oil, and valves or two harmonics for them.

    Beside CUDA C++, which knows no valves.
    """
    name, steps = "car" if cams == "valves" else cams, effort.launched(variants)
    drive = drive_by_name(name)
    theirs = cuda_or_nan_seconds(drive, precision, steps, variants, effort)
    bare, metrics = (
        time_loop_seconds(drive, name, variants, precision, steps, on, effort.rounds)[0] for on in (False, True)
    )
    us = 1e6 / steps
    return us * theirs, us * bare, theirs / bare, us * metrics


def cuda_or_nan_seconds(drive: Drive, precision: str, steps: int, variants: int, effort: BenchEffort) -> float:
    """Seconds of the CUDA program, NaN for valves, which it does not know."""
    return math.nan if drive.valves else cuda_seconds(drive, precision, steps, variants, Path(effort.folder))


def load_kernels(drives: Sequence[Drive], **options: Any) -> None:
    """Loads the kernels of a run."""
    simulate(drives, **options | {"duration": 0.001, "window": None, "record": NONE})


def timed_run(drives: Sequence[Drive], warm: bool = False, **options: Any) -> tuple[Run, float]:
    """A whole run without recordings, and its seconds from drives to table; its kernels are loaded before."""
    if not warm:
        load_kernels(drives, **options)
    begin = time.perf_counter()
    return simulate(drives, record=NONE, **options), time.perf_counter() - begin


@gpu_part(
    "drive | precision | simulated [s] | without [s] | metrics [s] | of bare | rate without | with", product(*EACH)
)
def runs(name: str, precision: str, effort: BenchEffort) -> Row:
    """Whole runs of 16,896 designs with metrics over the second half, as is usual, and without; no settling."""
    drive = drive_by_name(name).with_values({"run.settle": False})
    length, many = drive.run.duration, varied_designs(drive, name, VARIANTS[-1])
    steps = [resolve_step(each) for each in many]
    found: dict[str, list[float]] = {"without": [], "with": []}
    for _ in range(min(effort.rounds, 2)):  # in turns
        for how, window in (("without", (length - max(steps), length)), ("with", None)):
            run, _ = timed_run(many, device=DEVICE, precision=precision, window=window)
            found[how].append(run.info.wall_time)
    without, measured = map(min, found.values())
    work = drive.chain.links * sum(length / step for step in steps) / 1e9
    return length, without, measured, without / measured, work / without, work / measured


@gpu_part(
    "drive | precision | s | packing and table | CUDA, its steps alone | diverged | mean tension [N] | steps vary",
    product(HEADLINE, PRECISIONS),
)
def headline(name: str, precision: str, effort: BenchEffort) -> Row:
    """10,000 designs of the marine drive, 2 s each, or of `car`, 0.2 s, with valves or harmonics (tables packed anew).

    Beside as many steps of CUDA C++ at the rate of some, each drive at its own step, without settling, metrics, packing
    and table. Steps vary: the drive with most of them takes so many times as many as that with fewest.
    """
    drive = drive_by_name(name)
    many, length = varied_designs(drive, name, DESIGNS), drive.run.duration
    run, total = timed_run(many, device=DEVICE, precision=precision)
    steps = [length / resolve_step(each) for each in many]
    theirs = (
        cuda_or_nan_seconds(drive, precision, effort.steps, len(many), effort) / effort.steps * float(np.mean(steps))
    )
    mean = float(np.mean(run.metrics["tension_mean"].to_numpy()))
    diverged = sum(run.metrics["diverged"].to_pylist())
    return total, total - run.info.wall_time, theirs, diverged, mean, max(steps) / min(steps)


@gpu_part("precision | one kind [s] | 224 kinds [s] | ratio | of roller-steps", product(PRECISIONS))
def kinds(precision: str, effort: BenchEffort) -> Row:
    """8,000 two-sprocket drives of 224 kinds beside 8,000 of one, 1 s each."""
    base, many = drive_by_name("two"), drives.two_sprocket_kinds()
    every = [many[k % len(many)] for k in range(8_000)]
    alike, mixed = (
        timed_run(some, device=DEVICE, precision=precision, duration=1.0)[1] for some in ([base] * 8_000, every)
    )
    work = sum(drive.chain.links for drive in every) / (8_000 * base.chain.links)
    return alike, mixed, mixed / alike, work


@gpu_part(
    "list | precision | one GPU [s] | all [s] | of one | beside steps, one [s] | all [s] | columns that differ",
    product(LISTS, PRECISIONS),
)
def gpus(name: str, precision: str, effort: BenchEffort) -> Row:
    """10,000 designs, each for its own time, from list to table, on one GPU and on all; and packing and table alone."""
    if wp.get_cuda_device_count() < 2:
        raise SystemExit("needs two GPUs")
    many = varied_designs(drive_by_name(name), name, DESIGNS)
    load_kernels(many, device="cuda", precision=precision)
    found: dict[str, tuple[Run, float]] = {}
    for device in ("cuda", DEVICE) * max(1, effort.rounds - 1):  # in turns
        run, total = timed_run(many, warm=True, device=device, precision=precision)
        if device not in found or total < found[device][1]:
            found[device] = run, total
    (one, alone), (every, together) = found[DEVICE], found["cuda"]
    beside = alone - one.info.wall_time, together - every.info.wall_time
    return alone, together, together / alone, *beside, differing_columns(one, every)


def differing_columns(one: Run, other: Run) -> int:
    """Columns of two runs' tables that are not the same to the bit."""
    held = [[of.metrics[name].combine_chunks() for name in one.metrics.column_names] for of in (one, other)]
    return sum(a.buffers() != b.buffers() for a, b in zip(*held, strict=True))


def part_rows(name: str, quick: bool) -> list[tuple[Any, ...]]:
    """The rows of a part."""
    keeps = {16896} if name == "joints" else QUICK
    sizes = {*VARIANTS, *LINKS} if name in LOOPS else set()
    return [words for words in PARTS[name].words if not quick or (sizes & set(words)) <= keeps]


def row_with_dashes(row: Row) -> Row:
    """A row with a dash for what was not measured."""
    return tuple("-" if isinstance(value, float) and math.isnan(value) else value for value in row)


def part_by_name(word: str) -> str:
    """The name of a part."""
    if word not in PARTS:
        raise argparse.ArgumentTypeError(f"{word!r}: allowed are {', '.join(PARTS)}")
    return word


@case(
    case_option(
        "parts", nargs="*", type=part_by_name, metavar="PART", help=f"of {', '.join(PARTS)}; without any all of them"
    ),
    case_option("--quick", action="store_true", help="fewer lengths and numbers of variants, less often"),
)
def gpu(asked: argparse.Namespace) -> Iterator[Line]:
    """Ensembles on GPUs, in 1e9 roller-steps a second, the time loop beside hand-written CUDA C++.

    python scripts/bench.py gpu table --quick
    python scripts/bench.py gpu [PART ...]

    First all kernels of the time loop are compiled, side by side on all cores; then rows are measured one after
    another, each several times, of which the best counts. One that fails is named, and the exit status is then 1.
    Without nvcc the CUDA program is left out. Drives are `two` equal sprockets and `smooth`, the marine drive without
    friction. Variants differ as those of a design of experiments do (`RANGES` in `benches/drives.py`), but for `kinds`;
    CUDA's are copies of one, as what differs costs it nothing.
    """
    if not wp.is_cuda_available():
        raise SystemExit("no CUDA device here")
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        if shutil.which("nvcc") is None:
            yield "no nvcc here: the CUDA program is left out"
        effort = BenchEffort(2000, 2 if asked.quick else 3, folder)
        plan = {name: part_rows(name, asked.quick) for name in asked.parts or PARTS}
        short = replace(effort, steps=8, rounds=1)
        with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
            for name in plan.keys() & set(LOOPS):
                for words in plan[name]:
                    pool.submit(PARTS[name].measure, *words, short)
        for name, rows in plan.items():
            chosen = PARTS[name]
            yield f"\n{name}: {(chosen.measure.__doc__ or '').splitlines()[0]}"
            yield chosen.head
            for words in rows:
                try:
                    yield row_with_dashes((*words, *chosen.measure(*words, effort)))
                except (Exception, SystemExit) as error:  # the others go on
                    failed = True
                    yield (*words, f"failed: {error}")
    if failed:
        raise SystemExit(1)
