"""The contacts of a block's silent chains with wheel teeth: four at a pin, with the flank ends of its two links.

Forces go to rows of their own first, on the pin itself and on those beside it, until all threads have theirs: a pin's
acceleration without them is that by its links, and by contacts as in the step before (`physics.toe`).
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import load_constant, products, row_access
from ..number import difference, leading_value
from ..physics.contact import (
    contact_energy,
    memory_after_teeth,
    normal_force,
    reaction_moment,
    relative_acceleration,
    rotated_vector,
    surface_velocity,
)
from ..physics.impact import law_at_roller
from ..physics.toe import force_on_far_pin, point_mobility, seated_toe_contact, toe_contact
from ..physics.tooth import nearest_seat, tracked_seat_from
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contact_sums import contact_sum_functions
from .contacts import contact_functions
from .events import EXTRA
from .rollers import roller_functions
from .shared_memory import force_rows
from .toe_links import toe_link_functions
from .toe_rows import toe_row_functions
from .wrench_parts import wrench_part_functions


@dataclass(frozen=True)
class ToeFunctions:
    """Contacts of one variant's silent chains with wheel teeth, and what those of backs have in common with them."""

    End: Any
    Reaction: Any
    with_end_force: wp.Function
    add_toe_forces: wp.Function


@cache
def toe_functions(kind: BlockKind) -> ToeFunctions:
    """The functions that evaluate contacts of toes with the wheels of one variant on a block."""
    Real, kinds, Now, sprockets = kind.Real, kind.types, kind.types.Now, kind.parts.sprockets
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2 = kinds.vec2
    row = force_rows(kind)
    contacts = contact_functions(kind)
    contact_sums = contact_sum_functions(kind)
    chains = chain_functions(kind)
    wrench_parts = wrench_part_functions(kind)
    access, whole_access = row_access(Real), row_access(wp.int32)
    rollers = roller_functions(kind)
    toe_links, toe_rows = toe_link_functions(kind), toe_row_functions(kind)

    @wp.struct
    class Pin:
        """A pin in a tooth gap."""

        number: wp.int32
        sprocket: wp.int32
        memory: wp.int32  # place of its contacts' memory
        outward: vec2  # direction of the gap's seat
        xi: Real  # from the seat along that [m]
        lateral: Real  # and across
        arm: vec2  # from the wheel's center [m]
        acceleration: vec2  # by links, and by contacts as in the step before [m/s^2]

    @wp.struct
    class Reaction:
        """Forces of teeth on a toe, as far as they are added up."""

        near: vec2  # on its pin [N]
        far: vec2  # on its link's other pin [N]
        whole: vec2  # [N]
        moment: Real  # on the wheel [N m]

    @wp.struct
    class End:
        """A flank's end in a tooth gap, or a back on a guide."""

        number: wp.int32  # of the pin
        partner: wp.int32  # sprockets first, then guides
        link: toe_links.Link
        memory: wp.int32  # place of the contact's memory
        open_speed: Real  # v0 if it is open
        before: Real  # v0 [m/s]
        pushed: Real  # force in the step before [N]
        damper_speed: Real  # at which its damper acted then [m/s]
        depth: Real  # [m]
        normal: vec2
        place: vec2  # from the link's middle [m]

    @wp.func
    def with_end_force(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, end: End, sum: Reaction
    ):
        """`sum` with the force of a contact of a link."""
        at, link, depth, normal, z = end.memory, end.link, end.depth, end.normal, end.place
        j, p, before = end.number, end.partner, end.before
        body, law = toe_links.partner_pose(shared, p), toe_links.partner_law(shared, p)
        kept, size = Real(end.open_speed), Real(0.0)
        if depth > -law.ahead:
            arm = link.middle + z
            surface = leading_value(surface_velocity(body, arm))
            relative = surface - link.velocity - link.turn * vec2(-z[1], z[0])
            own = link.acceleration + link.angular * vec2(-z[1], z[0])
            straight = vec2()
            if wp.static(kind.moving):
                straight = body.straight
            more = relative_acceleration(straight, body.angular, arm, own)
            mobility = point_mobility(z, normal, link.length)
            inverse_mass = chains.chain_at(shared, j).inverse_mass
            pushed = wp.where(before > Real(0.0), end.pushed, Real(0.0))
            speed = products(relative[0], normal[0], relative[1], normal[1])
            growth = products(more[0], normal[0], more[1], normal[1]) + inverse_mass * mobility * pushed
            known = law_at_roller(contacts.specialized_law(shared, law, j), Real(1.0) / mobility, mobility)
            mean, elastic, found, first, damper = normal_force(depth, speed, growth, before, end.damper_speed, known)
            if mean > Real(0.0):
                size, kept = found, first
                pushes = size * normal
                force, drag = pushes, vec2()
                if wp.static(kind.friction.contacts):
                    contact = contacts.Contact()
                    contact.impact_speed = before
                    contact.held_friction = access.load(state.contact_hold, at)
                    drag, holds = contacts.friction_and_hold(now, size, normal, relative, contact, shared.friction[p])
                    force = force + drag
                    if now.stage == 0:
                        access.store(state.contact_hold, at, holds)
                far = force_on_far_pin(force, z, link.u, link.length)
                sum.near = sum.near + (force - far)
                sum.far = sum.far + far
                sum.whole = sum.whole + force
                sum.moment = sum.moment + reaction_moment(arm, force)
                if now.stage == 0:
                    access.store(state.damper_speed, at, damper)
                if now.flags & EXTRA != 0:
                    extra = mine.first_roller + j
                    state.extra[extra].energy = state.extra[extra].energy + contact_energy(mean, elastic, known)
                    if p < sprockets:
                        state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + size
                    else:
                        state.extra[extra].guide_force = state.extra[extra].guide_force + size
                if wp.static(kind.measuring) and now.measures != 0:
                    damping = contacts.dissipating_force(pushes, size - elastic, normal)
                    taken, rubbed = contacts.dissipated_powers(mine, damping, drag, relative, more)
                    contact_sums.add_powers(tallies, now, at, taken, rubbed)
                    contact_sums.add_stored_energy(tallies, now, at, contact_energy(mean, elastic, known))
                    contact_sums.add_force_and_counts(tallies, now, at, before, size, p < sprockets)
        if now.stage == 0:
            if size != end.pushed:
                access.store(state.push, chains.push_memory(shared, mine, j, at), size)
            if kept != before:
                access.store(state.impact_speed, at, kept)
        return sum

    @wp.func
    def add_link_forces(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, pin: Pin, after: bool
    ):
        """Adds the forces of teeth on the toe at a pin of the link after it, or before it, to rows and wheel."""
        j, s, e = pin.number, pin.sprocket, pin.outward
        count = chains.chain_length(shared, mine, j)
        end = End()
        end.number = j
        end.partner = s
        other = wp.where(
            after, chains.next_roller(shared, j, mine.rollers), chains.previous_roller(shared, j, mine.rollers)
        )
        end.link = toe_links.link_of_pin(shared, j, other, pin.arm)
        x, y = end.link.u[0], end.link.u[1]
        u = vec2(products(x, e[0], y, e[1]), products(y, e[0], -x, e[1]))
        plate, teeth = shared.plates[chains.chain_number(shared, j)], shared.teeth[s]
        moves, sum = bool(False), Reaction()
        k = int(0)  # a loop that Warp does not unroll: four times the code would not fit the instruction caches
        while k < 2:
            at = pin.memory + k * count
            end.memory = at
            end.before = access.load(state.impact_speed, at)
            end.open_speed = memory_after_teeth(end.before)
            end.pushed = access.load(state.push, chains.push_memory(shared, mine, j, at))
            end.damper_speed = access.load(state.damper_speed, at)
            depth, n, z, done = seated_toe_contact(pin.xi, pin.lateral, u, end.link.length, k, after, plate, teeth)
            if done == 0:
                depth, n, z = toe_contact(pin.xi, pin.lateral, u, end.link.length, k, after, plate, teeth)
            if depth > -teeth.law.ahead and not moves:
                end.link = toe_links.with_motion(state, shared, mine, j, other, pin.acceleration, end.link)
                moves = True
            end.depth = depth
            end.normal = rotated_vector(e, n[0], n[1])
            end.place = rotated_vector(e, z[0], z[1])
            sum = with_end_force(state, tallies, shared, mine, now, end, sum)
            k = k + 1
        toe_rows.add_pair(shared.rows, row.near_x, row.near_y, j, sum.near)
        if after:
            toe_rows.add_pair(shared.rows, row.next_x, row.next_y, j, sum.far)
        else:
            toe_rows.add_pair(shared.rows, row.last_x, row.last_y, j, sum.far)
        wrench_parts.add_wrench(shared, mine, s, j, sum.moment, sum.whole, now.measures)
        wrench_parts.add_wrench_on_carrier(shared, mine, now, s, j, sum.whole)

    @wp.func
    def add_toe_forces(
        ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, j: int, s: int
    ):
        """Adds the forces of teeth of sprocket s on the links at pin j to rows, and their reactions to the sprocket."""
        teeth, body = shared.teeth[s], shared.poses[s]
        p = difference(rollers.exact_position(shared.rows, j), body.center)
        pin = Pin()
        pin.number = j
        pin.sprocket = s
        pin.memory = chains.contact_memory(shared, mine, j, s)
        pin.arm = leading_value(p)
        kept = whole_access.load(state.seat, pin.memory)
        number = kept
        if number < 0:
            number = nearest_seat(pin.arm, leading_value(body.cosine), leading_value(body.sine), teeth.teeth)
        found, e, xi, lateral = tracked_seat_from(
            p, number, load_constant(ensemble.seats, teeth.first_seat + number), body, teeth, ensemble.seats
        )
        if found != kept:
            whole_access.store(state.seat, pin.memory, found)
        pin.outward = e
        pin.xi = xi
        pin.lateral = lateral
        pin.acceleration = toe_links.pin_acceleration(state, shared, mine, j)
        side = int(0)
        while side < 2:
            add_link_forces(state, tallies, shared, mine, now, pin, side == 0)
            pin.memory = pin.memory + 2 * chains.chain_length(shared, mine, j)
            side = side + 1

    return ToeFunctions(
        End=End,
        Reaction=Reaction,
        with_end_force=with_end_force,
        add_toe_forces=add_toe_forces,
    )
