"""Modes of the timing drive at rest, and how they move with the crankshaft's speed.

    python scripts/mode_figures.py [docs/images]

Writes modes-engine.png and campbell-engine.png.
"""

import argparse
from pathlib import Path

import numpy as np

from warpchain import load_drive
from warpchain.drive.examples import drive_path
from warpchain.modal.campbell import campbell
from warpchain.modal.figures import campbell_figure, shapes_figure

SHAPES, LINES = 8, 10
FASTEST, POINTS = 600.0, 25  # rad/s


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", nargs="?", type=Path, help="where to save the figures; default: nowhere")
    return made


def main() -> None:
    """Finds the modes and draws them."""
    folder = parser().parse_args().folder
    found = campbell(load_drive(drive_path("engine")), np.linspace(0.0, FASTEST, POINTS).tolist(), LINES)
    for name, figure in (
        ("modes-engine", shapes_figure(found.modes[0].first(SHAPES))),
        ("campbell-engine", campbell_figure(found)),
    ):
        if folder is not None:
            figure.savefig(folder / f"{name}.png", dpi=80)
            print(folder / f"{name}.png")


if __name__ == "__main__":
    main()
