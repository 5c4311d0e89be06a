"""Five machines from beginning to end, as files: what overruns, slips, brakes and holds in each, and their energy."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from drives import ran

from warpchain import load_drive

FILES = Path(__file__).resolve().parents[2] / "scripts" / "drawings"
SHORT = {"kart": 0.4, "vtwin": 0.7, "elevator": 0.1, "ebike": 0.15, "reaper": 0.1}
"""Durations [s]: the beginning of each."""
pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")]


@cache
def started(name):
    """The beginning of a machine's run, and its row."""
    values = {"run.duration": SHORT[name]} | ({"run.step": 5e-6} if name == "elevator" else {})
    drive = load_drive(FILES / f"{name}.toml").with_values(values)
    run, row = ran(drive, rate=2e3, device="cpu")
    speeds = {shaft.name: np.asarray(run[0].shaft_speed[:, h], float) for h, shaft in enumerate(drive.shafts)}
    torques = {part.name: np.asarray(run[0].coupling_torque[:, c], float) for c, part in enumerate(drive.couplings)}
    return run[0], row, speeds, torques


@pytest.mark.parametrize("name", SHORT)
def test_energy_balances(name):
    _, row, _, _ = started(name)
    assert row["diverged"] == 0
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_kart_slips_away_by_its_clutch():
    # the engine settles where the clutch bears its torque: it gives the axle 6 times that, whose speed is the integral
    run, row, speeds, torques = started("kart")
    late = run.time > 0.25
    engine = speeds["engine"][late].mean()
    borne = np.interp(engine, np.array([2600.0, 4000.0]) * np.pi / 30.0, [10.0, 40.0])
    assert torques["clutch"][late].mean() == pytest.approx(borne, rel=1e-3)
    growth = np.polyfit(run.time[late], speeds["axle"][late], 1)[0]
    assert growth == pytest.approx((6.0 * borne - 3.0) / 3.204, rel=0.02)
    assert row["clutch.slip_loss"] > 100.0


def test_a_starter_lets_the_engine_run_away():
    run, _, speeds, torques = started("vtwin")
    early, late = (run.time > 0.01) & (run.time < 0.15), run.time > 0.68
    assert np.abs(speeds["starter"] - speeds["crank"])[early].max() < 0.5
    assert torques["sprag"].min() >= 0.0
    assert (torques["sprag"][late] == 0.0).all()
    assert speeds["starter"][late].max() < 0.5 * speeds["crank"][late].min()


def test_a_backstop_holds_full_buckets_until_the_motor_does():
    # it bears 900 N m of load less what the motor gives the head shaft so far, 10 times 220 S(t / 0.3), in the mean of
    # a swing of 27 Hz that dies away; 900 N m twist it by 4.5 mrad, at first by no more than twice as much
    run, _, speeds, torques = started("elevator")
    u = run.time / 0.3
    borne = 900.0 - 2200.0 * u * u * (3.0 - 2.0 * u)
    late = run.time > 0.1 - 1.0 / 26.9
    assert torques["backstop"][late].mean() == pytest.approx(borne[late].mean(), rel=0.1)
    assert torques["backstop"].min() >= 0.0
    assert -0.009 < np.asarray(run.shaft_angle[:, 0], float).min() < 0.0


def test_a_rider_drives_the_wheel_by_the_freewheel():
    run, _, speeds, torques = started("ebike")
    assert torques["freewheel"].min() >= 0.0
    assert torques["freewheel"].max() > 20.0
    assert speeds["wheel"][-1] > speeds["wheel"][0]


def test_a_reaper_starts_by_its_power_take_off():
    run, row, speeds, torques = started("reaper")
    assert torques["freewheel"].min() >= 0.0
    assert np.abs(torques["freewheel"]).max() <= 250.0
    angle = np.degrees(np.asarray(run.arm_angle[:, 0], float))
    assert angle.min() > 5.0 and angle.max() < 25.0
