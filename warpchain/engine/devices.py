"""Devices by name, and engines, kernels and launch limits on them."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from contextlib import contextmanager

from warpchain.engine import start_warp
from warpchain.engine.arrays import Engine
from warpchain.engine.device_choice import DeviceChoice, fastest_devices
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.errors import SimulationError
from warpchain.progress import ProgressReport, StopRequest


def devices_by_name(device: str | None, packed: PackedEnsemble) -> tuple[str, ...]:
    """Names of devices that "cpu", "cuda" (all GPUs), "cuda:1" or None mean.

    Raises:
        SimulationError: no such device, too old a one, or an ensemble that a GPU cannot run.
    """
    if device == "cpu":
        return ("cpu",)
    if device is not None and device != "cuda" and not (device.startswith("cuda:") and device[5:].isdigit()):
        raise SimulationError(f'device = {device!r}: allowed are "cpu", "cuda" (all GPUs), "cuda:0" (one)')
    names, usable = _gpu_architectures(), usable_gpus()
    if device is None and not usable:
        return ("cpu",)
    from warpchain.engine.gpu import OLDEST_ARCHITECTURE, gpu_refusal

    reason = gpu_refusal(packed)
    if device is None:
        return usable if reason is None else ("cpu",)
    if not names:
        raise SimulationError(
            f"device = {device!r}: no NVIDIA GPU with a driver is here (see nvidia-smi); install the driver, "
            'or use device="cpu"'
        )
    wanted = tuple(names) if device == "cuda" else (device,)
    for name in wanted:
        if name not in names:
            raise SimulationError(f"device = {device!r}: there is no such GPU; there are {', '.join(names)}")
        if names[name] < OLDEST_ARCHITECTURE:
            raise SimulationError(
                f"device {name}: compute capability {names[name] / 10:g} is too old, {OLDEST_ARCHITECTURE / 10:g} is "
                'needed; use device="cpu"'
            )
    if reason is not None:
        raise SimulationError(reason)
    return wanted


def processor_name() -> str:
    """Name of the machine's processor."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
            return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def usable_gpus() -> tuple[str, ...]:
    """Names of this machine's GPUs that are new enough."""
    names = _gpu_architectures()
    if not names:
        return ()
    from warpchain.engine.gpu import OLDEST_ARCHITECTURE

    return tuple(name for name, arch in names.items() if arch >= OLDEST_ARCHITECTURE)


def gpus_by_name(device: str | None) -> tuple[str, ...]:
    """Names of GPUs that `device` can mean, or ()."""
    if device == "cpu":
        return ()
    gpus = usable_gpus()
    return gpus if device in (None, "cuda") else tuple(gpu for gpu in gpus if gpu == device)


def choose_devices(
    device: str | None, packed: PackedEnsemble, precision: str, cores: int, count: int, times: float = 1.0
) -> DeviceChoice:
    """Choice of devices by name, for None the fastest.

    Args:
        packed: the ensemble, or a part of it.
        count: of variants, each on one device.
        times: work of the run over that of `packed`.

    Raises:
        SimulationError: as `devices_by_name`.
    """
    devices = devices_by_name(device, packed)[:count]
    if device is not None or devices == ("cpu",):
        return DeviceChoice(devices, None)
    return fastest_devices(devices, packed, precision, cores, times)


def _gpu_architectures() -> dict[str, int]:
    """Architectures (capability times ten) of GPUs by name."""
    import warp as wp

    start_warp()
    if not wp.is_cuda_available():
        return {}
    return {str(gpu): int(gpu.arch) for gpu in wp.get_cuda_devices()}


def make_engine(device: str, packed: PackedEnsemble, cores: int) -> Engine:
    """Engine for an ensemble on a device."""
    if device == "cpu":
        from warpchain.engine.cpu import CpuEngine

        return CpuEngine(packed, cores)
    from warpchain.engine.gpu import GpuEngine

    return GpuEngine(packed, device)


@contextmanager
def load_run_kernels(
    device: str,
    packed: PackedEnsemble,
    precision: str,
    settles: bool,
    cores: int,
    report: ProgressReport,
    stop: StopRequest,
) -> Iterator[None]:
    """Context that compiles and loads a run's kernels, those that settle if it `settles`."""
    if device != "cpu":
        from warpchain.engine.gpu import compile_missing_kernels

        compile_missing_kernels(device, packed, precision, settles, cores, report, stop)
        yield
        return
    from warpchain.engine.compilation import load_cpu_kernels
    from warpchain.engine.cpu import cpu_kernel

    relax = [cpu_kernel("relax", packed, "float64")] if settles else []
    with load_cpu_kernels([kernel.module for kernel in (*relax, cpu_kernel("advance", packed, precision))], report):
        yield


def launch_step_limit(device: str, packed: PackedEnsemble, wanted: int) -> int:
    """Most steps of a device's launch, up to `wanted`."""
    if device == "cpu":
        from warpchain.kernels.sums import MERGE_EVERY

        every = int(MERGE_EVERY)
        return wanted // every * every or wanted
    from warpchain.engine.gpu import gpu_launch_steps as on_gpu

    return on_gpu(float(packed.drives["rollers"].sum()), wanted)


def launch_frame_bytes(device: str) -> int | None:
    """Most bytes of frames of a device's launch, or None."""
    if device == "cpu":
        return None
    from warpchain.engine.gpu import FRAME_BYTES

    return FRAME_BYTES
