"""Goods on strands of a block's chains: forces and work of taking them on."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.strand_load import feed_rate_and_force, goods_power
from ..structs import RollerTally, Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .rollers import roller_functions
from .sync import add_to_roller_tally


@dataclass(frozen=True)
class StrandLoadFunctions:
    """Strand load functions of a block."""

    add_feed_forces: wp.Function
    add_goods_work: wp.Function


@cache
def strand_load_functions(kind: BlockKind) -> StrandLoadFunctions:
    """Strand load functions of block kernels."""
    Real, threads, kinds = kind.Real, kind.shape.threads, kind.types
    Shared, Now = kinds.Shared, kinds.Now
    chains, rollers = chain_functions(kind), roller_functions(kind)

    @wp.func
    def add_feed_forces(shared: Shared, mine: ThreadParts):
        """Adds the forces of goods that come on to those on the thread's rollers."""
        j = int(mine.thread)
        while j < mine.rollers:
            chain = shared.chains[chains.chain_number(shared, j)]
            if chain.load.relative_mass > Real(0.0):
                position, velocity = rollers.position(shared.rows, j), rollers.velocity(shared.rows, j)
                rate, force = feed_rate_and_force(position, velocity, rollers.time_step(mine), chain)
                rollers.set_force(shared, j, rollers.force(shared, j) + force)
            j = j + threads

    @wp.func
    def add_goods_work(tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now):
        """Adds the work of goods on the thread's rollers in this step to their tallies."""
        j = int(mine.thread)
        while j < mine.rollers:
            chain = shared.chains[chains.chain_number(shared, j)]
            if chain.load.relative_mass > Real(0.0):
                position, v = rollers.position(shared.rows, j), rollers.velocity(shared.rows, j)
                h = rollers.time_step(mine)
                if wp.static(not kind.has_stages):
                    v = v + Real(0.5) * h * rollers.acceleration(shared, j)
                more = RollerTally()
                more.goods_work = wp.float64(now.weight * goods_power(position, v, h, chain))
                add_to_roller_tally(tallies.roller, mine.first_roller + j, more)
            j = j + threads

    return StrandLoadFunctions(add_feed_forces=add_feed_forces, add_goods_work=add_goods_work)
