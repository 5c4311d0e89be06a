"""Barriers, sums and atomic additions of a block's threads, as native code.

On the CPU a block's threads are cooperative fibers of one thread, and a warp is one thread.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import code_by_device
from ..structs import LinkTally, RollerTally
from .block_kinds import WARP, BlockKind

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


SUM_OF_LANES = """
    const int width = 8, groups = 4;
    auto lanes = parts.data + first;
    decltype(+*lanes) of[width], other[width];
    for (int lane = 0; lane < width; ++lane) {
        of[lane] = 0;
        for (int group = 0; group < groups; ++group) {
            decltype(+*lanes) sum = 0;
            for (int at = group * width + lane; at < count; at += groups * width) sum += lanes[at];
            of[lane] += sum;
        }
    }
    for (int apart = width / 2; apart; apart /= 2) {
        for (int lane = 0; lane < width; ++lane) other[lane] = of[lane ^ apart];
        for (int lane = 0; lane < width; ++lane) of[lane] += other[lane];
    }
    return of[0];
"""


BARRIER = "WP_TILE_SYNC();"


WARP_BARRIER = code_by_device("__syncwarp();", BARRIER)
"""Native code of the barrier of a block of one warp."""


def _named_barrier(what: str, number: int, threads: int, elsewhere: str = "") -> str:
    """Native code of a warp at barrier `number` of `threads` threads."""
    return code_by_device(f'__syncwarp(); asm volatile("bar.{what} {number}, {threads};" ::: "memory");', elsewhere)


@wp.func_native(code_by_device("return 32;", "return 1;"))
def warp_lanes() -> int:
    """Number of threads of a warp: 1 on the CPU."""


@wp.func
def group_lanes() -> int:
    """Number of threads of a group, a quarter of a warp, which adds up what acts on a body."""
    return (warp_lanes() + 3) // 4


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
    """Position of the lowest bit set in a block's `mask`, which is not zero."""


def _addition(of: str, letter: str) -> str:
    """Native code of an atomic addition of `value` in global memory."""
    place = "__cvta_generic_to_global(sums.data + at)"
    red = f'asm volatile("red.global.add.{of} [%0], %1;" :: "l"({place}), "{letter}"(value));'
    return code_by_device(red, "sums.data[at] += value;")


@wp.func_native(_addition("f64", "d"))
def add_to_element(sums: wp.array[wp.float64], at: int, value: wp.float64):
    """Adds `value` atomically to element `at` in a GPU's global memory, without waiting."""


@wp.func_native(_addition("u32", "r"))
def add_to_element(sums: wp.array[wp.int32], at: int, value: int):
    """Adds `value` atomically to a count, element `at` in a GPU's global memory, without waiting."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    asm volatile("red.global.max.s64 [%0], %1;" ::
        "l"(__cvta_generic_to_global(values.data + at)), "l"(__double_as_longlong(value)));
#else
    if (value > values.data[at]) values.data[at] = value;
#endif
""")
def raise_element(values: wp.array[wp.float64], at: int, value: wp.float64):
    """Raises element `at` in a GPU's global memory, not negative, to `value`, without waiting."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const int bits = __float_as_int(value);
    return __hiloint2double((bits & 0x80000000) | (((bits & 0x7fffffff) >> 3) + 0x38000000), bits << 29);
#else
    return value;
#endif
""")
def float64_from_float32(value: wp.float32) -> wp.float64:
    """Float32 as float64, without a GPU's instructions of float64; inexact below 1e-38."""


def _field_additions(**types_of: str) -> str:
    """Native code of additions of the fields of a struct `more` to `tallies` at `at`, without waiting."""
    address = "__cvta_generic_to_global(&tallies.data[at].{0})"
    letters = {"f64": "d", "u64": "l"}
    red = """    asm volatile("red.global.add.{1} [%0], %1;" :: "l"({2}), "{3}"(more.{0}));"""
    reds = [red.format(name, of, address.format(name), letters[of]) for name, of in types_of.items()]
    adds = [f"    tallies.data[at].{name} += more.{name};" for name in types_of]
    return code_by_device("\n".join(reds), "\n".join(adds))


@wp.func_native(_field_additions(samples="u64", tension="f64", tension_square="f64"))
def add_to_link_tally(tallies: wp.array[LinkTally], at: int, more: LinkTally):
    """Adds `more` to a link's tally, of which no other thread writes."""


@wp.func_native(_field_additions(dissipated="f64", friction="f64", goods_work="f64"))
def add_to_roller_tally(tallies: wp.array[RollerTally], at: int, more: RollerTally):
    """Adds `more` to a roller's tally, of which no other thread writes."""


@wp.func_native(code_by_device("return __ballot_sync(0xffffffffu, flag);", "return flag;"))
def lanes_with_flag(flag: int) -> int:
    """Threads of the warp whose `flag`, 0 or 1, is 1, as bits."""


@wp.func_native(
    code_by_device("return __popc(mask & (n < 32 ? (1u << n) - 1 : 0xffffffffu));", "return n ? mask & 1 : 0;")
)
def bits_below(mask: int, n: int) -> int:
    """Number of bits set in a warp's `mask` below bit `n`."""


SUM_WITH_LANE = code_by_device("return value + __shfl_xor_sync(0xffffffffu, value, apart);", "return value;")


@wp.func_native(SUM_WITH_LANE)
def sum_with_lane(value: wp.float64, apart: int) -> wp.float64:
    """Sum of two threads' float64 numbers, 1 or 2 apart; all threads of the warp together."""


@wp.func_native(SUM_WITH_LANE)
def sum_with_lane(value: wp.float32, apart: int) -> wp.float32:
    """Sum of two threads' float32 numbers, 1 or 2 apart; all threads of the warp together."""


VALUE_OF_LANE = code_by_device("return __shfl_sync(0xffffffffu, value, lane);", "return value;")


@wp.func_native(VALUE_OF_LANE)
def value_of_lane(value: wp.float64, lane: int) -> wp.float64:
    """Float64 number of thread `lane` of the warp; all threads of the warp together."""


@wp.func_native(VALUE_OF_LANE)
def value_of_lane(value: wp.float32, lane: int) -> wp.float32:
    """Float32 number of thread `lane` of the warp; all threads of the warp together."""


@wp.func_native(VALUE_OF_LANE)
def value_of_lane(value: int, lane: int) -> int:
    """Whole number of thread `lane` of the warp; all threads of the warp together."""


@wp.func_native(code_by_device("__syncwarp();", ""))
def end_turn():
    """Ends a thread's turn among those of its warp."""


BLOCK_OR = "return __syncthreads_or(flag);"
WARP_OR = "__syncwarp(); return __any_sync(0xffffffffu, flag);"
FIBERS_OR = """
    static int any;
    WP_TILE_SYNC();
    any = 0;
    WP_TILE_SYNC();
    if (flag) any = 1;
    WP_TILE_SYNC();
    return any;
"""


@dataclass(frozen=True)
class SyncFunctions:
    """Synchronization functions of a block."""

    barrier: wp.Function
    block_barrier: wp.Function
    is_set_in_any_thread: wp.Function
    hand_over_contacts: wp.Function
    await_contacts: wp.Function
    roller_barrier: wp.Function
    warp_sum: wp.Function
    group_sum: wp.Function
    sum_of_lanes: wp.Function
    warp_max: wp.Function


@cache
def sync_functions(kind: BlockKind) -> SyncFunctions:
    """Synchronization functions of block kernels."""
    Real, threads = kind.Real, kind.shape.threads

    @wp.func_native(WARP_BARRIER if threads == WARP else BARRIER)
    def barrier():
        """Waits for all threads of the variant."""

    @wp.func_native(BARRIER)
    def block_barrier():
        """Waits for all threads of the block, of all its variants."""

    @wp.func_native(code_by_device(WARP_OR if threads == WARP else BLOCK_OR, FIBERS_OR))
    def is_set_in_any_thread(flag: int) -> int:
        """Whether `flag` is not zero in any thread of the variant; a barrier."""

    @wp.func_native(_named_barrier("arrive", 1, threads))
    def hand_over_contacts():
        """Signals to the warp of the bodies that this warp's contacts are done, without waiting."""

    @wp.func_native(_named_barrier("sync", 1, threads, BARRIER))
    def await_contacts():
        """Waits until all other warps have handed over their contacts."""

    @wp.func_native(_named_barrier("sync", 2, threads - WARP, BARRIER))
    def roller_barrier():
        """Waits for all threads but those of the warp of the bodies."""

    @wp.func_native(SUM)
    def warp_sum(value: wp.float64) -> wp.float64:
        """Sum of `value` over the threads of this warp."""

    @wp.func_native(GROUP_SUM)
    def group_sum(value: Real) -> Real:
        """Sum of `value` over this thread's group, a quarter of a warp."""

    @wp.func_native(code_by_device("return 0;", SUM_OF_LANES))
    def sum_of_lanes(parts: wp.array[Real], first: int, count: int) -> Real:
        """Sum of `count` parts from `first` on, on the CPU, in the order of a group's threads."""

    @wp.func_native(LARGEST)
    def warp_max(value: Real) -> Real:
        """Largest `value` of the threads of this warp."""

    return SyncFunctions(
        barrier=barrier,
        block_barrier=block_barrier,
        is_set_in_any_thread=is_set_in_any_thread,
        hand_over_contacts=hand_over_contacts,
        await_contacts=await_contacts,
        roller_barrier=roller_barrier,
        warp_sum=warp_sum,
        group_sum=group_sum,
        sum_of_lanes=sum_of_lanes,
        warp_max=warp_max,
    )
