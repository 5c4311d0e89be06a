"""One contact of a block's roller with a tooth or a guide: law, friction, the v0 that it keeps, sums."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import row_access
from ..physics.contact import (
    contact_energy,
    dissipated_power,
    even_friction_force,
    friction_force,
    normal_force_vector,
    relative_acceleration,
)
from ..physics.impact import law_at_roller
from ..structs import Tallies
from .block_kinds import BY_SPEED, BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contact_sums import contact_sum_functions
from .events import EXTRA
from .partner_bits import partner_bit_functions
from .rollers import roller_functions


@dataclass(frozen=True)
class ContactFunctions:
    """Contact functions of a block: force, memory, sums."""

    Contact: Any
    with_kinematics: wp.Function
    acceleration_past: wp.Function
    approach_acceleration: wp.Function
    with_memory: wp.Function
    friction_and_hold: wp.Function
    specialized_law: wp.Function
    velocity_lag: wp.Function
    dissipating_force: wp.Function
    dissipated_powers: wp.Function
    keep_impact_speed: wp.Function
    keep_damper_speed: wp.Function
    add_normal_force: wp.Function


@cache
def contact_functions(kind: BlockKind) -> ContactFunctions:
    """Contact functions of block kernels."""
    Real, sprockets = kind.Real, kind.parts.sprockets
    kinds, Now = kind.types, kind.types.Now
    State, Shared, Friction = kinds.State, kinds.Shared, kinds.Friction
    partner_bits = partner_bit_functions(kind)
    rollers = roller_functions(kind)
    access = row_access(Real)
    chains = chain_functions(kind)
    vec2, Direction = kinds.vec2, kinds.Ensemble.vars["seats"].type.dtype
    Pose = kinds.Pose
    contact_sums = contact_sum_functions(kind)

    @wp.struct
    class Contact:
        """A roller's contact with the partner at hand."""

        partner: wp.int32  # sprockets first, then guides
        seat: wp.int32  # in a sprocket, negative where it has none yet
        direction: Direction  # of the seat at angle zero
        impact_speed: Real  # v0 [m/s], or whether it touched
        held_friction: Real  # friction that the contact has held until now, of kernels with friction [N]
        damper_speed: Real  # speed at which its damper acted in the step before [m/s]
        penetration: Real  # [m], negative where they do not touch yet
        normal: vec2
        relative: vec2  # velocity [m/s]
        acceleration: vec2  # acceleration of that velocity without this contact [m/s^2]

    @wp.func
    def with_kinematics(contact: Contact, penetration: Real, normal: vec2, relative: vec2):
        """Block's contact with its penetration [m], normal and relative velocity [m/s] set."""
        contact.penetration = penetration
        contact.normal = normal
        contact.relative = relative
        return contact

    @wp.func
    def acceleration_past(body: Pose, arm: vec2, acceleration: vec2):
        """Acceleration [m/s^2] of a block's body's point, `arm` from its center, less another."""
        straight = vec2()
        if wp.static(kind.moving):
            straight = body.straight
        return relative_acceleration(straight, body.angular, arm, acceleration)

    @wp.func
    def approach_acceleration(shared: Shared, body: Pose, arm: vec2, j: int):
        """Acceleration [m/s^2] of a block's body's point, `arm` from its center, less roller j's by forces so far."""
        return acceleration_past(body, arm, rollers.acceleration(shared, j))

    @wp.func
    def with_memory(state: State, contact: Contact, at: int):
        """Block's contact with the values that the state keeps at `at`."""
        contact.impact_speed = access.load(state.impact_speed, at)
        contact.damper_speed = access.load(state.damper_speed, at)
        if wp.static(kind.friction.contacts):
            contact.held_friction = access.load(state.contact_hold, at)
        return contact

    @wp.func
    def friction_and_hold(now: Now, size: Real, normal: vec2, relative: vec2, contact: Contact, what: Friction):
        """Friction of a block's contact on a roller [N], and its bristle's force [N]."""
        held = wp.where(contact.impact_speed > Real(0.0), contact.held_friction, Real(0.0))
        stretched = rollers.stretch_part(now)
        if wp.static(kind.friction.contacts == BY_SPEED):
            return friction_force(size, normal, relative, held, what, stretched)
        else:
            return even_friction_force(size, normal, relative, held, what, stretched)

    @wp.func
    def specialized_law(shared: Shared, law: Any, j: int):
        """Contact law for roller j, with constants of the block kernel's kind."""
        if wp.static(not kind.has_stages):
            law.most_damping = Real(0.0)
        if wp.static(kind.linear_hysteretic):
            law.form = 0
            law.exponent = Real(1.0)
        if wp.static(kind.links == "varied"):
            relative = chains.relative_mass(shared, j)
            law = law_at_roller(law, relative, Real(1.0) / relative)
        return law

    @wp.func
    def velocity_lag(mine: ThreadParts):
        """Time [s] from velocities to contact forces on a block."""
        if wp.static(kind.has_stages):
            return Real(0.0)
        else:
            return Real(0.5) * rollers.time_step(mine)

    @wp.func
    def dissipating_force(force: vec2, damper: Real, normal: vec2):
        """Part of a block's contact force [N] that takes power: all of it, or with stages that of the damper."""
        if wp.static(kind.has_stages):
            return damper * normal
        else:
            return force

    @wp.func
    def dissipated_powers(mine: ThreadParts, force: vec2, drag: vec2, relative: vec2, more: vec2):
        """Powers [W] of a block's closed contact's force and friction; `more` is the acceleration by all [m/s^2]."""
        return dissipated_power(force, relative, more, velocity_lag(mine)), dissipated_power(
            drag, relative, more, velocity_lag(mine)
        )

    @wp.func
    def keep_impact_speed(state: State, now: Now, at: int, before: Real, kept: Real):
        """Stores v0 of a block's contact while it is closed, at a step's first stage only."""
        if before != kept and now.stage == 0:
            access.store(state.impact_speed, at, kept)

    @wp.func
    def keep_damper_speed(state: State, now: Now, at: int, answer: Real, damper_speed: Real):
        """Stores the damper speed [m/s] of a block's closed contact whose law has an `answer`."""
        if answer > Real(0.0) and now.stage == 0:
            access.store(state.damper_speed, at, damper_speed)

    @wp.func
    def add_normal_force(
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: ThreadParts,
        now: Now,
        j: int,
        contact: Contact,
        law: kinds.ContactLaw,
    ):
        """Adds the block's current contact force to roller j's; returns whether it is closed, and the force [N]."""
        p, before, normal, relative, more = (
            contact.partner,
            contact.impact_speed,
            contact.normal,
            contact.relative,
            contact.acceleration,
        )
        at = chains.contact_memory(shared, mine, j, p)
        known = specialized_law(shared, law, j)
        pushes, mean, elastic, size, first, damper_speed = normal_force_vector(
            contact.penetration, normal, relative, more, before, contact.damper_speed, known
        )
        force = pushes
        closed = mean > Real(0.0)
        if closed:
            if now.flags & EXTRA != 0:  # at once, so that the energy is worked out only here
                extra = mine.first_roller + j
                state.extra[extra].energy = state.extra[extra].energy + contact_energy(mean, elastic, known)
                if p < sprockets:
                    state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + size
                else:
                    state.extra[extra].guide_force = state.extra[extra].guide_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(kind.friction.contacts):
                drag, holds = friction_and_hold(now, size, normal, relative, contact, shared.friction[p])
                force = force + drag
                if now.stage == 0:
                    access.store(state.contact_hold, at, holds)
            rollers.set_force(shared, j, rollers.force(shared, j) + force)
            keep_impact_speed(state, now, at, before, first)
            keep_damper_speed(state, now, at, law.answer, damper_speed)
            if wp.static(kind.measuring) and now.measures != 0:
                after = more - chains.chain_at(shared, j).inverse_mass * force
                taken, rubbed = dissipated_powers(
                    mine, dissipating_force(pushes, size - elastic, normal), drag, relative, after
                )
                contact_sums.add_powers(tallies, now, at, taken, rubbed)
                contact_sums.add_stored_energy(tallies, now, at, contact_energy(mean, elastic, known))
                contact_sums.add_force_and_counts(tallies, now, at, before, size, p < sprockets)
        return closed, force

    return ContactFunctions(
        Contact=Contact,
        with_kinematics=with_kinematics,
        acceleration_past=acceleration_past,
        approach_acceleration=approach_acceleration,
        with_memory=with_memory,
        friction_and_hold=friction_and_hold,
        specialized_law=specialized_law,
        velocity_lag=velocity_lag,
        dissipating_force=dissipating_force,
        dissipated_powers=dissipated_powers,
        keep_impact_speed=keep_impact_speed,
        keep_damper_speed=keep_damper_speed,
        add_normal_force=add_normal_force,
    )
