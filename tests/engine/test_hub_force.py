"""The chain's force on the hubs, as the kernels add it up, against the tensions of the strands and against frames."""

from dataclasses import replace

import numpy as np
import pytest
from drives import two_sprockets

from warpchain import Record, simulate
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.shaft_signals import hub_forces


@pytest.fixture(scope="module")
def run():
    drive = two_sprockets(speed=20.0, duration=0.6, ramp=0.1, load_ramp=0.1, viscous=5.0, span=20.0 * (1 + 1e-3))
    return simulate(drive, device="cpu", window=(0.3, 0.6), record=Record(rate=10000.0))


def test_hubs_bear_the_strands_less_what_turns_the_chain_around(run):
    # momentum of the chain that comes and goes through the two parallel strands: T_t + T_s - 2 m v^2 / p on either hub,
    # m / p the mass per length; the strands bend by little more than (sag / span)^2
    row, drive = run.metrics.to_pylist()[0], run.drives[0]
    tight, slack = (row[f"{name}.tension_mean"] for name in drive.strand_names)
    v = row["driver.speed_mean"] * 20 * 0.05 / (2.0 * np.pi)
    pull = tight + slack - 2.0 * drive.chain.mass / drive.chain.pitch * v * v
    assert row["driver.hub_force_x_mean"] == pytest.approx(pull, rel=0.01)
    assert row["driven.hub_force_x_mean"] == pytest.approx(-pull, rel=0.01)
    assert abs(row["driver.hub_force_y_mean"]) < 0.02 * pull
    assert row["driver.hub_force_max"] >= np.hypot(row["driver.hub_force_x_mean"], row["driver.hub_force_y_mean"])
    # nothing else holds the chain: both hubs together bear what its momentum changes by, next to nothing in the mean
    assert abs(row["driver.hub_force_x_mean"] + row["driven.hub_force_x_mean"]) < 0.005 * pull


def test_frames_tell_the_same_without_tooth_friction(run):
    row, found = run.metrics.to_pylist()[0], EngineeringReport(run[0], 0.3, 0.6)
    mean = found.hub_forces.mean(axis=0)
    for s, name in enumerate(("driver", "driven")):
        # 3,000 frames of a window of 60,000 steps
        assert mean[s, 0] == pytest.approx(row[f"{name}.hub_force_x_mean"], rel=0.01)
        assert np.hypot(*found.hub_forces[:, s].T).max() <= row[f"{name}.hub_force_max"] * (1 + 1e-9)


def test_recorded_every_step_the_channel_is_what_the_kernel_adds_up():
    """Trapezoids of all steps of a window are its mean; with friction, which frames of normal forces do not have."""
    drive = two_sprockets(speed=20.0, duration=0.002).with_values(
        {"contact.sprocket.friction": 0.2, "chain.elongation": -1e-3}
    )
    record = Record(rate=1e9, channels=CHANNEL_NAMES)
    run = simulate(drive, device="cpu", window=(0.001, 0.002), record=record)
    row, trajectory = run.metrics.to_pylist()[0], run[0]
    within = trajectory.time > 0.001 - 1e-9
    for s, name in enumerate(("driver", "driven")):
        force, time = trajectory.hub_force[within, s], trajectory.time[within]
        mean = np.trapezoid(force, time, axis=0) / (time[-1] - time[0])
        # window and frames are both of every step: round-off
        np.testing.assert_allclose(mean[0], row[f"{name}.hub_force_x_mean"], rtol=1e-9)
        np.testing.assert_allclose(mean[1], row[f"{name}.hub_force_y_mean"], rtol=1e-9)
        assert np.hypot(*force.T).max() == pytest.approx(row[f"{name}.hub_force_max"], rel=1e-12)
    bare = replace(trajectory, hub_force=None)
    assert np.abs(hub_forces(bare) - trajectory.hub_force).max() > 0.02 * np.abs(trajectory.hub_force).max()


def test_share_of_links_without_tension(run):
    row, tension = run.metrics.to_pylist()[0], run[0].tension[run[0].time >= 0.3]
    # bins end at no tension, so that the share is counted, every 64th step; frames come every 20th
    assert 0.0 < row["slack"] < 1.0
    assert row["slack"] == pytest.approx((tension < 0.0).mean(), abs=0.01)


def test_metrics_of_a_recording(run):
    found = EngineeringReport(run[0], 0.3, 0.6).metrics()
    assert set(found) >= {"driven.phase_mean", "driver.jump_margin", "driver->driven.slack_time"}
    assert found["driven.phase_mean"] < 0.0  # the load pulls it back
    assert 0.0 < found["driver.jump_margin_relative"] <= 1.0 + 1e-3
