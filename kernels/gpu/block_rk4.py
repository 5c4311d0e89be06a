"""The classical Runge-Kutta scheme on blocks of threads: one of its four stages, for a roller and for a sprocket.

The step's start and the sums of slopes lie in the state; what is shared always stands where the next stage looks.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..physics.body import angular_acceleration, body_accelerations, heading_of, rk4_center, rk4_turn
from ..rows import accessors
from ..structs import SprocketState, types
from ..sum_structs import Totals
from .block_rows import block_rows

STAGE_ROWS = 10
"""Values that a roller keeps over the stages of a step: x, y, vx, vy, low x, low y, and sums for x, y, vx, vy."""


@cache
def block_rk4(
    Real: type, threads: int, per: int, sprockets: int, guides: int, moving: bool, measuring: bool
) -> SimpleNamespace:
    """The functions that take one variant through a stage on a block of `threads` threads."""
    kinds = types(Real)
    vec2 = kinds.vec2
    row = block_rows(Real, threads, per, sprockets, guides, moving, measuring)
    X, Y, X_LOW, Y_LOW = row.X, row.Y, row.X_LOW, row.Y_LOW
    acceleration, velocity, set_velocity, move = row.acceleration, row.velocity, row.set_velocity, row.move
    load, store = accessors(Real).load, accessors(Real).store
    compensated = Real == wp.float32

    @wp.func
    def weight_of(stage: int, h: wp.float64):
        """The stage's weight in the sums of slopes [s]."""
        return wp.where(stage == 1 or stage == 2, h / wp.float64(3.0), h / wp.float64(6.0))

    @wp.func
    def reach_of(stage: int, h: wp.float64):
        """How far from the step's start the next stage is [s]."""
        return wp.where(stage < 2, wp.float64(0.5) * h, h)

    @wp.func
    def stage_roller(state: kinds.State, shared: kinds.Shared, first: int, n: int, j: int, stage: int, h: wp.float64):
        """Roller j, evaluated, to where the next stage looks at it; the fourth ends the step."""
        weight = Real(weight_of(stage, h))
        reach = Real(reach_of(stage, h))
        rows = shared.rows
        kept = state.stages
        at = wp.static(STAGE_ROWS) * first + j
        a = acceleration(shared, j)
        v = velocity(rows, j)
        if stage == 0:
            store(kept, at, load(rows, X + j))
            store(kept, at + n, load(rows, Y + j))
            store(kept, at + 2 * n, v[0])
            store(kept, at + 3 * n, v[1])
            if wp.static(compensated):
                store(kept, at + 4 * n, load(rows, X_LOW + j))
                store(kept, at + 5 * n, load(rows, Y_LOW + j))
            for k in range(6, 10):
                store(kept, at + k * n, Real(0.0))
        store(kept, at + 6 * n, load(kept, at + 6 * n) + weight * v[0])
        store(kept, at + 7 * n, load(kept, at + 7 * n) + weight * v[1])
        store(kept, at + 8 * n, load(kept, at + 8 * n) + weight * a[0])
        store(kept, at + 9 * n, load(kept, at + 9 * n) + weight * a[1])
        store(rows, X + j, load(kept, at))
        store(rows, Y + j, load(kept, at + n))
        if wp.static(compensated):
            store(rows, X_LOW + j, load(kept, at + 4 * n))
            store(rows, Y_LOW + j, load(kept, at + 5 * n))
        start = vec2(load(kept, at + 2 * n), load(kept, at + 3 * n))
        if stage == 3:
            set_velocity(shared, j, start + vec2(load(kept, at + 8 * n), load(kept, at + 9 * n)))
            move(shared, j, load(kept, at + 6 * n), load(kept, at + 7 * n))
        else:
            set_velocity(shared, j, start + reach * a)
            move(shared, j, reach * v[0], reach * v[1])

    @wp.func
    def standing(shared: kinds.Shared, s: int):
        """Sprocket s as it is now."""
        wheel = shared.wheels[s]
        body = SprocketState()
        body.angle = wheel.angle
        body.speed = wheel.speed
        body.center = wheel.center
        body.velocity = wheel.velocity
        return body

    @wp.func
    def stage_sprocket(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        shared: kinds.Shared,
        variant: int,
        s: int,
        contacts: Totals,
        step_time: wp.float64,
        stage: int,
        h: wp.float64,
    ):
        """Sprocket s to where the next stage looks at it; the fourth ends the step that begins at `step_time`."""
        mine = ensemble.drives[variant].first_sprocket + s
        weight = weight_of(stage, h)
        reach = reach_of(stage, h)
        time = step_time + wp.where(stage == 0, wp.float64(0.0), wp.where(stage == 3, h, wp.float64(0.5) * h))
        after = step_time + reach
        motion = shared.motions[s]
        body = state.sprockets[mine]
        now = standing(shared, s)
        body.angle = now.angle
        body.speed = now.speed
        body.center = now.center
        body.velocity = now.velocity
        active = int(0)
        if wp.static(moving):
            active = shared.mounts[s].active
        if active != 0:
            if wp.static(moving):
                mount = shared.mounts[s]
                rates = body_accelerations(
                    time, body, heading_of(body), contacts, motion, mount, ensemble.harmonics, ensemble.tables
                )
                turned = rk4_turn(
                    after, weight, reach, stage, body, rates[2], motion, ensemble.harmonics, ensemble.tables
                )
                moved, stages = rk4_center(after, weight, reach, stage, turned, state.centers[mine], rates, mount)
                state.centers[mine] = stages
                state.sprockets[mine] = moved
        else:
            faster = angular_acceleration(time, body, contacts.moment, motion, ensemble.harmonics, ensemble.tables)
            state.sprockets[mine] = rk4_turn(
                after, weight, reach, stage, body, faster, motion, ensemble.harmonics, ensemble.tables
            )
        body = state.sprockets[mine]
        heading = heading_of(body)
        shared.wheels[s].angle = body.angle
        shared.wheels[s].speed = body.speed
        shared.wheels[s].cosine = heading[0]
        shared.wheels[s].sine = heading[1]
        if wp.static(moving):
            shared.wheels[s].center = body.center
            shared.wheels[s].velocity = body.velocity
            shared.bands[s].center = vec2(Real(body.center[0]), Real(body.center[1]))

    return SimpleNamespace(stage_roller=stage_roller, standing=standing, stage_sprocket=stage_sprocket)
