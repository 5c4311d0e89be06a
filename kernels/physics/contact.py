r"""One roller against one sprocket or guide-bar: gap, approach speed, force, and the memory that a contact keeps.

A contact keeps the approach speed v0 of its first instant until it opens; v0 = 0 stands for "open". A roller keeps its
seat while it is engaged, so that no angle is computed in the time loop. The approach speed is that of the sprocket's
material point against the roller, v = (v_s + omega x r - v_i) . n (eq. (10)-(14)); the force acts on the roller
along n, its opposite on the sprocket at the same point, which conserves angular momentum (eq. (16) with the full
cross product).
"""

from typing import Any

import warp as wp

from ..structs import vec2d
from .guide import guide_gap
from .impact import contact_force, elastic_force
from .tooth import seat_step, tooth_gap, wrapped_seat


@wp.func
def penalty(penetration: Any, speed: Any, impact_speed: Any, law: Any):
    """Force [N], v0 [m/s], dissipated power [W] and elastic energy [J] of a contact; all zero where it is open.

    Args:
        penetration: pen [m], contact where positive.
        speed: approach speed v [m/s].
        impact_speed: v0 of this contact, 0 if it was open until now.
        law: the contact's parameters (`structs.ContactLaw`).
    """
    zero = type(penetration)(0.0)
    force = zero
    first = zero
    dissipated = zero
    energy = zero
    if penetration > zero:
        force, first, elastic = closed_contact(penetration, speed, impact_speed, law)
        dissipated = (force - elastic) * speed
        energy = elastic_energy(elastic, penetration, law)
    return force, first, dissipated, energy


@wp.func
def closed_contact(penetration: Any, speed: Any, impact_speed: Any, law: Any):
    """Force [N], v0 [m/s] and elastic force [N] of a contact that is closed; arguments as of `penalty`.

    The force less the elastic force, times the speed, is the dissipated power.
    """
    first = impact_speed
    if first == type(penetration)(0.0):
        first = wp.max(speed, law.speed_floor)
    elastic = elastic_force(penetration, law.stiffness, law.exponent)
    return contact_force(elastic, speed, first, law), first, elastic


@wp.func
def elastic_energy(elastic: Any, penetration: Any, law: Any):
    """Energy [J] that a closed contact's elastic force holds."""
    return elastic * penetration / (law.exponent + type(penetration)(1.0))


@wp.func
def turned(direction: Any, cosine: Any, sine: Any):
    """`direction` turned by the angle whose cosine and sine are given."""
    return type(direction)(direction[0] * cosine - direction[1] * sine, direction[0] * sine + direction[1] * cosine)


@wp.func
def in_gap(p: vec2d, direction: vec2d, cosine: wp.float64, sine: wp.float64):
    """Outward direction of a seat that points to `direction` at angle zero, and p's components along and across it."""
    e = turned(direction, cosine, sine)
    return e, wp.dot(p, e), p[1] * e[0] - p[0] * e[1]


@wp.func
def gap_approach(p: vec2d, v: Any, omega: Any, e: vec2d, radial: wp.float64, lateral: wp.float64, sprocket: Any):
    """Penetration [m] in a tooth gap whose outward direction is `e`, its normal, and the approach speed [m/s]."""
    xi = type(omega)(radial - sprocket.exact_radius)
    penetration, normal_radial, normal_lateral = tooth_gap(xi, type(omega)(lateral), sprocket)
    n = turned(type(v)(type(omega)(e[0]), type(omega)(e[1])), normal_radial, normal_lateral)
    surface = type(v)(-omega * type(omega)(p[1]), omega * type(omega)(p[0]))
    return penetration, n, wp.dot(surface - v, n)


@wp.func
def sprocket_contact(
    p: vec2d,
    v: Any,
    omega: Any,
    cosine: wp.float64,
    sine: wp.float64,
    seat: int,
    impact_speed: Any,
    sprocket: Any,
    seats: Any,
):
    """Contact of an engaged roller with its tooth gap, eq. (5)-(17).

    The roller's place in the gap is taken in float64 at every precision: it is the small difference of large lengths.

    Args:
        p: roller from the sprocket's center [m].
        v: roller's velocity relative to the center's [m/s].
        omega: sprocket's angular velocity [rad/s].
        cosine, sine: of the sprocket's angle.
        seat: the seat kept from the step before.
        impact_speed: v0 kept from the step before.
        sprocket: its teeth (`structs.Sprocket`).
        seats: table of seat directions at angle zero.

    Returns:
        Force on the roller (vector, N), its magnitude, seat, v0, dissipated power [W], elastic energy [J].
    """
    e, radial, lateral = in_gap(p, seats[sprocket.first_seat + seat], cosine, sine)
    move = seat_step(radial, lateral, wp.float64(sprocket.half_pitch_tangent))
    if move != 0:
        seat = wrapped_seat(seat + move, sprocket.teeth)
        e, radial, lateral = in_gap(p, seats[sprocket.first_seat + seat], cosine, sine)
    penetration, n, speed = gap_approach(p, v, omega, e, radial, lateral, sprocket)
    force, first, dissipated, energy = penalty(penetration, speed, impact_speed, sprocket.law)
    return force * n, force, seat, first, dissipated, energy


@wp.func
def guide_approach(p: vec2d, v: Any, impact_speed: Any, bar: Any):
    """Penetration [m] of a roller in a guide-bar, and its normal."""
    t = bar.direction
    along = type(impact_speed)(wp.dot(p, t))
    across = type(impact_speed)(p[1] * t[0] - p[0] * t[1])
    penetration, normal_along, normal_across = guide_gap(along, across, bar)
    return penetration, turned(type(v)(type(impact_speed)(t[0]), type(impact_speed)(t[1])), normal_along, normal_across)


@wp.func
def guide_contact(p: vec2d, v: Any, impact_speed: Any, bar: Any):
    """Contact of a roller with a guide-bar, eq. (21)-(23).

    Args:
        p: roller from the bar's start [m], in float64 as in `sprocket_contact`.
        v: roller's velocity [m/s].
        impact_speed: v0 kept from the step before.
        bar: the guide-bar (`structs.Guide`).

    Returns:
        Force on the roller (vector, N), its magnitude, v0, dissipated power [W], elastic energy [J].
    """
    penetration, n = guide_approach(p, v, impact_speed, bar)
    force, first, dissipated, energy = penalty(penetration, -wp.dot(v, n), impact_speed, bar.law)
    return force * n, force, first, dissipated, energy
