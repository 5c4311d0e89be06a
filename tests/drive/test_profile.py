"""Faces of guides: continuity, places, heights and offsets against the geometry of circles and lines."""

import math
from itertools import pairwise

import numpy as np
import pytest

from warpchain.drive.face_profile import Piece, Profile, ProfileError, arcs, make_profile, rounded, straight, turn

BLADE = [(0.10, 0.30), (0.13, 0.22), (0.12, 0.12)]
QUARTER = ((0, 0), 0.2, math.pi, math.pi / 2)
EXACT = 1e-13  # [m, rad]: rounding of a few operations on numbers below 1


FACES = {
    "bar": straight((0.1, 0.2), (0.4, -0.1)),
    "blade": rounded(BLADE, 0.25),
    "bend": rounded([(0.0, 0.0), (0.3, 0.0), (0.5, 0.2), (0.9, 0.2)], 0.1),
    "arcs": arcs([((0.0, 0.0), 0.2, math.pi, math.pi / 2), ((0.1, 0.5), 0.3, -math.pi / 2, 0.0)]),
}


@pytest.fixture(params=[(name, side) for name in FACES for side in ("left", "right")], ids="-".join)
def profile(request):
    name, side = request.param
    return make_profile(FACES[name], 0.02, side)


def test_pieces_join_in_place_and_heading(profile):
    for a, b in pairwise(profile.pieces):
        assert math.dist(a.end, b.start) < EXACT
        assert abs(turn(b.heading - a.end_heading)) < EXACT


def test_ends_are_convex_quarters(profile):
    for cap in (profile.pieces[0], profile.pieces[-1]):
        assert cap.curvature == pytest.approx(-1 / 0.02) and cap.length == pytest.approx(0.02 * math.pi / 2)
    assert profile.end_radius == pytest.approx(0.02)


def test_places_count_from_the_beginning_of_the_face(profile):
    assert profile.places[0] == -profile.pieces[0].length and profile.places[1] == 0.0
    assert profile.face_length == pytest.approx(sum(piece.length for piece in profile.face), rel=1e-15)
    for place, piece in zip(profile.places, profile.pieces, strict=True):
        point, heading = profile.at(place)
        assert math.dist(point, piece.start) < EXACT and abs(turn(heading - piece.heading)) < EXACT


def test_place_and_height_are_those_from_which_a_point_was_made(profile):
    """Below the smallest radius of curvature on the face every point has one foot: (a) and (b) find it."""
    for height in (-0.01, 1e-12, 0.004, 0.05):
        for s in np.linspace(profile.places[1], profile.face_length, 41)[1:-1]:
            (x, y), heading = profile.at(s)
            point = (x - height * math.sin(heading), y + height * math.cos(heading))
            assert profile.locate(point) == pytest.approx((s, height), abs=1e-12)


def test_the_chain_rides_on_the_left_of_the_pieces_whatever_the_side():
    """Above a bar to the right is its left; the other side runs the other way, from its end."""
    left, right = (make_profile(straight((0.0, 0.0), (1.0, 0.0)), 0.1, side) for side in ("left", "right"))
    assert left.locate((0.25, 0.02)) == pytest.approx((0.25, 0.02))
    assert right.locate((0.25, -0.02)) == pytest.approx((0.75, 0.02))
    assert (left.reversed, right.reversed) == (False, True) and left.straight and right.straight


def test_beyond_the_ends_there_is_nothing():
    profile = make_profile(straight((0.0, 0.0), (1.0, 0.0)), 0.1)
    assert profile.locate((1.05, 0.02)) == pytest.approx((1.0 + 0.1 * math.atan2(0.05, 0.12), 0.13 - 0.1))
    assert profile.locate((1.2, -0.2)) is None and profile.locate((-0.2, -0.2)) is None


def test_a_rounded_corner_touches_both_sides():
    """Two sides at a right angle, radius R: the arc begins R before the corner and is a quarter of 2 pi R long."""
    first, bend, last = rounded([(0.0, 0.0), (0.3, 0.0), (0.3, 0.5)], 0.1)
    assert (first.length, bend.length, last.length) == pytest.approx((0.2, 0.1 * math.pi / 2, 0.4), abs=EXACT)
    assert bend.curvature == 10.0 and bend.start == pytest.approx((0.2, 0.0)) and last.end == pytest.approx((0.3, 0.5))


def test_arcs_that_only_share_a_tangent_are_joined_by_a_straight_piece():
    first, between, last = arcs([QUARTER, ((0.3, 0), 0.2, math.pi / 2, 0)])
    assert (first.curvature, between.curvature, last.curvature) == (-5.0, 0.0, -5.0)
    assert between.length == pytest.approx(0.3) and last.end == pytest.approx((0.5, 0.0))


def test_roller_centers_are_at_the_offset(profile):
    """The offset curve of an arc of radius R is one of R + offset (convex) or R - offset: its length follows."""
    offset, spacing = 0.004, 1e-4
    centers = profile.offset_points(offset, spacing, caps=False)
    length = np.linalg.norm(np.diff(centers, axis=0), axis=1).sum()
    expected = sum(piece.length * (1 - offset * piece.curvature) for piece in profile.face)
    assert length == pytest.approx(expected, rel=1e-6)  # chords are short by (spacing k)^2 / 24
    assert all(profile.locate(center)[1] == pytest.approx(offset, abs=EXACT) for center in centers[1:-1])
    feet = profile.points(spacing)
    assert np.linalg.norm(np.diff(feet, axis=0), axis=1).max() <= spacing * (1 + 1e-9)
    assert feet[0] == pytest.approx(profile.pieces[0].start) and feet[-1] == pytest.approx(profile.pieces[-1].end)


def test_a_nearly_straight_piece_loses_nothing():
    """A curvature of 1e-9 1/m bends 0.1 m by 5e-12 m: height and place are those of the line but for that."""
    piece = Piece((0.3, 0.1), 0.7, 1e-9, 0.2)
    (x, y), heading = piece.at(0.1)
    point = (x - 1e-3 * math.sin(heading), y + 1e-3 * math.cos(heading))
    assert piece.place_and_height(point) == pytest.approx((0.1, 1e-3), abs=1e-15)
    line = Piece(piece.start, piece.heading, 0.0, 0.2)
    assert line.place_and_height(point)[1] - 1e-3 == pytest.approx(5e-12, abs=1e-15)


@pytest.mark.parametrize(
    ("make", "index", "text"),
    [
        (lambda: rounded([(0, 0), (1, 0), (1, 0)], 0.1), 2, "another point than the one before"),
        (lambda: rounded([(0, 0), (1, 0), (1, 0.3)], 0.4), 1, "need 0.4 m of the 0.3 m between points 1 and 2"),
        (lambda: rounded([(0, 0), (1, 0), (1, 0.3), (2, 0.3)], 0.2), 2, "no room for radius 0.2"),
        (lambda: arcs([QUARTER, ((0, 0.01), 0.2, math.pi / 2, 0)]), 1, "begins 0.01 m from the end of the arc before"),
        (lambda: arcs([QUARTER, ((0, 0), 0.2, math.pi / 2 - 0.1, 0)]), 1, "turns by -5.73 degrees against the end of"),
    ],
    ids=["same", "short", "two corners", "apart", "kink"],
)
def test_what_cannot_be_drawn_is_told(make, index, text):
    with pytest.raises(ProfileError, match=text) as caught:
        make()
    assert caught.value.index == index


def test_a_profile_is_a_value():
    assert make_profile(straight((0, 0), (1, 0)), 0.1) == make_profile(straight((0, 0), (1, 0)), 0.1)
    assert isinstance(make_profile(straight((0, 0), (1, 0)), 0.1), Profile)
