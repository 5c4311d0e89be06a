"""What the threads of a block tell each other, thread i holding roller i: states, link forces, and arrays they share.

The only native code of the block kernels. On CUDA, neighbors talk through warp shuffles, and through shared memory at
the edges of warps; elsewhere through arrays that all threads read and write, which is also the plain description of
what is meant. (On the CPU a block's threads are cooperative fibers of one thread, and blocks follow each other, so
those arrays may be static.) An evaluation has two barriers: in `state_of_next` and in `force_of_previous`.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .structs import Motion, Mount, Strand, Wheel, types
from .sum_structs import ContactSums, MountSums, SprocketSums, StrandSums

NAMES = {wp.float64: "double", wp.float32: "float"}
STATE = 6
"""Values of a roller that its neighbor reads: x, y, vx, vy and the low parts of x, y."""


def _next_snippet(real: str, threads: int, values: int) -> str:
    return f"""
    wp::vec_t<{STATE}, {real}> other;
#if defined(__CUDA_ARCH__)
    __shared__ {real} first[{threads // 32}][{values}];
    const int lane = i & 31, warp = i >> 5;
    if (lane == 0) {{
        #pragma unroll
        for (int k = 0; k < {values}; ++k) first[warp][k] = own.c[k];
    }}
    __syncthreads();
    #pragma unroll
    for (int k = 0; k < {values}; ++k) other.c[k] = __shfl_down_sync(0xffffffffu, own.c[k], 1);
    if (lane == 31 || i == count - 1) {{
        const int from = i + 1 < count ? warp + 1 : 0;
        #pragma unroll
        for (int k = 0; k < {values}; ++k) other.c[k] = first[from][k];
    }}
#else
    static {real} all[{threads}][{values}];
    for (int k = 0; k < {values}; ++k) all[i][k] = own.c[k];
    WP_TILE_SYNC();
    for (int k = 0; k < {values}; ++k) other.c[k] = all[i + 1 < count ? i + 1 : 0][k];
#endif
    return other;
"""


def _previous_snippet(real: str, threads: int) -> str:
    return f"""
    wp::vec_t<2, {real}> out;
#if defined(__CUDA_ARCH__)
    __shared__ {real} edge[{threads // 32}][2];
    const int lane = i & 31, warp = i >> 5;
    out.c[0] = __shfl_up_sync(0xffffffffu, own.c[0], 1);
    out.c[1] = __shfl_up_sync(0xffffffffu, own.c[1], 1);
    if (i < count && (lane == 31 || i == count - 1)) {{ edge[warp][0] = own.c[0]; edge[warp][1] = own.c[1]; }}
    __syncthreads();
    if (lane == 0) {{
        const int from = warp > 0 ? warp - 1 : (count - 1) >> 5;
        out.c[0] = edge[from][0];
        out.c[1] = edge[from][1];
    }}
#else
    static {real} all[{threads}][2];
    all[i][0] = own.c[0];
    all[i][1] = own.c[1];
    WP_TILE_SYNC();
    out.c[0] = all[i > 0 ? i - 1 : count - 1][0];
    out.c[1] = all[i > 0 ? i - 1 : count - 1][1];
#endif
    return out;
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


OWN = "return {all.data + first, count};"
"""A view of `count` values of a global array from `first` on."""

SHARED_BYTES = 40_000
"""Most bytes of shared memory for what each thread keeps; larger blocks keep it in global memory."""


def _shared_snippet(field: str, count: int, cpu_count: int) -> str:
    return f"""
#if defined(__CUDA_ARCH__)
    __shared__ __align__(16) char memory[{count} * sizeof(*like.{field}.data)];
    return {{(decltype(like.{field}.data))memory, {count}}};
#else
    static char memory[{cpu_count} * sizeof(*like.{field}.data)];
    return {{(decltype(like.{field}.data))memory, {cpu_count}}};
#endif
"""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __any_sync(0xffffffffu, flag);
#else
    return flag;
#endif
""")
def any_lane(flag: int) -> int:
    """Whether `flag` is not zero in any thread of this warp (on the CPU a warp is one thread)."""
    ...


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


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffs(mask) - 1;
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
    WP_TILE_SYNC();
""")
def barrier():
    """Waits for all threads of the block."""
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


def keeps_in_shared(Real: type, threads: int) -> bool:
    """Whether blocks of `threads` threads keep in shared memory what each thread adds up."""
    kinds = types(Real)
    kept = (kinds.Recent, kinds.Extra, ContactSums)
    return threads * sum(struct.numpy_dtype()["itemsize"] for struct in kept) <= SHARED_BYTES


@cache
def exchange(Real: type, threads: int, sprockets: int, guides: int) -> SimpleNamespace:
    """The exchanges of a block of `threads` threads (whole warps) for these numbers of sprockets and guide-bars."""
    real = NAMES[Real]
    state = wp.types.vector(STATE, Real)
    vec2 = wp.types.vector(2, Real)
    kinds = types(Real)

    @wp.func_native(_next_snippet(real, threads, 4 if Real is wp.float64 else 6))
    def state_of_next(own: state, i: int, count: int) -> state:
        """State of the next roller; the evaluation's first barrier."""
        ...

    @wp.func_native(_previous_snippet(real, threads))
    def force_of_previous(own: vec2, i: int, count: int) -> vec2:
        """Force of the link before; the evaluation's second barrier."""
        ...

    @wp.func_native(SUM)
    def warp_sum(value: Real) -> Real:
        """Sum of `value` over the threads of this warp."""
        ...

    @wp.func_native(LARGEST)
    def warp_max(value: Real) -> Real:
        """Largest `value` of the threads of this warp."""
        ...

    @wp.func_native(_shared_snippet("wheels", sprockets, sprockets))
    def wheels(like: kinds.Shared) -> wp.array(dtype=Wheel): ...

    @wp.func_native(_shared_snippet("teeth", sprockets, sprockets))
    def teeth(like: kinds.Shared) -> wp.array(dtype=kinds.Sprocket): ...

    @wp.func_native(_shared_snippet("bands", sprockets, sprockets))
    def bands(like: kinds.Shared) -> wp.array(dtype=kinds.Band): ...

    @wp.func_native(_shared_snippet("bars", max(guides, 1), max(guides, 1)))
    def bars(like: kinds.Shared) -> wp.array(dtype=kinds.Guide): ...

    @wp.func_native(_shared_snippet("chain", 1, 1))
    def chain(like: kinds.Shared) -> wp.array(dtype=kinds.Chain): ...

    @wp.func_native(_shared_snippet("parts", 3 * sprockets * (threads // 32), 3 * sprockets * threads))
    def parts(like: kinds.Shared) -> wp.array(dtype=wp.float64): ...

    @wp.func_native(_shared_snippet("motions", sprockets, sprockets))
    def motions(like: kinds.Shared) -> wp.array(dtype=Motion): ...

    @wp.func_native(_shared_snippet("strands", sprockets, sprockets))
    def strands(like: kinds.Shared) -> wp.array(dtype=Strand): ...

    @wp.func_native(_shared_snippet("mounts", sprockets, sprockets))
    def mounts(like: kinds.Shared) -> wp.array(dtype=Mount): ...

    @wp.func_native(_shared_snippet("mount_sums", sprockets, sprockets))
    def mount_sums(like: kinds.Shared) -> wp.array(dtype=MountSums): ...

    @wp.func_native(_shared_snippet("recent", threads, threads))
    def recent(like: kinds.Shared) -> wp.array(dtype=kinds.Recent): ...

    @wp.func_native(_shared_snippet("extra", threads, threads))
    def extra(like: kinds.Shared) -> wp.array(dtype=kinds.Extra): ...

    @wp.func_native(_shared_snippet("contact_sums", threads, threads))
    def contact_sums(like: kinds.Shared) -> wp.array(dtype=ContactSums): ...

    @wp.func_native(_shared_snippet("sprocket_sums", sprockets, sprockets))
    def sprocket_sums(like: kinds.Shared) -> wp.array(dtype=SprocketSums): ...

    @wp.func_native(_shared_snippet("strand_sums", sprockets, sprockets))
    def strand_sums(like: kinds.Shared) -> wp.array(dtype=StrandSums): ...

    @wp.func_native(OWN)
    def own_recent(all: wp.array(dtype=kinds.Recent), first: int, count: int) -> wp.array(dtype=kinds.Recent): ...

    @wp.func_native(OWN)
    def own_extra(all: wp.array(dtype=kinds.Extra), first: int, count: int) -> wp.array(dtype=kinds.Extra): ...

    @wp.func_native(OWN)
    def own_sums(all: wp.array(dtype=ContactSums), first: int, count: int) -> wp.array(dtype=ContactSums): ...

    @wp.func
    def shared_arrays(state: kinds.State, first: int, count: int):
        """The arrays that the block's threads share, for the variant whose `count` rollers begin at `first`."""
        shared = kinds.Shared()
        shared.wheels = wheels(shared)
        shared.teeth = teeth(shared)
        shared.bands = bands(shared)
        shared.bars = bars(shared)
        shared.chain = chain(shared)
        shared.parts = parts(shared)
        shared.motions = motions(shared)
        shared.mounts = mounts(shared)
        shared.strands = strands(shared)
        shared.mount_sums = mount_sums(shared)
        if wp.static(keeps_in_shared(Real, threads)):
            shared.recent = recent(shared)
            shared.extra = extra(shared)
            shared.contact_sums = contact_sums(shared)
        else:
            shared.recent = own_recent(state.recent, first, count)
            shared.extra = own_extra(state.extra, first, count)
            shared.contact_sums = own_sums(state.contact_sums, first, count)
        shared.sprocket_sums = sprocket_sums(shared)
        shared.strand_sums = strand_sums(shared)
        return shared

    return SimpleNamespace(
        state=state,
        state_of_next=state_of_next,
        force_of_previous=force_of_previous,
        warp_sum=warp_sum,
        warp_max=warp_max,
        shared_arrays=shared_arrays,
    )
