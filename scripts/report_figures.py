"""What a run-up of the timing drive puts on its shafts and its guide, as `warpchain report` shows it.

    python scripts/report_figures.py [docs/images]

Writes report-hubs.png, report-orders.png and report-guide.png.
"""

import argparse
from pathlib import Path

from warpchain import Record, load_drive, simulate
from warpchain.drive.examples import drive_path
from warpchain.results.handed_in import handed_in
from warpchain.view.figures.cuts import cuts_figure, run_up_cuts
from warpchain.view.figures.load import guide_load_figure
from warpchain.view.figures.shafts import hub_figure
from warpchain.view.figures.style import save_figures

SLOWEST, FASTEST = 105.0, 600.0  # rad/s
RATE = 20_000.0  # Hz


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", nargs="?", type=Path, help="where to save the figures; default: nowhere")
    made.add_argument("--duration", type=float, default=1.0, help="of the run-up [s]")
    return made


def main() -> None:
    """Runs the drive up and draws the figures."""
    arguments = parser().parse_args()
    table = {"time": [0.0, arguments.duration], "speed": [SLOWEST, FASTEST]}
    values = {"sprockets.crankshaft.prescribed.table": table, "run.duration": arguments.duration}
    drive = load_drive(drive_path("engine")).with_values(values)
    run = simulate(drive, record=Record(rate=RATE), window=(0.0, arguments.duration), progress=False)
    found = handed_in(run)
    figures = {"report-hubs": hub_figure(found), "report-guide": guide_load_figure(found, 0)}
    cuts = run_up_cuts(found)
    if cuts:
        unit, of = cuts["force on the hub"]
        figures["report-orders"] = cuts_figure(drive, "force on the hub", unit, of)
    for name, value in found.metrics().items():
        print(f"{name} {value:.4g}")
    if arguments.folder is not None:
        for path in save_figures(figures, arguments.folder, "png"):
            print(path)


if __name__ == "__main__":
    main()
