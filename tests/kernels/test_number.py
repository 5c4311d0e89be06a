"""Pairs of float32 against float64: arithmetic, headings, tooth gaps and guide-bars; no float64 in the time loop."""

from fractions import Fraction
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from blocks import some_of
from own_kernels import kernel
from pairs import BLOCKS, both, given, launched
from ptx import (
    compiled,
    contractible,
    float64_arithmetic,
    largest_part_without_float64,
    loop_without_float64,
    time_loop,
)

from warpchain.engine.arrays import harmonic_rows, seat_directions
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import BY_SPEED, BlockKind, BlockShape, Friction, Parts
from warpchain.kernels.number import (  # noqa: F401  (the signs between pairs)
    Pair,
    add,
    component,
    cross_product,
    difference,
    div,
    exact_multiple,
    float64_from_pair,
    leading_value,
    log_of_sum,
    logarithm,
    mul,
    number_of,
    pair,
    pair_from_float64,
    sine_cosine,
    sub,
    trimmed_value,
    vector,
)
from warpchain.kernels.physics.body import (
    aligned_pose,
    body_at_time,
    body_energy,
    leapfrog_body,
    pose_of,
    pose_with_coordinates,
    turned_pose,
)
from warpchain.kernels.physics.guide import bar_contact, frame_vector, profile_contact, tracked_piece
from warpchain.kernels.physics.motion import load_moment, prescribed_rotation, table_integral, table_value
from warpchain.kernels.physics.tooth import grid_magic, tooth_contact, tracked_seat
from warpchain.kernels.precision import as_float32
from warpchain.kernels.structs import BodyState, Ensemble, Guide, Motion, Piece, Sprocket, Tabulated
from warpchain.kernels.sums import add_powers, gathered_sprocket_sums
from warpchain.results.channels import DEFAULT_FRAME

EPS = 2.0**-24
"""Largest relative rounding of float32."""


@wp.func
def blocks_pose(body: BodyState, radius: wp.float64):
    """A body as blocks at float32 see it."""
    state = BLOCKS.BodyState()
    state.angle = pair_from_float64(body.angle)
    state.speed = pair_from_float64(body.speed)
    state.center = vector(pair_from_float64(body.center[0]), pair_from_float64(body.center[1]))
    pose = BLOCKS.Pose()
    pose.radius = pair_from_float64(radius)
    if radius > wp.float64(0.0):
        pose.inverse_radius = 1.0 / pose.radius.high
        pose.grid = grid_magic(pose.radius.high)
    return aligned_pose(pose_with_coordinates(pose, state))


@kernel
def arithmetic(a: wp.array[wp.float64], b: wp.array[wp.float64], out: wp.array2d[wp.float64]):
    i = wp.tid()
    x = pair_from_float64(a[i])
    y = pair_from_float64(b[i])
    out[i, 0] = float64_from_pair(x)
    out[i, 1] = float64_from_pair(x + y)
    out[i, 2] = float64_from_pair(x * y)
    out[i, 3] = wp.float64(difference(x, y))
    out[i, 4] = float64_from_pair(trimmed_value(x))
    out[i, 5] = float64_from_pair(trimmed_value(pair_from_float64(float64_from_pair(trimmed_value(x)))))
    out[i, 6] = wp.float64(cross_product(x.high, y.high, y.low, x.low))
    out[i, 7] = float64_from_pair(exact_multiple(i * 1_000_003, pair_from_float64(b[i])))
    out[i, 8] = float64_from_pair(x - y)
    out[i, 9] = float64_from_pair(x / y)
    out[i, 10] = float64_from_pair(0.5 - x * 0.75 + y.high)
    v = vector(x, y) - vector(y, x) * 2.0
    out[i, 11] = float64_from_pair(component(v, 1))


def test_pairs_have_48_bits():
    generator = np.random.default_rng(1)
    a = generator.uniform(0.5, 2.0, 1000) * generator.choice([-1, 1], 1000)
    b = a + generator.choice([1e-6, 1e-3, 1.0], 1000) * generator.uniform(-1, 1, 1000)
    found = launched(arithmetic, 1000, given(a), given(b), width=12)
    x, y = found[:, 0], np.float32(b) + np.float32(b - np.float32(b)).astype(float)
    # a low part is rounded at 2^-24 of half a unit of the high part's last place; each operation rounds a few of them
    bit = EPS**2
    assert np.abs(x - a).max() <= 2 * bit * np.abs(a).max()
    assert np.abs(found[:, 1] - (x + y)).max() <= 4 * bit * 4
    assert np.abs(found[:, 2] - x * y).max() <= 8 * bit * 8
    assert (np.abs(found[:, 3] - (x - y)) <= EPS * np.abs(x - y) + 4 * bit).all()  # rounded once, whatever cancels
    assert np.abs(found[:, 4] - x).max() <= 4 * bit * 2
    np.testing.assert_array_equal(found[:, 5], found[:, 4])  # float64 holds it, and it stays
    highs = [[Fraction(float(np.float32(v))) for v in values] for values in (a, b)]
    lows = [[Fraction(float(np.float32(v - np.float32(v)))) for v in values] for values in (a, b)]
    exact = [float(h * hl - k * kl) for h, k, hl, kl in zip(*highs, *lows, strict=True)]  # a high x low of either
    assert (np.abs(found[:, 6] - exact) <= 2 * EPS * np.abs(exact)).all()
    steps = np.arange(1000) * 1_000_003
    assert (np.abs(found[:, 7] - steps * y) <= 16 * bit * np.abs(steps * y)).all()
    assert np.abs(found[:, 8] - (x - y)).max() <= 4 * bit * 4
    assert (np.abs(found[:, 9] - x / y) <= 16 * bit * np.abs(x / y)).all()
    assert np.abs(found[:, 10] - (0.5 - 0.75 * x + np.float32(y))).max() <= 12 * bit * 5
    assert np.abs(found[:, 11] - (y - 2.0 * x)).max() <= 12 * bit * 6


@kernel
def with_literals(a: wp.array[wp.float64], out: wp.array2d[wp.float64]):
    x = a[0]
    out[0, 0] = 0.5 * x - x * 0.25
    out[0, 1] = 1.5 - x / 3.0
    out[0, 2] = 2.0 + x


def test_literals_beside_float64_are_float64():
    """A literal is float32 in a kernel: whole numbers and halves are exact in it."""
    x = 0.1234567890123
    found = launched(with_literals, 1, given([x]), width=3)[0]
    assert found.tolist() == [0.5 * x - x * 0.25, 1.5 - x / 3.0, 2.0 + x]


@kernel
def logarithms(values: wp.array[wp.float64], small: wp.array[wp.float64], out: wp.array2d[wp.float64]):
    i = wp.tid()
    out[i, 0] = float64_from_pair(logarithm(pair_from_float64(values[i])))
    out[i, 1] = wp.float64(log_of_sum(wp.float32(small[i])))


def test_logarithms_of_pairs():
    generator = np.random.default_rng(6)
    values = np.append(np.exp(generator.uniform(-8.0, 8.0, 20_000)), [1.0, 1.0 + 1e-6, 2.0, 0.5, np.sqrt(2.0)])
    small = generator.choice([-1, 1], len(values)) * 10.0 ** generator.uniform(-12, -0.1, len(values))
    found = launched(logarithms, len(values), given(values), given(small), width=2)
    # what comes after the first term of artanh is rounded, some times: a hundredth of 0.35, and the terms from s^15 on
    assert np.abs(found[:, 0] - np.log(values)).max() <= 0.0101 * 0.35 * 8 * EPS + 2e-12
    assert found[-5, 0] == 0.0
    exact = np.log1p(np.float32(small).astype(float))
    assert (np.abs(found[:, 1] - exact) <= 4 * EPS * np.abs(exact)).all()


@kernel
def headings(angle: wp.array[wp.float64], out: wp.array2d[wp.float64]):
    i = wp.tid()
    s, c = sine_cosine(pair_from_float64(angle[i]))
    out[i, 0] = float64_from_pair(s)
    out[i, 1] = float64_from_pair(c)


@pytest.mark.parametrize("largest", [0.8, 10.0, 1e3, 1e5])
def test_sine_and_cosine_of_pairs(largest):
    angle = np.random.default_rng(1).uniform(-largest, largest, 20_000)
    found = launched(headings, len(angle), given(angle), width=2)
    # terms without a low part leave 1.4e-12; beyond, the angle itself and its quarter turns are rounded at 2^-48
    tolerance = 2e-12 + 3 * 2.0**-48 * largest
    np.testing.assert_allclose(found, np.stack([np.sin(angle), np.cos(angle)], axis=1), rtol=0, atol=tolerance)


@kernel
def headings_at_float32(angle: wp.array[wp.float64], out: wp.array2d[wp.float64]):
    i = wp.tid()
    s, c = sine_cosine(wp.float32(angle[i]))
    out[i, 0] = wp.float64(s)
    out[i, 1] = wp.float64(c)


@pytest.mark.parametrize("largest", [0.8, 1e3])
def test_sine_and_cosine_at_float32(largest):
    angle = np.random.default_rng(1).uniform(-largest, largest, 20_000)
    found, of = launched(headings_at_float32, len(angle), given(angle), width=2), angle.astype(np.float32).astype(float)
    np.testing.assert_allclose(found, np.stack([np.sin(of), np.cos(of)], axis=1), rtol=0, atol=EPS)


TEETH, R, CLEARANCE = 31, 0.4321, 2e-4


def gap():
    """A sprocket's tooth gap."""
    half = np.radians(137.0 / 2)
    seat = {"cos_half_seat": np.cos(half), "sin_half_seat": np.sin(half), "half_pitch_tangent": np.tan(np.pi / TEETH)}
    return {"teeth": TEETH, "exact_radius": R, "pitch_radius": R, "clearance": CLEARANCE, "tip_reach": R + 0.05} | seat


@kernel
def gaps(
    points: wp.array[wp.vec2d],
    angles: wp.array[wp.float64],
    center: wp.vec2d,
    exact: wp.array[Sprocket],
    gear: wp.array[BLOCKS.Sprocket],
    seats: wp.array[wp.vec2d],
    split: wp.array[wp.vec4f],
    out: wp.array2d[wp.float64],
):
    i = wp.tid()
    x, y = pair_from_float64(points[i][0]), pair_from_float64(points[i][1])
    body = BodyState()
    body.angle = angles[i]
    body.center = center
    pose = blocks_pose(body, exact[0].exact_radius)
    p = wp.vec2d(float64_from_pair(x), float64_from_pair(y)) - center
    number, e, xi, lateral = tracked_seat(p, -1, pose_of(body), exact[0], seats)
    penetration, normal, relative = tooth_contact(p, wp.vec2d(), wp.float64(7.0), e, xi, lateral, exact[0])
    at = difference(vector(x, y), pose.center)
    found, e_found, xi_found, lateral_found = tracked_seat(at, -1, pose, gear[0], split)
    ours, facing, moving = tooth_contact(leading_value(at), wp.vec2f(), 7.0, e_found, xi_found, lateral_found, gear[0])
    out[i, 0] = wp.float64(wp.abs(found - number))
    out[i, 1] = wp.float64(ours) - penetration
    out[i, 2] = wp.float64(facing[0]) - normal[0]
    out[i, 3] = wp.float64(facing[1]) - normal[1]
    out[i, 4] = wp.float64(moving[0]) - relative[0]
    out[i, 5] = wp.float64(moving[1]) - relative[1]


def test_tooth_gaps_in_pairs_are_those_of_float64():
    generator = np.random.default_rng(2)
    count = 20_000
    seats = 2 * np.pi * np.arange(TEETH) / TEETH
    directions = np.stack([np.cos(seats), np.sin(seats)], axis=1)
    angles, number = generator.uniform(-50.0, 50.0, count), generator.integers(TEETH, size=count)
    center = np.array([1.2345678901, -0.0456789])
    away_by = 10.0 ** generator.uniform(-5, -2.5, count)  # from the seat [m]
    turn, at = generator.uniform(0, 2 * np.pi, count), angles + seats[number]
    points = center + np.stack(
        [R * np.cos(at) + away_by * np.cos(turn), R * np.sin(at) + away_by * np.sin(turn)], axis=1
    )
    inputs = [given(points, wp.vec2d), given(angles), wp.vec2d(*center), *both(Sprocket, **gap())]
    split = seat_directions(SimpleNamespace(seats=directions), True)
    tables = [given(directions, wp.vec2d), given(split, wp.vec4f)]
    found = np.abs(launched(gaps, count, *inputs, *tables, width=6))
    assert not found[:, 0].any()
    # the vector from the seat is off by 2^-37 of R and a few roundings of itself; clearance and direction round too
    assert (found[:, 1] <= 4 * 2.0**-37 * R + 8 * EPS * (away_by + CLEARANCE)).all()
    assert (found[:, 2:4] <= (2.0**-36 * R / away_by + 16 * EPS)[:, None]).all()
    assert found[:, 4:].max() <= 8 * EPS * 7.0 * (R + 0.01)


@kernel
def bars(points: wp.array[wp.vec2d], exact: wp.array[Guide], bar: wp.array[BLOCKS.Guide], out: wp.array2d[wp.float64]):
    i = wp.tid()
    x, y = pair_from_float64(points[i][0]), pair_from_float64(points[i][1])
    p = wp.vec2d(float64_from_pair(x), float64_from_pair(y)) - exact[0].start
    still = wp.vec2d()
    penetration, normal, relative = bar_contact(p, still, still, exact[0])
    at = difference(vector(x, y), bar[0].start)
    ours, facing, moving = bar_contact(at, wp.vec2f(), wp.vec2f(), bar[0])
    out[i, 0] = wp.float64(ours) - penetration
    out[i, 1] = wp.float64(facing[0]) - normal[0]
    out[i, 2] = wp.float64(facing[1]) - normal[1]


def bar():
    """A bar at both precisions."""
    size = {"length": 3.0, "end_radius": 0.25, "roller_radius": 0.03125}
    return both(Guide, start=(1.1, -0.3), direction=(np.cos(0.7), np.sin(0.7)), **size)


def test_guide_bars_in_pairs_are_those_of_float64():
    generator = np.random.default_rng(3)
    along, across = generator.uniform(-0.2, 3.2, 20_000), generator.uniform(-0.02, 0.0312, 20_000)
    t = np.array([np.cos(0.7), np.sin(0.7)])
    points = np.array([1.1, -0.3]) + along[:, None] * t + across[:, None] * np.array([-t[1], t[0]])
    found = np.abs(launched(bars, len(points), given(points, wp.vec2d), *bar(), width=3))
    flat = (along > 1e-6) & (along < 3.0 - 1e-6)
    # on the face the distance from it is rounded, a few times; over the ends the place along the bar too
    assert found[flat, 0].max() <= 4 * EPS * 0.0625
    assert found[:, 0].max() <= 8 * EPS * 0.5 + 4 * EPS * 3.2
    assert found[:, 1:].max() <= 16 * EPS * (1 + 3.2 / 0.25)


@kernel
def faces(
    points: wp.array[wp.vec2d],
    body: BodyState,
    exact: wp.array[Guide],
    guide: wp.array[BLOCKS.Guide],
    pieces: wp.array[Piece],
    rows: wp.array[BLOCKS.Piece],
    out: wp.array2d[wp.float64],
):
    i = wp.tid()
    x, y = pair_from_float64(points[i][0]), pair_from_float64(points[i][1])
    pose = pose_of(body)
    carrier = blocks_pose(body, wp.float64(0.0))
    q = frame_vector(wp.vec2d(float64_from_pair(x), float64_from_pair(y)) - pose.center, pose)
    number = tracked_piece(q, -1, exact[0], pieces)
    penetration, normal, beyond = profile_contact(q, number, exact[0], pieces)
    p = frame_vector(difference(vector(x, y), carrier.center), carrier)
    ours = tracked_piece(p, -1, guide[0], rows)
    deep, facing, past = profile_contact(p, ours, guide[0], rows)
    out[i, 0] = wp.float64(wp.abs(tracked_piece(p, wp.max(ours - 1, 0), guide[0], rows) - ours))
    out[i, 1] = wp.float64(wp.abs(ours - number))
    out[i, 2] = wp.float64(deep) - penetration
    out[i, 3] = wp.float64(facing[0]) - normal[0]
    out[i, 4] = wp.float64(facing[1]) - normal[1]


def test_profiles_in_pairs_are_those_of_float64():
    # an arc, a straight piece and a hollow one, on a body 4 m away that has turned by 0.4 rad; points over them all
    lengths, curvatures, heading = [0.15, 0.1, 0.2], [-4.0, 0.0, 2.5], 0.3
    pieces = np.zeros(len(lengths) + 2, dtype=Piece.numpy_dtype())
    generator, place, points = np.random.default_rng(5), np.array([0.21, -0.13]), []
    body = BodyState()
    body.angle, body.center = 0.4, wp.vec2d(3.9, 1.3)
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    for k, (length, curvature) in enumerate([*zip(lengths, curvatures, strict=True), (0.0, 0.0)], start=1):
        pieces[k]["start"], pieces[k]["direction"] = place, (np.cos(heading), np.sin(heading))
        pieces[k]["curvature"] = curvature
        for s, height in generator.uniform((1e-6, -0.004), (1.0 - 1e-6, 0.0039), (3000 * (length > 0), 2)):
            middle, over = heading + 0.5 * curvature * s * length, heading + curvature * s * length
            chord = s * length * np.sinc(0.5 * curvature * s * length / np.pi)
            foot = place + chord * np.array([np.cos(middle), np.sin(middle)])
            points.append(foot + height * np.array([-np.sin(over), np.cos(over)]))
        middle = heading + 0.5 * curvature * length
        place = place + length * np.sinc(0.5 * curvature * length / np.pi) * np.array([np.cos(middle), np.sin(middle)])
        heading += curvature * length
    points = np.array([3.9, 1.3]) + np.array(points) @ turn.T
    face = {"pieces": len(lengths), "first_piece": 1, "length": 0.5, "end_radius": 0.02, "roller_radius": 0.004}
    guides = both(Guide, **face)
    tables = both(Piece, len(pieces), **{name: pieces[name] for name in pieces.dtype.names})
    found = np.abs(launched(faces, len(points), given(points, wp.vec2d), body, *guides, *tables, width=5))
    assert not found[:, :2].any()
    # along and across a piece are rounded, and k u^2 / 2 <= 0.05 with what is made of them
    assert found[:, 2].max() <= 8 * EPS * 0.1
    assert found[:, 3:].max() <= 16 * EPS


@kernel
def led(
    motions: wp.array[Motion],
    ours: wp.array[BLOCKS.Motion],
    curves: Ensemble,
    rows: BLOCKS.Ensemble,
    h: wp.float64,
    every: int,
    out: wp.array2d[wp.float64],
):
    i = wp.tid()
    time = exact_multiple(i * every, h)
    angle, speed = prescribed_rotation(time, motions[0], curves)
    angle_found, speed_found = prescribed_rotation(exact_multiple(i * every, pair_from_float64(h)), ours[0], rows)
    out[i, 0] = float64_from_pair(angle_found) - angle
    out[i, 1] = wp.float64(speed_found) - speed
    load = load_moment(time, time, angle, speed, motions[1], curves)
    time_found = exact_multiple(i * every, pair_from_float64(h))
    found = load_moment(
        time_found,
        leading_value(time_found),
        pair_from_float64(angle),
        pair_from_float64(speed),
        ours[1],
        rows,
    )
    out[i, 2] = wp.float64(found) - load


@pytest.mark.parametrize("ramp", [0.0, 0.3])
def test_prescribed_angles_in_pairs(ramp):
    harmonics = np.array([[6.0, 0.002, 0.4], [0.5, 0.03, -1.0], [3.0, 2500.0, 0.7], [20.0, 400.0, 0.1]])
    rows = np.zeros(2, dtype=Motion.numpy_dtype())
    rows["sign"], rows["speed"], rows["ramp_time"], rows["start_angle"] = -1.0, 52.36, ramp, 0.123
    rows["prescribed"], rows["load"], rows["load_ramp_time"] = [1, 0], (9000.0, 50.0, 0.1), ramp
    rows["drive_harmonics"]["count"], rows["load_harmonics"]["first"], rows["load_harmonics"]["count"] = 2, 2, 2
    motions = both(Motion, 2, **{name: rows[name] for name in rows.dtype.names})
    curves, ours = Ensemble(), BLOCKS.Ensemble()
    curves.harmonics, curves.tables = given(harmonics, wp.vec3d), given(np.zeros(1))
    ours.harmonics = given(harmonic_rows(SimpleNamespace(harmonics=harmonics), True), wp.vec4f)
    ours.tables = wp.zeros(1, dtype=Pair, device="cpu")
    found = np.abs(launched(led, 20_000, *motions, curves, ours, 1.7e-6, 100, width=3))  # 3.4 s, 178 rad
    # amplitude, phase and the sine of the phase are float32: a / h of each times their rounding
    assert found[:, 0].max() <= 16 * EPS**2 * 178 + 3 * EPS * (0.002 / 6 + 0.03 / 0.5)
    assert found[:, 1].max() <= 8 * EPS * 52.36
    assert found[:, 2].max() <= 8 * EPS * 14_800  # all parts of the moment at once


@kernel
def tabled(
    points: wp.array[wp.float64],
    table: wp.array[Tabulated],
    ours: wp.array[BLOCKS.Tabulated],
    values: wp.array[wp.float64],
    pairs: wp.array[Pair],
    out: wp.array2d[wp.float64],
):
    i = wp.tid()
    value, integral = table_integral(points[i], table[0], values)
    found, way = table_integral(pair_from_float64(points[i]), ours[0], pairs)
    out[i, 0] = float64_from_pair(found) - value
    out[i, 1] = wp.float64(table_value(pair_from_float64(points[i]), ours[0], pairs)) - value
    out[i, 2] = float64_from_pair(way) - integral


@pytest.mark.parametrize("repeats", [0, 1])
def test_tables_in_pairs_are_those_of_float64(repeats):
    # a speed of 50 rad/s with a ripple, 40 cells of 0.7 rad; the points go beyond both ends, by a round and a half
    cells, first, start, spacing = 40, 5, -3.3, 0.7
    generator = np.random.default_rng(4)
    values = 50.0 + generator.uniform(-9.0, 9.0, (cells, 5))
    c0, c1, c2, c3 = values[:, :4].T
    each = spacing * (c0 + c1 / 2 + c2 / 3 + c3 / 4)
    values[:, 4] = np.append(0.0, np.cumsum(each)[:-1])
    flat = np.concatenate([np.zeros(5), values.ravel(), [each.sum()]])
    points = generator.uniform(start - 1.5 * cells * spacing, start + 2.5 * cells * spacing, 20_000)
    table = {"cells": cells, "first": first, "repeats": repeats, "start": start, "spacing": spacing}
    pairs = given(as_float32(flat, np.dtype(Pair.numpy_dtype())), Pair)
    inputs = [*both(Tabulated, **table), given(flat), pairs]
    found = np.abs(launched(tabled, len(points), given(points), *inputs, width=3))
    inside = np.abs((points - start) / spacing - np.rint((points - start) / spacing)) > 1e-9  # off the cells' edges,
    if not repeats:  # where these values jump
        inside |= (points < start) | (points > start + cells * spacing)
    largest, bit = 50.0 + 9.0 + 3 * 59.0, EPS**2
    assert found[inside, 0].max() <= 64 * bit * largest * cells  # the place in the table is rounded in cells
    assert found[inside, 1].max() <= 8 * EPS * largest
    assert found[inside, 2].max() <= 64 * bit * np.abs(each).sum() * 2.5


@kernel
def turning(moment: wp.float64, inverse_inertia: wp.float64, h: wp.float64, steps: int, out: wp.array2d[wp.float64]):
    pose = blocks_pose(BodyState(), wp.float64(0.4))
    motion = BLOCKS.Motion()
    rates = wp.vec3f(0.0, 0.0, wp.float32(moment) * wp.float32(inverse_inertia))
    step = wp.float32(h)
    nowhere = number_of(float(0.0))
    for _ in range(steps):
        body = BLOCKS.BodyState()
        body.angle = pose.angle
        body.speed = pose.speed
        moved = leapfrog_body(step, step, body, rates, nowhere, motion, BLOCKS.Mount())
        pose = turned_pose(pose_with_coordinates(pose, moved), difference(moved.angle, body.angle))
    out[0, 0] = float64_from_pair(pose.angle)
    out[0, 1] = float64_from_pair(pose.speed)
    sine, cosine = sine_cosine(float64_from_pair(pose.angle))
    out[0, 2] = float64_from_pair(pose.cosine) - cosine
    out[0, 3] = float64_from_pair(pose.sine) - sine
    out[0, 4] = float64_from_pair(pose.reach_cosine) - wp.float64(0.4) * float64_from_pair(pose.cosine)
    out[0, 5] = float64_from_pair(pose.reach_sine) - wp.float64(0.4) * float64_from_pair(pose.sine)


@pytest.mark.parametrize("steps", [32, 1_000_000])
def test_a_body_that_turns_freely_keeps_its_phase(steps):
    # constant moment from rest: speed a h n, angle a h^2 n (n + 1) / 2; float32 alone would have lost every increment
    h, moment = 2.0**-19, 100.0
    angle, speed, *off = launched(turning, 1, moment, 0.25, h, steps, width=6)[0]
    a = moment * 0.25
    assert speed == pytest.approx(a * h * steps, rel=1e-11)
    assert angle == pytest.approx(a * h * h * steps * (steps + 1) / 2, rel=1e-11)
    # turned step by step: at most a rounding of each turn, all one way; anew from the angle every 32 steps in a run
    turns = min(angle, a * h * h * steps * 1.0)
    assert np.abs(off[:2]).max() <= 2e-12 + 2 * EPS * (angle if steps > 32 else turns)
    assert np.abs(off[2:]).max() <= 2.0**-36 * 0.4


@kernel
def spinning(speed: wp.float64, rate: wp.float64, lag: wp.float64, inertia: wp.float64, out: wp.array2d[wp.float64]):
    body = BLOCKS.BodyState()
    body.speed = pair_from_float64(speed)
    motion, mount = BLOCKS.Motion(), BLOCKS.Mount()
    motion.inverse_inertia = wp.float32(wp.float64(1.0) / inertia)
    rates, now = wp.vec3f(0.0, 0.0, wp.float32(rate)), number_of(float(0.0))
    seen = body_at_time(now, wp.float32(lag), body, rates, float(0.0), motion, mount, BLOCKS.Ensemble())
    out[0, 0] = body_energy(wp.vec2f(), seen, wp.vec2f(), motion, mount)


def test_a_flywheels_energy_is_that_of_float64():
    # 2^-2 kg m^2 at 300 rad/s has 11 kJ, of which float32 would leave 7e-4 J over, as much as small losses
    speed, rate, lag = 300.0 + 1.0 / 3.0, 123.0, 2.0**-20
    exact = 0.125 * (speed + lag * rate) ** 2
    assert launched(spinning, 1, speed, rate, lag, 0.25, width=1)[0, 0] == pytest.approx(exact, rel=1e-13)


@kernel
def power_sums(speed: wp.array[wp.float32], moment: wp.array[wp.float32], out: wp.array2d[wp.float64]):
    sums = BLOCKS.SprocketSums()
    for k in range(speed.shape[0]):
        if k % 32 == 0:
            sums = gathered_sprocket_sums(sums)
        sums = add_powers(sums, speed[k], moment[k], -moment[k], 0.0, 1.0)
    sums = gathered_sprocket_sums(sums)
    out[0, 0] = float64_from_pair(sums.moment.sum)
    out[0, 1] = float64_from_pair(sums.contact_work.sum)
    out[0, 2] = float64_from_pair(sums.load_work.sum)


def test_moments_and_works_of_many_steps():
    generator = np.random.default_rng(5)
    speed, moment = generator.normal(12.0, 0.01, 100_005), generator.normal(5e3, 2e3, 100_005)
    speed, moment = (values.astype(np.float32).astype(float) for values in (speed, moment))
    found = launched(power_sums, 1, given(speed, wp.float32), given(moment, wp.float32), width=3)[0]
    exact = np.array([moment.sum(), (speed * moment).sum(), -(speed * moment).sum()])
    # each of 32 additions in a row, and a product, is rounded by EPS of up to 32 addends, one as often up as down
    assert np.abs(found / exact - 1.0).max() < 32 * EPS / np.sqrt(100_005 / 32)


@kernel
def twice_gathered(high: float, low: float, value: float, out: wp.array2d[wp.float64]):
    once, twice = BLOCKS.SprocketSums(), BLOCKS.SprocketSums()
    once.moment.sum = pair(high, low)
    twice.moment.sum = pair(high, low)
    twice = gathered_sprocket_sums(twice)
    once = gathered_sprocket_sums(add_powers(once, 1.0, value, 0.0, 0.0, 1.0))
    twice = gathered_sprocket_sums(add_powers(twice, 1.0, value, 0.0, 0.0, 1.0))
    out[0, 0] = float64_from_pair(once.moment.sum)
    out[0, 1] = float64_from_pair(twice.moment.sum)


@pytest.mark.parametrize("value", [0.1, 0.7, 1.3])
def test_sums_that_are_gathered_where_nothing_is_new_stay_as_they_are(value):
    """As at the end of a launch: with `low` half a unit of an odd `high`, another pair has the same value."""
    once, twice = launched(twice_gathered, 1, 1.0 + 2.0**-23, 2.0**-24, value, width=2)[0]
    assert once == twice


def each_of(kinds, usual, long):
    """Names of kinds; the compiler takes half a minute to a minute and a half for each."""
    return some_of(*([(name,) for name in names] for names in (kinds, usual, long)))


kind, WARPS, RUBS = partial(BlockKind, wp.float32), BlockShape(32, 4), Friction(BY_SPEED, BY_SPEED)
ON_ARM = Parts(2, 1, arms=1, tensioners=1)
LOOPS = {
    "plain": kind(WARPS, Parts(2, 0), linear_hysteretic=True),
    "friction": kind(BlockShape(32, 6), Parts(2, 1), friction=RUBS, links="varied"),
    "few": kind(BlockShape(160, 1), Parts(2, 1)),
    "tables, profiles": kind(WARPS, Parts(2, 2), profiles=True, friction=Friction(BY_SPEED)),
    "arm, moving": kind(WARPS, ON_ARM, moving=True, profiles=True),
    "pushed, rk4": kind(WARPS, Parts(2, 0, tensioners=1), integrator=1, moving=True),
    "shafts": kind(WARPS, Parts(2, 0, other_bodies=3, tied=1, geared=1)),
}
"""Each has what others lack; together they have all that drives may have."""


@pytest.mark.parametrize("name", each_of(LOOPS, [], ["few", "pushed, rk4", "arm, moving"]))
def test_no_float64_in_the_time_loop_at_float32(tmp_path, name):
    every, loop = time_loop(compiled(block_kernel(LOOPS[name], 16, DEFAULT_FRAME), tmp_path))
    assert len(loop) > 0.4 * len(every)  # the time loop, not one of those before and after it
    assert not float64_arithmetic(loop)
    assert not contractible(every)
    # what is read from the state and the ensemble before, and goes back after
    kinds = float64_arithmetic(every)
    assert sum(kinds.values()) < 200, kinds
    assert not any(name.startswith(("mul", "fma", "div", "sqrt")) for name in kinds), kinds


MEASURING = {
    "plain": kind(WARPS, Parts(2, 0), measuring=True),
    "friction": kind(BlockShape(32, 6), Parts(2, 1), measuring=True, friction=RUBS),
    "arm": kind(WARPS, ON_ARM, measuring=True, profiles=True),
    "rk4": kind(WARPS, Parts(2, 0), measuring=True, integrator=1),
}


@pytest.mark.parametrize("name", each_of(MEASURING, [], ["plain"]))
def test_metrics_at_float32_take_float64_at_looks_and_ends_only(tmp_path, name):
    ptx = compiled(block_kernel(MEASURING[name], 12, DEFAULT_FRAME), tmp_path)
    every, loop = time_loop(ptx)
    free, branches = loop_without_float64(ptx)
    # contacts' sums, forces and all of the motion are in what goes around without float64
    assert len(free) > 0.7 * len(loop)
    assert sum("rsqrt" in line or "sqrt" in line for line in free) > 3
    if not MEASURING[name].has_stages and not MEASURING[name].profiles:
        # of the two steps in the code the one that nearly all are has none at all
        common = largest_part_without_float64(ptx)
        assert len(common) > 0.2 * len(loop)  # whose other step and looks are drawn in, too
        assert sum("rsqrt" in line or "sqrt" in line for line in common) > 3
    # beside it: what is merged every 32 steps, looks, and at the window's ends the energies of rollers, by their own
    # masses, of bodies and tensioners, and what these have metered
    counts = sorted(sum(float64_arithmetic(branch).values()) for branch in branches)
    arms = MEASURING[name].parts.arms
    assert len(counts) <= 3 + 2 * arms and counts[-1] <= 180 and sum(counts[:-1]) <= 42 + 40 * arms, counts


@wp.kernel(enable_backward=False, module="unique")
def sums_of_roots(values: wp.array[wp.float32], looks: wp.array[wp.float64], out: wp.array[wp.float32]):
    total = wp.float32(0.0)
    for i in range(values.shape[0]):
        total += wp.sqrt(values[i])
        if i % 32 == 31:
            looks[i // 32] = wp.sqrt(wp.float64(values[i]) + wp.float64(total))
    out[0] = total


def test_float64_is_found_where_it_is(tmp_path):
    """Every 32nd time around: two conversions, a sum and a root, however often the loop is unrolled."""
    ptx = compiled(sums_of_roots, tmp_path)
    every, loop = time_loop(ptx)
    counts = float64_arithmetic(loop)
    sums = sum(count for name, count in counts.items() if name.startswith("add"))
    assert sums > 0 and sum(counts.values()) == 4 * sums, counts
    assert float64_arithmetic(every) == counts
    free, branches = loop_without_float64(ptx)
    assert any("sqrt" in line for line in free) and not float64_arithmetic(free)
    assert sum(sum(float64_arithmetic(branch).values()) for branch in branches) == 4 * sums
