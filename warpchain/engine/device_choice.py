"""Estimates of a run's time on a device, by a few numbers of it: measured once a machine and stored, or of its class.

With variants of n rollers and w steps each, a CPU whose cores do r roller-steps a second apiece, s times that all at
once, and a GPU that does r when it is full take about

    t_cpu = start + max(most of w n, (sum of w n) / s) / r                                                    (1)
    t_gpu = start + sqrt((l (most of w))^2 + ((sum of w n) / r)^2)                                            (2)

where l is what a step takes of a GPU however few variants there are. (2) is within a fifth of what was measured of 1 to
4,224 variants (docs/devices.md). The drive that is measured stands for others: what makes one slower, such as
friction, does so on either device. Steps inside the window of the metrics count `METRICS` times. Settling is left out:
it takes as much more on either. Where Warp's cache lacks a kernel that a device needs, what it takes to compile comes
on top.
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

from warpchain.engine.compiling import in_cache
from warpchain.files import parse_json, write_text_file
from warpchain.progress import StopRequest
from warpchain.version import installed_version

if TYPE_CHECKING:
    from warpchain.engine.packed import Packed

METRICS = {"cpu": 1.5, "gpu": 1.4}
"""What a step with metrics takes beside one without."""

WORTH_MEASURING = 60.0
"""Estimated seconds from which on it pays to measure, where the answer is not plain from the class."""

PLAIN = 4.0
"""One device that is this many times faster than the next by its class is chosen without measuring."""

ALIKE = 1.05
"""Times that differ by less are taken for equal."""

FILE = "warpchain-devices.json"


@dataclass(frozen=True)
class Speed:
    """The speed of a device at one precision.

    Attributes:
        rate: roller-steps a second, without metrics: of one core of the CPU, or of a GPU that is full.
        latency: what a step takes of a GPU however few variants there are [s].
        start: what it takes to begin [s], kernels once compiled.
        cores: how many times one core's work all cores of the CPU do.
        compiling: what it takes to compile the kernels of a kind of drive, side by side [s].
    """

    rate: float
    latency: float = 0.0
    start: float = 0.0
    cores: float = 1.0
    compiling: float = 0.0

    @property
    def sound(self) -> bool:
        """Whether the numbers can be those of a device."""
        limits = self.rate > 0.0, self.latency >= 0.0, self.start >= 0.0, self.cores > 0.0, self.compiling >= 0.0
        return all(limits) and all(map(math.isfinite, asdict(self).values()))


class Work(NamedTuple):
    """The work of an ensemble, in steps without metrics on some kind of device."""

    total: float  # roller-steps
    longest: float  # roller-steps of the variant that has most
    steps: float  # of the variant that has most


def work_of(packed: Packed, kind: str) -> Work:
    """The work of an ensemble on a "cpu" or "gpu"."""
    drives = packed.drives
    window = np.minimum(drives["window_end"], drives["steps"]) - drives["window_start"] + 1.0
    steps = drives["steps"] + (METRICS[kind] - 1.0) * np.maximum(window, 0.0)
    each = np.add.reduceat(steps * drives["rollers"], packed.begins)
    return Work(float(each.sum()), float(each.max()), float(steps.max()))


def seconds_on(devices: Sequence[str], packed: Packed, cores: int, speed: Speed, times: float = 1.0) -> float:
    """Estimated seconds of the steps of `times` an ensemble: on `cores` threads of the CPU, (1), on some GPUs, (2)."""
    if tuple(devices) == ("cpu",):
        work = work_of(packed, "cpu")
        return speed.start + max(work.longest, times * work.total / min(speed.cores, cores)) / speed.rate
    work = work_of(packed, "gpu")
    return speed.start + math.hypot(speed.latency * work.steps, times * work.total / (speed.rate * len(devices)))


def class_speed(device: str, precision: str, cores: int) -> Speed:
    """The speed of a device of this class, roughly: numbers of docs/performance.md."""
    single = precision == "float32"
    if device == "cpu":
        return Speed(8.0e7, cores=float(cores), compiling=8.0)
    import warp as wp

    gpu = wp.get_device(device)
    full = gpu.arch in (70, 80, 90, 100)  # the others do float64 at 1/64 to 1/32 of float32
    each = (4.0e8 if single else 3.5e8) if full else (2.5e8 if single else 2.5e7)
    latency = 2.0e-6 if full or single else 8.0e-6
    return Speed(each * int(gpu.sm_count), latency=latency, start=0.1, compiling=10.0)


class Choice(NamedTuple):
    """Devices, and why these."""

    devices: tuple[str, ...]
    why: str | None


def quickest(gpus: Sequence[str], packed: Packed, precision: str, cores: int, times: float = 1.0) -> Choice:
    """The CPU, one of some GPUs, or all of them: what `times` an ensemble is estimated to finish on first.

    It is measured what they do where that has not been done on this machine, and pays.
    """
    of_class = {device: class_speed(device, precision, cores) for device in ("cpu", gpus[0])}
    found = _estimates(gpus, packed, cores, of_class.__getitem__, times)
    known = stored(gpus)
    if not known.keys() >= {f"cpu {precision}", f"{gpus[0]} {precision}"}:
        least, next_ = sorted(found.values())[:2]
        if least < WORTH_MEASURING or next_ > PLAIN * least:
            return _described(_with_compiling(found, packed, precision, of_class))
        known = known | measured(gpus, precision, cores)
    speeds = {device: known[f"{device} {precision}"] for device in of_class}
    found = _estimates(gpus, packed, cores, speeds.__getitem__, times)
    return _described(_with_compiling(found, packed, precision, speeds))


def _estimates(
    gpus: Sequence[str], packed: Packed, cores: int, speed_of: Callable[[str], Speed], times: float
) -> dict[tuple[str, ...], float]:
    """Estimated seconds of each choice that there is, the plainest first."""
    choices = dict.fromkeys([("cpu",), (gpus[0],), tuple(gpus)])
    return {devices: seconds_on(devices, packed, cores, speed_of(devices[0]), times) for devices in choices}


def _with_compiling(
    found: Mapping[tuple[str, ...], float], packed: Packed, precision: str, speeds: Mapping[str, Speed]
) -> dict[tuple[str, ...], float]:
    """The seconds of each choice, with what compiling takes on devices whose kernels are not there.

    Only what would be chosen is looked at, as it takes half a second to make the kernels of a device.
    """
    seconds, known = dict(found), set[str]()
    while (device := _best(seconds)[0]) not in known:
        known.add(device)
        if uncompiled(device, packed, precision):
            seconds = {of: t + (speeds[device].compiling if of[0] == device else 0.0) for of, t in seconds.items()}
    return seconds


def uncompiled(device: str, packed: Packed, precision: str) -> bool:
    """Whether a run has to compile kernels first, as Warp's cache does not have them for this device.

    Those that take steps are looked at; settling's is compiled beside them.
    """
    return not all(in_cache(module, device, threads) for module, threads in modules_of(device, packed, precision))


def modules_of(device: str, packed: Packed, precision: str) -> list[tuple[Any, int]]:
    """The modules of the kernels that take steps on a device, and their threads a block."""
    if device == "cpu":
        from warpchain.engine.cpu import kernel_of

        return [(kernel_of("advance", packed, precision).module, 1)]
    from warpchain.engine.buckets import GpuKernels

    return [(of.module, of.threads) for of in GpuKernels(replace(packed, precision=precision), device).wanted()]


def _best(found: Mapping[tuple[str, ...], float]) -> tuple[str, ...]:
    """The choice that takes least; the plainest of those that take about as little."""
    least = ALIKE * min(found.values())
    return next(devices for devices, seconds in found.items() if seconds <= least)


def _described(found: Mapping[tuple[str, ...], float]) -> Choice:
    """The best choice, beside the others."""
    best = _best(found)
    others = [f"{seconds:.2g} s on {','.join(devices)}" for devices, seconds in found.items() if devices != best]
    return Choice(best, f"{found[best]:.2g} s estimated against {' and '.join(others)}")


def machine(gpus: Sequence[str]) -> dict[str, Any]:
    """The machine for which measured numbers hold: processor, its cores, GPUs, and versions."""
    import warp as wp

    from warpchain.engine import start_warp

    start_warp()
    names = [wp.get_device(gpu).name for gpu in gpus]
    return {
        "cpu": processor(),
        "cores": os.cpu_count(),
        "gpus": names,
        "warpchain": installed_version(),
        "warp": wp.__version__,
    }


def processor() -> str:
    """The processor's name."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
            return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def store() -> Path:
    """Where measured numbers are kept: where Warp keeps its kernels."""
    import warp as wp

    from warpchain.engine import start_warp

    start_warp()
    return Path(str(wp.config.kernel_cache_dir)) / FILE


def stored(gpus: Sequence[str]) -> dict[str, Speed]:
    """The speeds measured on this machine, by "DEVICE PRECISION"; empty where none were, or on another machine."""
    try:
        held = parse_json(store().read_text(encoding="utf-8"))
        if held["machine"] != machine(gpus):
            return {}
        speeds = {name: Speed(**values) for name, values in held["speeds"].items()}
        return speeds if all(speed.sound for speed in speeds.values()) else {}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def measured(gpus: Sequence[str], precision: str, cores: int) -> dict[str, Speed]:
    """Measures the CPU and the first of some GPUs, and stores what is found beside what was.

    A device that refuses, such as a CPU without a compiler for it, keeps the numbers of its class.
    """
    found = {}
    for device in ("cpu", *gpus[:1]):
        try:
            speed = measured_cpu(precision, cores) if device == "cpu" else measured_gpu(device, precision, cores)
        except Exception:  # of whatever kind: Warp raises it bare where a compiler fails
            speed = class_speed(device, precision, cores)
        found[f"{device} {precision}"] = speed
    held = {name: asdict(speed) for name, speed in (stored(gpus) | found).items()}
    text = json.dumps({"machine": machine(gpus), "speeds": held}, indent=1)
    with contextlib.suppress(OSError):  # then it is measured anew the next time that it pays
        write_text_file(store(), text)
    return found


def measured_cpu(precision: str, cores: int) -> Speed:
    """Measure the CPU for half a second of an example drive: one variant on one core, and several on each."""
    from warpchain.engine.cpu import CpuEngine

    compiling = _compile_seconds("cpu", precision, cores)
    one = _rate(lambda: CpuEngine(_sample(precision, 1), 1))
    every = _rate(lambda: CpuEngine(_sample(precision, 8 * cores), cores)) if cores > 1 else one
    return Speed(one.rate, cores=max(1.0, every.rate / one.rate), compiling=compiling)


def measured_gpu(device: str, precision: str, cores: int) -> Speed:
    """Measure a GPU for a second of an example drive: one variant, and many."""
    import warp as wp

    from warpchain.engine.gpu import GpuEngine

    many = 32 * int(wp.get_device(device).sm_count)
    compiling = _compile_seconds(device, precision, cores)
    alone = _rate(lambda: GpuEngine(_sample(precision, 1), device))
    full = _rate(lambda: GpuEngine(_sample(precision, many), device))
    rollers = float(_sample(precision, 1).drives["rollers"][0])
    return Speed(full.rate, latency=rollers / alone.rate, start=BEGINNING + alone.start, compiling=compiling)


def _compile_seconds(device: str, precision: str, cores: int) -> float:
    """Seconds to compile the kernel of one variant; where it is in the cache, those of the device's class."""
    import warp as wp

    packed = _sample(precision, 1)
    if not uncompiled(device, packed, precision):
        return class_speed(device, precision, 1).compiling
    begin = time.perf_counter()
    if device != "cpu":
        from warpchain.engine.gpu import compile_lacking

        compile_lacking(device, packed, precision, False, cores, lambda *_: None, StopRequest())
    for module, threads in modules_of(device, packed, precision):
        wp.load_module(module, device=device, block_dim=threads)
    return time.perf_counter() - begin


class _Rate(NamedTuple):
    rate: float  # roller-steps a second
    start: float  # what it took to make the engine [s]


BEGINNING = 0.05
"""Seconds that a run on a GPU takes besides memory and steps: loading its kernels, settling's memory, sums."""

LEAST, TRIES = 0.06, 4
"""Seconds that a rate is taken over, and how often; the best counts, as others may be using the machine."""


def _rate(make: Callable[[], Any]) -> _Rate:
    """Measure an engine, its kernel once loaded."""
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
        while seconds < LEAST:
            steps *= 4
            seconds = run(steps)
        seconds = min(seconds, *(run(steps) for _ in range(TRIES - 1)))
        return _Rate(float(engine.packed.drives["rollers"].sum()) * steps / seconds, start)
    finally:
        engine.close()


def _sample(precision: str, variants: int) -> Packed:
    """So many variants of an example drive, which run without end and without metrics."""
    from warpchain.assembly.timestep import resolve_step
    from warpchain.drive import load_drive
    from warpchain.drive.examples import drive_path
    from warpchain.engine.pack import pack
    from warpchain.results.schedule import MOST_STEPS, Schedule

    drive = load_drive(drive_path("industrial"))
    schedule = Schedule(resolve_step(drive), MOST_STEPS, MOST_STEPS, MOST_STEPS, 0)
    return pack([drive], [schedule]).at_precision(precision).taken([0] * variants)
