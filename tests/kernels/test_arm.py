"""An arm on its own: free swing, spring, stops, energy; and what a chain does to it."""

import numpy as np
import pytest
import raw

INERTIA, MOMENT, WEIGHT = 6e-4, 0.09 * 0.08, 9.81


def swinging(*, steps, step=1e-4, integrator="leapfrog", gravity=(0.0, 0.0), window=None, **arm):
    """An arm and a chain far away that nothing touches; returns the engine and the arm's last state."""
    position, _ = raw.polygon(6, 0.01)
    packed = raw.chain(
        position + 50.0, np.zeros((6, 2)), mass=0.01, pitch=0.01, stiffness=1e5, gravity=gravity, step=step,
        steps=steps, integrator=integrator, window=window, arms=[{"pivot": (0.1, 0.2), "inertia": INERTIA} | arm],
    )  # fmt: skip
    engine, _ = raw.run(packed)
    return engine, engine.bodies()[0]


@pytest.mark.parametrize("integrator, order", [("leapfrog", 2), ("rk4", 4)])
def test_torsion_spring(integrator, order):
    # theta = theta_0 + a cos(w t): the error after ten periods shrinks by 2^order with half the step
    stiffness, start, free = 5.0, 0.1, -0.02
    omega = np.sqrt(stiffness / INERTIA)
    errors = []
    for steps in (2000, 4000):
        step = 20.0 * np.pi / omega / steps
        _, body = swinging(
            steps=steps, step=step, integrator=integrator, stiffness=stiffness, free_angle=free, angle=start
        )
        errors.append(abs(body["angle"] - start))
    amplitude = start - free
    # a leapfrog's period is shorter by (w h)^2 / 24, and at the turn its angle is off by the square of that
    assert errors[0] < 1e-2 * amplitude
    assert errors[1] < errors[0] / 2 ** (order - 0.5)


def test_free_swing_of_a_pendulum():
    # small amplitude a: period 2 pi sqrt(I / (m g l)) (1 + a^2 / 16); after a quarter of it the arm hangs straight.
    amplitude = 0.05
    period = 2.0 * np.pi * np.sqrt(INERTIA / (MOMENT * WEIGHT)) * (1.0 + amplitude**2 / 16.0)
    steps = 4000
    _, body = swinging(
        steps=steps, step=0.25 * period / steps, gravity=(0.0, -WEIGHT), mass_moment=(0.0, -MOMENT), angle=amplitude,
    )  # fmt: skip
    assert abs(body["angle"]) < 1e-5 * amplitude + 1.6e-3 * amplitude**3  # the period's next term, 11 a^4 / 3072


def test_stops_hold_and_push_only():
    # let go at rest with a steady spring moment against the upper stop it comes to rest at moment / stiffness beyond it
    stiffness, stop = 2.0, 4e4
    damping = 2.0 * np.sqrt(stop * INERTIA)
    _, body = swinging(
        steps=20000, step=2e-5, stiffness=stiffness, free_angle=1.0, stops=(-0.1, 0.05), stop_stiffness=stop,
        stop_damping=damping,
    )  # fmt: skip
    beyond = stiffness * (1.0 - 0.05) / (stop + stiffness)
    assert body["angle"] == pytest.approx(0.05 + beyond, abs=1e-9)
    assert abs(body["speed"]) < 1e-6


def test_energy_of_a_damped_arm_on_its_stops():
    # kinetic + elastic + weight at the window's ends, and what damper and stops took: the balance closes with the step,
    # between h and h^2, as a stop begins to act within a step
    residuals = []
    for steps in (4000, 8000):
        engine, body = swinging(
            steps=steps, step=0.2 / steps, gravity=(0.0, -WEIGHT), mass_moment=(MOMENT, 0.0), damping=2e-4,
            stops=(-0.3, 0.3),
            stop_stiffness=20.0, stop_damping=1e-3, angle=0.25, speed=20.0,
        )  # fmt: skip
        chain, arm = engine.sums()["chain"][0], engine.sums()["arm"][0]
        lost = chain["energy_start"] - chain["energy_end"]
        residuals.append(abs(lost - arm["dissipated"]) / lost)
        assert arm["angle_max"] > 0.3 and lost > 0.02
    assert residuals[1] < 0.6 * residuals[0] and residuals[1] < 2e-4
