"""Which kernels the variants of an ensemble take on a GPU, and what a GPU does not take.

Variants with like numbers of rollers, sprockets and so on go into one launch: a bucket.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.block_shape import MANY, ROOMS, BlockShape, block_shape, room_for, row_of
from warpchain.engine.packed import Packed
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.kind import DECLARED, BlockKind
from warpchain.kernels.gpu.near_mask import BITS
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.shared_memory import asked_of_a_block, room
from warpchain.kernels.structs import GROUND

MOST_LINKS = 16 * ROOMS[-1]
"""Links of the longest chain: each thread's rollers are gone through in unrolled loops."""

MOST_PARTNERS = BITS
"""Sprockets and guide-bars of one drive: which of them a roller is near is kept in the bits of an int."""

RESERVED = 1024
"""Bytes of a multiprocessor's shared memory that each block takes beside its own."""

NUMBERS = ("slots", "sprockets", "guides", "arms", "tensioners", "led")
"""What buckets differ in by a number; in all else by yes or no."""


def refusal(packed: Packed, first: int = 0) -> str | None:
    """Why a GPU cannot run this ensemble, None if it can; `first` is what variant 0 is called."""
    found = _refused(packed)
    return None if found is None else f'variant {first + found[0]}: {found[1]}; use device="cpu"'


def _refused(packed: Packed) -> tuple[Any, str] | None:
    """A variant that a GPU cannot run, and why."""
    drives = packed.drives
    for v in np.flatnonzero(drives["rollers"] > MOST_LINKS):
        return v, f"chain.links = {drives['rollers'][v]}: a GPU takes up to {MOST_LINKS}"
    partners = drives["sprockets"] + drives["guides"]
    for v in np.flatnonzero(partners > MOST_PARTNERS):
        return v, f"{partners[v]} sprockets and guide-bars: a GPU takes up to {MOST_PARTNERS}"
    guides = packed.guides[: drives["guides"].sum()]
    for g in np.flatnonzero((guides["body"] != GROUND) & (guides["pieces"] == 0)):
        v = np.flatnonzero(drives["first_guide"] <= g)[-1]
        number = g - drives["first_guide"][v]
        return v, f"guide-bar {number} is carried by a body: a GPU takes guide-bars on the ground only"
    for v in np.flatnonzero(drives["bodies"] != drives["sprockets"] + drives["arms"]):
        counts = f"{drives['bodies'][v]} bodies for {drives['sprockets'][v]} sprockets"
        return v, f"{counts}: a GPU takes no bodies but sprockets and arms"
    return None


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
        """How many variants."""
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
    """What of a kernel's kind is its blocks' shape."""
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
    """How many sprockets of each variant have their angle prescribed, (variants,)."""
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
