"""GPU benchmark of the block kernel's time loop: 1e9 roller-steps a second, by precision and number of variants.

    python scripts/bench_gpu.py [--device cuda:0] [--drive two|marine] [--blocks 1,4] [--metrics] [--only 1056,16896]

Two equal 30-tooth sprockets (118 rollers) or the marine drive (162 rollers, 3 sprockets, guide-bar), no recording.
Compilation is timed apart; each case is launched several times and the best counts.
"""

import argparse
import time

import numpy as np
import warp as wp
from bench_cpu import FOREVER, TWO_SPROCKETS

from warpchain import load_drive, loads_drive
from warpchain.arrays import empty_sums, empty_tallies, upload_ensemble, upload_state
from warpchain.ensemble import REAL, Schedule, pack
from warpchain.examples import drive_path
from warpchain.kernels.block import block_kernel

VARIANTS = (1, 132, 1056, 4224, 16896)


def rate(drive, variants: int, precision: str, steps: int, device: str, blocks: int, metrics: bool):
    """Roller-steps a second, and seconds of the first launch (compilation among them)."""
    start = 0 if metrics else FOREVER - 1
    schedule = Schedule(drive.run.step, FOREVER, start, FOREVER, 0)
    one = pack([drive], [schedule])
    packed = repeated(one.at_precision(precision), variants)
    ensemble, state = upload_ensemble(packed, device), upload_state(packed, device)
    sums, tallies = empty_sums(packed, device), empty_tallies(packed, device)
    order = wp.array(np.arange(variants), dtype=wp.int32, device=device)
    frames = wp.zeros(1, dtype=packed.real, device=device)
    threads = -(-drive.chain.links // 32) * 32
    kernel = block_kernel(REAL[precision], threads, len(drive.sprockets), blocks)

    def launch(count: int) -> float:
        wp.synchronize_device(device)
        begin = time.perf_counter()
        inputs = [ensemble, state, sums, tallies, frames, order, count]
        wp.launch(kernel, dim=variants * threads, inputs=inputs, block_dim=threads, device=device)
        wp.synchronize_device(device)
        return time.perf_counter() - begin

    first = launch(64)
    best = min(launch(steps) for _ in range(3))
    rows = state.rollers.numpy()
    if not np.isfinite(rows).all() or state.progress.numpy()["diverged"].any():
        raise SystemExit(f"{variants} variants, {precision}: the run diverged")
    return variants * drive.chain.links * steps / best, first


def repeated(one, variants: int):
    """`one` variant `variants` times over, without assembling each."""
    from dataclasses import replace

    names = ("drives", "chains", "sprockets", "motions", "guides", "rollers", "bodies", "strands", "seat")
    arrays = {name: getattr(one, name) for name in names}
    arrays = {name: values[np.tile(np.arange(len(values)), variants)] for name, values in arrays.items()}
    many = replace(one, assemblies=one.assemblies * variants, **arrays)
    row = one.drives[0]
    n, s, g = int(row["rollers"]), int(row["sprockets"]), int(row["guides"])
    for field, width in (
        ("first_roller", n),
        ("first_sprocket", s),
        ("first_guide", g),
        ("first_contact", n * (s + g)),
        ("first_tally", n * (s + 1)),
    ):
        many.drives[field] = np.arange(variants) * width
    return many


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--drive", default="two", choices=["two", "marine"])
    parser.add_argument("--blocks", default="4")
    parser.add_argument("--metrics", action="store_true")
    parser.add_argument("--only", default=",".join(map(str, VARIANTS)))
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    print(wp.get_device(arguments.device).name)
    drive = loads_drive(TWO_SPROCKETS) if arguments.drive == "two" else load_drive(drive_path("marine"))
    print("precision  blocks  variants  1e9 roller-steps/s   us/step  first launch s")
    for precision in REAL:
        for blocks in map(int, arguments.blocks.split(",")):
            for variants in map(int, arguments.only.split(",")):
                steps = 4000 if variants < 5000 else 2000
                per_second, first = rate(drive, variants, precision, steps, arguments.device, blocks, arguments.metrics)
                step_time = 1e6 * variants * drive.chain.links / per_second
                row = (
                    f"{precision:9s} {blocks:7d} {variants:9d} {per_second / 1e9:19.2f} {step_time:9.3f} {first:15.2f}"
                )
                print(row, flush=True)


if __name__ == "__main__":
    main()
