"""The GPU engine: an ensemble in one GPU's memory, one block of threads a variant.

Variants with like numbers of rollers and sprockets go into one launch. Frames come back on a stream of their own while
the next steps are under way.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.arrays import SUMS, empty_sums, empty_tallies, upload_ensemble, upload_state
from warpchain.ensemble import INTEGRATORS, Packed
from warpchain.errors import SimulationError
from warpchain.kernels import relax
from warpchain.kernels.block import block_kernel
from warpchain.kernels.block_observe import collect
from warpchain.kernels.block_relax import block_relax_kernel
from warpchain.kernels.exchange import keeps_in_shared
from warpchain.kernels.serial import DIVERGENCE_CHECK

THREADS = (32, 64, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 1024)
"""Block sizes that kernels are made for."""

MOST_SPROCKETS = 31
"""Sprockets of one drive: which of them a roller is engaged with is kept in the bits of an int."""

OLDEST = 70
"""Oldest architecture (compute capability times ten) that the kernels are compiled for."""

FRAME_BYTES = 32 * 2**20
"""Most bytes of frames of one launch: pinned memory takes long to get, and small copies hide behind the next steps."""

LAUNCH_WORK = 5.0e9
"""Roller-steps of one launch, about a quarter of a second, so that progress shows and Ctrl-C is heard."""

LAUNCH_STEPS = 131_072
"""Most steps of one launch, about a quarter of a second for a single variant."""


def resident_blocks(precision: str, threads: int) -> int:
    """How many blocks of `threads` threads the compiler is to make room for on a multiprocessor.

    This bounds the registers of a thread; what is best was measured on an H200 (docs/performance.md).
    """
    return max(1, (512 if precision == "float64" and threads <= 128 else 768) // threads)


def launch_steps(rollers: float, wanted: int) -> int:
    """Steps of a launch over so many rollers in all: `wanted` at most, and a fraction of a second.

    Whole multiples of what the kernel counts by, so that results do not depend on where launches end.
    """
    unit = int(DIVERGENCE_CHECK)
    steps = min(wanted, LAUNCH_STEPS, int(LAUNCH_WORK / rollers))
    return max(unit, steps // unit * unit) if wanted >= unit else wanted


def refusal(packed: Packed) -> str | None:
    """Why a GPU cannot run this ensemble, None if it can."""
    drives = packed.drives
    for v in np.flatnonzero(drives["integrator"] != INTEGRATORS["leapfrog"]):
        return f'variant {v}: run.integrator = "rk4" runs on the CPU only; use "leapfrog", or device="cpu"'
    for v in np.flatnonzero(drives["rollers"] > THREADS[-1]):
        return f'variant {v}: chain.links = {drives["rollers"][v]}: a GPU takes up to {THREADS[-1]}; use device="cpu"'
    for v in np.flatnonzero(drives["sprockets"] > MOST_SPROCKETS):
        return f'variant {v}: {drives["sprockets"][v]} sprockets: a GPU takes up to {MOST_SPROCKETS}; use device="cpu"'
    return None


@contextmanager
def _told(device: str, packed: Packed) -> Iterator[None]:
    """Turns an exhausted GPU memory into one line that says what to do."""
    try:
        yield
    except RuntimeError as error:
        if "alloc" not in str(error).lower() and "out of memory" not in str(error).lower():
            raise
        free = wp.get_device(device).free_memory / 2**30
        raise SimulationError(
            f"device {device}: out of memory with {packed.variants} variants ({free:.3g} GiB are free); simulate fewer "
            'variants at a time, lower memory=, or use precision="float32"'
        ) from error


class FrameBuffer:
    """A block's frames: on the device, and in the host's memory once `numpy` is called."""

    def __init__(self, values: int, real: type, device: str) -> None:
        self.values = values
        self.device: wp.array = wp.empty(max(values, 1), dtype=real, device=device)
        self.host: wp.array = wp.empty(max(values, 1), dtype=real, device="cpu", pinned=True)
        self.copied: Any = None

    def numpy(self) -> NDArray[np.floating]:
        """The frames; waits until they have come over."""
        if self.copied is not None:
            wp.synchronize_event(self.copied)
        return self.host.numpy()


@dataclass(frozen=True)
class Bucket:
    """Variants that share a kernel."""

    threads: int
    sprockets: int
    guides: int
    moving: bool
    order: wp.array  # of the variants
    count: int


class GpuEngine:
    """Steps an ensemble on one GPU.

    Args:
        packed: the ensemble.
        device: such as "cuda:0".

    Raises:
        SimulationError: if the GPU's memory does not hold the ensemble.
    """

    def __init__(self, packed: Packed, device: str) -> None:
        self.packed, self.device = packed, device
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=f"warpchain {device}")
        with _told(device, packed):
            self.stream, self.copies = wp.Stream(device), wp.Stream(device)
            with wp.ScopedStream(self.stream):
                self.ensemble = upload_ensemble(packed, device)
                self.state = upload_state(packed, device, self._keeps())
                self.gpu_sums = empty_sums(packed, device)
                self.tallies = empty_tallies(packed, device)
                self.buckets = self._bucketed()
            wp.synchronize_stream(self.stream)
        self._progress = np.zeros(packed.variants, dtype=self.state.progress.dtype.numpy_dtype())
        self._settling: Any = None
        self._kernels: dict[str, list[Any]] = {}
        self._settling_now: NDArray[Any] = np.zeros(0)

    def _keeps(self) -> bool:
        """Whether some blocks are too large to keep in shared memory what their threads add up."""
        largest = THREADS[int(np.searchsorted(THREADS, self.packed.drives["rollers"].max()))]
        return not keeps_in_shared(self.packed.real, largest)

    def _bucketed(self) -> list[Bucket]:
        """The variants by kernel, the longest first."""
        drives = self.packed.drives
        threads = np.array(THREADS)[np.searchsorted(THREADS, drives["rollers"])]
        moving = np.add.reduceat(self.packed.mounts["active"], drives["first_sprocket"]) > 0
        keys = np.stack([threads, drives["sprockets"], drives["guides"], moving])
        buckets = []
        for size, wheels, bars, moves in sorted({tuple(key) for key in keys.T.tolist()}, reverse=True):
            order = np.flatnonzero((keys == [[size], [wheels], [bars], [moves]]).all(axis=0))
            array: wp.array = wp.array(order, dtype=wp.int32, device=self.device)
            buckets.append(Bucket(size, wheels, bars, bool(moves), array, len(order)))
        return buckets

    def _ready(self, name: str) -> list[Any]:
        """Each bucket's kernel, compiled and loaded by the calling thread: Warp builds one at a time."""
        if name not in self._kernels:
            kernels = []
            for b in self.buckets:
                blocks = resident_blocks(self.packed.precision, b.threads)
                if name == "advance":
                    kernel = block_kernel(self.packed.real, b.threads, b.sprockets, b.guides, blocks, b.moving)
                else:
                    kernel = block_relax_kernel(self.packed.real, b.threads, b.sprockets, b.guides, blocks)
                wp.load_module(kernel.module, device=self.device, block_dim=b.threads)
                kernels.append(kernel)
            self._kernels[name] = kernels
        return self._kernels[name]

    def _launch(self, kernel: Any, bucket: Bucket, inputs: Sequence[Any]) -> None:
        wp.launch(
            kernel,
            dim=bucket.count * bucket.threads,
            inputs=[*inputs],
            block_dim=bucket.threads,
            device=self.device,
            stream=self.stream,
        )

    def advance(self, block: int, frames: FrameBuffer) -> list[Future[None]]:
        """Starts `block` steps of every variant that has not ended; frames go to `frames`."""

        kernels = self._ready("advance")

        def work() -> None:
            with _told(self.device, self.packed):
                if frames.copied is not None:
                    self.stream.wait_event(frames.copied)
                for bucket, kernel in zip(self.buckets, kernels, strict=True):
                    inputs = [
                        self.ensemble,
                        self.state,
                        self.gpu_sums,
                        self.tallies,
                        frames.device,
                        bucket.order,
                        block,
                    ]
                    self._launch(kernel, bucket, inputs)
                done = self.stream.record_event()
                if frames.values:
                    self.copies.wait_event(done)
                    wp.copy(frames.host, frames.device, count=frames.values, stream=self.copies)
                    frames.copied = self.copies.record_event()
                wp.synchronize_event(done)
                self._progress = self._read(self.state.progress)

        return [self._pool.submit(work)]

    def _read(self, array: wp.array) -> NDArray[Any]:
        """A copy of a device array, by the engine's own stream."""
        with wp.ScopedStream(self.stream, sync_enter=False):
            return np.array(array.numpy(), copy=True)

    def start_settling(self, settling: NDArray[Any]) -> None:
        """Takes the state of each variant's relaxation, (variants,) `kernels.relax.Settling`."""
        with _told(self.device, self.packed), wp.ScopedStream(self.stream):
            self._settling = wp.array(settling, dtype=relax.Settling, device=self.device)
            self._settling_now = settling.copy()

    def settle(self, block: int) -> list[Future[None]]:
        """Starts up to `block` steps of relaxation of every variant that has not settled."""

        kernels = self._ready("relax")

        def work() -> None:
            with _told(self.device, self.packed):
                for bucket, kernel in zip(self.buckets, kernels, strict=True):
                    inputs = [self.ensemble, self.state, self.tallies, self._settling, bucket.order, block]
                    self._launch(kernel, bucket, inputs)
                self._settling_now = self._read(self._settling)

        return [self._pool.submit(work)]

    def settling(self) -> NDArray[Any]:
        """The state of each variant's relaxation after the last launch."""
        return self._settling_now

    def rollers(self) -> NDArray[np.floating]:
        """Copy of the rollers' rows, as in `Packed.rollers`."""
        return self._read(self.state.rollers)

    def progress(self) -> NDArray[Any]:
        """(variants,) `structs.Progress` after the last launch."""
        return self._progress

    def sums(self) -> dict[str, NDArray[Any]]:
        """The window's sums, by name as in `kernels.sum_structs.Sums`."""
        with _told(self.device, self.packed), wp.ScopedStream(self.stream):
            sums = empty_sums(self.packed, self.device)
            for name in ("strand", "sprocket", "mount"):
                wp.copy(getattr(sums, name), getattr(self.gpu_sums, name))
            wp.launch(
                collect, dim=self.packed.variants, inputs=[self.ensemble.drives, self.tallies, sums], device=self.device
            )
            return {name: np.array(getattr(sums, name).numpy(), copy=True) for name in SUMS}

    def frame_buffer(self, values: int) -> FrameBuffer:
        """A buffer for a block's frames."""
        with _told(self.device, self.packed):
            return FrameBuffer(values, self.packed.real, self.device)

    def close(self) -> None:
        """Waits for what is under way."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        wp.synchronize_device(self.device)
