"""Kernels that the variants of an ensemble take on a GPU.

Variants with like numbers of rollers, sprockets and so on go into one launch: a bucket. The shape of a bucket's blocks
says how many threads of a GPU one variant gets, and how many of its rollers each of them has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.compiling import Wanted
from warpchain.engine.packed import Packed
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.kind import DECLARED, WARP, BlockKind, BlockShape, Friction, Parts
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.shared_memory import asked_of_a_block, room
from warpchain.kernels.gpu.statistics import collect_kernel

ROOMS = (32, 64, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 896, 1024)
"""Rollers that blocks have room for; beyond, sixteenths of the next power of two, from 4,096 on whole 1,024."""

LONGEST_ON_A_WARP = 512
"""Links of the longest chain that one warp may have to itself."""

FEW = 1
"""Most variants a multiprocessor that are few: each has a roller a thread, and a warp for its bodies alone."""

VARIANTS_PER_BLOCK = 4
"""Variants of a block, a warp each, where going through the same code at the same time makes them faster."""

FULL_OF_OIL = 11
"""Variants of a block, a warp each, whose oil another warp has: with that one they take all of a multiprocessor."""

FULL_WITH_METRICS = 7
"""The same with metrics at float64: of 11, registers spill (10,000 `car` took 21.2 s, of 7 18.5)."""

FULL_AT_FLOAT32 = 15
"""The same of kernels that want fewer registers, at float32 without metrics."""

COLLECTING = 256
"""Threads of a block that adds up what the others have noted."""

CAMS = 8
"""A kernel has room for a multiple of so many cams of valves."""

RESERVED = 1024
"""Bytes of a multiprocessor's shared memory that each block takes beside its own."""


def room_for(links: NDArray[np.integer]) -> NDArray[np.integer]:
    """The rollers that blocks for chains of so many links have room for, so that like chains share a kernel."""
    most = ROOMS[-1]
    step = np.minimum(2 ** np.ceil(np.log2(np.maximum(links, most))).astype(int) // 8, most)
    return np.where(links > most, -(-links // step) * step, np.array(ROOMS)[np.searchsorted(ROOMS[:-1], links)])


def block_shape(room: int, each: int, shared_bytes: int = DECLARED) -> BlockShape:
    """The block for chains of up to `room` links, as from `room_for`, of which a multiprocessor gets `each` variants.

    There are two: few variants are fastest with a roller a thread, many on a warp each, which then waits for no other.
    Moments on bodies are added up in the same order either way, so a variant's results do not depend on how many there
    are beside it. Longer chains have up to 16 rollers a thread and `shared_bytes` of memory, however many they are.
    """
    if room > LONGEST_ON_A_WARP:
        threads = 1024 if room > 4096 else max(128, 2 ** (room - 1).bit_length() // 16)
        return BlockShape(threads, -(-room // threads), shared_bytes=shared_bytes)
    if each > FEW:
        return BlockShape(WARP, -(-room // WARP))
    return BlockShape(room + WARP, 1)


def is_simple(kind: BlockKind) -> bool:
    """Whether kernels of a kind are as short as can be, but for friction at float32."""
    rubs = kind.friction.contacts or kind.friction.joints
    more = kind.moving or kind.staged or kind.links == "varied" or kind.parts.arms or kind.parts.tied or kind.profiles
    return kind.linear_hysteretic and not more and (kind.paired or not rubs)


def resident(kind: BlockKind) -> int:
    """Number of variants that the compiler is to make room for on a multiprocessor, which bounds a thread's registers.

    Taking metrics wants more of them, and of shared memory, and kernels of simple drives fewer. What is best was
    measured on an H200 and an H100 (docs/kernels.md).
    """
    shape, per = kind.shape, kind.shape.rollers_per_thread
    if shape.oil_warp:
        return shape.variants_per_block
    if shape.variants_per_block > 1:
        return 20 if per <= 4 and not (kind.friction.contacts or kind.friction.joints) else 16
    if shape.threads == WARP:
        if not is_simple(kind):
            long = kind.parts.hubs or kind.parts.rings > 1 or (not kind.paired and (kind.moving or kind.profiles))
            return 8 if per > 6 or long or kind.measuring else 12  # or registers spill
        if kind.paired:
            return 20 if per <= 4 else 16 if per <= 6 else 8 if kind.measuring else 12
        return 14 if per <= (4 if kind.measuring else 6) else 12 if per <= 6 else 8
    if per > 1:
        most = 2 if per > 8 else 4 if kind.paired else 3
        return max(1, most * 128 // shape.threads)
    return FEW


@dataclass(frozen=True)
class Bucket:
    """Variants that share kernels.

    Attributes:
        kind: of the kernel that takes steps without metrics.
        variants: their numbers, of several chains the rows of the first.
        order: the same, on the device.
        most_shared: bytes of shared memory that a block may have on the device.
        each: variants that a multiprocessor gets.
    """

    kind: BlockKind
    variants: NDArray[np.integer]
    order: wp.array
    most_shared: int = DECLARED
    each: int = 1

    @property
    def count(self) -> int:
        """Number of variants."""
        return len(self.variants)


def sharing_blocks(kind: BlockKind, most_shared: int, each: int) -> BlockKind:
    """A kind, several variants a block where that was measured to be faster: long code, fetched once for all of them,
    or oil, which a warp of its own then has, where a multiprocessor gets more variants than it holds by themselves.

    It must have memory for as many as it is to hold.
    """
    shape = kind.shape
    if kind.parts.oil and shape.threads == WARP:
        most = FULL_AT_FLOAT32 if kind.paired else FULL_OF_OIL
        if kind.measuring:
            most = FULL_OF_OIL if kind.paired else FULL_WITH_METRICS
        oiled = replace(kind, shape=replace(shape, variants_per_block=most, oil_warp=True))
        fits = most * kind.parts.tensioners <= WARP and asked_of_a_block(oiled) <= most_shared
        return oiled if fits and each > resident(kind) else kind
    long = kind.measuring or shape.rollers_per_thread > 4
    if not (kind.paired and shape.threads == WARP and shape.rollers_per_thread <= 6 and long and is_simple(kind)):
        return kind
    several = replace(kind, shape=replace(shape, variants_per_block=VARIANTS_PER_BLOCK))
    needed = asked_of_a_block(several) + RESERVED
    return several if resident(several) // VARIANTS_PER_BLOCK * needed <= most_shared + RESERVED else kind


def kernel_kind(name: str, bucket: Bucket) -> BlockKind:
    """The kind of a bucket's kernel: "advance" takes no metrics, "measure" does, "relax" settles."""
    kind = bucket.kind
    if name == "relax":  # by one kernel, however many there are and whatever else they have
        parts = replace(kind.parts, prescribed=1, tabulated=1, tied=0, crowded=0, oil=0, fed=0, valves=0, rings=1)
        links = "varied" if kind.links == "varied" else "lengths"
        shape = block_shape(kind.shape.room, FEW + 1, kind.shape.shared_bytes)
        moving = bool(parts.hubs)
        return BlockKind(kind.Real, shape, parts, moving=moving, profiles=kind.profiles, links=links)
    return sharing_blocks(replace(kind, measuring=name == "measure"), bucket.most_shared, bucket.each)


TOGETHER = {
    np.add: ("sprockets", "guides", "arms", "tensioners", "prescribed", "others", "valves"),
    np.minimum: ("linear_hysteretic",),
}
"""How columns of several chains become those of their variant; the others by `np.maximum`."""


def kind_columns(packed: Packed) -> dict[str, NDArray[Any]]:
    """The properties that decide the kernels which take variants on, (variants,) each."""
    rings, begins, columns = packed.drives["rings"], packed.begins, chain_columns(packed)
    if len(begins) == packed.variants:
        return columns
    several = rings[begins] > 1
    ways = {name: way for way, names in TOGETHER.items() for name in names}
    whole = {name: ways.get(name, np.maximum).reduceat(values, begins) for name, values in columns.items()}
    whole["room"] = room_for(np.add.reduceat(packed.drives["rollers"], begins))
    prescribed = np.add.reduceat(packed.motions["prescribed"], packed.drives["first_body"][begins])
    whole |= {"prescribed": np.maximum(prescribed, 1), "tied": whole["tied"] | several, "rings": rings[begins]}
    return whole


def chain_columns(packed: Packed) -> dict[str, NDArray[Any]]:
    """The same of each chain by itself, (rows,): of kernels that settle it, or that take on a variant with no other."""
    drives = packed.drives
    cells = packed.motions["drive_table"]["cells"] + packed.motions["load_table"]["cells"]
    cells = cells + packed.mounts["x_table"]["cells"] + packed.mounts["y_table"]["cells"]
    return {
        "room": room_for(drives["rollers"]),
        "sprockets": drives["sprockets"],
        "guides": drives["guides"],
        "arms": drives["arms"],
        "tensioners": drives["tensioners"],
        "prescribed": np.maximum(np.add.reduceat(packed.motions["prescribed"], drives["first_body"]), 1),
        "others": drives["bodies"] - drives["sprockets"] - drives["arms"],
        "tabulated": np.add.reduceat(cells, drives["first_body"]) > 0,
        "tied": drives["tied"],
        "hubs": drives["hubs"] + drives["jointed"],
        "crowded": packed.crowded_arms,
        "oil": packed.oiled,
        "fed": packed.fed,
        "valves": CAMS * -(-packed.cams // CAMS),
        "rings": np.ones_like(drives["rings"]),
        "integrator": drives["integrator"],
        "moving": (np.add.reduceat(packed.mounts["active"], drives["first_body"]) > 0) | (drives["hubs"] > 0),
        "profiles": packed.carried_guides,
        "contacts": packed.sliding,
        "joints": packed.rubbing,
        "links": np.where(packed.varied_links, 2, 1 - packed.uniform_links),
        "linear_hysteretic": packed.linear_hysteretic,
    }


def kind_of(real: type, columns: Mapping[str, int], each: int, shared_bytes: int = DECLARED) -> BlockKind:
    """The kind of kernel of a variant with such columns (`kind_columns`), of which a multiprocessor gets `each`."""
    counts = {field.name: int(columns[field.name]) for field in fields(Parts)}
    return BlockKind(
        real,
        block_shape(int(columns["room"]), each, shared_bytes),
        Parts(**counts),
        integrator=int(columns["integrator"]),
        moving=bool(columns["moving"]),
        profiles=bool(columns["profiles"]),
        friction=Friction(int(columns["contacts"]), int(columns["joints"])),
        links=("alike", "lengths", "varied")[int(columns["links"])],
        linear_hysteretic=bool(columns["linear_hysteretic"]),
    )


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
    """A kernel of a bucket, its kind, how many variants a multiprocessor is to hold of it, and what makes it."""

    kernel: Any
    kind: BlockKind
    resident: int
    wanted: Wanted


class GpuKernels:
    """The kernels that an ensemble takes on a GPU.

    Args:
        packed: the ensemble.
        device: such as "cuda:0".

    Attributes:
        buckets: the variants by the kernels that take them on.
        chains: their chains by the kernels that settle them, each by itself.
    """

    def __init__(self, packed: Packed, device: str) -> None:
        self.packed, self.device = packed, device
        self._processors = int(wp.get_device(device).sm_count)
        self._most_shared = int(wp.get_device(device).max_shared_memory_per_block)
        self._kernels: dict[tuple[str, int], Made] = {}
        drives = packed.drives
        measuring = bool((drives["window_start"] < drives["steps"]).any())
        self._names = ("measure", "advance") if measuring else ("advance",)  # what takes longest to compile first
        self.buckets = self._bucketed(kind_columns(packed), packed.begins)
        alone = len(packed.begins) == packed.variants
        self.chains = self.buckets if alone else self._bucketed(chain_columns(packed), np.arange(packed.variants))

    def _bucketed(self, columns: Mapping[str, NDArray[Any]], rows: NDArray[np.integer]) -> list[Bucket]:
        """The variants, or chains, that begin at these rows, by kernel, the longest first."""
        packed = self.packed
        keys = np.column_stack(list(columns.values()))
        buckets = []
        for key in _distinct(keys):
            order = rows[(keys == key).all(axis=1)]
            recorded = packed.drives["sample_every"][order] > 0
            order = order[np.argsort(~recorded, kind="stable")]  # which take longer
            array: wp.array = wp.array(order, dtype=wp.int32, device=self.device)
            each = -(-len(order) // self._processors)
            kind = kind_of(packed.real, dict(zip(columns, key, strict=True)), each, self._most_shared)
            if packed.frame.holds("hub_force"):  # which kernels of moving bodies sum up at every step
                kind = replace(kind, moving=True)
            buckets.append(Bucket(kind, order, array, self._most_shared, each))
        return buckets

    def _made(self, name: str, bucket: Bucket) -> Made:
        """A bucket's kernel: "advance" takes no metrics, "measure" does, "relax" settles."""
        key = name, id(bucket)
        if key not in self._kernels:
            kind = kernel_kind(name, bucket)
            held = resident(kind)
            settling = name == "relax"
            factory = block_relax_kernel if settling else block_kernel
            form = (kind, held) if settling else (kind, held, self.packed.frame)
            self._kernels[key] = Made(factory(*form), kind, held, Wanted(factory, form, kind.shape.block_threads))
        return self._kernels[key]

    def buckets_of(self, name: str) -> list[Bucket]:
        """The buckets that a kernel of this name is launched for."""
        return self.chains if name == "relax" else self.buckets

    def wanted(self, *names: str) -> list[Wanted]:
        """The kernels of these names, by default of those that take steps, with which goes what adds up their sums.

        They are made by the calling thread, as they share functions.
        """
        made = [self._made(name, of) for name in names or self._names for of in self.buckets_of(name)]
        blocks = [of.wanted for of in made]
        return blocks if names else [*blocks, Wanted(collect_kernel, (self.packed.real,), COLLECTING)]
