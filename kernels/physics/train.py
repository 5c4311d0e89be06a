r"""Shafts, gears, couplings and motors: moments that bodies pass on to each other, and what drives them.

Bodies that a shaft or gears tie are a train, of which body b turns rho_b times as fast as the first. With M_b the
moment of contacts, load, motor and couplings on body b,

    (sum rho^2 J) q'' = sum rho M,    alpha_b = rho_b q'',                                                (a)

which body b has as if it turned alone with the inertia sum rho^2 J / rho_b^2 under the moment sum rho M / rho_b. A pair
of gears passes on to the bodies B beyond it, the first of which turns with alpha_b,

    T = J_B alpha_b - sum_B rho M / rho_b,    J_B = sum_B rho^2 J / rho_b^2.                              (b)

A coupling of the twist e = q_1 - q_2 passes on to its second body, and takes from its first,

    M = k d + c e',    d = e - b above b, e + b below -b,    M = 0 in between.                            (c)

A motor's moment is that of its limits M_0 and P and of its table: min(M_0 + M(omega), P / omega) forward.
"""

from typing import Any

import warp as wp

from ..number import add, difference, leading, mul, number_of, rounded, sub  # noqa: F401
from .motion import forward_angle, ramp, value_at

OVER_SPEED = wp.constant(2)
"""`Tabulated.over_angle` of a motor's table over speed."""


@wp.func
def motor_moment(time: Any, angle: Any, speed: Any, motor: Any, motion: Any, tables: Any):
    """Moment [N m] of a shaft's motor, counter-clockwise; 0 where it has none or its angle is prescribed.

    Args:
        time: a number [s].
        angle, speed: numbers, of the shaft.
        motor: its data.
        motion: of the shaft, with its sense.
        tables: values of all tables.
    """
    forward = motion.sign * leading(speed)
    torque = motor.torque
    if motor.present == 0 or motion.prescribed == 1:
        return type(torque)(0.0)
    if motor.table.cells > 0:
        x = time
        if motor.table.over_angle == 1:
            x = forward_angle(angle, motion)
        elif motor.table.over_angle == OVER_SPEED:
            x = number_of(forward)
        torque = torque + value_at(x, motor.table, tables)
    if motor.power > type(torque)(0.0) and torque * forward > motor.power:
        torque = motor.power / forward
    return motion.sign * torque * ramp(rounded(time), motor.ramp_time)


@wp.func
def twist_of(first: Any, second: Any, coupling: Any):
    """Twist [rad] of a coupling and its rate [rad/s], from the states of its bodies."""
    twist = difference(first.angle - second.angle, coupling.rest)
    return twist, rounded(difference(first.speed, second.speed))


@wp.func
def twisted(twist: Any, coupling: Any):
    """d of (c) [rad]."""
    zero = type(twist)(0.0)
    return wp.max(twist - coupling.lash, zero) + wp.min(twist + coupling.lash, zero)


@wp.func
def coupling_moment(twist: Any, rate: Any, coupling: Any):
    """Moment [N m] that a coupling passes on to its second body (c)."""
    beyond = twisted(twist, coupling)
    damped = wp.where(wp.abs(twist) >= coupling.lash, coupling.damping, type(twist)(0.0))
    return coupling.stiffness * beyond + damped * rate


@wp.func
def coupling_energy(twist: Any, coupling: Any):
    """Energy [J] of a coupling's spring."""
    beyond = twisted(twist, coupling)
    return type(twist)(0.5) * coupling.stiffness * beyond * beyond


@wp.func
def coupling_loss(twist: Any, rate: Any, coupling: Any):
    """Power [W] that a coupling's damper takes."""
    return wp.where(wp.abs(twist) >= coupling.lash, coupling.damping * rate * rate, type(twist)(0.0))


@wp.func
def own_energy(energy: Any, speed: Any, tie: Any, motion: Any):
    """Energy [J] of a body of a train without that of the others, whose inertia it sees and `energy` has."""
    half = type(speed)(0.5)
    if motion.prescribed == 0:
        energy = energy + half * speed * speed * (tie.inertia - type(speed)(1.0) / motion.inverse_inertia)
    return energy


@wp.func
def on_side(gear: Any, b: int):
    """Whether body `b` of the drive is beyond a pair of gears, on the side of its second."""
    return (gear.side >> wp.int64(b)) & wp.int64(1) != wp.int64(0)
