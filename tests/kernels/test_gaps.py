"""Tooth gap and guide-bar geometry against the curves written out in numpy, and their continuity."""

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel

from warpchain.kernels.physics.guide import guide_gap
from warpchain.kernels.physics.tooth import nearest_seat, seat_step, straight_flank_gap, tooth_gap
from warpchain.kernels.structs import types

KINDS, SINGLE = types(wp.float64), types(wp.float32)


@kernel
def tooth_gaps(points: wp.array[wp.vec2d], gap: KINDS.Sprocket, out: wp.array[wp.vec3d]):
    i = wp.tid()
    penetration, radial, lateral = tooth_gap(points[i][0] - gap.pitch_radius, points[i][1], gap)
    out[i] = wp.vec3d(penetration, radial, lateral)


@kernel
def single_gap(xi: wp.float32, lateral: wp.float32, gap: SINGLE.Sprocket, out: wp.array[wp.float32]):
    penetration, radial, along = tooth_gap(xi, lateral, gap)
    out[0] = penetration


@kernel
def usual_gaps(points: wp.array[wp.vec2d], gap: KINDS.Sprocket, out: wp.array[wp.vec4d]):
    i = wp.tid()
    penetration, radial, lateral, usual = straight_flank_gap(points[i][0] - gap.pitch_radius, points[i][1], gap)
    out[i] = wp.vec4d(penetration, radial, lateral, wp.float64(usual))


@kernel
def guide_gaps(points: wp.array[wp.vec2d], bar: KINDS.Guide, out: wp.array[wp.vec3d]):
    i = wp.tid()
    penetration, along, across = guide_gap(points[i][0], points[i][1], bar)
    out[i] = wp.vec3d(penetration, along, across)


@kernel
def seats(points: wp.array[wp.vec2d], angle: wp.float64, teeth: int, out: wp.array[int]):
    i = wp.tid()
    out[i] = nearest_seat(points[i], wp.cos(angle), wp.sin(angle), teeth)


@kernel
def moves(points: wp.array[wp.vec2d], tangent: wp.float64, out: wp.array[int]):
    i = wp.tid()
    out[i] = seat_step(points[i][0], points[i][1], tangent)


def launch(kernel, points, *parameters, dtype=wp.vec3d):
    source = wp.array(np.asarray(points, dtype=float), dtype=wp.vec2d, device="cpu")
    fill = np.full((len(points), dtype._length_) if dtype in (wp.vec3d, wp.vec4d) else len(points), -999)
    out = wp.array(fill, dtype=dtype, device="cpu")
    wp.launch(kernel, dim=len(points), inputs=[source, *parameters, out], device="cpu")
    return out.numpy()


R, P, RR, CLEARANCE, HALF = 0.4, 0.1, 0.03, 2e-4, np.radians(137.0 / 2)


def sprocket():
    gap = KINDS.Sprocket()
    gap.pitch_radius, gap.clearance = R, CLEARANCE
    gap.cos_half_seat, gap.sin_half_seat = np.cos(HALF), np.sin(HALF)
    gap.tip_reach = R + (P - 2 * RR) / 2 + RR
    return gap


RE = 0.12 * 2 * RR * 27  # a convex flank as large as that of 25 teeth


def convex():
    gap = sprocket()
    gap.flank_curvature = 1 / (RE + RR)
    return gap


SHAPES = {"straight": sprocket, "convex": convex}


def curve(radial, lateral, shape):
    """Model of the offset curve, in plain numpy; a convex flank is an arc about f, written out."""
    q = np.array([radial - R, lateral])
    xi, eta = q[0], abs(lateral)
    side = 1.0 if lateral >= 0 else -1.0
    if eta * np.cos(HALF) <= -xi * np.sin(HALF):
        pen, normal = np.hypot(*q) - CLEARANCE, -q / np.hypot(*q)
    elif shape == "straight":
        pen = eta * np.sin(HALF) - xi * np.cos(HALF) - CLEARANCE
        normal = np.array([np.cos(HALF), -side * np.sin(HALF)])
    else:
        f = (CLEARANCE + RR + RE) * np.array([-np.cos(HALF), np.sin(HALF)])  # R_seat + re = Rc + Rr + re
        h = np.array([xi, eta]) - f
        pen, normal = RE + RR - np.hypot(*h), h / np.hypot(*h) * [1, side]
    r = np.array([radial, lateral])
    tip = R + (P - 2 * RR) / 2 + RR - np.hypot(*r)
    if pen > 0 and tip < pen:
        pen, normal = tip, r / np.hypot(*r)
    return np.array([pen, *normal])


def scattered(seed):
    """Points all over a gap, half of them near its seat."""
    rng = np.random.default_rng(seed)
    points = np.stack([rng.uniform(R - P / 2, R + P / 2, 4000), rng.uniform(-P / 2, P / 2, 4000)], axis=1)
    points[:2000] = [R, 0] + rng.normal(scale=5e-4, size=(2000, 2))
    return points


@pytest.mark.parametrize(("shape", "seed", "rounding"), [("straight", 1, 1e-14), ("convex", 5, 1e-13)])
def test_tooth_gap_is_the_offset_curve(shape, seed, rounding):
    points = scattered(seed)
    expected = np.array([curve(*point, shape) for point in points])
    np.testing.assert_allclose(launch(tooth_gaps, points, SHAPES[shape]()), expected, atol=rounding)


def test_usual_gap_is_the_tooth_gap_and_says_where():
    points = scattered(12)
    for gap in (sprocket(), convex()):
        found, expected = launch(usual_gaps, points, gap, dtype=wp.vec4d), launch(tooth_gaps, points, gap)
        usual = found[:, 3] == 1.0
        # the same operations, but that the compiler may draw other products into sums
        np.testing.assert_allclose(found[usual, :3], expected[usual], atol=1e-15)
        q = points - [R, 0.0]
        in_arc = np.abs(q[:, 1]) * np.cos(HALF) <= -q[:, 0] * np.sin(HALF)
        on_tip = (found[:, 0] > 0) & (np.hypot(*points.T) > gap.tip_reach - found[:, 0])
        np.testing.assert_array_equal(usual, ~on_tip & (in_arc | (gap.flank_curvature == 0.0)))
        assert 1000 < usual.sum() < 4000


@pytest.mark.parametrize(("shape", "seed"), [("straight", 2), ("convex", 6)])
def test_tooth_gap_penetration_is_continuous_with_slope_one(shape, seed):
    # along any line the penetration changes by at most the distance gone: |grad pen| = 1, no jump (model's reason
    # for the flank)
    gap = SHAPES[shape]()
    rng = np.random.default_rng(seed)
    start = np.stack([rng.uniform(R - P / 3, R + P / 3, 400), rng.uniform(-P / 2, P / 2, 400)], axis=1)
    ends = start + rng.normal(scale=1e-6, size=start.shape)
    before, after = launch(tooth_gaps, start, gap)[:, 0], launch(tooth_gaps, ends, gap)[:, 0]
    both = (before > 0) & (after > 0)
    assert both.sum() > 100
    assert (np.abs(after - before)[both] <= np.hypot(*(ends - start).T)[both] * (1 + 1e-9) + 1e-16).all()


def test_normals_are_unit_and_mirror():
    rng = np.random.default_rng(3)
    points = np.stack([rng.uniform(R - P / 2, R + P / 2, 500), rng.uniform(1e-6, P / 2, 500)], axis=1)
    here, mirrored = launch(tooth_gaps, points, sprocket()), launch(tooth_gaps, points * [1, -1], sprocket())
    np.testing.assert_allclose(np.hypot(here[:, 1], here[:, 2]), 1.0, atol=1e-12)
    np.testing.assert_allclose(mirrored, here * [1, 1, -1], atol=1e-14)


@pytest.mark.parametrize("teeth", [5, 30, 57])
def test_nearest_seat_and_its_step(teeth):
    rng = np.random.default_rng(teeth)
    angle, where = 0.7, rng.uniform(-4 * np.pi, 4 * np.pi, 500)
    points = R * np.stack([np.cos(where), np.sin(where)], axis=1)
    expected = np.rint((where - angle) * teeth / (2 * np.pi)).astype(int) % teeth
    assert (launch(seats, points, angle, teeth, dtype=wp.int32) == expected).all()
    # in a seat's own frame the neighbor is nearer beyond half a tooth
    local = rng.uniform(-np.pi / teeth * 1.9, np.pi / teeth * 1.9, 500)
    frame = R * np.stack([np.cos(local), np.sin(local)], axis=1)
    expected = np.rint(local * teeth / (2 * np.pi)).astype(int)
    assert (launch(moves, frame, np.tan(np.pi / teeth), dtype=wp.int32) == expected).all()


LENGTH, RG = 1.2, 0.3


def bar():
    guide = KINDS.Guide()
    guide.length, guide.end_radius, guide.roller_radius = LENGTH, RG, RR
    return guide


def guide_curve(along, across):
    """Conditions A, B and C in the bar's own frame: a at the origin, t = (1, 0), n = (0, 1)."""
    if 0 <= along <= LENGTH:
        return (RR - across, 0.0, 1.0) if -RG < across < RR else (0.0, 0.0, 1.0)
    center = np.array([0.0 if along < 0 else LENGTH, -RG])
    h = np.array([along, across]) - center
    if h[1] <= 0:
        return (0.0, 0.0, 1.0)
    return (RR + RG - np.hypot(*h), *(h / np.hypot(*h)))


def test_guide_gap_is_conditions_a_b_and_c():
    rng = np.random.default_rng(4)
    points = np.stack([rng.uniform(-0.5, LENGTH + 0.5, 4000), rng.uniform(-0.4, 0.1, 4000)], axis=1)
    found = launch(guide_gaps, points, bar())
    expected = np.array([guide_curve(*point) for point in points])
    np.testing.assert_array_equal(found[:, 0] > 0, expected[:, 0] > 0)
    touching = expected[:, 0] > 0
    assert touching.sum() > 200
    np.testing.assert_allclose(found[touching], expected[touching], atol=1e-14)


def test_guide_gap_is_continuous_where_flat_and_end_meet():
    for edge in (0.0, LENGTH):
        points = [(edge - 1e-9, 0.01), (edge, 0.01), (edge + 1e-9, 0.01)]
        found = launch(guide_gaps, points, bar())
        assert np.ptp(found[:, 0]) < 1e-9


def test_convex_gap_is_continuous_with_its_normal():
    # points on the offset curve on both sides of where arc and flank meet: penetration and normal change by no more
    # than the distance, and the distance times the larger curvature
    junction = np.array([R - CLEARANCE * np.cos(HALF), CLEARANCE * np.sin(HALF)])
    along = np.array([np.sin(HALF), np.cos(HALF)])
    points = [junction - 1e-9 * along, junction + 1e-9 * along]
    before, after = launch(tooth_gaps, points, convex())
    assert abs(before[0]) < 1e-14 and abs(after[0]) < 1e-14
    assert np.abs(after - before)[1:].max() < 2e-9 / CLEARANCE


def test_a_flank_of_huge_radius_is_the_straight_one():
    gap = sprocket()
    gap.flank_curvature = 1e-12
    rng = np.random.default_rng(7)
    points = [R, 0] + rng.normal(scale=5e-4, size=(500, 2))
    np.testing.assert_allclose(launch(tooth_gaps, points, gap), launch(tooth_gaps, points, sprocket()), atol=1e-12)


def test_single_precision_keeps_the_penetration_on_a_large_flank():
    # 57 teeth of 72B: re = 2 m; what is left of meters must be good to a part of the micrometer
    gap = SINGLE.Sprocket()
    gap.pitch_radius, gap.clearance, gap.flank_curvature, gap.tip_reach = R, CLEARANCE, 0.5, 2 * R
    gap.cos_half_seat, gap.sin_half_seat = np.cos(HALF), np.sin(HALF)
    out = wp.zeros(1, dtype=wp.float32, device="cpu")
    xi, eta = 1e-4, 1e-3
    wp.launch(single_gap, dim=1, inputs=[xi, eta, gap, out], device="cpu")
    h = np.array([xi, eta]) - (CLEARANCE + 2.0) * np.array([-np.cos(HALF), np.sin(HALF)])
    assert out.numpy()[0] == pytest.approx(2.0 - np.hypot(*h), rel=1e-6)
