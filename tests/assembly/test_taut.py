"""The taut string against closed forms, and chains laid around guides."""

import math

import numpy as np
import pytest
from assemblies import link_lengths
from drives import two_sprockets

from warpchain import assemble
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.taut_string import obstacle_arcs, point_end, taut_string
from warpchain.drive.face_profile import Piece, make_profile
from warpchain.model import single_chain


def face(center, radius, half, upward=1.0):
    """An arc of a face about the highest (or lowest) point of a circle, the chain outside of it."""
    begin = 0.5 * math.pi + half
    start = (center[0] + radius * math.cos(begin), center[1] + upward * radius * math.sin(begin))
    heading = upward * half
    piece = Piece(start, heading, -upward / radius, 2.0 * half * radius)
    return make_profile([piece if upward > 0 else piece.reversed_piece()], 0.05)


def test_string_over_an_arc():
    """Tangents from points at distance D have the length sqrt(D^2 - R^2); round-off of some 1e-16 m."""
    run = obstacle_arcs(face((0.0, 0.0), 0.25, 0.7), 0.01, 0, along=True)
    found = taut_string(point_end((-0.6, 0.1)), point_end((0.5, 0.05)), [run])
    radius = 0.26
    tangents = math.sqrt(0.37 - radius**2) + math.sqrt(0.2525 - radius**2)
    between = math.atan2(0.1, -0.6) - math.atan2(0.05, 0.5)
    angle = between - math.acos(radius / math.sqrt(0.37)) - math.acos(radius / math.sqrt(0.2525))
    assert found.length == pytest.approx(tangents + radius * angle, rel=1e-14)
    assert sum(touch.wrap for touch in found.touches) == pytest.approx(angle, rel=1e-12)


def test_string_over_two_arcs_on_both_sides():
    """An S: the inner tangent of two circles of radius R a distance D apart is sqrt(D^2 - 4 R^2) long."""
    over = obstacle_arcs(face((0.0, 0.0), 0.2, 1.2), 0.0, 0, along=True)
    under = obstacle_arcs(face((0.6, 0.1), 0.2, 1.2, upward=-1.0), 0.0, 1, along=False)
    found = taut_string(point_end((-0.5, 0.0)), point_end((1.1, 0.1)), [over, under])
    assert [touch.arc.guide for touch in found.touches] == [0, 1]
    distance = math.hypot(0.6, 0.1)
    straight = [piece.length for piece in found.pieces if piece.curvature == 0.0]
    middle = math.sqrt(distance**2 - 0.4**2)
    assert straight == pytest.approx([math.sqrt(0.21), middle, math.sqrt(0.21)], rel=1e-13)


def test_a_guide_out_of_reach_is_not_touched():
    run = obstacle_arcs(face((0.0, 0.0), 0.25, 0.7), 0.01, 0, along=True)
    found = taut_string(point_end((-0.6, 0.3)), point_end((0.5, 0.3)), [run])
    assert not found.touches
    assert found.length == 1.1


def test_directions_are_the_gradient():
    """By central differences of step h: h^2 of the third derivative, and 1e-16/h of round-off."""
    run = obstacle_arcs(face((0.0, 0.0), 0.25, 0.7), 0.01, 0, along=True)
    a, b, h = np.array([-0.6, 0.1]), np.array([0.5, 0.05]), 1e-6

    def length(da, db):
        return taut_string(point_end(a + da), point_end(b + db), [run]).length

    found, none = taut_string(point_end(a), point_end(b), [run]), np.zeros(2)
    for axis in np.eye(2) * h:
        first = (length(axis, none) - length(-axis, none)) / (2 * h)
        last = (length(none, axis) - length(none, -axis)) / (2 * h)
        side = int(axis[1] > 0)
        assert first == pytest.approx(-(math.cos(found.first), math.sin(found.first))[side], abs=1e-9)
        assert last == pytest.approx((math.cos(found.last), math.sin(found.last))[side], abs=1e-9)


def test_levers_are_the_gradient_by_an_arms_angle():
    profile, pivot, h = face((0.0, 0.0), 0.25, 0.7), (-0.3, -0.1), 1e-6
    from warpchain.assembly.guide_obstacles import turned_profile

    def string(angle):
        run = obstacle_arcs(turned_profile(profile, pivot, angle), 0.01, 0, along=True)
        return taut_string(point_end((-0.6, 0.1)), point_end((0.5, 0.05)), [run])

    slope = (string(h).length - string(-h).length) / (2 * h)
    assert string(0.0).levers([0], pivot) == pytest.approx(-slope, rel=1e-8)


def guided(radius=0.5, top=0.24, links=60):
    """Two sprockets with a circular guide inside the upper strand, as an arc through (0.5, top)."""
    drive = two_sprockets(links=links)
    arc = {"center": [0.5, top - radius], "radius": radius, "from": 65.0, "to": 115.0}
    return drive.with_values(
        {
            "contact.guide": {"restitution": 0.3, "stiffness": 1e8, "impact_speed_floor": 0.02},
            "guides": [{"name": "blade", "arcs": [arc], "side": "right"}],
        }
    )


def test_rollers_stand_on_the_guide():
    """Rollers of the arc at R' = R + R_r; all links of strands strained alike. 1e-9 m: what closing leaves."""
    drive = guided()
    path = chain_path(single_chain(drive))
    assembly = assemble(drive)
    strings = [k for k, string in enumerate(path.strings) if string is not None]
    assert strings == [1]
    touch = path.strings[1].touches[0]
    reach = np.hypot(*(assembly.position - [0.5, -0.26]).T)
    strand = (assembly.strand_first[1] + np.arange(assembly.strand_links[1] + 1)) % 60
    lengths = link_lengths(assembly)
    for k in range(2):
        own = (assembly.strand_first[k] + np.arange(assembly.strand_links[k])) % 60
        assert lengths[own] == pytest.approx(0.05 * (1.0 + assembly.strain), abs=1e-9)
    away = np.abs(np.arctan2(assembly.position[strand, 0] - 0.5, assembly.position[strand, 1] + 0.26))
    on = strand[away < 0.5 * touch.wrap - 0.01]
    assert len(on) > 3
    assert reach[on] == pytest.approx(0.515, abs=1e-9)
    assert reach[strand].min() > 0.515 - 1e-9


def test_path_and_wraps_by_hand():
    """The strand's tangents from sprockets of radius R at distance D to the guide's circle of radius R'."""
    drive = guided()
    path, radius = chain_path(single_chain(drive)), float(chain_path(single_chain(drive)).radius[0])
    h, distance = 0.515 - radius, math.hypot(0.5, 0.26)
    straight = math.sqrt(distance**2 - h**2)
    pieces = path.strings[1].pieces
    assert [pieces[0].length, pieces[-1].length] == pytest.approx([straight, straight], rel=1e-12)
    wrap = sum(touch.wrap for touch in path.strings[1].touches)
    assert float(path.wrap_angle.sum()) + wrap == pytest.approx(2.0 * math.pi, rel=1e-13)
    chord = 2.0 * math.asin(0.05 / 1.03)
    assert path.strand_length[1] == pytest.approx(2.0 * straight + 0.05 * wrap / chord, rel=1e-12)


def test_an_arm_stands_where_chain_and_spring_balance():
    """The torsion spring's moment against T (h_out - h_in) of the assembled chain: T = k p strain."""
    drive = guided(links=60).with_values(
        {
            "arms": [
                {"name": "lever", "pivot": [0.1, 0.05], "mass": 0.1, "center": [0.3, 0.1], "inertia": 0.01,
                 "stiffness": 200.0, "free_angle": 20.0, "stops": [-30.0, 30.0]}
            ],
            "guides.blade.arm": "lever",
        }
    )  # fmt: skip
    assembly = assemble(drive)
    angle = float(assembly.arm_angle[0])
    string = assembly.path.strings[1]
    pull = drive.chain.mean_stiffness * assembly.path.pitch * assembly.strain
    assert assembly.strain > 0.0
    spring = -200.0 * (angle - math.radians(20.0))
    assert pull * string.levers([0], (0.1, 0.05)) == pytest.approx(-spring, rel=1e-4)
