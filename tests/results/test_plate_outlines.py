"""Outlines of silent chains against their plates' numbers and each other: flanks on teeth, nothing within a tooth."""

import dataclasses
import math

import numpy as np
import pytest
from drives import STARTING
from matplotlib.collections import PolyCollection
from matplotlib.path import Path
from silent_chains import pulled_silent_drive

from warpchain import simulate
from warpchain.assembly.tooth_hold import top_radius
from warpchain.drive.plate import ROOT_DEPTH, Plate, wheel_tip_radius
from warpchain.model import single_chain
from warpchain.results.outlines import tooth_outline
from warpchain.results.plate_outlines import pin_outlines, plate_outline, plate_outlines, wheel_outline
from warpchain.view.figures.drive_figure import drive_figure

PITCH = 0.0127
PLATE = Plate(
    PITCH, math.radians(30.0), 0.375 * PITCH, 0.4 * PITCH, (0.2 * PITCH, 0.5 * PITCH), tip_radius=0.05 * PITCH
)


def seated_plates(teeth):
    """Outlines (z, P, 2) [m] of plates around a whole wheel, counter-clockwise, pins in its seats."""
    angle = 2.0 * math.pi / teeth * np.arange(teeth)
    radius = PITCH / (2.0 * math.sin(math.pi / teeth))
    pins = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    model = single_chain(pulled_silent_drive(**{"chain.pitch": PITCH, "sprockets.driven.center": [0.296, 0.0]}))
    return plate_outlines(model, pins)


def flank_distances(points, pin_x, side):
    """Distances [m] of points in a link's frame from the pin at `pin_x` along its flank's normal."""
    return -side * (points[:, 0] - pin_x) * math.cos(PLATE.flank_angle) + points[:, 1] * math.sin(PLATE.flank_angle)


def test_a_plate_has_its_back_toes_and_flanks():
    outline = plate_outline(PLATE)
    assert (outline[0] == outline[-1]).all()
    assert outline[:, 1].min() == pytest.approx(-PLATE.back_height)
    finer = plate_outline(PLATE, 400)
    assert finer[:, 1].max() == pytest.approx(PLATE.depth, rel=1e-5)  # an arc's lowest of 800 points: 1 - cos(0.002)
    mirrored = {tuple(point) for point in np.round(outline * [-1.0, 1.0], 12)}
    assert mirrored == {tuple(point) for point in np.round(outline, 12)}
    for side in (1, -1):
        away = flank_distances(outline, -0.5 * side * PITCH, side)
        assert away.max() == pytest.approx(PLATE.flank_distance, rel=1e-12)
        on = outline[np.isclose(away, PLATE.flank_distance, rtol=1e-12)]
        ends = on[[0, -1]] if len(on) == 2 else on
        assert np.hypot(*(ends[1] - ends[0])) == pytest.approx(PLATE.flank_length, rel=1e-9)


def test_the_crotch_leaves_teeth_a_gap_of_0_022_pitches():
    middle = Path(plate_outline(PLATE))
    assert not middle.contains_point((0.0, -0.061 * PITCH)) and middle.contains_point((0.0, -0.063 * PITCH))


@pytest.mark.parametrize("teeth", [17, 23, 60])
def test_a_wheel_reaches_from_the_root_to_the_tips(teeth):
    radius = np.hypot(*wheel_outline(PLATE, teeth, PITCH).T)
    apothem = 0.5 * PITCH / math.tan(math.pi / teeth)
    assert radius.min() == pytest.approx(apothem - ROOT_DEPTH * PITCH, rel=1e-12)
    assert radius.max() == pytest.approx(wheel_tip_radius(teeth, PITCH), rel=1e-12)


@pytest.mark.parametrize("teeth", [17, 23, 60])
def test_flanks_of_seated_plates_lie_on_teeth_and_nothing_is_within_them(teeth):
    wheel, plates = wheel_outline(PLATE, teeth, PITCH, 30), seated_plates(teeth)
    shrunk = Path(wheel * (1.0 - 1e-9))
    assert not shrunk.contains_points(plates.reshape(-1, 2)).any()
    assert not any(Path(plate).contains_points(wheel * (1.0 - 1e-9)).any() for plate in plates)
    edges = np.hypot(*np.diff(wheel, axis=0).T) > 0.0
    ends = wheel[:-1][edges], wheel[1:][edges]
    for plate in plates:
        way = ends[1] - ends[0]
        share = ((plate[:, None] - ends[0]) * way).sum(axis=-1) / (way * way).sum(axis=-1)
        apart = plate[:, None] - ends[0] - np.clip(share, 0.0, 1.0)[..., None] * way
        touching = np.hypot(*np.moveaxis(apart, -1, 0)).min(axis=1) < 1e-9 * PITCH
        assert touching.sum() == 4  # the two ends of both flanks


def test_a_narrow_gaps_flanks_meet_above_the_root():
    narrow = dataclasses.replace(PLATE, flank_angle=math.radians(45.0), flank_distance=0.25 * PITCH)
    gap, radius = math.radians(45.0) - math.pi / 23, PITCH / (2.0 * math.sin(math.pi / 23))
    lowest = np.hypot(*wheel_outline(narrow, 23, PITCH).T).min()
    assert lowest == pytest.approx(radius - narrow.flank_distance / math.sin(gap), rel=1e-12)


def test_toes_point_inward_whichever_way_the_chain_travels():
    for wrap in ("cw", "ccw"):
        model = single_chain(pulled_silent_drive(wrap=wrap))
        sign = 1.0 if wrap == "ccw" else -1.0
        angle = sign * 2.0 * math.pi / 70 * np.arange(70)
        outlines = plate_outlines(model, 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        assert np.hypot(*outlines.mean(axis=1).T).max() < 0.1


def test_pictures_have_wheels_plates_and_pins_with_odd_links_in_front():
    drive = pulled_silent_drive()
    trajectory = simulate(drive, device="cpu", limits=STARTING)[0]
    model, position = single_chain(drive), np.asarray(trajectory.position[5], dtype=float)
    np.testing.assert_array_equal(tooth_outline(model, 0, 4), wheel_outline(model.chain.plate, 23, 9.525e-3, 4))
    drawn = [part for part in drive_figure(trajectory, 5).axes[0].collections if isinstance(part, PolyCollection)]
    behind, front, pins, *_ = sorted(drawn, key=lambda part: part.get_zorder())  # before the arrows
    plates = plate_outlines(model, position)
    for part, outlines in ((behind, plates[::2]), (front, plates[1::2]), (pins, pin_outlines(model, position))):
        assert len(part.get_paths()) == len(outlines)
        found = np.array([path.vertices[: outlines.shape[1]] for path in part.get_paths()])
        np.testing.assert_allclose(found, 1e3 * outlines, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("teeth", [17, 40])
def test_a_silent_chain_jumps_where_its_toes_stand_on_tips(teeth):
    """A link there, with the rounded ends of both its toes on the tips' circle, has its pins at that radius."""
    model = single_chain(pulled_silent_drive((teeth, teeth)))
    plate, top = model.chain.plate, top_radius(model, 0)
    height = math.sqrt(top**2 - (0.5 * plate.pitch) ** 2)
    x, y = plate.flank_end(1)
    ends = math.hypot(0.5 * plate.pitch - x, height - y)
    assert ends == pytest.approx(model.tip_radius(0) + plate.tip_radius, rel=1e-12)
