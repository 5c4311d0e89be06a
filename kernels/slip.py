"""Teeth that the chain jumps over a sprocket: the seat of the roller in mid-wrap, less its place along the chain.

While no tooth is jumped, seat and place count on together (modulo the number of teeth; against each other on a sprocket
that turns clockwise), whichever roller is in mid-wrap and however far chain and sprocket have gone. A difference that
two looks in a row agree on counts; a roller that rides on a tip and falls back does not.
"""

import warp as wp

from .structs import Strand
from .sum_structs import SlipSums


@wp.func
def modulo(a: int, n: int):
    """Remainder from 0 to n - 1."""
    rest = a % n
    return wp.where(rest < 0, rest + n, rest)


@wp.func
def brought(a: int, n: int):
    """The same of a number from -n to 2 n - 1, without a division."""
    return wp.where(a < 0, a + n, wp.where(a < n, a, a - n))


@wp.func
def mid_wrap(before: Strand, after: Strand, n: int):
    """The roller in the middle of those between two strands."""
    last = brought(before.first_link + before.links, n)
    return brought(last + brought(after.first_link - last, n) // 2, n)


@wp.func
def follow_slip(slip: SlipSums, roller: int, seat: int, teeth: int, sign: wp.float64, n: int):
    """A sprocket's slip after a look at `roller`, now in mid-wrap, whose seat is `seat`, negative for none.

    `sign` is 1 on a sprocket that turns counter-clockwise, else -1.
    """
    moved = int(0)
    if slip.known != 0:
        moved = brought(roller - slip.roller + n // 2, n) - n // 2
    slip.roller = roller
    slip.place = modulo(slip.place + moved, teeth)
    if seat >= 0:
        offset = brought(seat - wp.where(sign < wp.float64(0.0), -slip.place, slip.place), teeth)
        if slip.known == 0:
            slip.offset = offset
        elif offset != slip.offset and offset == slip.candidate:
            slip.slips = slip.slips + wp.abs(modulo(offset - slip.offset + teeth // 2, teeth) - teeth // 2)
            slip.offset = offset
        slip.candidate = offset
        slip.known = 1
    return slip
