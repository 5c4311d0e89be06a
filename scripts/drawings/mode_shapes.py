"""Modes of the timing drives."""

import argparse
from pathlib import Path

import numpy as np
from common.cases import case, option

from warpchain import load_drive
from warpchain.drive.examples import drive_path
from warpchain.modal.campbell import campbell
from warpchain.modal.eigenmodes import modes
from warpchain.modal.mode_figures import campbell_figure, shapes_figure

SHAPES, LINES = 8, 10
CAR = ("intake cam->exhaust cam 1", "crank->intake cam 1", "intake cam 1", "arm 1")
CAR_MODES = 30
FASTEST, POINTS = 600.0, 25  # rad/s


@case(option("folder", nargs="?", type=Path, help="where to save the figures; default: nowhere"))
def mode_shapes(asked: argparse.Namespace) -> None:
    """Modes of the timing drives at rest, and how those of one move with the crankshaft's speed.

    python scripts/figures.py mode-shapes [docs/images]

    Writes modes-engine.png, campbell-engine.png and modes-car.png.
    """
    folder = asked.folder
    found = campbell(load_drive(drive_path("engine")), np.linspace(0.0, FASTEST, POINTS).tolist(), LINES)
    car = modes(load_drive(drive_path("car")), CAR_MODES)
    for name, figure in (
        ("modes-engine", shapes_figure(found.modes[0].first(SHAPES))),
        ("campbell-engine", campbell_figure(found)),
        ("modes-car", shapes_figure(car.chosen(np.array([car.names.index(name) for name in CAR])))),
    ):
        if folder is not None:
            figure.savefig(folder / f"{name}.png", dpi=80)
            print(folder / f"{name}.png")
