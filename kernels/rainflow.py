"""Rainflow counting as samples come, after ASTM E1049-85 (2011), 5.4.4, and Miner damage along with it.

The stack holds the reversals that no cycle has closed yet. With the latest three, X is the later range and Y the
earlier one: while X >= Y, Y is counted, as half a cycle if it holds the series' start, else as a whole one. What is
left at the end counts as half cycles. Values are exact, so cycles are those of any other implementation of the
standard, bit for bit. Damage sums n (range / reference)^m, Miner's sum in units of one cycle of the reference range.
"""

import warp as wp

vec2d = wp.types.vector(2, wp.float64)
vec3d = wp.types.vector(3, wp.float64)


@wp.struct
class Rainflow:
    """One series' counting, between two samples."""

    samples: wp.int32  # seen so far
    points: wp.int32  # reversals on the stack
    cycles: wp.int32  # ranges counted so far
    last: wp.float64  # latest sample
    change: wp.float64  # latest change that was not zero
    damage: wp.float64  # sum of n (range / reference)^m


@wp.func
def count_range(
    a: wp.float64,
    b: wp.float64,
    part: wp.float64,
    woehler: vec2d,
    log: wp.array(dtype=vec3d),
    first: int,
    room: int,
    state: Rainflow,
):
    """Counts the range from a to b as `part` of a cycle; notes (range, mean, part) where the log has room."""
    size = wp.abs(a - b)
    if state.cycles < room:
        log[first + state.cycles] = vec3d(size, wp.float64(0.5) * (a + b), part)
    state.cycles = state.cycles + 1
    state.damage = state.damage + part * wp.pow(size / woehler[0], woehler[1])
    return state


@wp.func
def add_reversal(
    value: wp.float64,
    stack: wp.array(dtype=wp.float64),
    base: int,
    capacity: int,
    woehler: vec2d,
    log: wp.array(dtype=vec3d),
    first: int,
    room: int,
    state: Rainflow,
):
    """Puts a reversal on the stack and counts what it closes.

    A full stack gives up its oldest range as half a cycle, which never happens with room for every reversal.
    """
    half, whole = wp.float64(0.5), wp.float64(1.0)
    if state.points == capacity:
        state = count_range(stack[base], stack[base + 1], half, woehler, log, first, room, state)
        for k in range(1, capacity):
            stack[base + k - 1] = stack[base + k]
        state.points = state.points - 1
    stack[base + state.points] = value
    state.points = state.points + 1
    closing = bool(True)
    while closing and state.points >= 3:
        top = base + state.points - 1
        x = wp.abs(stack[top] - stack[top - 1])
        y = wp.abs(stack[top - 1] - stack[top - 2])
        if x < y:
            closing = False
        elif state.points == 3:
            state = count_range(stack[base], stack[base + 1], half, woehler, log, first, room, state)
            stack[base] = stack[base + 1]
            stack[base + 1] = stack[base + 2]
            state.points = 2
        else:
            state = count_range(stack[top - 2], stack[top - 1], whole, woehler, log, first, room, state)
            stack[top - 2] = stack[top]
            state.points = state.points - 2
    return state


@wp.func
def add_sample(
    value: wp.float64,
    stack: wp.array(dtype=wp.float64),
    base: int,
    capacity: int,
    woehler: vec2d,
    log: wp.array(dtype=vec3d),
    first: int,
    room: int,
    state: Rainflow,
):
    """One sample of a series; the first one is a reversal, later ones where the series turns.

    Args:
        value: the sample.
        stack: reversals of all series; this one's are stack[base : base + capacity], capacity at least 4.
        woehler: (reference range, exponent).
        log: counted ranges of all series; this one's are log[first : first + room]. No room: only damage is kept.
        state: how the counting stands.
    """
    if state.samples == 0:
        state = add_reversal(value, stack, base, capacity, woehler, log, first, room, state)
        state.last = value
    change = value - state.last
    if change != wp.float64(0.0):
        turned = (state.change > wp.float64(0.0)) != (change > wp.float64(0.0))
        if state.change != wp.float64(0.0) and turned:
            state = add_reversal(state.last, stack, base, capacity, woehler, log, first, room, state)
        state.change = change
        state.last = value
    state.samples = state.samples + 1
    return state


@wp.func
def end_series(
    stack: wp.array(dtype=wp.float64),
    base: int,
    capacity: int,
    woehler: vec2d,
    log: wp.array(dtype=vec3d),
    first: int,
    room: int,
    state: Rainflow,
):
    """The series' last sample is a reversal; the ranges left on the stack are half cycles."""
    if state.samples > 1:
        state = add_reversal(state.last, stack, base, capacity, woehler, log, first, room, state)
    for k in range(state.points - 1):
        state = count_range(stack[base + k], stack[base + k + 1], wp.float64(0.5), woehler, log, first, room, state)
    state.points = 0
    return state


@wp.kernel(enable_backward=False)
def rainflow_kernel(
    series: wp.array2d(dtype=wp.float64),
    woehler: vec2d,
    capacity: int,
    room: int,
    stack: wp.array(dtype=wp.float64),
    log: wp.array(dtype=vec3d),
    cycles: wp.array(dtype=wp.int32),
    damage: wp.array(dtype=wp.float64),
):
    """Counts every column of `series` (samples, columns), one thread a column."""
    column = wp.tid()
    state = Rainflow()
    base, first = column * capacity, column * room
    for k in range(series.shape[0]):
        state = add_sample(series[k, column], stack, base, capacity, woehler, log, first, room, state)
    state = end_series(stack, base, capacity, woehler, log, first, room, state)
    cycles[column] = state.cycles
    damage[column] = state.damage
