"""Causes of a drive's change with temperature: its oil, its sizes."""

import argparse
from collections.abc import Iterator

from common.cases import Line, case
from common.drives import Values, example_drive

from warpchain import Record, simulate

OIL = "tensioners.tensioner.oil"
WINTER = {f"{OIL}.viscosity_40": 62e-6, f"{OIL}.viscosity_100": 10.3e-6}
HOT_ALWAYS = {f"{OIL}.viscosity_40": 12.00001e-6, f"{OIL}.viscosity_100": 12e-6}
"""An oil that hardly thins: the drive's own, which is that of 95 degrees C."""
CASES: dict[str, Values] = {
    "as it is": WINTER,
    "a block of steel": {"expansion.block": "steel"} | WINTER,
    "oil of 12 mm^2/s": HOT_ALWAYS,
}
DURATION, WINDOW, LONG = 0.4, 0.16, 1.2
"""Of the study's runs and its window at their end, and of a longer run [s]."""


@case()
def temperature(asked: argparse.Namespace) -> Iterator[Line]:
    """The tables below the one of the study in docs/temperature.md: causes, and longer runs.

    python scripts/figures.py temperature
    """
    columns = ("tensioner.extension_mean", "crank->intake cam.tension_mean", "exhaust cam->crank.tension_mean")

    def metric_rows(cases: list[tuple[str, float]], duration: float) -> list[list[float]]:
        """Metrics of drives at temperatures [degrees C], from the end of a run [s]."""
        drives = [example_drive("car", CASES[name] | {"temperature": degrees}) for name, degrees in cases]
        run = simulate(
            drives, record=Record("none"), duration=duration, window=(duration - WINDOW, duration), device="cpu"
        )
        return [[row[column] for column in columns] for row in run.metrics.to_pylist()]

    cases = [(name, degrees) for name in CASES for degrees in (-30.0, 120.0)]
    yield ("degrees C", "", "plunger [mm]", "slack strand, mean [N]", "tight strand, mean [N]")
    for (name, degrees), (plunger, slack, tight) in zip(cases, metric_rows(cases, DURATION), strict=True):
        yield (f"{degrees:g}", name, f"{1e3 * plunger:+.2f}", f"{slack:.0f}", f"{tight:.0f}")
    cases = [("as it is", degrees) for degrees in (-30.0, 0.0, 20.0, 60.0, 120.0)]
    yield f"after {LONG:g} s, against {DURATION:g} s"
    yield ("degrees C", "slack strand", "tight strand")
    for (_, degrees), short, long in zip(cases, metric_rows(cases, DURATION), metric_rows(cases, LONG), strict=True):
        changes = (100.0 * (b / a - 1.0) for a, b in zip(short[1:], long[1:], strict=True))
        yield (f"{degrees:g}", *(f"{change:+.2f} %" for change in changes))
