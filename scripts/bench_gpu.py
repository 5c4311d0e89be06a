"""GPU benchmark: 1e9 roller-steps a second, beside hand-written CUDA C++ doing the same work, compiled on the spot.

    python scripts/bench_gpu.py [table] [joints] [recording] [rollers] [gpus] [headline] [kinds]

`table`: the time loop bare and with metrics, by precision and number of variants, one alone among them, two drives,
each beside chain_reference.cu in the same run. `joints`: with joint friction beside without.
`recording`: whole runs without records, with 16 variants in full, and with metrics over the whole run.
`rollers`: by length of chain. `gpus`: on one GPU and on all. `headline`: 10,000 variants of the
marine drive, two simulated seconds each, metrics for all, equal but for a load and different in five values. `kinds`:
8,000 two-sprocket drives of 224 kinds beside 8,000 of one. Without names: all of them. Each case is run several times
and the best counts; compilation is timed apart. Without nvcc the reference is left out, with a message.

`--limit FILE.cu` compiles and runs another CUDA program beside the table, one that prints lines such as
`CUDA f64 V=1056 N=118 steps=4000 ... 85.6 Groller-steps/s`.
"""

import argparse
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
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
from warpchain.results.schedule import Schedule

DEVICE = "cuda:0"
VARIANTS = (1, 132, 1056, 4224, 16896)
DRIVES = bench_drives()


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


def reference(drive: Drive, steps: int, folder: Path) -> dict[tuple[str, int], float]:
    """Seconds of the CUDA program by precision and variants; empty without nvcc."""
    if shutil.which("nvcc") is None:
        print("  no nvcc here: the CUDA reference is left out")
        return {}
    program = folder / "chain_reference_gpu"
    if not program.exists():
        source = str(HERE / "chain_reference.cu")
        subprocess.run(["nvcc", "-O3", "-arch=native", "-o", str(program), source], check=True)
    packed = pack([drive], [Schedule(resolve_step(drive), FOREVER, FOREVER - 1, FOREVER, 0)])
    (folder / "in").write_bytes(reference_input(packed))
    command = [str(program), str(folder / "in"), str(folder / "out"), str(steps), *map(str, VARIANTS)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    words = [line.split() for line in lines]
    return {("float64" if size == "8" else "float32", int(count)): float(seconds) for size, count, seconds in words}


def difference(drive: Drive, steps: int, folder: Path) -> float:
    """Largest distance between the engine's rollers and the reference's after `steps` steps [m]."""
    packed = pack([drive], [Schedule(resolve_step(drive), FOREVER, FOREVER - 1, FOREVER, 0)])
    (folder / "in").write_bytes(reference_input(packed))
    command = [str(folder / "chain_reference_gpu"), str(folder / "in"), str(folder / "out"), str(steps), "1"]
    subprocess.run(command, check=True, capture_output=True)
    engine = GpuEngine(packed, DEVICE)
    for future in engine.advance(steps, engine.frame_buffer(0)):
        future.result()
    n = drive.chain.links
    ours, theirs = engine.rollers()[: 2 * n], np.fromfile(folder / "out")[: 2 * n]
    engine.close()
    return float(np.abs(ours - theirs).max())


LIMIT_LINE = re.compile(r"^CUDA f(64|32) V=(\d+) .*?([\d.]+) Groller-steps/s")


def limits(source: Path | None, folder: Path) -> dict[tuple[str, int], float]:
    """What another CUDA program reaches, 1e9 roller-steps a second by precision and variants; empty without one."""
    if source is None or shutil.which("nvcc") is None:
        return {}
    program = folder / "limit"
    subprocess.run(["nvcc", "-O3", "-arch=native", "-o", str(program), str(source)], check=True)
    lines = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout.splitlines()
    return limit_rates(lines)


def limit_rates(lines: list[str]) -> dict[tuple[str, int], float]:
    """The rates in such a program's lines; others do not count."""
    found = [match for match in map(LIMIT_LINE.match, lines) if match]
    return {(f"float{match[1]}", int(match[2])): float(match[3]) for match in found}


def table(limit: Path | None = None) -> None:
    """The time loop beside the reference."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, drive in DRIVES.items():
            print(f"\n{title}: {drive.chain.links} rollers; 1e9 roller-steps/s, 2,000 steps")
            print(
                "precision  variants     CUDA     bare  of CUDA   us/step  metrics  of bare   GiB  first launch  limit"
            )
            times = reference(drive, 2000, folder)
            most = limits(limit, folder) if len(drive.sprockets) == 2 else {}
            for precision in ("float64", "float32"):
                for variants in VARIANTS:
                    work = variants * drive.chain.links * 2000 / 1e9
                    best, first, taken = bare(drive, variants, precision, 2000, False)
                    measured, _, _ = bare(drive, variants, precision, 2000, True)
                    theirs = times.get((precision, variants), np.nan)
                    print(
                        f"{precision:9s} {variants:9d} {work / theirs:8.2f} {work / best:8.2f} {theirs / best:8.2f} "
                        f"{best / 2000 * 1e6:9.3f} {work / measured:8.2f} {best / measured:8.2f} {taken:5.2f} "
                        f"{first:9.2f} {most.get((precision, variants), np.nan):12.2f}",
                        flush=True,
                    )
            if times:
                print(f"largest difference in position after 500 steps: {difference(drive, 500, folder):.1e} m")


def timed(drives: list[Drive], **options: Any) -> float:
    """Seconds of a whole run, the better of two."""
    return min(simulate(drives, **options).info.wall_time for _ in range(2))


def recording() -> None:
    """Whole runs of 2,112 variants, two seconds each, without settling."""
    drive = DRIVES["marine drive"].with_values({"run.settle": False})
    drives = [drive] * 2112
    none = Record(variants="none")
    some = Record(variants=range(0, 2112, 132), rate=5000.0)
    print("\n2,112 variants of the marine drive, 2 s, no settling: seconds")
    for precision in ("float64", "float32"):
        options: dict[str, Any] = {"device": DEVICE, "precision": precision, "duration": 2.0}
        simulate(drives, record=none, **options | {"duration": 0.001})  # compiles
        last = (2.0 - resolve_step(drive), 2.0)
        nothing = timed(drives, record=none, window=last, **options)
        recorded = timed(drives, record=some, window=last, **options)
        metrics = timed(drives, record=none, window=(0.0, 2.0), **options)
        print(
            f"{precision}: bare {nothing:.3f}, 16 variants in full at 5 kHz {recorded:.3f} "
            f"({recorded / nothing - 1:+.1%}), metrics over all of it {metrics:.3f} ({metrics / nothing - 1:+.1%})",
            flush=True,
        )


def rollers() -> None:
    """The time loop by length of chain, two 30-tooth sprockets."""
    print("\ntwo 30-tooth sprockets, about 500,000 rollers in all: 1e9 roller-steps/s, float64 and float32")
    base = DRIVES["two equal 30-tooth sprockets"]
    for links in (62, 94, 118, 158, 190, 254, 382, 510, 766, 1022, 2000, 4000):
        distance = (links - 30) / 2 * 0.1 + 0.0004
        drive = base.with_values({"chain.links": links, "sprockets.driven.center": [distance, 0.0]})
        variants = 500_000 // links
        rates = [variants * links * 500 / bare(drive, variants, p, 500, False)[0] / 1e9 for p in ("float64", "float32")]
        print(f"{links:5d} rollers, {variants:5d} variants: {rates[0]:7.2f} {rates[1]:7.2f}", flush=True)


def gpus() -> None:
    """The same ensemble on one GPU and on all, 0.2 s each."""
    count = wp.get_cuda_device_count()
    drive = DRIVES["marine drive"].with_values({"run.settle": False})
    drives = [drive] * (16_896 * count)
    options: dict[str, Any] = {"duration": 0.2, "record": Record(variants="none")}
    simulate([drive] * count, device="cuda", **options)
    one = timed(drives, device=DEVICE, **options)
    every = timed(drives, device="cuda", **options)
    title = f"{len(drives)} variants of the marine drive, 0.2 s"
    print(f"\n{title}: one GPU {one:.2f} s, {count} GPUs {every:.2f} s, {one / every:.2f}x")


def different(drive: Drive, count: int) -> list[Drive]:
    """Marine drives that differ in five values, two of which move rollers to other places."""
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


def headline() -> None:
    """10,000 variants of the marine drive, with its friction."""
    drive = load_drive(drive_path("marine"))
    loads = [drive.with_values({"sprockets.camshaft.load.torque": 8000.0 + 0.2 * k}) for k in range(10_000)]
    for title, drives in (("that differ in a load", loads), ("that differ in five values", different(drive, 10_000))):
        for precision in ("float64", "float32"):
            told = f"10,000 variants of the marine drive {title}, 2 s each, {precision}"
            whole(told, drives, precision, None)


def whole(title: str, drives: list[Drive], precision: str, duration: float | None) -> float:
    """Times a run from a list of drives to the table of metrics, prints it, and returns its seconds."""
    options: dict[str, Any] = {"device": DEVICE, "precision": precision, "record": Record(variants="none")}
    simulate(drives, duration=0.001, **options)  # compiles
    begin = time.perf_counter()
    run = simulate(drives, duration=duration, **options)
    total = time.perf_counter() - begin
    diverged = sum(run.metrics["diverged"].to_pylist())
    mean = np.mean(run.metrics["tension_mean"].to_numpy())
    print(
        f"\n{title}: {total:.2f} s, of which packing and the table {total - run.info.wall_time:.2f} s; "
        f"{diverged} diverged, mean tension {mean:.0f} N",
        flush=True,
    )
    return total


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


def kinds() -> None:
    """8,000 drives of many kinds beside 8,000 of one, 1 s each."""
    base = DRIVES["two equal 30-tooth sprockets"]
    many = kinds_of(base)
    drives = [many[k % len(many)] for k in range(8_000)]
    for precision in ("float64", "float32"):
        one = whole(f"8,000 variants of one kind, 1 s each, {precision}", [base] * 8_000, precision, 1.0)
        all_ = whole(f"8,000 variants of {len(many)} kinds, 1 s each, {precision}", drives, precision, 1.0)
        work = sum(drive.chain.links for drive in drives) / (8_000 * base.chain.links)
        print(f"{all_ / one:.2f} times as long, for {work:.2f} times the roller-steps", flush=True)


def joints() -> None:
    """What joint friction costs, beside the same drive without it."""
    for title, drive in DRIVES.items():
        print(f"\n{title}: {drive.chain.links} rollers; 1e9 roller-steps/s, 2,000 steps")
        print("precision  variants  metrics  without  with friction  ratio")
        rubbing = drive.with_values(RUBBING)
        for precision in ("float64", "float32"):
            for variants in VARIANTS:
                for metrics in (False, True):
                    work = variants * drive.chain.links * 2000 / 1e9
                    plain, _, _ = bare(drive, variants, precision, 2000, metrics)
                    rubbed, _, _ = bare(rubbing, variants, precision, 2000, metrics)
                    print(
                        f"{precision:9s} {variants:9d}  {metrics!s:7s} {work / plain:8.2f} {work / rubbed:14.2f} "
                        f"{plain / rubbed:6.2f}",
                        flush=True,
                    )


PARTS: dict[str, Callable[..., None]] = {
    "table": table,
    "joints": joints,
    "recording": recording,
    "rollers": rollers,
    "gpus": gpus,
    "headline": headline,
    "kinds": kinds,
}


def part(word: str) -> str:
    """The name of a part."""
    if word not in PARTS:
        raise argparse.ArgumentTypeError(f"{word!r}: allowed are {', '.join(PARTS)}")
    return word


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("parts", nargs="*", type=part, help=", ".join(PARTS))
    made.add_argument("--limit", metavar="FILE.cu", type=Path, help="another CUDA program to hold the table against")
    return made


def main() -> None:
    """Runs the parts that are named."""
    asked = parser().parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    print(wp.get_device(DEVICE).name)
    for name in asked.parts or list(PARTS):
        PARTS[name](*([asked.limit] if name == "table" else []))


if __name__ == "__main__":
    main()
