"""Drives whose joints rub: what they lose against closed forms, and bad input."""

import math

import numpy as np
import pytest
from drives import errors_of, marine_values, of_long, put, row, two_sprockets

from warpchain import Record, read_archive, simulate
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.losses import losses

WORN_IN, NEW = 4 / math.pi, math.pi / 2
JOINT = {"friction": 0.1, "pin_radius": 0.0075}
BOTH = ["joint_friction_power", "hub_force"]
"""The channels on request, which other tests have a kernel for."""


def strands(found):
    """Mean tension of the tight and of the slack strand [N]."""
    return sorted((found["driver->driven.tension_mean"], found["driven->driver.tension_mean"]), reverse=True)


def drive(joint, teeth=40, links=80, speed=1.0, duration=3.0, **values):
    """Two sprockets that turn quietly: seats that hug the rollers, taut strands, links well damped."""
    base = two_sprockets(
        teeth=teeth, links=links, span=20.0, speed=speed, torque=300.0, damping=2e3, restitution=0.1, clearance=2e-5,
        duration=duration, step=5e-6, viscous=5.0, ramp=0.2, load_ramp=0.2,
    )  # fmt: skip
    return base.with_values({"chain.joint": joint, "sprockets.driven.center": [1.0006, 0.0], **values})


def test_a_drive_loses_by_its_joints_what_statics_says():
    # every joint turns by 2 pi / z on and off each sprocket, under the tension of the strand there: for each link that
    # passes 2 pi kappa mu r (1/z1 + 1/z2) (T_t + T_s), of the p (T_t - T_s) that is put in
    found = row(drive(JOINT))
    tight, slack = strands(found)
    factor = 2 * math.pi * WORN_IN * 0.1 * (0.0075 / 0.05) * (1 / 40 + 1 / 40)
    loss = factor * (tight + slack) / (tight - slack)
    # strands vibrate by the teeth they pass, which turns joints to and fro: 3.9 % more at 1 rad/s, at 5 us and at 1.25
    assert found["joints.friction"] / found["input_work"] == pytest.approx(loss, rel=0.05)
    lost = sum(losses(drive(JOINT), found).values())
    assert found["efficiency"] == pytest.approx(1.0 - lost / (found["output_work"] + lost), rel=1e-12)
    assert abs(found["energy_residual_relative"]) < 1e-5  # leapfrog's


def test_the_pin_term_of_spicer():
    # N1 w1 mu r (pi/2) T0 (1/N1 + 1/N2), Spicer et al. (2001), eq. (15) with its numbers: 1.87567 W
    speed = 80 * 2 * math.pi / 60
    power = 48 * speed * 0.09 * 1.75968e-3 * NEW * 300.0 * (1 / 48 + 1 / 24)
    assert power == pytest.approx(1.87567, rel=1e-5)
    radius = 12.7e-3 / (2 * math.sin(math.pi / 24))
    values = {
        "chain.pitch": 12.7e-3, "chain.links": 114, "chain.roller_mass": 3.8e-3, "chain.stiffness": 4e6,
        "chain.damping": 6.0, "chain.roller_radius": 3.9e-3, "sprockets.driver.teeth": 48, "sprockets.driven.teeth": 24,
        "sprockets.driver.prescribed.speed": speed,
        "sprockets.driven.load.torque": 295.0 * radius, "sprockets.driven.inertia": 2e-2,
        "sprockets.driven.load.viscous": 5.0 * radius / (2 * speed), "sprockets.driven.center": [0.4945, 0.0],
        "contact.sprocket.stiffness": 2e6, "contact.sprocket.seat_angle": 130.0, "contact.sprocket.clearance": 1e-5,
        "contact.sprocket.restitution": 0.5, "run.step": 8e-7, "run.duration": 1.0,
    }  # fmt: skip
    joint = {"friction": 0.09, "pin_radius": 1.75968e-3, "factor": NEW}
    found = row(drive(joint, teeth=20, links=60, **values))
    tight, slack = strands(found)
    own = found["joints.friction"] / (found["window_end"] - found["window_start"])
    # the formula has the tight strand only; with the drive's own tensions it is linear in their sum
    assert own == pytest.approx(power * (tight + slack) / 300.0, rel=0.03)


@pytest.mark.parametrize(
    ("integrator", "channels"),
    [
        ("leapfrog", BOTH),
        *of_long(("rk4", CHANNEL_NAMES)),
        pytest.param("leapfrog", BOTH[:1], marks=pytest.mark.thorough),
    ],
)
def test_powers_of_the_joints_add_up_to_their_loss(integrator, channels, tmp_path):
    # sampled at every step, the joints' powers under the window's trapezoids are the metric's sum in another order
    drive = two_sprockets(duration=0.01, integrator=integrator).with_values({"chain.joint": JOINT})
    run = simulate(
        drive, device="cpu", window=(0.0, 0.01), archive=tmp_path / "run.mcap",
        record=Record(rate=1e9, channels=channels),
    )  # fmt: skip
    power = read_archive(tmp_path / "run.mcap")[0].joint_friction_power
    assert power.shape == (2001, 60)
    weight = np.full(2001, run.info.step)
    weight[[0, -1]] *= 0.5
    assert weight @ power.sum(axis=1) == pytest.approx(run.metrics["joints.friction"][0].as_py(), rel=1e-12)
    # a joint that turns back is given what its bristle has stored, less than a hundredth of the largest power
    assert power.min() >= -1e-2 * power.max()


def test_a_drive_without_joint_friction_has_no_friction_power():
    # its scratch still holds the moments of the variant before it, which the same thread has run
    rubbing = two_sprockets(duration=0.002)
    rubbing, bare = rubbing.with_values({"chain.joint": JOINT}), rubbing
    record = Record(channels=BOTH)
    run = simulate([rubbing, bare], device="cpu", workers=1, record=record)
    assert run[0].joint_friction_power.max() > 0.0
    assert (run[1].joint_friction_power == 0.0).all()


BAD = [
    ({"friction": -0.1, "pin_radius": 0.01}, "chain.joint.friction = -0.1: must be a number of at least 0"),
    ({"friction": 0.1}, "chain.joint.pin_radius: missing; must be a positive number; needed without a size"),
    (
        {"friction": 0.1, "pin_radius": 0.01, "static_friction": 0.05, "stribeck_speed": 0.1},
        "chain.joint.static_friction = 0.05: must be at least friction, 0.1",
    ),
    (
        {"friction": 0.1, "pin_radius": 0.01, "static_friction": 0.2},
        "chain.joint.stribeck_speed: missing; must be a positive number; needed with static_friction",
    ),
    ({"friction": 0.1, "pin_radius": 0.01, "mu": 1}, "chain.joint.mu = 1: unknown key; allowed are friction, "
     "pin_radius, factor, static_friction, stribeck_speed"),
]  # fmt: skip


@pytest.mark.parametrize(("joint", "line"), BAD)
def test_bad_joints_are_told(joint, line):
    values = marine_values()
    put(values, "chain/joint", joint)
    assert errors_of(values) == (line,)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("chain/outer", {"elongation": 0.5}, "chain.outer.elongation = 0.5: must be a number from -0.05 to 0.1"),
        ("chain/play", 0.02, "chain.play = 0.02: must be at most a tenth of the pitch, 0.01143"),
        ("chain/play", -1, "chain.play = -1: must be a number of at least 0"),
    ],
)
def test_bad_links_are_told(path, value, line):
    values = marine_values()
    put(values, path, value)
    assert errors_of(values) == (line,)


def test_outer_links_need_an_even_number():
    values = marine_values()
    put(values, "chain/outer", {"elongation": 0.01})
    put(values, "chain/links", 161)
    assert errors_of(values) == ("chain.links = 161: must be even where outer links differ",)


def test_no_coefficient_is_no_friction():
    # zero coefficients take the path without joints: the same bits, and no column
    bare = two_sprockets(duration=0.02)
    assert row(bare.with_values({"chain.joint": {"friction": 0.0, "pin_radius": 0.01}})) == row(bare)
