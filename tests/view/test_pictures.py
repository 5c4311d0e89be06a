"""Figures and playback: they are drawn, they show the chain, and they refuse in one line."""

import dataclasses

import numpy as np
import pytest
from drives import STARTING, example, two_sprockets
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.quiver import Quiver
from PIL import Image

from warpchain import Record, dumps_drive, loads_drive, simulate, write_archive
from warpchain.assembly.frequencies import excited_orders
from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.strand_passing import strand_displacement
from warpchain.view.figures.chain_figures import contact_angle_figure, link_tension_figure, strand_displacement_figure
from warpchain.view.figures.drive_figure import drive_figure
from warpchain.view.figures.figure_style import panel_column, panel_grid, save_figure
from warpchain.view.figures.plain_figure import tick_label_width
from warpchain.view.figures.plot import plot_figures, plot_sweep
from warpchain.view.figures.sweep import SpeedSweep, campbell_figure, speed_sweeps
from warpchain.view.html import picture_html
from warpchain.view.rerun.drive_scene import thinned_trajectory
from warpchain.view.rerun.run_playback import FRAME_BUDGET, view


@pytest.fixture(scope="module")
def run():
    return simulate(two_sprockets(duration=0.05, gravity=-9.81))


def test_powers_of_ten_take_the_room_that_they_are_seen_to_take():
    """Labels of an upright axis stand as near to powers of ten as to numbers of three figures."""
    from matplotlib.figure import Figure

    numbers, powers = Figure().subplots(1, 2)
    numbers.set_ylim(0.0, 600.0)
    powers.set(yscale="log", ylim=(1e-6, 1e-2))
    assert 0.5 < tick_label_width(powers) / tick_label_width(numbers) < 1.7


def test_names_of_parts_are_no_formulas(tmp_path):
    """A name with two dollar signs around what is no formula, in a figure that is laid out before it is written."""
    drive = loads_drive(dumps_drive(two_sprockets()).replace('"driven"', '"$x^{$"'))
    figure = drive_figure(drive)
    save_figure(figure, tmp_path / "drive.png")
    assert (tmp_path / "drive.png").exists() and "svg" in picture_html(figure, "")
    figure.savefig(tmp_path / "by-hand.png")  # as a user of the library does
    others = panel_column(2, 3.0, "$x^{$", drive)[0], panel_grid(2, 2, 2.0, 2.0)[0]
    for other in others:
        other.axes[0].set_yscale("log")
        other.axes[0].set_title("$x^{$")
        other.draw_without_rendering()


def colored(image, least=60):
    """Share of pixels with a color (not gray)."""
    rgb = np.asarray(Image.open(image).convert("RGB")).astype(int)
    return (np.ptp(rgb, axis=2) > least).mean()


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_figures_are_drawn(run, tmp_path, kind):
    paths = plot_figures(run, tmp_path / "plots", kind=kind)
    # no guide-bar, and of 0.05 s the latter half passes a tooth or two: neither guide force nor spectrum
    names = ["drive", "strand-displacement", "link-tension", "contact-forces", "tension-waterfall", "contact-angle"]
    assert [path.name for path in paths] == [f"{name}.{kind}" for name in names]
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == sorted(path.name for path in paths)
    if kind == "png":
        for path in paths:
            assert Image.open(path).size[0] > 600
            assert colored(path) > 0.001, path
    else:
        words = {path.stem: path.read_text() for path in paths}
        assert all(text.startswith("<?xml") and "</svg>" in text for text in words.values())
        for name, label in {
            "strand-displacement": "displacement [mm]",
            "link-tension": "link tension [kN]",
            "contact-forces": "contact with sprockets [kN]",
            "tension-waterfall": "time [s]",
            "contact-angle": "angle since the roller reached the sprocket, in the direction of travel [degrees]",
        }.items():
            assert label in words[name], name
            assert "60 links of 50 mm, driver at 95.49 rpm" in words[name], name


def test_figures_from_an_archive(run, tmp_path):
    archive = write_archive(run, tmp_path / "a.mcap")
    assert len(plot_figures(archive, tmp_path / "plots", variant=0, kind=("png", "svg"), only=["drive"])) == 2


def test_refusals(run, tmp_path):
    drive = two_sprockets(duration=0.001, settle="false")
    part, bare = (simulate(drive, record=record) for record in (Record(channels=("tension",)), Record("none")))
    for line, call in {
        "variant 3 was not recorded": lambda: plot_figures(run, tmp_path, variant=3),
        "recorded without position": lambda: plot_figures(part, tmp_path),
        "nothing to draw": lambda: view(bare, save=tmp_path / "a.rrd"),
        "figure 'x': allowed are drive, strand-displacement": lambda: plot_figures(run, tmp_path, only=["x"]),
        "roller 60: allowed are 0 to 59": lambda: plot_figures(run, tmp_path, roller=60),
        "format 'gif': allowed are png, svg": lambda: plot_figures(run, tmp_path, kind="gif", only=["drive"]),
        "two speeds or more": lambda: plot_sweep([run, run], tmp_path),
    }.items():
        with pytest.raises(SimulationError, match=line):
            call()
    (tmp_path / "file").write_text("")
    for draw in (lambda: view(run, save=tmp_path / "absent" / "a.rrd"), lambda: plot_figures(run, tmp_path / "file")):
        with pytest.raises(ArchiveError, match="cannot be written"):
            draw()


def test_recording_is_whole_and_alone(run, tmp_path):
    view(run, save=tmp_path / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    assert (tmp_path / "a.rrd").stat().st_size > 100_000


def test_long_recordings_are_drawn_within_the_frame_budget(run):
    assert len(run[0].time) == 1001
    shown = thinned_trajectory(run[0], FRAME_BUDGET)
    assert len(shown.time) == FRAME_BUDGET
    assert (shown.time[0], shown.time[-1]) == (0.0, run[0].time[-1])


@pytest.mark.long
def test_a_sweep_over_speed_shows_the_tooth_passing_frequency(tmp_path):
    # chains settled on their sprockets run with the tooth-passing ripple of the polygon action
    drives = [two_sprockets(duration=0.2, speed=speed, span=19.5, links=59) for speed in (30.0, 20.0, 40.0)]
    run = simulate(drives, record=Record(rate=2000.0), limits=STARTING)
    found = speed_sweeps([run], "tension")
    to = " \N{RIGHTWARDS ARROW} "
    assert [sweep.name for sweep in found] == [f"driver{to}driven", f"driven{to}driver"]
    assert found[0].speed == pytest.approx(np.array([20.0, 30.0, 40.0]) * 30 / np.pi)
    for frequency, amplitude, speed in zip(found[0].frequency, found[0].amplitude, (20.0, 30.0, 40.0), strict=True):
        passing = 20 * speed / (2 * np.pi)
        step = frequency[1]  # 10 Hz: half of 0.2 s
        at = np.abs(frequency - passing) <= step
        other = (frequency > 0.3 * passing) & (frequency < 1.7 * passing) & (np.abs(frequency - passing) > 2 * step)
        assert amplitude[at].max() > np.median(amplitude[other])
    paths = plot_sweep([run], tmp_path)
    assert [path.stem for path in paths] == ["campbell-displacement", "campbell-resonance", "campbell-tension"]
    assert all(colored(path) > 0.01 for path in paths)


def test_a_campbell_diagram_of_a_table_has_its_lines_where_they_are():
    speed = np.array([60.0, 120.0, 180.0])
    frequency = np.linspace(0.0, 100.0, 201)
    amplitude = [np.exp(-(((frequency - 10.0 * s / 60.0) / 0.6) ** 2)) + 1e-6 for s in speed]
    figure = campbell_figure([SpeedSweep("a", "x [mm]", speed, [frequency] * 3, amplitude, 10)])
    axis = figure.axes[0]
    mesh = axis.collections[0]
    image = mesh.get_array().reshape(600, 3)
    up = np.linspace(0.0, axis.get_ylim()[1], 600)
    # brightest where 10 teeth pass: half a line of the spectrum is 0.25 Hz, a row of the picture 0.17 Hz
    assert up[image.argmax(axis=0)] == pytest.approx([10.0, 20.0, 30.0], abs=0.4)
    assert axis.get_xlabel() == "mean speed of the driver [rpm]"
    assert axis.get_ylabel() == "frequency [Hz]"


@pytest.mark.parametrize(
    ("harmonic", "order"),
    [
        # a load of order 6 on a sprocket of twice the teeth comes three times a revolution of the driver
        ({"order": 6, "amplitude": 5.0}, 3.0),
        # one that is counted on the driver's shaft comes as often as it says
        ({"order": 1.5, "amplitude": 5.0, "shaft": "driver"}, 1.5),
    ],
)
def test_excited_orders_count_the_drivers_revolutions(harmonic, order):
    teeth = {"sprockets.driven.teeth": 40, "chain.links": 70}
    drive = two_sprockets().with_values(teeth | {"sprockets.driven.load.harmonics": [harmonic]})
    assert [found.value for found in excited_orders(drive)] == [order]


def test_excited_orders_of_one_order_count_once():
    """The marine drive's crankshaft and its camshaft's load both have order 6."""
    assert [order.value for order in excited_orders(example("marine"))] == [6.0]


@pytest.mark.parametrize("name", ["marine", "engine", "industrial"])
def test_the_drawing_holds_all_arrows_and_fills_its_page(name):
    drive = example(name)
    run = simulate(drive.with_values({"run.duration": 0.005}))
    figure = drive_figure(run[0])
    FigureCanvasAgg(figure).draw()
    axis = figure.axes[0]
    quivers = [part for part in axis.collections if isinstance(part, Quiver)]
    assert quivers
    (left, right), (low, high) = axis.get_xlim(), axis.get_ylim()
    for quiver in quivers:
        tips = quiver.XY + np.stack([quiver.U, quiver.V], axis=-1)
        assert (tips[:, 0] > left).all() and (tips[:, 0] < right).all()
        assert (tips[:, 1] > low).all() and (tips[:, 1] < high).all()
    # title, labels, color bar and legend take the rest: 1.7 inches across and 1.9 up, of at least 5 by 5
    box = axis.get_position()
    assert box.width > 0.55 and box.height > 0.5
    size = max(right - left, high - low)
    unit = axis.get_xlabel()
    assert unit == ("x [m]" if size < 20.0 else "x [mm]")


def test_legends_stand_above_the_data_and_words_within_the_figure(run):
    """A panel has four fifths of the width; its legend covers no curve, and no label ends at the figure's edge."""
    for figure in (strand_displacement_figure(run[0]), link_tension_figure(run[0], 0), contact_angle_figure(run[0])):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        legends = [axis.get_legend() for axis in figure.axes if axis.get_legend()]
        assert legends
        for legend in legends:
            assert legend.get_window_extent().y0 >= legend.axes.get_window_extent().y1 - 1.0
        for axis in figure.axes:
            assert axis.get_window_extent().width > 0.8 * figure.bbox.width
            panel, labels = axis.get_window_extent(), axis.get_yticklabels()
            labels = [text for text in labels if panel.padded(5.0).y0 < text.get_window_extent().y0 < panel.y1]
            words = [axis.title, axis.xaxis.label, axis.yaxis.label, *labels]
            legend = axis.get_legend()
            boxes = [text.get_window_extent() for text in words if text.get_text() and text.get_visible()]
            for box in [*boxes, *([legend.get_window_extent()] if legend else [])]:
                assert box.x0 > 0.0 and box.y0 > 0.0 and box.x1 < figure.bbox.x1 and box.y1 < figure.bbox.y1
            ticks = [text.get_window_extent().x0 for text in labels if text.get_text()]
            assert axis.yaxis.label.get_window_extent().x1 <= min(ticks)


def test_the_mean_of_a_strand_is_that_of_the_window(run):
    """Over a window in which the displacement is its own number, the line lies there and has the window's ends."""
    trajectory = dataclasses.replace(run[0], window=(0.02, 0.03))
    axis = strand_displacement_figure(trajectory).axes[0]
    (curve, mean) = axis.lines
    inside = (trajectory.time > 0.02 - 1e-9) & (trajectory.time < 0.03 + 1e-9)
    unit = 1e3 if "[mm]" in axis.get_ylabel() else 1e6
    values = unit * strand_displacement(trajectory, 0)[inside]
    assert mean.get_ydata() == pytest.approx([values.mean()] * 2)
    assert list(mean.get_xdata()) == [0.02, 0.03] and "mean of 0.02 to 0.03 s" in mean.get_label()
    assert len(curve.get_xdata()) > 10


def test_curves_reach_from_edge_to_edge(run):
    (axis,) = link_tension_figure(run[0], 0).axes
    assert axis.get_xlim() == (axis.lines[0].get_xdata()[0], axis.lines[0].get_xdata()[-1])


def test_axes_are_in_units_that_fit(run):
    """300 N m on a radius of 0.16 m pull some 2 kN; at the ends of the strands that is thousandths of a newton less."""
    assert link_tension_figure(run[0], 0).axes[0].get_ylabel() == "link tension [kN]"
    light = dataclasses.replace(run[0], tension=1e-2 * run[0].tension)
    assert link_tension_figure(light, 0).axes[0].get_ylabel() == "link tension [N]"
    bar = [axis for axis in drive_figure(light).axes if "tension" in axis.get_ylabel()]
    assert [axis.get_ylabel() for axis in bar] == ["link tension [N]"]
