"""Arms on arms: the double pendulum's normal frequencies, its energy, a spring in the joint."""

import numpy as np
import pytest
import raw
from scipy.linalg import eigh

G = 9.81
UPPER = {"pivot": (0.1, 0.2), "inertia": 0.05, "moment": 0.18}  # its own inertia and m l
LOWER = {"inertia": 0.012, "moment": 0.06, "mass": 0.5}
LENGTH = 0.3  # from the one pivot to the other


def hanging(angles, *, steps, step, integrator="leapfrog", speeds=(0.0, 0.0), window=None, gravity=G, **joint):
    """A double pendulum that is let go at two angles [rad], beside a chain that nothing touches; the engine."""
    position, _ = raw.polygon(6, 0.01)
    weight = {"mass_moment": (0.0, -(UPPER["moment"] + LOWER["mass"] * LENGTH))}
    upper = {"pivot": UPPER["pivot"], "inertia": UPPER["inertia"] + LOWER["mass"] * LENGTH**2} | weight
    lower = {"pivot": (0.1, 0.2 - LENGTH), "inertia": LOWER["inertia"], "mass_moment": (0.0, -LOWER["moment"])}
    lower |= {"on": 1, "lever": (0.0, -LENGTH)} | joint
    arms = [one | {"angle": angle, "speed": w} for one, angle, w in zip((upper, lower), angles, speeds, strict=True)]
    packed = raw.chain(
        position + 50.0, np.zeros((6, 2)), mass=0.01, pitch=0.01, stiffness=1e5, gravity=(0.0, -gravity), step=step,
        steps=steps, integrator=integrator, window=window, arms=arms,
    )  # fmt: skip
    packed.drives["jointed"] = packed.drives["hubs"] = 1
    packed.bodies["center"][1] = np.add(UPPER["pivot"], LENGTH * np.array([np.sin(angles[0]), -np.cos(angles[0])]))
    engine, _ = raw.run(packed)
    return engine


def modes(stiffness=0.0, gravity=G):
    """Frequencies [rad/s] and shapes of small swings: M theta'' = -K theta in absolute angles."""
    c, hung = LOWER["moment"] * LENGTH, UPPER["moment"] + LOWER["mass"] * LENGTH
    mass = [[UPPER["inertia"] + LOWER["mass"] * LENGTH**2, c], [c, LOWER["inertia"]]]
    spring = np.diag([hung * gravity, LOWER["moment"] * gravity]) + stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    square, shapes = eigh(spring, mass)
    return np.sqrt(square), shapes.T / np.abs(shapes).max(axis=0)[:, None]


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
@pytest.mark.parametrize("stiffness", [0.0, 3.0])
@pytest.mark.parametrize("k", [0, 1])
def test_normal_modes_of_a_double_pendulum(k, stiffness, integrator):
    # from rest in a mode's shape both hang straight after a quarter of its period, at w times their amplitudes: what is
    # left out goes with the square of the amplitude a, a^2 / 16 of the period and as much of the other mode
    omega, shape = (found[k] for found in modes(stiffness))
    amplitude, steps = 2e-3, 5000
    step = 0.5 * np.pi / omega / steps
    engine = hanging(amplitude * shape, steps=steps, step=step, integrator=integrator, stiffness=stiffness)
    angle, speed = (np.array([body[name] for body in engine.bodies()]) for name in ("angle", "speed"))
    assert angle == pytest.approx([0.0, 0.0], abs=2e-4 * amplitude)
    assert speed == pytest.approx(-omega * amplitude * shape, rel=1e-3)


@pytest.mark.parametrize("integrator, order", [("leapfrog", 2), ("rk4", 4)])
def test_energy_of_a_double_pendulum_that_goes_over(integrator, order):
    # weight and motion: of the joint only the damper takes any; what the balance misses falls with the step's order
    residuals = []
    for steps in (4000, 8000):
        engine = hanging(
            (2.0, 2.6), steps=steps, step=1.0 / steps, integrator=integrator, speeds=(1.0, -6.0), damping=2e-3,
            stiffness=0.2, window=(0, steps),
        )  # fmt: skip
        chain, arms = engine.sums()["chain"][0], engine.sums()["arm"]
        lost = chain["energy_start"] - chain["energy_end"] - chain["dissipated"]
        residuals.append(abs(lost - arms["dissipated"].sum()))
        assert arms["dissipated"][1] > 0.01 and arms["dissipated"][0] == 0.0
        assert np.ptp([arms["angle_min"][0], arms["angle_max"][0]]) > 2.0
    assert residuals[0] < 2e-3
    assert residuals[1] < residuals[0] / 1.8  # of trapezoids and of rates half a step late


def test_the_joint_turns_both_and_keeps_their_momentum():
    # without weight: L = sum of I w + the cross terms about the fixed pivot stays
    engine = hanging((0.3, -0.5), steps=20_000, step=2e-5, gravity=0.0, stiffness=4.0, window=(0, 20_000))
    (upper, lower), c = engine.bodies(), LOWER["moment"] * LENGTH
    turn = c * np.cos(lower["angle"] - upper["angle"])
    inertia = UPPER["inertia"] + LOWER["mass"] * LENGTH**2
    momentum = (inertia + turn) * upper["speed"] + (LOWER["inertia"] + turn) * lower["speed"]
    assert max(abs(upper["speed"]), abs(lower["speed"])) > 1.0
    assert abs(momentum) < 1e-4 * inertia * abs(upper["speed"])
    center = np.add(UPPER["pivot"], LENGTH * np.array([np.sin(upper["angle"]), -np.cos(upper["angle"])]))
    assert lower["center"] == pytest.approx(center, abs=1e-12)
