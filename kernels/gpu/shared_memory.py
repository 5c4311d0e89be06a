"""Shared memory of a block: its arrays, their lengths and places.

A kernel declares up to `DECLARED` bytes; rows of longer chains lie in what each launch asks for, else in global memory.
Blocks of several variants ask for all of theirs. Between two barriers a thread touches nothing that another one reads.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .block_kinds import DECLARED, WARP, BlockKind
from .sync import sync_functions

PLANNED_STEPS = 32
"""Number of steps for which a block computes prescribed motion at once."""


LONGEST_IN_ORDER = 512
"""Rollers of the longest chain whose moments a block adds up in the rollers' order, whatever its shape."""


BYTES_PER_THREAD = 4
"""Bytes of shared memory that Warp takes of a launch for each thread of a block."""


STRAND_WORD = 32
"""Bits of a whole number of `strand_words`."""


ALIGNED = 16
"""Alignment of arrays in a block's shared memory [bytes]."""


@dataclass(frozen=True)
class RollerRows:
    """First index of each row of rollers in a block's shared memory."""

    x: int  # position [m]
    y: int
    vx: int  # velocity [m/s]
    vy: int
    force_x: int  # [N]
    force_y: int
    x_low: int  # what float32 rounds off the position [m]
    y_low: int


@cache
def roller_rows(kind: BlockKind) -> RollerRows:
    """First index of each row of rollers in the shared memory of a block kind."""
    firsts = {field.name: k * kind.shape.slots for k, field in enumerate(fields(RollerRows))}
    return type("RollerRows", (), firsts)  # as Warp reads constants from attributes of a class, not of an object


@dataclass(frozen=True)
class ForceRows:
    """First index of each shared row of forces of teeth and guides on a silent chain's links, after all other rows."""

    pairs: int  # pins and sprockets whose contacts a warp's threads share (`toes`)
    near_x: int  # at the pin itself [N]
    near_y: int
    next_x: int  # at the next pin, by the link between [N]
    next_y: int
    last_x: int  # at the pin before [N]
    last_y: int
    back_x: int  # of guides on the back after the pin, at the pin itself; with guides only, as the next [N]
    back_y: int
    ahead_x: int  # at the next pin [N]
    ahead_y: int


def force_row_count(kind: BlockKind) -> int:
    """Rows of `ForceRows` that a block has."""
    return kind.silent * (len(fields(ForceRows)) - 4 * (kind.parts.guides == 0))


@cache
def force_rows(kind: BlockKind) -> ForceRows:
    """First index of each shared row of forces of teeth and guides on a silent chain's links, in block kernels."""
    before = shared_rows(kind.Real) + joint_rows(kind) + mass_rows(kind)
    firsts = {field.name: (before + k) * kind.shape.slots for k, field in enumerate(fields(ForceRows))}
    return type("ForceRows", (), firsts)


def shared_rows(Real: type) -> int:
    """Number of a block's rows of rollers: x, y, vx, vy, force (x, y), at float32 low parts of x, y."""
    return 8 if Real == wp.float32 else 6


def joint_rows(kind: BlockKind) -> int:
    """Number of a block's rows for metrics of joint friction, beside `shared_rows`."""
    if not kind.friction.joints or not kind.measuring:
        return 0
    return 1 if kind.Real == wp.float64 else 2


def mass_rows(kind: BlockKind) -> int:
    """Number of a block's rows for rollers' own relative masses, after all others: of links that vary."""
    return int(kind.links == "varied")


def extreme_values(kind: BlockKind) -> int:
    """Number of extremes of tension that each warp keeps: of strands, of links on none, of threads without links."""
    return 2 * (kind.parts.sprockets + kind.parts.chains + 1)


def strand_bits(kind: BlockKind) -> int:
    """Number of bits for the strand of a block's link: a sprocket's, none of a chain, or no such link."""
    return (kind.parts.sprockets + kind.parts.chains).bit_length()


def strand_words(kind: BlockKind) -> int:
    """Number of whole numbers that hold `strand_bits` of each link of a thread."""
    return -(-kind.shape.rollers_per_thread // (STRAND_WORD // strand_bits(kind)))


def joint_work_values(kind: BlockKind) -> int:
    """Number of values of joint friction's work in a block: one a roller."""
    return (kind.friction.joints > 0) * kind.shape.slots


def tally_places(kind: BlockKind) -> tuple[int, int, int]:
    """Where a block's squared link rates and joint work begin, after the extremes, and their end."""
    first = kind.shape.threads // WARP * extreme_values(kind)
    return first, first + kind.shape.slots, first + kind.shape.slots + joint_work_values(kind)


def parts_per_body(kind: BlockKind) -> int:
    """Number of parts of a block's sum of wrenches on a body: one a roller, or one a thread.

    By threads for many rollers, and on one warp unless a roller may press on a body twice.
    """
    twice = kind.parts.crowded_arms or kind.silent
    by_threads = kind.shape.slots > LONGEST_IN_ORDER or (kind.shape.is_one_warp and not twice)
    return kind.shape.threads if by_threads else kind.shape.room


def part_rows(kind: BlockKind) -> int:
    """Number of a block's rows of wrench parts: of the moment, and of the force in x and in y."""
    return 3 if kind.moving or kind.measuring else 1


def _small_arrays(kind: BlockKind) -> dict[str, int]:
    """Number of values of each shared array but the rows of rollers and their parts."""
    sprockets, guides, chains, measuring = kind.parts.sprockets, kind.parts.guides, kind.parts.chains, kind.measuring
    several = chains > 1
    counts = {
        "motions": kind.parts.bodies,
        "prescribed_angles": PLANNED_STEPS * kind.parts.prescribed,
        "prescribed_speeds": PLANNED_STEPS * kind.parts.prescribed,
        "poses": kind.parts.bodies + kind.profiles,
        "train_moments": kind.parts.bodies * kind.parts.is_tied,
        "cams": kind.parts.bodies * (kind.parts.valves > 0),
        "lifts": kind.parts.valves,
        "mounts": kind.parts.bodies * kind.moving,
        "hubs": sprockets * (kind.parts.hubs > 0),
        "bearing_moments": sprockets * (kind.parts.hubs > 0),
        "strokes": kind.parts.tensioners * kind.has_oil_warp,
        "speeds_now": kind.parts.bodies * (kind.parts.hubs > 0),
        "carried_arms": kind.parts.arms * kind.parts.jointed,
        "arm_rates": kind.parts.bodies * kind.parts.jointed,
        "mount_sums": sprockets * kind.moving * measuring,
        "sprocket_sums": sprockets * measuring,
        "teeth": sprockets,
        "bands": sprockets,
        "guides": guides,
        "chains": chains,
        "plates": chains * kind.silent,
        "boxes": 2 * chains,
        "friction": (sprockets + guides) * (kind.friction.contacts > 0),
        "chain_places": chains * several,
        "contact_begins": (sprockets + guides) * several,
        "body_indices": kind.parts.bodies * several,
        "strand_words": kind.shape.threads * strand_words(kind) * measuring,
    }
    return {name: count for name, count in counts.items() if count > 0}


@dataclass(frozen=True)
class BlockMemory:
    """Sizes and places of a block's arrays, by their names in `Shared`.

    Attributes:
        wrench_parts, rows, link_sums: values, maybe in global memory.
        shared: values of each array in shared memory.
        places: of arrays of a launch, from the begin of their variant's [bytes].
        asked: memory of a launch, of each variant [bytes].
    """

    wrench_parts: int
    rows: int
    link_sums: int  # extremes of tension, each link's squared rates, the work of each roller's joint friction
    shared: Mapping[str, int]
    places: Mapping[str, int]
    asked: int

    @property
    def part_values(self) -> int:
        """Number of a block's wrench parts in global memory."""
        return self.wrench_parts * ("wrench_parts" not in self.shared)

    @property
    def values(self) -> int:
        """Number of a block's values in global memory, at the kernel's precision."""
        return self.rows * ("rows" not in self.shared) + self.link_sums * ("link_sums" not in self.shared)


def size_of(dtype: Any) -> int:
    """Size of a value, a vector or a struct in shared memory [bytes]."""
    return int(wp.types.type_size_in_bytes(dtype))


def block_memory(kind: BlockKind) -> BlockMemory:
    """Sizes and places of the memory of a block kind."""
    fields = kind.types.Shared.vars
    parts = part_rows(kind) * kind.parts.bodies * parts_per_body(kind)
    rows = shared_rows(kind.Real) + joint_rows(kind) + mass_rows(kind) + force_row_count(kind)
    rows *= kind.shape.slots
    seen = tally_places(kind)[-1] if kind.measuring else 0

    def needed(counts: Mapping[str, int]) -> int:
        """Bytes of shared arrays of so many values, each aligned."""
        bytes_ = (count * size_of(fields[name].type.dtype) for name, count in counts.items())
        return sum(-(-each // ALIGNED) * ALIGNED for each in bytes_)

    shared = _small_arrays(kind)
    used = needed(shared)
    large = [{"rows": rows}, {"wrench_parts": parts}, {"link_sums": seen}]
    asks = used + sum(map(needed, large)) > DECLARED and kind.shape.shared_bytes > DECLARED
    used += BYTES_PER_THREAD * kind.shape.threads * asks
    asked: list[str] = []
    for counts in large:
        counts = {name: count for name, count in counts.items() if count > 0}
        if used + needed(counts) <= kind.shape.shared_bytes:
            used += needed(counts)
            shared |= counts
            asked += counts if asks else ()
    if kind.shape.variants_per_block > 1:
        asked = [name for name in shared if name != "strokes"]  # which two warps look at
    places, end = {}, 0
    for name in asked:
        places[name] = end
        end += needed({name: shared[name]})
    return BlockMemory(parts, rows, seen, shared, places, end)


def launch_bytes_per_block(kind: BlockKind) -> int:
    """Bytes of shared memory that a launch asks for, for each block."""
    each = block_memory(kind).asked + kind.parts.tensioners * kind.has_oil_warp * size_of(kind.types.Stroke)
    return kind.shape.variants_per_block * each + BYTES_PER_THREAD * kind.block_threads


VIEW_CODE = "assert(first >= 0 && first + count <= all.shape[0]); return {all.data + first, count};"
"""Native code of the view of `count` values of a global array from `first` on."""


@cache
def array_view(Real: type) -> wp.Function:
    """Warp function of a view of a part of a global array of `Real`."""

    @wp.func_native(VIEW_CODE)
    def view(all: wp.array[Real], first: int, count: int) -> wp.array[Real]:
        """View of `count` values of a global array from `first` on."""

    return view


def _array_function(kind: BlockKind, of: BlockMemory, name: str) -> wp.Function:
    """Warp function of an array of a block's shared memory, or its variant's part; empty if none."""
    dtype = kind.types.Shared.vars[name].type.dtype

    @wp.func_native(_array_code(kind, of, name, size_of(dtype)))
    def array(like: kind.types.Shared, place: int) -> wp.array[dtype]: ...

    return array


def _array_code(kind: BlockKind, of: BlockMemory, name: str, size: int) -> str:
    """Native code of an array of a block's shared memory, of values of `size` bytes."""
    if name not in of.shared:
        return "return {};"
    count, element, variants = of.shared[name], f"*like.{name}.data", kind.shape.variants_per_block
    memory = f"__shared__ __align__({ALIGNED}) char memory[{count * size}];"
    if name in of.places:
        # found anew from the thread's number, `place` would take a register
        place = f"(threadIdx.x / {WARP}) * {of.asked} + " if variants > 1 else ""
        memory = f"""extern __shared__ __align__({ALIGNED}) char of_launch[];
    char* const memory = of_launch + {place}{of.places[name]};"""
    elif variants > 1:
        memory = f"""__shared__ __align__({ALIGNED}) char all[{variants * count * size}];
    char* const memory = all + place * {count * size};"""
    return f"""
    static_assert(sizeof({element}) == {size}, "of this size the arrays are laid out");
#if defined(__CUDA_ARCH__)
    {memory}
#else
    static char memories[{variants}][{count * size}];
    char* const memory = memories[place];
#endif
    return {{(decltype(like.{name}.data))memory, {count}}};
"""


@cache
def shared_arrays(kind: BlockKind) -> wp.Function:
    """Warp function of the arrays that a block's threads share of a variant."""
    sync = sync_functions(kind)
    kinds, of, variants = kind.types, block_memory(kind), kind.shape.variants_per_block
    Shared = kinds.Shared
    part = array_view(kind.Real)
    arrays = (name for name in kinds.Shared.vars if name != "first_rollers")
    found = SimpleNamespace(**{name: _array_function(kind, of, name) for name in arrays})

    @wp.func
    def in_shared_memory(place: int):
        """Arrays in shared memory of the variant at `place` of the block."""
        shared = Shared()
        shared.rows = found.rows(shared, place)
        shared.link_sums = found.link_sums(shared, place)
        shared.strand_words = found.strand_words(shared, place)
        shared.poses = found.poses(shared, place)
        shared.motions = found.motions(shared, place)
        shared.train_moments = found.train_moments(shared, place)
        shared.cams = found.cams(shared, place)
        shared.lifts = found.lifts(shared, place)
        shared.mounts = found.mounts(shared, place)
        shared.hubs = found.hubs(shared, place)
        shared.bearing_moments = found.bearing_moments(shared, place)
        shared.strokes = found.strokes(shared, place)
        shared.speeds_now = found.speeds_now(shared, place)
        shared.carried_arms = found.carried_arms(shared, place)
        shared.arm_rates = found.arm_rates(shared, place)
        shared.prescribed_angles = found.prescribed_angles(shared, place)
        shared.prescribed_speeds = found.prescribed_speeds(shared, place)
        shared.teeth = found.teeth(shared, place)
        shared.bands = found.bands(shared, place)
        shared.guides = found.guides(shared, place)
        shared.friction = found.friction(shared, place)
        shared.chains = found.chains(shared, place)
        shared.plates = found.plates(shared, place)
        shared.boxes = found.boxes(shared, place)
        shared.chain_places = found.chain_places(shared, place)
        shared.contact_begins = found.contact_begins(shared, place)
        shared.body_indices = found.body_indices(shared, place)
        shared.wrench_parts = found.wrench_parts(shared, place)
        shared.sprocket_sums = found.sprocket_sums(shared, place)
        shared.mount_sums = found.mount_sums(shared, place)
        return shared

    @wp.func
    def shared_arrays(state: kinds.State, number: int):
        """Arrays that a block's threads share of the variant at place `number` of its launch."""
        if wp.static(of.asked > 0):
            wp.tile_zeros(
                shape=wp.static(kind.shape.variants_per_block * of.asked // 8), dtype=wp.float64, storage="shared"
            )
            sync.block_barrier()
        shared = in_shared_memory(number % variants)
        first = number * wp.static(of.values)
        if wp.static("rows" not in of.shared):
            shared.rows = part(state.rows, first, wp.static(of.rows))
        if wp.static("link_sums" not in of.shared):
            shared.link_sums = part(state.rows, first + wp.static(of.values - of.link_sums), wp.static(of.link_sums))
        if wp.static("wrench_parts" not in of.shared):
            shared.wrench_parts = part(state.parts, number * wp.static(of.wrench_parts), wp.static(of.wrench_parts))
        return shared

    return shared_arrays
