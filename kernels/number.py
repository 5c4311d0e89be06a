"""One number at two precisions: float64, or a pair of float32 on blocks without float64.

A pair is a value and what it rounds off: 48 bits. A float32 sum is exactly a float and its error (Knuth's two-sum), and
so is a product:

    s = fl(a + b), t = s - a, e = (a - (s - t)) + (b - t);        p = fl(a b), e = fma(a, b, -p).

No compiler may fuse a product into these sums (`modules.without_contraction`). Modules that import `add`, `sub`, `mul`,
`div` have signs between pairs, and between numbers and literals exact in float32 (0.5, not 0.1). Quotients of literals
are `wp.static`: kernels divide them in float32.

Sine and cosine are the same on every device: angle = k pi/2 + r, |r| <= pi/4, and series to r^17 and r^16. A pair's
logarithm is ln r = e ln 2 + 2 s (1 + s^2/3 + s^4/5 + ...), s = (m - 1)/(m + 1), r = 2^e m.
"""

import math
from typing import Any

import numpy as np
import warp as wp

from .native import code_by_device, multiply_add, products, quotient


def high_and_low_parts(value: float) -> tuple[float, float]:
    """High and low float32 parts of a constant number."""
    high = float(np.float32(value))
    return high, float(np.float32(value - high))


@wp.struct
class Pair:
    """A number `high` + `low`, the latter its rounding."""

    high: wp.float32
    low: wp.float32


@wp.struct
class PairVector:
    """A vector of two pairs, `high` + `low`."""

    high: wp.vec2f
    low: wp.vec2f


@wp.struct
class RecentSum:
    """A pair's sum with latest additions in float32."""

    sum: Pair
    recent: wp.float32


@wp.func
def two_sum(a: wp.float32, b: wp.float32):
    """a + b of float32, and its rounding error."""
    s = a + b
    t = s - a
    return wp.vec2f(s, (a - (s - t)) + (b - t))


@wp.func
def two_difference(a: wp.float32, b: wp.float32):
    """a - b of float32, and its rounding error."""
    s = a - b
    t = s - a
    return wp.vec2f(s, (a - (s - t)) - (b + t))


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float p = a * b;
    return {p, fma(a, b, -p)};
#else
    const float p = a * b;
    return {p, (float)((double)a * (double)b - (double)p)};
#endif
""")
def two_product(a: wp.float32, b: wp.float32) -> wp.vec2f:
    """a b of float32, and its rounding error."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float p = b * c;
    return fma(a, d, -p) - fma(b, c, -p);
#else
    return (float)((double)a * (double)d - (double)b * (double)c);
#endif
""")
def cross_product(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32) -> wp.float32:
    """a d - b c of float32 to round-off (Kahan)."""


@wp.func_native(code_by_device("return fma(a, b, c);", "return (float)((double)a * (double)b + (double)c);"))
def fused_multiply_add(a: wp.float32, b: wp.float32, c: wp.float32) -> wp.float32:
    """a b + c of float32, rounded once."""


@wp.func
def pair(high: wp.float32, low: wp.float32):
    """The pair `high` + `low`."""
    made = Pair()
    made.high = high
    made.low = low
    return made


@wp.func
def pair_from_float64(value: wp.float64):
    """The pair of a float64, rounded to 48 bits."""
    high = wp.float32(value)
    return pair(high, wp.float32(value - wp.float64(high)))


@wp.func
def pair_vector(high: wp.vec2f, low: wp.vec2f):
    """The vector of pairs `high` + `low`."""
    made = PairVector()
    made.high = high
    made.low = low
    return made


@wp.func
def number_of(value: wp.float32):
    """The pair of a float32."""
    return pair(value, 0.0)


@wp.func
def number_of(value: wp.vec2f):
    """The vector of pairs of a float32 vector."""
    return pair_vector(value, wp.vec2f())


@wp.func
def number_of(value: Any):
    """A float64 as a number: itself."""
    return value


@wp.func
def float64_from_pair(a: Pair):
    """The float64 of a pair."""
    return wp.float64(a.high) + wp.float64(a.low)


@wp.func
def vector(x: Pair, y: Pair):
    """The vector (x, y) of two pairs."""
    return pair_vector(wp.vec2f(x.high, y.high), wp.vec2f(x.low, y.low))


@wp.func
def vector(x: wp.float64, y: wp.float64):
    """The vector (x, y) of two float64."""
    return wp.vec2d(x, y)


@wp.func
def component(v: PairVector, k: int):
    """Component `k` of a vector of pairs."""
    return pair(v.high[k], v.low[k])


@wp.func
def component(v: wp.vec2d, k: int):
    """Component `k` of a float64 vector."""
    return v[k]


@wp.func
def exact_sum(a: wp.float32, b: wp.float32):
    """a + b of float32 as an exact pair."""
    sum = two_sum(a, b)
    return pair(sum[0], sum[1])


@wp.func
def exact_product(a: wp.float32, b: wp.float32):
    """a b of float32 as an exact pair."""
    product = two_product(a, b)
    return pair(product[0], product[1])


@wp.func
def normalized_pair(high: wp.float32, low: wp.float32):
    """Pair of `high` and a smaller `low`, which may have grown."""
    sum = high + low
    return pair(sum, low - (sum - high))


@wp.func
def add(a: Pair, b: Pair):
    """a + b of pairs."""
    s = exact_sum(a.high, b.high)
    return normalized_pair(s.high, s.low + (a.low + b.low))


@wp.func
def add(a: Pair, b: wp.float32):
    """a + b of a pair and a float32."""
    s = exact_sum(a.high, b)
    return normalized_pair(s.high, s.low + a.low)


@wp.func
def add(a: wp.float32, b: Pair):
    """a + b of a float32 and a pair."""
    return add(b, a)


@wp.func
def add(a: wp.float32, b: wp.float64):
    """a + b of a literal and a float64."""
    return wp.float64(a) + b


@wp.func
def sub(a: Pair, b: Pair):
    """a - b of pairs."""
    s = two_difference(a.high, b.high)
    return normalized_pair(s[0], s[1] + (a.low - b.low))


@wp.func
def sub(a: Pair, b: wp.float32):
    """a - b of a pair and a float32."""
    return add(a, -b)


@wp.func
def sub(a: wp.float32, b: Pair):
    """a - b of a float32 and a pair."""
    s = two_difference(a, b.high)
    return normalized_pair(s[0], s[1] - b.low)


@wp.func
def sub(a: wp.float32, b: wp.float64):
    """a - b of a literal and a float64."""
    return wp.float64(a) - b


@wp.func
def mul(a: Pair, b: Pair):
    """a b of pairs."""
    p = exact_product(a.high, b.high)
    return normalized_pair(p.high, p.low + products(a.high, b.low, a.low, b.high))


@wp.func
def mul(a: Pair, b: wp.float32):
    """a b of a pair and a float32."""
    p = exact_product(a.high, b)
    return normalized_pair(p.high, fused_multiply_add(a.low, b, p.low))


@wp.func
def mul(a: wp.float32, b: Pair):
    """a b of a float32 and a pair."""
    return mul(b, a)


@wp.func
def mul(a: wp.float64, b: wp.float32):
    """a b of a float64 and a literal."""
    return a * wp.float64(b)


@wp.func
def mul(a: wp.float32, b: wp.float64):
    """a b of a literal and a float64."""
    return wp.float64(a) * b


@wp.func
def div(a: Pair, b: Pair):
    """a / b of pairs."""
    q = quotient(a.high, b.high)
    p = exact_product(q, b.high)
    return normalized_pair(q, quotient(((a.high - p.high) - p.low) + fused_multiply_add(-q, b.low, a.low), b.high))


@wp.func
def div(a: Pair, b: wp.float32):
    """a / b of a pair and a float32."""
    return div(a, pair(b, 0.0))


@wp.func
def div(a: wp.float64, b: wp.float64):
    """a / b of float64."""
    return quotient(a, b)


@wp.func
def div(a: wp.float64, b: wp.float32):
    """a / b of a float64 and a literal."""
    return a / wp.float64(b)


@wp.func
def add(a: PairVector, b: PairVector):
    """a + b of vectors of pairs."""
    return vector(add(component(a, 0), component(b, 0)), add(component(a, 1), component(b, 1)))


@wp.func
def add(a: PairVector, b: wp.vec2f):
    """a + b of pairs' and float32 vectors."""
    return vector(add(component(a, 0), b[0]), add(component(a, 1), b[1]))


@wp.func
def sub(a: PairVector, b: PairVector):
    """a - b of vectors of pairs."""
    return vector(sub(component(a, 0), component(b, 0)), sub(component(a, 1), component(b, 1)))


@wp.func
def mul(a: wp.float32, b: PairVector):
    """a b of a float32 and pairs' vector."""
    return vector(mul(a, component(b, 0)), mul(a, component(b, 1)))


@wp.func
def mul(a: PairVector, b: wp.float32):
    """a b of a pairs' vector and float32."""
    return mul(b, a)


@wp.func
def mul(a: Pair, b: wp.vec2f):
    """a b of a pair and float32 vector."""
    return vector(mul(a, b[0]), mul(a, b[1]))


@wp.func
def difference(a: Pair, b: Pair):
    """a - b of pairs as a float32."""
    d = two_difference(a.high, b.high)
    return d[0] + (d[1] + (a.low - b.low))


@wp.func
def difference(a: PairVector, b: PairVector):
    """a - b as a pairs' vector, not normalized."""
    x = two_difference(a.high[0], b.high[0])
    y = two_difference(a.high[1], b.high[1])
    return pair_vector(wp.vec2f(x[0], y[0]), wp.vec2f(x[1] + (a.low[0] - b.low[0]), y[1] + (a.low[1] - b.low[1])))


@wp.func
def difference(a: Any, b: Any):
    """a - b of float64."""
    return a - b


@wp.func
def leading_value(a: Pair):
    """High part of a pair."""
    return a.high


@wp.func
def leading_value(a: PairVector):
    """High parts of a vector of pairs."""
    return a.high


@wp.func
def leading_value(a: Any):
    """Leading value of a float64: itself."""
    return a


@wp.func
def rounded_value(a: Pair):
    """A pair rounded to float32."""
    return a.high + a.low


@wp.func
def rounded_value(a: PairVector):
    """A vector of pairs rounded to float32."""
    return a.high + a.low


@wp.func
def rounded_value(a: Any):
    """Rounded value of a float64: itself."""
    return a


@wp.func
def trimmed_value(a: Pair):
    """A pair to 2^-48 of itself, exact in float64."""
    anchor = a.high * wp.static(1.5 / 2.0**25)
    return pair(a.high, (a.low + anchor) - anchor)


@wp.func
def trimmed_value(a: PairVector):
    """A pairs' vector to 2^-48 of its components."""
    return vector(trimmed_value(component(a, 0)), trimmed_value(component(a, 1)))


@wp.func
def trimmed_value(a: Any):
    """Trimmed value of a float64: itself."""
    return a


@wp.func
def sum_with(sum: Pair, value: wp.float32):
    """A pair's sum with a small value added; 0 keeps all bits."""
    more = trimmed_value(normalized_pair(sum.high, sum.low + value))
    return pair(wp.where(value == 0.0, sum.high, more.high), wp.where(value == 0.0, sum.low, more.low))


@wp.func
def sum_with(sum: PairVector, value: wp.vec2f):
    """A pairs' vector sum with a small vector added."""
    return vector(sum_with(component(sum, 0), value[0]), sum_with(component(sum, 1), value[1]))


@wp.func
def sum_with(sum: RecentSum, value: wp.float32):
    """A `RecentSum` with a value added in float32."""
    sum.recent = sum.recent + value
    return sum


@wp.func
def sum_with(sum: Any, value: Any):
    """A float64 sum with a value added."""
    return sum + value


@wp.func
def gathered_sum(a: RecentSum):
    """A `RecentSum` with its latest additions in its pair."""
    a.sum = sum_with(a.sum, a.recent)
    a.recent = 0.0
    return a


@wp.func
def gathered_sum(a: Any):
    """Gathered sum of a float64: itself."""
    return a


@wp.func
def exact_multiple(count: int, unit: Pair):
    """`count` times a pair, exact to 2^36."""
    thousands = count // 4096
    return 4096.0 * float(thousands) * unit + float(count - 4096 * thousands) * unit


@wp.func
def exact_multiple(count: int, unit: wp.float64):
    """`count` times a float64."""
    return wp.float64(count) * unit


TWO_OVER_PI = wp.constant(wp.float64(0.6366197723675814))
HALF_PI_1 = wp.constant(wp.float64(1.5707963267341256))
HALF_PI_2 = wp.constant(wp.float64(6.077100506303966e-11))
HALF_PI_3 = wp.constant(wp.float64(2.0222662487959506e-21))


@wp.func
def sine_cosine(angle: wp.float64):
    """sin, cos of a float64 angle [rad], to 2e-16, below 1.6e6."""
    one = wp.float64(1.0)
    k = wp.rint(angle * TWO_OVER_PI)
    r = multiply_add(-k, HALF_PI_3, multiply_add(-k, HALF_PI_2, multiply_add(-k, HALF_PI_1, angle)))
    q = r * r
    s = multiply_add(-q, wp.static(wp.float64(1.0 / 272.0)), one)
    s = multiply_add(-q * s, wp.static(wp.float64(1.0 / 210.0)), one)
    s = multiply_add(-q * s, wp.static(wp.float64(1.0 / 156.0)), one)
    s = multiply_add(-q * s, wp.static(wp.float64(1.0 / 110.0)), one)
    s = multiply_add(-q * s, wp.static(wp.float64(1.0 / 72.0)), one)
    s = multiply_add(-q * s, wp.static(wp.float64(1.0 / 42.0)), one)
    s = multiply_add(-q * s, wp.static(wp.float64(1.0 / 20.0)), one)
    sine = multiply_add(-r * q * s, wp.static(wp.float64(1.0 / 6.0)), r)
    c = multiply_add(-q, wp.static(wp.float64(1.0 / 240.0)), one)
    c = multiply_add(-q * c, wp.static(wp.float64(1.0 / 182.0)), one)
    c = multiply_add(-q * c, wp.static(wp.float64(1.0 / 132.0)), one)
    c = multiply_add(-q * c, wp.static(wp.float64(1.0 / 90.0)), one)
    c = multiply_add(-q * c, wp.static(wp.float64(1.0 / 56.0)), one)
    c = multiply_add(-q * c, wp.static(wp.float64(1.0 / 30.0)), one)
    c = multiply_add(-q * c, wp.static(wp.float64(1.0 / 12.0)), one)
    cosine = multiply_add(wp.float64(-0.5) * q, c, one)
    quadrant = int(k) & 3
    odd = (quadrant & 1) == 1
    sign = wp.where((quadrant & 2) == 2, -one, one)
    return sign * wp.where(odd, cosine, sine), sign * wp.where(odd, -sine, cosine)


HALF_PI = high_and_low_parts(math.pi / 2)
SPLIT = {n: high_and_low_parts(1.0 / n) for n in (6, 12, 20, 30, 42, 56)}
"""1/n as high and low parts, for series."""


@wp.func
def series_term(q: Pair, rest: Pair, high: wp.float32, low: wp.float32):
    """1 - c q `rest` in pairs, a term of sine's series."""
    return 1.0 - q * rest * pair(high, low)


@wp.func
def sine_cosine(angle: Pair):
    """sin, cos of an angle [rad] as pairs, to 5e-12, below 4e6."""
    k = wp.rint(angle.high * wp.static(float(TWO_OVER_PI)))
    r = angle - k * pair(wp.static(HALF_PI[0]), wp.static(HALF_PI[1]))
    q = r * r
    t = 1.0 - q.high * wp.static(1.0 / 110.0) * (1.0 - q.high * wp.static(1.0 / 156.0))
    s = number_of(1.0 - q.high * wp.static(1.0 / 72.0) * t)
    s = series_term(q, s, wp.static(SPLIT[42][0]), wp.static(SPLIT[42][1]))
    s = series_term(q, s, wp.static(SPLIT[20][0]), wp.static(SPLIT[20][1]))
    s = series_term(q, s, wp.static(SPLIT[6][0]), wp.static(SPLIT[6][1]))
    sine = r * s
    t = 1.0 - q.high * wp.static(1.0 / 132.0) * (1.0 - q.high * wp.static(1.0 / 182.0))
    c = number_of(1.0 - q.high * wp.static(1.0 / 90.0) * t)
    c = series_term(q, c, wp.static(SPLIT[56][0]), wp.static(SPLIT[56][1]))
    c = series_term(q, c, wp.static(SPLIT[30][0]), wp.static(SPLIT[30][1]))
    c = series_term(q, c, wp.static(SPLIT[12][0]), wp.static(SPLIT[12][1]))
    cosine = series_term(q, c, 0.5, 0.0)
    quadrant = int(k) & 3
    sign = wp.where((quadrant & 2) == 2, -1.0, 1.0)
    if (quadrant & 1) == 1:
        return sign * cosine, -sign * sine
    return sign * sine, sign * cosine


@wp.func
def sine_cosine(angle: wp.float32):
    """sin, cos of a float32 angle [rad], to round-off, below 4e6."""
    sine, cosine = sine_cosine(pair(angle, 0.0))
    return rounded_value(sine), rounded_value(cosine)


@wp.func_native(code_by_device("return __cosf(angle);", "return wp::cos(angle);"))
def quick_cosine(angle: wp.float32) -> wp.float32:
    """cos of a float32 angle [rad], below half a turn, to 5e-7."""


@wp.func
def cosine_of(angle: Pair):
    """cos of a pair's angle [rad], to 5e-7."""
    turns = wp.rint(angle.high * wp.static(0.5 / math.pi))
    return quick_cosine(rounded_value(angle - turns * pair(wp.static(4.0 * HALF_PI[0]), wp.static(4.0 * HALF_PI[1]))))


@wp.func
def cosine_of(angle: wp.float64):
    """cos of a float64 angle [rad], to 2e-16."""
    _, cosine = sine_cosine(angle)
    return cosine


LN_2 = high_and_low_parts(math.log(2.0))


@wp.func_native("union { int whole; float value; } of; of.whole = (127 + e) << 23; return of.value;")
def power_of_two(e: int) -> wp.float32:
    """2^e as float32, of ordinary size."""


@wp.func
def logarithm(r: Pair):
    """ln(r) of a pair as a pair, to 2e-9."""
    e = wp.rint(wp.log2(r.high))
    scale = power_of_two(-int(e))
    m = pair(r.high * scale, r.low * scale)
    s = (m - 1.0) / (m + 1.0)
    q = s.high * s.high
    rest = q * (wp.static(1.0 / 9.0) + q * (wp.static(1.0 / 11.0) + q * wp.static(1.0 / 13.0)))
    rest = q * (wp.static(1.0 / 3.0) + q * (wp.static(1.0 / 5.0) + q * (wp.static(1.0 / 7.0) + rest)))
    return e * pair(wp.static(LN_2[0]), wp.static(LN_2[1])) + 2.0 * (s + s.high * rest)


@wp.func
def log_of_sum(u: wp.float32):
    """ln(1 + u) of a float32 to round-off (Kahan)."""
    w = 1.0 + u
    kept = w - 1.0
    value = u
    if kept != 0.0:
        value = wp.log(w) * (u / kept)
    return value


@wp.func
def log_of_sum(u: wp.float64):
    """ln(1 + u) of a float64 to round-off."""
    value = u
    if wp.abs(u) < wp.float64(0.03):
        s = quotient(u, wp.float64(2.0) + u)
        rest = wp.float64(wp.static(1.0 / 9.0))
        for k in range(4):
            rest = rest * s * s + wp.float64(wp.static(1.0 / (7 - 2 * k)))
        value = wp.float64(2.0) * s * rest
    else:
        value = wp.log(wp.float64(1.0) + u)
    return value
