"""Signals against closed forms: spectra of sines, orders of a driver that does not run evenly, gear ratios."""

import numpy as np
import pytest
from test_drive_physics import two_sprockets

from warpchain import Trajectory
from warpchain.signals import amplitude_spectrum, order_spectrum, speed_ratio, transmission_error


def turning(driver, driven=None, time=None, teeth=20):
    """A trajectory of angles (F,) [rad] alone."""
    time = np.linspace(0.0, 10.0, 20001) if time is None else time
    angle = np.stack([driver, driver if driven is None else driven], axis=1)
    speed = np.gradient(angle, time, axis=0)
    return Trajectory(two_sprockets(teeth=teeth), time, sprocket_angle=angle, sprocket_speed=speed)


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
    np.testing.assert_allclose(speed_ratio(trajectory, 1)[1:-1], 1.0 + 0.00375 * np.cos(30.0 * time[1:-1]), atol=1e-6)
    np.testing.assert_allclose(speed_ratio(trajectory, 0), 1.0)
