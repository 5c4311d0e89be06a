"""The parts that contacts of a block have in common: their law and friction, the v0 that they keep, their sums."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..namespace import namespace
from ..physics.contact import UNTOUCHED, dissipated, rub, rub_evenly
from ..rows import accessors
from ..structs import types
from ..sum_structs import Tallies
from .kind import BlockKind, Mine, now_struct
from .roller_rows import roller_rows
from .sync import add_to, count_at, raise_to, widened


@cache
def contact_sums(kind: BlockKind) -> SimpleNamespace:
    """The functions that contacts with teeth and with guides call."""
    Real, rk4, sliding = kind.Real, kind.rk4, kind.contact_friction
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    row, store_row = roller_rows(kind), accessors(Real).store_row
    acceleration_under = row.acceleration_under

    @wp.func
    def drag_of(size: Real, normal: vec2, relative: vec2, what: kinds.Sliding):
        """Friction on a roller [N], as `rub`."""
        if wp.static(kind.stribeck):
            return rub(size, normal, relative, what)
        else:
            return rub_evenly(size, normal, relative, what)

    @wp.func
    def as_known(law: Any):
        """A contact law with what is known of it when the kernel is made."""
        if wp.static(kind.linear_hysteretic):
            law.form = 0
            law.exponent = Real(1.0)
        return law

    @wp.func
    def lag(mine: Mine):
        """How far velocities are behind the forces [s]."""
        if wp.static(rk4):
            return Real(0.0)
        else:
            return Real(0.5) * row.step_of(mine)

    @wp.func
    def powers(shared: kinds.Shared, mine: Mine, force: vec2, damper: vec2, drag: vec2, relative: vec2):
        """Powers [W] that damper and friction take in a closed contact of a roller on which all `force` [N] acts."""
        a = acceleration_under(shared, force)
        return dissipated(damper, relative, a, lag(mine)), dissipated(drag, relative, a, lag(mine))

    @wp.func
    def in_full(value: Real):
        """A value as the sums of contacts have it."""
        if wp.static(kind.paired):
            return widened(value)
        else:
            return value

    @wp.func
    def measure_powers(tallies: Tallies, now: Now, at: int, damped: Real, rubbed: Real):
        """Adds the powers [W] of a closed contact's damping and friction to its sums."""
        add_to(tallies.dissipated, at, in_full(now.weight * damped))
        if wp.static(sliding):
            add_to(tallies.friction, at, in_full(now.weight * rubbed))

    @wp.func
    def measure_force(tallies: Tallies, now: Now, at: int, before: Real, size: Real, passing: bool):
        """Adds a closed contact's force [N] to its sums where that is watched, and counts it at its first instant.

        Rollers pass sprockets, where first touches count.
        """
        if now.watched != 0:
            add_to(tallies.impulse, at, in_full(now.watch_weight * size))
            raise_to(tallies.force_max, at, in_full(size))
        if before <= Real(0.0):
            count_at(tallies.impacts, at)
            if passing and before == Real(UNTOUCHED):
                count_at(tallies.contacts, at)

    @wp.func
    def put(state: kinds.State, now: Now, at: int, before: Real, kept: Real):
        """What a contact keeps: v0 while it is closed. At a step's start only (rk4 has three more stages)."""
        if before != kept and now.stage == 0:
            store_row(state.impact_speed, at, kept)

    return namespace(drag_of, as_known, powers, measure_powers, measure_force, put)
