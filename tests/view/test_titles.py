"""Titles of pages and figures say the speed that the run had."""

import math

import numpy as np
import pytest
from drives import two_sprockets
from run_ups import kart

from warpchain import Record, simulate
from warpchain.results.engineering_report import engineering_report
from warpchain.view.figures.figure_style import driver_speed_text, run_line
from warpchain.view.figures.plot import draw_figures
from warpchain.view.recorded_variants import recorded_variant
from warpchain.view.report.run_report import run_heading


@pytest.fixture(scope="module")
def run():
    drive = kart(**{"run.duration": 0.12})
    return simulate(drive, device="cpu", record=Record(rate=2000.0), window=(0.04, 0.1))


def test_titles_have_the_mean_of_the_window(run):
    # the driver's revolutions between the window's ends over its length; the metric is the mean of all steps
    (mean,) = run.metrics["driver.speed_mean"].to_pylist()
    words = f"driver at {mean * 30.0 / math.pi:.4g} rpm in the mean of 0.04 to 0.1 s"
    seen = recorded_variant(run, 0).trajectory
    angle = np.interp([0.04, 0.1], seen.time, seen.sprocket_angle[:, seen.drive.driver])
    assert mean == pytest.approx(abs(np.diff(angle)[0]) / 0.06, rel=1e-4)
    assert run_heading(engineering_report(run)) == f"Chain drive, {words}"
    assert run_line(seen).endswith(words)
    figures = draw_figures(run, only=["strand-displacement", "link-tension"])  # of the whole run and of its last round
    assert all(figure.get_suptitle().endswith(words) for figure in figures.values())


def test_a_drive_that_has_not_run_says_up_to(run):
    assert driver_speed_text(two_sprockets()) == "driver at 95.49 rpm"
    assert driver_speed_text(run.drives[0]).startswith("driver up to about ")
