"""Signals against closed forms: spectra of sines, orders of a driver that does not run evenly, gear ratios."""

import numpy as np
import pytest
from drives import example, two_sprockets

from warpchain import Trajectory, simulate
from warpchain.model import single_chain
from warpchain.results import signals
from warpchain.results.signals import (
    amplitude_spectrum,
    contact_angles,
    guide_forces_and_rollers,
    last_round_frames,
    latter_half_frames,
    opening_events,
    order_spectrum,
    range_and_path,
    speed_ratio_to_driver,
    strand_tension,
    transmission_error,
)
from warpchain.results.strand_passing import passing_link


def turning(driver, driven=None, time=None):
    """A trajectory of angles (F,) [rad] alone."""
    time = np.linspace(0.0, 10.0, 20001) if time is None else time
    angle = np.stack([driver, driver if driven is None else driven], axis=1)
    speed = np.gradient(angle, time, axis=0)
    return Trajectory(two_sprockets(), time, sprocket_angle=angle, sprocket_speed=speed)


def test_a_sine_shows_its_amplitude_at_its_frequency():
    time = np.arange(4000) * 1e-3
    frequency, amplitude = amplitude_spectrum(7.0 + 3.0 * np.sin(2 * np.pi * 50.0 * time + 0.3), 1e-3)
    peak = amplitude.argmax()
    assert frequency[peak] == pytest.approx(50.0, abs=1e-9)  # 200 periods: exactly on a line
    assert amplitude[peak] == pytest.approx(3.0, rel=1e-9)
    assert amplitude[0] < 1e-9  # mean removed
    assert amplitude[np.abs(frequency - 50.0) > 1.0].max() < 1e-9  # Hann: three lines, no more


def test_orders_do_not_smear_when_the_driver_does_not_run_evenly():
    time = np.linspace(0.0, 10.0, 20001)
    driver = 20.0 * time + 4.0 * np.sin(1.5 * time)  # speed from 14 to 26 rad/s
    ripple = 5.0 * np.sin(20.0 * driver)  # tooth-passing of 20 teeth
    trajectory = turning(driver)
    orders, amplitude = order_spectrum(trajectory, ripple)
    near = np.abs(orders - 20.0) < 0.5
    # linear interpolation between samples loses (dphi)^2/12 of a sine, dphi = 20 * 26 / 2000 rad a sample: 0.6 %;
    # a line of the spectrum off the order loses up to 15 % (Hann)
    assert 0.84 * 5.0 < amplitude[near].max() < 5.0
    assert amplitude[np.abs(orders - 20.0) > 1.0].max() < 0.02 * amplitude[near].max()
    # over frequency the same signal spreads from 45 to 83 Hz
    _, smeared = amplitude_spectrum(ripple, time[1])
    assert smeared.max() < 0.5 * amplitude[near].max()


def test_no_orders_where_the_driver_stops_or_hardly_turns():
    time = np.linspace(0.0, 10.0, 2001)
    assert order_spectrum(turning(np.sin(time), time=time), np.sin(9 * time)) is None
    assert order_spectrum(turning(0.1 * time, time=time), np.sin(9 * time)) is None
    assert order_spectrum(turning(9.0 * time, time=time), np.full(2001, np.nan)) is None


def test_ratio_and_error_of_a_driven_sprocket_that_hunts():
    time = np.linspace(0.0, 10.0, 20001)
    driver = 8.0 * time
    trajectory = turning(driver, driver + 1e-3 * np.sin(30.0 * time) + 0.7)
    error = transmission_error(trajectory, 1)
    # less its mean, and from where it started: 1e-3 (sin - mean of sin), the mean at most 2/(30 * 10) of the amplitude
    np.testing.assert_allclose(error, 1e-3 * np.sin(30.0 * time), atol=1e-5)
    # derivative 0.03 cos(30 t) over 8; the recorded speed here is a difference quotient, off by (30 * 5e-4)^2 / 6
    np.testing.assert_allclose(
        speed_ratio_to_driver(trajectory, 1)[1:-1], 1.0 + 0.00375 * np.cos(30.0 * time[1:-1]), atol=1e-6
    )
    np.testing.assert_allclose(speed_ratio_to_driver(trajectory, 0), 1.0)


def test_transmission_errors_are_shown_in_degrees(monkeypatch):
    """A milliradian three times a revolution is 0.0573 degrees; interpolation and the window's ends lose a percent."""
    time = np.linspace(0.0, 10.0, 20001)
    trajectory = turning(8.0 * time, 8.0 * time + 1e-3 * np.sin(24.0 * time))
    monkeypatch.setattr(signals, "strand_tension", lambda trajectory, k: np.full(len(time), np.nan))
    ((title, (error,)),) = signals.order_spectra(trajectory).items()
    assert title == "transmission error [degrees]"
    assert error.amplitude.max() == pytest.approx(np.degrees(1e-3), rel=0.01)
    assert error.orders[error.amplitude.argmax()] == pytest.approx(3.0, rel=0.02)


def test_forces_on_guide_bars_and_sprockets_are_all_accounted_for():
    drive = example("marine").with_values({"run.duration": 0.35, "run.sample_rate": 1000.0})
    trajectory = simulate(drive)[0]
    ((force, rollers),) = guide_forces_and_rollers(trajectory)
    np.testing.assert_allclose(force, trajectory.guide_force.sum(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(rollers, (trajectory.guide_force > 0.0).sum(axis=1))
    assert rollers.max() >= 1  # the bar is touched at 0.25 s
    found = [contact_angles(trajectory, s) for s in range(3)]
    total = trajectory.sprocket_force[latter_half_frames(trajectory)].sum()
    assert sum(angles.force.sum() for angles in found) == pytest.approx(total, rel=1e-12)
    for angles in found:
        pressed = angles.angle[angles.force > 0.0]
        # rollers are pressed on the wrapped arc and up to a pitch angle before and after it, where flanks reach
        assert pressed.min() > -angles.pitch
        assert pressed.max() < angles.wrap + angles.pitch


def test_the_last_round_is_as_many_teeth_as_links():
    time = np.linspace(0.0, 10.0, 20001)
    trajectory = turning(8.0 * time)  # 20 teeth, 60 links: three revolutions in 2.356 s, to half a millisecond
    assert time[last_round_frames(trajectory)][0] == pytest.approx(10.0 - 6.0 * np.pi / 8.0, abs=5.01e-4)
    assert last_round_frames(turning(0.8 * time)) == slice(0, None)


def test_the_link_at_mid_strand_is_the_one_there():
    drive = two_sprockets(duration=0.02, step=1e-5)
    trajectory = simulate(drive)[0]
    middle = np.array(
        [0.5, -single_chain(drive).pitch_radius(0)]
    )  # turning counter-clockwise, the driver lets go below
    link, displacement = passing_link(trajectory, 0)
    frame = np.arange(len(link))
    a, b = trajectory.position[frame, link], trajectory.position[frame, (link + 1) % 60]
    assert ((a[:, 0] <= middle[0]) & (b[:, 0] > middle[0])).all()
    at = a + ((middle[0] - a[:, 0]) / (b[:, 0] - a[:, 0]))[:, None] * (b - a)
    np.testing.assert_allclose(at[:, 1] - middle[1], displacement, atol=1e-12)
    # the strand sags and swings by less than a tenth of a pitch
    assert np.abs(at[:, 1] - middle[1]).max() < 0.1 * drive.chain.pitch
    np.testing.assert_array_equal(strand_tension(trajectory, 0), trajectory.tension[frame, link])


def test_a_sine_goes_back_and_forth_four_amplitudes_a_period():
    time = np.linspace(0.0, 2.0, 20001)
    found = range_and_path(time, 3.0 + 0.5 * np.sin(2.0 * np.pi * 10.0 * time))
    assert (found.low, found.high) == pytest.approx((2.5, 3.5), rel=1e-5)
    assert found.range_width == pytest.approx(1.0, rel=1e-5)
    assert found.mean == pytest.approx(3.0, rel=1e-6)
    assert found.path == pytest.approx(4 * 0.5 * 10.0, rel=1e-4)  # a thousand samples a period


def test_openings_of_a_valve():
    time = np.arange(1000) * 1e-3
    lift = np.maximum(np.sin(2.0 * np.pi * 5.0 * (time - 0.05)), 0.0)  # opens at 0.05, 0.25, ... for 0.1 s
    found = opening_events(time, lift)
    assert found.openings == 5 and found.rate == pytest.approx(5.0, rel=1e-9)
    assert found.share == pytest.approx(0.5, abs=6e-3)  # a sample at either end of five spells
    assert found.longest == pytest.approx(0.1, abs=2e-3)


def test_what_is_open_from_the_beginning_did_not_open():
    assert opening_events(np.arange(4.0), np.array([1.0, 1.0, 0.0, 1.0])).openings == 1
    assert (
        opening_events(np.arange(4.0), np.ones(4))[0] == 0 and opening_events(np.arange(4.0), np.ones(4)).share == 1.0
    )
    assert opening_events(np.arange(4.0), np.zeros(4)) == (0, 0.0, 0.0, 0.0)
