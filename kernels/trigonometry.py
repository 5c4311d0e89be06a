r"""Sine and cosine together, in float64 and in pairs of float32: the same on every device, without the subroutine for
huge angles.

angle = k pi/2 + r, |r| <= pi/4, pi/2 in three parts so that k times the first two is exact up to k = 2^20; then the
series of sin r and cos r to r^17 and r^16, whose next terms are below 1e-19; then the quadrant k mod 4.

Quotients of literals are `wp.static`: within a kernel Warp divides them in float32.
"""

import math

import warp as wp

from .pairs import Pair, minus, pair, pair_of, plus, split, times

TWO_OVER_PI = wp.constant(wp.float64(0.6366197723675814))
HALF_PI_1 = wp.constant(wp.float64(1.5707963267341256))
HALF_PI_2 = wp.constant(wp.float64(6.077100506303966e-11))
HALF_PI_3 = wp.constant(wp.float64(2.0222662487959506e-21))


@wp.func
def sine_cosine(angle: wp.float64):
    """sin(angle), cos(angle), to 2e-16; angle in radians, up to 1.6e6 in size."""
    one = wp.float64(1.0)
    k = wp.rint(angle * TWO_OVER_PI)
    r = ((angle - k * HALF_PI_1) - k * HALF_PI_2) - k * HALF_PI_3
    q = r * r
    s = one - q * wp.static(wp.float64(1.0 / 272.0))
    s = one - q * s * wp.static(wp.float64(1.0 / 210.0))
    s = one - q * s * wp.static(wp.float64(1.0 / 156.0))
    s = one - q * s * wp.static(wp.float64(1.0 / 110.0))
    s = one - q * s * wp.static(wp.float64(1.0 / 72.0))
    s = one - q * s * wp.static(wp.float64(1.0 / 42.0))
    s = one - q * s * wp.static(wp.float64(1.0 / 20.0))
    sine = r - r * q * s * wp.static(wp.float64(1.0 / 6.0))
    c = one - q * wp.static(wp.float64(1.0 / 240.0))
    c = one - q * c * wp.static(wp.float64(1.0 / 182.0))
    c = one - q * c * wp.static(wp.float64(1.0 / 132.0))
    c = one - q * c * wp.static(wp.float64(1.0 / 90.0))
    c = one - q * c * wp.static(wp.float64(1.0 / 56.0))
    c = one - q * c * wp.static(wp.float64(1.0 / 30.0))
    c = one - q * c * wp.static(wp.float64(1.0 / 12.0))
    cosine = one - wp.float64(0.5) * q * c
    quadrant = int(k) & 3
    odd = (quadrant & 1) == 1
    sign = wp.where((quadrant & 2) == 2, -one, one)
    return sign * wp.where(odd, cosine, sine), sign * wp.where(odd, -sine, cosine)


HALF_PI = split(math.pi / 2)
SPLIT = {n: split(1.0 / n) for n in (6, 12, 20, 30, 42, 56)}
"""pi/2 and some reciprocals as high and low parts of pairs."""


@wp.func
def series_term(q: Pair, rest: Pair, high: wp.float32, low: wp.float32):
    """1 - c q `rest`, c given as high and low part."""
    return plus(minus(times(times(q, rest), pair(high, low))), 1.0)


@wp.func
def sine_cosine(angle: Pair):
    """sin(angle), cos(angle) as pairs, to 5e-12 and what the angle itself rounds off; up to 4e6 in size.

    The same series as in float64; of its terms, what is below 1e-3 of the result needs no low part.
    """
    k = wp.rint(angle.high * wp.static(float(TWO_OVER_PI)))
    quarter = pair(wp.static(HALF_PI[0]), wp.static(HALF_PI[1]))
    r = plus(angle, minus(times(quarter, k)))
    q = times(r, r)
    t = 1.0 - q.high * wp.static(1.0 / 110.0) * (1.0 - q.high * wp.static(1.0 / 156.0))
    s = pair_of(1.0 - q.high * wp.static(1.0 / 72.0) * t)
    s = series_term(q, s, wp.static(SPLIT[42][0]), wp.static(SPLIT[42][1]))
    s = series_term(q, s, wp.static(SPLIT[20][0]), wp.static(SPLIT[20][1]))
    s = series_term(q, s, wp.static(SPLIT[6][0]), wp.static(SPLIT[6][1]))
    sine = times(r, s)
    t = 1.0 - q.high * wp.static(1.0 / 132.0) * (1.0 - q.high * wp.static(1.0 / 182.0))
    c = pair_of(1.0 - q.high * wp.static(1.0 / 90.0) * t)
    c = series_term(q, c, wp.static(SPLIT[56][0]), wp.static(SPLIT[56][1]))
    c = series_term(q, c, wp.static(SPLIT[30][0]), wp.static(SPLIT[30][1]))
    c = series_term(q, c, wp.static(SPLIT[12][0]), wp.static(SPLIT[12][1]))
    cosine = series_term(q, c, 0.5, 0.0)
    quadrant = int(k) & 3
    if (quadrant & 1) == 1:
        kept = sine
        sine = cosine
        cosine = minus(kept)
    if (quadrant & 2) == 2:
        sine = minus(sine)
        cosine = minus(cosine)
    return sine, cosine
