"""Straight flanks that let a strand go: the limit against the unwinding roller, the default below it, the warning
above it.
"""

import math
import warnings

import numpy as np
import pytest
from drives import row, two_sprockets

from warpchain import Record, simulate
from warpchain.drive.tooth_shape import default_seat_angle, iso606_tooth, releasing_seat_angle
from warpchain.model import single_chain
from warpchain.results.outlines import tooth_outline


@pytest.mark.parametrize("teeth", [7, 12, 20, 57])
def test_limit_is_where_the_unwinding_roller_first_touches(teeth):
    # the roller's path in its own gap, from the seat to the tips: clear just below the limit, in the flank just above
    pitch = 0.05
    radius = pitch / (2 * math.sin(math.pi / teeth))
    s = np.linspace(1e-3 * pitch, math.sqrt((radius + pitch / 2) ** 2 - radius**2), 2000)
    behind, reach = s / radius - np.arctan(s / radius), np.hypot(radius, s)
    xi, eta = reach * np.cos(behind) - radius, reach * np.sin(behind)
    half = releasing_seat_angle(radius, pitch) / 2
    for b, touches in ((half - 1e-6, False), (half + 1e-6, True)):
        assert (eta * math.sin(b) - xi * math.cos(b) > 0).any() == touches


def test_default_is_140_less_90_over_z_where_that_releases():
    def default(teeth):
        return math.degrees(default_seat_angle(teeth, 0.05 / (2 * math.sin(math.pi / teeth)), 0.05))

    assert default(57) == pytest.approx(140 - 90 / 57)
    assert default(25) == pytest.approx(140.6 - 5, abs=0.1)
    assert default(12) == pytest.approx(121.5 - 5, abs=0.1)


def test_catching_teeth_multiply_the_tension_and_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        free = two_sprockets(seat_angle=128.0, duration=0.5, speed=2.0, span=20.002)
    with pytest.warns(UserWarning, match=r'seat_angle = 138: the straight flanks of "driver" \(20 teeth\) catch'):
        catching = two_sprockets(seat_angle=138.0, duration=0.5, speed=2.0, span=20.002)
    assert (single_chain(free).catching_sprockets(), single_chain(catching).catching_sprockets()) == ((), (0, 1))
    assert row(catching)["tension_mean"] > 3 * row(free)["tension_mean"]


@pytest.mark.parametrize(
    ("gap", "expected"),
    [
        # ISO 606 for 08B (d1 = 8.51 mm, p = 12.7 mm), 17 teeth, by hand: radii in mm, angle in degrees, tip diameter
        ("minimum", (4.29755, 134.70588, 19.4028, 69.11583 + 12.7 * (1 - 1.6 / 17) - 8.51)),
        ("maximum", (4.29755 + 0.069 * 8.51 ** (1 / 3), 114.70588, 31.92952, 69.11583 + 1.25 * 12.7 - 8.51)),
    ],
)
def test_iso606_gap(gap, expected):
    tooth = iso606_tooth(gap, 4.255e-3, 17, 12.7e-3)
    found = (1e3 * tooth.seat_radius, math.degrees(tooth.seat_angle), 1e3 * tooth.flank_radius, 2e3 * tooth.tip_radius)
    assert found == pytest.approx(expected, rel=2e-6)
    assert tooth.pressure_angle(17) == pytest.approx(math.radians(90 - expected[1] / 2 - 180 / 17))


@pytest.mark.parametrize("gap", ["minimum", "maximum"])
@pytest.mark.parametrize("teeth", [5, 9, 20, 57])
def test_iso606_flanks_let_a_straight_strand_go(gap, teeth):
    # the unwinding roller as above, against seat arc and convex flank: clear all the way out
    pitch, roller = 25.4e-3, 7.94e-3
    tooth = iso606_tooth(gap, roller, teeth, pitch)
    radius, half = pitch / (2 * math.sin(math.pi / teeth)), tooth.seat_angle / 2
    s = np.linspace(1e-3 * pitch, pitch, 2000)
    behind, reach = s / radius - np.arctan(s / radius), np.hypot(radius, s)
    xi, eta = reach * np.cos(behind) - radius, reach * np.sin(behind)
    f = (tooth.seat_radius + tooth.flank_radius) * np.array([-math.cos(half), math.sin(half)])
    flank = tooth.flank_radius + roller - np.hypot(xi - f[0], eta - f[1])
    assert (flank < 0).all()


def iso606(drive, gap):
    values = {"profile": "iso606", "gap": gap, "clearance": None, "seat_angle": None}
    return drive.with_values({f"contact.sprocket.{key}": value for key, value in values.items()})


@pytest.mark.parametrize("gap", ["minimum", "maximum"])
def test_seated_chain_tension_falls_by_the_profiles_own_pressure_angle(gap):
    # sprocket locked, one side pulled: T_{i+1} / T_i = sin(phi) / sin(phi + 2 pi / z); stiff, so that rollers stay
    # where the flanks begin; the convex flank and elastic links move the normal by a tenth of a degree: 1 %
    teeth = 20
    drive = iso606(
        two_sprockets(teeth=teeth, links=60, span=20.0 * (1 + 1e-6), torque=400.0, speed=0.0, damping=2e4,
        stiffness=5e7, contact=5e9, duration=1.0, restitution=0.1, inertia=1.0, floor=0.5, step=4e-6, viscous=300.0),
        gap,
    )  # fmt: skip
    trajectory = simulate(drive, record=Record(rate=100.0), window=(0.9, 1.0))[0]
    tension = trajectory.tension[-1]
    on_driver = np.hypot(*trajectory.position[-1].T) < single_chain(drive).pitch_radius(0) * 1.02
    loaded = on_driver & (trajectory.sprocket_force[-1] > 0.02 * trajectory.sprocket_force[-1].max())
    phi = single_chain(drive).tooth(0).pressure_angle(teeth)
    expected = math.sin(phi) / math.sin(phi + 2 * math.pi / teeth)
    before, after = tension[np.flatnonzero(loaded) - 1], tension[np.flatnonzero(loaded)]
    ratios = np.minimum(before, after) / np.maximum(before, after)
    ratios = ratios[np.maximum(before, after) > 0.2 * tension.max()]
    assert len(ratios) >= 2
    assert np.median(ratios) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("gap", ["minimum", "maximum"])
def test_drawn_iso606_teeth_are_the_profile(gap):
    # every point drawn is on the seat's circle, on the flank's circle, or at the tip
    drive = iso606(two_sprockets(), gap)
    tooth, radius = single_chain(drive).tooth(0), single_chain(drive).pitch_radius(0)
    outline = tooth_outline(single_chain(drive), 0)
    local = outline[np.abs(np.arctan2(outline[:, 1], outline[:, 0])) < math.pi / 20 * (1 - 1e-9)]
    half = tooth.seat_angle / 2
    f = [radius, 0] + (tooth.seat_radius + tooth.flank_radius) * np.array([-math.cos(half), math.sin(half)])
    on_seat = np.abs(np.hypot(*(local - [radius, 0]).T) - tooth.seat_radius)
    on_flank = np.abs(np.hypot(local[:, 0] - f[0], np.abs(local[:, 1]) - f[1]) - tooth.flank_radius)
    assert np.minimum(on_seat, on_flank).max() < 1e-12
    assert np.hypot(*outline.T).max() <= tooth.tip_radius * (1 + 1e-12)
