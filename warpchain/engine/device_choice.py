"""Estimates how long a run takes on each device, from speeds measured on this machine or those of its class.

For variants of n rollers and w steps each, a CPU whose cores do r roller-steps a second, s times that all at once, and
a GPU that does r when it is full take about

    t_cpu = start + max(most of w n, (sum of w n) / s) / r                                                    (1)
    t_gpu = start + sqrt((l (most of w))^2 + ((sum of w n) / r)^2)                                            (2)

where l is the time of a step of few variants. (2) is within a fifth of what was measured of 1 to 4,224 variants
(docs/devices.md). Steps within the window of metrics count `METRICS_FACTOR` times. Settling is left out. Kernels that
Warp's cache lacks add the time to compile them.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from warpchain.engine.compilation import is_cached
from warpchain.files import parse_json, write_text_file
from warpchain.progress import StopRequest
from warpchain.version import installed_version

if TYPE_CHECKING:
    from warpchain.engine.packed_ensemble import PackedEnsemble

METRICS_FACTOR = {"cpu": 1.5, "gpu": 1.4}
"""Time of a step with metrics over one without."""

WORTH_MEASURING = 60.0
"""Estimated seconds of a run from which it pays to measure, unless one device is clearly faster."""

CLEAR_ADVANTAGE = 4.0
"""One device that is this many times faster than the next by its class is chosen without measuring."""

EQUAL_WITHIN = 1.05
"""Times that differ by less than this factor are taken for equal."""

SPEEDS_FILE_NAME = "warpchain-devices.json"


@dataclass(frozen=True)
class DeviceSpeed:
    """The speed of a device at one precision.

    Attributes:
        rate: roller-steps a second, without metrics: of one core of the CPU, or of a GPU that is full.
        latency: time of a step of a GPU with few variants [s].
        start: time to begin, kernels compiled [s].
        cores: work of all cores of the CPU at once over one core's.
        compile_seconds: time to compile the kernels of a drive, side by side [s].
    """

    rate: float
    latency: float = 0.0
    start: float = 0.0
    cores: float = 1.0
    compile_seconds: float = 0.0

    @property
    def is_plausible(self) -> bool:
        """Whether the numbers can be those of a device."""
        limits = self.rate > 0.0, self.latency >= 0.0, self.start >= 0.0, self.cores > 0.0, self.compile_seconds >= 0.0
        return all(limits) and all(map(math.isfinite, asdict(self).values()))


class EnsembleWork(NamedTuple):
    """The work of an ensemble, in steps without metrics on some kind of device."""

    total: float  # roller-steps
    longest: float  # roller-steps of the variant that has most
    steps: float  # of the variant that has most


def ensemble_work(packed: PackedEnsemble, kind: str) -> EnsembleWork:
    """The work of an ensemble on a "cpu" or "gpu"."""
    drives = packed.drives
    window = np.minimum(drives["window_end"], drives["steps"]) - drives["window_start"] + 1.0
    steps = drives["steps"] + (METRICS_FACTOR[kind] - 1.0) * np.maximum(window, 0.0)
    each = np.add.reduceat(steps * drives["rollers"], packed.first_rows)
    return EnsembleWork(float(each.sum()), float(each.max()), float(steps.max()))


def estimated_seconds(
    devices: Sequence[str], packed: PackedEnsemble, cores: int, speed: DeviceSpeed, times: float = 1.0
) -> float:
    """Estimated seconds of the steps of `times` an ensemble, on `cores` threads of the CPU, (1), or on GPUs, (2)."""
    if tuple(devices) == ("cpu",):
        work = ensemble_work(packed, "cpu")
        return speed.start + max(work.longest, times * work.total / min(speed.cores, cores)) / speed.rate
    work = ensemble_work(packed, "gpu")
    return speed.start + math.hypot(speed.latency * work.steps, times * work.total / (speed.rate * len(devices)))


def class_speed(device: str, precision: str, cores: int) -> DeviceSpeed:
    """The rough speed of a device's class: numbers of docs/performance.md."""
    single = precision == "float32"
    if device == "cpu":
        return DeviceSpeed(8.0e7, cores=float(cores), compile_seconds=8.0)
    import warp as wp

    gpu = wp.get_device(device)
    full = gpu.arch in (70, 80, 90, 100)  # the others do float64 at 1/64 to 1/32 of float32
    each = (4.0e8 if single else 3.5e8) if full else (2.5e8 if single else 2.5e7)
    latency = 2.0e-6 if full or single else 8.0e-6
    return DeviceSpeed(each * int(gpu.sm_count), latency=latency, start=0.1, compile_seconds=10.0)


class DeviceChoice(NamedTuple):
    """Devices for a run, and the reason."""

    devices: tuple[str, ...]
    why: str | None


def fastest_devices(
    gpus: Sequence[str], packed: PackedEnsemble, precision: str, cores: int, times: float = 1.0
) -> DeviceChoice:
    """The CPU, one of some GPUs, or all of them: what is estimated to finish `times` an ensemble first.

    Devices that have not been measured on this machine are measured where that pays.
    """
    of_class = {device: class_speed(device, precision, cores) for device in ("cpu", gpus[0])}
    found = _seconds_by_choice(gpus, packed, cores, of_class.__getitem__, times)
    known = stored_speeds(gpus)
    if not known.keys() >= {f"cpu {precision}", f"{gpus[0]} {precision}"}:
        least, next_ = sorted(found.values())[:2]
        if least < WORTH_MEASURING or next_ > CLEAR_ADVANTAGE * least:
            return _choice_with_reason(_seconds_with_compilation(found, packed, precision, of_class))
        known = known | measure_speeds(gpus, precision, cores)
    speeds = {device: known[f"{device} {precision}"] for device in of_class}
    found = _seconds_by_choice(gpus, packed, cores, speeds.__getitem__, times)
    return _choice_with_reason(_seconds_with_compilation(found, packed, precision, speeds))


def _seconds_by_choice(
    gpus: Sequence[str], packed: PackedEnsemble, cores: int, speed_of: Callable[[str], DeviceSpeed], times: float
) -> dict[tuple[str, ...], float]:
    """Estimated seconds of each choice of devices, the plainest first."""
    choices = dict.fromkeys([("cpu",), (gpus[0],), tuple(gpus)])
    return {devices: estimated_seconds(devices, packed, cores, speed_of(devices[0]), times) for devices in choices}


def _seconds_with_compilation(
    found: Mapping[tuple[str, ...], float], packed: PackedEnsemble, precision: str, speeds: Mapping[str, DeviceSpeed]
) -> dict[tuple[str, ...], float]:
    """The seconds of each choice, with the time to compile on those devices that would be chosen and lack kernels."""
    seconds, known = dict(found), set[str]()
    while (device := _fastest_choice(seconds)[0]) not in known:
        known.add(device)
        if has_uncompiled_kernels(device, packed, precision):
            seconds = {
                of: t + (speeds[device].compile_seconds if of[0] == device else 0.0) for of, t in seconds.items()
            }
    return seconds


def has_uncompiled_kernels(device: str, packed: PackedEnsemble, precision: str) -> bool:
    """Whether Warp's cache lacks a kernel that takes the steps of a run on this device."""
    return not all(is_cached(module, device, threads) for module, threads in kernel_modules(device, packed, precision))


def kernel_modules(device: str, packed: PackedEnsemble, precision: str) -> list[tuple[Any, int]]:
    """The modules of the kernels that take steps on a device, and their threads a block."""
    if device == "cpu":
        from warpchain.engine.cpu import cpu_kernel

        return [(cpu_kernel("advance", packed, precision).module, 1)]
    from warpchain.engine.gpu_kernels import GpuKernels

    return [(of.module, of.threads) for of in GpuKernels(replace(packed, precision=precision), device).kernel_specs()]


def _fastest_choice(found: Mapping[tuple[str, ...], float]) -> tuple[str, ...]:
    """The choice that takes least time; of those within `EQUAL_WITHIN` the plainest."""
    least = EQUAL_WITHIN * min(found.values())
    return next(devices for devices, seconds in found.items() if seconds <= least)


def _choice_with_reason(found: Mapping[tuple[str, ...], float]) -> DeviceChoice:
    """The fastest choice, with the estimates of all as the reason."""
    best = _fastest_choice(found)
    others = [f"{seconds:.2g} s on {','.join(devices)}" for devices, seconds in found.items() if devices != best]
    return DeviceChoice(best, f"{found[best]:.2g} s estimated against {' and '.join(others)}")


def machine_facts(gpus: Sequence[str]) -> dict[str, Any]:
    """The machine for which measured speeds hold: processor, its cores, GPUs, and versions."""
    import warp as wp

    from warpchain.engine import start_warp

    start_warp()
    names = [wp.get_device(gpu).name for gpu in gpus]
    return {
        "cpu": processor_name(),
        "cores": os.cpu_count(),
        "gpus": names,
        "warpchain": installed_version(),
        "warp": wp.__version__,
    }


def processor_name() -> str:
    """The processor's name."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
            return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def speeds_file() -> Path:
    """File of the measured speeds, beside Warp's kernels."""
    import warp as wp

    from warpchain.engine import start_warp

    start_warp()
    return Path(str(wp.config.kernel_cache_dir)) / SPEEDS_FILE_NAME


def stored_speeds(gpus: Sequence[str]) -> dict[str, DeviceSpeed]:
    """The speeds measured on this machine, by "DEVICE PRECISION"; empty where none were, or on another machine."""
    try:
        held = parse_json(speeds_file().read_text(encoding="utf-8"))
        if held["machine"] != machine_facts(gpus):
            return {}
        speeds = {name: DeviceSpeed(**values) for name, values in held["speeds"].items()}
        return speeds if all(speed.is_plausible for speed in speeds.values()) else {}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def measure_speeds(gpus: Sequence[str], precision: str, cores: int) -> dict[str, DeviceSpeed]:
    """Measures the CPU and the first of some GPUs, and stores the speeds.

    A device that fails keeps the speed of its class.
    """
    found = {}
    for device in ("cpu", *gpus[:1]):
        try:
            speed = measure_cpu(precision, cores) if device == "cpu" else measure_gpu(device, precision, cores)
        except Exception:  # of whatever kind: Warp raises it bare where a compiler fails
            speed = class_speed(device, precision, cores)
        found[f"{device} {precision}"] = speed
    held = {name: asdict(speed) for name, speed in (stored_speeds(gpus) | found).items()}
    text = json.dumps({"machine": machine_facts(gpus), "speeds": held}, indent=1)
    with contextlib.suppress(OSError):  # then it is measured anew the next time that it pays
        write_text_file(speeds_file(), text)
    return found


def measure_cpu(precision: str, cores: int) -> DeviceSpeed:
    """Measures the CPU with an example drive: one variant on one core, and several on each."""
    from warpchain.engine.cpu import CpuEngine

    compiling = _compile_seconds("cpu", precision, cores)
    one = _measure_rate(lambda: CpuEngine(_example_ensemble(precision, 1), 1))
    every = _measure_rate(lambda: CpuEngine(_example_ensemble(precision, 8 * cores), cores)) if cores > 1 else one
    return DeviceSpeed(one.rate, cores=max(1.0, every.rate / one.rate), compile_seconds=compiling)


def measure_gpu(device: str, precision: str, cores: int) -> DeviceSpeed:
    """Measures a GPU with an example drive: one variant, and many."""
    import warp as wp

    from warpchain.engine.gpu import GpuEngine

    many = 32 * int(wp.get_device(device).sm_count)
    compiling = _compile_seconds(device, precision, cores)
    alone = _measure_rate(lambda: GpuEngine(_example_ensemble(precision, 1), device))
    full = _measure_rate(lambda: GpuEngine(_example_ensemble(precision, many), device))
    rollers = float(_example_ensemble(precision, 1).drives["rollers"][0])
    return DeviceSpeed(
        full.rate, latency=rollers / alone.rate, start=GPU_START_SECONDS + alone.start, compile_seconds=compiling
    )


def _compile_seconds(device: str, precision: str, cores: int) -> float:
    """Seconds to compile the kernel of one variant; where it is in the cache, those of the device's class."""
    import warp as wp

    packed = _example_ensemble(precision, 1)
    if not has_uncompiled_kernels(device, packed, precision):
        return class_speed(device, precision, 1).compile_seconds
    begin = time.perf_counter()
    if device != "cpu":
        from warpchain.engine.gpu import compile_missing_kernels

        compile_missing_kernels(device, packed, precision, False, cores, lambda *_: None, StopRequest())
    for module, threads in kernel_modules(device, packed, precision):
        wp.load_module(module, device=device, block_dim=threads)
    return time.perf_counter() - begin


class _EngineRate(NamedTuple):
    rate: float  # roller-steps a second
    start: float  # what it took to make the engine [s]


GPU_START_SECONDS = 0.05
"""Seconds that a run on a GPU takes besides memory and steps: loading its kernels, settling's memory, sums."""

RATE_SECONDS, RATE_TRIES = 0.06, 4
"""Seconds over which a rate is measured, and how often; the best counts, as others may be using the machine."""


def _measure_rate(make: Callable[[], Any]) -> _EngineRate:
    """Measures an engine, its kernel loaded before."""
    make().close()  # streams, pools and contexts are there now
    begin = time.perf_counter()
    engine = make()
    start = time.perf_counter() - begin
    frames = engine.frame_buffer(0)

    def run(steps: int) -> float:
        begin = time.perf_counter()
        for future in engine.advance(steps, frames):
            future.result()
        return time.perf_counter() - begin

    try:
        run(64)
        steps, seconds = 128, 0.0
        while seconds < RATE_SECONDS:
            steps *= 4
            seconds = run(steps)
        seconds = min(seconds, *(run(steps) for _ in range(RATE_TRIES - 1)))
        return _EngineRate(float(engine.packed.drives["rollers"].sum()) * steps / seconds, start)
    finally:
        engine.close()


def _example_ensemble(precision: str, variants: int) -> PackedEnsemble:
    """So many variants of an example drive, which run without end and without metrics."""
    from warpchain.assembly.timestep import resolve_step
    from warpchain.drive import load_drive
    from warpchain.drive.examples import drive_path
    from warpchain.engine.pack import pack
    from warpchain.results.schedule import MOST_STEPS, Schedule

    drive = load_drive(drive_path("industrial"))
    schedule = Schedule(resolve_step(drive), MOST_STEPS, MOST_STEPS, MOST_STEPS, 0)
    return pack([drive], [schedule]).at_precision(precision).pick_variants([0] * variants)
