"""The contacts of a block's rollers with the teeth of sprockets: forces, their reactions, and what is added up."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..fast_math import products
from ..namespace import namespace
from ..physics.contact import after_teeth, reaction, respond, sized
from ..physics.impact import is_linear_hysteretic, linear_force
from ..rows import accessors
from ..structs import types
from ..sum_structs import Tallies
from .contact_sums import contact_sums
from .events import EXTRA
from .geometry import contact_geometry
from .kind import BlockKind, Mine, now_struct
from .roller_rows import roller_rows
from .tooth_gaps import tooth_gaps
from .wrench import wrench_parts


@cache
def tooth_contacts(kind: BlockKind) -> SimpleNamespace:
    """The functions that evaluate a roller's contact with a sprocket of one variant on a block."""
    Real, sprockets, moving, sliding = kind.Real, kind.sprockets, kind.moving, kind.contact_friction
    kinds, Now, gripping = types(Real), now_struct(Real), kind.gripping
    vec2 = kinds.vec2
    row, wrenches, sums, gaps = roller_rows(kind), wrench_parts(kind), contact_sums(kind), tooth_gaps(kind)
    add_moment, add_push, add_wrench = wrenches.add_moment, wrenches.add_push, wrenches.add_wrench
    drag_of, as_known, powers, put = sums.drag_of, sums.as_known, sums.powers, sums.put
    measure_powers, measure_force = sums.measure_powers, sums.measure_force
    Grip, seat_at, in_gap_of, teeth_of = gaps.Grip, gaps.seat_at, gaps.in_gap_of, contact_geometry(kind).teeth_of
    in_straight_flank_gap = gaps.in_straight_flank_gap
    force_on, set_force = row.force_on, row.set_force
    load_row, load_whole = accessors(Real).load_row, accessors(wp.int32).load_row

    @wp.func
    def is_summed(now: Now, s: int):
        """Whether the moment on sprocket s is wanted: with metrics all are."""
        if wp.static(kind.measuring):
            return True
        else:
            return (now.summed >> s) & 1 != 0

    @wp.func
    def at_sprocket(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        grip: Grip,
    ):
        """Adds the force of the teeth of a sprocket to roller j's, and its reaction to the sprocket if it is summed."""
        s = grip.sprocket
        at = mine.memory + j + s * mine.rollers
        before = Real(grip.before)
        if wp.static(not gripping):
            before = load_row(state.impact_speed, at)
        penetration, normal, relative, arm = in_gap_of(ensemble, state, shared, at, j, s, grip)
        if penetration > Real(0.0):
            law = as_known(teeth_of(shared, s).law)
            force, size, first, damper, energy = respond(penetration, normal, relative, before, law)
            if now.flags & EXTRA != 0:  # at once, so that the energy is worked out only here
                extra = mine.first + j
                state.extra[extra].energy = state.extra[extra].energy + energy
                state.extra[extra].sprocket_force = state.extra[extra].sprocket_force + size
            drag = vec2(Real(0.0), Real(0.0))
            if wp.static(sliding):
                drag = drag_of(size, normal, relative, shared.sliding[s])
                force = force + drag
            whole = force_on(shared, j) + force
            set_force(shared, j, whole)
            put(state, now, at, before, first)
            if now.measured != 0:
                damped, rubbed = powers(shared, mine, whole, damper * normal, drag, relative)
                measure_powers(tallies, now, at, damped, rubbed)
                measure_force(tallies, now, at, before, size, True)
            if is_summed(now, s):
                add_wrench(shared, mine, s, j, reaction(arm, force), force, now.watched)
        else:
            put(state, now, at, before, after_teeth(before))

    @wp.func
    def linear_hysteretic_laws(shared: kinds.Shared):
        """The sprockets whose contacts are linear and hysteretic, as bits, unless all contacts are."""
        mask = int(0)
        if wp.static(not kind.linear_hysteretic):
            for s in range(wp.static(sprockets)):
                if is_linear_hysteretic(shared.teeth[s].law):
                    mask = mask | (1 << s)
        return mask

    @wp.func
    def is_quick(now: Now, s: int):
        """Whether the law of sprocket s is the usual one; so that no thread asks where all are."""
        if wp.static(kind.linear_hysteretic):
            return True
        else:
            return (now.linear_hysteretic >> s) & 1 != 0

    @wp.struct
    class Answer:
        """What a roller in its tooth gap is answered."""

        applies: wp.int32  # 1 where all is as usual, else nothing holds
        closed: wp.int32  # whether they touch
        at: wp.int32  # where its memory is
        before: Real  # v0, as it was kept [m/s]
        first: Real  # v0 [m/s]
        moment: Real  # on the sprocket [N m]
        force: vec2  # on the roller [N]
        size: Real  # of it without friction [N], for metrics as what follows
        damper: vec2  # its part that dissipates [N]
        drag: vec2  # friction [N]
        relative: vec2  # velocity of the sprocket less the roller's [m/s]

    @wp.func
    def answer_of(ensemble: kinds.Ensemble, state: kinds.State, shared: kinds.Shared, mine: Mine, j: int, grip: Grip):
        """What a sprocket answers roller j if all is as usual, without a branch."""
        s = grip.sprocket
        answer = Answer()
        answer.at = mine.memory + j + s * mine.rollers
        seat = int(grip.seat)
        answer.before = grip.before
        direction = grip.direction
        teeth = teeth_of(shared, s)
        if wp.static(not gripping):
            seat = load_whole(state.seat, answer.at)
            answer.before = load_row(state.impact_speed, answer.at)
            direction = seat_at(ensemble, teeth.first_seat + wp.max(seat, 0))
        penetration, normal, relative, arm, applies = in_straight_flank_gap(shared, teeth, j, s, direction)
        speed = products(relative[0], normal[0], relative[1], normal[1])
        size, first = linear_force(penetration, speed, answer.before, teeth.law)
        answer.first = first
        answer.force = sized(normal, size)
        if wp.static(sliding):
            drag = drag_of(size, normal, relative, shared.sliding[s])
            answer.force = answer.force + drag
            answer.drag = drag
        if wp.static(kind.measuring):
            answer.size = size
            answer.damper = (size - teeth.law.stiffness * penetration) * normal
            answer.relative = relative
        answer.moment = reaction(arm, answer.force)
        answer.closed = int(penetration > Real(0.0))
        answer.applies = wp.where(seat < 0, 0, applies)
        return answer

    @wp.func
    def add_answer(state: kinds.State, shared: kinds.Shared, now: Now, j: int, answer: Answer):
        """Adds a contact's force, if it is closed, to roller j's, which is returned [N]; keeps what it is to keep."""
        zero = Real(0.0)
        force = force_on(shared, j) + wp.where(answer.closed != 0, answer.force, vec2(zero, zero))
        set_force(shared, j, force)
        kept = wp.where(answer.closed != 0, answer.first, after_teeth(answer.before))
        put(state, now, answer.at, answer.before, kept)
        return force

    @wp.func
    def answered(
        state: kinds.State,
        tallies: Tallies,
        shared: kinds.Shared,
        mine: Mine,
        now: Now,
        j: int,
        s: int,
        answer: Answer,
    ):
        """Does what sprocket s answers roller j, with few branches: at each a warp's threads part."""
        wanted = answer.closed != 0 and is_summed(now, s)
        add_moment(shared, mine, s, j, wp.where(wanted, answer.moment, Real(0.0)))
        if wp.static(moving):
            if answer.closed != 0:
                add_push(shared, mine, s, j, answer.force)
        force = add_answer(state, shared, now, j, answer)
        if wp.static(kind.measuring) and now.measured != 0:
            damped, rubbed = powers(shared, mine, force, answer.damper, answer.drag, answer.relative)
            if answer.closed != 0:
                measure_powers(tallies, now, answer.at, damped, rubbed)
            if answer.closed != 0 and (now.watched != 0 or answer.before <= Real(0.0)):
                measure_force(tallies, now, answer.at, answer.before, answer.size, True)
                if wp.static(not moving) and now.watched != 0:
                    add_push(shared, mine, s, j, answer.force)

    return namespace(at_sprocket, linear_hysteretic_laws, is_quick, Answer, answer_of, answered)
