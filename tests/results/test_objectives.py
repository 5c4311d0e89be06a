"""Objectives against closed forms: rotation with a known error, a pulse of known impulse, sums of a known window."""

import math

import numpy as np
import pytest
from drives import STARTING, two_sprockets

from warpchain import Record, simulate
from warpchain.errors import SimulationError
from warpchain.model import single_chain
from warpchain.results.fatigue import Woehler
from warpchain.results.metric_columns import unit_of_metric
from warpchain.results.metric_formulas import column_of_value
from warpchain.results.metrics import design_metric_columns
from warpchain.results.objectives import add_objectives, engagement_impulses, trajectory_objectives
from warpchain.results.run import Trajectory
from warpchain.results.signals import transmission_error

DRIVE = two_sprockets(mass=1.5)


def design_row(metrics):
    """The objectives of one variant, from its other metrics."""
    columns = design_metric_columns(
        [single_chain(DRIVE)], {name: column_of_value(np.array([value])) for name, value in metrics.items()}
    )
    return {name: column.values[0] for name, column in columns.items() if not column.missing[0]}


def test_sums_of_a_window():
    """2 s at 10 rad/s forward and 5 rad/s backward: 20/2pi and 10/2pi revolutions."""
    strand = DRIVE.strand_names[0]
    metrics = {
        **{"tension_mean": 2e3, "tension_max": 5e3, "window_start": 1.0, "window_end": 3.0},
        **{"driver.speed_mean": 10.0, "driver.dissipated": 40.0, "driven.speed_mean": -5.0, "driven.dissipated": 6.0},
        **{f"{strand}.tension_mean": 4e3, f"{strand}.tension_max": 6e3},
        **{f"{strand}.displacement_mean": -3e-3, f"{strand}.displacement_rms": 5e-3},
    }
    row = design_row(metrics)
    turns = 20.0 / (2.0 * math.pi)
    assert row == pytest.approx(
        {
            "peak_factor": 2.5,
            f"{strand}.peak_factor": 1.5,
            f"{strand}.displacement_std": 4e-3,
            "driver.contact_energy_per_revolution": 40.0 / turns,
            "driven.contact_energy_per_revolution": 6.0 / turns,
            "contact_energy_per_revolution": 46.0 / turns,
            "driver.impact_impulse": math.sqrt(2.0 * 1.5 * 40.0 / (20 * turns)),
            "driven.impact_impulse": math.sqrt(2.0 * 1.5 * 6.0 / (10 * turns)),
        },
        rel=1e-12,
    )
    still = design_row(metrics | {"driver.speed_mean": 0.0, "driven.speed_mean": 0.0})
    assert set(still) == {"peak_factor", f"{strand}.peak_factor", f"{strand}.displacement_std"}


def test_transmission_error_of_a_known_rotation():
    """Driver at 10 rad/s, 20 to 40 teeth, driven clockwise with a ripple of 1 mrad: rms 1/sqrt(2), range 2 mrad."""
    drive = two_sprockets(links=80).with_values({"sprockets.driven.teeth": 40})
    time = np.linspace(0.0, 2.0, 2001)[:-1]  # whole periods: the ripple's mean is zero
    ripple = 1e-3 * np.sin(2.0 * np.pi * 5.0 * time)
    angle = np.stack([0.3 + 10.0 * time, 1.0 + 5.0 * time + ripple], axis=1)
    trajectory = Trajectory(drive, time, sprocket_angle=angle)
    assert transmission_error(trajectory, 1) == pytest.approx(ripple, abs=1e-12)
    swing = {"driven.transmission_error_rms": 1e-3 / math.sqrt(2.0), "driven.transmission_error_range": 2e-3}
    assert trajectory_objectives(trajectory, 0.0, 2.0) == pytest.approx(swing, rel=1e-6)


def test_impulse_of_a_half_sine_and_of_a_plateau():
    """A half sine of height H and half period T gives 2 H T / pi; a steady force F over the window gives F * 2 T."""
    half = math.pi * math.sqrt(DRIVE.chain.mass / single_chain(DRIVE).sprocket_stiffness(0))
    time = np.arange(0, 4000) * half / 200.0
    rollers = DRIVE.chain.links
    position = np.full((len(time), rollers, 2), 50.0)
    force = np.zeros((len(time), rollers))
    radius, touch = single_chain(DRIVE).pitch_radius(0), time - time[1000]
    for roller, height in ((3, 4e3), (7, 1e3)):
        position[900:3000, roller] = (-radius, 0.0)
        force[:, roller] = np.where((touch >= 0) & (touch <= half), height * np.sin(np.pi * touch / half), 0.0)
    position[900:3000, 11] = (-radius, 0.0)
    force[1000:2500, 11] = 500.0
    position[3900:, 13], force[3950:, 13] = (-radius, 0.0), 1e5  # ends before its window does
    position[:, 15], force[:, 15] = (-radius, 0.0), 1e5  # already there: no passing begins
    centers = np.tile([sprocket.center for sprocket in DRIVE.sprockets], (len(time), 1, 1))
    trajectory = Trajectory(DRIVE, time, position=position, sprocket_force=force, sprocket_center=centers)
    found = engagement_impulses(trajectory, 0)
    # trapezoidal sums of 200 points a half sine: (pi/200)^2/12; the plateau rises within half a sample of 400
    assert found == pytest.approx([2 * 4e3 * half / math.pi, 2 * 1e3 * half / math.pi, 500.0 * 2 * half], rel=2e-3)
    assert len(engagement_impulses(trajectory, 1)) == 0


def test_fatigue_of_a_known_swing():
    """Each link swings N times by D in T seconds: N (D/D_ref)^m / N_ref damage, a chain revolution counts once."""
    time = np.linspace(0.0, 36.0, 36 * 20 + 1)
    swing = 2e3 + 1e3 * np.cos(2.0 * np.pi * 5.0 * time)  # 180 periods, peaks at both ends
    tension = np.stack([swing, np.full_like(swing, 9e3)], axis=1)
    angle = np.stack([time, time], axis=1) * 2.0 * np.pi  # 36 revolutions, of 20 teeth; 60 links: 12 of the chain
    swung = Trajectory(DRIVE, time, tension=tension, sprocket_angle=angle)
    row = trajectory_objectives(swung, 0.0, 36.0, Woehler(3.0, 1e3, 1e6))
    assert row["damage_per_hour_max"] == pytest.approx(180 * 2.0**3 / 1e6 * 100, rel=1e-9)
    assert row["damage_per_hour_mean"] == pytest.approx(0.5 * row["damage_per_hour_max"])
    assert row["tension_equivalent_range"] == pytest.approx(2e3 * (180 / 12) ** (1 / 3), rel=1e-9)


def test_objectives_of_a_run_join_its_metrics():
    drives = [two_sprockets(duration=0.1), two_sprockets(duration=0.1, torque=400.0)]
    run = simulate(drives, record=Record(variants=[1]), limits=STARTING)
    table = add_objectives(run, Woehler(5.0, 1e4))
    assert table.column_names[: run.metrics.num_columns] == run.metrics.column_names
    assert table.select(run.metrics.column_names).equals(run.metrics)
    first, second = table.to_pylist()
    assert first["driven.transmission_error_rms"] is None
    assert first["contact_energy_per_revolution"] > 0.0
    seconds = first["window_end"] - first["window_start"]
    turns = 10.0 * seconds / (2.0 * math.pi)
    assert first["driver.contact_energy_per_revolution"] * turns == pytest.approx(first["driver.dissipated"], rel=1e-12)
    # a blow cannot carry more than a roller that meets the teeth at the speed of a whole pitch angle, v = omega p
    for name in ("driver", "driven"):
        assert 0.0 < second[f"{name}.engagement_impulse"] < 10.0 * 1.0 * 10.0 * 0.05
    assert second["driven.transmission_error_rms"] < 2.0 * math.pi / 20 / 10  # a tenth of a pitch angle
    assert second["damage_per_hour_max"] > second["damage_per_hour_mean"] > 0.0
    units = {"peak_factor": "1", "driven.transmission_error_rms": "rad", "tension_equivalent_range": "N"}
    units |= {"driver.impact_impulse": "N s", "driver.engagement_impulse": "N s", "damage_per_hour_max": "1/h"}
    for name, unit in (units | {"contact_energy_per_revolution": "J"}).items():
        assert table.schema.field(name).metadata == {b"unit": unit.encode()} and unit_of_metric(name) == unit


def test_refusals():
    time = np.linspace(0.0, 1.0, 11)
    with pytest.raises(SimulationError, match=r"2 frames from 0 to 0\.1 s"):
        trajectory_objectives(Trajectory(DRIVE, time), 0.0, 0.1)
    with pytest.raises(SimulationError, match="recorded without sprocket_angle"):
        transmission_error(Trajectory(DRIVE, time), 1)
    with pytest.raises(SimulationError, match="recorded without position, sprocket_center, sprocket_force"):
        engagement_impulses(Trajectory(DRIVE, time), 1)
