"""A guide-bar is entered through its face: what comes from elsewhere feels nothing and is counted."""

import numpy as np
import pytest
import raw

from warpchain.engine.settling import settling_ensemble

LINKS, PITCH, MASS, RADIUS, CONTACT = 10, 0.05, 0.5, 0.015, 1e6


def near_bar(height, speed, *, end_radius=0.1, steps=4000, **options):
    """A straight chain whose rollers' centers are at a height above the face of a bar, moving up at a speed."""
    position = np.stack([PITCH * np.arange(LINKS), np.full(LINKS, height)], axis=1)
    bar = {"start": (-1.0, 0.0), "end": (1.0, 0.0), "roller_radius": RADIUS, "stiffness": CONTACT}
    packed = raw.chain(
        position, np.tile((0.0, speed), (LINKS, 1)), mass=MASS, pitch=PITCH, stiffness=1e6,
        guides=[bar | {"end_radius": end_radius}], step=5e-5, steps=steps, window=(0, steps), **options,
    )  # fmt: skip
    packed.lengths[-1] = (LINKS - 1) * PITCH
    return packed


def outcome(packed):
    """Heights and speeds of the rollers, sums of the bar's contacts, and the change of energy over the window."""
    engine, _ = raw.run(packed)
    _, y, _, vy = raw.state(engine)
    chain = engine.sums()["chain"][0]
    return y, vy, engine.sums()["contact"][0], chain["energy_end"] - chain["energy_start"]


BOTH = pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])


@BOTH
@pytest.mark.parametrize("end_radius", [0.1, 1e-3], ids=["thick", "thin"])
def test_a_chain_that_comes_from_behind_passes_and_is_counted(integrator, end_radius):
    # it flies on as if nothing were there: without the rule the bar threw it out, with energy from nowhere
    start = -end_radius - 0.01
    y, vy, sums, change = outcome(near_bar(start, 1.0, end_radius=end_radius, integrator=integrator))
    np.testing.assert_allclose(y, start + 4000 * 5e-5, rtol=1e-9)
    np.testing.assert_array_equal(vy, 1.0)
    assert (sums["missed"], sums["impacts"], sums["impulse"]) == (LINKS, 0, 0.0)
    assert change == 0.0


@BOTH
def test_a_chain_that_begins_deep_inside_feels_nothing_until_it_has_left(integrator):
    y, vy, sums, _ = outcome(near_bar(0.4 * RADIUS, 0.0, integrator=integrator, steps=100))
    np.testing.assert_array_equal(y, 0.4 * RADIUS)
    assert sums["missed"] == LINKS and sums["impulse"] == 0.0
    # thrown up, it leaves and comes back through the face, from which it rebounds
    packed = near_bar(0.4 * RADIUS, 0.5, integrator=integrator, gravity=(0.0, -9.81), steps=3000)
    y, vy, sums, _ = outcome(packed)
    assert sums["missed"] == LINKS and sums["impacts"] >= LINKS
    assert (y > RADIUS - 1e-3).all()


@BOTH
def test_a_chain_that_comes_through_the_face_is_held_however_deep_it_goes(integrator):
    # so fast that it goes v sqrt(m / K) = 0.8 of its radius deep, beyond where entry would be denied
    y, vy, sums, change = outcome(near_bar(RADIUS + 1e-3, -17.0, integrator=integrator, steps=400))
    assert (sums["missed"], sums["impacts"]) == (0, LINKS)
    assert sums["force_max"] > 0.75 * RADIUS * CONTACT
    # the contact's h omega = 0.07 and begins within a step: (h omega)^2 of the energy
    np.testing.assert_allclose(vy, 17.0, rtol=5e-3)


def test_who_is_inside_as_the_window_begins_is_counted():
    packed = near_bar(0.0, 0.0, steps=100)
    packed.drives["window_start"] = 50
    assert outcome(packed)[2]["missed"] == LINKS


def test_settling_pushes_out_whoever_assembly_put_inside():
    still = settling_ensemble(near_bar(0.2 * RADIUS, 0.0, steps=10))
    assert outcome(still)[2]["missed"] == 0
    assert outcome(still)[2]["impulse"] > 0.0
