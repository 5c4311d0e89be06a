"""GPU benchmark: 1e9 roller-steps a second, beside hand-written CUDA C++ doing the same work, compiled on the spot.

    python scripts/bench_gpu.py [table] [joints] [recording] [rollers] [gpus] [headline]

`table`: the time loop bare and with metrics, by precision and number of variants, two drives, each beside
chain_reference.cu in the same run. `joints`: with joint friction beside without.
`recording`: whole runs without records, with 16 variants in full, and with metrics over the whole run.
`rollers`: by length of chain. `gpus`: on one GPU and on all. `headline`: 10,000 variants of the
marine drive, two simulated seconds each, metrics for all. Without names: all of them. Each case is run several times
and the best counts; compilation is timed apart. Without nvcc the reference is left out, with a message.
"""

import argparse
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from bench_cpu import FOREVER, HERE, RUBBING, TWO_SPROCKETS, reference_input

from warpchain import Drive, Record, load_drive, loads_drive, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.drive.examples import drive_path
from warpchain.engine.gpu import GpuEngine
from warpchain.engine.pack import pack
from warpchain.engine.packed import Packed
from warpchain.results.schedule import Schedule

DEVICE = "cuda:0"
VARIANTS = (1, 132, 1056, 4224, 16896)
DRIVES = {
    "two equal 30-tooth sprockets": loads_drive(TWO_SPROCKETS),
    "marine drive": load_drive(drive_path("marine")),
}


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


def table() -> None:
    """The time loop beside the reference."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, drive in DRIVES.items():
            print(f"\n{title}: {drive.chain.links} rollers; 1e9 roller-steps/s, 2,000 steps")
            print("precision  variants     CUDA     bare  of CUDA   us/step  metrics  of bare   GiB  first launch s")
            times = reference(drive, 2000, folder)
            for precision in ("float64", "float32"):
                for variants in VARIANTS:
                    work = variants * drive.chain.links * 2000 / 1e9
                    best, first, taken = bare(drive, variants, precision, 2000, False)
                    measured, _, _ = bare(drive, variants, precision, 2000, True)
                    theirs = times.get((precision, variants), np.nan)
                    print(
                        f"{precision:9s} {variants:9d} {work / theirs:8.2f} {work / best:8.2f} {theirs / best:8.2f} "
                        f"{best / 2000 * 1e6:9.3f} {work / measured:8.2f} {best / measured:8.2f} {taken:5.2f} "
                        f"{first:9.2f}",
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


def headline() -> None:
    """10,000 variants of the marine drive."""
    drive = DRIVES["marine drive"]
    begin = time.perf_counter()
    drives = [drive.with_values({"sprockets.camshaft.load.torque": 8000.0 + 0.2 * k}) for k in range(10_000)]
    made = time.perf_counter() - begin
    for precision in ("float64", "float32"):
        simulate(drives, device=DEVICE, precision=precision, duration=0.001, record=Record(variants="none"))  # compiles
        begin = time.perf_counter()
        run = simulate(drives, device=DEVICE, precision=precision, record=Record(variants="none"))
        total = time.perf_counter() - begin
        diverged = sum(run.metrics["diverged"].to_pylist())
        mean = np.mean(run.metrics["tension_mean"].to_numpy())
        print(
            f"\n10,000 variants of the marine drive, 2 s each, {precision}: {total:.2f} s, of which packing "
            f"{total - run.info.wall_time:.2f} s (drives made in {made:.2f} s); {diverged} diverged, "
            f"mean tension {mean:.0f} N",
            flush=True,
        )


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


PARTS = {
    "table": table,
    "joints": joints,
    "recording": recording,
    "rollers": rollers,
    "gpus": gpus,
    "headline": headline,
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
    return made


def main() -> None:
    """Runs the parts that are named."""
    chosen = parser().parse_args().parts or list(PARTS)
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    print(wp.get_device(DEVICE).name)
    for name in chosen:
        PARTS[name]()


if __name__ == "__main__":
    main()
