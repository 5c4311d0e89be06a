"""What the threads of a block share: the rollers' states and forces, and what they have in common of a variant.

Where that lies, and how threads wait for each other and add up together, is native code. On CUDA the arrays lie in the
block's shared memory, those of large blocks in global memory; elsewhere they are static. (On the CPU a block's threads
are cooperative fibers of one thread, a warp is one thread, and blocks follow each other.) What each thread does between
two barriers touches nothing that another one reads.
"""

from dataclasses import dataclass
from functools import cache, partial

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
    WheelStages,
    types,
)
from ..sum_structs import LinkTally, MountSums, RollerTally, SprocketSums
from .block_kind import WARP, BlockKind
from .block_room import ALIGNED, Room, room, size_of

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
    return __ballot_sync(0xffffffffu, flag);
#else
    return flag;
#endif
""")
def lanes_where(flag: int) -> int:
    """The threads of the warp where `flag`, 0 or 1, is 1, as bits."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif
""")
def after_turn():
    """Ends a thread's turn, after those of the warp that had theirs and before those that have none yet."""
    ...


BLOCK_OR = """
#if defined(__CUDA_ARCH__)
    return __syncthreads_or(flag);
"""

WARP_OR = """
#if defined(__CUDA_ARCH__)
    __syncwarp();
    return __any_sync(0xffffffffu, flag);
"""

FIBERS_OR = """
#else
    static int any;
    WP_TILE_SYNC();
    any = 0;
    WP_TILE_SYNC();
    if (flag) any = 1;
    WP_TILE_SYNC();
    return any;
#endif
"""


def _snippet(kind: BlockKind, of: Room, name: str) -> str:
    """An array of the block's own shared memory, or of the variant's part of it; nothing where there is none."""
    if name not in of.shared:
        return "return {};"
    count, element = of.shared[name], f"*like.{name}.data"
    size = size_of(types(kind.Real).Shared.vars[name].type.dtype)
    memory = f"__shared__ __align__({ALIGNED}) char memory[{count * size}];"
    if name in of.places:
        # found anew from the thread's number, `place` would take a register
        place = f"(threadIdx.x / {WARP}) * {of.asked} + " if kind.abreast > 1 else ""
        memory = f"""extern __shared__ __align__({ALIGNED}) char of_launch[];
    char* const memory = of_launch + {place}{of.places[name]};"""
    return f"""
    static_assert(sizeof({element}) == {size}, "of this size the arrays are laid out");
#if defined(__CUDA_ARCH__)
    {memory}
#else
    static char memories[{kind.abreast}][{count * size}];
    char* const memory = memories[place];
#endif
    return {{(decltype(like.{name}.data))memory, {count}}};
"""


@dataclass(frozen=True)
class Exchange:
    """What a block's threads do together, as functions of kernels."""

    barrier: wp.Function
    together: wp.Function
    any_thread: wp.Function
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
    Real, threads, slots = kind.Real, kind.threads, kind.slots
    kinds, of = types(Real), room(kind)
    snippet = partial(_snippet, kind, of)

    @wp.func_native(WARP_BARRIER if threads == WARP else BARRIER)
    def barrier():
        """Waits for all threads of the variant."""
        ...

    @wp.func_native(BARRIER)
    def together():
        """Waits for all threads of the block, of all the variants abreast in it."""
        ...

    @wp.func_native((WARP_OR if threads == WARP else BLOCK_OR) + FIBERS_OR)
    def any_thread(flag: int) -> int:
        """Whether `flag` is not zero in any thread of the variant; a barrier."""
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

    @wp.func_native(OWN)
    def view(all: wp.array[Real], first: int, count: int) -> wp.array[Real]:
        """`count` values from `first` on."""
        ...

    @wp.func_native(snippet("rows"))
    def rows(like: kinds.Shared, place: int) -> wp.array[Real]: ...

    @wp.func_native(snippet("parts"))
    def parts(like: kinds.Shared, place: int) -> wp.array[Real]: ...

    @wp.func_native(snippet("seen"))
    def seen(like: kinds.Shared, place: int) -> wp.array[Real]: ...

    @wp.func_native(snippet("strand_of"))
    def strand_of(like: kinds.Shared, place: int) -> wp.array[wp.uint32]: ...

    @wp.func_native(snippet("teeth"))
    def teeth(like: kinds.Shared, place: int) -> wp.array[kinds.Sprocket]: ...

    @wp.func_native(snippet("bands"))
    def bands(like: kinds.Shared, place: int) -> wp.array[kinds.Band]: ...

    @wp.func_native(snippet("bars"))
    def bars(like: kinds.Shared, place: int) -> wp.array[kinds.Guide]: ...

    @wp.func_native(snippet("lines"))
    def lines(like: kinds.Shared, place: int) -> wp.array[wp.vec4f]: ...

    @wp.func_native(snippet("box"))
    def box(like: kinds.Shared, place: int) -> wp.array[wp.vec4f]: ...

    @wp.func_native(snippet("sliding"))
    def sliding(like: kinds.Shared, place: int) -> wp.array[kinds.Sliding]: ...

    @wp.func_native(snippet("chain"))
    def chain(like: kinds.Shared, place: int) -> wp.array[kinds.Chain]: ...

    @wp.func_native(snippet("joint"))
    def joint(like: kinds.Shared, place: int) -> wp.array[kinds.Joint]: ...

    @wp.func_native(snippet("links"))
    def links(like: kinds.Shared, place: int) -> wp.array[kinds.Links]: ...

    @wp.func_native(snippet("motions"))
    def motions(like: kinds.Shared, place: int) -> wp.array[Motion]: ...

    @wp.func_native(snippet("course"))
    def course(like: kinds.Shared, place: int) -> wp.array[wp.float64]: ...

    @wp.func_native(snippet("poses"))
    def poses(like: kinds.Shared, place: int) -> wp.array[Pose]: ...

    @wp.func_native(snippet("mounts"))
    def mounts(like: kinds.Shared, place: int) -> wp.array[Mount]: ...

    @wp.func_native(snippet("wheels"))
    def wheels(like: kinds.Shared, place: int) -> wp.array[wp.vec4f]: ...

    @wp.func_native(snippet("gears"))
    def gears(like: kinds.Shared, place: int) -> wp.array[wp.vec4f]: ...

    @wp.func_native(snippet("spins"))
    def spins(like: kinds.Shared, place: int) -> wp.array[Spin]: ...

    @wp.func_native(snippet("led"))
    def led(like: kinds.Shared, place: int) -> wp.array[Led]: ...

    @wp.func_native(snippet("hubs"))
    def hubs(like: kinds.Shared, place: int) -> wp.array[Hub]: ...

    @wp.func_native(snippet("wheel_stages"))
    def wheel_stages(like: kinds.Shared, place: int) -> wp.array[WheelStages]: ...

    @wp.func_native(snippet("plungers"))
    def plungers(like: kinds.Shared, place: int) -> wp.array[PlungerState]: ...

    @wp.func_native(snippet("plunger_pushes"))
    def plunger_pushes(like: kinds.Shared, place: int) -> wp.array[PlungerPush]: ...

    @wp.func_native(snippet("plunger_meters"))
    def plunger_meters(like: kinds.Shared, place: int) -> wp.array[PlungerMeter]: ...

    @wp.func_native(snippet("plunger_sums"))
    def plunger_sums(like: kinds.Shared, place: int) -> wp.array[PlungerSums]: ...

    @wp.func_native(snippet("lever_sums"))
    def lever_sums(like: kinds.Shared, place: int) -> wp.array[LeverSums]: ...

    @wp.func_native(snippet("hub_sums"))
    def hub_sums(like: kinds.Shared, place: int) -> wp.array[HubSums]: ...

    @wp.func_native(snippet("mount_sums"))
    def mount_sums(like: kinds.Shared, place: int) -> wp.array[MountSums]: ...

    @wp.func_native(snippet("spin_sums"))
    def spin_sums(like: kinds.Shared, place: int) -> wp.array[SpinSums]: ...

    @wp.func_native(snippet("sprocket_sums"))
    def sprocket_sums(like: kinds.Shared, place: int) -> wp.array[SprocketSums]: ...

    @wp.func
    def in_shared_memory(place: int):
        """The arrays that lie in shared memory, of the variant at `place` of those abreast."""
        shared = kinds.Shared()
        shared.rows = rows(shared, place)
        shared.parts = parts(shared, place)
        shared.seen = seen(shared, place)
        shared.strand_of = strand_of(shared, place)
        shared.teeth = teeth(shared, place)
        shared.bands = bands(shared, place)
        shared.bars = bars(shared, place)
        shared.lines = lines(shared, place)
        shared.box = box(shared, place)
        shared.sliding = sliding(shared, place)
        shared.chain = chain(shared, place)
        shared.joint = joint(shared, place)
        shared.links = links(shared, place)
        shared.motions = motions(shared, place)
        shared.course = course(shared, place)
        shared.poses = poses(shared, place)
        shared.mounts = mounts(shared, place)
        shared.wheels = wheels(shared, place)
        shared.gears = gears(shared, place)
        shared.spins = spins(shared, place)
        shared.led = led(shared, place)
        shared.hubs = hubs(shared, place)
        shared.wheel_stages = wheel_stages(shared, place)
        shared.plungers = plungers(shared, place)
        shared.plunger_pushes = plunger_pushes(shared, place)
        shared.plunger_meters = plunger_meters(shared, place)
        shared.plunger_sums = plunger_sums(shared, place)
        shared.lever_sums = lever_sums(shared, place)
        shared.hub_sums = hub_sums(shared, place)
        shared.mount_sums = mount_sums(shared, place)
        shared.spin_sums = spin_sums(shared, place)
        shared.sprocket_sums = sprocket_sums(shared, place)
        return shared

    @wp.func
    def shared_arrays(state: kinds.State, number: int):
        """The arrays that the threads share of the variant at place `number` of its launch.

        Warp asks for memory at each launch: as much as a tile would take, which nothing else uses.
        """
        if wp.static(of.asked > 0):
            wp.tile_zeros(shape=wp.static(kind.abreast * of.asked // 8), dtype=wp.float64, storage="shared")
            together()
        shared = in_shared_memory(number % wp.static(kind.abreast))
        first = number * wp.static(of.values)
        if wp.static("rows" not in of.shared):
            shared.rows = view(state.rows, first, wp.static(of.rows))
        if wp.static("seen" not in of.shared):
            shared.seen = view(state.rows, first + wp.static(of.values - of.seen), wp.static(of.seen))
        if wp.static("parts" not in of.shared):
            shared.parts = view(state.parts, number * wp.static(of.parts), wp.static(of.parts))
        return shared

    return Exchange(
        barrier=barrier,
        together=together,
        any_thread=any_thread,
        hand_over=hand_over,
        taken_over=taken_over,
        among_rollers=among_rollers,
        warp_sum=warp_sum,
        group_sum=group_sum,
        warp_max=warp_max,
        view=view,
        shared_arrays=shared_arrays,
    )
