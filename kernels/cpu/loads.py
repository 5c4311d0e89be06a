"""Wrenches and moments on single bodies on the CPU: contacts', tensioners', loads', arms' springs'."""

from typing import Any

import warp as wp

from ..bodies.carried_arms import carried_spring_moment, spring_state
from ..physics.body import arm_own_moment, heading_of, wrench_with_force
from ..physics.motion import load_moment
from ..structs import BodyState, Drive
from .body_states import arm_of


@wp.func
def body_wrench(ensemble: Any, state: Any, drive: Drive, b: int):
    """Wrench of contacts and tensioners on body `b` of all."""
    wrench = state.wrenches[b]
    for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
        if drive.first_body + ensemble.tensioners[t].body == b:
            wrench = wrench_with_force(wrench, state.pushes[t].thrust, state.pushes[t].moment)
    return wrench


@wp.func
def body_load(ensemble: Any, state: Any, drive: Drive, body: BodyState, b: int, time: wp.float64):
    """Load moment [N m] on body `b` of all; an arm's by springs and weight."""
    load, motion, arm = wp.float64(0.0), ensemble.motions[b], arm_of(drive, b)
    if arm >= 0:
        load = arm_own_moment(body, heading_of(body), ensemble.arms[arm])
        if drive.jointed != 0:
            a, first = arm - drive.first_arm, drive.first_body + drive.bodies - drive.arms
            seen = spring_state(drive, ensemble.arms, state.bodies, first, a, body)
            load = arm_own_moment(seen, heading_of(body), ensemble.arms[arm])
            load = load + carried_spring_moment(drive, ensemble.arms, state.bodies, first, a)
    elif motion.prescribed == 0:  # to ask for a load that is 0 takes 3 % of a step of two sprockets
        load = load_moment(time, time, body.angle, body.speed, motion, ensemble)
    return load
