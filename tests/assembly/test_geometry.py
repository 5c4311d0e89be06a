"""The chain's path against closed forms of belts on pulleys, and its invariants on random layouts."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from layouts import PITCH, Placed, drive_of, loops, tangles

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.path import MAX_STRAIN, check_fit
from warpchain.errors import DriveError
from warpchain.model import single_chain

pytestmark = pytest.mark.filterwarnings("ignore:chain.links:UserWarning")  # any number that fits, odd ones too


def path_of(sprockets, links=100):
    return chain_path(single_chain(drive_of(sprockets, links)))


def path_or_reject(sprockets):
    try:
        return path_of(sprockets)
    except DriveError:
        assume(False)


def test_open_pair():
    big, small = Placed(40, (0.0, 0.0)), Placed(17, (0.5, 0.1))
    path = path_of([big, small])
    distance = math.hypot(0.5, 0.1)
    lean = math.asin((big.radius - small.radius) / distance)
    np.testing.assert_allclose(
        path.strand_length, math.sqrt(distance**2 - (big.radius - small.radius) ** 2), rtol=1e-14
    )
    np.testing.assert_allclose(path.wrap_angle, [math.pi + 2 * lean, math.pi - 2 * lean], rtol=1e-14)
    assert path.turning == 2 * math.pi


@pytest.mark.parametrize("wraps", [("ccw", "cw"), ("cw", "ccw")])
def test_crossed_pair(wraps):
    big, small = Placed(40, (0.0, 0.0), wraps[0]), Placed(17, (-0.3, 0.4), wraps[1])
    path = path_of([big, small])
    reach = big.radius + small.radius
    np.testing.assert_allclose(path.strand_length, math.sqrt(0.5**2 - reach**2), rtol=1e-14)
    np.testing.assert_allclose(path.wrap_angle, math.pi + 2 * math.asin(reach / 0.5), rtol=1e-14)
    assert path.turning == 0.0


def test_equal_sprockets_and_tangent_points():
    sprockets = [Placed(20, (0.0, 0.0)), Placed(20, (20 * PITCH, 0.0))]
    path = path_of(sprockets, 60)
    radius = sprockets[0].radius
    np.testing.assert_allclose(path.strand_start, [[0.0, -radius], [20 * PITCH, radius]], atol=1e-15)
    np.testing.assert_allclose(path.strand_end, [[20 * PITCH, -radius], [0.0, radius]], atol=1e-15)
    np.testing.assert_allclose(path.arrival_angle % (2 * math.pi), [math.pi / 2, 3 * math.pi / 2], rtol=1e-14)
    assert path.nominal_strain == pytest.approx(0.0, abs=1e-14)
    assert path.strain(61) == pytest.approx(40 / 41 - 1, rel=1e-12)
    assert path.wrapped_pitches == pytest.approx(20.0, rel=1e-14)
    assert path.strain(20) == math.inf
    assert path.fitting_links() == (59, 60, 61, 62)  # 40 / 38.1 to 40 / 42.1


def test_equal_triangle():
    side, teeth = 0.4, 24
    centers = [(0.0, 0.0), (side, 0.0), (side / 2, side * math.sqrt(3) / 2)]
    for wrap, order, turning in (("ccw", 1, 2 * math.pi), ("cw", -1, -2 * math.pi)):
        path = path_of([Placed(teeth, center, wrap) for center in centers[::order]])
        np.testing.assert_allclose(path.wrap_angle, 2 * math.pi / 3, rtol=1e-13)
        np.testing.assert_allclose(path.strand_length, side, rtol=1e-14)
        assert path.turning == turning


@given(tangles())
def test_tangents(sprockets):
    path = path_or_reject(sprockets)
    signs = np.array([1.0 if sprocket.wrap == "ccw" else -1.0 for sprocket in sprockets])
    centers = np.array([sprocket.center for sprocket in sprockets])
    direction = (path.strand_end - path.strand_start) / path.strand_length[:, None]
    np.testing.assert_allclose(np.hypot(*direction.T), 1.0, rtol=1e-12)
    left = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    for shift, point in ((0, path.strand_start), (-1, path.strand_end)):
        arm = np.roll(centers, shift, axis=0) - point  # to the sprocket: left of travel where it turns the chain ccw
        reach = np.roll(signs * path.radius, shift)
        np.testing.assert_allclose(np.einsum("ij,ij->i", arm, left), reach, rtol=1e-12)
        np.testing.assert_allclose(np.einsum("ij,ij->i", arm, direction), 0.0, atol=1e-13)


@given(tangles())
def test_wraps_join_the_tangent_points(sprockets):
    path = path_or_reject(sprockets)
    signs = np.array([1.0 if sprocket.wrap == "ccw" else -1.0 for sprocket in sprockets])
    for s, sprocket in enumerate(sprockets):
        for angle, point in (
            (path.arrival_angle[s], path.strand_end[s - 1]),
            (path.arrival_angle[s] + signs[s] * path.wrap_angle[s], path.strand_start[s]),
        ):
            expected = np.add(sprocket.center, sprocket.radius * np.array([math.cos(angle), math.sin(angle)]))
            np.testing.assert_allclose(point, expected, atol=1e-12)
    assert np.all((path.wrap_angle > 0.0) & (path.wrap_angle < 2 * math.pi))
    assert np.sum(signs * path.wrap_angle) == pytest.approx(path.turning, abs=1e-9)


@given(loops())
def test_simple_loops_turn_once(sprockets):
    path = path_or_reject(sprockets)
    starts = path.strand_start
    area = np.sum(starts[:, 0] * np.roll(path.strand_end[:, 1], 0) - starts[:, 1] * path.strand_end[:, 0])
    if len(sprockets) > 2:  # the tangent points' own area tells the direction
        assert path.turning == pytest.approx(math.copysign(2 * math.pi, area))
    assert abs(path.turning) == 2 * math.pi


@given(loops())
def test_strain_solves_the_nominal_equation(sprockets):
    path = path_or_reject(sprockets)
    for links in path.fitting_links():
        strain = path.strain(links)
        sprocket_pitches = sum(
            path.wrap_angle[s] * sprocket.teeth / (2 * math.pi) for s, sprocket in enumerate(sprockets)
        )
        assert sprocket_pitches + path.strand_length.sum() / (PITCH * (1 + strain)) == pytest.approx(links, rel=1e-12)
        assert abs(strain) <= MAX_STRAIN


@pytest.mark.parametrize("wrap", ["ccw", "cw"])
def test_overlapping_pitch_circles(wrap):
    sprockets = [Placed(40, (0.0, 0.0)), Placed(30, (0.5, 0.0)), Placed(30, (0.6, 0.0), wrap)]
    with pytest.raises(DriveError, match='sprockets "s1" and "s2": pitch circles overlap') as failure:
        path_of(sprockets)
    assert f"{2 * sprockets[1].radius:.6g} m" in str(failure.value)
    assert "\n" not in str(failure.value)


def test_tightener_that_misses_the_chain():
    sprockets = [Placed(20, (0.0, 0.0)), Placed(20, (0.6, 0.0))]
    height = sprockets[0].radius + Placed(12, (0.0, 0.0)).radius
    path = path_of([*sprockets, Placed(12, (0.3, height - 0.01), "cw")])
    assert path.wrap_angle[2] < 0.1
    with pytest.raises(DriveError, match='sprocket "s2": with wrap = "cw" the chain turns 35') as failure:
        path_of([*sprockets, Placed(12, (0.3, height + 0.01), "cw")])
    assert "\n" not in str(failure.value)


def test_misfit_of_a_path_that_crosses_itself():
    drive = drive_of([Placed(20, (0.0, 0.0)), Placed(20, (0.6, 0.0)), Placed(12, (0.3, 0.2), "cw")], 116)
    path = chain_path(single_chain(drive))
    assert path.turning == 0.0
    with pytest.raises(
        DriveError, match=r"the path crosses itself, turning 313\.4 degrees around sprocket .s2."
    ) as failure:
        check_fit(single_chain(drive), path)
    assert "\n" not in str(failure.value)


def test_strand_through_a_sprocket():
    sprockets = [
        Placed(20, (0.0, 0.0)),
        Placed(20, (0.6, 0.0)),
        Placed(20, (0.6, 0.6)),
        Placed(20, (0.3, -0.04), "ccw"),
    ]
    with pytest.raises(DriveError, match='strand "s0->s1": passes through the pitch circle of sprocket "s3"'):
        path_of(sprockets)


def test_misfit_names_what_fits():
    sprockets = [Placed(20, (0.0, 0.0)), Placed(20, (20 * PITCH, 0.0))]
    for links, strain in ((66, f"{100 * (40 / 46 - 1):+.3f} %"), (15, "too short to go round")):
        drive = drive_of(sprockets, links)
        with pytest.raises(DriveError) as failure:
            check_fit(single_chain(drive), chain_path(single_chain(drive)))
        message = str(failure.value)
        assert message.startswith(f"chain.links = {links}: does not fit the path, strain {strain}")
        assert "59 to 62, best 60" in message
        assert f"59: {100 * (40 / 39 - 1):+.3f} %, 60: " in message
        assert f"61: {100 * (40 / 41 - 1):+.3f} %" in message
        assert "\n" not in message


def test_misfit_where_nothing_fits():
    sprockets = [Placed(9, (0.0, 0.0)), Placed(9, (3.55 * PITCH, 0.0))]  # 9 + 7.1 pitches: 16 or 17 links
    path = path_of(sprockets)
    assert path.fitting_links() == (16,)
    sprockets = [Placed(9, (0.0, 0.0)), Placed(9, (3.25 * PITCH, 0.0))]  # 9 + 6.5 pitches
    drive = drive_of(sprockets, 15)
    assert chain_path(single_chain(drive)).fitting_links() == ()
    with pytest.raises(DriveError, match="links that fit: none"):
        check_fit(single_chain(drive), chain_path(single_chain(drive)))
