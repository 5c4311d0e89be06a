"""Rows of values, one a roller, as both the CPU's and the GPU's kernels keep them: how they are read and written."""

from dataclasses import dataclass
from functools import cache

import warp as wp

STATE_ROWS = wp.constant(6)
"""A variant's rows in `structs.State.rollers`: x, y, vx, vy, and the low parts of x, y."""

LANES = {wp.float64: 4, wp.float32: 8}
"""Rollers that the CPU's loops over rows take at a time; what lies beyond the chain's end is worked out, not read."""


@cache
def whole_lanes(Real: type) -> wp.Function:
    """The function that rounds a number up to a multiple of the lanes of `Real`."""
    lanes = LANES[Real]

    @wp.func
    def whole(n: int):
        """`n` rounded up to a multiple of `lanes`."""
        return (n + wp.static(lanes - 1)) & wp.static(-lanes)

    return whole


@dataclass(frozen=True)
class Accessors:
    """How the values of a row are read and written."""

    load_row: wp.Function
    store_row: wp.Function
    unlike: wp.Function


@cache
def accessors(Real: type) -> Accessors:
    """`load_row(array, i)` and `store_row(array, i, value)` for contiguous arrays of `Real`, without a stride.

    `unlike(array, first, count, value)`, on the CPU only, tells which of up to 64 values are not `value`, as bits. In
    Warp's debug build an index out of bounds ends the process, as it does for its own arrays.
    """

    @wp.func_native("assert(i >= 0 && i < a.shape[0]); return a.data[i];")
    def load_row(a: wp.array[Real], i: int) -> Real: ...

    @wp.func_native("assert(i >= 0 && i < a.shape[0]); a.data[i] = value;")
    def store_row(a: wp.array[Real], i: int, value: Real): ...

    @wp.func_native("""
        typedef decltype(value) Lanes __attribute__((ext_vector_type(8)));
        typedef bool Bits __attribute__((ext_vector_type(8)));
        assert(first >= 0 && first + count <= a.shape[0]);
        unsigned long long bits = 0;
        if (count < 8) {
            for (int k = 0; k < count; ++k)
                bits |= (unsigned long long)(a.data[first + k] != value) << k;
            return bits;
        }
        for (int k = 0; k < count; k += 8) {
            const int at = k + 8 <= count ? k : count - 8;
            Lanes lanes;
            __builtin_memcpy(&lanes, a.data + first + at, sizeof(lanes));
            const Bits found = __builtin_convertvector(lanes != value, Bits);
            unsigned char eight;
            __builtin_memcpy(&eight, &found, 1);
            bits |= (unsigned long long)eight << at;
        }
        return bits;
    """)
    def unlike(a: wp.array[Real], first: int, count: int, value: Real) -> wp.uint64: ...

    return Accessors(load_row, store_row, unlike)


@wp.func_native("assert(i >= 0 && i < rows.shape[0]); return rows.data[i];")
def load_constant(rows: wp.array[wp.vec2d], i: int) -> wp.vec2d:
    """Row i of a table that does not change, such as the directions of seats."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float4 row = __ldg((const float4*)(rows.data + i));
    return {row.x, row.y, row.z, row.w};
#else
    assert(i >= 0 && i < rows.shape[0]);
    return rows.data[i];
#endif
""")
def load_constant(rows: wp.array[wp.vec4f], i: int) -> wp.vec4f:
    """The same of four values, such as the high parts (x, y) and low parts (x, y) of a direction."""
    ...
