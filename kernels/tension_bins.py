"""Histograms of link tension: bins that are narrow about zero and widen with the tension's magnitude.

Bin k holds tensions T with k <= asinh(T / s) / STEP + ZERO < k + 1, where s is the drive's scale of tension: about zero
bins are STEP s wide, far from it STEP |T|. What lies beyond the ends is in the outermost bins. Counts are whole
numbers, so that the order in which threads add to them does not matter. The logarithm is float32's at every precision.
"""

from typing import Any

import warp as wp

BINS = wp.constant(256)
ZERO = wp.constant(96)
"""The bin that begins at no tension: -23 s to 301 s are told apart."""
STEP = 0.04


@wp.func
def bins_per_force(scale: wp.float64):
    """1 / s of a scale [N], as `bin_of` wants it."""
    return wp.float32(wp.float64(1.0) / wp.max(scale, wp.float64(1.0e-9)))


@wp.func
def bin_of(tension: Any, per_force: wp.float32):
    """Bin of a tension [N] for 1 / s [1/N]; an outermost one of what is not finite."""
    ratio = wp.float32(tension) * per_force
    size = wp.abs(ratio)
    size = wp.log(size + wp.sqrt(size * size + wp.float32(1.0))) * wp.static(wp.float32(1.0 / STEP))
    place = wp.int32(wp.floor(wp.where(ratio < wp.float32(0.0), -size, size)))
    return wp.clamp(place + ZERO, 0, BINS - 1)


@wp.func
def count_tension(counts: wp.array[wp.int32], first: int, tension: Any, per_force: wp.float32):
    """Adds a tension [N] to the histogram that begins at `first`; `per_force` as in `bin_of`."""
    wp.atomic_add(counts, first + bin_of(tension, per_force), 1)
