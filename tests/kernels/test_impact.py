"""Contact laws: restitution against its closed form, no adhesion, energy accounts."""

import numpy as np
import pytest
import warp as wp
from bouncing import KINDS, bounce
from scipy.optimize import brentq

from warpchain.kernels.physics.contact import penalty


def rebound(e, stiffness=1e6, exponent=1.0, mass=2.0, speed=0.7, h=None):
    law = KINDS.ContactLaw()
    law.stiffness, law.exponent, law.hysteresis, law.speed_floor = stiffness, exponent, 0.75 * (1 - e * e), 1e-9
    out = wp.zeros(3, dtype=wp.float64, device="cpu")
    duration = (
        np.sqrt(mass / stiffness)
        if exponent == 1.0
        else (mass / stiffness * speed ** (1 - exponent)) ** (1 / (1 + exponent))
    )
    wp.launch(bounce, dim=1, inputs=[law, mass, speed, h or 1e-4 * duration, out], device="cpu")
    return out.numpy() / [speed, 1.0, 1.0]


def closed_form(e):
    """d - ln(1 + d) = -d r - ln(1 - d r), d = 3 (1 - e^2) / 4."""
    d = 0.75 * (1 - e * e)
    return brentq(lambda r: d - np.log1p(d) + d * r + np.log1p(-d * r), 1e-9, min(1.0, 1 / d) - 1e-12)


@pytest.mark.parametrize(("e", "expected"), [(0.3, 0.68423), (0.5, 0.72524), (0.8, 0.84710)])
def test_restitution_is_the_closed_form(e, expected):
    # midpoint rule at 1e-4 of the contact's time scale: error of order 1e-4 from the last step's overshoot
    assert closed_form(e) == pytest.approx(expected, abs=1e-5)
    assert rebound(e)[0] == pytest.approx(expected, abs=3e-4)


@pytest.mark.parametrize(("stiffness", "exponent", "mass", "speed"), [(1e9, 1.0, 7.0, 3.0), (3e8, 1.5, 0.5, 0.1)])
def test_restitution_does_not_depend_on_stiffness_exponent_mass_or_speed(stiffness, exponent, mass, speed):
    assert rebound(0.5, stiffness, exponent, mass, speed)[0] == pytest.approx(0.72524, abs=1e-3)


def test_restitution_converges_first_order_in_the_step():
    # the contact opens within a step: the overshoot is of the order of h
    scale = np.sqrt(2.0 / 1e6)
    errors = [abs(rebound(0.5, h=h * scale)[0] - closed_form(0.5)) for h in (1e-2, 1e-3, 1e-4)]
    assert errors[0] > errors[2]
    assert errors[2] < 3e-4


def test_dissipated_energy_is_what_the_mass_lost():
    mass, speed = 2.0, 0.7
    r, dissipated, peak = rebound(0.5, mass=mass, speed=speed)
    lost = 0.5 * mass * speed**2 * (1 - r**2)
    assert dissipated == pytest.approx(lost, rel=1e-3)
    assert 0 < peak < 0.5 * mass * speed**2


def test_contact_never_pulls():
    # leaving fast: the law alone would give a negative force
    @wp.kernel(enable_backward=False, module="unique")
    def force_at(law: KINDS.ContactLaw, out: wp.array(dtype=wp.float64)):
        force, first, dissipated, energy = penalty(wp.float64(1e-5), wp.float64(-10.0), wp.float64(0.1), law)
        out[0] = force
        out[1] = dissipated

    law = KINDS.ContactLaw()
    law.stiffness, law.exponent, law.hysteresis, law.speed_floor = 1e8, 1.0, 0.5, 0.01
    out = wp.full(2, -7.0, dtype=wp.float64, device="cpu")
    wp.launch(force_at, dim=1, inputs=[law, out], device="cpu")
    assert out.numpy()[0] == 0.0
    assert out.numpy()[1] == pytest.approx(1e8 * 1e-5 * 10.0)  # the spring's energy goes as fast as it opens
