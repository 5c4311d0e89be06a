"""Partners of a thread's rollers, sprockets and guides, as bits of a few whole numbers."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from .block_kinds import BlockKind
from .block_structs import BITS
from .sync import lowest_bit


@dataclass(frozen=True)
class PartnerBitFunctions:
    """Partner bit functions of a block."""

    Bits: Any
    with_roller: wp.Function
    has_any: wp.Function
    of_sprockets: wp.Function
    of_guides: wp.Function
    first_pair: wp.Function
    without_first_pair: wp.Function


@cache
def partner_bit_functions(kind: BlockKind) -> PartnerBitFunctions:
    """Partner bit functions of block kernels."""
    threads, rollers_per_thread, sprockets = kind.shape.threads, kind.shape.rollers_per_thread, kind.parts.sprockets
    partners = sprockets + kind.parts.guides
    slots = BITS // partners
    word_count = -(-rollers_per_thread // slots)
    last_word = word_count - 1
    Bits = wp.types.vector(word_count, wp.int32)
    OF_SPROCKETS = sum(((1 << sprockets) - 1) << k * partners for k in range(min(slots, rollers_per_thread)))
    OF_GUIDES = sum(((1 << partners) - (1 << sprockets)) << k * partners for k in range(min(slots, rollers_per_thread)))

    @wp.func
    def with_roller(bits: Bits, k: int, near: int):
        """Partner bits with those, `near`, of the thread's roller k, which has none yet."""
        bits[k // slots] = bits[k // slots] | (near << (k % slots * partners))
        return bits

    @wp.func
    def has_any(bits: Bits):
        """Whether any partner bit of a thread is set."""
        found = int(0)
        for q in range(word_count):
            found = found | bits[q]
        return found != 0

    @wp.func
    def of_sprockets(bits: Bits):
        """A thread's partner bits of sprockets alone."""
        return bits & Bits(OF_SPROCKETS)

    @wp.func
    def of_guides(bits: Bits):
        """A thread's partner bits of guides alone."""
        return bits & Bits(OF_GUIDES)

    @wp.func
    def first_word(bits: Bits):
        """Index of a thread's first number with partner bits set; some is set."""
        q = int(last_word)
        for back in range(1, word_count):
            if bits[last_word - back] != 0:
                q = last_word - back
        return q

    @wp.func
    def first_pair(bits: Bits, i: int):
        """First roller of thread i with a partner bit set, and its first partner; some bit is set."""
        if wp.static(rollers_per_thread == 1):
            return i, lowest_bit(bits[0])
        else:
            q = first_word(bits)
            number = int(bits[0])
            for other in range(1, word_count):
                number = wp.where(q == other, bits[other], number)
            b = lowest_bit(number)
            k = b // partners
            return (q * slots + k) * threads + i, b - k * partners

    @wp.func
    def without_first_pair(bits: Bits):
        """A thread's partner bits without that of `first_pair`."""
        q = first_word(bits)
        for other in range(word_count):
            if q == other:
                bits[other] = bits[other] & (bits[other] - 1)
        return bits

    return PartnerBitFunctions(
        Bits=Bits,
        with_roller=with_roller,
        has_any=has_any,
        of_sprockets=of_sprockets,
        of_guides=of_guides,
        first_pair=first_pair,
        without_first_pair=without_first_pair,
    )
