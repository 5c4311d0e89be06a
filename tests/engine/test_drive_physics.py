"""Whole drives against closed forms: torque balance, polygon action, energy, integrators, precision."""

import numpy as np
import pytest
from drives import example, row, two_sprockets

from warpchain import Record, simulate
from warpchain.model import single_chain


@pytest.mark.usefixtures("device")
def test_mean_moment_is_the_load_in_steady_running():
    # torque balance: over the window, mean moment = load + J (change of speed) / window
    drive = two_sprockets(torque=300.0, viscous=10.0, duration=1.5, span=20.002, speed=2.0, seat_angle=115.0)
    run = simulate(drive, window=(0.5, 1.5))
    values = run.metrics.to_pylist()[0]
    speed = values["driven.speed_mean"]
    assert speed == pytest.approx(2.0, rel=1e-2)
    # the load, and what the sprocket's own speed has gained over the window
    ends = np.searchsorted(run[0].time, (0.5 - 1e-9, 1.5 - 1e-9))
    gained = 2.0 * np.diff(run[0].sprocket_speed[ends, 1])[0]
    assert values["driven.moment_mean"] == pytest.approx(300.0 + 10.0 * speed + gained, rel=1e-6)
    # (T_tight - T_slack) R lies between the two moments, which impacts set apart; the strand that reaches the driver
    # pulls
    radius = single_chain(drive).pitch_radius(1)
    difference = values["driven->driver.tension_mean"] - values["driver->driven.tension_mean"]
    assert 0.99 * values["driven.moment_mean"] < difference * radius < -1.01 * values["driver.moment_mean"]
    assert difference * radius == pytest.approx(values["driven.moment_mean"], rel=5e-2)


def ratio_range(half, stiffness, contact, inertia):
    """Extremes of the speed ratio of slow z = 16 sprockets with strands of 7 (whole) or 7.5 (half-odd) pitches."""
    span, links, speed = (7.5, 31, 0.4) if half else (7.0, 30, 0.4)
    tooth_time = 2 * np.pi / 16 / speed
    drive = two_sprockets(teeth=16, links=links, span=span * (1 + 1e-5), stiffness=stiffness, contact=contact,
                          damping=1.2e-4 * stiffness, torque=400.0, inertia=inertia, speed=speed, duration=4 *
                          tooth_time, step=4e-6, clearance=1e-6, restitution=1.0, load_ramp=tooth_time,
                          seat_angle=110.0)  # fmt: skip
    angle = simulate(drive, record=Record(rate=2000.0, channels=("sprocket_angle",)))[0].sprocket_angle
    # the chain rings at hundreds of hertz, the teeth pass at 1: the ratio is taken over 1/40 of a tooth
    n = int(tooth_time / 40 * 2000.0)
    ratio = ((angle[n:, 1] - angle[:-n, 1]) / (angle[n:, 0] - angle[:-n, 0]))[len(angle) // 2 :]
    return ratio.min(), ratio.max()


@pytest.mark.filterwarnings("ignore:chain.links")
def test_polygon_action_at_half_odd_and_whole_strands():
    # a tight strand of 7.5 pitches: between cos(pi/16) = 0.98079 and its inverse 1.01959; of 7 pitches: constant.
    # Reached
    # as links and contacts stiffen and inertia shrinks; what is left here is ringing of some 1e-3
    low, high = ratio_range(True, 5e8, 2e9, 2.0)
    assert low == pytest.approx(np.cos(np.pi / 16), abs=1e-3)
    assert high == pytest.approx(1 / np.cos(np.pi / 16), abs=2e-3)
    softer_low, softer_high = ratio_range(True, 1e8, 4e8, 20.0)
    assert abs(softer_high - 1.01959) + abs(softer_low - 0.98079) > abs(high - 1.01959) + abs(low - 0.98079)
    low, high = ratio_range(False, 5e8, 2e9, 2.0)
    assert low == pytest.approx(1.0, abs=3e-3)
    assert high == pytest.approx(1.0, abs=3e-3)


@pytest.mark.usefixtures("device")
def test_energy_balance_closes_and_improves_with_the_step():
    residuals = []
    for step in (8e-6, 4e-6, 2e-6):
        values = row(two_sprockets(step=step, duration=0.4))
        residuals.append(abs(values["energy_residual_relative"]))
    assert residuals[0] < 5e-3
    assert residuals[2] < residuals[0]


@pytest.mark.usefixtures("device")
def test_dissipation_is_never_negative_by_part():
    values = row(two_sprockets(duration=0.3))
    parts = {name: value for name, value in values.items() if name.endswith("dissipated")}
    assert set(parts) == {"links.dissipated", "driver.dissipated", "driven.dissipated"}
    assert all(value >= 0.0 for value in parts.values())


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
@pytest.mark.usefixtures("device")
def test_integrators_agree_on_a_drive_with_contacts(integrator):
    fine = simulate(two_sprockets(duration=0.01, step=5e-7, integrator="rk4", settle="false"))[0]
    coarse = simulate(two_sprockets(duration=0.01, step=2e-6, integrator=integrator, settle="false"))[0]
    apart = np.abs(fine.position - coarse.position).max()
    assert apart < 5e-6  # contacts open and close within steps: first order in h there


@pytest.mark.usefixtures("device")
def test_float32_tension_follows_float64():
    # until contacts make the motion chaotic; plain float32 positions would lose 1e-7 m * 5e7 N/m = 5 N a link here
    drive = two_sprockets(duration=0.01, gravity=-9.81)
    exact, single = simulate(drive)[0], simulate(drive, precision="float32")[0]
    assert single.tension.dtype == np.float32
    assert np.abs(single.tension - exact.tension).max() < 1e-3 * exact.tension.mean()
    assert np.abs(single.position - exact.position).max() < 1e-6


@pytest.mark.usefixtures("device")
def test_marine_drive_carries_about_20_kn_and_its_load():
    drive = example("marine")
    values = simulate(drive, record=Record(variants="none"), window=(1.0, 2.0)).metrics.to_pylist()[0]
    assert not values["diverged"]
    assert values["tension_mean"] == pytest.approx(20e3, rel=0.15)
    load = 9000.0 + 50.0 * values["camshaft.speed_mean"]
    assert values["camshaft.moment_mean"] == pytest.approx(load, rel=0.02)
    assert abs(values["energy_residual_relative"]) < 0.01


@pytest.mark.usefixtures("device")
def test_marine_metrics_in_float32_are_those_of_float64():
    # joint friction keeps the motion regular: stiffnesses 1e-13 apart give means 6e-14 apart, and float32 is 1e-4 off
    drive = example("marine")
    options = {"record": Record(variants="none"), "window": (0.5, 2.0)}
    exact = simulate(drive, **options).metrics
    single = simulate(drive, precision="float32", **options).metrics
    for name, tolerance in (
        ("tension_mean", 1e-3),
        ("tension_std", 1e-3),
        ("camshaft.moment_mean", 1e-5),
        ("camshaft.speed_mean", 1e-6),
    ):
        assert single[name][0].as_py() == pytest.approx(exact[name][0].as_py(), rel=tolerance), name
    for metrics in (exact, single):  # some 3e-7 of either
        assert abs(metrics["energy_residual_relative"][0].as_py()) < 1e-5
