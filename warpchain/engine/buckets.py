"""Kernels that the variants of an ensemble take on a GPU.

Variants with like numbers of rollers, sprockets and so on go into one launch: a bucket. The shape of a bucket's blocks
says how many threads of a GPU one variant gets, and how many of its rollers each of them has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.packed import Packed
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.kind import DECLARED, WARP, BlockKind
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.shared_memory import asked_of_a_block, room

ROOMS = (32, 64, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 896, 1024)
"""Rollers that blocks have room for; beyond, sixteenths of the next power of two, from 4,096 on whole 1,024."""

LONGEST_ON_A_WARP = 512
"""Links of the longest chain that one warp may have to itself."""

MANY = 6
"""Variants a multiprocessor from which a warp each is faster (docs/performance.md)."""

LOW_OCCUPANCY = 8
"""Most variants a multiprocessor at which a thread of theirs has registers for two contacts at once."""

VARIANTS_PER_BLOCK = 4
"""Variants of a block, a warp each, where going through the same code at the same time makes them faster."""

ROW = 16
"""Variants that a multiprocessor holds where they are abreast, and fewest where they are."""

LONGER_ROW = 20
"""The same of kernels that are short enough for the registers that threads then have, 96."""

BODY_WARP = 2
"""Most variants a multiprocessor at which each may have a warp for its bodies alone."""


@dataclass(frozen=True, order=True)
class BlockShape:
    """Threads of a block, and how many rollers each has at most."""

    threads: int
    rollers_per_thread: int
    body_warp: bool = False
    """Whether the last warp has no rollers, but moves the bodies."""
    shared_bytes: int = DECLARED
    """Most of shared memory that a block may have."""
    low_occupancy: bool = False
    """Whether so few are on a multiprocessor that a thread has registers for two contacts at once."""

    @property
    def slots(self) -> int:
        """Rollers that the threads could have."""
        return self.threads * self.rollers_per_thread

    @property
    def room(self) -> int:
        """Rollers that there is room for."""
        return self.slots - 32 * self.body_warp

    def variants_per_block(self, precision: str, measuring: bool, each: int, simple: bool) -> int:
        """Number of variants of a block, where a multiprocessor gets `each`; arguments as in `resident`.

        One on a warp has its own block unless several were measured to be faster: long code at float32, which is
        fetched once for all that are abreast.
        """
        if precision != "float32" or self.threads != WARP or self.rollers_per_thread > 6 or each < ROW or not simple:
            return 1
        return VARIANTS_PER_BLOCK if measuring or self.rollers_per_thread > 4 else 1

    def resident(self, precision: str, measuring: bool, wanted: int, simple: bool = False, row: int = 0) -> int:
        """Number of variants that the compiler is to make room for on a multiprocessor, `wanted` at most.

        This bounds the registers of a thread; taking metrics wants more of them, and of shared memory, and kernels of
        drives that are `simple` (`buckets.Bucket`) fewer. Where variants are abreast it holds `row`, which else is 0.
        What is best was measured on an H200 (docs/performance.md).
        """
        if row:
            most = row
        elif self.threads == WARP:
            most = {
                ("float64", False): (12, 12, 8),
                ("float64", True): (12, 12, 8),
                ("float32", False): (20, 16, 12),
                ("float32", True): (20, 16, 8),
            }[precision, measuring][(self.rollers_per_thread > 4) + (self.rollers_per_thread > 6)]
            if simple and precision == "float64" and self.rollers_per_thread <= (4 if measuring else 6):
                most = 14
        elif self.slots > LONGEST_ON_A_WARP and self.rollers_per_thread > 1:
            most = 2 if self.rollers_per_thread > 8 else 3 if precision == "float64" else 4
            most = most * 128 // self.threads
        else:
            most = (512 if precision == "float64" and self.threads <= 160 else 768) // self.threads
        return max(1, min(most, wanted))


def row_of(kind: BlockKind) -> int:
    """Variants of a kind that a multiprocessor holds where several share a block, 0 of other kinds."""
    if kind.variants_per_block == 1:
        return 0
    return LONGER_ROW if kind.rollers_per_thread <= 4 and not (kind.contact_friction or kind.joint_friction) else ROW


def room_for(links: NDArray[np.integer]) -> NDArray[np.integer]:
    """The rollers that blocks for chains of so many links have room for, so that like chains share a kernel."""
    most = ROOMS[-1]
    step = np.minimum(2 ** np.ceil(np.log2(np.maximum(links, most))).astype(int) // 8, most)
    return np.where(links > most, -(-links // step) * step, np.array(ROOMS)[np.searchsorted(ROOMS[:-1], links)])


def on_two_warps(room: int, each: int) -> bool:
    """Whether two warps a variant are fastest at float32, of `each` variants a multiprocessor (measured on an H200)."""
    return 160 < room <= 256 and 4 <= each <= 6


def block_shape(room: int, each: int, shared_bytes: int = DECLARED, precision: str = "float64") -> BlockShape:
    """The block for chains of up to `room` links, as from `room_for`, of which a multiprocessor gets `each` variants.

    Few variants are fastest with a roller a thread, and very few with a warp beside them for the bodies; of many, each
    is fastest on a warp of its own, which then waits for no other, and between these at float32 on two. Moments on
    bodies are added up in the same order either way, so a variant's results do not depend on how many there are beside
    it. Longer chains have up to 16 rollers a thread and `shared_bytes` of memory, however many they are.
    """
    if room > LONGEST_ON_A_WARP:
        threads = 1024 if room > 4096 else max(128, 2 ** (room - 1).bit_length() // 16)
        return BlockShape(threads, -(-room // threads), shared_bytes=shared_bytes)
    if precision == "float32" and on_two_warps(room, each):
        return BlockShape(64, -(-room // 64))
    if each >= MANY:
        return BlockShape(WARP, -(-room // WARP), low_occupancy=each <= LOW_OCCUPANCY and room <= 192)
    body_warp = each <= BODY_WARP and 32 < room < 512
    return BlockShape(room + 32 * body_warp, 1, body_warp)


RESERVED = 1024
"""Bytes of a multiprocessor's shared memory that each block takes beside its own."""

NUMBERS = ("slots", "sprockets", "guides", "arms", "tensioners", "led")
"""What buckets differ in by a number; in all else by yes or no."""


@dataclass(frozen=True)
class Bucket:
    """Variants that share kernels.

    Attributes:
        kind: of the kernel that takes steps without metrics.
        variants: their numbers.
        order: the same, on the device.
        each: most of them that a multiprocessor gets.
        most_shared: bytes of shared memory that a block may have on the device.
    """

    kind: BlockKind
    variants: NDArray[np.integer]
    order: wp.array
    each: int
    most_shared: int = DECLARED

    @property
    def count(self) -> int:
        """Number of variants."""
        return len(self.variants)

    @property
    def shape(self) -> BlockShape:
        """The shape of their blocks when they take steps."""
        kind = self.kind
        return BlockShape(kind.threads, kind.rollers_per_thread, kind.body_warp, kind.shared_bytes, kind.low_occupancy)

    @property
    def simple(self) -> bool:
        """Whether their kernels are as short as can be, but for friction at float32."""
        kind = self.kind
        more = kind.moving, kind.rk4, kind.varied_links, kind.arms, kind.profiles, kind.tabulated
        rubbing = kind.contact_friction or kind.joint_friction
        return kind.linear_hysteretic and not any(more) and (kind.paired or not rubbing)


def of_shape(shape: BlockShape) -> dict[str, Any]:
    """The fields of a kernel's kind that are its blocks' shape."""
    return {
        name: getattr(shape, name)
        for name in ("threads", "rollers_per_thread", "body_warp", "shared_bytes", "low_occupancy")
    }


def kernel_shape(name: str, bucket: Bucket) -> BlockShape:
    """The shape of a bucket's blocks; settling's does not depend on the number of variants."""
    if name == "relax":
        return block_shape(bucket.shape.room, MANY, bucket.shape.shared_bytes)
    return bucket.shape


def _variants_per_block(kind: BlockKind, bucket: Bucket) -> int:
    """Variants of a block of such a kernel: one, unless a multiprocessor has memory for the whole row of them."""
    precision = "float32" if kind.paired else "float64"
    wanted = bucket.shape.variants_per_block(precision, kind.measuring, bucket.each, bucket.simple)
    if wanted == 1:
        return 1
    kind = replace(kind, variants_per_block=wanted)
    needed = asked_of_a_block(kind) + RESERVED
    return wanted if row_of(kind) // wanted * needed <= bucket.most_shared + RESERVED else 1


def kernel_kind(name: str, bucket: Bucket) -> BlockKind:
    """The kind of a bucket's kernel: "advance" takes no metrics, "measure" does, "relax" settles."""
    if name == "relax":
        still = dict.fromkeys(
            ("moving", "rk4", "contact_friction", "joint_friction", "linear_hysteretic", "low_occupancy"), False
        )
        return replace(bucket.kind, **(of_shape(kernel_shape(name, bucket)) | still))
    kind = replace(bucket.kind, measuring=True, low_occupancy=False) if name == "measure" else bucket.kind
    return replace(kind, variants_per_block=_variants_per_block(kind, bucket))


def curved(packed: Packed) -> NDArray[np.bool_]:
    """Which variants have tables of motion or load, (variants,)."""
    motions = packed.motions
    counts = motions["drive_table"]["cells"] + motions["load_table"]["cells"]
    return np.asarray(np.add.reduceat(counts, packed.drives["first_body"]) > 0)


def led(packed: Packed) -> NDArray[np.integer]:
    """Number of sprockets of each variant whose angle is prescribed, (variants,)."""
    return np.asarray(np.add.reduceat(packed.motions["prescribed"], packed.drives["first_body"]))


def rows_apart(buckets: Sequence[Bucket]) -> tuple[int, int]:
    """Values, and values of parts, that blocks too large for shared memory keep in global memory."""
    needs = np.zeros(2, dtype=int)
    for bucket in buckets:
        for name in ("advance", "measure", "relax"):
            of = room(kernel_kind(name, bucket))
            needs = np.maximum(needs, bucket.count * np.array([of.values, of.part_values]))
    return int(needs[0]), int(needs[1])


def _distinct(keys: NDArray[np.integer]) -> list[tuple[Any, ...]]:
    """The different rows of some keys, the largest first."""
    differ = (keys != keys[0]).any(axis=0)
    rows = np.unique(keys[:, differ], axis=0, return_index=True)[1] if differ.any() else np.zeros(1, dtype=int)
    return sorted((tuple(row) for row in keys[rows].tolist()), reverse=True)


class Made(NamedTuple):
    """A kernel of a bucket, its kind, and how many variants a multiprocessor is to hold in its blocks."""

    kernel: Any
    kind: BlockKind
    resident: int


class GpuKernels:
    """The kernels that an ensemble takes on a GPU.

    Args:
        packed: the ensemble.
        device: such as "cuda:0".
    """

    def __init__(self, packed: Packed, device: str) -> None:
        self.packed, self.device = packed, device
        self._processors = int(wp.get_device(device).sm_count)
        self._most_shared = int(wp.get_device(device).max_shared_memory_per_block)
        self._kernels: dict[tuple[str, int], Made] = {}
        drives = packed.drives
        measuring = bool((drives["window_start"] < drives["steps"]).any())
        self._names = ("advance", "measure") if measuring else ("advance",)
        self.buckets = self._bucketed()

    def _bucketed(self) -> list[Bucket]:
        """The variants by kernel, the longest first."""
        packed, drives = self.packed, self.packed.drives
        moving = np.add.reduceat(packed.mounts["active"], drives["first_body"]) > 0
        columns = {
            "slots": room_for(drives["rollers"]),
            "sprockets": drives["sprockets"],
            "guides": drives["guides"],
            "moving": moving,
            "rk4": drives["integrator"],
            "contact_friction": packed.slides,
            "joint_friction": packed.joints["rubs"],
            "varied_links": packed.links["varied_links"],
            "arms": drives["arms"],
            "tensioners": drives["tensioners"],
            "profiles": drives["pieces"] > 0,
            "tabulated": curved(packed),
            "stribeck": packed.stribeck,
            "linear_hysteretic": packed.linear_hysteretic,
            "uniform_links": packed.uniform_links,
            "led": led(packed),
        }
        keys = np.column_stack(list(columns.values()))
        buckets = []
        for key in _distinct(keys):
            order = np.flatnonzero((keys == key).all(axis=1))
            order = order[np.argsort(drives["sample_every"][order] == 0, kind="stable")]  # recorded ones take longer
            array: wp.array = wp.array(order, dtype=wp.int32, device=self.device)
            values = {name: value if name in NUMBERS else bool(value) for name, value in zip(columns, key, strict=True)}
            each = -(-len(order) // self._processors)
            buckets.append(Bucket(self._kind(len(order), **values), order, array, each, self._most_shared))
        return buckets

    def _kind(self, count: int, slots: int, **values: Any) -> BlockKind:
        """The kind of kernel that takes `count` variants alike on, by themselves."""
        # for others two warps were not faster, or not measured
        plain = not any(values[name] for name in ("moving", "contact_friction", "joint_friction", "arms"))
        precision = self.packed.precision if plain else "float64"
        shape = block_shape(slots, count // self._processors, self._most_shared, precision)
        return BlockKind(self.packed.real, **of_shape(shape), **values)

    def _made(self, name: str, bucket: Bucket) -> Made:
        """A bucket's kernel: "advance" takes no metrics, "measure" does, "relax" settles."""
        key = name, id(bucket)
        if key not in self._kernels:
            kind, settling = kernel_kind(name, bucket), name == "relax"
            each, simple = (2**31, False) if settling else (bucket.each, bucket.simple)
            shape, precision = kernel_shape(name, bucket), self.packed.precision
            held = shape.resident(precision, name == "measure", each, simple, row_of(kind))
            kernel = block_relax_kernel(kind, held) if settling else block_kernel(kind, held, self.packed.frame)
            self._kernels[key] = Made(kernel, kind, held)
        return self._kernels[key]

    def modules(self, *names: str) -> list[tuple[Any, int]]:
        """The modules of the kernels of these names, by default of those that take steps, and their threads a block.

        They are made by the calling thread, as they share functions.
        """
        made = [self._made(name, bucket) for bucket in self.buckets for name in names or self._names]
        return [(each.kernel.module, each.kind.block_threads) for each in made]
