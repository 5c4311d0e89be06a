"""One contact of a link of a block's silent chain, a toe's with a tooth or a back's with a guide: force, memory, sums.

Forces act on the link's two pins. A pin's acceleration without them is that by its links, and by contacts as in the
step before (`physics.toe`).
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import products, reciprocal, row_access
from ..number import leading_value
from ..physics.contact import contact_energy, normal_force, reaction_moment, surface_velocity
from ..physics.impact import law_at_roller
from ..physics.toe import force_on_far_pin, point_mobility
from ..structs import Tallies
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .contact_sums import contact_sum_functions
from .contacts import contact_functions
from .events import EXTRA
from .toe_links import toe_link_functions


@dataclass(frozen=True)
class LinkContactFunctions:
    """Contacts of links of one variant's silent chains."""

    LinkContact: Any
    Reaction: Any
    find_reaction: wp.Function
    sum_of_reactions: wp.Function
    add_samples: wp.Function


@cache
def link_contact_functions(kind: BlockKind) -> LinkContactFunctions:
    """The functions that evaluate contacts of links of silent chains of one variant on a block."""
    Real, kinds, Now, sprockets = kind.Real, kind.types, kind.types.Now, kind.parts.sprockets
    State, Shared = kinds.State, kinds.Shared
    vec2 = kinds.vec2
    contacts, contact_sums = contact_functions(kind), contact_sum_functions(kind)
    chains, toe_links = chain_functions(kind), toe_link_functions(kind)
    access = row_access(Real)

    @wp.struct
    class Reaction:
        """Forces of contacts on links at a pin."""

        near: vec2  # on its pin [N]
        far: vec2  # on its link's other pin [N]
        whole: vec2  # [N]
        moment: Real  # on the wheel [N m]
        size: Real  # of normal forces, for frames [N]
        energy: Real  # of contacts, for frames [J]

    @wp.struct
    class LinkContact:
        """Contact of a flank's end in a tooth gap, or of a back on a guide."""

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
    def find_reaction(
        state: State, tallies: Tallies, shared: Shared, mine: ThreadParts, now: Now, contact: LinkContact
    ):
        """Force of a contact of a link, which it keeps and adds to sums."""
        sum = Reaction()
        at, link, depth, normal, z = contact.memory, contact.link, contact.depth, contact.normal, contact.place
        j, p, before = contact.number, contact.partner, contact.before
        body, law = toe_links.partner_pose(shared, p), toe_links.partner_law(shared, p)
        kept, size = Real(contact.open_speed), Real(0.0)
        if depth > -law.ahead:
            arm = link.middle + z
            surface = leading_value(surface_velocity(body, arm))
            relative = surface - link.velocity - link.turn * vec2(-z[1], z[0])
            own = link.acceleration + link.angular * vec2(-z[1], z[0])
            more = contacts.acceleration_past(body, arm, own)
            mobility = point_mobility(z, normal, link.length)
            inverse_mass = chains.chain_at(shared, j).inverse_mass
            pushed = wp.where(before > Real(0.0), contact.pushed, Real(0.0))
            speed = products(relative[0], normal[0], relative[1], normal[1])
            growth = products(more[0], normal[0], more[1], normal[1]) + inverse_mass * mobility * pushed
            known = law_at_roller(contacts.specialized_law(shared, law, j), reciprocal(mobility), mobility)
            mean, elastic, found, first, damper = normal_force(
                depth, speed, growth, before, contact.damper_speed, known
            )
            if mean > Real(0.0):
                size, kept = found, first
                pushes = size * normal
                force, drag = pushes, vec2()
                if wp.static(kind.friction.contacts):
                    roller_contact = contacts.Contact()
                    roller_contact.impact_speed = before
                    roller_contact.held_friction = access.load(state.contact_hold, at)
                    drag, holds = contacts.friction_and_hold(
                        now, size, normal, relative, roller_contact, shared.friction[p]
                    )
                    force = force + drag
                    if now.stage == 0:
                        access.store(state.contact_hold, at, holds)
                far = force_on_far_pin(force, z, link.u, link.length)
                sum.near = force - far
                sum.far = far
                sum.whole = force
                sum.moment = reaction_moment(arm, force)
                if now.stage == 0:
                    access.store(state.damper_speed, at, damper)
                if now.flags & EXTRA != 0:
                    sum.size = size
                    sum.energy = contact_energy(mean, elastic, known)
                if wp.static(kind.measuring) and now.measures != 0:
                    damping = contacts.dissipating_force(pushes, size - elastic, normal)
                    taken, rubbed = contacts.dissipated_powers(mine, damping, drag, relative, more)
                    contact_sums.add_powers(tallies, now, at, taken, rubbed)
                    contact_sums.add_stored_energy(tallies, now, at, contact_energy(mean, elastic, known))
                    contact_sums.add_force_and_counts(tallies, now, at, before, size, p < sprockets)
        if now.stage == 0:
            if size != contact.pushed:
                access.store(state.push, chains.push_memory(shared, mine, j, at), size)
            if kept != before:
                access.store(state.impact_speed, at, kept)
        return sum

    @wp.func
    def add_samples(state: State, mine: ThreadParts, now: Now, j: int, p: int, sum: Reaction):
        """Adds size and energy of forces of partner p on a link of pin j to what a frame shows of the pin, if any."""
        if now.flags & EXTRA != 0:
            extra = mine.first_roller + j
            state.extra[extra].energy = state.extra[extra].energy + sum.energy
            if p < sprockets:
                state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + sum.size
            else:
                state.extra[extra].guide_force = state.extra[extra].guide_force + sum.size

    @wp.func
    def sum_of_reactions(sum: Reaction, more: Reaction):
        """`sum` with `more`."""
        sum.near = sum.near + more.near
        sum.far = sum.far + more.far
        sum.whole = sum.whole + more.whole
        sum.moment = sum.moment + more.moment
        sum.size = sum.size + more.size
        sum.energy = sum.energy + more.energy
        return sum

    return LinkContactFunctions(
        LinkContact=LinkContact,
        Reaction=Reaction,
        find_reaction=find_reaction,
        sum_of_reactions=sum_of_reactions,
        add_samples=add_samples,
    )
