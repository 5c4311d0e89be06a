"""The block kernels' evaluation: the forces on the roller that a thread holds, and the moments on the sprockets."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .board import (
    CENTER_X,
    CENTER_Y,
    COSINE,
    FAR,
    NEAR,
    SINE,
    SLATE_STRIDE,
    SLATE_X,
    SLATE_Y,
    SPEED,
    STRIDE,
)
from .contact import guide_contact, sprocket_contact
from .exchange import any_lane, exchange, lanes, lowest_bit
from .link import link_force
from .structs import Tallies, types, vec2d
from .tooth import nearest_seat


@cache
def block_forces(Real: type, threads: int, sprockets: int) -> SimpleNamespace:
    """The functions that evaluate one variant on a block of `threads` threads, with up to `sprockets` sprockets."""
    kinds = types(Real)
    vec2 = kinds.vec2
    talk = exchange(Real, threads, sprockets)
    State = talk.state
    compensated = Real == wp.float32
    state_of_next, force_of_previous, warp_sum = talk.state_of_next, talk.force_of_previous, talk.warp_sum
    get, put, slate_get = talk.get, talk.put, talk.slate_get

    @wp.struct
    class Forces:
        """What an evaluation finds for one roller and the link after it."""

        link: vec2  # force of the link after, on the roller [N]
        contact: vec2  # force of all contacts [N]
        tension: Real  # [N]
        rate: Real  # of the link's elongation [m/s]
        sprocket_force: Real  # sum of magnitudes [N]
        guide_force: Real  # [N]
        energy: Real  # elastic, of the contacts [J]

    @wp.func
    def place(own: State, center: vec2d):
        """Position in float64 from `center` [m]."""
        if wp.static(compensated):
            return vec2d(
                wp.float64(own[0]) - center[0] + wp.float64(own[4]),
                wp.float64(own[1]) - center[1] + wp.float64(own[5]),
            )
        else:
            return vec2d(wp.float64(own[0]) - center[0], wp.float64(own[1]) - center[1])

    @wp.func
    def bands(own: State, count: int):
        """The sprockets whose band of engagement the roller is in, as bits."""
        mask = int(0)
        for s in range(count):
            at = s * SLATE_STRIDE
            x = own[0] - slate_get(at + SLATE_X)
            y = own[1] - slate_get(at + SLATE_Y)
            square = x * x + y * y
            if square > slate_get(at + NEAR) and square < slate_get(at + FAR):
                mask = mask | (1 << s)
        return mask

    @wp.func
    def tally_contact(tallies: Tallies, memory: int, weight: Real, force: Real, dissipated: Real, began: int):
        """Adds one roller's contact of one step to its own sums; `weight` is the time it stands for [s]."""
        sums = tallies.contact[memory]
        sums.force_max = wp.max(sums.force_max, wp.float64(force))
        sums.impacts = sums.impacts + began
        sums.impulse = sums.impulse + wp.float64(weight * force)
        sums.dissipated = sums.dissipated + wp.float64(weight * dissipated)
        tallies.contact[memory] = sums

    @wp.func
    def link_of(own: State, other: State, chain: kinds.Chain):
        """Tension [N], rate of elongation [m/s] and force on the roller [N] of the link to `other`, eq. (2), (3)."""
        d = vec2(other[0] - own[0], other[1] - own[1])
        if wp.static(compensated):
            d = d + vec2(other[4] - own[4], other[5] - own[5])
        tension, rate, u = link_force(
            d, vec2(other[2] - own[2], other[3] - own[3]), chain.pitch, chain.stiffness, chain.damping
        )
        return tension, rate, tension * u

    @wp.func
    def clear_moments(i: int, count: int):
        """This warp's part of every sprocket's moment, set to zero by its first lane."""
        if i % lanes() == 0:
            warps = wp.static(threads) // lanes()
            for s in range(count):
                put(wp.static(sprockets) * STRIDE + s * warps + i // lanes(), wp.float64(0.0))

    @wp.func
    def add_moment(moment: Real, on: int, i: int, count: int):
        """Adds up the warp's moments on each sprocket; this thread's is on sprocket `on`, none if negative."""
        warps = wp.static(threads) // lanes()
        for s in range(count):
            mine = Real(0.0)
            if s == on:
                mine = moment
            if any_lane(int(mine != Real(0.0))) != 0:
                total = warp_sum(mine)
                if i % lanes() == 0:
                    k = wp.static(sprockets) * STRIDE + s * warps + i // lanes()
                    put(k, get(k) + wp.float64(total))

    @wp.func
    def moment_on(s: int, n: int):
        """Sum of the moments on sprocket `s` [N m], warp by warp; after the second barrier."""
        warps = wp.static(threads) // lanes()
        total = wp.float64(0.0)
        for w in range((n - 1) // lanes() + 1):
            total = total + get(wp.static(sprockets) * STRIDE + s * warps + w)
        return total

    @wp.func
    def evaluate(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        variant: int,
        own: State,
        other: State,
        held: int,
        i: int,
        stage: int,
        weight: Real,
    ):
        """Link and contact forces on roller i, the next roller's state being `other`; all threads together.

        `held` are the sprockets it was engaged with, as bits; v0 is kept at `stage` 0 only. Contacts are added to
        `tallies` where `weight` [s] is not zero. Returns the forces, and what it is engaged with now.
        """
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        n = drive.rollers
        out = Forces()
        tension, rate, link = link_of(own, other, chain)
        out.tension = tension
        out.rate = rate
        out.link = link
        clear_moments(i, drive.sprockets)
        v = vec2(own[2], own[3])
        mask = int(0)
        if i < n:
            mask = bands(own, drive.sprockets)
        left = held & ~mask
        while left != 0:
            memory = drive.first_contact + lowest_bit(left) * n + i
            state.seat[memory] = -1
            state.impact_speed[memory] = Real(0.0)
            left = left & (left - 1)
        todo = mask
        while any_lane(todo) != 0:
            moment = Real(0.0)
            on = int(-1)
            if todo != 0:
                s = lowest_bit(todo)
                todo = todo & (todo - 1)
                memory = drive.first_contact + s * n + i
                at = s * STRIDE
                sprocket = ensemble.sprockets[drive.first_sprocket + s]
                cosine = get(at + COSINE)
                sine = get(at + SINE)
                p = place(own, vec2d(get(at + CENTER_X), get(at + CENTER_Y)))
                seat = state.seat[memory]
                kept = seat
                if seat < 0:
                    seat = nearest_seat(p, cosine, sine, sprocket.teeth)
                before = state.impact_speed[memory]
                f, size, now, first, dissipated, energy = sprocket_contact(
                    p, v, Real(get(at + SPEED)), cosine, sine, seat, before, sprocket, ensemble.seats
                )
                if now != kept:
                    state.seat[memory] = now
                if first != before and stage == 0:
                    state.impact_speed[memory] = first
                if first != Real(0.0):
                    out.contact = out.contact + f
                    out.sprocket_force = out.sprocket_force + size
                    out.energy = out.energy + energy
                    moment = Real(p[1]) * f[0] - Real(p[0]) * f[1]
                    on = s
                    if weight != Real(0.0):
                        tally_contact(tallies, memory, weight, size, dissipated, int(before == Real(0.0)))
            add_moment(moment, on, i, drive.sprockets)
        if i < n:
            memory = drive.first_contact + drive.sprockets * n + i
            for g in range(drive.guides):
                bar = ensemble.guides[drive.first_guide + g]
                before = state.impact_speed[memory]
                f, size, first, dissipated, energy = guide_contact(place(own, bar.start), v, before, bar)
                if first != before and stage == 0:
                    state.impact_speed[memory] = first
                if first != Real(0.0):
                    out.contact = out.contact + f
                    out.guide_force = out.guide_force + size
                    out.energy = out.energy + energy
                    if weight != Real(0.0):
                        tally_contact(tallies, memory, weight, size, dissipated, int(before == Real(0.0)))
                memory = memory + n
        return out, mask

    @wp.func
    def move(own: State, dx: Real, dy: Real):
        """The state moved by (dx, dy) [m]; what float32 rounds off goes to the low parts (fast two-sum)."""
        if wp.static(compensated):
            low_x = own[4] + dx
            low_y = own[5] + dy
            x = own[0] + low_x
            y = own[1] + low_y
            own[4] = low_x - (x - own[0])
            own[5] = low_y - (y - own[1])
            own[0] = x
            own[1] = y
        else:
            own[0] = own[0] + dx
            own[1] = own[1] + dy
        return own

    return SimpleNamespace(
        State=State,
        Forces=Forces,
        state_of_next=state_of_next,
        force_of_previous=force_of_previous,
        get=get,
        put=put,
        slate_put=talk.slate_put,
        evaluate=evaluate,
        moment_on=moment_on,
        move=move,
    )
