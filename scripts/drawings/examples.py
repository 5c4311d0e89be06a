"""Pictures of the example drives."""

import argparse
from pathlib import Path

from common.cases import case, option

from warpchain import Record, Run, load_drive, simulate
from warpchain.drive.examples import drive_path, example_names
from warpchain.view.figures.plot import drive_figure

FOLDER = Path(__file__).parents[2] / "docs" / "images"


def table(name: str, run: Run) -> str:
    """One row: rollers, simulated time, means of the slackest and tightest strand, extremes of the tension."""
    row = run.metrics.to_pylist()[0]
    drive = run[0].drive
    strands = [row[f"{strand}.tension_mean"] for strand in drive.strand_names]
    return (
        f"| {name} | {drive.chain.links} | {drive.run.duration:g} | {min(strands):.0f} | "
        f"{max(strands):.0f} | {row['tension_min']:.0f} | {row['tension_max']:.0f} |"
    )


@case(option("names", nargs="*", metavar="NAME", help="examples; default: all"))
def examples(asked: argparse.Namespace) -> None:
    """The pictures of the example drives in docs/images: the drive and the forces on its chain at one instant of a run.

    python scripts/figures.py examples [NAME ...]

    Prints a table of what each run came to, as docs/examples.md has it.
    """
    names = asked.names or example_names()
    channels = ["position", "tension", "sprocket_force", "guide_force", "sprocket_angle", "sprocket_center"]
    channels += ["arm_angle", "tensioner_extension"]
    head = "drive | links | simulated [s] | slackest strand [N] | tightest strand [N] | least [N] | most [N]"
    print(f"| {head} |")
    print("|---|---|---|---|---|---|---|")
    for name in names:
        run = simulate(load_drive(drive_path(name)), record=Record(channels=channels))
        drive_figure(run[0]).savefig(FOLDER / f"{name.replace('_', '-')}-drive.png", dpi=90)
        print(table(name, run))
