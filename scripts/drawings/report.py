"""A run-up as reports show it."""

import argparse
from pathlib import Path

from common.cases import case, option

from warpchain import Record, load_drive, simulate
from warpchain.drive.examples import drive_path
from warpchain.results.engineering_report import handed_in
from warpchain.view.figures.load import guide_load_figure
from warpchain.view.figures.shafts import hub_figure
from warpchain.view.figures.style import save_figures
from warpchain.view.figures.sweep import cuts_figure, run_up_cuts

SLOWEST, FASTEST = 105.0, 600.0  # rad/s
RATE = 20_000.0  # Hz


@case(
    option("folder", nargs="?", type=Path, help="where to save the figures; default: nowhere"),
    option("--duration", type=float, default=1.0, help="of the run-up [s]"),
)
def report(asked: argparse.Namespace) -> None:
    """What a run-up of the timing drive puts on its shafts and its guide, as `warpchain report` shows it.

    python scripts/figures.py report [docs/images]

    Writes report-hubs.png, report-orders.png and report-guide.png.
    """
    table = {"time": [0.0, asked.duration], "speed": [SLOWEST, FASTEST]}
    values = {"sprockets.crankshaft.prescribed.table": table, "run.duration": asked.duration}
    drive = load_drive(drive_path("engine")).with_values(values)
    run = simulate(drive, record=Record(rate=RATE), window=(0.0, asked.duration), progress=False)
    found = handed_in(run)
    figures = {"report-hubs": hub_figure(found), "report-guide": guide_load_figure(found, 0)}
    cuts = run_up_cuts(found)
    if cuts:
        unit, of = cuts["force on the hub"]
        figures["report-orders"] = cuts_figure(drive, "force on the hub", unit, of)
    for name, value in found.metrics().items():
        print(f"{name} {value:.4g}")
    if asked.folder is not None:
        for path in save_figures(figures, asked.folder, "png"):
            print(path)
