"""Rotation of a body: prescribed angle and speed, and the load moment of a free one (Pedersen et al. 2004, eq. (4)).

Prescribed, w = +1 or -1 the wrap's sign, S(u) = u^2 (3 - 2 u) the smooth ramp, phi' = Omega S(t / t_ramp) or tabulated:

    theta = theta_0 + w [phi + sum_h (a_h / h) (sin(h phi + psi_h) - sin psi_h)],    omega = theta'

Load, phi_f = w (theta - theta_0) the forward angle; T0 may be tabulated over time or phi_f:

    M = -{w [T0 + sum_h T_h cos(h phi_f + psi_h)] + b omega + q omega |omega|} S(t / t_load)

Times and angles are numbers (`number`), since seats depend on them; all else is rounded.
"""

from typing import Any

import warp as wp

from ..native import quotient
from ..number import add, cosine_of, div, leading_value, mul, number_of, rounded_value, sine_cosine, sub  # noqa: F401

CELL_VALUES = wp.constant(5)


@wp.func
def table_cell(x: Any, table: Any):
    """Cell of a motion's table at `x`, place in it, cells beyond the ends, and a repeating table's rounds."""
    u = div(x - table.start, table.spacing)
    place = rounded_value(u)
    cells = type(place)(table.cells)
    rounds = type(place)(0.0)
    if table.repeats == 1:
        rounds = wp.floor(place / cells)
        u = u - rounds * cells
    within = u
    if not (rounded_value(u) >= type(place)(0.0)):  # before it, or no number: the variant is diverging
        within = number_of(type(place)(0.0))
    if rounded_value(u) >= cells:
        within = number_of(cells)
    cell = wp.min(int(rounded_value(within)), table.cells - 1)
    return cell, within - type(place)(cell), u - within, rounds


@wp.func
def cubic_value(w: Any, c0: Any, c1: Any, c2: Any, c3: Any):
    """Cubic c_0 + c_1 w + c_2 w^2 + c_3 w^3 of a motion table's cell."""
    return c0 + w * (c1 + w * (c2 + w * c3))


@wp.func
def table_value(x: Any, table: Any, values: Any):
    """Value of a motion's or load's table at `x`, rounded."""
    cell, place, beyond, rounds = table_cell(x, table)
    at = table.first + CELL_VALUES * cell
    c2, c3 = leading_value(values[at + 2]), leading_value(values[at + 3])
    return cubic_value(rounded_value(place), leading_value(values[at]), leading_value(values[at + 1]), c2, c3)


@wp.func
def table_slope(x: Any, table: Any, values: Any):
    """Slope of a motion's or load's table at `x`, rounded."""
    cell, place, beyond, rounds = table_cell(x, table)
    at = table.first + CELL_VALUES * cell
    w = rounded_value(place)
    c1, c2, c3 = leading_value(values[at + 1]), leading_value(values[at + 2]), leading_value(values[at + 3])
    slope = quotient(c1 + w * (2.0 * c2 + 3.0 * w * c3), rounded_value(table.spacing))
    return wp.where(rounded_value(beyond) == type(w)(0.0), slope, type(w)(0.0))


@wp.func
def table_derivatives(x: Any, table: Any, values: Any):
    """Value, a number, and two rounded derivatives of a motion's table at `x`; 0 for none."""
    w = rounded_value(x)
    value = number_of(type(w)(0.0))
    slope = type(w)(0.0)
    bend = type(w)(0.0)
    if table.cells > 0:
        cell, place, beyond, rounds = table_cell(x, table)
        at = table.first + CELL_VALUES * cell
        value = cubic_value(place, values[at], values[at + 1], values[at + 2], values[at + 3])
        if rounded_value(beyond) == type(w)(0.0):
            w = rounded_value(place)
            c1, c2, c3 = leading_value(values[at + 1]), leading_value(values[at + 2]), leading_value(values[at + 3])
            spacing = rounded_value(table.spacing)
            slope = quotient(c1 + w * (type(w)(2.0) * c2 + type(w)(3.0) * w * c3), spacing)
            bend = quotient(type(w)(2.0) * c2 + type(w)(6.0) * w * c3, spacing * spacing)
    return value, slope, bend


@wp.func
def table_integral(x: Any, table: Any, values: Any):
    """Value and integral from 0 of a motion's table at `x`."""
    cell, w, beyond, rounds = table_cell(x, table)
    at = table.first + CELL_VALUES * cell
    c0, c1, c2, c3 = values[at], values[at + 1], values[at + 2], values[at + 3]
    value = cubic_value(w, c0, c1, c2, c3)
    integral = values[at + 4] + table.spacing * w * cubic_value(w, c0, c1 / 2.0, c2 / 3.0, c3 / 4.0)
    integral = integral + rounds * values[table.first + CELL_VALUES * table.cells]
    return value, integral + beyond * table.spacing * value


@wp.func
def ramp(time: Any, duration: Any):
    """Smooth ramp S(t / duration) of a motion or load, 0 to 1."""
    if time >= duration:
        return type(time)(1.0)
    u = quotient(time, duration)
    return u * u * (type(time)(3.0) - type(time)(2.0) * u)


@wp.func
def ramp_slope(time: Any, duration: Any):
    """Derivative [1/s] of the smooth `ramp` by time."""
    if time >= duration:
        return type(time)(0.0)
    u = quotient(time, duration)
    return quotient(type(time)(6.0) * u * (type(time)(1.0) - u), duration)


@wp.func
def ramp_integral(time: Any, duration: Any):
    """Integral [s] of the smooth `ramp` from 0 to `time` [s]."""
    if leading_value(time) >= leading_value(duration):
        return time - 0.5 * duration
    u = time / duration
    return duration * u * u * u * (1.0 - 0.5 * u)


@wp.func
def prescribed_course(time: Any, motion: Any, ensemble: Any):
    """phi [rad], phi' [rad/s], phi'' [rad/s^2] of a prescribed rotation without harmonics."""
    phi = motion.speed * ramp_integral(time, motion.ramp_time)
    rate = rounded_value(motion.speed) * ramp(rounded_value(time), rounded_value(motion.ramp_time))
    growth = rounded_value(motion.speed) * ramp_slope(rounded_value(time), rounded_value(motion.ramp_time))
    if motion.drive_table.cells > 0:
        value, integral = table_integral(time, motion.drive_table, ensemble.tables)
        phi = integral
        rate = rounded_value(value)
        growth = table_slope(time, motion.drive_table, ensemble.tables)
    return phi, rate, growth


@wp.func
def phase_sine(harmonic: wp.vec3d):
    """Sine of a prescribed harmonic's phase, in float64."""
    sine, cosine = sine_cosine(harmonic[2])
    return sine


@wp.func
def phase_sine(harmonic: wp.vec4f):
    """Sine of a prescribed harmonic's phase, kept in float32."""
    return harmonic[3]


@wp.func
def prescribed_rotation(time: Any, motion: Any, ensemble: Any):
    """Angle [rad] and angular velocity [rad/s] of a body's prescribed rotation."""
    phi, rate, growth = prescribed_course(time, motion, ensemble)
    angle = phi
    factor = type(rate)(1.0)
    rows = motion.drive_harmonics
    for j in range(rows.first, rows.first + rows.count):
        harmonic = ensemble.harmonics[j]
        sine, cosine = sine_cosine(harmonic[0] * phi + harmonic[2])
        angle = angle + harmonic[1] / harmonic[0] * (sine - phase_sine(harmonic))
        factor = factor + harmonic[1] * leading_value(cosine)
    return motion.start_angle + motion.sign * angle, motion.sign * rate * factor


@wp.func
def prescribed_acceleration(time: Any, motion: Any, ensemble: Any):
    """Angular acceleration [rad/s^2] of a body's prescribed rotation."""
    phi, rate, growth = prescribed_course(time, motion, ensemble)
    factor = type(rate)(1.0)
    slope = type(rate)(0.0)
    rows = motion.drive_harmonics
    for j in range(rows.first, rows.first + rows.count):
        harmonic = ensemble.harmonics[j]
        sine, cosine = sine_cosine(harmonic[0] * phi + harmonic[2])
        factor = factor + harmonic[1] * leading_value(cosine)
        slope = slope - harmonic[0] * harmonic[1] * leading_value(sine)
    return motion.sign * (growth * factor + rate * rate * slope)


@wp.func
def resisting_moment(torque: Any, speed: Any, sign: Any, load: Any):
    """Load moment [N m] of a body at full ramp, from `torque` [N m]."""
    return -(sign * torque + load[1] * speed + load[2] * speed * wp.abs(speed))


@wp.func
def forward_angle(angle: Any, motion: Any):
    """Forward angle phi_f [rad] of a rotating body at an angle [rad]."""
    return motion.sign * (angle - motion.start_angle)


@wp.func
def load_table_argument(time: Any, angle: Any, motion: Any):
    """Time [s] or forward angle [rad], whichever a body's load is tabulated over."""
    x = time
    if motion.load_table.over_angle == 1:
        x = forward_angle(angle, motion)
    return x


@wp.func
def load_moment(time: Any, rounded: Any, angle: Any, speed: Any, motion: Any, ensemble: Any):
    """Load moment [N m], counter-clockwise, of a body at `time` [s], also `rounded`; 0 with a prescribed angle."""
    tabulated = type(motion.inverse_inertia)(0.0)
    if motion.load_table.cells > 0:
        tabulated = table_value(load_table_argument(time, angle, motion), motion.load_table, ensemble.tables)
    torque = motion.load[0] + tabulated
    rows = motion.load_harmonics
    for j in range(rows.first, rows.first + rows.count):
        harmonic = ensemble.harmonics[j]
        torque = torque + harmonic[1] * cosine_of(harmonic[0] * forward_angle(angle, motion) + harmonic[2])
    load = resisting_moment(torque, leading_value(speed), motion.sign, motion.load)
    return wp.where(motion.prescribed == 1, type(load)(0.0), load * ramp(rounded, motion.load_ramp_time))


@wp.func
def load_moment_at_speed(time: Any, load: Any, before: Any, speed: Any, motion: Any):
    """Load moment [N m] of a body at `speed`, from `load` at `before` [rad/s]."""
    change = motion.load[1] * (speed - before) + motion.load[2] * (speed * wp.abs(speed) - before * wp.abs(before))
    return load - change * ramp(time, motion.load_ramp_time)
