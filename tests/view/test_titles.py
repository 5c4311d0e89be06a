"""Titles of pages and figures say the speed that the run had."""

import math

import numpy as np
import pytest
from drives import two_sprockets
from run_ups import kart

from warpchain import Record, simulate
from warpchain.results.engineering_report import handed_in
from warpchain.view.chosen import recorded
from warpchain.view.figures.plot import draw_figures
from warpchain.view.figures.style import about, driver_at
from warpchain.view.report.run_sections import heading


@pytest.fixture(scope="module")
def run():
    drive = kart(**{"run.duration": 0.12})
    return simulate(drive, device="cpu", record=Record(rate=2000.0), window=(0.04, 0.1))


def test_titles_have_the_mean_of_the_window(run):
    # the driver's revolutions between the window's ends over its length; the metric is the mean of all steps
    (mean,) = run.metrics["driver.speed_mean"].to_pylist()
    words = f"driver at {mean * 30.0 / math.pi:.4g} rpm in the mean of 0.04 to 0.1 s"
    seen = recorded(run, 0).trajectory
    angle = np.interp([0.04, 0.1], seen.time, seen.sprocket_angle[:, seen.drive.driver])
    assert mean == pytest.approx(abs(np.diff(angle)[0]) / 0.06, rel=1e-4)
    assert heading(handed_in(run)) == f"Chain drive, {words}"
    assert about(seen).endswith(words)
    figures = draw_figures(run, only=["strand-displacement", "link-tension"])  # of the whole run and of its last round
    assert all(figure.get_suptitle().endswith(words) for figure in figures.values())


def test_a_drive_that_has_not_run_says_up_to(run):
    assert driver_at(two_sprockets()) == "driver at 95.49 rpm"
    assert driver_at(run.drives[0]).startswith("driver up to about ")
