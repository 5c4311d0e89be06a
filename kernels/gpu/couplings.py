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
    """Coupling functions of a block (`physics.train`)."""

    coupling_count: wp.Function
    coupling_and_bodies: wp.Function
    coupling_state_now: wp.Function


@cache
def coupling_functions(kind: BlockKind) -> CouplingFunctions:
    """Coupling functions of block kernels."""
    kinds, chains = kind.types, chain_functions(kind)
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared

    @wp.func
    def coupling_count(drive: Drive):
        """Number of couplings of a drive on a block; a constant 0 in kinds without any."""
        if wp.static(kind.parts.geared):
            return drive.couplings
        else:
            return int(0)

    @wp.func
    def coupling_and_bodies(ensemble: Ensemble, shared: Shared, mine: ThreadParts, c: int):
        """Coupling c of all, of the thread's chain, and its two bodies on the block."""
        coupling, row, chain = ensemble.couplings[c], mine.drive_row, mine.drive_row - mine.variant
        first = chains.body_on_block(ensemble, shared, row, chain, coupling.first)
        return coupling, first, chains.body_on_block(ensemble, shared, row, chain, coupling.second)

    @wp.func
    def coupling_state_now(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, c: int, time: Any):
        """State of a block's coupling c of all at the step's start."""
        coupling, one, other = coupling_and_bodies(ensemble, shared, mine, c)
        first, second = shared.poses[wp.max(one, 0)], shared.poses[other]
        return coupling_state(time, first, second, state.couplings[c], coupling, ensemble.tables)

    return CouplingFunctions(
        coupling_count=coupling_count,
        coupling_and_bodies=coupling_and_bodies,
        coupling_state_now=coupling_state_now,
    )
