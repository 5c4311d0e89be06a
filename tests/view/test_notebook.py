"""Pictures and tables in notebooks, and the tutorial notebook run from its first cell to its last."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from drives import STARTING, two_sprockets
from loading import load_script
from matplotlib.figure import Figure

from warpchain import Record, simulate
from warpchain.study.results import read_results
from warpchain.view.figures import draw_figures, draw_sweep
from warpchain.view.notebook import notebook_html, value_with_unit

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))
assert NOTEBOOKS


@pytest.fixture(scope="module")
def run():
    drives = [two_sprockets(duration=0.01, torque=torque) for torque in (200.0, 300.0)]
    return simulate(drives, record=Record([1]), limits=STARTING)


def test_what_notebooks_show(run):
    shown = run.drives[0]._repr_html_()
    assert "<img src=" in shown and "driver" in shown and "60 links of 50 mm" in shown and "rpm" in shown
    shown = run._repr_html_()
    assert "2 variants, 1 recorded" in shown and ">ok</b>" in shown and "tension_max" in shown
    shown = run[1]._repr_html_()
    assert "sprocket_angle" in shown and "rad" in shown and "201 frames" in shown
    alone = simulate(two_sprockets(duration=0.01))._repr_html_()
    assert "mean link tension" in alone and " kN" in alone
    with pytest.raises(TypeError, match="Drive, Run, Trajectory"):
        notebook_html(3)


def test_names_are_escaped():
    drive = two_sprockets().with_values({"sprockets.driven.name": "<b>&"})
    assert "<b>&" not in drive._repr_html_() and "&lt;b&gt;&amp;" in drive._repr_html_()


def test_a_drive_that_does_not_fit_shows_why():
    drive = two_sprockets().with_values({"sprockets.driven.center": (0.01, 0.0)})
    assert "overlap" in drive._repr_html_()


def test_a_study_shows_its_first_rows():
    table = pa.table({"a": np.arange(30.0), "tension_max": np.full(30, 4200.0), "status": ["ok"] * 29 + ["suspect"]})
    shown = read_results(table, ["a"])._repr_html_()
    assert "30 rows: 29 ok, 1 suspect" in shown and "4.2 kN" in shown
    assert shown.count("<tr>") == 21


@pytest.mark.parametrize(
    "value, unit, text",
    [(42.2e3, "N", "42.2 kN"), (0.5, "1", "0.5"), (None, "N", "-"), (True, "1", "True"), (float("nan"), "N", "nan")],
)
def test_values_with_units(value, unit, text):
    assert value_with_unit(value, unit) == text


def test_figures_are_returned(run):
    figures = draw_figures(run, only=["drive", "link-tension"])
    assert list(figures) == ["drive", "link-tension"]
    assert all(isinstance(figure, Figure) for figure in figures.values())
    drives = [two_sprockets(duration=0.1, speed=speed, span=19.5, links=59) for speed in (20.0, 30.0)]
    speeds = simulate(drives, limits=STARTING)
    assert all(isinstance(figure, Figure) for figure in draw_sweep([speeds]).values())


@pytest.mark.long
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_it_showed(path):
    """Every cell ends well, and shows as many things of the same kinds as those that are stored."""
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")

    def kinds(book):
        return [
            [output.output_type if "data" not in output else sorted(output.data) for output in cell.outputs]
            for cell in book.cells
            if cell.cell_type == "code"
        ]

    assert kinds(load_script("pages.notebooks").executed_notebook(path)) == kinds(nbformat.read(path, as_version=4))
