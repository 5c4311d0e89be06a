"""Faces of guides against the geometry of circles and lines; measured ones, as biarcs that follow their points."""

import math
import os
from itertools import pairwise

import numpy as np
import pytest

from warpchain import load_drive
from warpchain.drive import dumps_drive, loads_drive
from warpchain.drive.biarcs import TOLERANCE, biarc, fitted_face
from warpchain.drive.examples import drive_path
from warpchain.drive.face_profile import (
    Piece,
    Profile,
    ProfileError,
    arc_face,
    make_profile,
    rounded_face,
    straight_face,
    wrapped_angle,
)
from warpchain.errors import DriveError
from warpchain.model import single_chain

BLADE = [(0.10, 0.30), (0.13, 0.22), (0.12, 0.12)]
BEFORE, QUARTER = "the end of the arc before", ((0, 0), 0.2, math.pi, math.pi / 2)
EXACT = 1e-13  # [m, rad]: rounding of a few operations on numbers below 1


FACES = {
    "bar": straight_face((0.1, 0.2), (0.4, -0.1)),
    "blade": rounded_face(BLADE, 0.25),
    "bend": rounded_face([(0.0, 0.0), (0.3, 0.0), (0.5, 0.2), (0.9, 0.2)], 0.1),
    "arcs": arc_face([((0.0, 0.0), 0.2, math.pi, math.pi / 2), ((0.1, 0.5), 0.3, -math.pi / 2, 0.0)]),
}


@pytest.fixture(params=[(name, side) for name in FACES for side in ("left", "right")], ids="-".join)
def profile(request):
    name, side = request.param
    return make_profile(FACES[name], 0.02, side)


def test_pieces_join_in_place_and_heading(profile):
    for a, b in pairwise(profile.pieces):
        assert math.dist(a.end, b.start) < EXACT
        assert abs(wrapped_angle(b.heading - a.end_heading)) < EXACT


def test_ends_are_convex_quarters(profile):
    for cap in (profile.pieces[0], profile.pieces[-1]):
        assert cap.curvature == pytest.approx(-1 / 0.02) and cap.length == pytest.approx(0.02 * math.pi / 2)
    assert profile.end_radius == pytest.approx(0.02)


def test_places_count_from_the_beginning_of_the_face(profile):
    assert profile.places[0] == -profile.pieces[0].length and profile.places[1] == 0.0
    assert profile.face_length == pytest.approx(sum(piece.length for piece in profile.face), rel=1e-15)
    for place, piece in zip(profile.places, profile.pieces, strict=True):
        point, heading = profile.at(place)
        assert math.dist(point, piece.start) < EXACT and abs(wrapped_angle(heading - piece.heading)) < EXACT


def test_place_and_height_are_those_from_which_a_point_was_made(profile):
    """Below the smallest radius of curvature on the face every point has one foot: (a) and (b) find it."""
    for height in (-0.01, 1e-12, 0.004, 0.05):
        for s in np.linspace(profile.places[1], profile.face_length, 41)[1:-1]:
            (x, y), heading = profile.at(s)
            point = (x - height * math.sin(heading), y + height * math.cos(heading))
            assert profile.locate(point) == pytest.approx((s, height), abs=1e-12)


def test_the_chain_rides_on_the_left_of_the_pieces_whatever_the_side():
    """Above a bar to the right is its left; the other side runs the other way, from its end."""
    left, right = (make_profile(straight_face((0.0, 0.0), (1.0, 0.0)), 0.1, side) for side in ("left", "right"))
    assert left.locate((0.25, 0.02)) == pytest.approx((0.25, 0.02))
    assert right.locate((0.25, -0.02)) == pytest.approx((0.75, 0.02))
    assert (left.reversed, right.reversed) == (False, True) and left.straight and right.straight


def test_beyond_the_ends_there_is_nothing():
    profile = make_profile(straight_face((0.0, 0.0), (1.0, 0.0)), 0.1)
    assert profile.locate((1.05, 0.02)) == pytest.approx((1.0 + 0.1 * math.atan2(0.05, 0.12), 0.13 - 0.1))
    assert profile.locate((1.2, -0.2)) is None and profile.locate((-0.2, -0.2)) is None


def test_a_rounded_corner_touches_both_sides():
    """Two sides at a right angle, radius R: the arc begins R before the corner and is a quarter of 2 pi R long."""
    first, bend, last = rounded_face([(0.0, 0.0), (0.3, 0.0), (0.3, 0.5)], 0.1)
    assert (first.length, bend.length, last.length) == pytest.approx((0.2, 0.1 * math.pi / 2, 0.4), abs=EXACT)
    assert bend.curvature == 10.0 and bend.start == pytest.approx((0.2, 0.0)) and last.end == pytest.approx((0.3, 0.5))


def test_arcs_that_only_share_a_tangent_are_joined_by_a_straight_piece():
    first, between, last = arc_face([QUARTER, ((0.3, 0), 0.2, math.pi / 2, 0)])
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
        (lambda: rounded_face([(0, 0), (1, 0), (1, 0)], 0.1), 2, "another point than the one before"),
        (lambda: rounded_face([(0, 0), (1, 0), (1, 0.3)], 0.4), 1, "need 0.4 m of the 0.3 m between points 1 and 2"),
        (lambda: rounded_face([(0, 0), (1, 0), (1, 0.3), (2, 0.3)], 0.2), 2, "no room for radius 0.2"),
        (lambda: arc_face([QUARTER, ((0, 0.01), 0.2, math.pi / 2, 0)]), 1, f"begins 0.01 m from {BEFORE}"),
        (
            lambda: arc_face([QUARTER, ((0, 0), 0.2, math.pi / 2 - 0.1, 0)]),
            1,
            f"turns by -5.73 degrees against {BEFORE}",
        ),
    ],
    ids=["same", "short", "two corners", "apart", "kink"],
)
def test_what_cannot_be_drawn_is_told(make, index, text):
    with pytest.raises(ProfileError, match=text) as caught:
        make()
    assert caught.value.index == index


def test_a_profile_is_a_value():
    assert make_profile(straight_face((0, 0), (1, 0)), 0.1) == make_profile(straight_face((0, 0), (1, 0)), 0.1)
    assert isinstance(make_profile(straight_face((0, 0), (1, 0)), 0.1), Profile)


CIRCLE = 0.25


def circle(count, begin=2.0, end=0.5):
    """Points on a circle of radius CIRCLE, run clockwise."""
    angle = np.linspace(begin, end, count)
    return CIRCLE * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def clothoid(count, length=0.2, rate=100.0):
    """Points of a curve whose curvature grows as rate s [1/m], by the trapezoidal rule on 2,000 steps a point."""
    s = np.linspace(0.0, length, 2000 * count + 1)
    heading = 0.5 * rate * s * s
    step = s[1]
    f = np.stack([np.cos(heading), np.sin(heading)])
    x, y = np.cumsum(np.pad(0.5 * step * (f[:, 1:] + f[:, :-1]), ((0, 0), (1, 0))), axis=1)
    return np.stack([x, y], axis=1)[:: 2000 * count // (count - 1)]


def distances(pieces, points):
    """Height of points over the face, drawn with a cap too small to matter."""
    profile = make_profile(pieces, 1.0)
    return np.array([profile.locate(point)[1] for point in points])


def test_a_biarc_joins_two_points_with_their_headings():
    first, second = biarc((0.1, 0.2), 0.3, (0.4, 0.25), -0.6)
    assert first.start == (0.1, 0.2) and first.heading == 0.3
    assert math.dist(first.end, second.start) < 1e-15 and abs(wrapped_angle(first.end_heading - second.heading)) < 1e-15
    assert second.end == pytest.approx((0.4, 0.25), abs=1e-15) and abs(wrapped_angle(second.end_heading + 0.6)) <= 1e-14


def test_a_biarc_of_a_circle_is_that_circle():
    (ax, ay), (bx, by) = circle(2)
    for arc in biarc((ax, ay), 2.0 - math.pi / 2, (bx, by), 0.5 - math.pi / 2):
        assert arc.curvature == pytest.approx(-1.0 / CIRCLE, rel=1e-12)
    assert arc.end == pytest.approx((bx, by))


def test_a_biarc_of_a_line_is_straight():
    first, second = biarc((0.0, 0.0), 0.25, (math.cos(0.25), math.sin(0.25)), 0.25)
    assert abs(first.curvature) < 1e-15 and first.length + second.length == pytest.approx(1.0)


@pytest.mark.parametrize("points", [circle(12), clothoid(21), [(0, 0), (0.1, 0.02), (0.2, 0)], [(0, 0), (0.3, 0.1)]],
                         ids=["circle", "clothoid", "three", "two"])  # fmt: skip
def test_the_face_is_smooth_and_keeps_to_its_points(points):
    pieces = fitted_face([tuple(point) for point in np.asarray(points, dtype=float).tolist()])
    for a, b in pairwise(pieces):
        assert math.dist(a.end, b.start) < 1e-12 and abs(wrapped_angle(a.end_heading - b.heading)) < 1e-12
    assert np.abs(distances(pieces, points[1:-1])).max(initial=0.0) <= TOLERANCE
    assert math.dist(pieces[0].start, points[0]) <= TOLERANCE and math.dist(pieces[-1].end, points[-1]) <= TOLERANCE


def test_a_measured_circle_gives_its_radius():
    """12 points of 0.25 m: within 1e-5 m over chords of 0.03 m, d = c^2 k / 8, the curvature is known to 10 %."""
    pieces = fitted_face([tuple(point) for point in circle(12).tolist()])
    assert len(pieces) <= 10
    assert [piece.curvature for piece in pieces] == pytest.approx([-1.0 / CIRCLE] * len(pieces), rel=0.1)
    assert sum(piece.length for piece in pieces) == pytest.approx(1.5 * CIRCLE, rel=1e-4)


def test_curvature_follows_a_clothoid():
    """Curvature 100 s: the pieces' own, in the middle of each, to the steps that arcs make of it."""
    pieces = fitted_face([tuple(point) for point in clothoid(41).tolist()])
    places = np.cumsum([0.0, *(piece.length for piece in pieces)])
    middles, curvatures = 0.5 * (places[1:] + places[:-1]), [piece.curvature for piece in pieces]
    assert curvatures[1:-1] == pytest.approx(100.0 * middles[1:-1], abs=1.5)
    assert len(pieces) < 60


def test_rounded_numbers_do_not_bend_the_face():
    """A blade of 0.25 m radius, points each millimeter rounded to 1e-6 m: a spline through every point would bend with
    6e-6 / 1e-3^2 = 6 1/m from point to point, against 4 1/m of the blade; within the tolerance it need not."""
    count = int(1.5 * CIRCLE / 1e-3)
    pieces = fitted_face([tuple(point) for point in np.round(circle(count), 6).tolist()])
    curvatures = [piece.curvature for piece in pieces]
    assert max(curvatures) < -3.0 and min(curvatures) > -5.0
    assert np.abs(distances(pieces, circle(count)[1:-1])).max() <= TOLERANCE + 1e-6


def test_a_point_twice_is_told():
    with pytest.raises(ProfileError, match="another point than the one before") as caught:
        fitted_face([(0.0, 0.0), (0.1, 0.0), (0.1, 0.0), (0.2, 0.0)])
    assert caught.value.index == 2


def marine_with(folder, guide):
    """The marine drive's file with another first guide; gravity and all else stay."""
    text = drive_path("marine").read_text()
    begin, end = text.index("[[guides]]"), text.index("[contact.sprocket]")
    path = folder / "drive.toml"
    path.write_text(text[:begin] + f'[[guides]]\nname = "blade"\n{guide}\n' + text[end:])
    return path


def test_a_drive_takes_its_points_in(tmp_path):
    (tmp_path / "blade.csv").write_text("# drawing 4711\nx_mm,y_mm\n0,0\n\n500,20\n1000,0\n")
    drive = load_drive(marine_with(tmp_path, 'profile = "blade.csv"'))
    assert drive.guides[0].profile == ((0.0, 0.0), (0.5, 0.02), (1.0, 0.0))
    (tmp_path / "blade.csv").unlink()
    assert loads_drive(dumps_drive(drive)) == drive
    assert single_chain(drive).profile(0).locate((0.5, 0.02))[1] == pytest.approx(0.0, abs=TOLERANCE)


def test_a_profile_may_say_which_columns_it_has(tmp_path):
    (tmp_path / "p.txt").write_text("No;X;Y;Z\n1;0;0;7\n2;500;20,5;7\n3;1000;0;7\n")
    named = 'columns = { x = "X", y = "#3" }, units = { x = "mm", y = "mm" }'
    path = marine_with(tmp_path, f'profile = {{ file = "p.txt", {named} }}')
    assert load_drive(path).guides[0].profile == ((0.0, 0.0), (0.5, 0.0205), (1.0, 0.0))
    path.write_text(path.read_text().replace('x = "X", ', ""))
    with pytest.raises(DriveError, match=r'guides.blade.profile.file = "p.txt": columns: has y; must be x and y'):
        load_drive(path)


FILES = [
    ("x,y\n0,0\n1,a\n", 'line 3: "a" is not a finite number'),
    (
        'x,y\n0,0\n1,"2,5"\n',
        'line 3: "2,5" is not a finite number within 1e+30 of 0; numbers of this file have decimal p',
    ),
    ("x;y\n0,5;1.249\n", "line 2: 1.249, but line 2 has 0,5: numbers of one file have points and commas; give decimal"),
    ("x,y\n0,0\n1\n", 'line 3: column "y" has no number; each line must have one'),
    ("x,y\n0,0\n0,0\n", "line 3: 0, 0 must be another point than that of the row before"),
    ("x,y\n0,0\n", "has 1 rows of numbers; must have 2 to 1000000"),
    ("0,0\n1,1\n", "line 1: numbers begin, and no line of names is above them; nothing is above it"),
    (
        "x,y,z\n0,0,0\n1,1,1\n",
        'line 1: column #3, "z", is not known; must be x and y; say which count, as in columns = {',
    ),
    ("# nothing\n", "must have a line of names and lines of numbers below it"),
    ("pipe", "cannot be read: it is a device or a pipe, not a file"),
    (None, "cannot be read: no such file or directory"),
]


@pytest.mark.parametrize(("text", "line"), FILES, ids=[line[:30] for _, line in FILES])
def test_a_wrong_file_is_one_line(tmp_path, text, line):
    path = marine_with(tmp_path, 'profile = "blade.csv"')
    if text == "pipe":
        os.mkfifo(tmp_path / "blade.csv")
    elif text is not None:
        (tmp_path / "blade.csv").write_text(text)
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    (error,) = caught.value.errors
    assert error.startswith(f'{path}: guides.blade.profile = "blade.csv": ') and line in error


@pytest.mark.parametrize("file", ["../blade.csv", "/dev/zero", "link.csv"])
def test_a_file_that_stands_elsewhere_is_not_read(tmp_path, file):
    (tmp_path / "blade.csv").write_text("secret\n")
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "link.csv").symlink_to(tmp_path / "blade.csv")
    with pytest.raises(DriveError, match=rf'"{file}": must be a file in the drive file\'s folder, or below it$'):
        load_drive(marine_with(tmp_path / "drive", f'profile = "{file}"'))


def test_a_file_is_read_by_load_drive_alone(tmp_path):
    path = marine_with(tmp_path, 'profile = "blade.csv"')
    with pytest.raises(DriveError, match=r'guides\.blade\.profile = "blade\.csv": must be a list of at least 2 points'):
        loads_drive(path.read_text())


def test_a_measured_line_tighter_than_a_pitch_is_told_where(tmp_path):
    """A half circle of 0.05 m, with the pitch of 0.1143 m."""
    angle = np.linspace(math.pi, 0.0, 30)
    rows = "\n".join(f"{0.05 * math.cos(a)!r},{0.05 * math.sin(a)!r}" for a in angle)
    (tmp_path / "blade.csv").write_text(f"x,y\n{rows}\n")
    with pytest.raises(DriveError) as caught:
        load_drive(marine_with(tmp_path, 'profile = "blade.csv"'))
    (error,) = caught.value.errors
    assert "guides.blade.profile: bends with a radius of 0.049" in error and "must be at least a pitch, 0.1143" in error
