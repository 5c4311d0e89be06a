"""Contacts of a block with teeth and guides alike: their law and friction, the v0 that they keep, their sums."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..native import row_access
from ..number import difference, leading
from ..physics.contact import (
    UNTOUCHED,
    contact_energy,
    dissipated_power,
    even_friction_force,
    friction_force,
    normal_force_vector,
    reaction_moment,
    relative_acceleration,
)
from ..structs import GROUND, Tallies
from .kind import BY_SPEED, ENDS, EXTRA, START, WARP, BlockKind, Mine
from .near import near_mask
from .rings import block_rings
from .rollers import roller_rows
from .shared_memory import parts_of_a_body
from .sync import add_to, group, lanes, raise_to, sync, widened


@cache
def contact_sums(kind: BlockKind) -> SimpleNamespace:
    """The functions that contacts with teeth and with guides call."""
    Real, staged, sliding, sprockets = kind.Real, kind.staged, kind.friction.contacts, kind.parts.sprockets
    kinds, Now = kind.types, kind.types.Now
    State, Shared, Friction = kinds.State, kinds.Shared, kinds.Friction
    vec2, Bits, Direction = kinds.vec2, near_mask(kind).Bits, kinds.Ensemble.vars["seats"].type.dtype
    row, load_row, store_row = roller_rows(kind), row_access(Real).load, row_access(Real).store
    Pose, memory_of, chain_at = kinds.Pose, block_rings(kind).memory_of, block_rings(kind).chain_at

    @wp.struct
    class Touch:
        """The partners that a thread's rollers are near (`update_near`), and one's contact with the partner at hand."""

        near: Bits
        partner: wp.int32  # sprockets first, then guides
        seat: wp.int32  # in a sprocket, negative where it has none yet
        direction: Direction  # of the seat at angle zero
        before: Real  # v0 [m/s], or whether it touched
        held: Real  # friction that the contact has held until now, of kernels with friction [N]
        damper_speed: Real  # speed at which its damper acted in the step before [m/s]
        penetration: Real  # [m], negative where they do not touch yet
        normal: vec2
        relative: vec2  # velocity [m/s]
        gaining: vec2  # acceleration of that velocity without this contact [m/s^2]

    @wp.func
    def placed(touch: Touch, penetration: Real, normal: vec2, relative: vec2):
        """`touch` with the penetration [m], normal and relative velocity [m/s] of the contact at hand."""
        touch.penetration = penetration
        touch.normal = normal
        touch.relative = relative
        return touch

    @wp.func
    def gaining(shared: Shared, body: Pose, arm: vec2, j: int):
        """Acceleration [m/s^2] of the velocity of a body's point, `arm` from its center, less roller j's so far."""
        straight = vec2()
        if wp.static(kind.moving):
            straight = body.straight
        return relative_acceleration(straight, body.angular, arm, row.acceleration(shared, j))

    @wp.func
    def remembering(state: State, touch: Touch, at: int):
        """`touch` with what the contact at `at` has kept; loaded at once, as each load is waited for."""
        touch.before = load_row(state.impact_speed, at)
        touch.damper_speed = load_row(state.damper_speed, at)
        if wp.static(sliding):
            touch.held = load_row(state.contact_hold, at)
        return touch

    @wp.func
    def drag_of(now: Now, size: Real, normal: vec2, relative: vec2, touch: Touch, what: Friction):
        """Friction on a roller [N], as `friction_force`, and what the contact then holds."""
        held = wp.where(touch.before > Real(0.0), touch.held, Real(0.0))
        stretched = row.stretched(now)
        if wp.static(sliding == BY_SPEED):
            return friction_force(size, normal, relative, held, what, stretched)
        else:
            return even_friction_force(size, normal, relative, held, what, stretched)

    @wp.func
    def as_known(law: Any):
        """A contact law with what is known of it when the kernel is made."""
        if wp.static(not staged):
            law.most_damping = Real(0.0)
        if wp.static(kind.linear_hysteretic):
            law.form = 0
            law.exponent = Real(1.0)
        return law

    @wp.func
    def lag(mine: Mine):
        """Time that velocities are behind the forces [s]."""
        if wp.static(staged):
            return Real(0.0)
        else:
            return Real(0.5) * row.step_of(mine)

    @wp.func
    def taking(force: vec2, damper: Real, normal: vec2):
        """The force whose power is taken from motion: a contact's, with stages the part of it that damps [N]."""
        if wp.static(staged):
            return damper * normal
        else:
            return force

    @wp.func
    def powers(mine: Mine, force: vec2, drag: vec2, relative: vec2, more: vec2):
        """Powers [W] that a closed contact's force and friction take; `more` is `gaining` with all forces [m/s^2]."""
        return dissipated_power(force, relative, more, lag(mine)), dissipated_power(drag, relative, more, lag(mine))

    @wp.func
    def in_full(value: Real):
        """A value as the sums of contacts have it."""
        if wp.static(kind.paired):
            return widened(value)
        else:
            return value

    @wp.func
    def measure_powers(tallies: Tallies, now: Now, at: int, damped: Real, rubbed: Real):
        """Adds the powers [W] that a closed contact's force and friction take to its sums."""
        add_to(tallies.dissipated, at, in_full(now.weight * damped))
        if wp.static(sliding):
            add_to(tallies.friction, at, in_full(now.weight * rubbed))

    @wp.func
    def measure_force(tallies: Tallies, now: Now, at: int, before: Real, size: Real, passing: bool):
        """Adds a closed contact's force [N] to its sums, and counts it at its first instant.

        Rollers pass sprockets, where first touches count.
        """
        add_to(tallies.impulse, at, in_full(now.weight * size))
        raise_to(tallies.force_max, at, in_full(size))
        if before <= Real(0.0):
            add_to(tallies.impacts, at, 1)
            if passing and before == Real(UNTOUCHED):
                add_to(tallies.contacts, at, 1)

    @wp.func
    def keep(state: State, now: Now, at: int, before: Real, kept: Real):
        """Stores v0 of a contact while it is closed, at a step's start only, not at its other stages."""
        if before != kept and now.stage == 0:
            store_row(state.impact_speed, at, kept)

    @wp.func
    def measure_energy(tallies: Tallies, now: Now, at: int, energy: Real):
        """Takes what a contact stores at the window's end, and not at its start, from what it has taken."""
        if wp.static(kind.measuring and not staged) and now.flags & ENDS != 0:
            add_to(tallies.dissipated, at, in_full(wp.where(now.flags & START != 0, energy, -energy)))

    @wp.func
    def remember(state: State, now: Now, at: int, answer: Real, damper_speed: Real):
        """Stores the speed at which a closed contact's damper acts [m/s], where its body's `answer` wants that."""
        if answer > Real(0.0) and now.stage == 0:
            store_row(state.damper_speed, at, damper_speed)

    @wp.func
    def press(
        state: State,
        tallies: Tallies,
        shared: Shared,
        mine: Mine,
        now: Now,
        j: int,
        touch: Touch,
        law: kinds.ContactLaw,
    ):
        """Adds the force of roller j's contact at hand to the roller's; returns whether it is closed, and that [N]."""
        p, before, normal, relative, more = touch.partner, touch.before, touch.normal, touch.relative, touch.gaining
        at = memory_of(shared, mine, j, p)
        known = as_known(law)
        pushes, mean, elastic, size, first, damper_speed = normal_force_vector(
            touch.penetration, normal, relative, more, before, touch.damper_speed, known
        )
        force = pushes
        closed = mean > Real(0.0)
        if closed:
            if now.flags & EXTRA != 0:  # at once, so that the energy is worked out only here
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + contact_energy(mean, elastic, known)
                if p < wp.static(sprockets):
                    state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + size
                else:
                    state.extra[extra].guide_force = state.extra[extra].guide_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag, holds = drag_of(now, size, normal, relative, touch, shared.friction[p])
                force = force + drag
                if now.stage == 0:
                    store_row(state.contact_hold, at, holds)
            row.set_force(shared, j, row.force_on(shared, j) + force)
            keep(state, now, at, before, first)
            remember(state, now, at, law.answer, damper_speed)
            if wp.static(kind.measuring) and now.measured != 0:
                after = more - chain_at(shared, j).inverse_mass * force
                taken, rubbed = powers(mine, taking(pushes, size - elastic, normal), drag, relative, after)
                measure_powers(tallies, now, at, taken, rubbed)
                measure_energy(tallies, now, at, contact_energy(mean, elastic, known))
                measure_force(tallies, now, at, before, size, p < wp.static(sprockets))
        return closed, force

    return SimpleNamespace(**locals())


@cache
def wrench_parts(kind: BlockKind) -> SimpleNamespace:
    """The functions that add up what the rollers of one variant on a block do to its bodies."""
    Real, threads, bodies, moving = kind.Real, kind.shape.threads, kind.parts.bodies, kind.moving
    kinds, Now = kind.types, kind.types.Now
    Shared = kinds.Shared
    vec2, of_three = kinds.vec2, wp.types.vector(3, Real)
    group_sum, sum_of_lanes = sync(kind).group_sum, sync(kind).sum_of_lanes
    load_row, store_row = row_access(Real).load, row_access(Real).store
    width = parts_of_a_body(kind)
    of_rollers = width != threads

    @wp.func
    def pushed(measured: int):
        """Whether the force on sprockets is wanted beside the moment."""
        if wp.static(moving):
            return True
        else:
            return wp.static(kind.measuring) and measured != 0

    @wp.func
    def place_of(mine: Mine, k: int, s: int, j: int):
        """Where roller j's part of body s, or its thread's, lies in row k: of moments, forces in x, forces in y."""
        first = (wp.static(bodies) * k + s) * wp.static(width)
        if wp.static(of_rollers):
            return first + j
        else:
            return first + mine.thread

    @wp.func
    def add_part(shared: Shared, at: int, value: Real):
        """Adds `value` to the part at `at`."""
        store_row(shared.parts, at, load_row(shared.parts, at) + value)

    @wp.func
    def add_moment(shared: Shared, mine: Mine, s: int, j: int, moment: Real):
        """Adds the moment [N m] of roller j's force to body s."""
        add_part(shared, place_of(mine, 0, s, j), moment)

    @wp.func
    def add_push(shared: Shared, mine: Mine, s: int, j: int, force: vec2):
        """Adds the opposite of roller j's force [N] to body s."""
        add_part(shared, place_of(mine, 1, s, j), -force[0])
        add_part(shared, place_of(mine, 2, s, j), -force[1])

    @wp.func
    def add_wrench(shared: Shared, mine: Mine, s: int, j: int, moment: Real, force: vec2, measured: int):
        """Adds the moment [N m] and, if that is wanted, the opposite of roller j's force [N] to body s."""
        add_moment(shared, mine, s, j, moment)
        if pushed(measured):
            add_push(shared, mine, s, j, force)

    @wp.func
    def pass_on(shared: Shared, mine: Mine, now: Now, s: int, j: int, force: vec2):
        """Adds what roller j's force does to the arm that carries sprocket s, where one does."""
        if wp.static(kind.parts.hubs > 0):
            arm = shared.hubs[s].arm
            if arm != GROUND:
                lever = leading(difference(shared.poses[s].center, shared.poses[arm].center))
                add_wrench(shared, mine, arm, j, reaction_moment(lever, force), force, now.measured)

    @wp.func
    def part(shared: Shared, s: int, k: int, i: int):
        """This thread's share of the sum of all parts of body s, if there is one, in row k; they start anew at zero.

        What is no body reads another's: so no thread waits for one that takes a branch.
        """
        value = Real(0.0)
        first = (wp.static(bodies) * k + wp.min(s, wp.static(bodies - 1))) * wp.static(width) + i % group()
        for q in range(lanes() // group()):
            of_lane = Real(0.0)
            for w in range(wp.static(width) // lanes()):
                of_lane = of_lane + load_row(shared.parts, first + w * lanes() + q * group())
            value = value + of_lane
        if lanes() == 1:
            value = sum_of_lanes(shared.parts, first, wp.static(width))
        if s < wp.static(bodies):
            for w in range(wp.static(width) // group()):
                store_row(shared.parts, first + w * group(), Real(0.0))
        return value

    @wp.func
    def crew():
        """Warps that move bodies: all, the last of which have the fewest rollers, or only the last, which has none."""
        if wp.static(kind.shape.body_warp and bodies <= 4):
            if lanes() > 1:
                return int(1)
        return wp.static(threads) // lanes()

    @wp.func
    def first_of(i: int):
        """The first body of thread i's warp, one that there is not where it has none."""
        if wp.static(threads == WARP):
            if lanes() > 1:
                return int(0)
        place = wp.static(threads) // lanes() - 1 - i // lanes()
        return wp.where(place < crew(), place, wp.static(bodies))

    @wp.func
    def body_of(i: int):
        """The body that thread i moves, negative for most: each group of threads has one, if they are few."""
        s = first_of(i) + crew() * (i % lanes() // group() + lanes() // group() * (i % group()))
        return wp.where(s < wp.static(bodies), s, -1)

    @wp.func
    def sum_of(shared: Shared, k: int, i: int):
        """Row k of what acts on the body that thread i moves: moment [N m], force in x, in y [N].

        All threads together, between the barrier after the contacts and the next one.
        """
        acting = Real(0.0)
        turn = int(0)
        first = first_of(i)
        while first < wp.static(bodies):
            value = group_sum(part(shared, first + crew() * (i % lanes() // group()), k, i))
            if i % group() == turn:
                acting = value
            turn = turn + 1
            first = first + crew() * (lanes() // group())
        return acting

    @wp.func
    def moment_on(shared: Shared, i: int):
        """The chain's moment on the body that thread i moves [N m]; all threads together, as `sum_of`."""
        return sum_of(shared, 0, i)

    @wp.func
    def acting_on(shared: Shared, i: int, moment: Real, measured: int):
        """That moment and, if it is wanted, the chain's force (x, y) [N]; all threads together, as `sum_of`."""
        acting = of_three()
        acting[0] = moment
        if pushed(measured):
            acting[1] = sum_of(shared, 1, i)
            acting[2] = sum_of(shared, 2, i)
        return acting

    @wp.func
    def wrench_of(acting: of_three):
        """The wrench that `acting_on` returns as a vector; with the force where bodies move."""
        wrench = kinds.Wrench()
        wrench.moment = acting[0]
        if wp.static(moving):
            wrench.force = vec2(acting[1], acting[2])
        return wrench

    return SimpleNamespace(**locals())
