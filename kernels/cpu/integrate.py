"""Forces of one variant at one instant, and the two integrators.

Leapfrog: v(n + 1/2) = v(n - 1/2) + h a(n), x(n + 1) = x(n) + h v(n + 1/2), the first kick being half a step; damping
reads v(n - 1/2). rk4 is the classical scheme; contacts keep their memory from step starts only.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..physics.body import bodies
from ..rows import accessors
from ..structs import Drive, types
from ..trigonometry import sine_cosine
from .rollers import passes, rows


@cache
def stepping(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that evaluate and advance one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    part = passes(Real, capacity)
    load, store = accessors(Real).load, accessors(Real).store
    leapfrog_sprocket, rk4_sprocket = bodies(Real).leapfrog_sprocket, bodies(Real).rk4_sprocket
    at = rows(capacity)
    X, Y, VX, VY, X_LOW, Y_LOW = at.x, at.y, at.vx, at.vy, at.x_low, at.y_low
    X0_LOW, Y0_LOW, move = at.x0_low, at.y0_low, part.move
    X0, Y0, VX0, VY0, SUM_X, SUM_Y, SUM_VX, SUM_VY = (
        at.x0,
        at.y0,
        at.vx0,
        at.vy0,
        at.sum_x,
        at.sum_y,
        at.sum_vx,
        at.sum_vy,
    )

    # the functions below see these as their own
    link_pass, sprocket_pass, guide_pass = part.link_pass, part.sprocket_pass, part.guide_pass
    acceleration, kick_drift = part.acceleration, part.kick_drift

    @wp.func
    def evaluate(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        stage: int,
    ):
        """Forces on all rollers and sprockets for the state in the scratch and in `state.sprockets`."""
        n = drive.rollers
        link_pass(w, n, chain)
        partner = drive.first_sprocket + drive.first_guide
        memory = drive.first_contact
        for s in range(drive.sprockets):
            body = state.sprockets[drive.first_sprocket + s]
            sprocket = ensemble.sprockets[drive.first_sprocket + s]
            sine, cosine = sine_cosine(body.angle)
            state.totals[partner] = sprocket_pass(
                w,
                n,
                sprocket,
                body,
                cosine,
                sine,
                ensemble.seats,
                state.seat,
                state.impact_speed,
                memory,
                stage,
            )
            partner += 1
            memory += n
        for g in range(drive.guides):
            bar = ensemble.guides[drive.first_guide + g]
            state.totals[partner] = guide_pass(w, n, bar, state.impact_speed, memory, stage)
            partner += 1
            memory += n

    @wp.func
    def leapfrog(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        time: wp.float64,
        kick: wp.float64,
    ):
        """One step from evaluated forces; `kick` is h, or h / 2 from the initial state."""
        h = drive.step
        for s in range(drive.sprockets):
            leapfrog_sprocket(ensemble, state, drive, s, time, kick)
        kick_drift(w, drive.rollers, chain, Real(kick), Real(h))

    @wp.func
    def rk4_rollers(w: wp.array(dtype=Real), n: int, chain: kinds.Chain, stage: int, weight: Real, reach: Real):
        """Adds this stage's slopes to the sums with `weight`, and goes `reach` along them from the step's start."""
        inverse_mass = chain.inverse_mass
        i = int(0)
        while i < n:
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load(w, VX + i)
            vy = load(w, VY + i)
            if stage == 0:
                store(w, X0 + i, load(w, X + i))
                store(w, Y0 + i, load(w, Y + i))
                store(w, X0_LOW + i, load(w, X_LOW + i))
                store(w, Y0_LOW + i, load(w, Y_LOW + i))
                store(w, VX0 + i, vx)
                store(w, VY0 + i, vy)
                store(w, SUM_X + i, Real(0.0))
                store(w, SUM_Y + i, Real(0.0))
                store(w, SUM_VX + i, Real(0.0))
                store(w, SUM_VY + i, Real(0.0))
            store(w, SUM_X + i, load(w, SUM_X + i) + weight * vx)
            store(w, SUM_Y + i, load(w, SUM_Y + i) + weight * vy)
            store(w, SUM_VX + i, load(w, SUM_VX + i) + weight * a[0])
            store(w, SUM_VY + i, load(w, SUM_VY + i) + weight * a[1])
            store(w, X + i, load(w, X0 + i))
            store(w, Y + i, load(w, Y0 + i))
            store(w, X_LOW + i, load(w, X0_LOW + i))
            store(w, Y_LOW + i, load(w, Y0_LOW + i))
            if stage == 3:
                move(w, i, load(w, SUM_X + i), load(w, SUM_Y + i))
                store(w, VX + i, load(w, VX0 + i) + load(w, SUM_VX + i))
                store(w, VY + i, load(w, VY0 + i) + load(w, SUM_VY + i))
            else:
                move(w, i, reach * vx, reach * vy)
                store(w, VX + i, load(w, VX0 + i) + reach * a[0])
                store(w, VY + i, load(w, VY0 + i) + reach * a[1])
            i = i + 1

    @wp.func
    def rk4(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array(dtype=Real),
        step_time: wp.float64,
        stage: int,
    ):
        """One of the four stages of the classical scheme, from evaluated forces; the fourth ends the step."""
        h = drive.step
        weight = wp.where(stage == 1 or stage == 2, h / wp.float64(3.0), h / wp.float64(6.0))
        reach = wp.where(stage < 2, wp.float64(0.5) * h, h)
        for s in range(drive.sprockets):
            rk4_sprocket(ensemble, state, drive, s, step_time, stage)
        rk4_rollers(w, drive.rollers, chain, stage, Real(weight), Real(reach))

    return SimpleNamespace(**{name: value for name, value in locals().items() if isinstance(value, wp.Function)})
