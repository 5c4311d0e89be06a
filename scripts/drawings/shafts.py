"""Figures of drives with shafts: a machine that a motor starts."""

import argparse
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case
from common.drives import example

from warpchain import Limits, Record, simulate
from warpchain.view.figures.style import panels


@case()
def starting(asked: argparse.Namespace) -> Iterator[Line]:
    """The conveyor's start: speeds, the chain's tension, twist and torque of its coupling.

    python scripts/figures.py starting

    Prints what the run comes to and where its peaks are, as docs/shafts.md has them.
    """
    drive = example("conveyor")
    run = simulate(drive, record=Record(rate=2000.0), window=(1.2, 2.0), limits=Limits())
    part, (row,) = run[0], run.metrics.to_pylist()
    time, most = part.time, np.asarray(part.tension, float).max(axis=1)
    figure, axes = panels(3, 7.0, "A conveyor started by its motor", None)
    motor, _, drum = np.abs(np.asarray(part.shaft_speed, float)).T
    driven = np.abs(np.asarray(part.sprocket_speed, float))[:, 1]
    axes[0].plot(time, motor / motor[-1], label="motor")
    axes[0].plot(time, driven / driven[-1], label="driven sprocket")
    axes[0].plot(time, drum / drum[-1], label="drum")
    axes[0].set_ylabel("speed over final speed")
    axes[0].legend()
    axes[1].plot(time, most / 1e3)
    axes[1].set_ylabel("largest tension [kN]")
    axes[2].plot(time, -np.asarray(part.coupling_torque, float)[:, 0] / 1e3)
    axes[2].set_ylabel("torque of the coupling [kN m]")
    axes[2].set_xlabel("time [s]")
    axes[2].set_xlim(0.0, 1.0)
    tight = row["driven->driver.tension_mean"]
    torque = np.abs(np.asarray(part.coupling_torque, float)[:, 0])
    yield ("", "largest", "at [s]", "steady", "ratio")
    for name, values, steady in (
        ("tension [N]", most, tight),
        ("coupling [N m]", torque, abs(row["coupling.torque_mean"])),
    ):
        peak = int(values.argmax())
        yield (name, f"{values[peak]:.0f}", f"{time[peak]:.3f}", f"{steady:.0f}", f"{values[peak] / steady:.2f}")
    yield ("motor [rad/s]", "", "", f"{abs(row['motor.speed_mean']):.1f}", "")
    yield ("efficiency", "", "", f"{row['efficiency']:.4f}", "")
    yield ("energy_residual_relative", "", "", f"{row['energy_residual_relative']:.1e}", "")
    yield {"conveyor-start": figure}
