"""Hubs on a block: friction in sprockets' bearings, and sprockets that arms carry."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..number import difference, leading_value, rounded_value
from ..physics.hub import bearing_moment
from ..structs import GROUND
from ..sums import add_bearing
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .body_states import body_state_functions
from .rollers import roller_functions
from .sync import sync_functions


@dataclass(frozen=True)
class HubFunctions:
    """Hub functions of a block (`physics.hub`)."""

    add_bearing_moments: wp.Function
    end_hub_step: wp.Function


@cache
def hub_functions(kind: BlockKind) -> HubFunctions:
    """Hub functions of block kernels; they do nothing without hubs."""
    Real, sprockets = kind.Real, kind.parts.sprockets
    kinds, Now = kind.types, kind.types.Now
    Ensemble, State, Shared, Wrench = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Wrench
    rollers = roller_functions(kind)
    sync = sync_functions(kind)
    body_states = body_state_functions(kind)

    @wp.func
    def add_bearing_moments(
        ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, now: Now, wrench: Wrench
    ):
        """Wrench on the thread's body with its bearings' moment; all threads together."""
        if wp.static(kind.parts.hubs):
            s = mine.body
            if s >= 0 and s < sprockets:
                hub = shared.hubs[s]
                at = ensemble.drives[mine.variant].first_sprocket + s
                turning = leading_value(shared.poses[s].speed)
                if hub.arm != GROUND:
                    turning = rounded_value(difference(shared.poses[s].speed, shared.poses[hub.arm].speed))
                stretched = rollers.stretch_part(now)
                moment, holds = bearing_moment(wrench.force, turning, Real(state.hub_hold[at]), hub, stretched)
                shared.bearing_moments[s] = moment
                if now.stage == 0:
                    state.hub_hold[at] = wp.float64(holds)
            sync.barrier()
            wrench.bearing = bearing_moment_on_body(shared, mine)
        return wrench

    @wp.func
    def bearing_moment_on_body(shared: Shared, mine: ThreadParts):
        """Moment [N m] of bearings on the thread's body; on an arm, of all sprockets that it carries."""
        moment = Real(0.0)
        for s in range(sprockets):
            if s == mine.body:
                moment = moment + shared.bearing_moments[s]
            if shared.hubs[s].arm == mine.body and mine.body >= 0:
                moment = moment - shared.bearing_moments[s]
        return moment

    @wp.func
    def end_hub_step(shared: Shared, mine: ThreadParts, now: Now):
        """Adds the loss of the thread's sprocket's bearing, and moves that sprocket with its arm.

        All threads together, once all bodies have moved.
        """
        if wp.static(kind.parts.hubs):
            sync.barrier()
            s = mine.sprocket
            if wp.static(kind.measuring):
                if s >= 0 and now.measures != 0:
                    turning = shared.speeds_now[s]
                    if shared.hubs[s].arm != GROUND:
                        turning = turning - shared.speeds_now[shared.hubs[s].arm]
                    power = -shared.bearing_moments[s] * turning
                    shared.mount_sums[s] = add_bearing(shared.mount_sums[s], power, now.weight)
            if now.goes_on != 0:
                body_states.place_carried_sprocket(shared, s)

    return HubFunctions(
        add_bearing_moments=add_bearing_moments,
        end_hub_step=end_hub_step,
    )
