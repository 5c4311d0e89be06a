"""GPU benchmark of the block kernel's bare time loop: 1e9 roller-steps a second, by precision and variants.

    python scripts/bench_gpu.py [--device cuda:0]

Two equal 30-tooth sprockets, 118 rollers, no recording. Compilation is timed apart; each case is launched several times
and the best counts.
"""

import argparse
import time

import numpy as np
import warp as wp
from bench_cpu import FOREVER, TWO_SPROCKETS

from warpchain import loads_drive
from warpchain.arrays import upload_ensemble, upload_state
from warpchain.ensemble import REAL, Schedule, pack
from warpchain.kernels.block import block_kernel

VARIANTS = (1, 132, 1056, 4224, 16896)


def rate(drive, variants: int, precision: str, steps: int, device: str) -> tuple[float, float]:
    """Roller-steps a second, and seconds of the first launch (compilation among them)."""
    schedule = Schedule(5e-6, FOREVER, FOREVER - 1, FOREVER, 0)
    packed = pack([drive] * variants, [schedule] * variants).at_precision(precision)
    ensemble, state = upload_ensemble(packed, device), upload_state(packed, device)
    order = wp.array(np.arange(variants), dtype=wp.int32, device=device)
    threads = -(-drive.chain.links // 32) * 32
    kernel = block_kernel(REAL[precision], threads, len(drive.sprockets), len(drive.guides))

    def launch(count: int) -> float:
        wp.synchronize_device(device)
        begin = time.perf_counter()
        inputs = [ensemble, state, order, count]
        wp.launch(kernel, dim=variants * threads, inputs=inputs, block_dim=threads, device=device)
        wp.synchronize_device(device)
        return time.perf_counter() - begin

    first = launch(64)
    best = min(launch(steps) for _ in range(3))
    rows = state.rollers.numpy()
    if not np.isfinite(rows).all():
        raise SystemExit(f"{variants} variants, {precision}: the state is not finite")
    return variants * drive.chain.links * steps / best, first


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0")
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    print(wp.get_device(arguments.device).name)
    drive = loads_drive(TWO_SPROCKETS)
    print(f"{'precision':10s} {'variants':>9s} {'Groller-steps/s':>16s} {'us/step':>9s} {'first launch s':>15s}")
    for precision in REAL:
        for variants in VARIANTS:
            steps = 4000 if variants < 5000 else 2000
            per_second, first = rate(drive, variants, precision, steps, arguments.device)
            step_time = 1e6 * variants * drive.chain.links / per_second
            print(f"{precision:10s} {variants:9d} {per_second / 1e9:16.2f} {step_time:9.3f} {first:15.2f}")


if __name__ == "__main__":
    main()
