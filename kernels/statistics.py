"""The window's batches, the histogram of tension, and teeth that the chain jumps.

Note k (from 1) of a window of W steps from step a is taken at the first multiple of the drive's `sample_interval` that
is at least a + k W / BATCHES, before that step is added.
"""

from typing import Any

import warp as wp

from .structs import Drive, SlipSums, Strand

BATCHES = wp.constant(80)
NOTES = wp.constant(79)
"""Number of batch notes taken in a window."""


@wp.func
def batches_ended(drive: Drive, step: int):
    """Number of the window's batches with notes ended at `step`."""
    since = wp.max(step - drive.window_start, 0)
    window = wp.max(drive.window_end - drive.window_start, 1)
    batches = wp.int64(BATCHES)  # once: of two casts of a constant Warp may take one before the constant is set
    share = wp.float32(since) / wp.float32(window)  # the quotient or its neighbor: a division of int64 takes long
    ended = wp.int32(wp.min(share, wp.float32(1.0)) * wp.float32(batches))
    passed = wp.int64(wp.min(since, window)) * batches
    if wp.int64(ended) * wp.int64(window) > passed:
        ended = ended - 1
    if wp.int64(ended + 1) * wp.int64(window) <= passed:
        ended = ended + 1
    return wp.min(ended, NOTES)


@wp.func
def notes_due(drive: Drive, step: int):
    """First batch note to take at `step`, and the one after the last."""
    return batches_ended(drive, step - drive.sample_interval), batches_ended(drive, step)


BINS = wp.constant(256)
ZERO = wp.constant(96)
"""Tension histogram's bin that begins at 0 N."""
STEP = 0.04


@wp.func
def bins_per_force(scale: wp.float64):
    """Bins per force 1/s [1/N] of the tension histogram's scale [N]."""
    return wp.float32(wp.float64(1.0) / wp.max(scale, wp.float64(1.0e-9)))


@wp.func
def tension_bin(tension: Any, per_force: wp.float32):
    """Histogram bin of a tension [N], outermost where not finite."""
    ratio = wp.float32(tension) * per_force
    size = wp.abs(ratio)
    size = wp.log(size + wp.sqrt(size * size + wp.float32(1.0))) * wp.static(wp.float32(1.0 / STEP))
    place = wp.int32(wp.floor(wp.where(ratio < wp.float32(0.0), -size, size)))
    return wp.clamp(place + ZERO, 0, BINS - 1)


@wp.func
def count_tension(counts: wp.array[wp.int32], first: int, tension: Any, per_force: wp.float32):
    """Adds a tension [N] to the histogram from `first` on."""
    wp.atomic_add(counts, first + tension_bin(tension, per_force), 1)


@wp.func
def modulo(a: int, n: int):
    """Remainder of a roller's number by n, from 0 on."""
    rest = a % n
    return wp.where(rest < 0, rest + n, rest)


@wp.func
def mid_wrap_roller(before: Strand, after: Strand, n: int):
    """Number of the roller in mid-wrap, between two strands."""
    last = modulo(before.first_link + before.links, n)
    return modulo(last + modulo(after.first_link - last, n) // 2, n)


@wp.func
def follow_slip(slip: SlipSums, roller: int, seat: int, teeth: int, sign: wp.float64, n: int):
    """A sprocket's count of jumped teeth by the seat of `roller`, now in mid-wrap.

    `seat` < 0: none; `sign`: 1 counter-clockwise, else -1.
    """
    moved = int(0)
    if slip.known != 0:
        moved = modulo(roller - slip.roller + n // 2, n) - n // 2
    slip.roller = roller
    slip.place = modulo(slip.place + moved, teeth)
    if seat >= 0:
        offset = modulo(seat - wp.where(sign < wp.float64(0.0), -slip.place, slip.place), teeth)
        if slip.known == 0:
            slip.offset = offset
        elif offset != slip.offset and offset == slip.candidate:
            slip.slips = slip.slips + wp.abs(modulo(offset - slip.offset + teeth // 2, teeth) - teeth // 2)
            slip.offset = offset
        slip.candidate = offset
        slip.known = 1
    return slip
