"""Devices by name, and an ensemble spread over several of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine import start_warp
from warpchain.engine.arrays import TABLE, Engine, starts
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


def devices_for(device: str | None, packed: Packed, precision: str, cores: int, times: float = 1.0) -> Choice:
    """The devices that an ensemble runs on: those that `device` names; for None those expected to finish first.

    Args:
        device: as the user names it.
        packed: the ensemble, or a part of it.
        precision: of the run.
        cores: CPU threads.
        times: how many times the work of `packed` there is in all.

    Raises:
        SimulationError: as `chosen_devices`.
    """
    devices = chosen_devices(device, packed)[: len(packed.begins)]
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


def engine_on(devices: Sequence[str], packed: Packed, cores: int) -> Engine:
    """An engine for the ensemble on these devices.

    Args:
        devices: as from `chosen_devices`.
        packed: the ensemble.
        cores: CPU threads, where the device is the CPU.
    """
    if tuple(devices) == ("cpu",):
        from warpchain.engine.cpu import CpuEngine

        return CpuEngine(packed, cores)
    from warpchain.engine.gpu import GpuEngine

    parts = _cut(devices, packed)
    if len(parts) == 1:
        return GpuEngine(packed, parts[0][0])
    return SeveralEngines(packed, parts, GpuEngine)


def _cut(devices: Sequence[str], packed: Packed) -> list[tuple[str, int, int]]:
    """GPUs, each with the first row of its variants and the one after the last, of about the same work."""
    work = np.add.reduceat(packed.drives["rollers"] * (packed.drives["steps"] + 1.0), packed.begins)
    cuts = np.append(packed.begins, packed.variants)[cuts_of(work, len(devices))].tolist()
    return [(name, a, b) for name, a, b in zip(devices, cuts[:-1], cuts[1:], strict=True) if b > a]


@contextmanager
def loading(
    devices: Sequence[str],
    packed: Packed,
    precision: str,
    settles: bool,
    cores: int,
    report: ProgressReport,
    stop: StopRequest,
) -> Iterator[None]:
    """Sees to the kernels of a run before what stands within, settling; where nothing is cached, side by side.

    Those of GPUs are compiled before it. The CPU's kernel of steps is loaded while it is done with another one.

    Args:
        devices, packed, cores: as in `engine_on`.
        precision: of the steps.
        settles: whether any variant is to be settled.
        report, stop: of the run.
    """
    if tuple(devices) != ("cpu",):
        from warpchain.engine.gpu import compile_lacking

        parts = _cut(devices, packed)
        whole = len(parts) == 1
        of_devices = [(name, packed if whole else packed.part(a, b)) for name, a, b in parts]
        compile_lacking(of_devices, precision, settles, cores, report, stop)
        yield
        return
    from warpchain.engine.compiling import loading_on_cpu
    from warpchain.engine.cpu import kernel_of

    relax = [kernel_of("relax", packed, "float64")] if settles else []
    with loading_on_cpu([kernel.module for kernel in (*relax, kernel_of("advance", packed, precision))], report):
        yield


def launch_steps(devices: Sequence[str], packed: Packed, wanted: int) -> int:
    """Steps of a launch on these devices, `wanted` at most.

    On the CPU whole rounds of `MERGE_EVERY` where they fit: at a launch's end sums are merged, so that how a run is
    cut into launches does not change them in their last digits.
    """
    if tuple(devices) == ("cpu",):
        from warpchain.kernels.sums import MERGE_EVERY

        every = int(MERGE_EVERY)
        return wanted // every * every or wanted
    from warpchain.engine.gpu import launch_steps as on_gpu

    return on_gpu(float(packed.drives["rollers"].sum()) / len(devices), wanted)


def frame_bytes(devices: Sequence[str]) -> int | None:
    """Most bytes that the frames of one launch are to take, None for as many as the memory budget gives."""
    if tuple(devices) == ("cpu",):
        return None
    from warpchain.engine.gpu import FRAME_BYTES

    return FRAME_BYTES * len(devices)


def _first_frame(packed: Packed, a: int) -> int | None:
    """Where the frames of variants from `a` on begin in the whole buffer; None if there are none."""
    recorded = np.flatnonzero(packed.drives["sample_every"][a:]) + a
    return int(packed.drives["first_value"][recorded[0]]) if recorded.size else None


def cuts_of(each: NDArray[np.floating], count: int) -> list[int]:
    """Where to cut the row of variants into `count` parts of about the same work; `each` is that of each variant."""
    work = np.cumsum(each)
    inner = np.searchsorted(work, work[-1] * np.arange(1, count) / count, side="left") + 1
    return [0, *np.minimum(inner, len(each)).tolist(), len(each)]


class SeveralBuffers:
    """The parts' buffers of one launch, joined in the host's memory."""

    def __init__(self, buffers: Sequence[Any], firsts: Sequence[int], values: int, real: Any) -> None:
        self.buffers, self.firsts = buffers, firsts
        self.joined = np.empty(values, dtype=real)

    def numpy(self) -> NDArray[np.floating]:
        """All frames."""
        for buffer, first in zip(self.buffers, self.firsts, strict=True):
            if buffer.values:
                self.joined[first : first + buffer.values] = buffer.numpy()[: buffer.values]
        return self.joined


class SeveralEngines(Engine):
    """An ensemble cut into parts, each on an engine of its own; the variants' results are those of one engine."""

    def __init__(
        self, packed: Packed, parts: Sequence[tuple[str, int, int]], make: Callable[[Packed, str], Engine]
    ) -> None:
        self.packed = packed
        self.parts = [packed.part(a, b) for _, a, b in parts]
        self.cuts = [(a, b) for _, a, b in parts]
        self.firsts = [_first_frame(packed, a) for a, _ in self.cuts]
        for part, first in zip(self.parts, self.firsts, strict=True):
            part.drives["first_value"] -= first or 0
        self.engines: list[Engine] = []
        with ThreadPoolExecutor(len(parts)) as pool:  # the parts go to their devices side by side
            made = [pool.submit(make, part, name) for (name, _, _), part in zip(parts, self.parts, strict=True)]
        self.engines = [future.result() for future in made if future.exception() is None]
        if len(self.engines) < len(made):
            self.close()
            for future in made:
                future.result()  # raises
        self.balances = all(engine.balances for engine in self.engines)

    def advance(self, steps: int | NDArray[np.integer], frames: SeveralBuffers) -> list[Future[None]]:
        each = [steps if isinstance(steps, int) else steps[a:b] for a, b in self.cuts]
        of_engines = zip(self.engines, each, frames.buffers, strict=True)
        return [future for engine, mine, buffer in of_engines for future in engine.advance(mine, buffer)]

    def start_settling(self, settling: NDArray[Any]) -> None:
        for engine, (a, b) in zip(self.engines, self.cuts, strict=True):
            engine.start_settling(settling[a:b])

    def settle(self, steps: int) -> list[Future[None]]:
        return [future for engine in self.engines for future in engine.settle(steps)]

    def settling(self) -> NDArray[Any]:
        return np.concatenate([engine.settling() for engine in self.engines])

    def progress(self) -> NDArray[Any]:
        return np.concatenate([engine.progress() for engine in self.engines])

    def sums(self) -> dict[str, NDArray[Any]]:
        """The window's sums, by name."""
        each = [engine.sums() for engine in self.engines]
        return {name: self._joined([sums[name] for sums in each], "sums", name) for name in TABLE["sums"]}

    def held(self) -> dict[str, Any]:
        return self.engines[0].held()

    def fetch(self, group: str, name: str) -> NDArray[Any]:
        return self._joined([engine.fetch(group, name) for engine in self.engines], group, name)

    def put(self, group: str, name: str, values: NDArray[Any]) -> None:
        for engine, mine in zip(self.engines, np.split(values, np.cumsum(self._counts(group, name))[:-1]), strict=True):
            if len(mine):
                engine.put(group, name, mine)

    def _counts(self, group: str, name: str) -> list[int]:
        """Number of values of an array in each part, without the row of one that is empty."""
        row = TABLE[group][name]
        return [row.width * int(starts(part.drives)[row.kind][-1]) for part in self.parts]

    def _joined(self, each: Sequence[NDArray[Any]], group: str, name: str) -> NDArray[Any]:
        """The parts' values of an array, one after the other."""
        counts = self._counts(group, name)
        return np.concatenate([values[:count] for values, count in zip(each, counts, strict=True)])

    def frame_buffer(self, values: int) -> SeveralBuffers:
        firsts = [values if first is None else first for first in self.firsts]
        ends = [*firsts[1:], values]
        buffers = [
            engine.frame_buffer(end - first) for engine, first, end in zip(self.engines, firsts, ends, strict=True)
        ]
        return SeveralBuffers(buffers, firsts, values, self.packed.rollers.dtype)

    def close(self) -> None:
        for engine in self.engines:
            engine.close()
