"""Couplings of one variant on the CPU: their bodies, states and moments."""

from typing import Any

import warp as wp

from ..physics.train import coupling_moment, coupling_state, coupling_twist
from ..structs import Drive
from . import body_states


@wp.func
def coupled_bodies(state: Any, drive: Drive, coupling: Any):
    """States of both bodies of a coupling; the first is any where it is the ground."""
    first = state.bodies[drive.first_body + wp.max(coupling.first, 0)]
    return first, state.bodies[drive.first_body + coupling.second]


@wp.func
def twist_and_moment(ensemble: Any, state: Any, drive: Drive, c: int):
    """Twist [rad] of coupling `c` of all, and moment [N m] that it takes from its first body."""
    coupling, engaged = ensemble.couplings[c], state.couplings[c]
    first, second = coupled_bodies(state, drive, coupling)
    twist, rate = coupling_twist(first, second, coupling, engaged)
    return twist, coupling_moment(twist, rate, coupling, engaged)


@wp.func
def twist_and_moment_now(ensemble: Any, state: Any, drive: Drive, c: int, time: wp.float64, lag: wp.float64):
    """Twist [rad], rate [rad/s] and moment [N m] of coupling `c` of all with the rates of `time`."""
    coupling, engaged = ensemble.couplings[c], state.couplings[c]
    first = body_states.body_now(ensemble, state, drive.first_body + wp.max(coupling.first, 0), time, lag)
    second = body_states.body_now(ensemble, state, drive.first_body + coupling.second, time, lag)
    twist, rate = coupling_twist(first, second, coupling, engaged)
    return twist, rate, coupling_moment(twist, rate, coupling, engaged)


@wp.func
def update_couplings(ensemble: Any, state: Any, drive: Drive, time: wp.float64):
    """Updates states of all couplings at a step's start."""
    for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
        coupling = ensemble.couplings[c]
        first, second = coupled_bodies(state, drive, coupling)
        tables = ensemble.tables
        state.couplings[c] = coupling_state(time, first, second, state.couplings[c], coupling, tables)
