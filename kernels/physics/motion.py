r"""Sprocket motion: prescribed angle and speed, and the load moment of a free sprocket (Pedersen et al. 2004, eq. (4)).

Prescribed, w = +1 or -1 the wrap's sign, S(u) = u^2 (3 - 2 u) the smooth ramp, phi' = Omega S(t / t_ramp) or tabulated:

    theta = theta_0 + w [phi + sum_h (a_h / h) (sin(h phi + psi_h) - sin psi_h)],    omega = theta'

Load, phi_f = w (theta - theta_0) the forward angle; T0 may be tabulated over time or phi_f; viscous and quadratic parts
oppose the actual speed:

    M = -{w [T0 + sum_h T_h cos(h phi_f + psi_h)] + b omega + q omega |omega|} S(t / t_load)

Angles are kept in float64 at every precision: they are a few numbers a step, and seats hang on them.
"""

import warp as wp

from ..trigonometry import sine_cosine

vec3 = wp.types.vector(3, wp.float64)


@wp.func
def ramp(time: wp.float64, duration: wp.float64):
    """S(t / duration), from 0 to 1; 1 throughout where the duration is zero."""
    if time >= duration:
        return wp.float64(1.0)
    u = time / duration
    return u * u * (wp.float64(3.0) - wp.float64(2.0) * u)


@wp.func
def ramp_slope(time: wp.float64, duration: wp.float64):
    """Derivative of `ramp` [1/s]."""
    if time >= duration:
        return wp.float64(0.0)
    u = time / duration
    return wp.float64(6.0) * u * (wp.float64(1.0) - u) / duration


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
def prescribed_motion(
    phi: wp.float64,
    rate: wp.float64,
    start_angle: wp.float64,
    sign: wp.float64,
    harmonics: wp.array(dtype=vec3),
    first: int,
    count: int,
):
    """Angle [rad] and angular velocity [rad/s] of a prescribed sprocket at phi and phi'; harmonics are (order,
    amplitude, phase).
    """
    angle = phi
    factor = wp.float64(1.0)
    for j in range(first, first + count):
        harmonic = harmonics[j]
        argument = harmonic[0] * phi + harmonic[2]
        sine, cosine = sine_cosine(argument)
        start, _ = sine_cosine(harmonic[2])
        angle = angle + harmonic[1] / harmonic[0] * (sine - start)
        factor = factor + harmonic[1] * cosine
    return start_angle + sign * angle, sign * rate * factor


@wp.func
def prescribed_acceleration(
    phi: wp.float64,
    rate: wp.float64,
    growth: wp.float64,
    sign: wp.float64,
    harmonics: wp.array(dtype=vec3),
    first: int,
    count: int,
):
    """Angular acceleration [rad/s^2] of `prescribed_motion` at phi, phi' and phi''."""
    factor = wp.float64(1.0)
    slope = wp.float64(0.0)
    for j in range(first, first + count):
        harmonic = harmonics[j]
        argument = harmonic[0] * phi + harmonic[2]
        sine, cosine = sine_cosine(argument)
        factor = factor + harmonic[1] * cosine
        slope = slope - harmonic[0] * harmonic[1] * sine
    return sign * (growth * factor + rate * rate * slope)


@wp.func
def load_moment(
    time: wp.float64,
    turned: wp.float64,
    speed: wp.float64,
    sign: wp.float64,
    load: vec3,
    ramp_time: wp.float64,
    harmonics: wp.array(dtype=vec3),
    first: int,
    count: int,
):
    """Load moment [N m] on a free sprocket, counter-clockwise; `load` is (torque, viscous, quadratic), `turned` =
    theta - theta_0.
    """
    forward = sign * turned
    torque = load[0]
    for j in range(first, first + count):
        harmonic = harmonics[j]
        _, cosine = sine_cosine(harmonic[0] * forward + harmonic[2])
        torque = torque + harmonic[1] * cosine
    resisting = sign * torque + load[1] * speed + load[2] * speed * wp.abs(speed)
    return -resisting * ramp(time, ramp_time)
