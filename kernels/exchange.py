"""What the threads of a block tell each other, thread i holding roller i: states, link forces, moments, bodies.

The only native code of the block kernel. On CUDA, neighbors talk through warp shuffles, and through shared memory at
the edges of warps; elsewhere through arrays that all threads read and write, which is also the plain description of
what is meant. (On the CPU a block's threads are cooperative fibers of one thread, and blocks follow each other, so
those arrays may be static.) A step has two barriers: in `state_of_next` and in `finish`.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

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


def _finish_snippet(real: str, threads: int, sprockets: int) -> str:
    return f"""
    wp::vec_t<{2 + sprockets}, {real}> out;
#if defined(__CUDA_ARCH__)
    __shared__ {real} edge[{threads // 32}][2];
    __shared__ {real} part[{threads // 32}][{sprockets}];
    const int lane = i & 31, warp = i >> 5, last = (count - 1) >> 5;
    out.c[0] = __shfl_up_sync(0xffffffffu, own.c[0], 1);
    out.c[1] = __shfl_up_sync(0xffffffffu, own.c[1], 1);
    if (lane == 31 || i == count - 1) if (i < count) {{ edge[warp][0] = own.c[0]; edge[warp][1] = own.c[1]; }}
    #pragma unroll
    for (int s = 0; s < {sprockets}; ++s) {{
        {real} sum = moment.c[s];
        if (__any_sync(0xffffffffu, sum != 0)) {{
            #pragma unroll
            for (int o = 16; o; o >>= 1) sum += __shfl_xor_sync(0xffffffffu, sum, o);
        }}
        if (lane == 0) part[warp][s] = sum;
    }}
    __syncthreads();
    if (lane == 0) {{
        const int from = warp > 0 ? warp - 1 : last;
        out.c[0] = edge[from][0];
        out.c[1] = edge[from][1];
    }}
    #pragma unroll
    for (int s = 0; s < {sprockets}; ++s) {{
        {real} sum = 0;
        if (i == s) for (int w = 0; w <= last; ++w) sum += part[w][s];
        out.c[2 + s] = sum;
    }}
#else
    static {real} all[{threads}][{2 + sprockets}];
    all[i][0] = own.c[0];
    all[i][1] = own.c[1];
    for (int s = 0; s < {sprockets}; ++s) all[i][2 + s] = moment.c[s];
    WP_TILE_SYNC();
    out.c[0] = all[i > 0 ? i - 1 : count - 1][0];
    out.c[1] = all[i > 0 ? i - 1 : count - 1][1];
    for (int s = 0; s < {sprockets}; ++s) {{
        {real} sum = 0;
        if (i == s) for (int j = 0; j < count; ++j) sum += all[j][2 + s];
        out.c[2 + s] = sum;
    }}
#endif
    return out;
"""


def _body_snippet(sprockets: int) -> str:
    return f"""
#if defined(__CUDA_ARCH__)
    __shared__ double bodies[{sprockets}][3];
#else
    static double bodies[{sprockets}][3];
#endif
    if (write) for (int k = 0; k < 3; ++k) bodies[s][k] = value.c[k];
    wp::vec_t<3, double> out;
    for (int k = 0; k < 3; ++k) out.c[k] = bodies[s][k];
    return out;
"""


@cache
def exchange(Real: type, threads: int, sprockets: int) -> SimpleNamespace:
    """The exchanges of a block of `threads` threads, a multiple of 32, for a drive of `sprockets` sprockets."""
    real = NAMES[Real]
    state = wp.types.vector(STATE, Real)
    vec2 = wp.types.vector(2, Real)
    moments = wp.types.vector(sprockets, Real)
    finished = wp.types.vector(2 + sprockets, Real)
    body = wp.types.vector(3, wp.float64)

    @wp.func_native(_next_snippet(real, threads, 4 if Real is wp.float64 else 6))
    def state_of_next(own: state, i: int, count: int) -> state:
        """State of the next roller; the step's first barrier."""
        ...

    @wp.func_native(_finish_snippet(real, threads, sprockets))
    def finish(own: vec2, moment: moments, i: int, count: int) -> finished:
        """Force of the link before; then, for thread s, the sum of the moments on sprocket s. The second barrier."""
        ...

    @wp.func_native(_body_snippet(sprockets))
    def sprocket_body(write: int, s: int, value: body) -> body:
        """Cosine, sine and angular velocity of sprocket s, written first if `write` is 1."""
        ...

    return SimpleNamespace(
        state=state, vec2=vec2, moments=moments, state_of_next=state_of_next, finish=finish, sprocket_body=sprocket_body
    )
