"""GPU kernels and blocks for an ensemble's variants, in buckets of like ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.compilation import KernelSpec
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import DECLARED, WARP, BlockKind, BlockShape, Friction, Parts
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.shared_memory import block_memory, launch_bytes_per_block
from warpchain.kernels.gpu.statistics import tally_sum_kernel

ROLLER_CAPACITIES = (32, 64, 96, 128, 160, 192, 256, 320, 384, 512, 640, 768, 896, 1024)
"""Rollers that GPU blocks hold."""

LONGEST_ON_A_WARP = 512
"""Links of the longest chain on one GPU warp."""

FEW_VARIANTS = 1
"""Most variants a multiprocessor with a thread a roller."""

VARIANTS_PER_BLOCK = 4
"""Variants of a GPU block, a warp each, if faster."""

FULL_OF_OIL = 11
"""Variants of a GPU block with a warp for oil."""

FULL_WITH_METRICS = 7
"""Variants of a GPU block with oil and metrics at float64."""

FULL_AT_FLOAT32 = 15
"""Variants of a GPU block with oil at float32."""

TALLY_SUM_THREADS = 256
"""Threads of a GPU block that sums tallies."""

CAM_STEP = 8
"""Step in the number of cams that GPU kernels hold."""

RESERVED_BYTES = 1024
"""Shared memory that each GPU block takes beside its own [bytes]."""


def roller_capacity(links: NDArray[np.integer]) -> NDArray[np.integer]:
    """Rollers that GPU blocks hold for chains of `links`."""
    most = ROLLER_CAPACITIES[-1]
    step = np.minimum(2 ** np.ceil(np.log2(np.maximum(links, most))).astype(int) // 8, most)
    return np.where(
        links > most,
        -(-links // step) * step,
        np.array(ROLLER_CAPACITIES)[np.searchsorted(ROLLER_CAPACITIES[:-1], links)],
    )


def block_shape(room: int, each: int, shared_bytes: int = DECLARED) -> BlockShape:
    """GPU block shape for chains of `room` links: few variants a roller a thread, many a warp each."""
    if room > LONGEST_ON_A_WARP:
        threads = 1024 if room > 4096 else max(128, 2 ** (room - 1).bit_length() // 16)
        return BlockShape(threads, -(-room // threads), shared_bytes=shared_bytes)
    if each > FEW_VARIANTS:
        return BlockShape(WARP, -(-room // WARP))
    return BlockShape(room + WARP, 1)


def is_simple_kind(kind: BlockKind) -> bool:
    """Whether GPU kernels of a kind are short."""
    rubs = kind.friction.contacts or kind.friction.joints
    more = (
        kind.moving
        or kind.has_stages
        or kind.links == "varied"
        or kind.parts.arms
        or kind.parts.is_tied
        or kind.profiles
    )
    return kind.linear_hysteretic and not more and (kind.is_paired or not rubs)


def resident_variants(kind: BlockKind) -> int:
    """Number of variants that a GPU's multiprocessor is to hold."""
    shape, per = kind.shape, kind.shape.rollers_per_thread
    if kind.has_oil_warp:
        return shape.variants_per_block
    if shape.variants_per_block > 1:
        return 20 if per <= 4 and not (kind.friction.contacts or kind.friction.joints) else 16
    if shape.threads == WARP:
        if not is_simple_kind(kind):
            long = kind.parts.hubs or kind.parts.chains > 1 or (not kind.is_paired and (kind.moving or kind.profiles))
            return 8 if per > 6 or long or kind.measuring else 12  # or registers spill
        if kind.is_paired:
            return 20 if per <= 4 else 16 if per <= 6 else 8 if kind.measuring else 12
        return 14 if per <= (4 if kind.measuring else 6) else 12 if per <= 6 else 8
    if per > 1:
        most = 2 if per > 8 else 4 if kind.is_paired else 3
        return max(1, most * 128 // shape.threads)
    return FEW_VARIANTS


@dataclass(frozen=True)
class Bucket:
    """Bucket of variants that share GPU kernels."""

    kind: BlockKind  # of the kernel that takes steps without metrics
    variants: NDArray[np.integer]  # their numbers, of several chains the rows of the first
    order: wp.array  # `variants` on the device
    most_shared: int = DECLARED  # bytes of shared memory that a block may have
    each: int = 1  # variants that a multiprocessor gets

    @property
    def count(self) -> int:
        """Number of variants in the bucket."""
        return len(self.variants)


def kind_with_shared_blocks(kind: BlockKind, most_shared: int, each: int) -> BlockKind:
    """GPU block kind with several variants a block, if faster."""
    shape = kind.shape
    if kind.parts.hydraulic and shape.threads == WARP:
        most = FULL_AT_FLOAT32 if kind.is_paired else FULL_OF_OIL
        if kind.measuring:
            most = FULL_OF_OIL if kind.is_paired else FULL_WITH_METRICS
        oiled = replace(kind, shape=replace(shape, variants_per_block=most))
        fits = most * kind.parts.tensioners <= WARP and launch_bytes_per_block(oiled) <= most_shared
        return oiled if fits and each > resident_variants(kind) else kind
    long = kind.measuring or shape.rollers_per_thread > 4
    if not (
        kind.is_paired and shape.threads == WARP and shape.rollers_per_thread <= 6 and long and is_simple_kind(kind)
    ):
        return kind
    fuller = replace(kind, shape=replace(shape, variants_per_block=VARIANTS_PER_BLOCK))
    needed = launch_bytes_per_block(fuller) + RESERVED_BYTES
    return fuller if resident_variants(fuller) // VARIANTS_PER_BLOCK * needed <= most_shared + RESERVED_BYTES else kind


def kernel_kind(name: str, bucket: Bucket) -> BlockKind:
    """GPU block kind of a bucket's "advance", "measure" or "relax"."""
    kind = bucket.kind
    if name == "relax":  # by one kernel, however many there are and whatever else they have
        parts = replace(
            kind.parts,
            prescribed=1,
            tabulated=1,
            tied=0,
            geared=0,
            crowded_arms=0,
            hydraulic=0,
            valves=0,
            chains=1,
        )
        links = "varied" if kind.links == "varied" else "lengths"
        shape = block_shape(kind.shape.room, FEW_VARIANTS + 1, kind.shape.shared_bytes)
        moving = bool(parts.hubs)
        return BlockKind(
            kind.Real, shape, parts, moving=moving, profiles=kind.profiles, links=links, silent=kind.silent
        )
    return kind_with_shared_blocks(replace(kind, measuring=name == "measure"), bucket.most_shared, bucket.each)


COLUMN_SUMS = {
    np.add: ("sprockets", "guides", "arms", "tensioners", "prescribed", "other_bodies", "valves"),
    np.minimum: ("linear_hysteretic",),
}
"""Functions that join columns of chains to their variant's."""


def variant_kind_columns(packed: PackedEnsemble) -> dict[str, NDArray[Any]]:
    """Properties (variants,) that decide GPU kernels, by name."""
    chains, begins, columns = packed.drives["chains"], packed.first_rows, chain_kind_columns(packed)
    if len(begins) == packed.variants:
        return columns
    ways = {name: way for way, names in COLUMN_SUMS.items() for name in names}
    whole = {name: ways.get(name, np.maximum).reduceat(values, begins) for name, values in columns.items()}
    whole["room"] = roller_capacity(np.add.reduceat(packed.drives["rollers"], begins))
    prescribed = np.add.reduceat(packed.motions["prescribed"], packed.drives["first_body"][begins])
    whole |= {"prescribed": np.maximum(prescribed, 1), "chains": chains[begins]}
    return whole


def chain_kind_columns(packed: PackedEnsemble) -> dict[str, NDArray[Any]]:
    """Properties (rows,) of chains that decide GPU kernels, by name."""
    drives = packed.drives
    cells = packed.motions["drive_table"]["cells"] + packed.motions["load_table"]["cells"]
    cells = cells + packed.mounts["x_table"]["cells"] + packed.mounts["y_table"]["cells"]
    return {
        "room": roller_capacity(drives["rollers"]),
        "sprockets": drives["sprockets"],
        "guides": drives["guides"],
        "arms": drives["arms"],
        "tensioners": drives["tensioners"],
        "prescribed": np.maximum(np.add.reduceat(packed.motions["prescribed"], drives["first_body"]), 1),
        "other_bodies": drives["bodies"] - drives["sprockets"] - drives["arms"],
        "tabulated": np.add.reduceat(cells, drives["first_body"]) > 0,
        "tied": drives["tied"],
        "geared": drives["couplings"] + drives["gears"] > 0,
        "hubs": drives["hubs"] + drives["jointed"],
        "crowded_arms": packed.has_crowded_arms,
        "hydraulic": packed.has_oil,
        "valves": CAM_STEP * -(-packed.cam_counts // CAM_STEP),
        "chains": np.ones_like(drives["chains"]),
        "integrator": drives["integrator"],
        "moving": (np.add.reduceat(packed.mounts["active"], drives["first_body"]) > 0) | (drives["hubs"] > 0),
        "profiles": packed.has_carried_guides,
        "contacts": packed.contact_friction_kinds,
        "joints": packed.joint_friction_kinds,
        "links": np.where(packed.has_varied_links, 2, 1 - packed.has_uniform_links),
        "linear_hysteretic": packed.has_linear_hysteretic_contacts,
        "silent": drives["points"] > 1,
    }


def block_kind(real: type, columns: Mapping[str, int], each: int, shared_bytes: int = DECLARED) -> BlockKind:
    """GPU block kind of a variant with these properties."""
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
        silent=bool(columns["silent"]),
    )


def global_memory_values(buckets: Sequence[Bucket]) -> tuple[int, int]:
    """Numbers of values, and of parts, of large GPU blocks in global memory."""
    needs = np.zeros(2, dtype=int)
    for bucket in buckets:
        for name in ("advance", "measure", "relax"):
            of = block_memory(kernel_kind(name, bucket))
            needs = np.maximum(needs, bucket.count * np.array([of.values, of.part_values]))
    return int(needs[0]), int(needs[1])


def _distinct_rows(keys: NDArray[np.integer]) -> list[tuple[Any, ...]]:
    """Distinct rows of keys, the largest first."""
    differ = (keys != keys[0]).any(axis=0)
    rows = np.unique(keys[:, differ], axis=0, return_index=True)[1] if differ.any() else np.zeros(1, dtype=int)
    return sorted((tuple(row) for row in keys[rows].tolist()), reverse=True)


class BucketKernel(NamedTuple):
    """GPU kernel of a bucket: kind, resident variants, specification."""

    kernel: Any
    kind: BlockKind
    resident_variants: int
    spec: KernelSpec


class GpuKernels:
    """GPU kernels of an ensemble.

    Attributes:
        buckets: variants by the kernels that step them.
        chain_buckets: chains by the kernels that settle them.
    """

    def __init__(self, packed: PackedEnsemble, device: str) -> None:
        self.packed, self.device = packed, device
        self._processors = int(wp.get_device(device).sm_count)
        self._most_shared = int(wp.get_device(device).max_shared_memory_per_block)
        self._kernels: dict[tuple[str, int], BucketKernel] = {}
        drives = packed.drives
        measuring = bool((drives["window_start"] < drives["steps"]).any())
        self._names = ("measure", "advance") if measuring else ("advance",)  # what takes longest to compile first
        self.buckets = self._make_buckets(variant_kind_columns(packed), packed.first_rows)
        alone = len(packed.first_rows) == packed.variants
        self.chain_buckets = (
            self.buckets if alone else self._make_buckets(chain_kind_columns(packed), np.arange(packed.variants))
        )

    def _make_buckets(self, columns: Mapping[str, NDArray[Any]], rows: NDArray[np.integer]) -> list[Bucket]:
        """Buckets of variants or chains for GPU kernels, longest first."""
        packed = self.packed
        keys = np.column_stack(list(columns.values()))
        buckets = []
        for key in _distinct_rows(keys):
            order = rows[(keys == key).all(axis=1)]
            recorded = packed.drives["frame_interval"][order] > 0
            order = order[np.argsort(~recorded, kind="stable")]  # which take longer
            array: wp.array = wp.array(order, dtype=wp.int32, device=self.device)
            each = -(-len(order) // self._processors)
            kind = block_kind(packed.real, dict(zip(columns, key, strict=True)), each, self._most_shared)
            if packed.frame.holds("hub_force"):  # which kernels of moving bodies sum up at every step
                kind = replace(kind, moving=True)
            buckets.append(Bucket(kind, order, array, self._most_shared, each))
        return buckets

    def _bucket_kernel(self, name: str, bucket: Bucket) -> BucketKernel:
        """GPU kernel of a bucket, by name."""
        key = name, id(bucket)
        if key not in self._kernels:
            kind = kernel_kind(name, bucket)
            held = resident_variants(kind)
            settling = name == "relax"
            factory = block_relax_kernel if settling else block_kernel
            form = (kind, held) if settling else (kind, held, self.packed.frame)
            self._kernels[key] = BucketKernel(factory(*form), kind, held, KernelSpec(factory, form, kind.block_threads))
        return self._kernels[key]

    def buckets_of_kernel(self, name: str) -> list[Bucket]:
        """Buckets that launch the GPU kernel of this name."""
        return self.chain_buckets if name == "relax" else self.buckets

    def kernel_specs(self, *names: str) -> list[KernelSpec]:
        """Specifications of GPU kernels by name, by default of steps."""
        made = [self._bucket_kernel(name, of) for name in names or self._names for of in self.buckets_of_kernel(name)]
        blocks = [of.spec for of in made]
        return blocks if names else [*blocks, KernelSpec(tally_sum_kernel, (self.packed.real,), TALLY_SUM_THREADS)]
