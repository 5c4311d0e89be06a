"""Mount of a body's center: prescribed, or on springs, with the inertia of an eccentric balance wheel.

Prescribed, with a unit vector d:   r_s(t) = r_0 + d (offset + A sin(2 pi f t + phase)), or r_0 + (x, y) of a table over
time. For an arm on a prescribed pivot, (b) holds with q = m left(r_c - p) and its weight in the load.

On springs and dampers, M = m_s + m_b the mass of sprocket and wheel, e the wheel's direction, q = m_b r_b e turned by
+90 degrees:

    M a + q alpha = contacts + M g + m_b r_b omega^2 e + preload - K (r_s - r_0) - C v_s      (a)
    I alpha + q . a = contact moment + load + q . g,      I = J + m_b r_b^2                   (b)

With B = 1/M along free directions and a_0 a prescribed center's acceleration,

    alpha = (N - q . (a_0 + B F)) / (I - q . B q).                                             (c)
"""

from typing import Any

import warp as wp

from ..native import quotient
from ..number import Pair, add, difference, leading_value, mul, rounded_value, sine_cosine, sub, vector  # noqa: F401
from .motion import table_derivatives

PRESCRIBED = wp.constant(1)
FREE = wp.constant(2)
CARRIED = wp.constant(3)
"""`Mount.moves` of a center that an arm carries (`hub`)."""


@wp.func
def phase_sine_cosine(argument: wp.float64):
    """Sine and cosine of the phase of a mount's motion, in float64."""
    return wp.sin(argument), wp.cos(argument)


@wp.func
def phase_sine_cosine(argument: Pair):
    """Sine and cosine of the phase of a mount's motion, in pairs."""
    sine, cosine = sine_cosine(argument)
    return sine, cosine


@wp.func
def prescribed_center(time: Any, mount: Any, ensemble: Any):
    """Position [m], velocity [m/s], acceleration [m/s^2] of a mount's prescribed center."""
    if mount.x_table.cells + mount.y_table.cells > 0:
        x, x_rate, x_growth = table_derivatives(time, mount.x_table, ensemble.tables)
        y, y_rate, y_growth = table_derivatives(time, mount.y_table, ensemble.tables)
        return mount.home + vector(x, y), wp.vector(x_rate, y_rate), wp.vector(x_growth, y_growth)
    sine, cosine = phase_sine_cosine(mount.frequency * time + mount.phase)
    along = mount.offset + mount.amplitude * sine
    amplitude, frequency = leading_value(mount.amplitude), leading_value(mount.frequency)
    rate = amplitude * frequency * rounded_value(cosine)
    growth = -amplitude * frequency * frequency * leading_value(sine)
    return mount.home + along * mount.direction, rate * mount.direction, growth * mount.direction


@wp.func
def displacement_from_home(center: Any, mount: Any):
    """Displacement [m] of a body's center from its mount's home r_0."""
    return rounded_value(difference(center, mount.home))


@wp.func
def wheel_arm(heading: Any, mount: Any):
    """m_b r_b e [kg m] of a mount's balance wheel."""
    w = mount.wheel
    return type(heading)(w[0] * heading[0] - w[1] * heading[1], w[0] * heading[1] + w[1] * heading[0])


@wp.func
def left_normal(v: Any):
    """Vector on a mount or arm turned by +90 degrees."""
    return type(v)(-v[1], v[0])


@wp.func
def mount_spring_force(displacement: Any, velocity: Any, mount: Any):
    """Force [N] of a mount's preload, spring and damper."""
    return mount.preload - mount.stiffness * displacement - mount.damping * velocity


@wp.func
def mount_accelerations(driven: Any, displacement: Any, body: Any, heading: Any, wrench: Any, turning: Any, mount: Any):
    """Accelerations of a mounted center (x, y) [m/s^2] and its body's angle [rad/s^2], (a) to (c).

    `driven` is a prescribed center's acceleration, else 0; `turning` holds 1 if the angle is prescribed else 0, its
    acceleration [rad/s^2] and the load moment [N m].
    """
    arm = wheel_arm(heading, mount)
    q = left_normal(arm)
    outward = body.speed * body.speed * arm
    force = wrench.force + mount.mass * mount.gravity + outward + mount_spring_force(displacement, body.velocity, mount)
    straight = driven + mount.inverse_mass * force
    angular = turning[1]
    if turning[0] == type(turning[0])(0.0):
        moment = wrench.moment + turning[2] + wp.dot(q, mount.gravity)
        angular = quotient(moment - wp.dot(q, straight), mount.inertia - wp.dot(q, mount.inverse_mass * q))
    straight = straight - angular * (mount.inverse_mass * q)
    return type(turning)(straight[0], straight[1], angular)


@wp.func
def mount_energy(displacement: Any, body: Any, heading: Any, mount: Any):
    """Kinetic and potential energy [J] of a body and balance wheel on a mount."""
    half = type(body.speed)(0.5)
    arm = wheel_arm(heading, mount)
    energy = half * mount.mass * wp.dot(body.velocity, body.velocity) + half * mount.inertia * body.speed * body.speed
    energy += body.speed * wp.dot(left_normal(arm), body.velocity)
    energy -= wp.dot(mount.gravity, mount.mass * body.center + arm)
    return energy + half * wp.dot(displacement, mount.stiffness * displacement) - wp.dot(mount.preload, displacement)


@wp.func
def holding_force(displacement: Any, body: Any, heading: Any, wrench: Any, rates: Any, mount: Any):
    """Force [N] that holds a mounted center, by springs or what prescribes it."""
    held = mount_spring_force(displacement, body.velocity, mount)
    if mount.moves != FREE:
        arm = wheel_arm(heading, mount)
        straight = type(heading)(rates[0], rates[1]) - mount.gravity
        held = mount.mass * straight + rates[2] * left_normal(arm) - body.speed * body.speed * arm - wrench.force
    return held


@wp.func
def prescribing_power(body: Any, heading: Any, holding: Any, rates: Any, prescribed: int, mount: Any):
    """Power [W] that keeps a mount's center and balance wheel in prescribed motion, contacts' work aside."""
    power = type(rates[2])(0.0)
    if mount.moves == PRESCRIBED:
        power += wp.dot(holding, body.velocity)
    if prescribed == 1:
        straight = type(heading)(rates[0], rates[1]) - mount.gravity
        power += body.speed * (mount.inertia * rates[2] + wp.dot(left_normal(wheel_arm(heading, mount)), straight))
    return power
