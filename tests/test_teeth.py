"""Straight flanks that let a strand go: the limit against the unwinding roller, the default below it, the warning
above it.
"""

import math
import warnings

import numpy as np
import pytest
from test_drive_physics import row, two_sprockets

from warpchain.teeth import default_seat_angle, releasing_seat_angle


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
    assert (free.catching(), catching.catching()) == ((), (0, 1))
    assert row(catching)["tension_mean"] > 3 * row(free)["tension_mean"]
