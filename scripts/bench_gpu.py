"""GPU benchmark: 1e9 roller-steps a second, beside hand-written CUDA C++ doing the same work, compiled on the spot.

    python scripts/bench_gpu.py [PART ...] [--quick]

`table`: the time loop bare and with metrics, by precision and number of variants, one alone among them, two drives,
each beside chain_reference.cu in the same run. `joints`: with joint friction beside without.
`recording`: whole runs without records, with 16 variants in full, and with metrics over the whole run.
`runs`: whole runs of 16,896 variants with metrics over the second half, as is usual, beside ones without.
`rollers`: by length of chain. `gpus`: on one GPU and on all. `headline`: 10,000 variants of the marine drive, two
simulated seconds each, metrics for all, equal but for a load and different in five values, these also without friction.
`kinds`: 8,000 two-sprocket drives of 224 kinds beside 8,000 of one. `study`: the study command beside a run of the same
drives. `packing`: what the processor does before. `start`: a command whose kernels are compiled already or not, and
`study status`. `float64`: operations on float64 in the time loops at float32. `choice`: which device `device=None`
takes. `cpu`: the CPU beside C (`bench_cpu.py` has more). Without names: all of them; at the end stands what the
performance page aims at, item by item, beside what was found, or why it was not.

First all kernels are compiled, side by side on all cores; then the cases are measured one after another, on as many
GPUs as there are, one case a GPU at a time, on several the longest first, on one the shortest; what takes all GPUs, or
is the start of a command, comes last, by itself. A case is measured several times and the best counts. `--quick`
leaves out some lengths and numbers of variants, measures less often, and ends within `--seconds`, 480: what is not done
by then is cut off. With `--store FILE` a case that the file has is not measured again, so that a run that was cut off
can be gone on with.
Without nvcc the reference is left out, with a message. What fails is told, and the exit status is 1.

`--limit FILE.cu` compiles and runs another CUDA program beside the table, one that prints lines such as
`CUDA f64 V=1056 N=118 steps=4000 ... 85.6 Groller-steps/s`.
"""

import argparse
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import wait
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from bench.aims import FIVE, SMOOTH, aims
from bench.work import Found, Store, Task, results
from bench_cpu import HERE, RUBBING, Reference, bench_drives, engine_rate, reference_input, schedule
from count_float64 import KINDS, counts

from warpchain import Drive, Record, load_drive, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.drive.examples import drive_path
from warpchain.engine.gpu import GpuEngine
from warpchain.engine.pack import pack
from warpchain.engine.packed import Packed
from warpchain.engine.simulation import available_cores

DEVICE = "cuda:0"
PRECISIONS = ("float64", "float32")
VARIANTS = (1, 132, 1056, 4224, 16896)
LINKS = (62, 94, 118, 158, 190, 254, 382, 510, 766, 1022, 2000, 4000)
QUICK = {1, 1056, 16896, 118, 510, 1022, 4000}
"""Numbers of variants and lengths of chain that `--quick` keeps."""
DRIVES = bench_drives()
TWO, MARINE = DRIVES
NOT_HERE = "not measured here"
"""How the line begins of what a machine cannot do."""

NO_COMPILER = f"{NOT_HERE}: no CPU compiler"
"""Where Warp has no kernels for the CPU."""


def repeated(one: Packed, variants: int) -> Packed:
    """`one` packed variant `variants` times over, without assembling each."""
    return one.taken([0] * variants)


def bare(
    drive: Drive, variants: int, precision: str, steps: int, metrics: bool, rounds: int = 3
) -> tuple[float, float, float]:
    """Seconds of `steps` steps of the engine, of its first launch, and GiB that the ensemble takes."""
    packed = repeated(pack([drive], [schedule(drive, metrics)]).at_precision(precision), variants)
    first, best, taken = math.nan, math.inf, math.nan

    def run(engine: GpuEngine, count: int) -> float:
        begin = time.perf_counter()
        for future in engine.advance(count, frames):
            future.result()
        return time.perf_counter() - begin

    for _ in range(rounds):  # each from the start, as the reference
        free = wp.get_device(DEVICE).free_memory
        engine = GpuEngine(packed, DEVICE)
        taken = (free - wp.get_device(DEVICE).free_memory) / 2**30
        frames = engine.frame_buffer(0)
        loading = run(engine, 64)
        first = loading if math.isnan(first) else first
        best = min(best, run(engine, steps))
        if engine.progress()["diverged"].any():
            raise SystemExit(f"{variants} variants, {precision}: the run diverged")
        engine.close()
    return best, first, taken


def compiled(source: Path, folder: Path) -> Path | None:
    """A CUDA program, compiled if it is not there yet; None without nvcc."""
    program = folder / source.stem
    if shutil.which("nvcc") is None:
        return None
    if not program.exists():
        subprocess.run(["nvcc", "-O3", "-arch=native", "-o", str(program), str(source)], check=True)
    return program


def reference(drive: Drive, steps: int, count: int, folder: Path) -> tuple[dict[str, float], np.ndarray | None]:
    """Seconds of the CUDA program by precision, and where its rollers are; nothing without nvcc."""
    program = compiled(HERE / "chain_reference.cu", folder)
    if program is None:
        return {}, None
    packed = pack([drive], [schedule(drive, False)])
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "in").write_bytes(reference_input(packed))
        command = [str(program), f"{name}/in", f"{name}/out", str(steps), str(count)]
        lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
        rollers = np.fromfile(f"{name}/out")[: 2 * drive.chain.links]
    words = [line.split() for line in lines]
    return {"float64" if size == "8" else "float32": float(seconds) for size, _, seconds in words}, rollers


def difference(drive: Drive, folder: Path) -> float:
    """Largest distance between the engine's rollers and the reference's after 500 steps [m]."""
    _, theirs = reference(drive, 500, 1, folder)
    engine = GpuEngine(pack([drive], [schedule(drive, False)]), DEVICE)
    for future in engine.advance(500, engine.frame_buffer(0)):
        future.result()
    ours = engine.rollers()[: 2 * drive.chain.links]
    engine.close()
    return math.nan if theirs is None else float(np.abs(ours - theirs).max())


LIMIT_LINE = re.compile(r"^CUDA f(64|32) V=(\d+) .*?([\d.]+) Groller-steps/s")


def limit_rates(lines: list[str]) -> dict[tuple[str, int], float]:
    """What another CUDA program says it reaches, 1e9 roller-steps a second by precision and variants."""
    found = [match for match in map(LIMIT_LINE.match, lines) if match]
    return {(f"float{match[1]}", int(match[2])): float(match[3]) for match in found}


def limit(task: Task, source: str) -> Found:
    """What another CUDA program reaches."""
    program = compiled(Path(source), task.folder)
    if program is None or task.compile_only:
        return "", {}
    lines = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout.splitlines()
    rates = {f"{precision} {count}": rate for (precision, count), rate in limit_rates(lines).items()}
    return ", ".join(f"{name}: {rate:.2f}" for name, rate in rates.items()), rates


def launched(task: Task, variants: int) -> int:
    """Steps of a launch of the two drives: few variants take more, as in runs, whose launches are still longer."""
    return task.steps if task.compile_only else min(10, max(1, VARIANTS[-1] // variants)) * task.steps


def table(task: Task, title: str, precision: str, variants: int) -> Found:
    """The time loop beside the reference."""
    drive, steps = DRIVES[title], launched(task, variants)
    work = variants * drive.chain.links * steps / 1e9
    theirs, _ = reference(drive, steps, variants, task.folder)
    cuda = theirs.get(precision, math.nan)
    best, first, taken = bare(drive, variants, precision, steps, False, task.rounds)
    measured, _, _ = bare(drive, variants, precision, steps, True, task.rounds)
    apart = f"{difference(drive, task.folder):9.1e}" if (precision, variants) == ("float64", 1) else ""
    line = (
        f"{title:28s} {precision:9s} {variants:9d} {work / cuda:8.2f} {work / best:8.2f} {cuda / best:8.2f} "
        f"{best / steps * 1e6:9.3f} {work / measured:8.2f} {best / measured:8.2f} {taken:5.2f} {first:9.2f} "
    )
    rates = {"cuda": work / cuda, "bare": work / best, "metrics": work / measured, "us": best / steps * 1e6}
    return line + apart, rates


def joints(task: Task, title: str, precision: str, variants: int, metrics: bool) -> Found:
    """What joint friction costs, beside the same drive without it."""
    drive = DRIVES[title]
    work = variants * drive.chain.links * task.steps / 1e9
    plain, _, _ = bare(drive, variants, precision, task.steps, metrics, task.rounds)
    rubbed, _, _ = bare(drive.with_values(RUBBING), variants, precision, task.steps, metrics, task.rounds)
    line = f"{title:28s} {precision:9s} {variants:9d}  {metrics!s:7s} {work / plain:8.2f} {work / rubbed:14.2f}"
    return f"{line} {plain / rubbed:6.2f}", {"ratio": plain / rubbed}


def timed(drives: list[Drive], rounds: int, **options: Any) -> float:
    """Seconds of a whole run, the best of some."""
    return min(simulate(drives, **options).info.wall_time for _ in range(rounds))


def last_step(drive: Drive, length: float) -> tuple[float, float]:
    """The window of a run of `length` [s] that is to go without metrics."""
    return length - resolve_step(drive), length


def recording(task: Task, precision: str) -> Found:
    """Whole runs of 2,112 variants, two seconds each, without settling."""
    drive = DRIVES[MARINE].with_values({"run.settle": False})
    drives = [drive] * 2112
    none, some = Record(variants="none"), Record(variants=range(0, 2112, 132), rate=5000.0)
    length = 0.001 if task.compile_only else 2.0
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "duration": length}
    last = last_step(drive, length)
    rounds = 1 if task.compile_only else 2
    nothing = timed(drives, rounds, record=none, window=last, **options)
    recorded = timed(drives, rounds, record=some, window=last, **options)
    metrics = timed(drives, rounds, record=none, window=(0.0, length), **options)
    line = (
        f"{precision}: bare {nothing:.3f}, 16 variants in full at 5 kHz {recorded:.3f} "
        f"({recorded / nothing - 1:+.1%}), metrics over all of it {metrics:.3f} ({metrics / nothing - 1:+.1%})"
    )
    return line, {"recorded": recorded / nothing, "metrics": metrics / nothing}


def runs(task: Task, title: str, precision: str) -> Found:
    """Whole runs of many variants with metrics over the second half, as is usual, and without; no settling."""
    drive = DRIVES[title].with_values({"run.settle": False})
    length = 0.001 if task.compile_only else drive.run.duration
    drives = [drive] * VARIANTS[-1]
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "record": Record(variants="none")}
    without, measured = math.inf, math.inf
    for _ in range(1 if task.compile_only or task.quick else 2):  # in turns
        without = min(without, timed(drives, 1, duration=length, window=last_step(drive, length), **options))
        measured = min(measured, timed(drives, 1, duration=length, **options))
    work = len(drives) * drive.chain.links * length / resolve_step(drive) / 1e9
    line = f"{title:28s} {precision:9s} {length:4.1f} {without:8.2f} {measured:8.2f} {without / measured:8.2f}"
    return f"{line} {work / without:8.2f} {work / measured:8.2f}", {"of bare": without / measured}


def rollers(task: Task, links: int, precision: str) -> Found:
    """The time loop by length of chain, two 30-tooth sprockets."""
    distance = (links - 30) / 2 * 0.1 + 0.0004
    drive = DRIVES[TWO].with_values({"chain.links": links, "sprockets.driven.center": [distance, 0.0]})
    variants, steps = 500_000 // links, task.steps // 4
    work = variants * links * steps / 1e9
    many, _, _ = bare(drive, variants, precision, steps, False, task.rounds)
    measured, _, _ = bare(drive, variants, precision, steps, True, task.rounds)
    some = launched(task, 1)
    alone, _, _ = bare(drive, 1, precision, some, False, task.rounds)
    rates = {"bare": work / many, "metrics": work / measured, "us": alone / some * 1e6}
    told = f"{rates['bare']:8.2f} {rates['metrics']:8.2f} {rates['us']:9.3f}"
    return f"{links:5d} {precision:9s} {variants:9d} {told}", rates


def gpus(task: Task) -> Found:
    """The same ensemble on one GPU and on all, 0.2 s each: the run, and from drives to table."""
    count = wp.get_cuda_device_count()
    drive = DRIVES[MARINE].with_values({"run.settle": False})
    drives = [drive] * (16_896 * count)
    none = Record(variants="none")
    simulate(drives, duration=0.0002, record=none, device="cuda")  # loads the kernels
    found = {}
    for device in (DEVICE, "cuda"):
        begin = time.perf_counter()
        run = simulate(drives, duration=0.0002 if task.compile_only else 0.2, record=none, device=device)
        found[device] = run.info.wall_time, time.perf_counter() - begin
    (one, one_all), (every, every_all) = found.values()
    line = (
        f"{len(drives)} variants, 0.2 s: one GPU {one:.2f} s, {count} GPUs {every:.2f} s, {one / every:.2f}x; from "
        f"drives to table {one_all:.2f} s, {every_all:.2f} s, {one_all / every_all:.2f}x"
    )
    return line, {"count": count, "times": one / every, "whole": one_all / every_all}


def other(drive: Drive, k: int) -> Drive:
    """The k-th of marine drives that differ in five values, two of which move rollers to other places.

    The camshaft's torque, the tightener's place, the chain's elongation, roller mass and damping.
    """
    x, y = drive.sprockets[1].center
    values = {
        "sprockets.camshaft.load.torque": 8000.0 + 0.2 * k,
        "sprockets.tightener.center": [x - 1e-7 * k, y],
        "chain.elongation": 1e-8 * k,
        "chain.roller_mass": 6.95 + 1e-5 * k,
        "chain.damping": 1.0e5 + k,
    }
    return drive.with_values(values)


def different(drive: Drive, count: int) -> list[Drive]:
    """As many of `other`."""
    return [other(drive, k) for k in range(count)]


def headline(task: Task, how: str, precision: str) -> Found:
    """10,000 variants of the marine drive, 2 s each."""
    drive = DRIVES[MARINE] if how == SMOOTH else load_drive(drive_path("marine"))
    count = 10 if task.compile_only else 10_000
    if how.startswith(FIVE):
        drives = different(drive, count)
    else:
        drives = [drive.with_values({"sprockets.camshaft.load.torque": 8000.0 + 0.2 * k}) for k in range(count)]
    line, total, run = whole(task, drives, precision, None)
    return f"{count} {how}, {precision}: {line}", {"seconds": total, "before and after": total - run}


def whole(task: Task, drives: list[Drive], precision: str, duration: float | None) -> tuple[str, float, float]:
    """A run from a list of drives to the table of metrics: what it gave, its seconds, and those of the run itself."""
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "record": Record(variants="none")}
    simulate(drives, duration=0.001, **options)  # loads the kernels
    begin = time.perf_counter()
    run = simulate(drives, duration=0.001 if task.compile_only else duration, **options)
    total = time.perf_counter() - begin
    diverged = sum(run.metrics["diverged"].to_pylist())
    mean = np.mean(run.metrics["tension_mean"].to_numpy())
    rest = total - run.info.wall_time
    line = f"{total:.2f} s, of which packing and the table {rest:.2f} s; {diverged} diverged, mean tension {mean:.0f} N"
    return line, total, run.info.wall_time


def kinds_of(base: Drive) -> list[Drive]:
    """Two-sprocket drives of 224 kinds: 14 numbers of teeth by 16 of links."""
    return [
        base.with_values(
            {
                "chain.links": links,
                "sprockets.driver.teeth": teeth,
                "sprockets.driven.teeth": teeth,
                "sprockets.driven.center": [(links - teeth) / 2 * base.chain.pitch + 0.0004, 0.0],
            }
        )
        for teeth in range(20, 34)
        for links in range(104, 136, 2)
    ]


def kinds(task: Task, precision: str) -> Found:
    """8,000 drives of many kinds beside 8,000 of one, 1 s each."""
    base = DRIVES[TWO]
    many, count = kinds_of(base), 224 if task.compile_only else 8_000
    drives = [many[k % len(many)] for k in range(count)]
    line, one, _ = whole(task, [base] * count, precision, 1.0)
    other, every, _ = whole(task, drives, precision, 1.0)
    work = sum(drive.chain.links for drive in drives) / (count * base.chain.links)
    told = f"{precision}: one kind {line}\n{precision}: {len(many)} kinds {other}\n{precision}: "
    return f"{told}{every / one:.2f} times as long, for {work:.2f} times the roller-steps", {"times": every / one}


def study(task: Task, precision: str) -> Found:
    """The study command beside `simulate` and the table for the same drives."""
    import bench_study

    words = ["--count", "10000", "--duration", "2", "--shards", "1", "--repeats", "1", "--device", DEVICE]
    asked = bench_study.parser().parse_args([*words, "--precision", precision])
    if task.compile_only:
        asked.count, asked.duration = 10, 0.001
    times = bench_study.times_of(asked)
    return f"{precision}: " + "; ".join(times.lines()), {"overhead": times.overhead}


def seconds_of(*words: str, **environment: str) -> float:
    """Seconds of a command of the package."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "warpchain", *words]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)
    seconds = time.perf_counter() - begin
    if done.returncode:
        raise RuntimeError((done.stderr.strip() or "no output").splitlines()[-1])
    return seconds


TINY = """
[study]
drive = "marine"
[design]
kind = "factorial"
[[factors]]
name = "torque"
path = "sprockets.camshaft.load.torque"
levels = [7e3, 8e3]
[run]
duration = 0.001
device = "{device}"
"""


def start(task: Task, how: str) -> Found:
    """A whole command of nearly no simulated time on the GPU, its kernels compiled already or not; `study status`."""
    if task.compile_only and how != "warm":
        return "", {}
    words = ["run", "industrial", "--duration", "0.001", "--device", DEVICE, "--quiet", "--overwrite", "-o"]
    with tempfile.TemporaryDirectory() as name:
        if how == "status":
            (Path(name) / "study.toml").write_text(TINY.format(device=DEVICE))
            seconds_of("study", "run", f"{name}/study.toml", "-o", f"{name}/study")
            said, best = "study status", min(seconds_of("study", "status", f"{name}/study") for _ in range(3))
        elif how == "cold":
            said = "warpchain run industrial --duration 0.001, no kernel compiled"
            best = seconds_of(*words, f"{name}/out.mcap", WARP_CACHE_PATH=f"{name}/cache")
        else:
            said = "warpchain run industrial --duration 0.001"
            best = min(seconds_of(*words, f"{name}/out.mcap") for _ in range(task.rounds))
    return f"{said}: {best:.2f} s", {"seconds": best}


def packing(task: Task) -> Found:
    """What the processor does before the kernels for 10,000 different marine drives, in seconds of CPU time."""
    from bench_assembly import adjustment

    from warpchain.drive.stack import stacks_of
    from warpchain.engine.simulation import schedules_of
    from warpchain.study.run.adjust import adjusted_all

    marks = [time.process_time()]
    drives = different(load_drive(drive_path("marine")), 10_000)
    marks.append(time.process_time())
    stacks = stacks_of(drives)
    pack(drives, schedules_of(drives, None, None, Record("none"), None, stacks), stacks)
    marks.append(time.process_time())
    adjusted_all(drives[:1000], adjustment(drives[0]), [{}] * 1000)
    marks.append(time.process_time())
    made, packed, adjusted = (after - before for before, after in pairwise(marks))
    line = f"made by with_values {made:.2f} s, packed {packed:.2f} s, 1,000 adjusted by a place {adjusted:.2f} s"
    return line, {"packed": packed, "adjusted": adjusted / 1000 / (made / 10_000)}


def float64(task: Task) -> Found:
    """Operations on float64 in the time loops of the kernels at float32; with metrics those of looks are among them."""
    found = {name: float(counts(kind)[0]) for name, kind in KINDS.items()}
    line = ", ".join(f"{name} {count:.0f}" for name, count in found.items())
    return line, {"loop": max(count for name, count in found.items() if not KINDS[name].measuring)} | found


def choice(task: Task) -> Found:
    """Which device finishes a run first, and which one is taken: seconds over those of the faster one, at worst."""
    if not wp.is_cpu_available():
        return NO_COMPILER, {}
    worst, told = 0.0, []
    for variants in (1, 8, 64, 512):
        drives = [DRIVES[TWO].with_values({"run.settle": False})] * variants
        options: dict[str, Any] = {"duration": 0.1, "record": Record(variants="none")}
        seconds = {device: timed(drives, 2, device=device, **options) for device in ("cpu", DEVICE)}
        taken = simulate(drives, **options).info.device
        times = seconds[DEVICE if "cuda" in taken else "cpu"] / min(seconds.values())
        worst = max(worst, times)
        told.append(f"{variants}: cpu {seconds['cpu']:.2f} s, GPU {seconds[DEVICE]:.2f} s, taken {taken}")
    return "; ".join(told), {"times": worst}


def cpu(task: Task, title: str) -> Found:
    """One core beside plain C, as `bench_cpu.py`."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if not wp.is_cpu_available() or compiler is None:
        return NO_COMPILER if compiler else f"{NOT_HERE}: no C compiler", {}
    drive, steps = DRIVES[title], 10_000
    packed = pack([drive], [schedule(drive, False)])
    work = drive.chain.links * steps
    with tempfile.TemporaryDirectory() as name:
        programs = [Reference(Path(name), compiler, *flags) for flags in ([], ["-fno-math-errno"])]
        rates = np.zeros(4)
        for _ in range(5):
            engine = [engine_rate(drive, 1, 1, steps, metrics, "float64") for metrics in (False, True)]
            rates = np.maximum(rates, [*engine, *(work / program.run(packed, steps)[0] for program in programs)])
    ours, measured, plain, vectorized = rates / 1e6
    line = f"{title}: {ours:.1f}, with metrics {measured:.1f}; C {plain:.1f}, with -fno-math-errno {vectorized:.1f}"
    return line, {"bare": ours / vectorized, "metrics": measured / plain}


@dataclass(frozen=True)
class Part:
    """Cases that are told together: what measures one, and the lines above them."""

    measure: Callable[..., Found]
    cases: Sequence[tuple[Any, ...]]
    heading: str
    seconds: float  # that a case may take on an H200, to begin the longest first
    where: str = "gpu"  # that it has to itself; "all" of them; "cores", beside others; "alone" on the machine
    compiles: bool = True  # kernels for a GPU, before it is measured


COUNTS = list(product(DRIVES, PRECISIONS, VARIANTS))
PARTS = {
    "table": Part(
        table,
        COUNTS,
        "the time loop: 1e9 roller-steps/s, launches of 2,000 to 20,000 steps\n"
        "drive                        precision  variants     CUDA     bare  of CUDA   us/step  metrics  of bare   GiB"
        "  first launch [s]  distance from CUDA after 500 steps [m]",
        15,
    ),
    "joints": Part(
        joints,
        [(*case, metrics) for case in COUNTS for metrics in (False, True)],
        "joint friction: 1e9 roller-steps/s\n"
        "drive                        precision  variants  metrics  without  with friction  ratio",
        15,
    ),
    "recording": Part(
        recording, [(p,) for p in PRECISIONS], "2,112 variants of the marine drive, 2 s, no settling: seconds", 40
    ),
    "runs": Part(
        runs,
        list(product(DRIVES, PRECISIONS)),
        "16,896 variants, no settling: seconds of whole runs without metrics and with those of the second half\n"
        "drive                        precision  [s]  without  metrics  of bare  1e9 roller-steps/s",
        45,
    ),
    "rollers": Part(
        rollers,
        list(product(LINKS, PRECISIONS)),
        "two 30-tooth sprockets, about 500,000 rollers in all: 1e9 roller-steps/s; one variant alone\n"
        "links precision  variants     bare  metrics   us/step",
        20,
    ),
    "gpus": Part(gpus, [()], "several GPUs, the marine drive", 50, where="all"),
    "headline": Part(
        headline,
        list(product(("that differ in a load", FIVE, SMOOTH), PRECISIONS)),
        "10,000 variants of the marine drive, with its friction unless said, 2 s each, metrics: from drives to table\n"
        "five values: the camshaft's torque, the tightener's place, the chain's elongation, roller mass and damping",
        45,
    ),
    "kinds": Part(kinds, [(p,) for p in PRECISIONS], "8,000 two-sprocket drives, 1 s each, metrics", 40),
    "study": Part(study, [(p,) for p in PRECISIONS], "10,000 marine rows, 2 s each: the study command", 70),
    "packing": Part(packing, [()], "10,000 different marine drives, CPU time", 15, "cores", compiles=False),
    "float64": Part(float64, [()], "operations on float64 in the time loop at float32", 120, "cores", compiles=False),
    "choice": Part(choice, [()], "0.1 s of the two sprockets by number of variants", 20, "alone"),
    "cpu": Part(cpu, [(title,) for title in DRIVES], "one core, 1e6 roller-steps/s", 10, "alone", compiles=False),
    "start": Part(start, [("warm",), ("cold",), ("status",)], "start of a command", 12, "alone"),
    "limit": Part(limit, [], "another CUDA program: 1e9 roller-steps/s by precision and variants", 20),
}
NAMES = [name for name, part in PARTS.items() if part.cases]
"""The parts that can be asked for by name."""


def visible() -> list[str]:
    """The GPUs that this process sees, as CUDA names them; one that is none where there are none."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    return named.split(",") if named else [str(gpu) for gpu in range(wp.get_cuda_device_count())] or [""]


def done(task: Task) -> Found:
    """Does a task."""
    return PARTS[task.part].measure(task, *task.case)


def tasks_of(name: str, quick: bool, folder: Path) -> list[Task]:
    """The cases of a part."""
    sizes = {str(size) for size in (*VARIANTS, *LINKS)}
    keeps = {"16896"} if name == "joints" else {str(size) for size in QUICK}
    cases = [case for case in PARTS[name].cases if not quick or sizes.intersection(map(str, case)) <= keeps]
    return [Task(name, case, folder, quick=quick) for case in cases]


class Session:
    """Measures tasks, tells how it goes, and keeps what was found.

    Args:
        tasks: all that are asked for; what the store has is not measured again.
        store: where it is kept.
        seconds: after how many it ends.
    """

    def __init__(self, tasks: Sequence[Task], store: Store, seconds: float) -> None:
        self.begin = time.monotonic()
        self.until = self.begin + seconds
        self.tasks, self.store = tasks, store
        self.left = [task for task in tasks if not store.lines.get(task.key, ("", {}))[1]]

    def tell(self, words: str) -> None:
        """A line with the seconds that have passed."""
        print(f"[{time.monotonic() - self.begin:4.0f} s] {words}", flush=True)

    def _of(self, *where: str) -> list[Task]:
        """What is left to measure at some places: on several GPUs the longest first, on one the shortest."""
        tasks = [task for task in self.left if PARTS[task.part].where in where]
        return sorted(tasks, key=lambda task: PARTS[task.part].seconds, reverse=len(visible()) > 1)

    def _keep(self, task: Task, found: Found) -> None:
        self.store.put(task, found)
        self.tell(f"{task.key}: done" if found[1] else found[0])

    def compile(self) -> None:
        """Compiles what the tasks run, side by side on all cores."""
        tasks = [replace(task, compile_only=True) for task in self.left if PARTS[task.part].compiles]
        if not tasks:
            return
        compiled(HERE / "chain_reference.cu", tasks[0].folder)
        gpus = visible()
        workers = [gpus[k % len(gpus)] for k in range(min(len(tasks), available_cores()))]
        for result in results(tasks, workers, done, self.until):
            line, figures = result.result()
            if line and not figures and not line.startswith(NOT_HERE):
                self.tell(f"while compiling: {line}")
        self.tell(f"compiled what {len(tasks)} cases run")

    def measure(self) -> None:
        """Measures what is left: side by side where each has a GPU or a core, then the rest one by one."""
        gpus = visible()
        last = self._of("all", "alone")
        idle = () if wp.is_cpu_available() else ("choice", "cpu")
        until = self.until - sum(PARTS[task.part].seconds for task in last if task.part not in idle)
        beside = results(self._of("cores"), gpus[:1], done, until, self._keep)
        wait([*results(self._of("gpu"), gpus, done, until, self._keep), *beside])
        for task in last:
            self.tell(f"{task.key}: begun")
            wait(results([task], [",".join(gpus)], done, self.until, self._keep))

    def print_parts(self) -> None:
        """The lines of each part."""
        for name in dict.fromkeys(task.part for task in self.tasks):
            print(f"\n{PARTS[name].heading}")
            for task in self.tasks:
                if task.part == name:
                    print(self.store.lines[task.key][0])

    def print_aims(self) -> None:
        """What is aimed at beside what was found, of the parts that were asked for."""
        asked = {task.key for task in self.tasks}
        print(f"\n{'item, what is aimed at':82s} {'found':>8s}  aim", flush=True)
        for aim in aims(self.store.figures):
            why = [
                self.store.lines[case][0] for case in aim.cases if not self.store.figures.get(case) and case in asked
            ]
            if not math.isnan(aim.value):
                print(f"{aim.item}  {aim.words:79s} {aim.value:8.3g}  {aim.aim}")
            elif why:
                print(f"{aim.item}  {aim.words:79s} {'-':>8s}  {aim.aim}; {why[0]}")
        sys.stdout.flush()

    @property
    def failed(self) -> int:
        """How many cases failed or were cut off; not those that cannot be measured here."""
        lines = [self.store.lines[task.key] for task in self.tasks]
        return sum(not figures and not line.startswith(NOT_HERE) for line, figures in lines)


def part(word: str) -> str:
    """The name of a part."""
    if not (word in PARTS and PARTS[word].cases):
        raise argparse.ArgumentTypeError(f"{word!r}: allowed are {', '.join(NAMES)}")
    return word


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("parts", nargs="*", type=part, help=", ".join(NAMES))
    made.add_argument("--quick", action="store_true", help="fewer lengths and numbers of variants, less often")
    made.add_argument("--seconds", type=float, help="after how many it ends (default 480 with --quick, else never)")
    made.add_argument("--compile-only", action="store_true", help="compile what they run, and end")
    made.add_argument("--store", metavar="FILE", type=Path, help="where what was measured is kept, to go on from")
    made.add_argument("--limit", metavar="FILE.cu", type=Path, help="another CUDA program to hold the table against")
    return made


def main() -> int:
    """Runs the parts that are named."""
    asked = parser().parse_args()
    wp.config.log_level = wp.LOG_ERROR
    names = asked.parts or NAMES
    name = wp.get_device(DEVICE).name if wp.is_cuda_available() else "none"
    print(f"{wp.get_cuda_device_count()} GPUs, the first: {name}", flush=True)
    if shutil.which("nvcc") is None:
        print("no nvcc here: the CUDA reference is left out")
    with tempfile.TemporaryDirectory() as name:
        tasks = [task for part in names for task in tasks_of(part, asked.quick, Path(name))]
        if asked.limit is not None:
            tasks.append(Task("limit", (str(asked.limit),), Path(name)))
        session = Session(tasks, Store(asked.store), asked.seconds or (480.0 if asked.quick else math.inf))
        session.compile()
        if asked.compile_only:
            return 0
        session.measure()
    session.print_parts()
    session.print_aims()
    return 1 if session.failed else 0


if __name__ == "__main__":
    sys.exit(main())
