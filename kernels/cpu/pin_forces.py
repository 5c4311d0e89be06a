"""Forces of contacts of a silent chain's links on its pins (`physics.toe`).

Forces on near and far pins are kept in rows of their own until the wheel is done.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.contact import reaction_moment
from ..physics.toe import LINK_ENDS, force_on_far_pin
from ..structs import types
from .link_runs import ENDS_APART, LinkRun
from .neighbor_list import GROUP, lowest_bit, without_lowest_bit
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class PinForceFunctions:
    """CPU functions of forces on pins."""

    clear_rows: wp.Function
    add_to_pins: tuple[wp.Function, wp.Function]  # of contacts of toes, and of backs
    join_forces: wp.Function
    keep_forces: wp.Function


@cache
def pin_force_functions(Real: type, capacity: int) -> PinForceFunctions:
    """CPU functions of forces on pins, for rows of `capacity` values."""
    kinds = types(Real)
    Memory, vec2 = kinds.Memory, kinds.vec2
    row = rows(capacity)
    rollers = roller_functions(Real, capacity)
    access = row_access(Real)

    @wp.func
    def force_shares(w: wp.array[Real], contacts: wp.array[Real], i: int, c: int, after: bool):
        """Forces [N] of contact `c` on pin `i` and on the far pin of its link; stores its moment on the partner."""
        at, sign = i + wp.where(after, 1, 0), wp.where(after, Real(1.0), Real(-1.0))
        u = vec2(sign * access.load(w, row.link_ux + at), sign * access.load(w, row.link_uy + at))
        force = vec2(access.load(contacts, row.force_x + c), access.load(contacts, row.force_y + c))
        z = vec2(access.load(contacts, row.place_x + c), access.load(contacts, row.place_y + c))
        arm = vec2(access.load(contacts, row.arm_x + c), access.load(contacts, row.arm_y + c))
        closed = access.load(contacts, row.penetration + c) > Real(0.0)
        far = force_on_far_pin(force, z, u, access.load(w, row.link_length + at))
        far_x, far_y = wp.where(closed, far[0], Real(0.0)), wp.where(closed, far[1], Real(0.0))
        near_x, near_y = force[0] - far_x, force[1] - far_y
        access.store(contacts, row.reaction + c, wp.where(closed, reaction_moment(arm, force), Real(0.0)))
        return wp.where(closed, near_x, Real(0.0)), wp.where(closed, near_y, Real(0.0)), far_x, far_y

    def add_function(ends: int) -> wp.Function:
        """Function that adds the forces of contacts of `ends` ends of links."""

        @wp.func(inline=True)
        def add_side_to_pins(w: wp.array[Real], run: LinkRun, after: bool, to_x: int, to_y: int):
            """Adds the forces on links after a run's pins, or before them, to rows of near and far pins."""
            contacts = access.shifted_rows(w, run.rows - run.low)
            i = run.low
            while i < run.low + run.pitch:
                for end in range(wp.static(ends)):
                    near_x, near_y, far_x, far_y = force_shares(w, contacts, i, i + end * ENDS_APART, after)
                    access.store(w, row.near_x + i, access.load(w, row.near_x + i) + near_x)
                    access.store(w, row.near_y + i, access.load(w, row.near_y + i) + near_y)
                    access.store(w, to_x + 1 + i, access.load(w, to_x + 1 + i) + far_x)
                    access.store(w, to_y + 1 + i, access.load(w, to_y + 1 + i) + far_y)
                i = i + 1

        @wp.func
        def add_to_pins(w: wp.array[Real], run: LinkRun):
            """Adds contact forces to rows of a run's pins, and stores their moments on the partner."""
            if run.end == 0:
                add_side_to_pins(w, run, True, row.next_x, row.next_y)
            else:
                add_side_to_pins(w, run, False, row.last_x, row.last_y)

        return add_to_pins

    @wp.func
    def clear_rows(w: wp.array[Real], n: int):
        """Zeroes the rows of forces of one wheel, or of guides, at `n` pins."""
        whole = access.whole_vectors(n + 1)
        rollers.clear_rows(w, row.near_x, row.near_y, whole)
        rollers.clear_rows(w, row.next_x, row.next_y, whole)
        rollers.clear_rows(w, row.last_x, row.last_y, whole)

    @wp.func
    def join_forces(w: wp.array[Real], n: int, memory: Memory):
        """Adds to each pin what a wheel's teeth exert on its two links.

        Returns the power [W] that contacts take less where pins accelerate by this, not as in the step before.
        """
        # rows of far pins' forces with one more at either end, so that the loop has no exceptions
        access.store(w, row.next_x, access.load(w, row.next_x + n))
        access.store(w, row.next_y, access.load(w, row.next_y + n))
        access.store(w, row.last_x + n + 1, access.load(w, row.last_x + 1))
        access.store(w, row.last_y + n + 1, access.load(w, row.last_y + 1))
        i = int(0)
        while i < access.whole_vectors(n):
            x = access.load(w, row.near_x + i) + access.load(w, row.next_x + i) + access.load(w, row.last_x + i + 2)
            y = access.load(w, row.near_y + i) + access.load(w, row.next_y + i) + access.load(w, row.last_y + i + 2)
            access.store(w, row.near_x + i, x)
            access.store(w, row.near_y + i, y)
            access.store(w, row.fx + i, access.load(w, row.fx + i) + x)
            access.store(w, row.fy + i, access.load(w, row.fy + i) + y)
            i = i + 1
        less = Real(0.0)
        first = wp.where(memory.wanted.measures != 0, 0, n)
        while first < n:
            count = wp.min(n - first, GROUP)
            bits = access.find_unlike(w, row.near_x + first, count, Real(0.0))
            bits = bits | access.find_unlike(w, row.near_y + first, count, Real(0.0))
            while bits != wp.uint64(0):
                i = first + lowest_bit(bits)
                x, y = access.load(w, row.near_x + i), access.load(w, row.near_y + i)
                # with those joined before, so that all together take what they do in their sum
                change_x = Real(2.0) * access.load(w, row.fx + i) - x - access.load(w, row.toe_x + i)
                change_y = Real(2.0) * access.load(w, row.fy + i) - y - access.load(w, row.toe_y + i)
                less += access.load(w, row.mobility + i) * (x * change_x + y * change_y)
                bits = without_lowest_bit(bits)
            first = first + GROUP
        return wp.float64(memory.lag * memory.inverse_mass * less)

    @wp.func
    def keep_forces(w: wp.array[Real], n: int):
        """Keeps the force of all contacts on each pin for the next step."""
        i = int(0)
        while i < access.whole_vectors(n):
            access.store(w, row.toe_x + i, access.load(w, row.fx + i))
            access.store(w, row.toe_y + i, access.load(w, row.fy + i))
            i = i + 1

    return PinForceFunctions(
        clear_rows=clear_rows,
        add_to_pins=(add_function(int(LINK_ENDS)), add_function(1)),
        join_forces=join_forces,
        keep_forces=keep_forces,
    )
