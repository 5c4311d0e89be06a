"""The contacts of a block's rollers with guides, straight bars and profiles: forces and their reactions on bodies."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..number import difference
from ..physics.contact import MISSED, UNTOUCHED, misses, reaction, respond, surface_velocity, turned
from ..physics.guide import on_guide, start_of
from ..physics.profile import on_profile, tracked_piece
from ..rows import accessors
from ..structs import types
from ..sum_structs import Tallies
from .contact_sums import contact_sums
from .events import EXTRA, START
from .geometry import contact_geometry
from .kind import BlockKind, Mine, now_struct
from .near_mask import near_mask
from .roller_rows import roller_rows
from .sync import count_at
from .wheels import load_line
from .wrench import wrench_parts


@cache
def guide_contacts(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate the contacts of one variant's rollers on a block with its guides."""
    Real, paired, sprockets, bodies = kind.Real, kind.paired, kind.sprockets, kind.bodies
    profiles, sliding = kind.profiles, kind.contact_friction
    kinds, Now = types(Real), now_struct(Real)
    vec2 = kinds.vec2
    row, geometry, bits, sums = roller_rows(kind), contact_geometry(kind), near_mask(kind), contact_sums(kind)
    bar_of, in_carrier, carrier_at = geometry.bar_of, geometry.in_carrier, geometry.carrier_at
    arm_on, center_velocity = geometry.arm_on, geometry.center_velocity
    Bits, of_bars, any_of, first, rest = bits.Bits, bits.of_bars, bits.any_of, bits.first, bits.rest
    drag_of, as_known, powers, put = sums.drag_of, sums.as_known, sums.powers, sums.put
    measure_powers, measure_force, add_wrench = sums.measure_powers, sums.measure_force, wrench_parts(kind).add_wrench
    point, velocity, force_on, set_force = row.point, row.velocity, row.force_on, row.set_force
    load_row = accessors(Real).load_row
    load_whole, store_whole = accessors(wp.int32).load_row, accessors(wp.int32).store_row

    @wp.func
    def at_profile(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, g: int, bar: kinds.Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on the profile of guide g."""
        at = mine.memory + j + (wp.static(sprockets) + g) * mine.rollers
        kept = load_whole(state.seat, at)
        arm, q = in_carrier(shared, j, bar.body)
        if wp.static(paired):
            pieces = ensemble.split_pieces
        else:
            pieces = ensemble.pieces
        number = tracked_piece(q, kept, bar, pieces)
        if number != kept:
            store_whole(state.seat, at, number)
        penetration, facing = on_profile(q, number, bar, pieces)
        v = velocity(shared.rows, j)
        if wp.static(paired):
            relative = -v
            if bar.body < wp.static(bodies):
                body = carrier_at(shared, bar.body)
                facing = turned(facing, body.cosine.high, body.sine.high)
                way = vec2(-body.speed.high * arm.high[1], body.speed.high * arm.high[0])
                relative = relative + way + center_velocity(shared, bar.body)
            return penetration, facing, relative
        else:
            pose = carrier_at(shared, bar.body)
            return penetration, turned(facing, pose.cosine, pose.sine), surface_velocity(pose, arm) - v

    @wp.func
    def on_straight(shared: kinds.Shared, j: int, g: int, bar: kinds.Guide):
        """The same on guide g, a straight bar on the ground."""
        p = point(shared.rows, j)
        v = velocity(shared.rows, j)
        if wp.static(paired):
            line = load_line(shared.lines, g)
            return on_guide(difference(p, start_of(line)), v, line, bar)
        else:
            return on_guide(p - bar.start, v, vec2(Real(0.0), Real(0.0)), bar)

    @wp.func
    def on_bar(
        ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, g: int, bar: kinds.Guide
    ):
        """Penetration [m], normal and relative velocity [m/s] of roller j on guide g."""
        if wp.static(profiles):
            penetration = Real(0.0)
            normal = vec2()
            relative = vec2()
            if bar.pieces != 0:
                penetration, normal, relative = at_profile(ensemble, state, shared, mine, j, g, bar)
            else:
                penetration, normal, relative = on_straight(shared, j, g, bar)
            return penetration, normal, relative
        else:
            return on_straight(shared, j, g, bar)

    @wp.func
    def at_guide(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        g: int,
    ):
        """Adds the force of guide g to roller j's, and its reaction to the body that carries it."""
        bar = bar_of(shared, g)
        at = mine.memory + j + (wp.static(sprockets) + g) * mine.rollers
        before = load_row(state.impact_speed, at)
        penetration, normal, relative = on_bar(ensemble, state, shared, mine, j, g, bar)
        if penetration > Real(0.0) and misses(penetration, before, bar):
            if now.measured != 0 and (before == Real(UNTOUCHED) or now.flags & START != 0):
                count_at(tallies.missed, at)
            put(state, now, at, before, Real(MISSED))
        elif penetration > Real(0.0):
            force, size, first, damper, energy = respond(penetration, normal, relative, before, as_known(bar.law))
            if now.flags & EXTRA != 0:
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + energy
                state.extra[extra].guide_force = state.extra[extra].guide_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag = drag_of(size, normal, relative, shared.sliding[wp.static(sprockets) + g])
                force = force + drag
            whole = force_on(shared, j) + force
            set_force(shared, j, whole)
            if wp.static(profiles):
                if bar.body < wp.static(bodies):
                    moment = reaction(arm_on(shared, j, bar.body), force)
                    add_wrench(shared, mine, bar.body, j, moment, force, now.watched)
            put(state, now, at, before, first)
            if now.measured != 0:
                damped, rubbed = powers(shared, mine, whole, damper * normal, drag, relative)
                measure_powers(tallies, now, at, damped, rubbed)
                measure_force(tallies, now, at, before, size, False)
        else:
            put(state, now, at, before, Real(UNTOUCHED))

    @wp.func
    def at_bars(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        near: Bits,
    ):
        """Adds the forces of the guides that they are near to those of the thread's rollers."""
        by_bar = of_bars(near)
        while any_of(by_bar):
            j, p = first(by_bar, mine.thread)
            by_bar = rest(by_bar)
            at_guide(ensemble, state, tallies, shared, mine, now, j, p - wp.static(sprockets))

    return namespace(at_bars)
