"""Contact forces of teeth on a block's rollers, and their reactions on sprockets."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..physics.contact import force_vector, memory_after_teeth, normal_force, reaction_moment
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contact_sums import contact_sum_functions
from .contacts import contact_functions
from .rollers import roller_functions
from .tooth_gaps import tooth_gap_functions
from .wrench_parts import wrench_part_functions


@dataclass(frozen=True)
class ToothFunctions:
    """Tooth contact functions of a block."""

    add_tooth_force: wp.Function
    add_straight_flank_force: wp.Function


@cache
def tooth_functions(kind: BlockKind) -> ToothFunctions:
    """Tooth contact functions of block kernels."""
    Real = kind.Real
    kinds, Now = kind.types, kind.types.Now
    State, Shared = kinds.State, kinds.Shared
    vec2 = kinds.vec2
    contacts = contact_functions(kind)
    contact_sums = contact_sum_functions(kind)
    chains = chain_functions(kind)
    tooth_gaps = tooth_gap_functions(kind)
    wrench_parts = wrench_part_functions(kind)
    access = row_access(Real)
    rollers = roller_functions(kind)

    @wp.func
    def is_moment_wanted(now: Now, s: int):
        """Whether a block wants the moment of teeth on sprocket s: always with metrics."""
        if wp.static(kind.measuring):
            return True
        else:
            return (now.wanted_moments >> s) & 1 != 0

    @wp.func
    def add_tooth_force(
        ensemble: kinds.Ensemble,
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        j: int,
        contact: contacts.Contact,
    ):
        """Adds the force of a sprocket's teeth to a block's roller j's, and its reaction to the sprocket."""
        s = contact.partner
        at = chains.contact_memory(shared, mine, j, s)
        closer, arm = tooth_gaps.contact_in_gap(ensemble, state, shared, at, j, contact)
        closed = bool(False)
        if closer.penetration > -shared.teeth[s].law.ahead:
            closer.acceleration = contacts.approach_acceleration(shared, shared.poses[s], arm, j)
            closed, force = contacts.add_normal_force(state, tallies, shared, mine, now, j, closer, shared.teeth[s].law)
            if closed:
                if is_moment_wanted(now, s):
                    wrench_parts.add_wrench(shared, mine, s, j, reaction_moment(arm, force), force, now.measures)
                wrench_parts.add_wrench_on_carrier(shared, mine, now, s, j, force)
        if not closed:
            contacts.keep_impact_speed(state, now, at, contact.impact_speed, memory_after_teeth(contact.impact_speed))

    @wp.func
    def add_straight_flank_force(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, j: int, contact: contacts.Contact
    ):
        """Adds the force of straight-flanked teeth to a block's roller j's, with few branches; 0 if it cannot.

        It can for a kept seat, a law linear and hysteretic, and a straight flank; else it has no effect.
        """
        s, before = contact.partner, contact.impact_speed
        at = chains.contact_memory(shared, mine, j, s)
        teeth = shared.teeth[s]
        closer, arm, applies = tooth_gaps.contact_in_straight_gap(shared, teeth, j, contact)
        penetration, normal, relative = closer.penetration, closer.normal, closer.relative
        speed = products(relative[0], normal[0], relative[1], normal[1])
        more = contacts.approach_acceleration(shared, shared.poses[s], arm, j)
        growth = products(more[0], normal[0], more[1], normal[1])
        law = contacts.specialized_law(shared, teeth.law, j)
        mean, elastic, size, first, damper_speed = normal_force(
            penetration, speed, growth, before, contact.damper_speed, law
        )
        pushes = force_vector(normal, size)
        force = pushes
        closed = mean > Real(0.0)
        applies = wp.where(contact.seat < 0, 0, applies)
        drag = vec2()
        if wp.static(kind.friction.contacts):
            drag, holds = contacts.friction_and_hold(now, size, normal, relative, contact, shared.friction[s])
            force = force + drag
            if applies != 0 and closed and now.stage == 0:
                access.store(state.contact_hold, at, holds)
        if applies != 0:
            wrench_parts.add_moment(
                shared,
                mine,
                s,
                j,
                wp.where(closed and is_moment_wanted(now, s), reaction_moment(arm, force), Real(0.0)),
            )
            if wp.static(kind.moving):
                if closed:
                    wrench_parts.add_reaction(shared, mine, s, j, force)
                    wrench_parts.add_wrench_on_carrier(shared, mine, now, s, j, force)
            rollers.set_force(shared, j, rollers.force(shared, j) + wp.where(closed, force, vec2()))
            contacts.keep_impact_speed(state, now, at, before, wp.where(closed, first, memory_after_teeth(before)))
            if closed:
                contacts.keep_damper_speed(state, now, at, teeth.law.answer, damper_speed)
            if wp.static(kind.measuring) and now.measures != 0:
                after = more - chains.chain_at(shared, j).inverse_mass * force
                taken, rubbed = contacts.dissipated_powers(
                    mine, contacts.dissipating_force(pushes, size - elastic, normal), drag, relative, after
                )
                if closed:
                    contact_sums.add_powers(tallies, now, at, taken, rubbed)
                    contact_sums.add_force_and_counts(tallies, now, at, before, size, True)
                    if wp.static(not kind.moving):
                        wrench_parts.add_reaction(shared, mine, s, j, force)
        return applies

    return ToothFunctions(
        add_tooth_force=add_tooth_force,
        add_straight_flank_force=add_straight_flank_force,
    )
