"""Link force: a spring and a damper on the line of two neighboring rollers; acceleration and energy of rollers.

With d = r_{i+1} - r_i, L = |d|, u = d / L and w = v_{i+1} - v_i (Pedersen et al. 2004, eq. (1)-(3), damping added):

    T = k (L - p) + c L',    L' = w . u,    F = T u   on roller i, -F on roller i + 1.

p is the link's unloaded length. Outer and inner links alternate and may differ; with a play s the spring acts beyond
p + s or p - s. The link between an open chain's ends is absent.
"""

from typing import Any

import warp as wp

from ..native import dot, inverse_root, multiply_add, products, root


@wp.func
def link_force(d: Any, w: Any, length: Any, chain: Any):
    """Tension [N], rate of elongation [m/s] and unit vector of a link of a chain of like links, eq. (2), (3).

    `d` [m] and `w` [m/s] are roller i + 1 less roller i.
    """
    square = dot(d, d)
    u = d * inverse_root(square)
    rate = dot(w, u)
    stretch = root(square) - length
    tension = products(chain.stiffness, stretch, chain.damping, rate)
    return tension, rate, u


@wp.func
def uneven_link_force(d: Any, w: Any, length: Any, i: int, chain: Any):
    """Tension [N], rate of elongation [m/s] and unit vector of link `i` of uneven links, eq. (2), (3)."""
    stiffness, damping = link_spring(i, chain)
    square = dot(d, d)
    u = d * inverse_root(square)
    rate = dot(w, u)
    drawn = root(square) - length
    stretch = drawn - wp.clamp(drawn, -chain.play, chain.play)
    tension = products(stiffness, stretch, damping, rate)
    return tension, rate, u


@wp.func
def has_uneven_links(chain: Any):
    """Whether links differ in stiffness or damping, have play, or one is absent."""
    like = chain.outer_stiffness == chain.stiffness and chain.outer_damping == chain.damping
    return not like or chain.play != type(chain.play)(0.0) or chain.absent > 0


@wp.func
def link_spring(i: int, chain: Any):
    """Stiffness [N/m] and damping [N s/m] of link `i`, outer where even, 0 where absent."""
    outer = i % 2 == 0
    stiffness = wp.where(outer, chain.outer_stiffness, chain.stiffness)
    damping = wp.where(outer, chain.outer_damping, chain.damping)
    none = type(stiffness)(0.0)
    exists = i + 1 != chain.absent
    return wp.where(exists, stiffness, none), wp.where(exists, damping, none)


@wp.func
def roller_acceleration(force: Any, inverse_mass: Any, gravity: Any):
    """Acceleration [m/s^2] of a roller by links, contacts, gravity, eq. (1)."""
    return type(gravity)(
        acceleration_component(force[0], inverse_mass, gravity[0]),
        acceleration_component(force[1], inverse_mass, gravity[1]),
    )


@wp.func
def acceleration_component(force: Any, inverse_mass: Any, gravity: Any):
    """Component of a roller's acceleration [m/s^2], eq. (1)."""
    return multiply_add(inverse_mass, force, gravity)


@wp.func
def chain_at_roller(chain: Any, relative_mass: Any, mobility: Any):
    """A chain with one roller's mass: `relative_mass` times the chain's, `mobility` 1 over that."""
    chain.mass = chain.mass * relative_mass
    chain.inverse_mass = chain.inverse_mass * mobility
    return chain


@wp.func
def compensated_sum(high: Any, low: Any, change: Any):
    """Roller's coordinate plus a small `change`, and its rounding (fast two-sum)."""
    rest = low + change
    moved = high + rest
    return moved, rest - (moved - high)


@wp.func
def roller_energy(position: Any, velocity: Any, tension: Any, rate: Any, i: int, chain: Any):
    """Kinetic and elastic energy [J] of roller `i` and its link; m g . x [J]."""
    stiffness, damping = link_spring(i, chain)
    spring = wp.float64(tension - damping * rate)
    apart = wp.where(i + 1 == chain.absent, wp.float64(1.0), wp.float64(stiffness))
    vx = wp.float64(velocity[0])
    vy = wp.float64(velocity[1])
    lift = wp.float64(chain.gravity[0]) * wp.float64(position[0]) + wp.float64(chain.gravity[1]) * wp.float64(
        position[1]
    )
    held = wp.float64(0.5) * (wp.float64(chain.mass) * (vx * vx + vy * vy) + spring * spring / apart)
    return held, wp.float64(chain.mass) * lift
