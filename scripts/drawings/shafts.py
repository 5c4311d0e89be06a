"""Figures of drives with shafts: a machine that a motor starts, and a motorcycle's gear change."""

import argparse
import math
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case
from common.drives import example_drive

from warpchain import Limits, Record, simulate
from warpchain.results.losses import losses
from warpchain.view.figures.figure_style import panel_column


@case()
def starting(asked: argparse.Namespace) -> Iterator[Line]:
    """The conveyor's start: speeds, the chain's tension, twist and torque of its coupling.

    python scripts/figures.py starting

    Prints what the run comes to and where its peaks are, as docs/shafts.md has them.
    """
    drive = example_drive("conveyor")
    run = simulate(drive, record=Record(rate=2000.0), window=(1.2, 2.0), limits=Limits())
    part, (row,) = run[0], run.metrics.to_pylist()
    time, most = part.time, np.asarray(part.tension, float).max(axis=1)
    figure, axes = panel_column(3, 7.0, "A conveyor started by its motor", None)
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


PHASES = {
    "second gear": (0.08, 0.2),
    "change": (0.2, 0.42),
    "third gear": (0.42, 0.6),
    "coasting": (0.64, 1.0),
    "all": (0.0, 1.0),
}
"""Windows [s] of `motorcycle_drivetrain`."""


@case()
def gear_change(asked: argparse.Namespace) -> Iterator[Line]:
    """`motorcycle_drivetrain`: speeds, moments, twists and tensions over the run, and where its energy goes by phases.

    python scripts/figures.py gear-change

    Prints the table of docs/motorcycle.md; energies in J.
    """
    drive, groups = example_drive("motorcycle_drivetrain"), list[str]()
    for phase, window in PHASES.items():
        record = Record(rate=5000.0) if phase == "all" else Record("none")
        run = simulate(drive, record=record, window=window, limits=Limits(energy_change=math.inf))
        (row,) = run.metrics.to_pylist()
        lost = losses(drive, row)
        if not groups:
            groups = list(lost)
            yield ("phase", "time [s]", "engine", "loads", "stored", *groups, "residual", "efficiency")
        works = [row[name] for name in ("input_work", "output_work", "energy_change")]
        energies = [*works, *(lost[group] for group in groups), row["energy_residual"]]
        share = f"{1.0 - sum(lost.values()) / works[0]:.3f}" if phase.endswith("gear") else ""
        yield (phase, "{:g} to {:g}".format(*window), *(f"{energy:.1f}" for energy in energies), share)
    part = run[0]
    figure, axes = panel_column(4, 9.5, "A gear change: 60 km/h, second to third", None)
    speed = np.abs(np.asarray(part.shaft_speed, float)).T
    for h, shaft in enumerate(drive.shafts):
        if shaft.name in ("basket", "mainshaft", "countershaft"):
            axes[0].plot(part.time, speed[h], label=shaft.name)
    axes[0].set_ylabel("speed [rad/s]")
    torque, twist = np.asarray(part.coupling_torque, float).T, np.asarray(part.coupling_twist, float).T
    for c, coupling in enumerate(drive.couplings):
        sense = 1.0 if coupling.name in ("clutch", "gearbox") else -1.0
        axes[1].plot(part.time, sense * torque[c], label=coupling.name, linewidth=0.8)
        axes[2].plot(part.time, sense * np.degrees(twist[c]), label=coupling.name, linewidth=0.8)
    axes[1].set_ylabel("moment [N m]")
    axes[2].set_ylabel("twist [deg]")
    axes[3].plot(part.time, np.asarray(part.tension, float).max(axis=1) / 1e3, linewidth=0.8)
    axes[3].set_ylabel("largest tension [kN]")
    axes[3].set_xlabel("time [s]")
    for axis in axes[:3]:
        axis.legend(loc="upper right", fontsize="small")
    yield {"gear-change": figure}
