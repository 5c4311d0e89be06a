"""Native code for CPU and GPUs: rows of values, roots, reciprocals, sums of products, comparisons.

CUDA fuses a sum of products: one product is not rounded.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp


def code_by_device(cuda: str, elsewhere: str) -> str:
    """Source of a native function, of CUDA and elsewhere."""
    return f"#if defined(__CUDA_ARCH__)\n{cuda}\n#else\n{elsewhere}\n#endif\n"


INVERSE_ROOT = """
    double y;
    asm("rsqrt.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(square));
    const double e = fma(-square * y, y, 1.0);
    y = fma(y * e, fma(0.375, e, 0.5), y);
"""
"""Native code of y = 1/sqrt(square), as float64."""

RECIPROCAL = """
    double y;
    asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(value));
    const double e = fma(-value, y, 1.0);
    y = fma(y * e, fma(e, e, 1.0 + e), y);
"""
"""Native code of y = 1/value, as float64."""

STATE_ROWS = wp.constant(6)
"""Rows of a variant in `structs.State.rollers`: x, y, vx, vy, low x, y."""

LANES = {wp.float64: 4, wp.float32: 8}
"""Rollers that the CPU's vectorized loops take at once, by type."""


@dataclass(frozen=True)
class RowAccess:
    """Native access to contiguous arrays, checked in Warp's debug build."""

    load: wp.Function
    store: wp.Function
    find_unlike: wp.Function
    find_above: wp.Function
    copy_rows: wp.Function
    shifted_rows: wp.Function
    round_up: wp.Function
    whole_vectors: wp.Function


def _bits_of_values(comparison: str) -> str:
    """Native code that compares `count` values of an array `a`, from `first` on, with `value`."""
    return f"""
        typedef decltype(value) Lanes __attribute__((ext_vector_type(8)));
        typedef bool Bits __attribute__((ext_vector_type(8)));
        assert(first >= 0 && first + count <= a.shape[0]);
        unsigned long long bits = 0;
        if (count < 8) {{
            for (int k = 0; k < count; ++k)
                bits |= (unsigned long long)(a.data[first + k] {comparison} value) << k;
            return bits;
        }}
        for (int k = 0; k < count; k += 8) {{
            const int at = k + 8 <= count ? k : count - 8;
            Lanes lanes;
            __builtin_memcpy(&lanes, a.data + first + at, sizeof(lanes));
            const Bits found = __builtin_convertvector(lanes {comparison} value, Bits);
            unsigned char eight;
            __builtin_memcpy(&eight, &found, 1);
            bits |= (unsigned long long)eight << at;
        }}
        return bits;
    """


@cache
def row_access(Real: type) -> RowAccess:
    """Native access to arrays of `Real`; on the CPU all but `load` and `store`, too."""
    lanes = LANES.get(Real, 1)

    @wp.func_native("assert(i >= 0 && i < a.shape[0]); return a.data[i];")
    def load(a: wp.array[Real], i: int) -> Real:
        """Value `i` of an array, by native code."""

    @wp.func_native("assert(i >= 0 && i < a.shape[0]); a.data[i] = value;")
    def store(a: wp.array[Real], i: int, value: Real):
        """Sets value `i` of an array, by native code."""

    @wp.func_native(_bits_of_values("!="))
    def find_unlike(a: wp.array[Real], first: int, count: int, value: Real) -> wp.uint64:
        """Bits of up to 64 values of an array, from `first` on, unlike `value`."""

    @wp.func_native(_bits_of_values(">"))
    def find_above(a: wp.array[Real], first: int, count: int, value: Real) -> wp.uint64:
        """Bits of up to 64 values of an array, from `first` on, above `value`."""

    @wp.func_native("""
        assert(first >= 0 && first + (rows - 1) * pitch + count <= a.shape[0]);
        assert(to >= 0 && to + (rows - 1) * to_pitch + count <= a.shape[0] && count % (32 / sizeof(*a.data)) == 0);
        for (int r = 0; r < rows; ++r)
            for (int k = 0; k < count; k += 32 / sizeof(*a.data))
                __builtin_memcpy(a.data + to + r * to_pitch + k, a.data + first + r * pitch + k, 32);
    """)
    def copy_rows(a: wp.array[Real], first: int, pitch: int, to: int, to_pitch: int, rows: int, count: int):
        """Copies `rows` times `count` values of an array, in whole vectors, from `pitch` apart to `to_pitch` apart."""

    @wp.func_native("""
        auto view = a;
        view.data = (decltype(view.data))((size_t)a.data + shift * sizeof(*a.data));
        view.shape[0] -= shift;
        return view;
    """)
    def shifted_rows(a: wp.array[Real], shift: int) -> wp.array[Real]:
        """Array whose value 0 is value `shift` of another, and that loops vectorize beside it."""

    @wp.func
    def round_up(n: int):
        """`n` rounded up to the vector lanes of `Real`."""
        return (n + wp.static(lanes - 1)) & wp.static(-lanes)

    @wp.func
    def whole_vectors(n: int):
        """`n` rounded up to two times the vector lanes of `Real`, which long loops take at once."""
        return (n + wp.static(2 * lanes - 1)) & wp.static(-2 * lanes)

    return RowAccess(
        load=load,
        store=store,
        find_unlike=find_unlike,
        find_above=find_above,
        copy_rows=copy_rows,
        shifted_rows=shifted_rows,
        round_up=round_up,
        whole_vectors=whole_vectors,
    )


@cache
def aligned_rows(kind: Any) -> wp.Function:
    """Native function that has arrays of structs read in whole rows."""

    @wp.func_native("""
        auto view = rows;
        view.data = (decltype(view.data))__builtin_assume_aligned(view.data, 16);
        return view;
    """)
    def aligned(rows: wp.array[kind]) -> wp.array[kind]:
        """Array to be read in rows of 16 bytes."""

    return aligned


@wp.func
def load_constant(rows: Any, i: int):
    """Row `i` of a constant table."""
    return rows[i]


@wp.func_native("assert(i >= 0 && i < rows.shape[0]); return rows.data[i];")
def load_constant(rows: wp.array[wp.vec2d], i: int) -> wp.vec2d:
    """Row `i` of a constant table of vectors."""


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
    """Row `i` of a constant table of four values."""


@wp.func_native(code_by_device(INVERSE_ROOT + "return y;", "return 1.0 / sqrt(square);"))
def inverse_root(square: wp.float64) -> wp.float64:
    """Native 1/sqrt(square) at float64, square > 0."""


@wp.func_native(code_by_device("return rsqrtf(square);", "return 1.0f / sqrtf(square);"))
def inverse_root(square: wp.float32) -> wp.float32:
    """Native 1/sqrt(square) at float32, square > 0."""


@wp.func_native(code_by_device(INVERSE_ROOT + "return square * y;", "return sqrt(square);"))
def root(square: wp.float64) -> wp.float64:
    """Native sqrt(square) at float64, square > 0."""


@wp.func_native(code_by_device("return square * rsqrtf(square);", "return sqrtf(square);"))
def root(square: wp.float32) -> wp.float32:
    """Native sqrt(square) at float32, square > 0."""


@wp.func_native(code_by_device(RECIPROCAL + "return y;", "return 1.0 / value;"))
def reciprocal(value: wp.float64) -> wp.float64:
    """Native 1/value at float64, of ordinary size."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    float y;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(value));
    return y;
#else
    return 1.0f / value;
#endif
""")
def reciprocal(value: wp.float32) -> wp.float32:
    """Native 1/value at float32, of ordinary size."""


@wp.func_native(code_by_device(RECIPROCAL.replace("value", "by") + "return value * y;", "return value / by;"))
def quotient(value: wp.float64, by: wp.float64) -> wp.float64:
    """Native value/by at float64, of ordinary size."""


@wp.func_native(code_by_device("return __fdividef(value, by);", "return value / by;"))
def quotient(value: wp.float32, by: wp.float32) -> wp.float32:
    """Native value/by at float32, of ordinary size, to two units."""


MULTIPLY_ADD = code_by_device("return fma(a, b, c);", "const auto product = a * b; return product + c;")
PRODUCTS = code_by_device(
    "return fma(a, b, c * d);", "const auto first = a * b, second = c * d; return first + second;"
)
DOT = code_by_device("return fma(a[1], b[1], a[0] * b[0]);", "return wp::dot(a, b);")
ALONG = code_by_device(
    "return {fma(s, b[0], a[0]), fma(s, b[1], a[1])};",
    "const auto x = s * b[0], y = s * b[1]; return {a[0] + x, a[1] + y};",
)
"""Native code of a + s b, vectors."""


@wp.func_native(MULTIPLY_ADD)
def multiply_add(a: wp.float64, b: wp.float64, c: wp.float64) -> wp.float64:
    """Native a b + c at float64."""


@wp.func_native(MULTIPLY_ADD)
def multiply_add(a: wp.float32, b: wp.float32, c: wp.float32) -> wp.float32:
    """Native a b + c at float32."""


@wp.func_native(PRODUCTS)
def products(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64) -> wp.float64:
    """Native a b + c d at float64."""


@wp.func_native(PRODUCTS)
def products(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32) -> wp.float32:
    """Native a b + c d at float32."""


@wp.func_native(DOT)
def dot(a: wp.vec2d, b: wp.vec2d) -> wp.float64:
    """Native dot product of float64 vectors."""


@wp.func_native(DOT)
def dot(a: wp.vec2f, b: wp.vec2f) -> wp.float32:
    """Native dot product of float32 vectors."""


@wp.func_native(ALONG)
def sum_with_multiple(a: wp.vec2d, s: wp.float64, b: wp.vec2d) -> wp.vec2d:
    """Native vector a + s b at float64."""


@wp.func_native(ALONG)
def sum_with_multiple(a: wp.vec2f, s: wp.float32, b: wp.vec2f) -> wp.vec2f:
    """Native vector a + s b at float32."""


@wp.func_native("return b < a ? b : a;")
def smaller(a: wp.float64, b: wp.float64) -> wp.float64:
    """Native smaller of two float64, without regard for NaN."""


@wp.func_native(code_by_device("return wp::min(a, b);", "return b < a ? b : a;"))
def smaller(a: wp.float32, b: wp.float32) -> wp.float32:
    """Native smaller of two float32; on CUDA passes over NaN."""


@wp.func_native("return a < b ? b : a;")
def larger(a: wp.float64, b: wp.float64) -> wp.float64:
    """Native larger of two float64, without regard for NaN."""


@wp.func_native(code_by_device("return wp::max(a, b);", "return a < b ? b : a;"))
def larger(a: wp.float32, b: wp.float32) -> wp.float32:
    """Native larger of two float32; on CUDA passes over NaN."""


@wp.func
def is_between(value: Any, low: Any, high: Any):
    """1 where low < value < high, else 0, without branches."""
    return int(value > low) & int(value < high)
