"""The CPU kernel's passes over the rollers of one variant for its guides: straight bars, and profiles."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.contact import (
    MISSED,
    UNTOUCHED,
    dissipated,
    misses,
    on_guide,
    reaction,
    respond,
    rub,
    surface_velocity,
    turned,
)
from ..physics.profile import in_frame, near_profile, on_profile, tracked_piece
from ..rows import accessors
from ..structs import Piece, Pose, types
from ..sum_structs import Totals
from .rollers import passes, rows


@dataclass(frozen=True)
class GuidePasses:
    """The passes over the rollers of one variant for its guides."""

    guide_pass: wp.Function
    profile_pass: wp.Function


@cache
def guide_passes(Real: type, capacity: int) -> GuidePasses:
    """The passes for guides over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    vec2, part = kinds.vec2, passes(Real, capacity)
    load_row, store_row = accessors(Real).load_row, accessors(Real).store_row
    at = rows(capacity)
    VX, VY, GUIDE_FORCE = at.vx, at.vy, at.guide_force
    place, add_force, add_response, acceleration = part.place, part.add_force, part.add_response, part.acceleration

    @wp.struct
    class Touch:
        """A roller on a guide: how deep, and how it slides."""

        penetration: Real  # [m]
        normal: vec2  # towards the roller
        relative: vec2  # velocity of the guide's material point less the roller's [m/s]
        arm: vec2  # the roller from the center of the guide's body [m]

    @wp.func
    def press(
        w: wp.array[Real],
        i: int,
        touch: Touch,
        guide: kinds.Guide,
        memory: kinds.Memory,
        sliding: kinds.Sliding,
        chain: kinds.Chain,
        totals: Totals,
    ):
        """Roller i on a guide: its force [N], what the contact keeps, and `totals` with its part."""
        before = load_row(memory.impact_speed, memory.first + i)
        force = vec2(Real(0.0), Real(0.0))
        kept = Real(UNTOUCHED)
        if touch.penetration > Real(0.0) and misses(touch.penetration, before, guide):
            kept = Real(MISSED)
            totals.missing += 1
            if before == Real(UNTOUCHED):
                totals.missed += 1
        elif touch.penetration > Real(0.0):
            normal, relative = touch.normal, touch.relative
            force, size, kept, damper, energy = respond(touch.penetration, normal, relative, before, guide.law)
            drag = vec2(Real(0.0), Real(0.0))
            if sliding.rubs != 0:
                drag = rub(size, normal, relative, sliding)
            force = force + drag
            add_force(w, i, GUIDE_FORCE, force, size)
            totals.moment += wp.float64(reaction(touch.arm, force))
            a = acceleration(w, i, chain.inverse_mass, chain.gravity)
            damped = wp.float64(dissipated(damper * normal, relative, a, memory.lag))
            rubbed = wp.float64(dissipated(drag, relative, a, memory.lag))
            totals = add_response(totals, wp.float64(size), damped, rubbed, wp.float64(energy))
            if before == Real(UNTOUCHED):
                totals.impacts += 1
        if memory.stage == 0:
            store_row(memory.impact_speed, memory.first + i, kept)
        return force, totals

    @wp.func
    def guide_pass(
        w: wp.array[Real],
        n: int,
        bar: kinds.Guide,
        body: Pose,
        memory: kinds.Memory,
        sliding: kinds.Sliding,
        chain: kinds.Chain,
    ):
        """Contacts of all rollers with one guide-bar on a body, eq. (21)-(23); returns their `Totals`."""
        totals = Totals()
        push = vec2(Real(0.0), Real(0.0))
        reach = wp.float64(bar.end_radius + bar.roller_radius)
        end = wp.float64(bar.length) + reach
        i = int(0)
        while i < n:
            p = place(w, i) - bar.start
            along = wp.dot(p, bar.direction)
            if along > -reach and along < end:
                arm = place(w, i) - body.center
                surface = surface_velocity(body, arm)
                v = vec2(load_row(w, VX + i), load_row(w, VY + i))
                touch = Touch()
                touch.arm = vec2(Real(arm[0]), Real(arm[1]))
                penetration, normal, relative = on_guide(p, v, vec2(Real(surface[0]), Real(surface[1])), bar)
                touch.penetration = penetration
                touch.normal = normal
                touch.relative = relative
                force, totals = press(w, i, touch, bar, memory, sliding, chain, totals)
                push -= force
            else:
                if memory.stage == 0:
                    store_row(memory.impact_speed, memory.first + i, Real(0.0))
            i = i + 1
        totals.push = wp.vec2d(wp.float64(push[0]), wp.float64(push[1]))
        return totals

    @wp.func
    def profile_pass(
        w: wp.array[Real],
        n: int,
        guide: kinds.Guide,
        body: Pose,
        pieces: wp.array[Piece],
        memory: kinds.Memory,
        sliding: kinds.Sliding,
        chain: kinds.Chain,
    ):
        """Contacts of all rollers with one guide's profile on a body; returns their `Totals`.

        The guide's `first_piece` is its first among all `pieces`.
        """
        totals = Totals()
        push = vec2(Real(0.0), Real(0.0))
        i = int(0)
        while i < n:
            arm = place(w, i) - body.center
            q = in_frame(arm, body)
            at = memory.first + i
            if near_profile(q, guide):
                number = tracked_piece(q, memory.seat[at], guide, pieces)
                memory.seat[at] = number
                touch = Touch()
                touch.arm = vec2(Real(arm[0]), Real(arm[1]))
                penetration, facing = on_profile(q, number, guide, pieces)
                touch.penetration = penetration
                facing = turned(facing, body.cosine, body.sine)
                surface = surface_velocity(body, arm)
                touch.normal = vec2(Real(facing[0]), Real(facing[1]))
                v = vec2(load_row(w, VX + i), load_row(w, VY + i))
                touch.relative = vec2(Real(surface[0]), Real(surface[1])) - v
                force, totals = press(w, i, touch, guide, memory, sliding, chain, totals)
                push -= force
            else:
                if memory.seat[at] >= 0:
                    memory.seat[at] = -1
                    store_row(memory.impact_speed, at, Real(0.0))
            i = i + 1
        totals.push = wp.vec2d(wp.float64(push[0]), wp.float64(push[1]))
        return totals

    return GuidePasses(guide_pass=guide_pass, profile_pass=profile_pass)
