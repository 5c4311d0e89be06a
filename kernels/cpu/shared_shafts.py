"""Shafts that several chains of a drive share, on the CPU.

Each chain has its own bodies; accelerations of the bodies of one shaft are added in order, and all take the sum.
"""

from typing import Any

import warp as wp

from ..bodies.train_moments import train_cam
from ..physics.valve import valve_inertia_share
from .body_states import leapfrog_interval


@wp.func
def body_count(ensemble: Any, first: int, chains: int):
    """Number of bodies of a variant whose chains begin at row `first`."""
    last = ensemble.drives[first + chains - 1]
    return last.first_body + last.bodies - ensemble.drives[first].first_body


@wp.func
def add_train_acceleration(ensemble: Any, state: Any, begin: int, count: int, b: int, kick: wp.float64, lifting: bool):
    """Adds the acceleration by the moment on body `b`, of another chain, to the bodies of its train.

    `begin` and `count` are the variant's bodies, `kick` `leapfrog_interval` [s].
    """
    first = b + ensemble.motions[b].shaft_offset
    mine, wrench, more = ensemble.motions[first], state.wrenches[b], state.rates[b][2]
    if lifting:
        cam = train_cam(ensemble.motions, state.cams, begin, count, first)
        share = valve_inertia_share(state.bodies[first].speed, kick, cam, mine)
        more = more / (wp.float64(1.0) + share)
    state.train_moments[first] = state.train_moments[first] + wrench.moment + wrench.bearing + wrench.load
    if ensemble.motions[b].prescribed == 0:
        for other in range(begin, begin + count):
            motion = ensemble.motions[other]
            if motion.train == mine.train and motion.shaft_offset == 0:
                rates = state.rates[other]
                rates[2] = rates[2] + motion.ratio / mine.ratio * more
                state.rates[other] = rates


@wp.func
def join_shafts(ensemble: Any, state: Any, begin: int, count: int, kick: wp.float64, lifting: bool):
    """Gives bodies of each shared shaft, among `count` from `begin` on, their accelerations' sum."""
    for b in range(begin, begin + count):
        if ensemble.motions[b].shaft_offset != 0:
            add_train_acceleration(ensemble, state, begin, count, b, kick, lifting)
    for b in range(begin, begin + count):
        if ensemble.motions[b].shaft_offset != 0 and ensemble.motions[b].prescribed == 0:
            rates = state.rates[b]
            rates[2] = state.rates[b + ensemble.motions[b].shaft_offset][2]
            state.rates[b] = rates


@wp.func
def join_shafts_of_variant(ensemble: Any, state: Any, variant: int, chains: int, time: wp.float64):
    """Gives bodies of a variant's shared shafts their accelerations' sum, at `time` [s]."""
    drive, last = ensemble.drives[variant], ensemble.drives[variant + chains - 1]
    lifting = last.first_valve + last.valves > drive.first_valve
    join_shafts(
        ensemble,
        state,
        drive.first_body,
        body_count(ensemble, variant, chains),
        leapfrog_interval(drive, time),
        lifting,
    )
