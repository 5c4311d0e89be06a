"""Square roots and reciprocals: on CUDA from the hardware's estimate, whose error of 2^-20 one third-order correction
takes below round-off, where a root and a division would be subroutines; elsewhere as written. And comparisons in which
the lanes of a warp do not part.
"""

from typing import Any

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    double y;
    asm("rsqrt.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(square));
    const double e = fma(-square * y, y, 1.0);
    return fma(y * e, fma(0.375, e, 0.5), y);
#else
    return 1.0 / sqrt(square);
#endif
""")
def inverse_root(square: wp.float64) -> wp.float64:
    """1 / sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrtf(square);
#else
    return 1.0f / sqrtf(square);
#endif
""")
def inverse_root(square: wp.float32) -> wp.float32:
    """1 / sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    double y;
    asm("rsqrt.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(square));
    const double e = fma(-square * y, y, 1.0);
    return square * fma(y * e, fma(0.375, e, 0.5), y);
#else
    return sqrt(square);
#endif
""")
def root(square: wp.float64) -> wp.float64:
    """sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return square * rsqrtf(square);
#else
    return sqrtf(square);
#endif
""")
def root(square: wp.float32) -> wp.float32:
    """sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    double y;
    asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(value));
    const double e = fma(-value, y, 1.0);
    return fma(y * e, fma(e, e, 1.0 + e), y);
#else
    return 1.0 / value;
#endif
""")
def reciprocal(value: wp.float64) -> wp.float64:
    """1 / value, which is of ordinary size, to round-off."""
    ...


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
    """1 / value, which is of ordinary size, to round-off."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    double y;
    asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(y) : "d"(by));
    const double e = fma(-by, y, 1.0);
    return value * fma(y * e, fma(e, e, 1.0 + e), y);
#else
    return value / by;
#endif
""")
def quotient(value: wp.float64, by: wp.float64) -> wp.float64:
    """`value` / `by`, which is of ordinary size; on CUDA to round-off."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fdividef(value, by);
#else
    return value / by;
#endif
""")
def quotient(value: wp.float32, by: wp.float32) -> wp.float32:
    """`value` / `by`, which is of ordinary size, to two units of the last place."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fma_rn(a, b, __dmul_rn(c, d));
#else
    const double first = a * b;
    const double second = c * d;
    return first + second;
#endif
""")
def products(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64) -> wp.float64:
    """a b + c d; on CUDA rounded alike wherever it stands, which the compiler would choose each time."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fmaf_rn(a, b, __fmul_rn(c, d));
#else
    const float first = a * b;
    const float second = c * d;
    return first + second;
#endif
""")
def products(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32) -> wp.float32:
    """a b + c d, as at float64."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __dmul_rn(a, b);
#else
    return a * b;
#endif
""")
def product(a: wp.float64, b: wp.float64) -> wp.float64:
    """a b; on CUDA drawn into no sum, so that kernels in which more or less is done with it give the same bits."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fmul_rn(a, b);
#else
    return a * b;
#endif
""")
def product(a: wp.float32, b: wp.float32) -> wp.float32:
    """a b, as at float64."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return b < a ? b : a;
#else
    return wp::min(a, b);
#endif
""")
def smaller(a: wp.float64, b: wp.float64) -> wp.float64:
    """The smaller of two; on CUDA without the instructions that keep it a number where one of them is none."""
    ...


@wp.func_native("return wp::min(a, b);")
def smaller(a: wp.float32, b: wp.float32) -> wp.float32:
    """The smaller of two."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return a < b ? b : a;
#else
    return wp::max(a, b);
#endif
""")
def larger(a: wp.float64, b: wp.float64) -> wp.float64:
    """The larger of two, as `smaller`."""
    ...


@wp.func_native("return wp::max(a, b);")
def larger(a: wp.float32, b: wp.float32) -> wp.float32:
    """The larger of two."""
    ...


@wp.func
def inside(value: Any, low: Any, high: Any):
    """1 where low < `value` < high, else 0; `and` would be a branch."""
    return int(value > low) & int(value < high)
