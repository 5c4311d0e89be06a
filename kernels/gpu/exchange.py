"""What the threads of a block share: the rollers' states and forces, and what they have in common of a variant.

Where that lies, and how threads wait for each other and add up together, is native code. On CUDA the arrays lie in the
block's shared memory, those of large blocks in global memory; elsewhere they are static. (On the CPU a block's threads
are cooperative fibers of one thread, a warp is one thread, and blocks follow each other.) What each thread does between
two barriers touches nothing that another one reads.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..structs import (
    Hub,
    HubSums,
    Led,
    LeverSums,
    Motion,
    Mount,
    PlungerMeter,
    PlungerPush,
    PlungerState,
    PlungerSums,
    Pose,
    Spin,
    SpinSums,
    Strand,
    WheelStages,
    types,
)
from ..sum_structs import LinkTally, MountSums, RollerTally, SprocketSums, StrandSums
from .block_kind import DECLARED, WARP, BlockKind
from .block_wheels import GEAR_ROWS, LINE_ROWS, WHEEL_ROWS

ANY_LANE = """
#if defined(__CUDA_ARCH__)
    return __any_sync(0xffffffffu, flag);
#else
    return flag;
#endif
"""

LARGEST = """
#if defined(__CUDA_ARCH__)
    #pragma unroll
    for (int o = 16; o; o >>= 1) {
        const auto other = __shfl_xor_sync(0xffffffffu, value, o);
        if (other > value) value = other;
    }
#endif
    return value;
"""

SUM = """
#if defined(__CUDA_ARCH__)
    #pragma unroll
    for (int o = 16; o; o >>= 1) value += __shfl_xor_sync(0xffffffffu, value, o);
#endif
    return value;
"""

GROUP_SUM = """
#if defined(__CUDA_ARCH__)
    #pragma unroll
    for (int o = 4; o; o >>= 1) value += __shfl_xor_sync(0xffffffffu, value, o);
#endif
    return value;
"""

OWN = "assert(first >= 0 && first + count <= all.shape[0]); return {all.data + first, count};"
"""A view of `count` values of a global array from `first` on."""


def _shared_snippet(field: str, count: int, at: int | None = None) -> str:
    """An array of the block's own shared memory; `at` bytes from the start of what each launch asks for, if given."""
    memory = f"__shared__ __align__(16) char memory[{count} * sizeof(*like.{field}.data)];"
    if at is not None:
        memory = f"extern __shared__ __align__(16) char of_launch[]; char* const memory = of_launch + {at};"
    return f"""
#if defined(__CUDA_ARCH__)
    {memory}
#else
    static char memory[{count} * sizeof(*like.{field}.data)];
#endif
    return {{(decltype(like.{field}.data))memory, {count}}};
"""


BARRIER = "WP_TILE_SYNC();"

WARP_BARRIER = """
#if defined(__CUDA_ARCH__)
    __syncwarp();
#else
    WP_TILE_SYNC();
#endif
"""
"""The barrier of a block of one warp."""


def _named(what: str, number: int, threads: int, elsewhere: str = "") -> str:
    """What a whole warp does at one of the block's barriers beside that of all, for so many threads."""
    return f"""
#if defined(__CUDA_ARCH__)
    __syncwarp();
    asm volatile("bar.{what} {number}, {threads};" ::: "memory");
#else
    {elsewhere}
#endif
"""


COURSE = 32
"""Steps that prescribed motion is worked out for at a time, one a thread of a warp."""


def shared_rows(Real: type) -> int:
    """Rows of rollers that threads share: x, y, vx, vy, force (x, y), at float32 the low parts of x, y.

    Where joints rub there are more (`joint_rows`).
    """
    return 8 if Real == wp.float32 else 6


def joint_rows(kind: BlockKind) -> int:
    """Rows beside these for the friction of joints (`block_joints`)."""
    if not kind.bending or (kind.threads == WARP and not kind.measuring):
        return 0
    return 1 if kind.threads == WARP and kind.Real == wp.float64 else 2


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
""")
def lanes() -> int:
    """Threads of a warp."""
    ...


@wp.func
def group() -> int:
    """Threads of a group, which adds up what acts on one sprocket: a quarter of a warp."""
    return (lanes() + 3) // 4


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return (__ffs(mask) - 1) & 31;
#else
    int bit = 0;
    while (!((mask >> bit) & 1)) ++bit;
    return bit;
#endif
""")
def lowest_bit(mask: int) -> int:
    """Position of the lowest bit set in `mask`, which is not zero."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("red.global.add.f64 [%0], %1;" :: "l"(__cvta_generic_to_global(sums.data + at)), "d"(value));
#else
    sums.data[at] += value;
#endif
""")
def add_to(sums: wp.array[wp.float64], at: int, value: wp.float64):
    """Adds `value` to what stands at `at` in global memory, and does not wait for it.

    Where no other thread adds to it, the sum is that of one addition after the other.
    """
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("red.global.max.s64 [%0], %1;" ::
        "l"(__cvta_generic_to_global(values.data + at)), "l"(__double_as_longlong(value)));
#else
    if (value > values.data[at]) values.data[at] = value;
#endif
""")
def raise_to(values: wp.array[wp.float64], at: int, value: wp.float64):
    """Raises what stands at `at` in global memory, not negative, to `value`, and does not wait for it.

    As whole numbers, bits of positive numbers have their order.
    """
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("red.global.add.u32 [%0], 1;" :: "l"(__cvta_generic_to_global(counts.data + at)));
#else
    counts.data[at] += 1;
#endif
""")
def count_at(counts: wp.array[wp.int32], at: int):
    """One more at `at` in global memory, without a wait."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int bits = __float_as_int(value);
    return __hiloint2double((bits & 0x80000000) | (((bits & 0x7fffffff) >> 3) + 0x38000000), bits << 29);
#else
    return value;
#endif
""")
def widened(value: wp.float32) -> wp.float64:
    """A float32 as float64 without an instruction of float64, those below 1e-38 as something as small."""
    ...


def _adds(**types_of: str) -> str:
    """Adds the fields of a struct `more` to those of `tallies` at `at`, and does not wait for them."""
    address = "__cvta_generic_to_global(&tallies.data[at].{0})"
    letters = {"f64": "d", "u64": "l"}
    red = """    asm volatile("red.global.add.{1} [%0], %1;" :: "l"({2}), "{3}"(more.{0}));"""
    reds = [red.format(name, of, address.format(name), letters[of]) for name, of in types_of.items()]
    adds = [f"    tallies.data[at].{name} += more.{name};" for name in types_of]
    return "\n".join(["", "#if defined(__CUDA_ARCH__)", *reds, "#else", *adds, "#endif", ""])


@wp.func_native(_adds(samples="u64", tension="f64", tension_square="f64"))
def add_to_link(tallies: wp.array[LinkTally], at: int, more: LinkTally):
    """Adds what `more` has to a link's tally; no other thread does."""
    ...


@wp.func_native(_adds(dissipated="f64", friction="f64"))
def add_to_roller(tallies: wp.array[RollerTally], at: int, more: RollerTally):
    """Adds what is dissipated in `more` to a roller's tally; no other thread does."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("" : "+r"(value));
#endif
    return value;
""")
def unforeseen(value: int) -> int:
    """`value`, of which the compiler knows nothing: it leaves a loop that goes so far a loop, which is shorter code."""
    ...


@wp.func_native(ANY_LANE)
def any_lane(flag: int) -> int:
    """Whether `flag` is not zero in any thread of the warp."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __syncthreads_or(flag);
#else
    static int any;
    WP_TILE_SYNC();
    any = 0;
    WP_TILE_SYNC();
    if (flag) any = 1;
    WP_TILE_SYNC();
    return any;
#endif
""")
def any_thread(flag: int) -> int:
    """Whether `flag` is not zero in any thread of the block; a barrier."""
    ...


def extremes(kind: BlockKind) -> int:
    """Values of the extremes of tension that each warp keeps: lowest and highest of the strands and of links on none,
    and what threads without a link are held against.
    """
    return 2 * (kind.sprockets + 2)


def seen_rows(kind: BlockKind) -> tuple[int, int, int]:
    """Where, after the extremes, each link's squared rates and each thread's friction begin, and where they end."""
    first = kind.threads // WARP * extremes(kind)
    return first, first + kind.slots, first + kind.slots + kind.bending * kind.threads


ORDERED = 512
"""Rollers of the longest chain whose moments are added up in the rollers' order, whatever the block's shape."""


def parts_of_a_body(kind: BlockKind) -> int:
    """Into how many parts the sum over all rollers of what acts on a body is taken apart.

    A roller has one, or a thread: on one warp, where that is the same order, and where the rollers are many. What has
    no rollers has none.
    """
    return kind.threads if kind.threads == WARP or kind.slots > ORDERED else kind.room


@dataclass(frozen=True)
class Room:
    """How much of what a block's threads share there is, and what of it lies in shared memory.

    A kernel declares up to `DECLARED` bytes of it; where that is not enough and the GPU has more, launches ask for it.
    """

    parts: int  # values
    rows: int  # values
    held: int
    seen: int  # values: extremes of tension, each link's squared rates, the work of each roller's joint friction
    strand_of: int  # bytes
    size: int  # of a value [bytes]
    shares_rows: bool  # and held
    shares_parts: bool
    shares_seen: bool
    asks: bool  # each launch asks for what is shared of these

    @property
    def part_values(self) -> int:
        """Values of `parts` of a block in global memory."""
        return self.parts * (not self.shares_parts)

    @property
    def values(self) -> int:
        """Values of a block in global memory, at the kernel's precision."""
        return self.rows * (not self.shares_rows) + self.seen * (not self.shares_seen)

    @property
    def integers(self) -> int:
        """Integers of a block in global memory."""
        return self.held * (not self.shares_rows)

    @property
    def asked(self) -> tuple[int | None, ...]:
        """Where parts, rows, held, seen and their end lie in what a launch asks for [bytes]; None if it does not."""
        sizes = [self.size * self.parts * self.shares_parts, self.size * self.rows * self.shares_rows]
        sizes += [4 * self.held * self.shares_rows, self.size * self.seen * self.shares_seen]
        return tuple(sum(sizes[:k]) if self.asks else None for k in range(5))


def _bytes(struct: Any) -> int:
    """Size of a struct."""
    return int(wp.types.type_size_in_bytes(struct))


def room(kind: BlockKind) -> Room:
    """What a block of a kind needs."""
    kinds = types(kind.Real)
    size = wp.types.type_size_in_bytes(kind.Real)
    parts = (3 if kind.pushes else 1) * kind.bodies * parts_of_a_body(kind)
    rows = (shared_rows(kind.Real) + joint_rows(kind)) * kind.slots
    seen = seen_rows(kind)[-1] if kind.measuring else 1
    strand_of = kind.slots if kind.measuring else 1
    of_each = [kinds.Sprocket, kinds.Band]
    of_each += [Strand, SprocketSums, StrandSums] if kind.measuring else []
    of_each += ([Hub, HubSums] if kind.paired else [Mount, MountSums]) if kind.moving else []
    of_each += [wp.vec4f] * GEAR_ROWS if kind.paired else []
    of_each += [Spin, *([Led] * COURSE)] if kind.paired else [Motion]
    used = kind.sprockets * (16 * COURSE * (not kind.paired) + sum(map(_bytes, of_each)))
    used += (kind.bodies + kind.profiles) * _bytes(Pose) * (not kind.paired)
    if kind.sliding:
        used += (kind.sprockets + kind.guides) * kinds.Sliding.numpy_dtype()["itemsize"]
    # and the chain, alignment, what stands for no mount
    used += max(kind.guides, 1) * kinds.Guide.numpy_dtype()["itemsize"] + strand_of + 1000
    if kind.paired:
        used += (kind.guides * LINE_ROWS + kind.wheels * WHEEL_ROWS) * _bytes(wp.vec4f)
        used += kind.tensioners * sum(map(_bytes, (PlungerState, PlungerPush)))
        used += kind.bodies * _bytes(WheelStages) * kind.rk4
        if kind.measuring:
            used += kind.arms * _bytes(LeverSums) + kind.tensioners * sum(map(_bytes, (PlungerMeter, PlungerSums)))
    needs = (rows * size + 4 * kind.slots, size * parts, seen * size)
    asks = used + sum(needs) > DECLARED and kind.shared_bytes > DECLARED
    used += 4 * kind.threads * asks  # Warp's own
    fits = []
    for needed in needs:
        fits.append(used + needed <= kind.shared_bytes)
        used += needed * fits[-1]
    return Room(parts, rows, kind.slots, seen, strand_of, size, *fits, asks=asks)


@dataclass(frozen=True)
class Exchange:
    """What a block's threads do together, as functions of kernels."""

    barrier: wp.Function
    hand_over: wp.Function
    taken_over: wp.Function
    among_rollers: wp.Function
    warp_sum: wp.Function
    group_sum: wp.Function
    warp_max: wp.Function
    view: wp.Function
    shared_arrays: wp.Function


@cache
def exchange(kind: BlockKind) -> Exchange:
    """What the threads of a block of a kind share."""
    Real, threads, slots, sprockets = kind.Real, kind.threads, kind.slots, kind.sprockets
    guides, moving = kind.guides, kind.moving
    kinds = types(Real)
    of = room(kind)
    parts_at, rows_at, held_at, seen_at, end = of.asked

    @wp.func_native(WARP_BARRIER if threads == WARP else BARRIER)
    def barrier():
        """Waits for all threads of the block."""
        ...

    @wp.func_native(_named("arrive", 1, threads))
    def hand_over():
        """Tells the warp that moves the bodies that this warp's contacts are done, and does not wait."""
        ...

    @wp.func_native(_named("sync", 1, threads, BARRIER))
    def taken_over():
        """Waits until all other warps have handed over."""
        ...

    @wp.func_native(_named("sync", 2, threads - WARP, BARRIER))
    def among_rollers():
        """Waits for all threads but those of the warp that moves the bodies."""
        ...

    @wp.func_native(SUM)
    def warp_sum(value: wp.float64) -> wp.float64:
        """Sum of `value` over the threads of this warp."""
        ...

    @wp.func_native(GROUP_SUM)
    def group_sum(value: Real) -> Real:
        """Sum of `value` over this thread's group, a quarter of a warp."""
        ...

    @wp.func_native(LARGEST)
    def warp_max(value: Real) -> Real:
        """Largest `value` of the threads of this warp."""
        ...

    @wp.func_native(_shared_snippet("rows", of.rows, rows_at))
    def rows(like: kinds.Shared) -> wp.array[Real]: ...

    @wp.func_native(_shared_snippet("held", slots, held_at))
    def held(like: kinds.Shared) -> wp.array[wp.int32]: ...

    @wp.func_native(_shared_snippet("seen", of.seen, seen_at))
    def seen(like: kinds.Shared) -> wp.array[Real]: ...

    @wp.func_native(_shared_snippet("strand_of", of.strand_of))
    def strand_of(like: kinds.Shared) -> wp.array[wp.uint8]: ...

    @wp.func_native(OWN)
    def view(all: wp.array[Real], first: int, count: int) -> wp.array[Real]:
        """`count` values from `first` on."""
        ...

    @wp.func_native(OWN)
    def own_held(all: wp.array[wp.int32], first: int, count: int) -> wp.array[wp.int32]: ...

    @wp.func_native(_shared_snippet("poses", kind.bodies + kind.profiles))
    def poses(like: kinds.Shared) -> wp.array[Pose]: ...

    @wp.func_native(_shared_snippet("wheels", WHEEL_ROWS * kind.wheels))
    def wheels(like: kinds.Shared) -> wp.array[wp.vec4f]: ...

    @wp.func_native(_shared_snippet("gears", GEAR_ROWS * sprockets))
    def gears(like: kinds.Shared) -> wp.array[wp.vec4f]: ...

    @wp.func_native(_shared_snippet("spins", sprockets))
    def spins(like: kinds.Shared) -> wp.array[Spin]: ...

    @wp.func_native(_shared_snippet("led", COURSE * sprockets))
    def led(like: kinds.Shared) -> wp.array[Led]: ...

    @wp.func_native(_shared_snippet("wheel_stages", kind.bodies))
    def wheel_stages(like: kinds.Shared) -> wp.array[WheelStages]: ...

    @wp.func_native(_shared_snippet("lever_sums", kind.arms))
    def lever_sums(like: kinds.Shared) -> wp.array[LeverSums]: ...

    @wp.func_native(_shared_snippet("plungers", kind.tensioners))
    def plungers(like: kinds.Shared) -> wp.array[PlungerState]: ...

    @wp.func_native(_shared_snippet("plunger_pushes", kind.tensioners))
    def plunger_pushes(like: kinds.Shared) -> wp.array[PlungerPush]: ...

    @wp.func_native(_shared_snippet("plunger_meters", kind.tensioners))
    def plunger_meters(like: kinds.Shared) -> wp.array[PlungerMeter]: ...

    @wp.func_native(_shared_snippet("plunger_sums", kind.tensioners))
    def plunger_sums(like: kinds.Shared) -> wp.array[PlungerSums]: ...

    @wp.func_native(_shared_snippet("lines", LINE_ROWS * max(guides, 1)))
    def lines(like: kinds.Shared) -> wp.array[wp.vec4f]: ...

    @wp.func_native(_shared_snippet("box", 1))
    def box(like: kinds.Shared) -> wp.array[wp.vec4f]: ...

    @wp.func_native(_shared_snippet("teeth", sprockets))
    def teeth(like: kinds.Shared) -> wp.array[kinds.Sprocket]: ...

    @wp.func_native(_shared_snippet("bands", sprockets))
    def bands(like: kinds.Shared) -> wp.array[kinds.Band]: ...

    @wp.func_native(_shared_snippet("bars", max(guides, 1)))
    def bars(like: kinds.Shared) -> wp.array[kinds.Guide]: ...

    @wp.func_native(_shared_snippet("sliding", sprockets + guides))
    def sliding(like: kinds.Shared) -> wp.array[kinds.Sliding]: ...

    @wp.func_native(_shared_snippet("chain", 1))
    def chain(like: kinds.Shared) -> wp.array[kinds.Chain]: ...

    @wp.func_native(_shared_snippet("joint", 1))
    def joint(like: kinds.Shared) -> wp.array[kinds.Joint]: ...

    @wp.func_native(_shared_snippet("links", 1))
    def links(like: kinds.Shared) -> wp.array[kinds.Links]: ...

    @wp.func_native(_shared_snippet("parts", of.parts, parts_at))
    def parts(like: kinds.Shared) -> wp.array[Real]: ...

    @wp.func_native(_shared_snippet("motions", sprockets))
    def motions(like: kinds.Shared) -> wp.array[Motion]: ...

    @wp.func_native(_shared_snippet("course", 2 * COURSE * sprockets))
    def course(like: kinds.Shared) -> wp.array[wp.float64]: ...

    @wp.func_native(_shared_snippet("strands", sprockets))
    def strands(like: kinds.Shared) -> wp.array[Strand]: ...

    @wp.func_native(_shared_snippet("hubs", sprockets))
    def hubs(like: kinds.Shared) -> wp.array[Hub]: ...

    @wp.func_native(_shared_snippet("hub_sums", sprockets))
    def hub_sums(like: kinds.Shared) -> wp.array[HubSums]: ...

    @wp.func_native(_shared_snippet("mounts", sprockets if moving else 1))
    def mounts(like: kinds.Shared) -> wp.array[Mount]: ...

    @wp.func_native(_shared_snippet("mount_sums", sprockets if moving else 1))
    def mount_sums(like: kinds.Shared) -> wp.array[MountSums]: ...

    @wp.func_native(_shared_snippet("spin_sums", sprockets))
    def spin_sums(like: kinds.Shared) -> wp.array[SpinSums]: ...

    @wp.func_native(_shared_snippet("sprocket_sums", sprockets))
    def sprocket_sums(like: kinds.Shared) -> wp.array[SprocketSums]: ...

    @wp.func_native(_shared_snippet("strand_sums", sprockets))
    def strand_sums(like: kinds.Shared) -> wp.array[StrandSums]: ...

    @wp.func
    def ask():
        """Has Warp ask for the memory at each launch: as much as this tile would take, which nothing else uses."""
        if wp.static(of.asks):
            wp.tile_zeros(shape=wp.static(end // 8), dtype=wp.float64, storage="shared")
            barrier()

    @wp.func
    def of_plungers(shared: kinds.Shared):
        """What is kept of arms, of tensioners and from stage to stage of rk4, at float32."""
        if wp.static(kind.tensioners > 0):
            shared.plungers = plungers(shared)
            shared.plunger_pushes = plunger_pushes(shared)
            if wp.static(kind.measuring):
                shared.plunger_meters = plunger_meters(shared)
                shared.plunger_sums = plunger_sums(shared)
        if wp.static(kind.arms > 0 and kind.measuring):
            shared.lever_sums = lever_sums(shared)
        if wp.static(kind.rk4):
            shared.wheel_stages = wheel_stages(shared)
        return shared

    @wp.func
    def shared_arrays(state: kinds.State, block: int):
        """The arrays that the threads share; `block` is the place of this block in its launch."""
        shared = kinds.Shared()
        ask()
        first = block * wp.static(of.values)
        if wp.static(of.shares_rows):
            shared.rows = rows(shared)
            shared.held = held(shared)
        else:
            shared.rows = view(state.rows, first, wp.static(of.rows))
            shared.held = own_held(state.held, wp.static(slots) * block, wp.static(slots))
        if wp.static(of.shares_seen):
            shared.seen = seen(shared)
        else:
            shared.seen = view(state.rows, first + wp.static(of.values - of.seen), wp.static(of.seen))
        if wp.static(kind.paired):
            shared.wheels = wheels(shared)
            shared.gears = gears(shared)
            shared.lines = lines(shared)
            shared.box = box(shared)
            shared.spins = spins(shared)
            shared.led = led(shared)
            shared = of_plungers(shared)
            if wp.static(moving):
                shared.hubs = hubs(shared)
                if wp.static(kind.measuring):
                    shared.hub_sums = hub_sums(shared)
        else:
            shared.motions = motions(shared)
            shared.course = course(shared)
            shared.poses = poses(shared)
        shared.strand_of = strand_of(shared)
        shared.teeth = teeth(shared)
        shared.bands = bands(shared)
        shared.bars = bars(shared)
        if wp.static(kind.sliding):
            shared.sliding = sliding(shared)
        shared.chain = chain(shared)
        if wp.static(kind.bending):
            shared.joint = joint(shared)
        if wp.static(kind.uneven):
            shared.links = links(shared)
        if wp.static(of.shares_parts):
            shared.parts = parts(shared)
        else:
            shared.parts = view(state.parts, block * wp.static(of.parts), wp.static(of.parts))
        if wp.static(not kind.paired):
            shared.mounts = mounts(shared)
        if wp.static(kind.measuring):
            shared.strands = strands(shared)
            if wp.static(kind.paired):
                shared.spin_sums = spin_sums(shared)
            else:
                shared.mount_sums = mount_sums(shared)
                shared.sprocket_sums = sprocket_sums(shared)
            shared.strand_sums = strand_sums(shared)
        return shared

    return Exchange(
        barrier=barrier,
        hand_over=hand_over,
        taken_over=taken_over,
        among_rollers=among_rollers,
        warp_sum=warp_sum,
        group_sum=group_sum,
        warp_max=warp_max,
        view=view,
        shared_arrays=shared_arrays,
    )
