"""Goods on a strand: mass that pins carry between two places.

With s a pin's distance along the line from where goods come on, l the length over which they lie, p the pitch and q
their mass on one meter, a pin carries

    m_q = q p f,    f(s) = clamp(s / p + 1/2, 0, 1) - clamp((s - l) / p + 1/2, 0, 1).                             (1)

Goods come on at a speed u along the line, of direction t, and hold back a pin that gains mass by

    F = -max(m_q', 0) (v - u t),    m_q' = q p (f(s + w) - f(s - w)) / h,    w = v . t h / 2.                      (2)

They bring a power, negative where they leave, of

    m_q' (v^2 / 2 - g . x) + F . v.                                                                                (3)
"""

from typing import Any

import warp as wp

from ..native import dot


@wp.func
def load_places(position: Any, load: Any):
    """Terms of a strand load's f before their clamps, (1), and 1 where a pin is near enough for goods, else 0."""
    away = position - load.start
    half = type(load.reach)(0.5)
    along = dot(away, load.direction)
    across = wp.abs(away[0] * load.direction[1] - away[1] * load.direction[0])
    near = wp.where(across < load.reach, type(load.reach)(1.0), type(load.reach)(0.0))
    return along * load.per_pitch + half, (along - load.length) * load.per_pitch + half, near


@wp.func
def clamped_change(place: Any, part: Any):
    """Change of a strand load's clamp(x, 0, 1) from `part` before to `part` after."""
    zero, one = type(place)(0.0), type(place)(1.0)
    return wp.clamp(place + part, zero, one) - wp.clamp(place - part, zero, one)


@wp.func
def carried_relative_mass(position: Any, load: Any):
    """Mass of goods on a pin over the chain's roller mass, (1)."""
    on, off, near = load_places(position, load)
    zero, one = type(near)(0.0), type(near)(1.0)
    return load.relative_mass * near * (wp.clamp(on, zero, one) - wp.clamp(off, zero, one))


@wp.func
def feed_rate_and_force(position: Any, velocity: Any, step: Any, chain: Any):
    """Rate at which a pin gains goods [kg/s], and force [N] that brings them to its velocity, (2)."""
    load = chain.load
    on, off, near = load_places(position, load)
    part = type(step)(0.5) * step * dot(velocity, load.direction) * load.per_pitch
    gained = near * (clamped_change(on, part) - clamped_change(off, part))
    rate = chain.mass * load.relative_mass * gained / step
    gain = wp.max(rate, type(rate)(0.0))
    return rate, gain * (load.feed_speed * load.direction - velocity)


@wp.func
def goods_power(position: Any, velocity: Any, step: Any, chain: Any):
    """Power [W] that goods on a strand bring to a pin, (3)."""
    rate, force = feed_rate_and_force(position, velocity, step, chain)
    half = type(rate)(0.5)
    return rate * (half * dot(velocity, velocity) - dot(chain.gravity, position)) + dot(force, velocity)
