r"""A roller in its tooth gap and on a straight guide-bar at float32 without float64 (`contact` has them in float64).

What a contact hangs on is small, some micrometers, and the difference of lengths of a meter. In the gap it is the
vector from the seat to the roller,

    q = (r - c) - u,    u = R (cos theta d_x - sin theta d_y, sin theta d_x + cos theta d_y),                 (a)

d the seat's direction at angle zero. R cos theta and R sin theta are kept with a high part that is a multiple of
2^-12 of a power of two above R, d with one that is a multiple of 2^-12: products and sums of these are exact in
float32, and what has low parts in it is small, so that plain float32 is off by 2^-37 of R. On a bar it is the
distance from the face, p_y t_x - p_x t_y, a difference of products of some meters (`pairs.cross`).
"""

from typing import Any

import warp as wp

from ..pairs import Pair, cross, fused, pair, pair_of, rounded_sum, two_difference
from ..root import inside
from ..structs import Line, Wheel
from .contact import turned
from .guide import guide_gap
from .tooth import seat_step, tooth_gap, wrapped_seat


@wp.struct
class Away:
    """Where a roller is from something: a vector and what it rounds off [m]."""

    high: wp.vec2f
    low: wp.vec2f


@wp.struct
class Gap:
    """Which seat of a sprocket a roller is nearest to, and where it is in that seat's gap."""

    number: wp.int32
    outward: wp.vec2f  # direction from the sprocket's center
    xi: wp.float32  # along it, from the seat [m]
    lateral: wp.float32  # across it [m]


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float4 row = __ldg((const float4*)(rows.data + i));
    return {row.x, row.y, row.z, row.w};
#else
    assert(i >= 0 && i < rows.shape[0]);
    return rows.data[i];
#endif
""")
def load_split(rows: wp.array[wp.vec4f], i: int) -> wp.vec4f:
    """Row i of what does not change, such as the direction of a seat: high parts (x, y) and low parts (x, y)."""
    ...


@wp.func
def away(high: wp.vec2f, low: wp.vec2f, center: wp.vec2f, center_low: wp.vec2f):
    """A position less a center, both with low parts."""
    x = two_difference(high[0], center[0])
    y = two_difference(high[1], center[1])
    p = Away()
    p.high = wp.vec2f(x[0], y[0])
    p.low = wp.vec2f(x[1] + (low[0] - center_low[0]), y[1] + (low[1] - center_low[1]))
    return p


@wp.func
def gridded(value: wp.float32, magic: wp.float32):
    """`value` on the grid of spacing `magic` / 1.5 / 2^23."""
    return rounded_sum(rounded_sum(value, magic), -magic)


@wp.func
def reach_of(part: Pair, radius: Pair, magic: wp.float32):
    """R times a cosine or sine, its high part on the grid that `magic` stands for (`grid_of`) [m]."""
    high = gridded(radius.high * part.high, magic)
    low = fused(radius.high, part.high, -high) + (radius.high * part.low + radius.low * part.high)
    return pair(high, low)


@wp.func
def grid_of(radius: wp.float32):
    """What `gridded` wants for a grid of 2^-12 of the power of two above `radius`."""
    return 3072.0 * wp.pow(2.0, wp.floor(wp.log2(radius)) + 1.0)


@wp.func
def in_gap(p: Away, wheel: Wheel, direction: wp.vec4f):
    """Where a roller at p from the wheel's center is in the gap of a seat, (a)."""
    c = wheel.reach_cosine
    s = wheel.reach_sine
    x = direction[0] + direction[2]
    y = direction[1] + direction[3]
    to_x = c.high * direction[0] - s.high * direction[1]
    to_y = s.high * direction[0] + c.high * direction[1]
    rest_x = (c.high * direction[2] + c.low * x) - (s.high * direction[3] + s.low * y)
    rest_y = (s.high * direction[2] + s.low * x) + (c.high * direction[3] + c.low * y)
    q = wp.vec2f((p.high[0] - to_x) + (p.low[0] - rest_x), (p.high[1] - to_y) + (p.low[1] - rest_y))
    gap = Gap()
    gap.outward = turned(wp.vec2f(x, y), wheel.cosine.high, wheel.sine.high)
    gap.xi = wp.dot(q, gap.outward)
    gap.lateral = q[1] * gap.outward[0] - q[0] * gap.outward[1]
    return gap


@wp.func
def gap_from(p: Away, number: int, direction: wp.vec4f, wheel: Wheel, sprocket: Any, seats: wp.array[wp.vec4f]):
    """The seat of a roller at `p` from the center of a sprocket, as `contact.seat_from`."""
    gap = in_gap(p, wheel, direction)
    step = seat_step(sprocket.pitch_radius + gap.xi, gap.lateral, sprocket.half_pitch_tangent)
    if step != 0:
        number = wrapped_seat(number + step, sprocket.teeth)
        gap = in_gap(p, wheel, load_split(seats, sprocket.first_seat + number))
    gap.number = number
    return gap


@wp.func
def in_teeth_gap(arm: wp.vec2f, v: wp.vec2f, omega: wp.float32, gap: Gap, sprocket: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller in its tooth gap, as `contact.in_teeth`.

    `arm` leads from the sprocket's center to the roller [m].
    """
    penetration, normal_radial, normal_lateral = tooth_gap(gap.xi, gap.lateral, sprocket)
    surface = wp.vec2f(-omega * arm[1], omega * arm[0])
    return penetration, turned(gap.outward, normal_radial, normal_lateral), surface - v


@wp.func
def line_of(bar: Any):
    """A straight guide-bar's line."""
    x = pair_of(bar.start[0])
    y = pair_of(bar.start[1])
    along = pair_of(bar.direction[0])
    across = pair_of(bar.direction[1])
    line = Line()
    line.start = wp.vec2f(x.high, y.high)
    line.start_low = wp.vec2f(x.low, y.low)
    line.direction = wp.vec2f(along.high, across.high)
    line.direction_low = wp.vec2f(along.low, across.low)
    line.slack = 1.0e-6 * (bar.length + 2.0 * (bar.end_radius + bar.roller_radius))
    return line


@wp.func
def line_coordinates(p: Away, t: wp.vec2f, low: wp.vec2f):
    """Components of `p` along a direction and across it, `t` + `low` its high and low parts [m]."""
    along = wp.dot(p.high, t) + (wp.dot(p.low, t) + wp.dot(p.high, low))
    rest = (p.low[1] * t[0] + p.high[1] * low[0]) - (p.low[0] * t[1] + p.high[0] * low[1])
    return along, cross(p.high[1], p.high[0], t[1], t[0]) + rest


@wp.func
def on_line(p: Away, v: wp.vec2f, line: Line, bar: Any):
    """Penetration [m], normal and relative velocity [m/s] of a roller on a guide-bar that does not move.

    Args:
        p: roller from the bar's start.
        v: roller's velocity [m/s].
        line: where the bar is.
        bar: the guide-bar (`structs.Guide`).
    """
    t = line.direction
    along, across = line_coordinates(p, t, line.direction_low)
    penetration, normal_along, normal_across = guide_gap(along, across, bar)
    return penetration, turned(t, normal_along, normal_across), -v


@wp.func
def near_line(x: wp.float32, y: wp.float32, line: Line, bar: Any):
    """1 where a roller at (x, y) from a bar's start may touch it; float32 is off by less than `slack`."""
    along = x * line.direction[0] + y * line.direction[1]
    across = y * line.direction[0] - x * line.direction[1]
    reach = bar.end_radius + bar.roller_radius + line.slack
    near = inside(across, -bar.end_radius - line.slack, bar.roller_radius + line.slack)
    return near & inside(along, -reach, bar.length + reach)
