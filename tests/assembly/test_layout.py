"""Strands that cross and guide-bars in the chain's way: what is told, where, by how much; and no false alarm."""

import math

import pytest
from drives import LARGE, but, example, with_bar
from hypothesis import given
from layouts import Placed, drive_of, loops

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.layout_checks import layout_faults, strand_crossing
from warpchain.assembly.summary import derived_quantities, report
from warpchain.drive.examples import example_names
from warpchain.errors import DriveError
from warpchain.model import Model, single_chain

PITCH, ROLLER = 0.05, 0.015
DROP = PITCH / (2.0 * math.sin(math.pi / 20))
"""Half the distance of the strands of `two_sprockets`: driver->driven is at y = -DROP, run to the right."""


@pytest.mark.parametrize("name", but(example_names(), LARGE))
def test_no_example_is_told_anything(name):
    drive = example(name)
    assert all(layout_faults(chain) == () for chain in Model(drive).chains)
    assert "LAYOUT" not in report(derived_quantities(drive))


@given(loops())
def test_loops_that_do_not_cross_are_told_nothing(sprockets):
    drive = drive_of(sprockets, 100)
    try:
        path = chain_path(single_chain(drive))
    except DriveError:
        return
    if abs(path.turning) == pytest.approx(2.0 * math.pi):
        assert not any("cross" in line for line in layout_faults(single_chain(drive), path)) or crossing_by_sampling(
            path
        )


def crossing_by_sampling(path):
    """Whether two strands come to within a thousandth of their length, by points on them."""
    ends = list(zip(path.strand_start, path.strand_end, strict=True))
    points = [[a + i / 2000 * (b - a) for i in range(1, 2000)] for a, b in ends]
    for k, one in enumerate(points):
        for other in points[k + 1 :]:
            reach = 1e-3 * max(math.dist(one[0], one[-1]), math.dist(other[0], other[-1]))
            near = min(min(math.dist(p, q) for q in other[::10]) for p in one[::10])
            if near < 10.0 * reach:
                return True
    return False


def test_a_crossed_pair_is_told_with_its_place():
    """Equal sprockets at 0 and 0.4 m: the strands cross midway."""
    drive = drive_of([Placed(17, (0.0, 0.0)), Placed(17, (0.4, 0.0), "cw")], 100)
    (line,) = layout_faults(single_chain(drive))
    assert line.startswith('strands "s0->s1" and "s1->s0" cross at (0.2, ')
    assert "look at wrap and center of" in line


def test_strands_beside_one_sprocket_cross_where_its_wrap_says_so():
    """Three in a row; the middle one wrapped the long way round."""
    sprockets = [Placed(20, (0.0, 0.0)), Placed(12, (0.3, 0.3), "cw"), Placed(20, (0.6, 0.0))]
    assert layout_faults(single_chain(drive_of([*sprockets[:1], Placed(12, (0.3, -0.3)), *sprockets[2:]], 100))) == ()
    assert any("cross at" in line for line in layout_faults(single_chain(drive_of(sprockets, 100))))


def test_meeting_is_where_lines_have_a_point_in_common():
    assert strand_crossing(((0.0, 0.0), (2.0, 2.0)), ((0.0, 2.0), (2.0, 0.0))) == (1.0, 1.0)
    assert strand_crossing(((0.0, 0.0), (2.0, 2.0)), ((2.0, 2.0), (4.0, 0.0))) is None  # ends that touch
    assert strand_crossing(((0.0, 0.0), (2.0, 0.0)), ((0.0, 1.0), (2.0, 1.0))) is None  # parallel
    assert strand_crossing(((0.0, 0.0), (1.0, 1.0)), ((0.0, 4.0), (4.0, 0.0))) is None  # beyond an end


def test_a_bar_that_the_chain_rides_on_is_told_nothing():
    """Beneath the lower strand, face up: depth 0, a quarter of a pitch, and 0.9 pitches; and apart from it."""
    for depth in (-0.01, 0.0, 0.25 * PITCH, 0.9 * PITCH):
        y = -DROP - ROLLER + depth
        assert layout_faults(single_chain(with_bar((0.3, y), (0.7, y)))) == (), depth


@pytest.mark.parametrize(("depth", "pitches"), [(0.06, "1.2"), (0.1, "2")])
def test_a_bar_that_dents_its_strand_by_more_than_a_pitch_is_told(depth, pitches):
    y = -DROP - ROLLER + depth
    (line,) = layout_faults(single_chain(with_bar((0.3, y), (0.7, y))))
    assert line.startswith(
        f'guides.bar: its face dents strand "driver->driven" by {depth:g} m, {pitches} pitches, out of its straight'
    )
    assert f"move start and end back by {depth:g} m" in line


def test_a_bar_that_faces_away_from_another_strand_is_told_nothing():
    """Above the lower strand, face up: the lower strand is behind it, the upper one in front."""
    assert layout_faults(single_chain(with_bar((0.3, 0.0), (0.7, 0.0)))) == ()
    y = DROP - ROLLER
    assert layout_faults(single_chain(with_bar((0.3, y), (0.7, y)))) == ()  # carries the upper strand from below


def test_a_bar_across_the_chain_is_told_with_its_place():
    """Upright at x = 0.5 m, seen by a strand that passes its face at right angles: the strand goes on for 0.5 m either
    side; (0.5, -DROP) is the place."""
    (line,) = layout_faults(single_chain(with_bar((0.5, -DROP - 0.1), (0.5, -DROP + 0.1))))
    assert line.startswith('guides.bar: its face cuts through strand "driver->driven" at (0.5, -0.1598) m')
    assert "turn the bar along the strand" in line


def test_a_bar_at_a_slant_is_told_only_where_it_goes_deep():
    """From 0.01 m below riding to 0.9 pitches above it: a shoe, as drives have them; to two pitches: cuts through."""
    low = -DROP - ROLLER
    assert layout_faults(single_chain(with_bar((0.3, low - 0.01), (0.7, low + 0.9 * PITCH)))) == ()
    (line,) = layout_faults(single_chain(with_bar((0.3, low - 0.01), (0.7, low + 2.0 * PITCH))))
    assert "cuts through" in line


def test_check_tells_the_layout():
    y = -DROP - ROLLER + 0.1
    values = derived_quantities(with_bar((0.3, y), (0.7, y)))
    assert len(values["layout"]) == 1
    assert f"LAYOUT: {values['layout'][0]}" in report(values).splitlines()
