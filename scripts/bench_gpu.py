"""GPU benchmark: 1e9 roller-steps a second, beside hand-written CUDA C++ doing the same work, compiled on the spot.

    python scripts/bench_gpu.py [table] [joints] [recording] [rollers] [gpus] [headline] [kinds] [study] [start]

`table`: the time loop bare and with metrics, by precision and number of variants, one alone among them, two drives,
each beside chain_reference.cu in the same run. `joints`: with joint friction beside without.
`recording`: whole runs without records, with 16 variants in full, and with metrics over the whole run.
`rollers`: by length of chain. `gpus`: on one GPU and on all. `headline`: 10,000 variants of the marine drive, two
simulated seconds each, metrics for all, equal but for a load and different in five values, these also without friction.
`kinds`: 8,000 two-sprocket drives of 224 kinds beside 8,000 of one. `study`: the study command beside a run of the same
drives. `start`: a command whose kernels are compiled already. Without names: all of them; at the end stands what the
performance page aims at, beside what was found.

First all kernels are compiled, side by side on all cores; then the cases are measured one after another, on as many
GPUs as there are, one case a GPU at a time. Each is run several times and the best counts. `--quick` leaves out some
lengths and numbers of variants. With `--store FILE` a case that the file has is not measured again, so that a run that
was cut off can be gone on with. Without nvcc the reference is left out, with a message.

`--limit FILE.cu` compiles and runs another CUDA program beside the table, one that prints lines such as
`CUDA f64 V=1056 N=118 steps=4000 ... 85.6 Groller-steps/s`.
"""

import argparse
import json
import math
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np
import warp as wp
from bench_cpu import FOREVER, HERE, RUBBING, bench_drives, reference_input

from warpchain import Drive, Record, load_drive, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.drive.examples import drive_path
from warpchain.engine.gpu import GpuEngine
from warpchain.engine.pack import pack
from warpchain.engine.packed import Packed
from warpchain.engine.simulation import available_cores
from warpchain.results.schedule import Schedule

DEVICE = "cuda:0"
PRECISIONS = ("float64", "float32")
VARIANTS = (1, 132, 1056, 4224, 16896)
LINKS = (62, 94, 118, 158, 190, 254, 382, 510, 766, 1022, 2000, 4000)
QUICK = {1, 1056, 16896, 118, 510, 1022, 4000}
"""Numbers of variants and lengths of chain that `--quick` keeps."""
DRIVES = bench_drives()
TWO, MARINE = DRIVES
FIVE = "that differ in five values"
SMOOTH = f"{FIVE}, without friction"


@dataclass(frozen=True)
class Task:
    """What a worker is to do: a case of a part, quickly if it is only to compile."""

    part: str
    case: tuple[Any, ...]
    folder: Path  # of the reference's program
    compile_only: bool = False

    @property
    def steps(self) -> int:
        """Steps of a measured launch."""
        return 64 if self.compile_only else 2000

    @property
    def key(self) -> str:
        """Its name in a store."""
        return " ".join(map(str, (self.part, *self.case)))


Found = tuple[str, dict[str, float]]
"""A line for the reader, and figures by name."""


def repeated(one: Packed, variants: int) -> Packed:
    """`one` packed variant `variants` times over, without assembling each."""
    return one.taken([0] * variants)


def bare(drive: Drive, variants: int, precision: str, steps: int, metrics: bool) -> tuple[float, float, float]:
    """Seconds of `steps` steps of the engine, of its first launch, and GiB that the ensemble takes."""
    schedule = Schedule(resolve_step(drive), FOREVER, 0 if metrics else FOREVER - 1, FOREVER, 0)
    packed = repeated(pack([drive], [schedule]).at_precision(precision), variants)
    free = wp.get_device(DEVICE).free_memory
    engine = GpuEngine(packed, DEVICE)
    taken = (free - wp.get_device(DEVICE).free_memory) / 2**30
    frames = engine.frame_buffer(0)

    def run(count: int) -> float:
        begin = time.perf_counter()
        for future in engine.advance(count, frames):
            future.result()
        return time.perf_counter() - begin

    first = run(64)
    best = min(run(steps) for _ in range(3))
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
    packed = pack([drive], [Schedule(resolve_step(drive), FOREVER, FOREVER - 1, FOREVER, 0)])
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
    engine = GpuEngine(pack([drive], [Schedule(resolve_step(drive), FOREVER, FOREVER - 1, FOREVER, 0)]), DEVICE)
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


def table(task: Task, title: str, precision: str, variants: int) -> Found:
    """The time loop beside the reference."""
    drive = DRIVES[title]
    work = variants * drive.chain.links * task.steps / 1e9
    theirs, _ = reference(drive, task.steps, variants, task.folder)
    cuda = theirs.get(precision, math.nan)
    best, first, taken = bare(drive, variants, precision, task.steps, False)
    measured, _, _ = bare(drive, variants, precision, task.steps, True)
    apart = f"{difference(drive, task.folder):9.1e}" if (precision, variants) == ("float64", 1) else ""
    line = (
        f"{title:28s} {precision:9s} {variants:9d} {work / cuda:8.2f} {work / best:8.2f} {cuda / best:8.2f} "
        f"{best / task.steps * 1e6:9.3f} {work / measured:8.2f} {best / measured:8.2f} {taken:5.2f} {first:9.2f} "
    )
    rates = {"cuda": work / cuda, "bare": work / best, "metrics": work / measured, "us": best / task.steps * 1e6}
    return line + apart, rates


def joints(task: Task, title: str, precision: str, variants: int, metrics: bool) -> Found:
    """What joint friction costs, beside the same drive without it."""
    drive = DRIVES[title]
    work = variants * drive.chain.links * task.steps / 1e9
    plain, _, _ = bare(drive, variants, precision, task.steps, metrics)
    rubbed, _, _ = bare(drive.with_values(RUBBING), variants, precision, task.steps, metrics)
    line = f"{title:28s} {precision:9s} {variants:9d}  {metrics!s:7s} {work / plain:8.2f} {work / rubbed:14.2f}"
    return f"{line} {plain / rubbed:6.2f}", {"ratio": plain / rubbed}


def timed(drives: list[Drive], **options: Any) -> float:
    """Seconds of a whole run, the better of two."""
    return min(simulate(drives, **options).info.wall_time for _ in range(2))


def recording(task: Task, precision: str) -> Found:
    """Whole runs of 2,112 variants, two seconds each, without settling."""
    drive = DRIVES[MARINE].with_values({"run.settle": False})
    drives = [drive] * 2112
    none, some = Record(variants="none"), Record(variants=range(0, 2112, 132), rate=5000.0)
    length = 0.001 if task.compile_only else 2.0
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "duration": length}
    last = (length - resolve_step(drive), length)
    nothing = timed(drives, record=none, window=last, **options)
    recorded = timed(drives, record=some, window=last, **options)
    metrics = timed(drives, record=none, window=(0.0, length), **options)
    line = (
        f"{precision}: bare {nothing:.3f}, 16 variants in full at 5 kHz {recorded:.3f} "
        f"({recorded / nothing - 1:+.1%}), metrics over all of it {metrics:.3f} ({metrics / nothing - 1:+.1%})"
    )
    return line, {"recorded": recorded / nothing, "metrics": metrics / nothing}


def rollers(task: Task, links: int, precision: str) -> Found:
    """The time loop by length of chain, two 30-tooth sprockets."""
    distance = (links - 30) / 2 * 0.1 + 0.0004
    drive = DRIVES[TWO].with_values({"chain.links": links, "sprockets.driven.center": [distance, 0.0]})
    variants, steps = 500_000 // links, task.steps // 4
    work = variants * links * steps / 1e9
    many, _, _ = bare(drive, variants, precision, steps, False)
    measured, _, _ = bare(drive, variants, precision, steps, True)
    alone, _, _ = bare(drive, 1, precision, steps, False)
    rates = {"bare": work / many, "metrics": work / measured, "us": alone / steps * 1e6}
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


def different(drive: Drive, count: int) -> list[Drive]:
    """Marine drives that differ in five values, two of which move rollers to other places.

    The camshaft's torque, the tightener's place, the chain's elongation, roller mass and damping.
    """
    x, y = drive.sprockets[1].center
    return [
        drive.with_values(
            {
                "sprockets.camshaft.load.torque": 8000.0 + 0.2 * k,
                "sprockets.tightener.center": [x - 1e-7 * k, y],
                "chain.elongation": 1e-8 * k,
                "chain.roller_mass": 6.95 + 1e-5 * k,
                "chain.damping": 1.0e5 + k,
            }
        )
        for k in range(count)
    ]


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


def start(task: Task) -> Found:
    """A whole command of nearly no simulated time, on the GPU, its kernels compiled already; the better of three."""
    seconds = []
    for _ in range(3):
        words = [sys.executable, "-m", "warpchain", "run", "industrial", "--duration", "0.001", "--device", DEVICE]
        with tempfile.TemporaryDirectory() as name:
            begin = time.perf_counter()
            done = subprocess.run([*words, "-o", f"{name}/out.mcap", "--quiet"], capture_output=True, text=True)
            seconds.append(time.perf_counter() - begin)
        if done.returncode:
            raise RuntimeError((done.stderr.strip() or "no output").splitlines()[-1])
    return f"warpchain run industrial --duration 0.001: {min(seconds):.2f} s", {"seconds": min(seconds)}


@dataclass(frozen=True)
class Part:
    """Cases that are told together: what measures one, and the lines above them."""

    measure: Callable[..., Found]
    cases: Sequence[tuple[Any, ...]]
    heading: str
    every_gpu: bool = False  # whether a case takes all GPUs


COUNTS = list(product(DRIVES, PRECISIONS, VARIANTS))
PARTS = {
    "table": Part(
        table,
        COUNTS,
        "the time loop: 1e9 roller-steps/s, 2,000 steps\n"
        "drive                        precision  variants     CUDA     bare  of CUDA   us/step  metrics  of bare   GiB"
        "  first launch [s]  distance from CUDA after 500 steps [m]",
    ),
    "joints": Part(
        joints,
        [(*case, metrics) for case in COUNTS for metrics in (False, True)],
        "joint friction: 1e9 roller-steps/s\n"
        "drive                        precision  variants  metrics  without  with friction  ratio",
    ),
    "recording": Part(
        recording, [(p,) for p in PRECISIONS], "2,112 variants of the marine drive, 2 s, no settling: seconds"
    ),
    "rollers": Part(
        rollers,
        list(product(LINKS, PRECISIONS)),
        "two 30-tooth sprockets, about 500,000 rollers in all: 1e9 roller-steps/s; one variant alone\n"
        "links precision  variants     bare  metrics   us/step",
    ),
    "gpus": Part(gpus, [()], "several GPUs, the marine drive", every_gpu=True),
    "headline": Part(
        headline,
        list(product(("that differ in a load", FIVE, SMOOTH), PRECISIONS)),
        "10,000 variants of the marine drive, with its friction unless said, 2 s each, metrics: from drives to table\n"
        "five values: the camshaft's torque, the tightener's place, the chain's elongation, roller mass and damping",
    ),
    "kinds": Part(kinds, [(p,) for p in PRECISIONS], "8,000 two-sprocket drives, 1 s each, metrics"),
    "study": Part(study, [(p,) for p in PRECISIONS], "10,000 marine rows, 2 s each: the study command"),
    "start": Part(start, [()], "start of a command"),
    "limit": Part(limit, [], "another CUDA program: 1e9 roller-steps/s by precision and variants"),
}
NAMES = [name for name, part in PARTS.items() if part.cases]
"""The parts that can be asked for by name."""


def aims(found: dict[str, dict[str, float]]) -> Iterator[tuple[str, float, str]]:
    """What is aimed at: the figure in words, what was found, and the aim. Only of cases that were measured."""

    def got(case: str, name: str) -> float:
        return found.get(case, {}).get(name, math.nan)

    for precision, seconds in (("float64", 12), ("float32", 9)):
        for how in (FIVE, SMOOTH):
            case = f"headline {how} {precision}"
            yield f"10,000 marine variants {how}, {precision} [s]", got(case, "seconds"), f"under {seconds}"
            yield (
                f"    of which packing and the table, {precision} [s]",
                got(case, "before and after"),
                "0.7 for packing",
            )
        yield f"8,000 of 224 kinds beside one kind, {precision}", got(f"kinds {precision}", "times"), "at most 1.5"
        yield f"the study command beside the run, {precision}", got(f"study {precision}", "overhead"), "at most 0.15"
    for variants, rate in ((16896, 80), (1056, 65)):
        case = f"table {TWO} float32 {variants}"
        yield f"two sprockets, {variants} variants, float32 [1e9/s]", got(case, "bare"), f"{rate}"
        yield "    the CUDA reference", got(case, "cuda"), ""
    for precision, least in (("float64", 0.9), ("float32", 0.85)):
        for title in DRIVES:
            case = f"table {title} {precision} 16896"
            part = got(case, "metrics") / got(case, "bare")
            yield f"{title} with metrics, part of bare, {precision}", part, f"at least {least}"
    for title in DRIVES:
        alone, crowd = f"table {title} float64 1", f"table {title} float64 1056"
        yield f"{title}, one variant alone, float64 [us a step]", got(alone, "us"), "1.2"
        yield f"{title}, 1,056 variants, part of CUDA", got(crowd, "bare") / got(crowd, "cuda"), "at least 0.9"
    yield "1,022 links beside 510", got("rollers 1022 float64", "bare") / got("rollers 510 float64", "bare"), "1"
    yield f"{found.get('gpus', {}).get('count', math.nan):.0f} GPUs beside one", got("gpus", "times"), "3.8 of 4"
    yield "start of a command, nearly nothing simulated [s]", got("start", "seconds"), "1.6 beside the simulation"


def visible() -> list[str]:
    """The GPUs that this process sees, as CUDA names them."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    return named.split(",") if named else [str(gpu) for gpu in range(wp.get_cuda_device_count())]


def see(gpus: str) -> None:
    """What a worker does before its first task: it sees some GPUs only."""
    os.environ["CUDA_VISIBLE_DEVICES"] = gpus
    wp.config.log_level = wp.LOG_ERROR
    warnings.simplefilter("ignore")


def done(task: Task) -> Found:
    """Does a task; what stops it is its line, without figures."""
    try:
        return PARTS[task.part].measure(task, *task.case)
    except Exception as error:  # the other cases go on
        return failure(task, error)


def failure(task: Task, error: Exception) -> Found:
    """The line of a task that was stopped."""
    return f"{task.key}: failed: {(str(error).strip() or type(error).__name__).splitlines()[0]}", {}


def results(tasks: Sequence[Task], workers: Sequence[str]) -> list[Future[Found]]:
    """What comes of tasks, each done by whichever worker is free: processes that see the GPUs named."""
    waiting: SimpleQueue[tuple[Task, Future[Found]] | None] = SimpleQueue()
    futures: list[Future[Found]] = [Future() for _ in tasks]
    for pair in zip(tasks, futures, strict=True):
        waiting.put(pair)

    def serve(gpus: str) -> None:
        pool = None
        while (pair := waiting.get()) is not None:
            pool = pool or ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), see, (gpus,))
            try:
                pair[1].set_result(pool.submit(done, pair[0]).result())
            except BrokenExecutor as error:  # the worker died: another one goes on
                pair[1].set_result(failure(pair[0], error))
                pool = None
        if pool is not None:
            pool.shutdown()

    for gpus in workers:
        waiting.put(None)
        Thread(target=serve, args=(gpus,)).start()
    return futures


class Store:
    """What was measured, kept in a file if there is one."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.lines: dict[str, Found] = {}
        if path is not None and path.exists():
            self.lines = {name: (line, figures) for name, (line, figures) in json.loads(path.read_text()).items()}

    def put(self, task: Task, found: Found) -> None:
        """Adds a case; one that failed is measured again the next time."""
        self.lines[task.key] = found
        if self.path is not None:
            kept = {name: (line, figures) for name, (line, figures) in self.lines.items() if figures}
            self.path.write_text(json.dumps(kept))

    @property
    def figures(self) -> dict[str, dict[str, float]]:
        """The figures of each case."""
        return {name: figures for name, (_, figures) in self.lines.items()}


def tasks_of(name: str, quick: bool, folder: Path) -> list[Task]:
    """The cases of a part."""
    sizes = {*VARIANTS, *LINKS}
    cases = [case for case in PARTS[name].cases if not quick or sizes.intersection(case) <= QUICK]
    return [Task(name, case, folder) for case in cases]


def compile_all(tasks: Sequence[Task]) -> None:
    """Compiles what the tasks run, side by side."""
    begin = time.perf_counter()
    compiled(HERE / "chain_reference.cu", tasks[0].folder)
    gpus = visible()
    workers = [gpus[k % len(gpus)] for k in range(min(len(tasks), available_cores()))]
    for result in results([replace(task, compile_only=True) for task in tasks], workers):
        line, figures = result.result()
        if line and not figures:
            print(f"while compiling: {line}", flush=True)
    print(f"compiled what {len(tasks)} cases run in {time.perf_counter() - begin:.0f} s", flush=True)


def measure_all(tasks: Sequence[Task], workers: Sequence[str], store: Store) -> None:
    """Measures cases, prints the lines of each, and keeps them."""
    left = [task for task in tasks if task.key not in store.lines]
    coming = dict(zip((task.key for task in left), results(left, workers), strict=True))
    before = ""
    for task in tasks:
        if task.part != before:
            print(f"\n{PARTS[task.part].heading}", flush=True)
        before = task.part
        if task.key in coming:
            store.put(task, coming[task.key].result())
        print(store.lines[task.key][0], flush=True)


def part(word: str) -> str:
    """The name of a part."""
    if not (word in PARTS and PARTS[word].cases):
        raise argparse.ArgumentTypeError(f"{word!r}: allowed are {', '.join(NAMES)}")
    return word


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("parts", nargs="*", type=part, help=", ".join(NAMES))
    made.add_argument("--quick", action="store_true", help="fewer lengths and numbers of variants")
    made.add_argument("--compile-only", action="store_true", help="compile what they run, and end")
    made.add_argument("--store", metavar="FILE", type=Path, help="where what was measured is kept, to go on from")
    made.add_argument("--limit", metavar="FILE.cu", type=Path, help="another CUDA program to hold the table against")
    return made


def main() -> None:
    """Runs the parts that are named."""
    asked = parser().parse_args()
    wp.config.log_level = wp.LOG_ERROR
    gpus = visible()
    store = Store(asked.store)
    names = asked.parts or NAMES
    print(f"{len(gpus)} GPUs, the first: {wp.get_device(DEVICE).name}")
    if shutil.which("nvcc") is None:
        print("no nvcc here: the CUDA reference is left out")
    with tempfile.TemporaryDirectory() as name:
        tasks = [task for part in names for task in tasks_of(part, asked.quick, Path(name))]
        if asked.limit is not None:
            tasks.append(Task("limit", (str(asked.limit),), Path(name)))
        left = [task for task in tasks if task.key not in store.lines]
        if left:
            compile_all(left)
        if asked.compile_only:
            return
        measure_all([task for task in tasks if not PARTS[task.part].every_gpu], gpus, store)
        measure_all([task for task in tasks if PARTS[task.part].every_gpu], [",".join(gpus)], store)
    print(f"\n{'what is aimed at':72s} {'found':>8s}  aim")
    for words, value, aim in aims(store.figures):
        if not math.isnan(value):
            print(f"{words:72s} {value:8.3g}  {aim}")


if __name__ == "__main__":
    main()
