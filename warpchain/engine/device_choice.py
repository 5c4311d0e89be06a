"""Device choice between the CPU, a GPU and all GPUs, by estimated times (docs/devices.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warpchain.engine.compilation import is_cached
from warpchain.results.channels import WHOLE_FRAME

if TYPE_CHECKING:
    from warpchain.engine.packed_ensemble import PackedEnsemble

CORE_RATE = 8e7
"""Roller-steps a second of a core (docs/performance.md)."""
GPU_START = 0.1
"""Seconds until a GPU begins."""
METRICS_FACTOR = 1.5
COMPILE_SECONDS = {"cpu": 8.0, "gpu": 10.0}
EQUAL_WITHIN = 1.05
"""Factor within which estimated times are equal."""


class DeviceChoice(NamedTuple):
    """Devices chosen for a run, and the reason."""

    devices: tuple[str, ...]
    why: str | None


def fastest_devices(
    gpus: Sequence[str], packed: PackedEnsemble, precision: str, cores: int, times: float = 1.0
) -> DeviceChoice:
    """CPU or GPUs estimated to finish first; within `EQUAL_WITHIN` the fewest."""
    choices = dict.fromkeys([("cpu",), (gpus[0],), tuple(gpus)])
    found = {devices: estimated_seconds(devices, packed, precision, cores, times) for devices in choices}
    asked = set[str]()
    while True:
        best = next(devices for devices, seconds in found.items() if seconds <= EQUAL_WITHIN * min(found.values()))
        if best[0] in asked:
            break
        asked.add(best[0])
        if has_uncompiled_kernels(best[0], packed, precision):
            more = COMPILE_SECONDS["cpu" if best == ("cpu",) else "gpu"]
            found = {devices: seconds + more * (devices[0] == best[0]) for devices, seconds in found.items()}
    others = [f"{seconds:.2g} s on {','.join(devices)}" for devices, seconds in found.items() if devices != best]
    return DeviceChoice(best, f"{found[best]:.2g} s estimated against {' and '.join(others)}")


def estimated_seconds(
    devices: Sequence[str], packed: PackedEnsemble, precision: str, cores: int, times: float = 1.0
) -> float:
    """Estimated time [s] of steps on devices (docs/devices.md)."""
    drives = packed.drives
    window = np.minimum(drives["window_end"], drives["steps"]) - drives["window_start"] + 1.0
    steps = drives["steps"] + (METRICS_FACTOR - 1.0) * np.maximum(window, 0.0)
    work = np.add.reduceat(steps * drives["rollers"], packed.first_rows)
    if tuple(devices) == ("cpu",):
        return float(max(work.max(), times * work.sum() / cores)) / CORE_RATE
    rate, latency = gpu_speed(devices[0], precision)
    return GPU_START + math.hypot(latency * float(steps.max()), times * float(work.sum()) / (rate * len(devices)))


def gpu_speed(device: str, precision: str) -> tuple[float, float]:
    """Roller-steps a second of a full GPU, and a small step's time [s]."""
    import warp as wp

    gpu, single = wp.get_device(device), precision == "float32"
    full = gpu.arch in (70, 80, 90, 100)  # the others do float64 at 1/64 to 1/32 of float32
    each = (4.0e8 if single else 3.5e8) if full else (2.5e8 if single else 2.5e7)
    return each * int(gpu.sm_count), 2.0e-6 if full or single else 8.0e-6


def has_uncompiled_kernels(device: str, packed: PackedEnsemble, precision: str) -> bool:
    """Whether a run's kernels on a device need compiling."""
    if device == "cpu":
        from warpchain.engine.cpu import cpu_kernel

        whole = replace(packed, frame=WHOLE_FRAME)  # as runs on the CPU have it
        return not is_cached(cpu_kernel("advance", whole, precision).module, device, 1)
    from warpchain.engine.gpu_kernels import GpuKernels

    kernels = GpuKernels(replace(packed, precision=precision), device).kernel_specs()
    return not all(is_cached(of.module, device, of.threads) for of in kernels)
