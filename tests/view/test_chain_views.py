"""Drives of several chains before and after a run: `check`, archives, figures, pages, recordings, notebooks."""

import json
import re

import chains
import numpy as np
import pytest

from warpchain import read_archive, simulate
from warpchain.assembly.summary import derived_quantities
from warpchain.assembly.summary import report as text_of
from warpchain.drive.body_ties import rotation_owners
from warpchain.errors import SimulationError
from warpchain.results.chains import chain_metrics_row, chain_trajectories
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.measured import compare_signals, signal_source
from warpchain.results.measured_file import MeasuredSignal
from warpchain.results.objectives import trajectory_objectives
from warpchain.results.signals import strand_tension
from warpchain.view.figures.plot import plot_figures
from warpchain.view.report import report
from warpchain.view.report.run_report import body_parts, metric_parts
from warpchain.view.rerun.run_playback import view

pytestmark = pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The archive of a run, and the run in memory."""
    drive, path = chains.two_stages(duration=0.02), tmp_path_factory.mktemp("chains") / "two.mcap"
    simulate(drive, device="cpu", archive=path)
    return path, simulate(drive, device="cpu")


def test_check_has_each_chain_with_the_loads_that_it_passes_on():
    """The first chain pulls the second's load: T = M z3 / (z4 R2) more in its tight strand, of 300 N m."""
    drive = chains.two_stages()
    found = derived_quantities(drive)
    first = {strand["name"]: strand["working_tension"] for strand in found["chains"]["first"]["strands"]}
    radius = found["chains"]["first"]["sprockets"][1]["pitch_radius"]
    rise = first["mid in->crank"] - first["crank->mid in"]
    assert rise == pytest.approx(300.0 * 18 / 36 / radius, rel=0.01)
    (mid,) = found["shafts"]
    assert mid["sprockets"] == ["mid in", "mid out"] and mid["speed"] == pytest.approx(20 / 3)
    lines = text_of(json.loads(json.dumps(found))).split("\n")
    assert '=== chain "first"' in lines and '=== chain "second"' in lines


def test_an_archive_reads_back_the_run(recorded):
    path, run = recorded
    held = read_archive(path)
    assert held.drives[0] == run.drives[0]
    for name, values in run[0].channels().items():
        np.testing.assert_allclose(held[0].channels()[name], values, atol=1e-6 * max(np.abs(values).max(), 1.0))


def test_figures_are_of_each_chain_and_of_the_whole_drive(recorded, tmp_path):
    names = {path.name for path in plot_figures(recorded[0], tmp_path, only=("drive", "link-tension"))}
    assert names == {"drive.png", "first link-tension.png", "second link-tension.png"}


@pytest.mark.long
def test_a_page_has_the_sections_of_each_chain(recorded, tmp_path):
    text = report(recorded[0], tmp_path / "two.html").read_text()
    for chain in ("first", "second"):
        assert f'<section id="{chain} tension">' in text and f"{chain}: Chain" in text


@pytest.mark.parametrize(
    ("stages", "alike", "moving"),
    [
        (chains.two_stages, {"mid in": "mid", "mid out": "mid"}, ["mid"]),
        (chains.geared_stages, {"mid in": "mid", "mid out": "mid"}, ["joint", "mid", "pump", "wheel"]),
        (chains.cushed_stages, {"mid in": "mid"}, ["cush", "mid", "mid out", "pump"]),  # which a coupling turns
    ],
)
def test_a_page_shows_the_motion_of_a_shaft_once(stages, alike, moving):
    run = simulate(stages(duration=0.01), device="cpu")
    assert rotation_owners(run.drives[0]) == alike
    row, headings, rows = run.metrics.to_pylist()[0], [], []
    for name, trajectory in chain_trajectories(run[0]).items():
        found, own = EngineeringReport(trajectory, alike=alike), chain_metrics_row(row, name)
        headings += re.findall(r"<h3>([^<,]+)</h3>", "".join(body_parts(found, own)))
        rows += re.findall(r"<td>([^<]+)\.speed_mean</td>", "".join(metric_parts(found, own)))
    assert sorted(headings) == moving
    turning = {"crank", "mid in", "mid out", "out"} | ({"mid", "pump", "wheel"} & set(moving))
    assert sorted(rows) == sorted(turning - alike.keys())


def test_a_recording_shows_all_chains(recorded, tmp_path):
    view(recorded[0], save=tmp_path / "two.rrd")
    assert (tmp_path / "two.rrd").stat().st_size > 10_000


def test_notebooks_show_each_chain(recorded):
    _, run = recorded
    for thing in (run.drives[0], run):
        assert "mid out" in thing._repr_html_() or "second" in thing._repr_html_()
    assert run[0]._repr_html_().count("<img src=") == 1  # of all chains


def test_objectives_of_chains_begin_with_their_names(recorded):
    found = trajectory_objectives(recorded[1][0], 0.01, 0.02)
    assert {"mid in.transmission_error_rms", "out.transmission_error_rms"} <= found.keys()


def test_a_measured_signal_is_laid_over_that_of_its_chain(recorded, tmp_path):
    # the simulated strand's own tension, given as measured: the same statistics, and orders of both chains' teeth
    run = recorded[1]
    one = run[0]
    second = chain_trajectories(one)["second"]
    half = slice(len(one.time) // 2, None)
    name = "second.mid out->out.tension"
    found = compare_signals(one, MeasuredSignal(name, "N", one.time[half], strand_tension(second, 0)[half]))
    assert found.statistics["mean"][0] == pytest.approx(found.statistics["mean"][1], rel=0.05)
    assert found.simulated == pytest.approx(strand_tension(second, 0))
    with pytest.raises(SimulationError, match=r'"first\.link I\.tension" with I from 0 to 65, "second\.link I'):
        signal_source(one, "out.tension")
    view(run, save=tmp_path / "measured.rrd", measured=[found])
    assert (tmp_path / "measured.rrd").stat().st_size > 10_000
