"""Couplings of one variant on the CPU: their bodies, states and moments."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.train import coupling_moment, coupling_state, coupling_twist
from ..structs import Drive, types
from .body_states import body_state_functions


@dataclass(frozen=True)
class CouplingFunctions:
    """CPU coupling functions (`physics.train`)."""

    twist_and_moment: wp.Function
    twist_and_moment_now: wp.Function
    update_couplings: wp.Function


@cache
def coupling_functions(Real: type) -> CouplingFunctions:
    """CPU coupling functions."""
    kinds = types(Real)
    Ensemble, State, Coupling = kinds.Ensemble, kinds.State, kinds.Coupling
    body_states = body_state_functions(Real)

    @wp.func
    def coupled_bodies(state: State, drive: Drive, coupling: Coupling):
        """States of both bodies of a coupling; the first is any where it is the ground."""
        first = state.bodies[drive.first_body + wp.max(coupling.first, 0)]
        return first, state.bodies[drive.first_body + coupling.second]

    @wp.func
    def twist_and_moment(ensemble: Ensemble, state: State, drive: Drive, c: int):
        """Twist [rad] of coupling `c` of all, and moment [N m] that it takes from its first body."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        first, second = coupled_bodies(state, drive, coupling)
        twist, rate = coupling_twist(first, second, coupling, engaged)
        return twist, coupling_moment(twist, rate, coupling, engaged)

    @wp.func
    def twist_and_moment_now(ensemble: Ensemble, state: State, drive: Drive, c: int, time: wp.float64, lag: wp.float64):
        """Twist [rad], rate [rad/s] and moment [N m] of coupling `c` of all with the rates of `time`."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        first = body_states.body_now(ensemble, state, drive.first_body + wp.max(coupling.first, 0), time, lag)
        second = body_states.body_now(ensemble, state, drive.first_body + coupling.second, time, lag)
        twist, rate = coupling_twist(first, second, coupling, engaged)
        return twist, rate, coupling_moment(twist, rate, coupling, engaged)

    @wp.func
    def update_couplings(ensemble: Ensemble, state: State, drive: Drive, time: wp.float64):
        """Updates states of all couplings at a step's start."""
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            coupling = ensemble.couplings[c]
            first, second = coupled_bodies(state, drive, coupling)
            tables = ensemble.tables
            state.couplings[c] = coupling_state(time, first, second, state.couplings[c], coupling, tables)

    return CouplingFunctions(
        twist_and_moment=twist_and_moment,
        twist_and_moment_now=twist_and_moment_now,
        update_couplings=update_couplings,
    )
