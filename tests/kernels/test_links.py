"""Links of two kinds and with play, against closed forms."""

import numpy as np
import pytest
from drives import row, two_sprockets
from raw import chain, run, state

from warpchain.assembly import assemble
from warpchain.assembly.timestep import highest_frequency

PITCH, MASS, STIFFNESS, PLAY = 0.1, 2.0, 5e6, 1e-4
FIT = {"sprockets.driven.center": [20 * 0.05 * 1.0004, 0.0]}
"""Taut by about 4e-4 of the strands where links are as new."""


def pushed(amplitude, steps, frame_interval=0, **links):
    """Two masses pushed at each other between walls: here two that swing against each other on two links in parallel,
    as far as the play lets them go and beyond, `amplitude` beyond it, a closed chain of two."""
    position = np.array([[0.0, 0.0], [PITCH + PLAY + amplitude, 0.0]])
    packed = chain(position, np.zeros((2, 2)), mass=MASS, pitch=PITCH, stiffness=STIFFNESS, step=1e-6, steps=steps,
                   frame_interval=frame_interval)  # fmt: skip
    row = packed.chains[0]
    row["play"] = PLAY
    row["outer_stiffness"] = links.get("outer_stiffness", STIFFNESS)
    return run(packed)


@pytest.mark.parametrize("outer", [STIFFNESS, 2e6])
@pytest.mark.parametrize("amplitude", [5e-5, 4e-4])
def test_period_with_play(amplitude, outer):
    # half a period on the springs pi / omega each way and 2 s free at A omega: T = 2 pi / omega + 4 s / (A omega), with
    # omega of the distance: both links' springs on half the mass
    omega = np.sqrt(2 * (STIFFNESS + outer) / MASS)
    period = 2 * np.pi / omega + 4 * PLAY / (amplitude * omega)
    steps = round(10 * period / 1e-6)
    engine, frames = pushed(amplitude, steps, 1, outer_stiffness=outer)
    apart = frames[:, 1] - frames[:, 0] - PITCH
    rising = np.flatnonzero((apart[:-1] < 0) & (apart[1:] >= 0))
    crossings = rising + apart[rising] / (apart[rising] - apart[rising + 1])
    # leapfrog is off by (omega h)^2 / 24 < 5e-7, and by as much where a spring begins within a step
    assert np.diff(crossings).mean() * 1e-6 == pytest.approx(period, rel=1e-5)
    assert apart.max() == pytest.approx(PLAY + amplitude, rel=1e-5)
    assert apart.min() == pytest.approx(-PLAY - amplitude, rel=1e-5)
    sums = engine.sums()["chain"][0]
    assert sums["energy_start"] == pytest.approx(0.5 * (STIFFNESS + outer) * amplitude**2, rel=1e-12)
    assert sums["energy_end"] == pytest.approx(sums["energy_start"], rel=1e-5)


def test_momentum_is_conserved_with_uneven_links():
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    position = PITCH / (2 * np.sin(np.pi / n)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    velocity = np.random.default_rng(1).normal(size=(n, 2))
    packed = chain(position, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, damping=50.0, step=4e-6, steps=4000)
    row = packed.chains[0]
    row["play"], row["outer_stiffness"], row["outer_damping"] = PLAY, 2e6, 200.0
    engine, _ = run(packed)
    # forces between two rollers are opposite to the last bit; what is left is the rounding of 4000 sums
    np.testing.assert_allclose(state(engine)[2:].sum(axis=1), velocity.sum(axis=0), atol=1e-11)
    sums = engine.sums()["chain"][0]
    lost = sums["energy_start"] - sums["energy_end"]
    # dampers read leapfrog's speed half a step late: first order, c h / m = 4e-4 of what they take
    assert sums["dissipated"] == pytest.approx(lost, rel=5e-3)


def test_lengths_alternate_and_close_the_chain():
    drive = two_sprockets(span=20.2).with_values({"chain.outer": {"elongation": 0.02}})
    lengths = drive.chain.link_lengths
    np.testing.assert_allclose(lengths[::2], 0.051, rtol=1e-15)
    np.testing.assert_allclose(lengths[1::2], 0.05, rtol=1e-15)
    same = two_sprockets(span=20.2).with_values({"chain.elongation": 0.01})
    assert drive.chain.worn_pitch == pytest.approx(same.chain.worn_pitch, rel=1e-15)
    # the path is that of a chain 1 % longer; an odd link more or less on a strand is worth 1 % of a pitch
    strands = 2 * 20
    assert assemble(drive).strain == pytest.approx(assemble(same).strain, abs=2 * 0.01 / strands)


def test_step_limit_takes_one_link_of_each_kind():
    drive = two_sprockets(stiffness=5e7, contact=2e8).with_values({"chain.outer": {"stiffness": 9e7}})
    # K (z - 1) R^2 / J of the sprocket that turns freely
    turning = 19 * 2e8 * (0.025 / np.sin(np.pi / 20)) ** 2 / 2.0
    expected = np.sqrt((2 * (5e7 + 9e7) + 2e8) / 1.0 + turning)
    assert highest_frequency(drive, damped_links=False) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {"chain.outer": {"stiffness": 3e7, "damping": 1e3}},
        {"chain.play": 1e-5, "chain.outer": {"stiffness": 3e7}, **FIT},
        {"chain.outer": {"elongation": 4e-4}, "sprockets.driven.center": [20 * 0.05 * 1.0008, 0.0]},
        {"chain.play": 1e-5, "chain.joint": {"friction": 0.1, "pin_radius": 0.005}, **FIT},
    ],
    ids=["stiffness", "play", "elongation", "joints"],
)
def test_drives_with_uneven_links_settle_and_keep_the_energy_balance(values):
    found = row(two_sprockets(speed=20.0).with_values(FIT | values))
    assert found["settle_residual"] < 1e-3
    # of the energy that is turned over leapfrog's balance misses (omega h)^2, 1e-4 here
    assert abs(found["energy_residual_relative"]) < 1e-4
