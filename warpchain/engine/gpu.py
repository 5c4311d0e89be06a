"""GPU engine: an ensemble in one GPU's memory, one block of threads a variant.

Variants with like numbers of rollers and sprockets go into one launch (`launches`). Frames come back on a stream of
their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from threading import Lock
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.arrays import (
    ARRAYS,
    Engine,
    assign_values,
    device_values,
    empty_sums,
    empty_tallies,
    upload_ensemble,
    upload_state,
)
from warpchain.engine.compilation import compile_in_processes, compile_jobs
from warpchain.engine.gpu_kernels import ROLLER_CAPACITIES, TALLY_SUM_THREADS, Bucket, GpuKernels, global_memory_values
from warpchain.engine.launches import (
    LAUNCH_PARTS,
    STEP_UNIT,
    Launch,
    launch_groups,
    metrics_start_steps,
    split_launches,
    steps_left,
)
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.errors import DeviceError, SimulationError
from warpchain.kernels import relaxation
from warpchain.kernels.gpu.block_structs import BITS
from warpchain.kernels.gpu.statistics import tally_sum_kernel
from warpchain.progress import ProgressReport, StopRequest

OLDEST_ARCHITECTURE = 70
"""Oldest GPU architecture, capability times ten."""

FRAME_BYTES = 32 * 2**20
"""Most bytes of a GPU launch's frames."""

LAUNCH_WORK = 1.0e10
"""Roller-steps of one GPU launch, for progress."""

STREAMS = 4
"""Streams of GPU launches side by side."""

KERNEL_LOCK = Lock()
"""Lock to make and load GPU kernels."""

LAUNCH_STEPS = 131_072
"""Most steps of one GPU launch."""

MOST_REPEATED = 16
"""Most lengths of pieces whose launches are kept."""

MOST_LINKS = 16 * ROLLER_CAPACITIES[-1]
"""Links of the longest chain that a GPU takes."""

MOST_PARTNERS = BITS
"""Most sprockets and guides of a drive on a GPU."""


def gpu_launch_steps(rollers: float, wanted: int) -> int:
    """Number of steps of a GPU launch, `wanted` at most.

    Whole multiples of `STEP_UNIT`, so that results do not depend on where launches end.
    """
    steps = min(wanted, LAUNCH_STEPS, int(LAUNCH_WORK / rollers))
    return max(STEP_UNIT, steps // STEP_UNIT * STEP_UNIT) if wanted >= STEP_UNIT else wanted


def gpu_refusal(packed: PackedEnsemble, numbers: NDArray[np.int64] | None = None) -> str | None:
    """Reason why a GPU cannot run an ensemble, or None."""
    drives, begins = packed.drives, packed.first_rows
    for count, most, words in (
        (drives["rollers"], MOST_LINKS, "chain.links = {}"),
        (drives["sprockets"] + drives["guides"], MOST_PARTNERS, "{} sprockets and guide-bars"),
    ):
        whole = np.add.reduceat(count, begins)
        for v in np.flatnonzero(whole > most):
            words = (
                words if drives["chains"][begins[v]] == 1 else words.replace("chain.links =", "links of all chains:")
            )
            number = v if numbers is None else numbers[v]
            return f'variant {number}: {words.format(whole[v])}: a GPU takes up to {most}; use device="cpu"'
    return None


@contextmanager
def explain_gpu_failures(device: str, variants: int) -> Iterator[None]:
    """Context that explains Warp's GPU errors in one line.

    Raises:
        DeviceError: the GPU does not answer any more.
        SimulationError: its memory does not hold so many variants.
    """
    try:
        yield
    except RuntimeError as error:
        try:
            wp.synchronize_device(device)
            free = wp.get_device(device).free_memory / 2**30
        except RuntimeError as failure:
            line = str(failure).partition(" (in function")[0]
            raise DeviceError(f"device {device} failed, see nvidia-smi: {line}") from error
        if "alloc" not in str(error).lower() and "out of memory" not in str(error).lower():
            raise
        raise SimulationError(
            f"device {device}: out of memory with {variants} variants ({free:.3g} GiB are free); simulate fewer "
            'variants at a time, lower memory=, or use precision="float32"'
        ) from error


def compile_missing_kernels(
    device: str,
    packed: PackedEnsemble,
    precision: str,
    settles: bool,
    cores: int,
    report: ProgressReport,
    stop: StopRequest,
) -> None:
    """Compiles a run's GPU kernels that Warp's cache lacks.

    Args:
        settles: whether any variant is to be settled.
        cores, report, stop: as in `compilation.compile_in_processes`.
    """
    with KERNEL_LOCK:
        wanted = GpuKernels(replace(packed, precision=precision), device).kernel_specs()
        if settles:
            wanted += GpuKernels(packed, device).kernel_specs("relax")
        compile_in_processes(list(compile_jobs(wanted, device)), cores, report, stop)


class FrameBuffer:
    """Frame buffer of a GPU launch, on device and host."""

    def __init__(self, values: int, packed: PackedEnsemble, device: str) -> None:
        self.late: wp.Stream | None = None  # on which frames are to be copied once they are asked for
        self.values, self._of = values, (device, packed.variants)
        self.device: wp.array = wp.empty(max(values, 1), dtype=packed.real, device=device)
        self.host: wp.array = wp.empty(max(values, 1), dtype=packed.real, device="cpu", pinned=True)
        self.copied: Any = None

    def numpy(self) -> NDArray[np.floating]:
        """Frames of a GPU launch, once copied."""
        if self.late is not None:
            with explain_gpu_failures(*self._of):
                wp.copy(self.host, self.device, count=self.values, stream=self.late)
                wp.synchronize_stream(self.late)
            self.late = None
        elif self.copied is not None:
            with explain_gpu_failures(*self._of):
                wp.synchronize_event(self.copied)
        return self.host.numpy()


@dataclass(frozen=True)
class RepeatedLaunch:
    """Recorded GPU launch that takes variants so many steps from wherever they all are.

    Attributes:
        command: of Warp.
        order: numbers of the variants on the device, which the command alone does not keep there.
        stream: where it goes.
        columns: end and start steps, on the device and pinned on the host, and what they are beyond the present step.
    """

    command: Any
    order: wp.array
    stream: wp.Stream
    columns: tuple[tuple[wp.array, wp.array, NDArray[np.integer]], ...]

    def repeat(self, step: int) -> None:
        """Launches it from `step` on, once the launch before has ended."""
        for device, host, beyond in self.columns:
            np.add(beyond, step, out=host.numpy(), casting="unsafe")
            wp.copy(device, host, stream=self.stream)
        self.command.launch(stream=self.stream)


class GpuEngine(GpuKernels, Engine):
    """Engine that steps an ensemble on one GPU.

    Raises:
        SimulationError: if the GPU's memory does not hold the ensemble.
    """

    balances = True

    def __init__(self, packed: PackedEnsemble, device: str) -> None:
        self._loaded: set[tuple[str, ...]] = set()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=f"warpchain {device}")
        with explain_gpu_failures(device, packed.variants):
            self.stream, self.copies, *self._others = (wp.Stream(device) for _ in range(STREAMS + 1))
            with wp.ScopedStream(self.stream):
                super().__init__(packed, device)
                self.ensemble = upload_ensemble(packed, device, blocks=True)
                self.state = upload_state(packed, device, global_memory_values([*self.buckets, *self.chain_buckets]))
                self.gpu_sums = empty_sums(packed, device, blocks=True)
                self.tallies = empty_tallies(packed, device)
            wp.synchronize_stream(self.stream)
        self._progress = np.zeros(packed.variants, dtype=self.state.progress.dtype.numpy_dtype())
        self._host_progress: Any = wp.empty(
            packed.variants, dtype=self.state.progress.dtype, device="cpu", pinned=wp.get_device(device).is_cuda
        )
        self._repeated: dict[tuple[str, int, int], list[RepeatedLaunch]] = {}  # by kernel, steps and buffer of frames
        self._settling: Any = None
        # rows in global memory, which launches share
        self._in_global_memory = [any(global_memory_values([bucket])) for bucket in self.buckets]
        self._settling_states: NDArray[Any] = np.zeros(0)

    def _explain_failures(self) -> AbstractContextManager[None]:
        """Context that turns the GPU's errors into those of the package."""
        return explain_gpu_failures(self.device, self.packed.variants)

    def _load_kernels(self, *names: str) -> None:
        """Loads GPU kernels by name, once."""
        if names in self._loaded:
            return
        with self._explain_failures(), KERNEL_LOCK, ThreadPoolExecutor(8) as pool:
            wanted = self.kernel_specs(*names)
            load = [pool.submit(wp.load_module, of.module, device=self.device, block_dim=of.threads) for of in wanted]
            for loading in load:
                loading.result()
        self._loaded.add(names)

    def _launch(
        self,
        name: str,
        bucket: Bucket,
        order: wp.array,
        inputs: Sequence[Any],
        stream: wp.Stream,
        record: bool = False,
    ) -> Any:
        """Launches a bucket's GPU kernel, or records the launch."""
        made = self._bucket_kernel(name, bucket)
        dim, block = made.kind.launch_threads(len(order)), made.kind.block_threads
        options = {"block_dim": block, "device": self.device, "stream": stream, "record_cmd": record}
        return wp.launch(made.kernel, dim=dim, inputs=[*inputs], **options)

    def _launch_sequences(self, share: NDArray[np.integer]) -> list[tuple[bool, Bucket, list[Launch]]]:
        """Launches that take variants `share` (V,) steps, by bucket."""
        drives, step, lanes = self.packed.drives, self._progress["step"], []
        begins = metrics_start_steps(drives, step)
        for bucket, apart in zip(self.buckets, self._in_global_memory, strict=True):
            variants = bucket.variants[share[bucket.variants] > 0]
            kernel = "measure" if (step + share > begins)[variants].any() else "advance"
            turn = bucket.count if apart else self._bucket_kernel(kernel, bucket).resident_variants * self._processors
            # what is recorded takes longer
            longest = variants[np.lexsort((-share[variants], drives["frame_interval"][variants] == 0))]
            parts = launch_groups(longest, turn)
            cut = LAUNCH_PARTS if len(parts) > 1 else 1
            lanes += [(not apart, bucket, list(split_launches(each, step, share, begins, cut))) for each in parts]
        return lanes

    def advance(self, steps: int | NDArray[np.integer], frames: FrameBuffer) -> list[Future[None]]:
        self._load_kernels()

        def work() -> None:
            with self._explain_failures():
                if frames.copied is not None:
                    self.stream.wait_event(frames.copied)
                lanes = self._launch_sequences(np.minimum(steps, steps_left(self.packed.drives, self._progress)))
                columns = self._upload_launches([launch for _, _, launches in lanes for launch in launches])
                begun = self.stream.record_event()
                for stream in self._others:
                    stream.wait_event(begun)
                state = self.ensemble, self.state, self.gpu_sums, self.tallies, frames.device
                for at, (beside, bucket, launches) in enumerate(lanes):
                    stream = [self.stream, *self._others][at % STREAMS if beside else 0]
                    for launch in launches:
                        order, *ends = next(columns)
                        self._launch(launch.kernel, bucket, order, [*state, order, *ends], stream)
                for stream in self._others:
                    self.stream.wait_event(stream.record_event())
                done = self.stream.record_event()
                frames.late = None
                if frames.values:
                    self.copies.wait_event(done)
                    wp.copy(frames.host, frames.device, count=frames.values, stream=self.copies)
                    frames.copied = self.copies.record_event()
                wp.synchronize_event(done)
                self._progress = self.fetch_array("state", "progress")

        return [self._pool.submit(work)]

    def take_steps(self, steps: int | NDArray[np.integer], frames: FrameBuffer) -> None:
        kernel = self._repeated_kernel(steps) if isinstance(steps, int) else None
        if kernel is None or not isinstance(steps, int):
            super().take_steps(steps, frames)
            return
        key = kernel, steps, id(frames)
        with self._explain_failures():
            if key not in self._repeated:
                if len(self._repeated) == MOST_REPEATED:
                    self._repeated.clear()
                self._load_kernels()
                self._repeated[key] = self._record_launches(steps, frames)
            launches, step = self._repeated[key], int(self._progress["step"][0])
            for launch in launches:
                launch.repeat(step)
            for stream in {of.stream for of in launches} - {self.stream}:
                self.stream.wait_event(stream.record_event())
            if frames.values:
                frames.late = self.stream
            wp.copy(self._host_progress, self.state.progress, stream=self.stream)
            wp.synchronize_stream(self.stream)
        self._progress = self._host_progress.numpy().copy()

    def _repeated_kernel(self, steps: int) -> str | None:
        """Kernel that takes all variants so many steps on, where one does and all are at one step; or None."""
        step, drives = self._progress["step"], self.packed.drives
        first = int(step[0])
        if self._progress["diverged"].any() or (step != first).any() or first + steps > int(drives["steps"].min()):
            return None
        begins = drives["window_start"] // STEP_UNIT * STEP_UNIT
        if first + steps <= int(begins.min()) or first > int(drives["window_end"].max()):
            return "advance"
        return "measure" if int(begins.max()) <= first <= int(drives["window_end"].min()) else None

    def _record_launches(self, steps: int, frames: FrameBuffer) -> list[RepeatedLaunch]:
        """Launches that take all variants so many steps on, recorded."""
        step = self._progress["step"]
        state = self.ensemble, self.state, self.gpu_sums, self.tallies, frames.device
        found = []
        for at, (beside, bucket, launches) in enumerate(self._launch_sequences(np.full(len(step), steps))):
            stream = [self.stream, *self._others][at % STREAMS if beside else 0]
            for launch in launches:
                ((order, *ends),) = self._upload_launches([launch])
                hosts = [wp.empty(len(of), dtype=wp.int32, device="cpu", pinned=True) for of in launch[2:]]
                beyond = [np.asarray(of, dtype=np.int64) - int(step[0]) for of in launch[2:]]
                command = self._launch(launch.kernel, bucket, order, [*state, order, *ends], stream, record=True)
                found.append(RepeatedLaunch(command, order, stream, tuple(zip(ends, hosts, beyond, strict=True))))
        wp.synchronize_stream(self.stream)
        return found

    def _upload_launches(self, launches: Sequence[Launch]) -> Iterator[list[wp.array]]:
        """Device arrays of each launch's variants and steps."""
        columns: list[wp.array] = []
        with wp.ScopedStream(self.stream):
            for each in zip(*(launch[1:] for launch in launches), strict=True):
                columns.append(wp.array(np.concatenate(each), dtype=wp.int32, device=self.device))
        cuts = np.cumsum([0, *(len(launch.variants) for launch in launches)]).tolist()
        return iter([[column[a:b] for column in columns] for a, b in pairwise(cuts)])

    def start_settling(self, settling: NDArray[Any]) -> None:
        with self._explain_failures(), wp.ScopedStream(self.stream):
            self._settling = wp.array(settling, dtype=relaxation.Settling, device=self.device)
            self._settling_states = settling.copy()

    def settle(self, steps: int) -> list[Future[None]]:
        self._load_kernels("relax")

        def work() -> None:
            with self._explain_failures():
                for bucket in self.buckets_of_kernel("relax"):
                    inputs = [self.ensemble, self.state, self.tallies, self._settling, bucket.order, steps]
                    self._launch("relax", bucket, bucket.order, inputs, self.stream)
                with wp.ScopedStream(self.stream, sync_enter=False):
                    self._settling_states = self._settling.numpy()

        return [self._pool.submit(work)]

    def settling_states(self) -> NDArray[Any]:
        return self._settling_states

    def progress(self) -> NDArray[Any]:
        return self._progress

    def sums(self) -> dict[str, NDArray[Any]]:
        """Sums of the window, by name."""
        with self._explain_failures(), wp.ScopedStream(self.stream):
            sums = empty_sums(self.packed, self.device, blocks=True)
            for name in ARRAYS["sums"]:
                wp.copy(getattr(sums, name), getattr(self.gpu_sums, name))
            inputs = [self.ensemble.drives, self.tallies, sums]
            kernel = tally_sum_kernel(self.packed.real)
            wp.launch(kernel, self.packed.variants, inputs=inputs, device=self.device, block_dim=TALLY_SUM_THREADS)
            return {name: device_values(getattr(sums, name), "sums", name, self.packed.real) for name in ARRAYS["sums"]}

    def changing_structs(self) -> dict[str, Any]:
        return {"state": self.state, "sums": self.gpu_sums, "tallies": self.tallies}

    def fetch_array(self, group: str, name: str) -> NDArray[Any]:
        with self._explain_failures(), wp.ScopedStream(self.stream, sync_enter=False):
            return device_values(getattr(self.changing_structs()[group], name), group, name, self.packed.real)

    def set_array(self, group: str, name: str, values: NDArray[Any]) -> None:
        with self._explain_failures():
            with wp.ScopedStream(self.stream):
                assign_values(getattr(self.changing_structs()[group], name), values)
            wp.synchronize_stream(self.stream)
        self._progress = self.fetch_array("state", "progress")

    def set_constants(self, name: str, values: NDArray[Any]) -> None:
        with self._explain_failures():
            with wp.ScopedStream(self.stream):
                assign_values(getattr(self.ensemble, name), values)
            wp.synchronize_stream(self.stream)

    def restore_state(self, arrays: Mapping[tuple[str, str], NDArray[Any]]) -> None:
        with self._explain_failures():
            with wp.ScopedStream(self.stream):
                super().restore_state(arrays)
            wp.synchronize_stream(self.stream)
        self._progress = self.fetch_array("state", "progress")

    def frame_buffer(self, values: int) -> FrameBuffer:
        with self._explain_failures():
            return FrameBuffer(values, self.packed, self.device)

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
        with self._explain_failures():
            wp.synchronize_device(self.device)
