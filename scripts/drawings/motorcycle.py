"""Figure and table of a motorcycle's gear change, from crankshaft to road."""

import argparse
import math
from collections.abc import Iterator

import numpy as np
from common.cases import Line, case
from common.drives import example

from warpchain import Limits, Record, simulate
from warpchain.results.losses import losses
from warpchain.view.figures.style import panels

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
    drive, groups = example("motorcycle_drivetrain"), list[str]()
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
    figure, axes = panels(4, 9.5, "A gear change: 60 km/h, second to third", None)
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
