"""Contact laws: restitution against its closed form, no adhesion, energy accounts."""

import numpy as np
import pytest
import warp as wp
from bouncing import KINDS, bounce, leap, response
from own_kernels import kernel
from scipy.optimize import brentq

from warpchain.kernels.physics.impact import contact_force


def rebound(e, stiffness=1e6, exponent=1.0, mass=2.0, speed=0.7, h=None):
    law = KINDS.ContactLaw()
    law.stiffness, law.exponent, law.damping, law.speed_floor = stiffness, exponent, 0.75 * (1 - e * e), 1e-9
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


def responses(penetration, speed, impact_speed):
    """Length of the force, its size and the damper's part [N] of a linear contact of 1e8 N/m, d = 0.5."""
    law = KINDS.ContactLaw()
    law.stiffness, law.exponent, law.damping, law.speed_floor = 1e8, 1.0, 0.5, 0.01
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


def leaps(law, mass, pull, begin, h, steps):
    """Penetrations and speeds (steps, 2) of a mass on a contact, by leapfrog."""
    law.lag, law.yielding, law.ahead = 0.5 * h, 0.5 * h / mass, 1.0
    out = wp.zeros(steps, dtype=wp.vec2d, device="cpu")
    wp.launch(leap, dim=1, inputs=[law, mass, pull, wp.vec2d(*begin), h, out], device="cpu")
    return out.numpy()


def law_of(form, stiffness, damping, floor=0.01):
    law = KINDS.ContactLaw()
    law.form, law.stiffness, law.exponent, law.damping, law.speed_floor = form, stiffness, 1.0, damping, floor
    return law


@pytest.mark.parametrize("h", [1e-7, 1e-5, 1e-3, 1e-1])
def test_a_mass_on_a_damper_moves_at_force_over_damping_at_any_step(h):
    # a damper of 1e5 N s/m stops 1 kg within 1e-5 s: far longer steps turn its speed around where it is taken late
    speed = leaps(law_of(1, 0.0, 1e5), 1.0, 50.0, (1e-3, 5e-4), h, 50)[:, 1]
    np.testing.assert_allclose(speed, 50.0 / 1e5, rtol=1e-9)
    begun = leaps(law_of(1, 0.0, 1e5), 1.0, 50.0, (10.0, 0.5), 1e-2, 20_000)[-1, 1]  # comes to it, whatever the step
    assert begun == pytest.approx(50.0 / 1e5, rel=1e-9)


def test_a_seated_mass_decays_as_its_law_says():
    # about N / K the contact damps by c = d N / v_min, centered in time: amplitudes fall by exp(-c t / (2 m)), at steps
    # at which c h / m is 0.06 and 0.4. Second order: errors of (omega h)^2 / 24 of frequency and rate, 3 % at most
    mass, stiffness, factor, pull, floor = 1.0, 1e8, 2e-3, 1e4, 0.01
    rate = factor * pull / floor / (2.0 * mass)
    for h in (3e-5, 6e-5):
        place = leaps(law_of(0, stiffness, factor, floor), mass, pull, (pull / stiffness * 1.001, 0.0), h, 400)[:, 0]
        swing = np.abs(place - pull / stiffness)
        peaks = np.flatnonzero((swing[1:-1] > swing[:-2]) & (swing[1:-1] > swing[2:])) + 1
        found = -np.polyfit(h * peaks, np.log(swing[peaks]), 1)[0]
        assert found == pytest.approx(rate, rel=0.05)


@pytest.mark.parametrize(("steps", "exact"), [(8, 6e-3), (16, 2e-3), (32, 6e-4)])
def test_a_coarse_step_keeps_the_restitution(steps, exact):
    # `steps` to a contact of pi sqrt(m / K); 0.68422 for e = 0.3
    mass, stiffness, speed = 2.0, 1e6, 0.7
    h = np.pi * np.sqrt(mass / stiffness) / steps
    law = law_of(0, stiffness, 0.75 * (1 - 0.3 * 0.3), 1e-9)
    phases = [-leaps(law, mass, 0.0, (-part * h * speed, speed), h, 4 * steps)[-1, 1] / speed
              for part in np.linspace(0.05, 0.95, 19)]  # fmt: skip
    assert np.mean(phases) == pytest.approx(0.68422, abs=exact)


@kernel
def squeeze(law: KINDS.ContactLaw, mass: wp.float64, depth: wp.float64, begin: wp.float64, h: wp.float64,
            out: wp.array[wp.float64]):  # fmt: skip
    """Places of a mass between two contacts, which press on it from both sides: the second sees the first."""
    x = begin
    none = wp.float64(0.0)
    v = none
    for i in range(out.shape[0]):
        out[i] = x
        first, acts = contact_force(law.stiffness * (depth - x), -v, none, law.speed_floor, none, law)
        second, acts = contact_force(law.stiffness * (depth + x), v, first / mass, law.speed_floor, none, law)
        v += h * (first - second) / mass
        x += h * v


@pytest.mark.parametrize("h", [1.5e-5, 3e-5])
def test_a_mass_between_two_contacts_decays_by_both_dampers(h):
    # m x'' = -2 K x - 2 c x', c = d N / v_min: amplitudes fall by exp(-c t / m). What the first contact does not know
    # of the second shifts the place of rest by c h / (4 m) of the depth, of first order in h; 5 % as of one contact
    mass, stiffness, factor, pull, floor = 1.0, 1e8, 2e-3, 1e4, 0.01
    law, depth = law_of(0, stiffness, factor, floor), pull / stiffness
    law.lag, law.yielding = 0.5 * h, 0.5 * h / mass
    out = wp.zeros(4000, dtype=wp.float64, device="cpu")
    wp.launch(squeeze, dim=1, inputs=[law, mass, depth, 1e-3 * depth, h, out], device="cpu")
    place, damper = out.numpy(), factor * pull / floor
    assert place[-1] == pytest.approx(-0.25 * damper * h / mass * depth, rel=0.1)
    swing = np.abs(place[:300] - place[-1])
    peaks = np.flatnonzero((swing[1:-1] > swing[:-2]) & (swing[1:-1] > swing[2:])) + 1
    assert -np.polyfit(h * peaks, np.log(swing[peaks]), 1)[0] == pytest.approx(damper / mass, rel=0.05)
