"""Links of a silent chain that may touch one partner, and what their contacts keep for the next step.

Contact j + k `ENDS_APART` of a run's rows of contacts is that of end `end` + k of the link at pin `low` + j. These rows
are apart from rows of pins, as compilers check at run time.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..structs import Drive, types
from .contact_rows import contact_row_functions
from .neighbor_list import GROUP, highest_bit, lowest_bit
from .rollers import rows

ENDS_APART = wp.constant(2 * int(GROUP))
"""Places from a contact's to that of the next end of the same link."""


@wp.struct
class LinkRun:
    """Pins in a row whose links may touch a partner."""

    low: wp.int32  # the first
    count: wp.int32
    pitch: wp.int32  # the count in whole vectors, which are worked out
    rows: wp.int32  # where rows of contacts begin
    end: wp.int32  # of a link, to which the first contacts belong
    pins: wp.int32  # of the chain


@dataclass(frozen=True)
class LinkRunFunctions:
    """CPU functions of what contacts of links keep."""

    fetch_pushes: wp.Function
    put_back_pushes: wp.Function
    link_run: wp.Function
    recall_contacts: wp.Function
    keep_contacts: wp.Function


@cache
def link_run_functions(Real: type, capacity: int) -> LinkRunFunctions:
    """CPU functions of what contacts of links keep, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Memory, State = kinds.Memory, kinds.State
    row = rows(capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    def push_function(fetches: bool) -> wp.Function:
        """Function that copies v0 and forces of the step before from the state to their rows, or back."""

        @wp.func
        def copy_value(w: wp.array[Real], i: int, kept: wp.array[Real], at: int):
            """Copies one value."""
            if wp.static(fetches):
                access.store(w, i, access.load(kept, at))
            else:
                access.store(kept, at, access.load(w, i))

        @wp.func
        def copy_pushes(state: State, drive: Drive, w: wp.array[Real]):
            """Copies v0 and forces of the step before, at a launch's begin or end."""
            n, contacts = drive.rollers, contact_rows.link_contacts(drive)
            for p in range(contacts):
                push, speed = contact_rows.push_row(drive, p), contact_rows.speed_row(drive, p)
                for i in range(n):
                    copy_value(w, push + i, state.push, drive.first_push + p * n + i)
                    copy_value(w, speed + i, state.impact_speed, drive.first_contact + p * n + i)
            at = drive.first_push + contacts * n
            for i in range(n):
                copy_value(w, row.toe_x + i, state.push, at + i)
                copy_value(w, row.toe_y + i, state.push, at + n + i)

        return copy_pushes

    @wp.func
    def link_run(drive: Drive, first: int, bits: wp.uint64, end: int, at: int):
        """Pins from the lowest to the highest of `bits`, from `first` on; none of 0. Contacts are from `at` on."""
        run = LinkRun()
        run.rows = contact_rows.push_row(drive, contact_rows.link_contacts(drive)) + at
        run.end = end
        run.pins = drive.rollers
        if bits != wp.uint64(0):
            low, high = lowest_bit(bits), highest_bit(bits) + 1
            low = wp.min(low, GROUP - access.round_up(high - low))  # whole vectors without the next run's pins
            run.low = first + low
            run.count = high - low
            run.pitch = access.round_up(run.count)
        return run

    @wp.func
    def recall_contacts(w: wp.array[Real], run: LinkRun, ends: int, memory: Memory):
        """Copies what a run's contacts have kept to their rows."""
        pitch, to, count = wp.static(capacity), ENDS_APART, run.pitch
        first = run.end * pitch + run.low
        access.copy_rows(w, memory.speed_row + first, pitch, run.rows + row.v0_before, to, ends, count)
        access.copy_rows(w, memory.push_row + first, pitch, run.rows + row.pushed, to, ends, count)
        access.copy_rows(w, memory.damper_row + first, pitch, run.rows + row.held, to, ends, count)

    @wp.func
    def keep_contacts(w: wp.array[Real], run: LinkRun, ends: int, memory: Memory):
        """Copies what a run's contacts keep from their rows."""
        pitch, of, count = wp.static(capacity), ENDS_APART, run.pitch
        first = run.end * pitch + run.low
        access.copy_rows(w, run.rows + row.v0_kept, of, memory.speed_row + first, pitch, ends, count)
        access.copy_rows(w, run.rows + row.force_size, of, memory.push_row + first, pitch, ends, count)
        access.copy_rows(w, run.rows + row.damper_speed, of, memory.damper_row + first, pitch, ends, count)

    return LinkRunFunctions(
        fetch_pushes=push_function(True),
        put_back_pushes=push_function(False),
        link_run=link_run,
        recall_contacts=recall_contacts,
        keep_contacts=keep_contacts,
    )
