r"""Natural logarithms at float32 without float64: of a pair, and of what is near one.

    ln r = e ln 2 + ln m,    ln m = 2 artanh s = 2 s (1 + s^2/3 + s^4/5 + ...),    s = (m - 1) / (m + 1)

with m within a factor sqrt 2 of one: |s| < 0.172, and the terms from s^14 on are below 2e-12 of the first. The first
term is a pair, what comes after it float32, a hundredth of it.
"""

import math

import warp as wp

from .pairs import Pair, apart, pair, plus, rounded_sum, split, times

LN_2 = split(math.log(2.0))


@wp.func_native("union { int whole; float value; } of; of.whole = (127 + e) << 23; return of.value;")
def power_of_two(e: int) -> wp.float32:
    """2^e, of ordinary size."""
    ...


@wp.func
def logarithm(r: Pair):
    """ln(r) as a pair, r > 0, to 2e-9."""
    e = wp.rint(wp.log2(r.high))
    scale = power_of_two(-int(e))
    m = pair(r.high * scale, r.low * scale)
    over = plus(m, -1.0)
    under = plus(m, 1.0)
    first = over.high / under.high
    s = pair(first, apart(over, times(under, first)) / under.high)
    q = s.high * s.high
    rest = q * (wp.static(1.0 / 9.0) + q * (wp.static(1.0 / 11.0) + q * wp.static(1.0 / 13.0)))
    rest = q * (wp.static(1.0 / 3.0) + q * (wp.static(1.0 / 5.0) + q * (wp.static(1.0 / 7.0) + rest)))
    near_one = times(plus(s, s.high * rest), 2.0)
    return plus(times(pair(wp.static(LN_2[0]), wp.static(LN_2[1])), e), near_one)


@wp.func
def log_of_sum(u: wp.float32):
    """ln(1 + u) to round-off of itself, u > -1: what 1 + u rounds off is made good (Kahan)."""
    w = rounded_sum(1.0, u)
    kept = rounded_sum(w, -1.0)
    value = u
    if kept != 0.0:
        value = wp.log(w) * (u / kept)
    return value
