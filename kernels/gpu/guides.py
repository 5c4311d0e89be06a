"""The contacts of a block's rollers with guides, straight bars and profiles: forces and their reactions on bodies."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import aligned, row_access
from ..number import difference, leading
from ..physics.contact import MISSED, UNTOUCHED, has_missed_face, reaction_moment, rotated_vector, surface_velocity
from ..physics.guide import bar_contact, profile_contact, tracked_piece
from ..structs import Tallies
from .contacts import contact_sums, wrench_parts
from .geometry import contact_geometry
from .kind import START, BlockKind, Mine
from .near import near_mask
from .rings import block_rings
from .rollers import roller_rows
from .sync import add_to


@cache
def guide_contacts(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate the contacts of one variant's rollers on a block with its guides."""
    Real, sprockets, bodies = kind.Real, kind.parts.sprockets, kind.parts.bodies
    profiles = kind.profiles
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Guide = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Guide
    vec2 = kinds.vec2
    row, geometry, bits, sums = roller_rows(kind), contact_geometry(kind), near_mask(kind), contact_sums(kind)
    in_carrier, arm_on, guide_at = geometry.in_carrier, geometry.arm_on, geometry.guide_at
    Bits, of_bars, any_of, first, rest = bits.Bits, bits.of_bars, bits.any_of, bits.first, bits.rest
    Touch, placed, press, keep, gaining = sums.Touch, sums.placed, sums.press, sums.keep, sums.gaining
    remembering = sums.remembering
    add_wrench = wrench_parts(kind).add_wrench
    point, velocity, memory_of = row.point, row.velocity, block_rings(kind).memory_of
    load_row, rows_of_pieces = row_access(Real).load, aligned(kinds.Piece)
    load_whole, store_whole = row_access(wp.int32).load, row_access(wp.int32).store

    @wp.func
    def at_profile(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, j: int, g: int, bar: Guide):
        """Penetration [m], normal and relative velocity [m/s] of roller j on the profile of guide g."""
        at = memory_of(shared, mine, j, wp.static(sprockets) + g)
        kept = load_whole(state.seat, at)
        arm, q = in_carrier(shared, j, bar.body)
        pieces = rows_of_pieces(ensemble.pieces)
        number = int(kept)
        if kept < 0:
            number = tracked_piece(q, kept, bar, pieces)
        penetration, facing, beyond = profile_contact(q, number, bar, pieces)
        if beyond != 0 and kept >= 0:
            number = wp.clamp(kept + beyond, 0, bar.pieces - 1)
            penetration, facing, beyond = profile_contact(q, number, bar, pieces)
        if number != kept:
            store_whole(state.seat, at, number)
        pose = shared.poses[bar.body]
        relative = surface_velocity(pose, leading(arm)) - velocity(shared.rows, j)
        return penetration, rotated_vector(facing, leading(pose.cosine), leading(pose.sine)), relative

    @wp.func
    def on_straight(shared: Shared, j: int, bar: Guide):
        """The same on a straight bar, which is where `guide_at` has it."""
        p = difference(point(shared.rows, j), bar.start)
        surface = vec2(Real(0.0), Real(0.0))
        if wp.static(profiles):
            surface = surface_velocity(shared.poses[bar.body], arm_on(shared, j, bar.body))
        return bar_contact(p, velocity(shared.rows, j), surface, bar)

    @wp.func
    def on_bar(ensemble: Ensemble, state: State, shared: Shared, mine: Mine, j: int, g: int, bar: Guide):
        """Penetration [m], normal and relative velocity [m/s] of roller j on guide g."""
        if wp.static(profiles):
            penetration = Real(0.0)
            normal = vec2()
            relative = vec2()
            if bar.pieces != 0:
                penetration, normal, relative = at_profile(ensemble, state, shared, mine, j, g, bar)
            else:
                penetration, normal, relative = on_straight(shared, j, bar)
            return penetration, normal, relative
        else:
            return on_straight(shared, j, bar)

    @wp.func
    def at_guide(
        ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: Mine, now: Now, j: int, g: int
    ):
        """Adds the force of guide g to roller j's, and its reaction to the body that carries it."""
        bar = guide_at(shared, g)
        touch = Touch()
        touch.partner = wp.static(sprockets) + g
        at = memory_of(shared, mine, j, touch.partner)
        touch = remembering(state, touch, at)
        before = touch.before
        penetration, normal, relative = on_bar(ensemble, state, shared, mine, j, g, bar)
        closed = bool(False)
        kept = Real(UNTOUCHED)
        if penetration > -bar.law.ahead:
            if has_missed_face(penetration, before, bar):
                kept = Real(MISSED)
                if now.measured != 0 and (before == Real(UNTOUCHED) or now.flags & START != 0):
                    add_to(tallies.missed, at, 1)
            else:
                touch = placed(touch, penetration, normal, relative)
                arm = vec2()
                carrier = kinds.Pose()
                if wp.static(profiles):
                    arm = arm_on(shared, j, bar.body)
                    carrier = shared.poses[bar.body]
                touch.gaining = gaining(shared, carrier, arm, j)
                closed, force = press(state, tallies, shared, mine, now, j, touch, bar.law)
                if wp.static(profiles):
                    if closed and bar.body < wp.static(bodies):
                        moment = reaction_moment(arm, force)
                        add_wrench(shared, mine, bar.body, j, moment, force, now.measured)
        if not closed:
            keep(state, now, at, before, kept)

    @wp.func
    def at_bars(ensemble: Ensemble, state: State, tallies: Tallies, shared: Shared, mine: Mine, now: Now, near: Bits):
        """Adds the forces of the guides that they are near to those of the thread's rollers."""
        by_bar = of_bars(near)
        while any_of(by_bar):
            j, p = first(by_bar, mine.thread)
            by_bar = rest(by_bar)
            at_guide(ensemble, state, tallies, shared, mine, now, j, p - wp.static(sprockets))

    return SimpleNamespace(**locals())
