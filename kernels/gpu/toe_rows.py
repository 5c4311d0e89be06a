"""Rows of forces of teeth and guides on a block's silent chains: at a pin, and by its links on those beside it."""

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
from .shared_memory import force_row_count, force_rows
from .sync import sync_functions


@dataclass(frozen=True)
class ToeRowFunctions:
    """Forces of teeth on the pins of one variant's silent chains."""

    is_silent: wp.Function
    add_pair: wp.Function
    clear_forces: wp.Function
    force_before: wp.Function
    join_forces: wp.Function
    add_late_force: wp.Function


@cache
def toe_row_functions(kind: BlockKind) -> ToeRowFunctions:
    """Toe row functions of block kernels."""
    Real, threads, rollers_per_thread = kind.Real, kind.shape.threads, kind.shape.rollers_per_thread
    kinds, Now = kind.types, kind.types.Now
    State, Shared, vec2 = kinds.State, kinds.Shared, kinds.vec2
    row, slots, sprockets = force_rows(kind), kind.shape.slots, kind.parts.sprockets
    several = kind.parts.chains > 1
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
            for q in range(wp.static(force_row_count(kind) - 1)):
                access.store(shared.rows, row.near_x + q * slots + k * threads + mine.thread, Real(0.0))
        sync.barrier()

    @wp.func
    def force_before(state: State, shared: Shared, mine: ThreadParts, j: int):
        """Force of contacts on pin j in the step before [N]."""
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
    def first_guide(shared: Shared, j: int):
        """Number of the first guide of the chain of a block's roller j."""
        if wp.static(several):
            return shared.chain_places[chains.chain_number(shared, j)].first_guide
        else:
            return int(0)

    @wp.func
    def add_power_taken_less(
        tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, j: int, p: int, force: vec2, change: vec2
    ):
        """Takes what `force` on pin j does less by the acceleration of another, `change`, from partner p's sums."""
        if wp.static(kind.measuring) and now.measures != 0:
            if force[0] != Real(0.0) or force[1] != Real(0.0):
                less = contacts.velocity_lag(mine) * chains.chain_at(shared, j).inverse_mass
                less = less * products(force[0], change[0], force[1], change[1])
                contact_sums.add_powers(tallies, now, chains.contact_memory(shared, mine, j, p), -less, Real(0.0))

    @wp.func
    def back_force(shared: Shared, mine: ThreadParts, j: int):
        """Force of guides on pin j by the backs of its two links [N]."""
        if wp.static(kind.parts.guides):
            before = chains.previous_roller(shared, j, mine.rollers)
            rows = shared.rows
            return pair_at(rows, row.back_x, row.back_y, j) + pair_at(rows, row.ahead_x, row.ahead_y, before)
        else:
            return vec2()

    @wp.func
    def join_forces(state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now):
        """Adds to the thread's pins what acts on their two links, and keeps that; all threads together."""
        sync.barrier()
        rows, n = shared.rows, mine.rollers
        for k in range(rollers_per_thread):
            j = k * threads + mine.thread
            if j < n and is_silent(shared, j):
                total = pair_at(rows, row.near_x, row.near_y, j)
                total = total + pair_at(rows, row.next_x, row.next_y, chains.previous_roller(shared, j, n))
                total = total + pair_at(rows, row.last_x, row.last_y, chains.next_roller(shared, j, n))
                backs = back_force(shared, mine, j)
                rollers.set_force(shared, j, rollers.force(shared, j) + (total + backs))
                if now.stage == 0:
                    at, count = chains.toe_memory(shared, mine, j)
                    before = force_before(state, shared, mine, j)
                    access.store(state.push, at, total[0] + backs[0])
                    access.store(state.push, at + count, total[1] + backs[1])
                    wheel = nearest_wheel(shared, j)
                    add_power_taken_less(tallies, shared, mine, now, j, wheel, total, total - before)
                    if wp.static(kind.parts.guides):
                        # with teeth's, so that all together take what they do in their sum
                        guide = sprockets + first_guide(shared, j)
                        change = backs + Real(2.0) * total - before
                        add_power_taken_less(tallies, shared, mine, now, j, guide, backs, change)

    @wp.func
    def add_late_force(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, j: int, p: int, force: vec2
    ):
        """Keeps the force of guide p on pin j itself [N], too, and takes from sums what others do less by it."""
        if now.stage == 0:
            at, count = chains.toe_memory(shared, mine, j)
            so_far = force_before(state, shared, mine, j)
            add_power_taken_less(tallies, shared, mine, now, j, p, force, so_far)
            access.store(state.push, at, so_far[0] + force[0])
            access.store(state.push, at + count, so_far[1] + force[1])

    return ToeRowFunctions(
        is_silent=is_silent,
        add_pair=add_pair,
        clear_forces=clear_forces,
        force_before=force_before,
        join_forces=join_forces,
        add_late_force=add_late_force,
    )
