"""What contacts at float32 want of bodies and guides, in rows of four values: all threads read them,
and a row is one access.

wheel  0  R cos theta, R sin theta, each high and low      gear  0  tan(pi/z), R, clearance, tip reach
       1  center, high parts (x, y) and low parts                1  cosine and sine of half a seat, flank, first seat
       2  cosine, sine, speed (high parts), load                 2  of the law K, n, damping, v_min
       3  their low parts; prescribed speed                      3  of the law m_e / h, form; number of teeth
       4  angle, R, each high and low
       5  velocity of the center, grid

line   0  start, high parts (x, y) and low parts                 3  of the law K, n, damping, v_min
       1  direction, the same                                    4  of the law m_e / h, form; slack
       2  length, end's and roller's radius, deepest entry       5  of a profile: the box along and across its chord
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..number import pair
from ..physics.guide import line_of
from ..structs import Line, Wheel, types
from .kind import BlockKind

WHEEL_ROWS = wp.constant(6)
GEAR_ROWS = wp.constant(4)
LINE_ROWS = wp.constant(6)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    const float4 row = *(const float4*)(rows.data + i);
    return {row.x, row.y, row.z, row.w};
#else
    assert(i >= 0 && i < rows.shape[0]);
    return rows.data[i];
#endif
""")
def load_four(rows: wp.array[wp.vec4f], i: int) -> wp.vec4f:
    """Row i."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    *(float4*)(rows.data + i) = make_float4(row[0], row[1], row[2], row[3]);
#else
    assert(i >= 0 && i < rows.shape[0]);
    rows.data[i] = row;
#endif
""")
def store_four(rows: wp.array[wp.vec4f], i: int, row: wp.vec4f):
    """Row i."""
    ...


@wp.func_native("union { int whole; float bits; } of; of.whole = value; return of.bits;")
def bits_of(value: int) -> wp.float32:
    """An integer's bits as those of a float."""
    ...


@wp.func_native("union { int whole; float bits; } of; of.bits = value; return of.whole;")
def whole_of(value: wp.float32) -> int:
    """The integer whose bits `bits_of` gave."""
    ...


@wp.func
def seen_wheel(rows: wp.array[wp.vec4f], s: int):
    """What contacts want of body s."""
    reach = load_four(rows, WHEEL_ROWS * s)
    center = load_four(rows, WHEEL_ROWS * s + 1)
    heading = load_four(rows, WHEEL_ROWS * s + 2)
    wheel = Wheel()
    wheel.reach_cosine = pair(reach[0], reach[1])
    wheel.reach_sine = pair(reach[2], reach[3])
    wheel.center = wp.vec2f(center[0], center[1])
    wheel.center_low = wp.vec2f(center[2], center[3])
    wheel.cosine.high = heading[0]
    wheel.sine.high = heading[1]
    wheel.speed.high = heading[2]
    wheel.load = heading[3]
    return wheel


@wp.func
def velocity_of(rows: wp.array[wp.vec4f], s: int):
    """Velocity of the center of body s [m/s]."""
    row = load_four(rows, WHEEL_ROWS * s + 5)
    return wp.vec2f(row[0], row[1])


@wp.func
def load_wheel(rows: wp.array[wp.vec4f], s: int):
    """Body s, but for the velocity of its center."""
    wheel = seen_wheel(rows, s)
    lows = load_four(rows, WHEEL_ROWS * s + 3)
    angle = load_four(rows, WHEEL_ROWS * s + 4)
    wheel.cosine.low = lows[0]
    wheel.sine.low = lows[1]
    wheel.speed.low = lows[2]
    wheel.exact_speed = lows[3]
    wheel.angle = pair(angle[0], angle[1])
    wheel.radius = pair(angle[2], angle[3])
    wheel.grid = load_four(rows, WHEEL_ROWS * s + 5)[2]
    return wheel


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    ((float*)(rows.data + i))[3] = value;
#else
    assert(i >= 0 && i < rows.shape[0]);
    rows.data[i][3] = value;
#endif
""")
def store_last(rows: wp.array[wp.vec4f], i: int, value: wp.float32):
    """The last value of row i, while others read those before."""
    ...


@wp.func
def store_load(rows: wp.array[wp.vec4f], s: int, load: wp.float32):
    """The load on body s."""
    store_last(rows, WHEEL_ROWS * s + 2, load)


@wp.func
def store_turn(rows: wp.array[wp.vec4f], s: int, wheel: Wheel):
    """What changes of body s as it turns about a fixed center."""
    cosine, sine = wheel.reach_cosine, wheel.reach_sine
    store_four(rows, WHEEL_ROWS * s, wp.vec4f(cosine.high, cosine.low, sine.high, sine.low))
    heading = wp.vec4f(wheel.cosine.high, wheel.sine.high, wheel.speed.high, wheel.load)
    store_four(rows, WHEEL_ROWS * s + 2, heading)
    lows = wp.vec4f(wheel.cosine.low, wheel.sine.low, wheel.speed.low, wheel.exact_speed)
    store_four(rows, WHEEL_ROWS * s + 3, lows)
    angle = wp.vec4f(wheel.angle.high, wheel.angle.low, wheel.radius.high, wheel.radius.low)
    store_four(rows, WHEEL_ROWS * s + 4, angle)


@wp.func
def store_wheel(rows: wp.array[wp.vec4f], s: int, wheel: Wheel):
    """Body s."""
    store_turn(rows, s, wheel)
    center, low = wheel.center, wheel.center_low
    store_four(rows, WHEEL_ROWS * s + 1, wp.vec4f(center[0], center[1], low[0], low[1]))
    moving = wheel.velocity
    store_four(rows, WHEEL_ROWS * s + 5, wp.vec4f(moving[0], moving[1], wheel.grid, 0.0))


@wp.func
def within(box: wp.vec4f, p: wp.vec2f):
    """Whether `p` is finite and in a box (low corner, high corner)."""
    return p[0] > box[0] and p[0] < box[2] and p[1] > box[1] and p[1] < box[3]


@wp.func
def load_line(rows: wp.array[wp.vec4f], g: int):
    """Where guide-bar g is."""
    start = load_four(rows, LINE_ROWS * g)
    along = load_four(rows, LINE_ROWS * g + 1)
    line = Line()
    line.start = wp.vec2f(start[0], start[1])
    line.start_low = wp.vec2f(start[2], start[3])
    line.direction = wp.vec2f(along[0], along[1])
    line.direction_low = wp.vec2f(along[2], along[3])
    line.slack = load_four(rows, LINE_ROWS * g + 4)[2]
    return line


@wp.func
def box_of(rows: wp.array[wp.vec4f], g: int):
    """The box about the chord of guide g, a profile, in which rollers are looked after: low, high [m]."""
    return load_four(rows, LINE_ROWS * g + 5)


@dataclass(frozen=True)
class GearFunctions:
    """How the teeth of sprockets and straight guide-bars are kept."""

    load_gear: wp.Function
    store_gear: wp.Function
    load_bar: wp.Function
    store_bar: wp.Function


@cache
def gears(kind: BlockKind) -> GearFunctions:
    """How teeth and contact laws are kept in rows, for kernels at float32."""
    kinds = types(kind.Real)

    @wp.func
    def law_in(law: wp.vec4f, rest: wp.vec4f):
        """A contact law from its rows, the second of which has more."""
        found = kinds.ContactLaw()
        found.stiffness = law[0]
        found.exponent = law[1]
        found.damping = law[2]
        found.speed_floor = law[3]
        found.most_damping = rest[0]
        found.form = whole_of(rest[1])
        return found

    @wp.func
    def store_law(rows: wp.array[wp.vec4f], at: int, law: kinds.ContactLaw, third: wp.float32):
        """A contact law into its rows, from row `at` on; `third` stands with it."""
        store_four(rows, at, wp.vec4f(law.stiffness, law.exponent, law.damping, law.speed_floor))
        store_four(rows, at + 1, wp.vec4f(law.most_damping, bits_of(law.form), third, 0.0))

    @wp.func
    def load_gear(rows: wp.array[wp.vec4f], s: int):
        """What contacts want of the teeth of sprocket s."""
        size = load_four(rows, GEAR_ROWS * s)
        seat = load_four(rows, GEAR_ROWS * s + 1)
        law = load_four(rows, GEAR_ROWS * s + 2)
        rest = load_four(rows, GEAR_ROWS * s + 3)
        gear = kinds.Sprocket()
        gear.half_pitch_tangent = size[0]
        gear.pitch_radius = size[1]
        gear.clearance = size[2]
        gear.tip_reach = size[3]
        gear.cos_half_seat = seat[0]
        gear.sin_half_seat = seat[1]
        gear.flank_curvature = seat[2]
        gear.first_seat = whole_of(seat[3])
        gear.teeth = whole_of(rest[2])
        gear.law = law_in(law, rest)
        return gear

    @wp.func
    def store_gear(rows: wp.array[wp.vec4f], s: int, gear: kinds.Sprocket):
        """The teeth of sprocket s."""
        at = GEAR_ROWS * s
        store_four(rows, at, wp.vec4f(gear.half_pitch_tangent, gear.pitch_radius, gear.clearance, gear.tip_reach))
        seat = wp.vec4f(gear.cos_half_seat, gear.sin_half_seat, gear.flank_curvature, bits_of(gear.first_seat))
        store_four(rows, at + 1, seat)
        store_law(rows, at + 2, gear.law, bits_of(gear.teeth))

    @wp.func
    def load_bar(rows: wp.array[wp.vec4f], g: int):
        """What contacts want of guide-bar g, but for where it is."""
        size = load_four(rows, LINE_ROWS * g + 2)
        law = load_four(rows, LINE_ROWS * g + 3)
        rest = load_four(rows, LINE_ROWS * g + 4)
        bar = kinds.Guide()
        bar.length = size[0]
        bar.end_radius = size[1]
        bar.roller_radius = size[2]
        bar.deepest_entry = size[3]
        bar.law = law_in(law, rest)
        return bar

    @wp.func
    def store_bar(rows: wp.array[wp.vec4f], g: int, bar: kinds.Guide):
        """Guide-bar g."""
        line = line_of(bar)
        at = LINE_ROWS * g
        start, start_low, along, along_low = line.start, line.start_low, line.direction, line.direction_low
        store_four(rows, at, wp.vec4f(start[0], start[1], start_low[0], start_low[1]))
        store_four(rows, at + 1, wp.vec4f(along[0], along[1], along_low[0], along_low[1]))
        store_four(rows, at + 2, wp.vec4f(bar.length, bar.end_radius, bar.roller_radius, bar.deepest_entry))
        store_law(rows, at + 3, bar.law, line.slack)
        low = wp.vec2f(wp.float32(bar.low[0]), wp.float32(bar.low[1]))
        store_four(rows, at + 5, wp.vec4f(low[0], low[1], wp.float32(bar.high[0]), wp.float32(bar.high[1])))

    return GearFunctions(load_gear=load_gear, store_gear=store_gear, load_bar=load_bar, store_bar=store_bar)
