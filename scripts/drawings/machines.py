"""Figures of five machines whose shafts overrun, slip and are braked: files beside this one."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common.cases import Line, case

from warpchain import Limits, Record, load_drive, simulate
from warpchain.view.figures.figure_style import panel_grid

MACHINES = ("kart", "vtwin", "elevator", "ebike", "reaper")


@case()
def machines(asked: argparse.Namespace) -> Iterator[Line]:
    """The five machines of docs/shafts.md: speeds of their shafts, torques of their couplings.

    python scripts/figures.py machines

    Prints of each coupling its largest torque, and what is lost as it slips and in its damper.
    """
    figure, axes = panel_grid(2 * len(MACHINES), 2, 6.0, 2.1)
    yield ("machine", "coupling", "torque [N m]", "slip loss [J]", "damping loss [J]", "energy residual")
    for k, name in enumerate(MACHINES):
        drive = load_drive(Path(__file__).with_name(f"{name}.toml"))
        window = (0.0, drive.run.duration)
        run = simulate(drive, record=Record(rate=1000.0), window=window, limits=Limits())
        part, (row,) = run[0], run.metrics.to_pylist()
        turning, twisting = axes[2 * k : 2 * k + 2]
        for h, shaft in enumerate(drive.shafts):
            turning.plot(part.time, np.asarray(part.shaft_speed, float)[:, h], label=shaft.name)
        for c, coupling in enumerate(drive.couplings):
            twisting.plot(part.time, np.asarray(part.coupling_torque, float)[:, c], lw=0.8, label=coupling.name)
            most = max(row[f"{coupling.name}.torque_max"], -row[f"{coupling.name}.torque_min"])
            losses = [row.get(f"{coupling.name}.{of}_loss") for of in ("slip", "damping")]
            yield (
                name,
                coupling.name,
                f"{most:.0f}",
                *("" if lost is None else f"{lost:.1f}" for lost in losses),
                f"{row['energy_residual_relative']:.0e}",
            )
        turning.set_ylabel(f"{name}: speed [rad/s]")
        twisting.set_ylabel("torque [N m]")
        for axis in (turning, twisting):
            axis.legend(fontsize=7, frameon=False)
            axis.margins(x=0.0)
    for axis in axes[-2:]:
        axis.set_xlabel("time [s]")
    yield {"machines": figure}
