r"""Pairs of float32, a value and what it rounds off: 48 bits without float64, whose rate on workstation GPUs is 1/64.

A sum of two floats is exactly a float and its error (Knuth's two-sum), a product is one too (an fma gives the error):

    s = fl(a + b), t = s - a, e = (a - (s - t)) + (b - t);        p = fl(a b), e = fma(a, b, -p).

On CUDA both are spelled so that no product is drawn into a sum. What the rest of a kernel does with the low parts is
plain float32.
"""

import numpy as np
import warp as wp


def split(value: float) -> tuple[float, float]:
    """High and low part of a number, for constants of kernels."""
    high = float(np.float32(value))
    return high, float(np.float32(value - high))


@wp.struct
class Pair:
    """A number `high` + `low`; `low` is at most about the rounding of `high`."""

    high: wp.float32
    low: wp.float32


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float s = __fadd_rn(a, b), t = __fsub_rn(s, a);
    return {s, __fadd_rn(__fsub_rn(a, __fsub_rn(s, t)), __fsub_rn(b, t))};
#else
    const float s = a + b, t = s - a;
    return {s, (a - (s - t)) + (b - t)};
#endif
""")
def two_sum(a: wp.float32, b: wp.float32) -> wp.vec2f:
    """a + b, rounded, and the error of that."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float s = __fsub_rn(a, b), t = __fsub_rn(s, a);
    return {s, __fsub_rn(__fsub_rn(a, __fsub_rn(s, t)), __fadd_rn(b, t))};
#else
    const float s = a - b, t = s - a;
    return {s, (a - (s - t)) - (b + t)};
#endif
""")
def two_difference(a: wp.float32, b: wp.float32) -> wp.vec2f:
    """a - b, rounded, and the error of that."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float p = __fmul_rn(a, b);
    return {p, __fmaf_rn(a, b, -p)};
#else
    const float p = a * b;
    return {p, (float)((double)a * (double)b - (double)p)};
#endif
""")
def two_product(a: wp.float32, b: wp.float32) -> wp.vec2f:
    """a b, rounded, and the error of that."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float p = __fmul_rn(b, c);
    return __fsub_rn(__fmaf_rn(a, d, -p), __fmaf_rn(b, c, -p));
#else
    return (float)((double)a * (double)d - (double)b * (double)c);
#endif
""")
def cross(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32) -> wp.float32:
    """a d - b c to round-off of itself, however much of the products cancels (Kahan)."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fadd_rn(a, b);
#else
    return a + b;
#endif
""")
def rounded_sum(a: wp.float32, b: wp.float32) -> wp.float32:
    """a + b, into which no product is drawn."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __fmaf_rn(a, b, c);
#else
    return (float)((double)a * (double)b + (double)c);
#endif
""")
def fused(a: wp.float32, b: wp.float32, c: wp.float32) -> wp.float32:
    """a b + c, rounded once."""
    ...


@wp.func
def pair(high: wp.float32, low: wp.float32):
    """`high` + `low`."""
    made = Pair()
    made.high = high
    made.low = low
    return made


@wp.func
def exact_sum(a: wp.float32, b: wp.float32):
    """a + b."""
    sum = two_sum(a, b)
    return pair(sum[0], sum[1])


@wp.func
def exact_product(a: wp.float32, b: wp.float32):
    """a b."""
    product = two_product(a, b)
    return pair(product[0], product[1])


@wp.func
def settled(high: wp.float32, low: wp.float32):
    """A pair whose `low` may have grown, but is smaller than `high` (fast two-sum)."""
    sum = high + low
    return pair(sum, low - (sum - high))


@wp.func
def trimmed(a: Pair):
    """A pair to 2^-48 of itself, which float64 holds exactly; trimmed again it stays as it is."""
    anchor = a.high * wp.static(1.5 / 2.0**25)
    return pair(a.high, rounded_sum(rounded_sum(a.low, anchor), -anchor))


@wp.func
def plus(a: Pair, b: Pair):
    """a + b."""
    s = exact_sum(a.high, b.high)
    return settled(s.high, s.low + (a.low + b.low))


@wp.func
def plus(a: Pair, b: wp.float32):
    """a + b."""
    s = exact_sum(a.high, b)
    return settled(s.high, s.low + a.low)


@wp.func
def minus(a: Pair):
    """-a."""
    return pair(-a.high, -a.low)


@wp.func
def times(a: Pair, b: Pair):
    """a b."""
    p = exact_product(a.high, b.high)
    return settled(p.high, p.low + (a.high * b.low + a.low * b.high))


@wp.func
def times(a: Pair, b: wp.float32):
    """a b."""
    p = exact_product(a.high, b)
    return settled(p.high, p.low + a.low * b)


@wp.func
def apart(a: Pair, b: Pair):
    """a - b, rounded once."""
    d = two_difference(a.high, b.high)
    return d[0] + (d[1] + (a.low - b.low))


@wp.func
def rounded(a: Pair):
    """a as one float32."""
    return a.high + a.low


@wp.func
def rounded(a: wp.float64):
    """A float64 stays what it is."""
    return a


@wp.func
def added(sum: Pair, value: wp.float32):
    """A sum and a value that is small beside it, or the first; float64 holds it exactly."""
    return trimmed(settled(sum.high, sum.low + value))


@wp.func
def added(sum: wp.float64, value: wp.float64):
    """The same at float64."""
    return sum + value


@wp.func
def pair_of(value: wp.float64):
    """A float64, rounded to 48 bits."""
    high = wp.float32(value)
    return pair(high, wp.float32(value - wp.float64(high)))


@wp.func
def pair_of(value: wp.float32):
    """A float32 as a pair."""
    return pair(value, 0.0)


@wp.func
def whole(a: Pair):
    """A pair as float64."""
    return wp.float64(a.high) + wp.float64(a.low)


@wp.func
def counted(count: int, unit: Pair):
    """`count` times `unit`, exact in the count up to 2^36."""
    thousands = count // 4096
    return plus(times(unit, 4096.0 * float(thousands)), times(unit, float(count - 4096 * thousands)))
