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

from warpchain.engine.arrays import NOTES, SUMS, empty_sums, empty_tallies, upload_ensemble, upload_state
from warpchain.engine.block_shape import MANY, ROOMS, BlockShape, block_shape, room_for
from warpchain.engine.lanes import Phase, cut, groups
from warpchain.engine.packed import Packed
from warpchain.errors import SimulationError
from warpchain.kernels import relaxation
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kind import BlockKind
from warpchain.kernels.gpu.block_observe import collect
from warpchain.kernels.gpu.block_relax import block_relax_kernel
from warpchain.kernels.gpu.exchange import room
from warpchain.kernels.structs import DIVERGENCE_CHECK, GROUND

MOST_LINKS = 16 * ROOMS[-1]
"""Links of the longest chain: each thread's rollers are gone through in unrolled loops."""

MOST_PARTNERS = 31
"""Sprockets and guide-bars of one drive: which of them a roller is near is kept in the bits of an int."""

OLDEST = 70
"""Oldest architecture (compute capability times ten) that the kernels are compiled for."""

FRAME_BYTES = 32 * 2**20
"""Most bytes of frames of one launch: pinned memory takes long to get, and small copies hide behind the next steps."""

LAUNCH_WORK = 1.0e10
"""Roller-steps of one launch, about a third of a second, so that progress shows and Ctrl-C is heard."""

STREAMS = 4
"""On which launches of unlike variants go side by side."""

LAUNCH_STEPS = 131_072
"""Most steps of one launch, about a quarter of a second for a single variant."""


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
    for v in np.flatnonzero(drives["rollers"] > MOST_LINKS):
        return f'variant {v}: chain.links = {drives["rollers"][v]}: a GPU takes up to {MOST_LINKS}; use device="cpu"'
    partners = drives["sprockets"] + drives["guides"]
    for v in np.flatnonzero(partners > MOST_PARTNERS):
        return (
            f'variant {v}: {partners[v]} sprockets and guide-bars: a GPU takes up to {MOST_PARTNERS}; use device="cpu"'
        )
    guides = packed.guides[: drives["guides"].sum()]
    for g in np.flatnonzero((guides["body"] != GROUND) & (guides["pieces"] == 0)):
        v = np.flatnonzero(drives["first_guide"] <= g)[-1]
        return (
            f"variant {v}: guide-bar {g - drives['first_guide'][v]} is carried by a body: a GPU takes guide-bars on "
            'the ground only; use device="cpu"'
        )
    for v in np.flatnonzero(drives["bodies"] != drives["sprockets"] + drives["arms"]):
        return (
            f"variant {v}: {drives['bodies'][v]} bodies for {drives['sprockets'][v]} sprockets: a GPU takes no bodies "
            'but sprockets and arms; use device="cpu"'
        )
    return None


@contextmanager
def _memory_named(device: str, packed: Packed) -> Iterator[None]:
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
    """A launch's frames: on the device, and in the host's memory once `numpy` is called."""

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

    shape: BlockShape
    sprockets: int
    guides: int
    moving: bool
    rk4: bool
    sliding: bool
    bending: bool
    uneven: bool
    arms: int
    tensioners: int
    profiles: bool
    curved: bool
    variants: NDArray[np.integer]
    order: wp.array  # of the variants, on the device
    stribeck: bool = True
    pushing: bool = True

    @property
    def count(self) -> int:
        """How many variants."""
        return len(self.variants)


def kernel_shape(name: str, bucket: Bucket) -> BlockShape:
    """The shape of a bucket's blocks; settling's does not depend on the number of variants."""
    if name == "relax":
        return block_shape(bucket.shape.room, MANY, bucket.shape.shared_bytes)
    return bucket.shape


def kernel_kind(name: str, real: Any, bucket: Bucket) -> BlockKind:
    """The kind of a bucket's kernel: "advance" takes no metrics, "measure" does, "relax" settles."""
    shape = kernel_shape(name, bucket)
    steps = name != "relax"
    return BlockKind(
        real,
        shape.threads,
        shape.per,
        bucket.sprockets,
        bucket.guides,
        moving=steps and bucket.moving,
        measuring=name == "measure",
        rk4=steps and bucket.rk4,
        sliding=steps and bucket.sliding,
        bending=steps and bucket.bending,
        uneven=bucket.uneven,
        arms=bucket.arms,
        tensioners=bucket.tensioners,
        profiles=bucket.profiles,
        curved=bucket.curved,
        stribeck=bucket.stribeck,
        pushing=bucket.pushing,
        crewed=shape.crewed,
        roomy=name == "advance" and shape.roomy,
        shared_bytes=shape.shared_bytes,
    )


def curved(packed: Packed) -> NDArray[np.bool_]:
    """Which variants have tables of motion or load, (variants,); all at float64, where no kernel asks."""
    motions = packed.motions
    counts = motions["drive_table"]["cells"] + motions["load_table"]["cells"]
    return (np.add.reduceat(counts, packed.drives["first_body"]) > 0) | (packed.precision == "float64")


def pushing(packed: Packed) -> NDArray[np.bool_]:
    """Which variants have tensioners that push sprockets, (variants,); all at float64, where no kernel asks."""
    owner = np.repeat(np.arange(packed.variants), packed.drives["tensioners"])
    on_sprockets = packed.tensioners["body"] < packed.drives["sprockets"][owner]
    counts = np.bincount(owner[on_sprockets], minlength=packed.variants)
    return (counts > 0) | (packed.precision == "float64")


def rows_apart(real: Any, buckets: Sequence[Bucket]) -> tuple[int, int, int]:
    """Values, integers and values of parts that blocks too large for shared memory keep in global memory."""
    needs = np.zeros(3, dtype=int)
    for bucket in buckets:
        for name in ("advance", "measure", "relax"):
            of = room(kernel_kind(name, real, bucket))
            needs = np.maximum(needs, bucket.count * np.array([of.values, of.integers, of.part_values]))
    return int(needs[0]), int(needs[1]), int(needs[2])


def _distinct(keys: NDArray[np.integer]) -> list[tuple[Any, ...]]:
    """The different rows of some keys, the largest first."""
    differ = (keys != keys[0]).any(axis=0)
    rows = np.unique(keys[:, differ], axis=0, return_index=True)[1] if differ.any() else np.zeros(1, dtype=int)
    return sorted((tuple(row) for row in keys[rows].tolist()), reverse=True)


class GpuKernels:
    """The kernels that an ensemble takes on a GPU.

    Args:
        packed: the ensemble.
        device: such as "cuda:0".
    """

    def __init__(self, packed: Packed, device: str) -> None:
        self.packed, self.device = packed, device
        self._processors = int(wp.get_device(device).sm_count)
        self._kernels: dict[Any, Any] = {}
        drives = packed.drives
        measuring = bool((drives["window_start"] < drives["steps"]).any())
        self._names = ("advance", "measure") if measuring else ("advance",)
        self.buckets = self._bucketed()

    def _bucketed(self) -> list[Bucket]:
        """The variants by kernel, the longest first."""
        drives = self.packed.drives
        moving = np.add.reduceat(self.packed.mounts["active"], drives["first_body"]) > 0
        slots = room_for(drives["rollers"])
        partners = [slots, drives["sprockets"], drives["guides"]]
        rubs = [self.packed.slides, self.packed.joints["rubs"]]
        kinds = [*rubs, self.packed.links["uneven"], drives["arms"], drives["tensioners"], drives["pieces"] > 0]
        kinds = [*kinds, curved(self.packed), pushing(self.packed), self.packed.stribeck]
        keys = np.column_stack([*partners, moving, drives["integrator"], *kinds])
        processors = self._processors
        most_shared = int(wp.get_device(self.device).max_shared_memory_per_block)
        buckets = []
        for key in _distinct(keys):
            order = np.flatnonzero((keys == key).all(axis=1))
            order = order[np.argsort(drives["sample_every"][order] == 0, kind="stable")]  # recorded ones take longer
            slots, sprockets, guides, moves, rk4, slides, bends, uneven, arms, tensioners, *others = key
            plain = not (moves or slides or bends or arms)  # for others two warps were not faster, or not measured
            precision = self.packed.precision if plain else "float64"
            shape = block_shape(slots, len(order) // processors, most_shared, precision)
            array: wp.array = wp.array(order, dtype=wp.int32, device=self.device)
            flags = bool(moves), bool(rk4), bool(slides), bool(bends), bool(uneven)
            profiles, curves, pushes, law = map(bool, others)
            bodies = arms, tensioners, profiles, curves
            buckets.append(Bucket(shape, sprockets, guides, *flags, *bodies, order, array, law, pushes))
        return buckets

    def _blocks(self, name: str, bucket: Bucket) -> int:
        """Blocks of a bucket's kernel that a multiprocessor is to hold."""
        each = 2**31 if name == "relax" else -(-bucket.count // self._processors)
        return kernel_shape(name, bucket).resident(self.packed.precision, name == "measure", each)

    def _made(self, name: str, bucket: Bucket) -> Any:
        """A bucket's kernel: "advance" takes no metrics, "measure" does, "relax" settles."""
        kind, blocks = kernel_kind(name, self.packed.real, bucket), self._blocks(name, bucket)
        if (name, kind) not in self._kernels:
            frame = self.packed.frame
            kernel = block_relax_kernel(kind, blocks) if name == "relax" else block_kernel(kind, blocks, frame)
            self._kernels[name, kind] = kernel
        return self._kernels[name, kind]

    def modules(self, *names: str) -> list[tuple[Any, int]]:
        """The modules of the kernels of these names, by default of those that take steps, and their threads a block.

        They are made by the calling thread, as they share functions.
        """
        pairs = [(bucket, name) for bucket in self.buckets for name in names or self._names]
        return [(self._made(name, bucket).module, kernel_shape(name, bucket).threads) for bucket, name in pairs]


class GpuEngine(GpuKernels):
    """Steps an ensemble on one GPU.

    Args:
        packed: the ensemble.
        device: such as "cuda:0".

    Raises:
        SimulationError: if the GPU's memory does not hold the ensemble.
    """

    def __init__(self, packed: Packed, device: str) -> None:
        self._loaded: set[str] = set()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=f"warpchain {device}")
        with _memory_named(device, packed):
            self.stream, self.copies, *self._others = (wp.Stream(device) for _ in range(STREAMS + 1))
            with wp.ScopedStream(self.stream):
                super().__init__(packed, device)
                self.ensemble = upload_ensemble(packed, device)
                self.state = upload_state(packed, device, rows_apart(packed.real, self.buckets))
                self.gpu_sums = empty_sums(packed, device)
                self.tallies = empty_tallies(packed, device)
            wp.synchronize_stream(self.stream)
        self._progress = np.zeros(packed.variants, dtype=self.state.progress.dtype.numpy_dtype())
        self._settling: Any = None
        drives = packed.drives
        windows = {name: np.ascontiguousarray(drives[name]) for name in ("window_start", "window_end")}
        # rows in global memory, which launches share
        self._apart = [any(rows_apart(packed.real, [bucket])) for bucket in self.buckets]
        self._windows = [{name: of[bucket.variants] for name, of in windows.items()} for bucket in self.buckets]
        self._settling_now: NDArray[Any] = np.zeros(0)

    def _load(self, *names: str) -> None:
        """Compiles and loads the kernels of these names, once, side by side."""
        if self._loaded.issuperset(names):
            return
        jobs = self.modules(*names)
        with ThreadPoolExecutor(8) as pool:
            load = [pool.submit(wp.load_module, module, device=self.device, block_dim=dim) for module, dim in jobs]
            for loading in load:
                loading.result()
        self._loaded.update(names)

    def _phases(self, number: int, steps: int) -> list[Phase]:
        """How to take the bucket of a number `steps` steps on: kernel, steps, and steps before in this call.

        What takes metrics is slower, so it runs from where the first window begins to where the last one ends.
        """
        windows, progress = self._windows[number], self._progress[self.buckets[number].variants]
        alive = (progress["diverged"] == 0) & (windows["window_end"] >= progress["step"])
        until = np.maximum(windows["window_start"] - progress["step"], 0)[alive].min(initial=steps)
        bare = steps if until >= steps else int(until) // int(DIVERGENCE_CHECK) * int(DIVERGENCE_CHECK)
        phases = [("advance", bare, 0), ("measure", steps - bare, bare)]
        return [phase for phase in phases if phase[1] > 0]

    def _launch(self, kernel: Any, threads: int, order: wp.array, inputs: Sequence[Any], stream: wp.Stream) -> None:
        dim = len(order) * threads
        wp.launch(kernel, dim=dim, inputs=[*inputs], block_dim=threads, device=self.device, stream=stream)

    def _lanes(self, steps: int) -> list[tuple[bool, Bucket, wp.array, list[Phase]]]:
        """Variants whose launches follow one another: whether beside others, bucket, place in it, and launches."""
        lanes = []
        for number, bucket in enumerate(self.buckets):
            phases = self._phases(number, steps)
            apart = self._apart[number]
            turn = bucket.count if apart or not phases else self._blocks(phases[-1][0], bucket) * self._processors
            parts = groups(bucket.count, turn)
            if len(parts) > 1:
                phases = cut(phases, int(DIVERGENCE_CHECK))
            lanes += [(not apart, bucket, bucket.order[first : first + count], phases) for first, count in parts]
        return lanes

    def advance(self, steps: int, frames: FrameBuffer) -> list[Future[None]]:
        """Starts `steps` steps of every variant that has not ended; frames go to `frames`."""
        self._load(*self._names)

        def work() -> None:
            with _memory_named(self.device, self.packed):
                if frames.copied is not None:
                    self.stream.wait_event(frames.copied)
                begun = self.stream.record_event()
                for stream in self._others:
                    stream.wait_event(begun)
                state = self.ensemble, self.state, self.gpu_sums, self.tallies, frames.device
                for at, (beside, bucket, order, phases) in enumerate(self._lanes(steps)):
                    stream = [self.stream, *self._others][at % STREAMS if beside else 0]
                    for name, taken, before in phases:
                        kernel = self._made(name, bucket)
                        self._launch(kernel, bucket.shape.threads, order, [*state, order, taken, before], stream)
                for stream in self._others:
                    self.stream.wait_event(stream.record_event())
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
        """Takes the state of each variant's relaxation, (variants,) `kernels.relaxation.Settling`."""
        with _memory_named(self.device, self.packed), wp.ScopedStream(self.stream):
            self._settling = wp.array(settling, dtype=relaxation.Settling, device=self.device)
            self._settling_now = settling.copy()

    def settle(self, steps: int) -> list[Future[None]]:
        """Starts up to `steps` steps of relaxation of every variant that has not settled."""
        self._load("relax")

        def work() -> None:
            with _memory_named(self.device, self.packed):
                for bucket in self.buckets:
                    inputs = [self.ensemble, self.state, self.tallies, self._settling, bucket.order, steps]
                    threads = kernel_shape("relax", bucket).threads
                    self._launch(self._made("relax", bucket), threads, bucket.order, inputs, self.stream)
                self._settling_now = self._read(self._settling)

        return [self._pool.submit(work)]

    def settling(self) -> NDArray[Any]:
        """The state of each variant's relaxation after the last launch."""
        return self._settling_now

    def rollers(self) -> NDArray[np.floating]:
        """Copy of the rollers' rows, as in `Packed.rollers`."""
        return self._read(self.state.rollers)

    def bodies(self) -> NDArray[Any]:
        """Copy of the bodies' states, as in `Packed.bodies`."""
        return self._read(self.state.bodies)

    def progress(self) -> NDArray[Any]:
        """(variants,) `structs.Progress` after the last launch."""
        return self._progress

    def sums(self) -> dict[str, NDArray[Any]]:
        """The window's sums, by name as in `kernels.sum_structs.Sums`."""
        with _memory_named(self.device, self.packed), wp.ScopedStream(self.stream):
            sums = empty_sums(self.packed, self.device)
            for name in ("chain", "strand", "sprocket", "mount", "arm", "tensioner", "slip", "tension_counts", *NOTES):
                wp.copy(getattr(sums, name), getattr(self.gpu_sums, name))
            wp.launch(
                collect, dim=self.packed.variants, inputs=[self.ensemble.drives, self.tallies, sums], device=self.device
            )
            return {name: np.array(getattr(sums, name).numpy(), copy=True) for name in SUMS}

    def single_engines(self) -> list[tuple[GpuEngine, int]]:
        """The engines that this one is made of, with the number of each one's first variant."""
        return [(self, 0)]

    def held(self) -> dict[str, Any]:
        """What variants change, by the groups of `engine.states`."""
        return {"state": self.state, "sums": self.gpu_sums, "tallies": self.tallies}

    def fetch(self, array: wp.array) -> NDArray[Any]:
        """A copy of one of these arrays."""
        return self._read(array)

    def put(self, array: wp.array, values: NDArray[Any]) -> None:
        """Sets one of these arrays."""
        with wp.ScopedStream(self.stream):
            array.assign(values)
        wp.synchronize_stream(self.stream)
        self._progress = self._read(self.state.progress)

    def frame_buffer(self, values: int) -> FrameBuffer:
        """A buffer for a launch's frames."""
        with _memory_named(self.device, self.packed):
            return FrameBuffer(values, self.packed.real, self.device)

    def close(self) -> None:
        """Waits for what is under way."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        wp.synchronize_device(self.device)
