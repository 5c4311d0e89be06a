"""Figure of the silent chain of docs/silent-chains.md."""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common.cases import Line, case

from warpchain import Record, load_drive, simulate
from warpchain.view.figures.drive_figure import drive_figure

DRIVE = Path(__file__).with_name("silent.toml")
AROUND = 0.048
"""Half the height of the picture [m]."""


@case()
def silent(_: argparse.Namespace) -> Iterator[Line]:
    """Driving wheel of a silent chain at work: plates, teeth, tensions and contact forces.

    python scripts/figures.py silent

    Prints the largest tension and contact force, and the losses.
    """
    drive = load_drive(DRIVE)
    run = simulate(drive, record=Record(rate=5000.0), device="cpu")
    (row,) = run.metrics.to_pylist()
    yield ("metric", "value")
    for name in ("tension_max", "driver.force_max", "driven.force_max", "efficiency"):
        yield (f"`{name}`", f"{row[name]:.4g}")
    figure = drive_figure(run[0])
    axis = figure.axes[0]
    box, place = axis.get_window_extent(), 1e3 * AROUND * np.array([-1.0, 1.0])
    axis.set(xlim=box.width / box.height * (place + 1e3 * AROUND) - 1e3 * AROUND, ylim=place)
    for text in axis.texts:
        text.set_clip_on(True)
    yield {"silent": figure}
