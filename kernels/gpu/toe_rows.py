"""Rows of forces of teeth on the pins of a block's silent chains: at a pin, and by its links on those beside it."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contact_sums import contact_sum_functions
from .contacts import contact_functions
from .rollers import roller_functions
from .shared_memory import FORCE_ROWS, force_rows
from .sync import sync_functions


@dataclass(frozen=True)
class ToeRowFunctions:
    """Forces of teeth on the pins of one variant's silent chains."""

    is_silent: wp.Function
    add_pair: wp.Function
    clear_forces: wp.Function
    force_before: wp.Function
    join_forces: wp.Function


@cache
def toe_row_functions(kind: BlockKind) -> ToeRowFunctions:
    """The functions that gather forces of teeth on pins of one variant on a block."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    kinds, Now = kind.types, kind.types.Now
    State, Shared, vec2 = kinds.State, kinds.Shared, kinds.vec2
    row, slots, sprockets = force_rows(kind), kind.shape.slots, kind.parts.sprockets
    contacts = contact_functions(kind)
    contact_sums = contact_sum_functions(kind)
    chains = chain_functions(kind)
    access = row_access(Real)
    rollers = roller_functions(kind)
    sync = sync_functions(kind)

    @wp.func
    def is_silent(shared: Shared, j: int):
        """Whether roller j is a pin of a silent chain."""
        return shared.plates[chains.chain_number(shared, j)].radius > Real(0.0)

    @wp.func
    def pair_at(rows: wp.array[Real], first: int, second: int, j: int):
        """Vector whose components are values j of two rows."""
        return vec2(access.load(rows, first + j), access.load(rows, second + j))

    @wp.func
    def add_pair(rows: wp.array[Real], first: int, second: int, j: int, value: vec2):
        """Adds a vector to values j of two rows."""
        access.store(rows, first + j, access.load(rows, first + j) + value[0])
        access.store(rows, second + j, access.load(rows, second + j) + value[1])

    @wp.func
    def clear_forces(shared: Shared, mine: ThreadParts):
        """Sets the rows of forces of the thread's pins to zero; all threads together, once links have theirs."""
        for k in range(rollers_per_thread):
            for q in range(FORCE_ROWS):
                access.store(shared.rows, row.near_x + q * slots + k * threads + mine.thread, Real(0.0))
        sync.barrier()

    @wp.func
    def force_before(state: State, shared: Shared, mine: ThreadParts, j: int):
        """Force of teeth on pin j in the step before [N]."""
        at, n = chains.toe_memory(shared, mine, j)
        return vec2(access.load(state.push, at), access.load(state.push, at + n))

    @wp.func
    def nearest_wheel(shared: Shared, j: int):
        """Sprocket of pin j's chain whose teeth are nearest to it."""
        found, least = int(0), Real(1.0e30)
        position = rollers.position(shared.rows, j)
        s = int(0)
        while s < sprockets:
            from_center = position - shared.bands[s].center
            away = products(from_center[0], from_center[0], from_center[1], from_center[1]) - shared.bands[s].far_square
            if away < least and chains.partners_of_chain(shared, j, 1 << s) != 0:
                found, least = s, away
            s = s + 1
        return found

    @wp.func
    def join_forces(state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now):
        """Adds to the thread's pins what teeth exert on their two links, and keeps that; all threads together."""
        sync.barrier()
        rows, n = shared.rows, mine.rollers
        for k in range(rollers_per_thread):
            j = k * threads + mine.thread
            if j < n and is_silent(shared, j):
                total = pair_at(rows, row.near_x, row.near_y, j)
                total = total + pair_at(rows, row.next_x, row.next_y, chains.previous_roller(shared, j, n))
                total = total + pair_at(rows, row.last_x, row.last_y, chains.next_roller(shared, j, n))
                rollers.set_force(shared, j, rollers.force(shared, j) + total)
                if now.stage == 0:
                    at, count = chains.toe_memory(shared, mine, j)
                    change = total - force_before(state, shared, mine, j)
                    access.store(state.push, at, total[0])
                    access.store(state.push, at + count, total[1])
                    if wp.static(kind.measuring) and now.measures != 0:
                        if total[0] != Real(0.0) or total[1] != Real(0.0):
                            less = contacts.velocity_lag(mine) * chains.chain_at(shared, j).inverse_mass
                            less = less * products(total[0], change[0], total[1], change[1])
                            memory = chains.contact_memory(shared, mine, j, nearest_wheel(shared, j))
                            contact_sums.add_powers(tallies, now, memory, -less, Real(0.0))

    return ToeRowFunctions(
        is_silent=is_silent,
        add_pair=add_pair,
        clear_forces=clear_forces,
        force_before=force_before,
        join_forces=join_forces,
    )
