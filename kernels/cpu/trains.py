"""Trains on the CPU: moments on bodies of shafts, couplings, motors and valves before they move."""

from typing import Any

import warp as wp

from ..bodies.loads import body_motor_moment
from ..structs import GROUND, Drive
from . import couplings, loads, valves


@wp.func
def find_train_moments(ensemble: Any, state: Any, drive: Drive, stage: int, time: wp.float64):
    """Sets `state.train_moments`: moments on all bodies but arms, with those of motors and couplings."""
    if stage == 0:
        couplings.update_couplings(ensemble, state, drive, time)
    for b in range(drive.first_body, drive.first_body + drive.sprockets + drive.shafts):
        wrench, body = loads.body_wrench(ensemble, state, drive, b), state.bodies[b]
        moment = wrench.moment + wrench.bearing + loads.body_load(ensemble, state, drive, body, b, time)
        motor = body_motor_moment(time, ensemble, drive, b - drive.first_body, body, ensemble.motions[b])
        state.train_moments[b] = moment + motor
    for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
        coupling = ensemble.couplings[c]
        first, second = drive.first_body + coupling.first, drive.first_body + coupling.second
        twist, moment = couplings.twist_and_moment(ensemble, state, drive, c)
        if coupling.first != GROUND:
            state.train_moments[first] = state.train_moments[first] - moment
        state.train_moments[second] = state.train_moments[second] + state.couplings[c].ratio * moment
    if drive.valves > 0:
        valves.find_valve_loads(ensemble, state, drive)
