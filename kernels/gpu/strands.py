"""Strands that a block's links are on, stored as a few bits a link."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..structs import Strand
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .shared_memory import STRAND_WORD, strand_bits, strand_words


@dataclass(frozen=True)
class StrandFunctions:
    """Strand functions of a block."""

    find_strands: wp.Function
    stored_strand: wp.Function


@cache
def strand_functions(kind: BlockKind) -> StrandFunctions:
    """Strand functions of block kernels."""
    threads, rollers_per_thread, sprockets = kind.shape.threads, kind.shape.rollers_per_thread, kind.parts.sprockets
    kinds = kind.types
    Shared = kinds.Shared
    bits = strand_bits(kind)
    together = STRAND_WORD // bits
    used_bits = together * bits
    chains = chain_functions(kind)

    @wp.func
    def strand_of_link(shared: Shared, strands: wp.array[Strand], first: int, j: int, n: int):
        """Strand of a block's link j, `first` being strand 0; S + r for none of chain r, the largest for no link."""
        found = int(sprockets + chains.chain_number(shared, j))
        begin, count = chains.chain_span(shared, j, n)
        for s in range(sprockets):
            place = j - begin - strands[first + s].first_link
            if place < 0:
                place = place + count
            if place < strands[first + s].links:
                if chains.partners_of_chain(shared, j, 1 << s) != 0:
                    found = s
        exists = j < n
        if wp.static(kind.links == "varied"):
            exists = exists and j - begin + 1 != chains.chain_at(shared, j).absent
        return wp.where(exists, found, wp.static(sprockets + kind.parts.chains))

    @wp.func
    def find_strands(ensemble: kinds.Ensemble, state: kinds.State, shared: Shared, mine: ThreadParts):
        """Stores the strands of the thread's links."""
        first = ensemble.drives[mine.variant].first_sprocket
        k = int(0)
        for q in range(wp.static(strand_words(kind))):
            word = wp.uint32(0)
            shift = int(0)
            while shift < used_bits and k < rollers_per_thread:
                of = strand_of_link(shared, state.strands, first, k * threads + mine.thread, mine.rollers)
                word = word | (wp.uint32(of) << wp.uint32(shift))
                shift = shift + bits
                k = k + 1
            shared.strand_words[q * threads + mine.thread] = word

    @wp.func
    def stored_strand(shared: Shared, i: int, k: int):
        """Strand of thread i's link k, stored from `strand_of_link`."""
        word = shared.strand_words[k // together * threads + i]
        shift = wp.uint32(k % together * bits)
        return int((word >> shift) & wp.uint32(wp.static((1 << bits) - 1)))

    return StrandFunctions(
        find_strands=find_strands,
        stored_strand=stored_strand,
    )
