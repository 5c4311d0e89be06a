"""Devices by name, and engines on them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from warpchain.engine import start_warp
from warpchain.engine.arrays import Engine
from warpchain.engine.device_choice import Choice, quickest
from warpchain.engine.packed import Packed
from warpchain.errors import SimulationError
from warpchain.progress import ProgressReport, StopRequest


def chosen_devices(device: str | None, packed: Packed) -> tuple[str, ...]:
    """The devices that `device` names: "cpu", "cuda" for all GPUs, "cuda:1" for one, None for GPUs or else the CPU.

    Raises:
        SimulationError: for an unknown name, no such GPU, one that is too old, or an ensemble that a GPU cannot run.
    """
    if device == "cpu":
        return ("cpu",)
    if device is not None and device != "cuda" and not (device.startswith("cuda:") and device[5:].isdigit()):
        raise SimulationError(f'device = {device!r}: allowed are "cpu", "cuda" (all GPUs), "cuda:0" (one)')
    names, usable = _gpus(), usable_gpus()
    if device is None and not usable:
        return ("cpu",)
    from warpchain.engine.gpu import OLDEST, refusal

    reason = refusal(packed)
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
        if names[name] < OLDEST:
            raise SimulationError(
                f"device {name}: compute capability {names[name] / 10:g} is too old, {OLDEST / 10:g} is needed; "
                'use device="cpu"'
            )
    if reason is not None:
        raise SimulationError(reason)
    return wanted


def usable_gpus() -> tuple[str, ...]:
    """The GPUs that are here and new enough."""
    names = _gpus()
    if not names:
        return ()
    from warpchain.engine.gpu import OLDEST

    return tuple(name for name, arch in names.items() if arch >= OLDEST)


def gpus_named(device: str | None) -> tuple[str, ...]:
    """The GPUs that `device` may come to (None: all that are here), () for none and for what is no GPU here."""
    if device == "cpu":
        return ()
    gpus = usable_gpus()
    return gpus if device in (None, "cuda") else tuple(gpu for gpu in gpus if gpu == device)


def devices_for(
    device: str | None, packed: Packed, precision: str, cores: int, count: int, times: float = 1.0
) -> Choice:
    """The devices that an ensemble runs on: those that `device` names; for None those expected to finish first.

    Args:
        device: as the user names it.
        packed: the ensemble, or a part of it.
        precision: of the run.
        cores: CPU threads.
        count: number of variants, of which each takes one device.
        times: how many times the work of `packed` there is in all.

    Raises:
        SimulationError: as `chosen_devices`.
    """
    devices = chosen_devices(device, packed)[:count]
    if device is not None or devices == ("cpu",):
        return Choice(devices, None)
    return quickest(devices, packed, precision, cores, times)


def _gpus() -> dict[str, int]:
    """The GPUs that Warp sees, with their architectures."""
    import warp as wp

    start_warp()
    if not wp.is_cuda_available():
        return {}
    return {str(gpu): int(gpu.arch) for gpu in wp.get_cuda_devices()}


def engine_on(device: str, packed: Packed, cores: int) -> Engine:
    """An engine for the ensemble on a device.

    Args:
        device: "cpu" or such as "cuda:0".
        packed: the ensemble.
        cores: CPU threads, where the device is the CPU.
    """
    if device == "cpu":
        from warpchain.engine.cpu import CpuEngine

        return CpuEngine(packed, cores)
    from warpchain.engine.gpu import GpuEngine

    return GpuEngine(packed, device)


@contextmanager
def loading(
    device: str, packed: Packed, precision: str, settles: bool, cores: int, report: ProgressReport, stop: StopRequest
) -> Iterator[None]:
    """Sees to the kernels of a run before what stands within, settling; where nothing is cached, side by side.

    Those of GPUs are compiled before it. The CPU's kernel of steps is loaded while it is done with another one.

    Args:
        device, packed, cores: as in `engine_on`.
        precision: of the steps.
        settles: whether any variant is to be settled.
        report, stop: of the run.
    """
    if device != "cpu":
        from warpchain.engine.gpu import compile_lacking

        compile_lacking(device, packed, precision, settles, cores, report, stop)
        yield
        return
    from warpchain.engine.compiling import loading_on_cpu
    from warpchain.engine.cpu import kernel_of

    relax = [kernel_of("relax", packed, "float64")] if settles else []
    with loading_on_cpu([kernel.module for kernel in (*relax, kernel_of("advance", packed, precision))], report):
        yield


def launch_steps(device: str, packed: Packed, wanted: int) -> int:
    """Steps of a launch on a device, `wanted` at most.

    On the CPU whole rounds of `MERGE_EVERY` where they fit: at a launch's end sums are merged, so that how a run is
    cut into launches does not change them in their last digits.
    """
    if device == "cpu":
        from warpchain.kernels.sums import MERGE_EVERY

        every = int(MERGE_EVERY)
        return wanted // every * every or wanted
    from warpchain.engine.gpu import launch_steps as on_gpu

    return on_gpu(float(packed.drives["rollers"].sum()), wanted)


def frame_bytes(device: str) -> int | None:
    """Most bytes that the frames of one launch are to take, None for as many as the memory budget gives."""
    if device == "cpu":
        return None
    from warpchain.engine.gpu import FRAME_BYTES

    return FRAME_BYTES
