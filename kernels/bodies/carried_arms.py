"""Arms that arms carry, on the CPU and blocks alike: their moments and coupled accelerations (`physics.hub`, (b)).

`arms` are all arms of an ensemble. A chain's arms are `drive.arms` bodies from `first` on, arm `a` is body `first` + a.
"""

from typing import Any

import warp as wp

from ..number import leading_value
from ..physics.body import arm_mass_moment, arm_spring_moment, plain_body, pose_heading
from ..physics.guide import world_vector
from ..physics.hub import carried_arm_coefficients, eliminate_carried_arm, relative_body
from ..structs import Drive


@wp.func
def spring_state(drive: Drive, arms: Any, bodies: Any, first: int, a: int, body: Any):
    """Angle and speed of arm `a`, at `body`, in plain numbers, relative to the arm that carries it, if any."""
    on = arms[drive.first_arm + a].on
    if on > 0:
        body = relative_body(body, bodies[first + on - 1])
    return plain_body(body)


@wp.func
def carried_spring_moment(drive: Drive, arms: Any, bodies: Any, first: int, a: int):
    """Moment [N m] on arm `a` of springs, dampers and stops of arms that it carries."""
    moment = type(arms[drive.first_arm].stiffness)(0.0)
    for k in range(drive.arms):
        arm = arms[drive.first_arm + k]
        if arm.on == a + 1:
            moment = moment - arm_spring_moment(spring_state(drive, arms, bodies, first, k, bodies[first + k]), arm)
    return moment


@wp.func
def joint_terms(drive: Drive, arms: Any, motions: Any, poses: Any, rates: Any, first: int, k: int, lag: Any):
    """Terms of carried arm `k` in (b), and 1 / I_2 [1/(kg m^2)].

    `rates` are uncoupled accelerations of centers [m/s^2] and angles [rad/s^2], `lag` the time from speeds to forces
    [s].
    """
    arm = arms[drive.first_arm + k]
    b, on = first + k, first + arm.on - 1
    own, carrier = poses[b], poses[on]
    lever, s = leading_value(world_vector(arm.lever, carrier)), arm_mass_moment(pose_heading(own), arm)
    w1, w2 = leading_value(carrier.speed) + lag * carrier.angular, leading_value(own.speed) + lag * own.angular
    led, inverse = wp.vector(rates[on][0], rates[on][1]), motions[b].inverse_inertia
    return carried_arm_coefficients(lever, s, w1, w2, led, rates[b][2] / inverse), inverse


@wp.func
def coupled_acceleration(drive: Drive, arms: Any, motions: Any, poses: Any, rates: Any, first: int, a: int, lag: Any):
    """Angular acceleration [rad/s^2] of arm `a`, which no arm carries, with arms that it carries, (b)."""
    inertia = type(lag)(1.0) / motions[first + a].inverse_inertia
    moment = inertia * rates[first + a][2]
    for k in range(drive.arms):
        if arms[drive.first_arm + k].on == a + 1:
            terms, inverse = joint_terms(drive, arms, motions, poses, rates, first, k, lag)
            moment, inertia = eliminate_carried_arm(moment, inertia, terms, inverse)
    return moment / inertia
