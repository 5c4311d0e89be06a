"""On which strand each link of a block's threads is: a few bits a link, several links in one shared number.

So a thread learns with one access where all its links are. It reads and writes its own numbers only, so that with a
roller a thread there is a number a link.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..structs import Strand, types
from .kind import BlockKind, Mine
from .shared_memory import STRAND_WORD, strand_bits, strand_words


@dataclass(frozen=True)
class StrandFunctions:
    """Strands of links, as functions of kernels."""

    find_strands: wp.Function
    strand_at: wp.Function


@cache
def block_strands(kind: BlockKind) -> StrandFunctions:
    """The functions that tell on which strand each link of one variant on a block is."""
    threads, rollers_per_thread, sprockets = kind.threads, kind.rollers_per_thread, kind.sprockets
    kinds = types(kind.Real)
    bits = strand_bits(kind)
    together = STRAND_WORD // bits

    @wp.func
    def strand_under(strands: wp.array[Strand], first: int, j: int, n: int):
        """Strand that link j is on, S where it is on none, S + 1 where there is no such link; `first` is strand 0."""
        found = int(wp.static(sprockets))
        for s in range(wp.static(sprockets)):
            place = j - strands[first + s].first_link
            if place < 0:
                place = place + n
            if place < strands[first + s].links:
                found = s
        return wp.where(j < n, found, wp.static(sprockets + 1))

    @wp.func
    def find_strands(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine):
        """Brings up to date which strands the thread's links are on."""
        first = ensemble.drives[mine.variant].first_sprocket
        k = int(0)
        for q in range(wp.static(strand_words(kind))):
            word = wp.uint32(0)
            shift = int(0)
            while shift < wp.static(together * bits) and k < wp.static(rollers_per_thread):
                of = strand_under(state.strands, first, k * wp.static(threads) + mine.thread, mine.rollers)
                word = word | (wp.uint32(of) << wp.uint32(shift))
                shift = shift + wp.static(bits)
                k = k + 1
            shared.strand_of[q * wp.static(threads) + mine.thread] = word

    @wp.func
    def strand_at(shared: kinds.Shared, i: int, k: int):
        """The strand that thread i's link k is on, as `strand_under`."""
        word = shared.strand_of[k // wp.static(together) * wp.static(threads) + i]
        shift = wp.uint32(k % wp.static(together) * wp.static(bits))
        return int((word >> shift) & wp.uint32(wp.static((1 << bits) - 1)))

    return StrandFunctions(find_strands=find_strands, strand_at=strand_at)
