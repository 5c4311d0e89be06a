"""A crank that firing turns: gas torque over two turns, with the speed following, against that of a rigid shaft."""

import math

import numpy as np
import pytest
from drives import ran, with_parts
from parts import shaft

INERTIA, SPEED, RADIUS, AREA, ROD = 0.25, 180.0, 0.045, 5.8e-3, 3.4
"""Crank and flywheel [kg m^2], speed at the start [rad/s], crank radius [m], piston [m^2], rod over crank radius."""
CYCLE = np.linspace(0.0, 4.0 * math.pi, 361)
"""Angles of the table: every 2 degrees of a cycle [rad]."""


def gas_torque(phi):
    """Torque [N m] of one cylinder that fires at phi = 0, with polytropes of 1.32: 45 bar at most, 1 bar else."""
    phi = np.mod(phi + 2.0 * math.pi, 4.0 * math.pi) - 2.0 * math.pi  # compressed from -pi to 0, works to pi
    place = 1.0 - np.cos(phi) + (1.0 - np.sqrt(1.0 - (np.sin(phi) / ROD) ** 2)) * ROD
    volume = 1.0 + 9.0 * place / 2.0
    pressure = np.where(phi < 0.0, 1e5 * 10.0**1.32, 45e5) * volume**-1.32
    pressure = np.where(np.abs(phi) < math.pi, np.maximum(pressure - 1e5, 0.0), 0.0)
    lever = RADIUS * (np.sin(phi) + np.sin(2.0 * phi) / (2.0 * np.sqrt(ROD**2 - np.sin(phi) ** 2)))
    return AREA * pressure * lever


def firing():
    """The table's torque of four cylinders half a turn apart [N m]; the last row is the first."""
    torque = sum(gas_torque(CYCLE - k * math.pi) for k in range(4))
    torque[-1] = torque[0]
    return torque


def engine(key, mean):
    """The crank, its gas torque that of a motor or, against rotation, of a load; it works against `mean` [N m]."""
    torque = firing() if key == "motor" else -firing()
    by = {"load": {"torque": mean}}
    by[key] = by.get(key, {}) | {"table": {"angle": CYCLE.tolist(), "torque": torque.tolist()}}
    return with_parts(shaft("crank", inertia=INERTIA, initial_speed=SPEED, **by), duration=0.21, step=5e-6)


@pytest.mark.parametrize(
    ("key", "precision", "off"), [("motor", "float64", 1e-7), ("load", "float64", 1e-7), ("motor", "float32", 5e-7)]
)
def test_firing_turns_the_crank(device, key, precision, off):
    # J w^2 / 2 = J w_0^2 / 2 + int (T - M) d phi, cycle by cycle; lines join the rows of the table; at float32
    # frames have the speed to 6e-8 of itself
    torque = firing()
    work = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(CYCLE) * (torque[1:] + torque[:-1]))])
    mean = float(work[-1] / (4.0 * math.pi))
    assert 50.0 < mean < 150.0
    run, row = ran(engine(key, mean), precision=precision)
    angle, speed = np.asarray(run[0].shaft_angle)[:, 0], np.asarray(run[0].shaft_speed)[:, 0]
    assert angle[-1] > 8.0 * math.pi  # three cycles
    fine = np.linspace(0.0, 4.0 * math.pi, 200_001)
    steps = np.interp(fine, CYCLE, torque) - mean
    energy = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(fine) * (steps[1:] + steps[:-1]))])
    expected = np.sqrt(SPEED**2 + 2.0 / INERTIA * np.interp(np.mod(angle, 4.0 * math.pi), fine, energy))
    assert speed == pytest.approx(expected, rel=off)
    # ripple over mean speed: the swing of the work over J w^2, with the mean for the middle, half a ripple off at most
    ripple = (row["crank.speed_max"] - row["crank.speed_min"]) / row["crank.speed_mean"]
    closed = np.ptp(energy) / (INERTIA * row["crank.speed_mean"] ** 2)
    assert ripple == pytest.approx(closed, rel=0.5 * ripple)
    assert 0.01 < ripple < 0.1
    assert abs(row["energy_residual"]) < 1e-5 * 0.5 * INERTIA * SPEED**2
