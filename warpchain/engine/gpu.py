"""GPU engine: an ensemble in one GPU's memory, one block of threads a variant.

Variants of like sizes share a launch (`launches`). Frames come back on their own stream.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
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
from warpchain.kernels.gpu.transfer import transfer_kernels
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

LAUNCH_STEPS = 131_072
"""Most steps of one GPU launch."""

MOST_GRAPHS = 16
"""Most lengths of pieces whose graphs are kept."""

MOST_LINKS = 16 * ROLLER_CAPACITIES[-1]
"""Links of the longest chain on a GPU."""

MOST_PARTNERS = BITS
"""Most sprockets and guides of a drive on a GPU."""


def gpu_launch_steps(rollers: float, wanted: int) -> int:
    """Steps of a GPU launch, `wanted` at most.

    Multiples of `STEP_UNIT`, so that results do not depend on where launches end.
    """
    steps = min(wanted, LAUNCH_STEPS, int(LAUNCH_WORK / rollers))
    return max(STEP_UNIT, steps // STEP_UNIT * STEP_UNIT) if wanted >= STEP_UNIT else wanted


def gpu_refusal(packed: PackedEnsemble, numbers: NDArray[np.int64] | None = None) -> str | None:
    """Why a GPU cannot run an ensemble, or None."""
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
        settles: whether any variant settles.
        cores, report, stop: as in `compilation.compile_in_processes`.
    """
    with KERNEL_LOCK:
        wanted = GpuKernels(replace(packed, precision=precision), device).kernel_specs()
        if settles:
            wanted += GpuKernels(packed, device).kernel_specs("relax")
        compile_in_processes(list(compile_jobs(wanted, device)), cores, report, stop)


class FrameBuffer:
    """Frame buffer of a GPU launch, on device and host.

    Attributes:
        wanted: places on the device of values that are read after a piece.
    """

    def __init__(self, values: int, packed: PackedEnsemble, device: str, wanted: NDArray[np.integer]) -> None:
        self.values, self._of = values, (device, packed.variants)
        self.device: wp.array = wp.empty(max(values, 1), dtype=packed.real, device=device)
        self.host: wp.array = wp.empty(max(values, 1), dtype=packed.real, device="cpu", pinned=True)
        self.copied: Any = None
        self.wanted: wp.array = wp.array(wanted, dtype=wp.int32, device=device)
        self._frames: NDArray[np.floating] = self.host.numpy()

    def numpy(self) -> NDArray[np.floating]:
        """Frames of a GPU launch, once copied."""
        if self.copied is not None:
            with explain_gpu_failures(*self._of):
                wp.synchronize_event(self.copied)
            self.copied = None
        return self._frames


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
        self._host_progress: Any = wp.empty(
            packed.variants, dtype=self.state.progress.dtype, device="cpu", pinned=wp.get_device(device).is_cuda
        )
        self._progress: NDArray[Any] = self._host_progress.numpy()
        self._common_step: int | None = None  # next step of all variants, while none has diverged
        self._read_progress()
        # of pieces by kernel, steps and buffer of frames, with arrays to keep alive
        self._graphs: dict[tuple[str, int, int], tuple[wp.Graph, list[wp.array]]] = {}
        self._inputs: list[wp.array] = []  # of a stepped run: tables and frame intervals, each from where and to where
        self._host_inputs: list[wp.array] = []  # pinned
        drives = packed.drives
        begins = drives["window_start"] // STEP_UNIT * STEP_UNIT
        self._steps = int(drives["steps"].min())
        self._windows = (begins.min(), begins.max(), drives["window_end"].min(), drives["window_end"].max())
        self._settling: Any = None
        # rows in global memory, which launches share
        self._in_global_memory = [any(global_memory_values([bucket])) for bucket in self.buckets]
        self._settling_states: NDArray[Any] = np.zeros(0)

    def _explain_failures(self) -> AbstractContextManager[None]:
        """Context that turns the GPU's errors into the package's."""
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
    ) -> None:
        """Launches a bucket's GPU kernel."""
        made = self._bucket_kernel(name, bucket)
        dim, block = made.kind.launch_threads(len(order)), made.kind.block_threads
        wp.launch(made.kernel, dim=dim, inputs=[*inputs], block_dim=block, device=self.device, stream=stream)

    def _launch_sequences(self, share: NDArray[np.integer]) -> list[tuple[bool, Bucket, list[Launch]]]:
        """Launches that take `share` (V,) steps, by bucket."""
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
                uploaded, columns = self._upload_launches(lanes)
                if self._inputs:
                    self._take_inputs(uploaded[:0], uploaded[:0])
                self._launch_beside(lanes, columns, frames)
                done = self.stream.record_event()
                if frames.values:
                    self.copies.wait_event(done)
                    wp.copy(frames.host, frames.device, count=frames.values, stream=self.copies)
                    frames.copied = self.copies.record_event()
                wp.synchronize_event(done)
                self._read_progress()

        return [self._pool.submit(work)]

    def _read_progress(self) -> None:
        """Reads variants' progress from the device."""
        self._progress[:] = self.fetch_array("state", "progress")
        step = self._progress["step"]
        is_common = (step == step[0]).all() and not self._progress["diverged"].any()
        self._common_step = int(step[0]) if is_common else None

    def take_steps(self, steps: int | NDArray[np.integer], frames: FrameBuffer) -> None:
        kernel = self._repeated_kernel(steps) if isinstance(steps, int) else None
        if kernel is None:
            super().take_steps(steps, frames)
        else:
            self._repeat_piece(kernel, int(steps), frames)

    def _repeat_piece(self, kernel: str, steps: int, frames: FrameBuffer) -> None:
        """Takes all variants, which are at one step, so many steps on by a graph, captured once."""
        key = kernel, steps, id(frames)
        with self._explain_failures():
            if key not in self._graphs:
                if len(self._graphs) == MOST_GRAPHS:
                    self._graphs.clear()
                self._load_kernels()
                self._graphs[key] = self._capture_piece(steps, frames)
            if frames.copied is not None:
                self.stream.wait_event(frames.copied)
                frames.copied = None
            wp.capture_launch(self._graphs[key][0], stream=self.stream)
            wp.synchronize_stream(self.stream)
        has_diverged = np.count_nonzero(self._progress["diverged"]) > 0
        self._common_step = None if has_diverged else int(self._progress["step"][0])

    def _repeated_kernel(self, steps: int) -> str | None:
        """Kernel that takes all variants so many steps on, where one does and all are at one step; or None."""
        first = self._common_step
        if first is None or first + steps > self._steps:
            return None
        first_begin, last_begin, first_end, last_end = self._windows
        if first + steps <= first_begin or first > last_end:
            return "advance"
        return "measure" if last_begin <= first <= first_end else None

    def _capture_piece(self, steps: int, frames: FrameBuffer) -> tuple[wp.Graph, list[wp.array]]:
        """Graph that takes all variants so many steps on, with inputs and outputs, and arrays to keep alive for it."""
        step = self._progress["step"]
        lanes = self._launch_sequences(np.full(len(step), steps))
        device, columns = self._upload_launches(lanes)
        ends = device[len(device) // 3 :]
        with wp.ScopedStream(self.stream):
            beyond: wp.array = wp.array(ends.numpy() - step[0], dtype=wp.int32, device=self.device)
        wp.capture_begin(stream=self.stream, force_module_load=False)
        try:
            self._take_inputs(beyond, ends)
            self._launch_beside(lanes, columns, frames)
            outputs = [frames.wanted, frames.device, self._on_device(frames.host)]
            outputs += [self.state.progress, self._on_device(self._host_progress)]
            self._transfer("give_outputs", max(len(frames.wanted), len(step)), outputs)
        finally:
            graph = wp.capture_end(stream=self.stream)
        return graph, [device, beyond]

    def _take_inputs(self, beyond: wp.array, ends: wp.array) -> None:
        """Takes inputs to the device, as they stand when the stream comes there, and sets launches' steps."""
        threads = max(map(len, [*self._inputs, ends]))
        self._transfer("take_inputs", threads, [*self._inputs, self.state.progress, beyond, ends])

    def _transfer(self, name: str, threads: int, arrays: Sequence[wp.array]) -> None:
        """Launches a transfer kernel."""
        kernel = transfer_kernels(self.packed.real)[name]
        wp.launch(kernel, threads, inputs=arrays, device=self.device, stream=self.stream)

    def _on_device(self, pinned: wp.array) -> wp.array:
        """Pinned memory of the host as an array of the device."""
        return wp.array(ptr=pinned.ptr, shape=len(pinned), dtype=pinned.dtype, device=self.device)

    def _launch_beside(
        self,
        lanes: Sequence[tuple[bool, Bucket, list[Launch]]],
        columns: Iterable[list[wp.array]],
        frames: FrameBuffer,
    ) -> None:
        """Makes GPU launches on several streams, each with its variants and steps; the first waits for all."""
        begun, streams = self.stream.record_event(), [self.stream, *self._others][: len(lanes)]
        for stream in streams[1:]:
            stream.wait_event(begun)
        state, left = (self.ensemble, self.state, self.gpu_sums, self.tallies, frames.device), iter(columns)
        for at, (beside, bucket, launches) in enumerate(lanes):
            stream = streams[at % STREAMS if beside else 0]
            for launch in launches:
                order, *ends = next(left)
                self._launch(launch.kernel, bucket, order, [*state, order, *ends], stream)
        for stream in streams[1:]:
            self.stream.wait_event(stream.record_event())

    def _upload_launches(
        self, lanes: Sequence[tuple[bool, Bucket, list[Launch]]]
    ) -> tuple[wp.array, list[list[wp.array]]]:
        """Device array of launches' variants, end steps and start steps, and each launch's parts."""
        launches = [launch for _, _, of in lanes for launch in of]
        cuts = np.cumsum([0, *(len(launch.variants) for launch in launches)]).tolist()
        values = [np.zeros(0, dtype=np.int32), *(launch[column] for column in (1, 2, 3) for launch in launches)]
        with wp.ScopedStream(self.stream):
            device: wp.array = wp.array(np.concatenate(values), dtype=wp.int32, device=self.device)
        return device, [[device[k * cuts[-1] + a : k * cuts[-1] + b] for k in range(3)] for a, b in pairwise(cuts)]

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
        return self._progress.copy()

    def diverged_view(self) -> NDArray[Any]:
        view: NDArray[Any] = self._progress["diverged"]
        return view

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
        self._read_progress()

    def stage_inputs(self, first: int) -> tuple[NDArray[Any], NDArray[Any]]:
        with self._explain_failures(), KERNEL_LOCK:
            found = self.packed.tables, self.packed.drives["frame_interval"]
            self._host_inputs = [wp.array(of, device="cpu", pinned=True) for of in found]
            tables, intervals = map(self._on_device, self._host_inputs)
            self._inputs = [tables[first:], self.ensemble.tables[first:], intervals, self.ensemble.drives]
            wp.load_module(transfer_kernels(self.packed.real)["take_inputs"].module, device=self.device)
        return self._host_inputs[0].numpy(), self._host_inputs[1].numpy()

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
        self._read_progress()

    def frame_buffer(self, values: int, wanted: NDArray[np.integer] | None = None) -> FrameBuffer:
        with self._explain_failures():
            return FrameBuffer(values, self.packed, self.device, np.zeros(0, dtype=int) if wanted is None else wanted)

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
        with self._explain_failures():
            wp.synchronize_device(self.device)
