"""Contact laws: restitution against its closed form, no adhesion, energy accounts."""

import numpy as np
import pytest
import warp as wp
from bouncing import KINDS, bounce, response
from scipy.optimize import brentq

UNBOUNDED = 1e30
"""Damping that no step bounds [N s/m]."""


def rebound(e, stiffness=1e6, exponent=1.0, mass=2.0, speed=0.7, h=None):
    law = KINDS.ContactLaw()
    law.stiffness, law.exponent, law.damping, law.speed_floor = stiffness, exponent, 0.75 * (1 - e * e), 1e-9
    law.most_damping = UNBOUNDED
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


@pytest.mark.parametrize(("e", "expected"), [(0.3, 0.68422), (0.5, 0.72524), (0.8, 0.84710)])
def test_restitution_is_the_closed_form(e, expected):
    # steps of 1e-4 of the contact's time scale: the error is 0.4 of their square at most
    assert closed_form(e) == pytest.approx(expected, abs=5e-6)
    assert rebound(e)[0] == pytest.approx(closed_form(e), abs=5e-9)


@pytest.mark.parametrize(("stiffness", "exponent", "mass", "speed"), [(1e9, 1.0, 7.0, 3.0), (3e8, 1.5, 0.5, 0.1)])
def test_restitution_does_not_depend_on_stiffness_exponent_mass_or_speed(stiffness, exponent, mass, speed):
    assert rebound(0.5, stiffness, exponent, mass, speed)[0] == pytest.approx(closed_form(0.5), abs=5e-9)


@pytest.mark.parametrize("e", [0.3, 0.5, 0.8])
def test_restitution_converges_with_the_square_of_the_step(e):
    # The midpoint rule is of second order, and that the contact opens within a step costs no more: the force is zero
    # there, so the overshoot by part of a step, K h v at most, acts for part of a step. Which part is chance, and
    # scatters the errors by a factor of 1.3: over two decades of the step, log(1.3) / log(100) = 0.06 in the order.
    scale, steps = np.sqrt(2.0 / 1e6), np.geomspace(1e-2, 1e-4, 7)
    errors = [abs(rebound(e, h=h * scale)[0] - closed_form(e)) for h in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.08), errors


def test_dissipated_energy_is_what_the_mass_lost():
    mass, speed = 2.0, 0.7
    r, dissipated, peak = rebound(0.5, mass=mass, speed=speed)
    lost = 0.5 * mass * speed**2 * (1 - r**2)
    # steps of 1e-4 of the contact's time scale and errors of second order: some 1e-8
    assert dissipated == pytest.approx(lost, rel=1e-7)
    # integral of m v dv / (1 + d v / v0) from rest to v0: what the spring holds where the mass turns
    d = 0.75 * (1 - 0.5**2)
    assert peak == pytest.approx(mass * speed**2 * (1 / d - np.log1p(d) / d**2), rel=1e-7)


def responses(penetration, speed, impact_speed, most_damping=UNBOUNDED):
    """Length of the force, its size and the damper's part [N] of a linear contact of 1e8 N/m, d = 0.5."""
    law = KINDS.ContactLaw()
    law.stiffness, law.exponent, law.damping, law.speed_floor = 1e8, 1.0, 0.5, 0.01
    law.most_damping = most_damping
    out = wp.full(3, -7.0, dtype=wp.float64, device="cpu")
    wp.launch(response, dim=1, inputs=[law, penetration, speed, impact_speed, out], device="cpu")
    return out.numpy()


@pytest.mark.parametrize(("speed", "part"), [(0.004, 0.4), (0.01, 1.0), (0.5, 1.0)])
def test_a_contact_that_is_pressed_in_faster_than_it_began_is_damped_no_more(speed, part):
    # a seated roller that came at the speed floor is then pushed at 50 times that: K pen (1 + d) at most
    _, size, damper = responses(1e-5, speed, 0.01)
    assert size == pytest.approx(1e3 * (1.0 + 0.5 * part), rel=1e-12)
    assert damper == pytest.approx(1e3 * 0.5 * part, rel=1e-12)


def test_contact_never_pulls():
    # leaving fast: the law alone would give a negative force; the damper takes all of the spring's
    length, size, damper = responses(1e-5, -10.0, 0.1)
    assert length + size == 0.0
    assert damper == pytest.approx(-1e8 * 1e-5)


@pytest.mark.parametrize("speed", [0.003, -0.003])
def test_a_step_takes_no_more_than_the_approach_speed(speed):
    # a seated roller under 10 kN that came at the floor: damped by d N / v0 = 5e5 N s/m it would leave each step at
    # 1 - 5e5 h / m = -4 times the speed that it came with; m / h takes all of it, either way
    mass, h = 1.0, 1e-5
    damper = responses(1e-4, speed, 0.01, most_damping=mass / h)[2]
    assert speed - h * damper / mass == pytest.approx(0.0, abs=1e-15)
