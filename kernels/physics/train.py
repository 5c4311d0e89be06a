"""Trains of shafts: moments of gears and couplings between bodies that turn together, and of motors that drive them.

Bodies tied by a shaft or gears are a train, of which body b turns rho_b times as fast as the first. With M_b the moment
of contacts, load, motor and couplings on body b,

    (sum rho^2 J) q'' = sum rho M,    alpha_b = rho_b q''.                                                (a)

A pair of gears passes on to the bodies B beyond it, the first turning with alpha_b,

    T = J_B alpha_b - sum_B rho M / rho_b,    J_B = sum_B rho^2 J / rho_b^2.                              (b)

A coupling of the twist e = q_1 - i q_2 - e_0, at a ratio i, takes from its first body

    M = k d + c e',    d = e - b above b, e + b below -b,    M = 0 in between,                            (c)

and passes on i M to its second. As i changes, k d^2 / 2 is lost; at i = 0 it is open. A clutch bears |M| <= C and
slips where k |d| would exceed it:

    e_0' = e' where k d = C and e' > 0, or k d = -C and e' < 0, else 0,    C |e_0'| lost.                   (d)

A freewheel of way w bears 0 <= w M <= C. q_1 is 0 where the first body is the ground.

A motor's moment is min(M_0 + M(omega), P / omega) forward, with limits M_0 and P and a table. Its governor multiplies
it by min(max(1 + (omega_0 - omega) / B, 0), f), P aside.
"""

from typing import Any

import warp as wp

from ..native import quotient
from ..number import add, difference, leading_value, mul, number_of, rounded_value, sub  # noqa: F401
from ..structs import GROUND
from .motion import forward_angle, ramp, table_value

OVER_SPEED = wp.constant(2)
"""`Tabulated.over_angle` of a train's table over speed."""


@wp.func
def motor_moment(time: Any, angle: Any, speed: Any, motor: Any, motion: Any, tables: Any):
    """Moment [N m] of a shaft's motor, counter-clockwise; 0 for none or a prescribed angle."""
    forward = motion.sign * leading_value(speed)
    torque = motor.torque
    if motor.present == 0 or motion.prescribed == 1:
        return type(torque)(0.0)
    if motor.table.cells > 0:
        x = time
        if motor.table.over_angle == 1:
            x = forward_angle(angle, motion)
        elif motor.table.over_angle == OVER_SPEED:
            x = number_of(forward)
        torque = torque + table_value(x, motor.table, tables)
    if motor.band > type(torque)(0.0):
        part = type(torque)(1.0) + quotient(motor.wanted - forward, motor.band)
        torque = torque * wp.clamp(part, type(torque)(0.0), motor.most)
    if motor.power > type(torque)(0.0) and torque * forward > motor.power:
        torque = motor.power / forward
    return motion.sign * torque * ramp(rounded_value(time), motor.ramp_time)


@wp.func
def coupling_twist(first: Any, second: Any, coupling: Any, engaged: Any):
    """Twist [rad] of a coupling and its rate [rad/s], both 0 while open."""
    ratio = engaged.ratio
    angle = first.angle
    speed = first.speed
    if coupling.first == GROUND:
        angle = number_of(type(ratio)(0.0))
        speed = number_of(type(ratio)(0.0))
    twist = difference(angle - ratio * second.angle, engaged.rest)
    rate = rounded_value(difference(speed, ratio * second.speed))
    if ratio == type(ratio)(0.0):
        return type(ratio)(0.0), type(ratio)(0.0)
    return twist, rate


@wp.func
def twist_beyond_lash(twist: Any, coupling: Any):
    """Twist d [rad] of a coupling beyond its lash, (c)."""
    zero = type(twist)(0.0)
    return wp.max(twist - coupling.lash, zero) + wp.min(twist + coupling.lash, zero)


@wp.func
def unbounded_moment(twist: Any, rate: Any, coupling: Any):
    """Moment [N m] of a coupling whatever its capacity, (c)."""
    return coupling.stiffness * twist_beyond_lash(twist, coupling) + coupling_damping(twist, coupling) * rate


@wp.func
def coupling_damping(twist: Any, coupling: Any):
    """Damping c [N m s/rad] of a coupling beyond lash, 0 within."""
    return wp.where(wp.abs(twist) >= coupling.lash, coupling.damping, type(twist)(0.0))


@wp.func
def coupling_moment(twist: Any, rate: Any, coupling: Any, engaged: Any):
    """Moment [N m] that a coupling takes from its first body, (c)."""
    low, high = moment_bounds(coupling, engaged)
    return wp.clamp(unbounded_moment(twist, rate, coupling), low, high)


@wp.func
def moment_bounds(coupling: Any, engaged: Any):
    """Least and largest moment [N m] that a coupling or freewheel bears."""
    zero = type(engaged.capacity)(0.0)
    low = wp.where(coupling.freewheel > 0, zero, -engaged.capacity)
    return low, wp.where(coupling.freewheel < 0, zero, engaged.capacity)


@wp.func
def clutch_capacity(time: Any, first: Any, second: Any, coupling: Any, tables: Any):
    """Moment [N m] that a clutch bears, by its table of time or speed."""
    x = time
    if coupling.engagement.over_angle == OVER_SPEED:
        x = number_of(wp.abs(leading_value(first.speed)))
        if coupling.first == GROUND:
            x = number_of(wp.abs(leading_value(second.speed)))
    return coupling.capacity * table_value(x, coupling.engagement, tables)


@wp.func
def coupling_energy(twist: Any, coupling: Any):
    """Energy [J] of a coupling's spring."""
    beyond = twist_beyond_lash(twist, coupling)
    return type(twist)(0.5) * coupling.stiffness * beyond * beyond


@wp.func
def coupling_loss(twist: Any, rate: Any, coupling: Any, engaged: Any):
    """Power [W] lost in a coupling by damper and bounds of moment."""
    over = coupling_moment(twist, rate, coupling, engaged) - unbounded_moment(twist, rate, coupling)
    return wp.max(coupling_damping(twist, coupling) * rate * rate + over * rate, type(rate)(0.0))


@wp.func
def coupling_ratio(time: Any, before: Any, coupling: Any, tables: Any):
    """Ratio in use of a coupling by its rows (time, ratio), or `before`."""
    ratio = type(before)(before)
    for at in range(coupling.first_ratio, coupling.first_ratio + 2 * coupling.ratios, 2):
        if difference(time, tables[at]) >= type(ratio)(0.0):
            ratio = leading_value(tables[at + 1])
    return ratio


@wp.func
def coupling_state(time: Any, first: Any, second: Any, before: Any, coupling: Any, tables: Any):
    """State of a coupling at a step's start: ratio, capacity, slip by (d)."""
    now = before
    twist, rate = coupling_twist(first, second, coupling, before)
    zero = type(twist)(0.0)
    now.lost = zero
    now.ratio = coupling_ratio(time, before.ratio, coupling, tables)
    if coupling.capacity > zero:
        now.capacity = coupling.capacity
        if coupling.engagement.cells > 0:
            now.capacity = clutch_capacity(time, first, second, coupling, tables)
    if now.ratio != before.ratio:
        now.rest = first.angle - now.ratio * second.angle
        now.lost = coupling_energy(twist, coupling)
    elif coupling.capacity > zero or coupling.freewheel != 0:
        low, high = moment_bounds(coupling, now)
        beyond = twist_beyond_lash(twist, coupling)
        slip = beyond - wp.clamp(beyond, low / coupling.stiffness, high / coupling.stiffness)
        now.rest = before.rest + slip
        if slip != zero:  # a capacity may be infinite
            now.lost = wp.where(slip > zero, high, low) * slip
    return now


@wp.func
def own_body_energy(energy: wp.float64, speed: wp.float64, motion: Any):
    """Energy [J] of a train's body by its own inertia, from `energy` by the train's."""
    if motion.prescribed == 0:
        others = wp.float64(motion.own_inertia) - wp.float64(1.0) / wp.float64(motion.inverse_inertia)
        energy = energy + wp.float64(0.5) * speed * speed * others
    return energy


@wp.func
def is_on_gear_side(gear: Any, b: int):
    """Whether body `b` is on the second side of a pair of gears."""
    return (gear.side >> wp.int64(b)) & wp.int64(1) != wp.int64(0)
