"""Which partners a thread's rollers are near, as bits of a few whole numbers that the thread keeps in registers.

Partners are sprockets, then guide-bars. Of P partners the thread's roller k has P bits, from bit (k mod n) P of number
k // n on, where n rollers have room in one number.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from .kind import BlockKind
from .sync import lowest_bit

BITS = 31
"""Bits of a whole number that are used: as many as there may be partners."""


@cache
def near_mask(kind: BlockKind) -> SimpleNamespace:
    """The bits of a thread's rollers."""
    threads, rollers_per_thread, sprockets = kind.threads, kind.rollers_per_thread, kind.sprockets
    partners = sprockets + kind.guides
    slots = BITS // partners
    words = -(-rollers_per_thread // slots)
    Bits = wp.types.vector(words, wp.int32)
    TEETH = sum(((1 << sprockets) - 1) << k * partners for k in range(min(slots, rollers_per_thread)))
    BARS = sum(((1 << partners) - (1 << sprockets)) << k * partners for k in range(min(slots, rollers_per_thread)))

    @wp.func
    def with_slot(bits: Bits, k: int, near: int):
        """`bits` with those of the thread's roller k, which has none yet: the partners that it is near."""
        bits[k // wp.static(slots)] = bits[k // wp.static(slots)] | (
            near << (k % wp.static(slots) * wp.static(partners))
        )
        return bits

    @wp.func
    def differ(bits: Bits, others: Bits):
        """Whether any is not what it is in `others`."""
        found = int(0)
        for q in range(wp.static(words)):
            found = found | (bits[q] ^ others[q])
        return found != 0

    @wp.func
    def any_of(bits: Bits):
        """Whether there are any."""
        found = int(0)
        for q in range(wp.static(words)):
            found = found | bits[q]
        return found != 0

    @wp.func
    def masked(bits: Bits, mask: int):
        """Those of every number that are in `mask`."""
        for q in range(wp.static(words)):
            bits[q] = bits[q] & mask
        return bits

    @wp.func
    def of_teeth(bits: Bits):
        """Those of sprockets."""
        return masked(bits, wp.static(TEETH))

    @wp.func
    def of_bars(bits: Bits):
        """Those of guide-bars."""
        return masked(bits, wp.static(BARS))

    @wp.func
    def both(bits: Bits, others: Bits):
        """What is in one of both."""
        for q in range(wp.static(words)):
            bits[q] = bits[q] | others[q]
        return bits

    @wp.func
    def without(bits: Bits, others: Bits):
        """What is not in `others`."""
        for q in range(wp.static(words)):
            bits[q] = bits[q] & ~others[q]
        return bits

    @wp.func
    def first_number(bits: Bits):
        """The first number that has bits, where there are any."""
        q = int(wp.static(words - 1))
        for back in range(wp.static(words - 1)):
            if bits[wp.static(words - 2) - back] != 0:
                q = wp.static(words - 2) - back
        return q

    @wp.func
    def first(bits: Bits, i: int):
        """The first roller of thread i that has a bit, and the first of its partners; there are some."""
        if wp.static(rollers_per_thread == 1):
            return i, lowest_bit(bits[0])
        else:
            q = first_number(bits)
            number = int(bits[0])
            for other in range(1, wp.static(words)):
                number = wp.where(q == other, bits[other], number)
            b = lowest_bit(number)
            k = b // wp.static(partners)
            return (q * wp.static(slots) + k) * wp.static(threads) + i, b - k * wp.static(partners)

    @wp.func
    def rest(bits: Bits):
        """`bits` without the first."""
        q = first_number(bits)
        for other in range(wp.static(words)):
            if q == other:
                bits[other] = bits[other] & (bits[other] - 1)
        return bits

    return namespace(with_slot, differ, any_of, of_teeth, of_bars, both, without, first, rest, Bits=Bits)
