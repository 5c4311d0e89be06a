"""Couplings of one variant on a block: their bodies and states."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..physics.train import coupling_state
from ..structs import Drive
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions


@dataclass(frozen=True)
class CouplingFunctions:
    """Couplings of one variant (`physics.train`)."""

    coupling_count: wp.Function
    coupling_and_bodies: wp.Function
    coupling_state_now: wp.Function


@cache
def coupling_functions(kind: BlockKind) -> CouplingFunctions:
    """The functions of one variant's couplings."""
    kinds, chains = kind.types, chain_functions(kind)
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared

    @wp.func
    def coupling_count(drive: Drive):
        """The number of couplings of a drive, 0 as the compiler knows where no drive of the kind has any."""
        if wp.static(kind.parts.geared):
            return drive.couplings
        else:
            return int(0)

    @wp.func
    def coupling_and_bodies(ensemble: Ensemble, shared: Shared, mine: ThreadParts, c: int):
        """Coupling c of all, of the chain of the thread's body, and its bodies on the block, or the ground."""
        coupling, row, chain = ensemble.couplings[c], mine.drive_row, mine.drive_row - mine.variant
        first = chains.body_on_block(ensemble, shared, row, chain, coupling.first)
        return coupling, first, chains.body_on_block(ensemble, shared, row, chain, coupling.second)

    @wp.func
    def coupling_state_now(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, c: int, time: Any):
        """State of coupling c of all at the step's start, found by both bodies' threads before either moves."""
        coupling, one, other = coupling_and_bodies(ensemble, shared, mine, c)
        first, second = shared.poses[wp.max(one, 0)], shared.poses[other]
        return coupling_state(time, first, second, state.couplings[c], coupling, ensemble.tables)

    return CouplingFunctions(
        coupling_count=coupling_count,
        coupling_and_bodies=coupling_and_bodies,
        coupling_state_now=coupling_state_now,
    )
