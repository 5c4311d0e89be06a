r"""How a body turns: prescribed angle and speed, and the load moment of a free one (Pedersen et al. 2004, eq. (4)).

Prescribed, w = +1 or -1 the wrap's sign, S(u) = u^2 (3 - 2 u) the smooth ramp, phi' = Omega S(t / t_ramp) or tabulated:

    theta = theta_0 + w [phi + sum_h (a_h / h) (sin(h phi + psi_h) - sin psi_h)],    omega = theta'

Load, phi_f = w (theta - theta_0) the forward angle; T0 may be tabulated over time or phi_f; viscous and quadratic parts
oppose the actual speed:

    M = -{w [T0 + sum_h T_h cos(h phi_f + psi_h)] + b omega + q omega |omega|} S(t / t_load)

Angles are kept in float64 at every precision: they are a few numbers a step, and seats hang on them.
"""

from typing import Any

import warp as wp

from ..fast_math import quotient
from ..number import sine_cosine
from ..structs import Curves, Motion
from .table import table_at


@wp.func
def ramp(time: Any, duration: Any):
    """S(t / duration), from 0 to 1; 1 throughout where the duration is zero."""
    if time >= duration:
        return type(time)(1.0)
    u = quotient(time, duration)
    return u * u * (type(time)(3.0) - type(time)(2.0) * u)


@wp.func
def ramp_slope(time: Any, duration: Any):
    """Derivative of `ramp` [1/s]."""
    if time >= duration:
        return type(time)(0.0)
    u = time / duration
    return type(time)(6.0) * u * (type(time)(1.0) - u) / duration


@wp.func
def ramp_integral(time: wp.float64, duration: wp.float64):
    """Integral of `ramp` from 0 to `time` [s]."""
    if time >= duration:
        return time - wp.float64(0.5) * duration
    u = time / duration
    return duration * u * u * u * (wp.float64(1.0) - wp.float64(0.5) * u)


@wp.func
def ramped(time: wp.float64, speed: wp.float64, ramp_time: wp.float64):
    """phi, phi' and phi'' of a speed that is ramped up."""
    return speed * ramp_integral(time, ramp_time), speed * ramp(time, ramp_time), speed * ramp_slope(time, ramp_time)


@wp.func
def course_at(time: wp.float64, motion: Motion, curves: Curves):
    """phi, phi' and phi'' of a prescribed body, before its harmonics."""
    phi, rate, growth = ramped(time, motion.speed, motion.ramp_time)
    if motion.drive_table.cells > 0:
        rate, phi, growth = table_at(time, motion.drive_table, curves.tables)
    return phi, rate, growth


@wp.func
def prescribed_at(time: wp.float64, motion: Motion, curves: Curves):
    """Angle [rad] and angular velocity [rad/s] of a prescribed body."""
    phi, rate, growth = course_at(time, motion, curves)
    angle = phi
    factor = wp.float64(1.0)
    rows = motion.drive_harmonics
    for j in range(rows.first, rows.first + rows.count):
        harmonic = curves.harmonics[j]
        argument = harmonic[0] * phi + harmonic[2]
        sine, cosine = sine_cosine(argument)
        start, _ = sine_cosine(harmonic[2])
        angle = angle + harmonic[1] / harmonic[0] * (sine - start)
        factor = factor + harmonic[1] * cosine
    return motion.start_angle + motion.sign * angle, motion.sign * rate * factor


@wp.func
def prescribed_acceleration(time: wp.float64, motion: Motion, curves: Curves):
    """Angular acceleration [rad/s^2] of a prescribed body."""
    phi, rate, growth = course_at(time, motion, curves)
    factor = wp.float64(1.0)
    slope = wp.float64(0.0)
    rows = motion.drive_harmonics
    for j in range(rows.first, rows.first + rows.count):
        harmonic = curves.harmonics[j]
        argument = harmonic[0] * phi + harmonic[2]
        sine, cosine = sine_cosine(argument)
        factor = factor + harmonic[1] * cosine
        slope = slope - harmonic[0] * harmonic[1] * sine
    return motion.sign * (growth * factor + rate * rate * slope)


@wp.func
def resisted(torque: Any, speed: Any, sign: Any, load: Any):
    """Load moment [N m] at full ramp, from the torque against forward motion [N m]; `load` as in `Motion`."""
    return -(sign * torque + load[1] * speed + load[2] * speed * wp.abs(speed))


@wp.func
def free_load(time: wp.float64, angle: wp.float64, speed: wp.float64, motion: Motion, curves: Curves):
    """Load moment [N m] of a body that is free to turn, counter-clockwise."""
    turned = angle - motion.start_angle
    forward = motion.sign * turned
    torque = motion.load[0]
    if motion.load_table.cells > 0:
        x = wp.where(motion.load_table.over_angle == 1, forward, time)
        tabulated, integral, slope = table_at(x, motion.load_table, curves.tables)
        torque = torque + tabulated
    rows = motion.load_harmonics
    for j in range(rows.first, rows.first + rows.count):
        harmonic = curves.harmonics[j]
        _, cosine = sine_cosine(harmonic[0] * forward + harmonic[2])
        torque = torque + harmonic[1] * cosine
    return resisted(torque, speed, motion.sign, motion.load) * ramp(time, motion.load_ramp_time)


@wp.func
def load_moment(time: wp.float64, angle: wp.float64, speed: wp.float64, motion: Motion, curves: Curves):
    """As `free_load`; 0 of a body whose angle is prescribed."""
    if motion.prescribed == 1:
        return wp.float64(0.0)
    return free_load(time, angle, speed, motion, curves)


@wp.func
def load_moment_at_speed(time: Any, load: Any, before: Any, speed: Any, motion: Any):
    """The load moment [N m] at another angular velocity than `before`, where it is `load`."""
    change = motion.load[1] * (speed - before) + motion.load[2] * (speed * wp.abs(speed) - before * wp.abs(before))
    return load - change * ramp(time, motion.load_ramp_time)
