"""Sums over the window of a block's contacts, in float64 in global memory."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import (
    UNTOUCHED,
)
from ..structs import Tallies
from .block_kinds import BlockKind
from .events import ENDS, START
from .sync import add_to_element, float64_from_float32, raise_element


@dataclass(frozen=True)
class ContactSumFunctions:
    """Contact sum functions of a block."""

    add_powers: wp.Function
    add_force_and_counts: wp.Function
    add_stored_energy: wp.Function


@cache
def contact_sum_functions(kind: BlockKind) -> ContactSumFunctions:
    """Contact sum functions of block kernels."""
    Real = kind.Real
    Now = kind.types.Now

    @wp.func
    def as_float64(value: Real):
        """Value of a block's contact in float64, for its sums."""
        if wp.static(kind.is_paired):
            return float64_from_float32(value)
        else:
            return value

    @wp.func
    def add_powers(tallies: Tallies, now: Now, at: int, damped: Real, rubbed: Real):
        """Adds the powers [W] of a block's closed contact's damper and friction to its sums."""
        add_to_element(tallies.dissipated, at, as_float64(now.weight * damped))
        if wp.static(kind.friction.contacts):
            add_to_element(tallies.friction, at, as_float64(now.weight * rubbed))

    @wp.func
    def add_force_and_counts(tallies: Tallies, now: Now, at: int, before: Real, size: Real, passing: bool):
        """Adds a block's closed contact's force [N] to its sums, and counts its first instant where `passing`."""
        add_to_element(tallies.impulse, at, as_float64(now.weight * size))
        raise_element(tallies.force_max, at, as_float64(size))
        if before <= Real(0.0):
            add_to_element(tallies.impacts, at, 1)
            if passing and before == Real(UNTOUCHED):
                add_to_element(tallies.contacts, at, 1)

    @wp.func
    def add_stored_energy(tallies: Tallies, now: Now, at: int, energy: Real):
        """Subtracts a block's contact's energy at the window's end from its dissipation, and adds that at the start."""
        if wp.static(not kind.has_stages):
            if now.flags & ENDS != 0:
                add_to_element(tallies.dissipated, at, as_float64(wp.where(now.flags & START != 0, energy, -energy)))

    return ContactSumFunctions(
        add_powers=add_powers,
        add_force_and_counts=add_force_and_counts,
        add_stored_energy=add_stored_energy,
    )
