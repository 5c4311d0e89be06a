"""The pictures of the example drives in docs/images: the drive and the forces on its chain at one instant of a run.

    python scripts/example_pictures.py [NAME ...]

Prints a table of what each run came to, as docs/examples.md has it.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from warpchain import Record, Run, load_drive, simulate
from warpchain.drive.examples import drive_path, example_names
from warpchain.view.figures.write import drive_figure

FOLDER = Path(__file__).parent.parent / "docs" / "images"


def picture(run: Run) -> Figure:
    """The drive's figure with room for its arrows."""
    figure = drive_figure(run[0])
    axis = figure.axes[0]
    span = max(np.diff(axis.get_xlim())[0], np.diff(axis.get_ylim())[0])
    for limits, place in ((axis.get_xlim(), axis.set_xlim), (axis.get_ylim(), axis.set_ylim)):
        place(limits[0] - 0.08 * span, limits[1] + 0.08 * span)
    return figure


def table(name: str, run: Run) -> str:
    """One row: rollers, simulated time, means of the slackest and tightest strand, extremes of the tension."""
    row = run.metrics.to_pylist()[0]
    drive = run[0].drive
    strands = [row[f"{strand}.tension_mean"] for strand in drive.strand_names]
    return (
        f"| {name} | {drive.chain.links} | {drive.run.duration:g} | {min(strands):.0f} | "
        f"{max(strands):.0f} | {row['tension_min']:.0f} | {row['tension_max']:.0f} |"
    )


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("names", nargs="*", metavar="NAME", help="examples; default: all")
    return made


def main() -> None:
    """Runs the examples and draws them."""
    names = parser().parse_args().names or example_names()
    parts = ("sprocket_angle", "sprocket_center", "arm_angle", "tensioner_extension")
    channels = ("position", "tension", "sprocket_force", "guide_force", *parts)
    head = "drive | links | simulated [s] | slackest strand [N] | tightest strand [N] | least [N] | most [N]"
    print(f"| {head} |")
    print("|---|---|---|---|---|---|---|")
    for name in names:
        run = simulate(load_drive(drive_path(name)), record=Record(channels=channels))
        picture(run).savefig(FOLDER / f"{name.replace('_', '-')}-drive.png", dpi=90)
        print(table(name, run))


if __name__ == "__main__":
    main()
