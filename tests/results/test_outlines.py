"""Outlines, contact directions and strand displacement against the solver and against geometry."""

import math

import numpy as np
import pytest
from drives import example, timing, two_sprockets
from layouts import winding

import warpchain
from warpchain import simulate
from warpchain.model import single_chain
from warpchain.results.nearest_parts import contact_force_vectors, engaged_sprockets
from warpchain.results.outlines import arm_outline, guide_outline, tensioner_outline, tooth_outline, turn_points
from warpchain.results.strand_passing import strand_displacement


@pytest.mark.parametrize("s", [0, 1])
def test_teeth_hold_a_roller_in_every_seat_and_end_at_the_tip(s):
    drive = example("marine")
    outline = tooth_outline(single_chain(drive), s)
    np.testing.assert_array_equal(outline[0], outline[-1])
    radius = np.hypot(*outline.T)
    assert radius.max() == pytest.approx(single_chain(drive).tip_radius(s), rel=1e-12)
    seat_radius = drive.chain.roller_radius + drive.contact.sprocket.clearance
    for j in range(drive.sprockets[s].teeth):
        angle = 2 * math.pi * j / drive.sprockets[s].teeth
        seat = single_chain(drive).pitch_radius(s) * np.array([math.cos(angle), math.sin(angle)])
        # nothing of the outline is inside a roller that sits there; the arc touches the seat's circle
        assert np.hypot(*(outline - seat).T).min() == pytest.approx(seat_radius, rel=1e-9)
    angles = np.unwrap(np.arctan2(outline[:, 1], outline[:, 0]))
    assert angles[-1] - angles[0] == pytest.approx(2 * math.pi)


def test_guide_outline_is_the_face_with_tangent_ends():
    drive = example("marine")
    outline, guide = guide_outline(single_chain(drive), 0), drive.guides[0]
    for point in (guide.start, guide.end):
        assert np.hypot(*(outline - point).T).min() < 1e-12
    steps = np.diff(outline, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert headings[0] - headings[-1] == pytest.approx(math.pi, abs=0.2)


def test_displacement_in_the_solver_is_that_of_the_recorded_positions():
    drive = two_sprockets(duration=0.01, gravity=-9.81)
    run = simulate(drive, window=(0.0, 0.01), record=warpchain.Record(rate=1 / 5e-6))
    metrics = run.metrics.to_pylist()[0]
    for k, name in enumerate(drive.strand_names):
        values = strand_displacement(run[0], k)[::32]  # the steps that the kernel looks at
        assert metrics[f"{name}.displacement_mean"] == pytest.approx(values.mean(), abs=1e-7)
        assert metrics[f"{name}.displacement_rms"] == pytest.approx(np.sqrt((values**2).mean()), abs=1e-7)


def test_displacement_is_that_of_the_crossing_nearest_the_strand():
    """By the window's start the chain has moved on by 85 links: the roller that was in the middle of s0->s1 has passed
    the middle of s2->s3, which lies behind the same plane, 0.14 m away.
    """
    drive = winding(400.0)
    run = simulate(drive, device="cpu", duration=0.07, window=(0.067, 0.07), record=warpchain.Record(rate=5e4))
    metrics = run.metrics.to_pylist()[0]
    within = run[0].time >= 0.067
    for k, name in enumerate(drive.strand_names):
        values = strand_displacement(run[0], k)[within]
        assert np.abs(values).max() < 0.01
        # looks are 32 steps apart, frames 20: a chain that vibrates by 1 mm, seen as often but at other times
        assert metrics[f"{name}.displacement_mean"] == pytest.approx(values.mean(), abs=1e-4)
        assert metrics[f"{name}.displacement_min"] == pytest.approx(values.min(), abs=5e-4)
        assert metrics[f"{name}.displacement_max"] == pytest.approx(values.max(), abs=5e-4)


def test_arrows_carry_the_recorded_forces_and_push_rollers_out_of_the_teeth():
    trajectory = simulate(two_sprockets(duration=0.05))[0]
    sprockets, guides = contact_force_vectors(trajectory)
    size = np.linalg.norm(sprockets, axis=-1)
    np.testing.assert_allclose(size, trajectory.sprocket_force, rtol=1e-9, atol=1e-9)
    assert not guides.any()
    # moments of the drawn forces about the driven sprocket are those that the solver recorded
    on = (engaged_sprockets(trajectory) == 1)[..., None]
    r = trajectory.position - trajectory.sprocket_center[:, None, 1]
    f = np.where(on, -sprockets, 0.0)
    moment = (r[..., 0] * f[..., 1] - r[..., 1] * f[..., 0]).sum(axis=1)
    np.testing.assert_allclose(moment, trajectory.sprocket_moment[:, 1], atol=1e-6 * np.abs(moment).max())


def test_arms_and_tensioners_are_drawn_where_they_are():
    """Lines from the pivot to both ends of the guide and to the pad; a plunger that ends where it touches."""
    drive = timing()
    pad, ends = drive.tensioners[0].at, single_chain(drive).profile(0).face
    lines = arm_outline(single_chain(drive), 0)
    assert [tuple(line[0]) for line in lines] == [drive.arms[0].pivot] * 3
    assert [tuple(line[1]) for line in lines] == [ends[0].start, ends[-1].end, pad]
    housing, plunger = tensioner_outline(single_chain(drive), 0)
    along = np.array(drive.tensioners[0].direction) / np.hypot(*drive.tensioners[0].direction)
    assert ((plunger - pad) @ along).max() == pytest.approx(0.0, abs=1e-15)
    width = np.ptp((plunger - pad) @ np.array([-along[1], along[0]]))
    assert width == pytest.approx(drive.tensioners[0].plunger.diameter)
    assert ((housing - pad) @ along).max() < 0.0
    assert turn_points(np.array([[2.0, 1.0]]), (1.0, 1.0), 0.5 * np.pi) == pytest.approx(np.array([[1.0, 2.0]]))
