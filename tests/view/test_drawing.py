"""`warpchain draw`: the dimensions in a drive's picture, what it prints, and drawing again at every save."""

import math
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from chains import two_stages
from command import refused
from command import run as command
from drives import example
from matplotlib.backends.backend_agg import FigureCanvasAgg
from waiting import wait_for

from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.assembly import assemble_chain
from warpchain.drive.examples import drive_path, example_names
from warpchain.model import Model, single_chain
from warpchain.view.figures.drive_figure import TRAVEL_STYLE, drive_figure


def words_of(figure):
    return [text.get_text() for text in figure.axes[0].texts]


@pytest.mark.parametrize("name", example_names())
def test_radii_wraps_links_and_travel_are_in_the_picture(name):
    """Radii p / (2 sin(pi/z)) and wraps as of the path, to the digits that are shown; links add up with the seated."""
    drive = example(name)
    words = words_of(drive_figure(drive))
    for whole in Model(drive).chains:
        path = chain_path(whole)
        for s, sprocket in enumerate(whole.sprockets):
            if sprocket.is_end:
                assert any(w.startswith("end") for w in words)
                continue
            told = [w for w in words if w.startswith(f"{sprocket.teeth} teeth, r ")]
            shown = [re.fullmatch(r"\d+ teeth, r ([\d.]+) (m|mm)\nwrap ([\d.]+)\N{DEGREE SIGN}", w) for w in told]
            radius = whole.sprocket_pitch(s) / (2.0 * math.sin(math.pi / sprocket.teeth))
            assert any(
                float(match[1]) * (1e-3 if match[2] == "mm" else 1.0) == pytest.approx(radius, rel=1e-3)
                and float(match[3]) == pytest.approx(math.degrees(path.wrap_angle[s]), abs=0.051)
                for match in shown
            ), sprocket.name
        for links in assemble_chain(whole).strand_links[: len(whole.strand_names)]:
            assert f"{links} links" in words
        for arm, angle in zip(whole.arms, path.arm_angle, strict=True):
            (told,) = [w for w in words if w.startswith(f"{arm.name} at ")]
            assert f"{math.degrees(angle):+.1f}\N{DEGREE SIGN}" in told
            assert arm.stops is None or "{:+g} to {:+g}\N{DEGREE SIGN}".format(*arm.stops) in told
    assert f"{sum(chain.links for chain in drive.each_chain)} links" in drive_figure(drive).axes[0].get_title()


def test_arms_are_drawn_on_their_stops():
    """The blade's end lies on the circle about the pivot, a stop's angle from where the drawing has it: exact."""
    drive = example("car")
    (axis,) = drive_figure(drive).axes
    dashed = [line.get_xydata() for line in axis.lines if line.get_linewidth() == TRAVEL_STYLE["lw"]]
    pivot, end = 1e3 * np.array(drive.arms[0].pivot), 1e3 * np.array(single_chain(drive).profile(0).face[0].start)
    for stop in np.radians(drive.arms[0].stops):
        c, s = math.cos(stop), math.sin(stop)
        there = pivot + np.array([[c, -s], [s, c]]) @ (end - pivot)
        assert any(np.hypot(*(line - there).T).min() < 1e-9 for line in dashed)
    # and within the picture
    low, high = np.array([axis.get_xlim(), axis.get_ylim()]).T
    assert all((low < points).all() and (points < high).all() for points in dashed)


def test_texts_of_sprockets_on_one_shaft_stand_below_one_another():
    axis = drive_figure(example("v6")).axes[0]
    at = [(tuple(np.round(text.xy, 6)), text.xyann) for text in axis.texts]
    assert len(at) == len(set(at))


@pytest.mark.parametrize("name", ["v6", "car", "motorcycle_drivetrain"])
def test_labels_cover_neither_each_other_nor_sprockets(name):
    """But those of a sprocket itself, which stand at its center."""
    drive = example(name)
    figure = drive_figure(drive, size=8.5)
    figure.draw_without_rendering()
    (axis,) = figure.axes[:1]
    boxes = [(text, text.get_window_extent()) for text in axis.texts]
    for k, (text, box) in enumerate(boxes):
        for other, beside in boxes[:k]:
            assert not box.padded(-1.0).overlaps(beside), (text.get_text(), other.get_text())
    centers = 1e3 * np.array([sprocket.center for sprocket in drive.sprockets])
    teeth = [patch.get_path().transformed(patch.get_transform()) for patch in axis.patches if len(patch.get_xy()) > 50]
    assert len(teeth) >= len(drive.sprockets)
    for text, box in boxes:
        if not np.isclose(centers, text.xy, atol=5.0).all(axis=1).any():
            corners = np.array([[x, y] for x in np.linspace(box.x0, box.x1, 9) for y in (box.y0, box.y1)])
            assert not any(path.contains_points(corners).any() for path in teeth), text.get_text()


@pytest.mark.parametrize("name", ["v6", "derailleur"])
def test_labels_cover_no_line_of_the_drawing(name):
    """Without its labels, the picture has nothing dark where they stand: of their boxes less a pixel all around."""
    figure = drive_figure(example(name))
    canvas = FigureCanvasAgg(figure)
    axis = figure.axes[0]
    boxes = [text.get_window_extent(canvas.get_renderer()).padded(-1.5).extents for text in axis.texts]
    leaders = [line for line in axis.lines if line.get_linewidth() == 0.5]
    for artist in (*axis.texts, *leaders):
        artist.set_visible(False)
    canvas.draw()
    gray = np.asarray(canvas.buffer_rgba())[::-1, :, :3].min(axis=2)
    assert len(boxes) > 8
    for text, (left, low, right, top) in zip(axis.texts, np.round(boxes).astype(int), strict=True):
        assert gray[low:top, left:right].min() > 200, text.get_text()


def test_chains_have_colors_and_shafts_their_way_of_turning():
    """Four chains: four colors, in lines, outlines and the legend; one arrow a shaft; one driver among the marks."""
    drive = example("v6")
    figure = drive_figure(drive)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [*(chain.name for chain in Model(drive).chains), "driver", "driven"]
    colors = [handle.get_color() for handle in figure.legends[0].legend_handles[:4]]
    assert len(set(colors)) == 4
    axis = figure.axes[0]
    heads = [patch for patch in axis.patches if len(patch.get_xy()) == 4]
    shafts = {tuple(np.round(sprocket.center, 6)) for sprocket in drive.sprockets}
    assert len(heads) == len(shafts)
    marked = [line.get_xydata()[0] for line in axis.lines if line.get_marker() == "o" and len(line.get_xdata()) == 1]
    crank = 1e3 * np.array(drive.sprockets[drive.driver].center)
    assert sum(np.allclose(at, crank) for at in marked) == 1


def test_a_chain_that_does_not_fit_has_lengths_in_pitches():
    words = words_of(drive_figure(example("car").with_values({"chain.links": 140})))
    assert sum(word.endswith(" pitches") for word in words) == 3 and not any(w.endswith(" links") for w in words)


def test_draw_prints_what_check_finds(capsys, tmp_path):
    picture = tmp_path / "drive.svg"
    status, out, err = command(capsys, "draw", "marine", "-o", picture)
    assert (status, err) == (0, []) and out[-1] == str(picture) and "</svg>" in picture.read_text()
    found = [line for line in command(capsys, "check", "marine")[1] if line.startswith(("fit: ", "LAYOUT", "LOOK AT"))]
    assert out[:-1] == found and len(found) >= 1
    status, out, _ = command(capsys, "draw", "v6", "-o", tmp_path / "v6.png")
    assert status == 0 and sum(line.startswith('chain "') and "fit: " in line for line in out) == 4


def test_draw_refuses_in_one_line(capsys, tmp_path):
    for more in ((), ("--watch",)):
        status, _, err = command(capsys, "draw", "car", "-o", tmp_path / "car.gif", *more)
        assert status == 2 and err == [f"warpchain: error: -o {tmp_path / 'car.gif'}: must end in .png, .svg"]
    assert 'did you mean "car"?' in refused(capsys, "draw", "cat", "-o", tmp_path / "car.svg")
    # a chain that does not fit is drawn, which is what the picture may tell
    status, _, err = command(capsys, "draw", "car", "--set", "chain.links=140", "-o", tmp_path / "long.png")
    assert status == 2 and len(err) == 1 and (tmp_path / "long.png").stat().st_size > 10_000


@pytest.mark.long
def test_watch_draws_at_every_save_and_outlives_mistakes(tmp_path):
    file, picture = tmp_path / "drive.toml", tmp_path / "drive.svg"
    text = drive_path("motorcycle").read_text()
    file.write_text(text)
    words = [sys.executable, "-m", "warpchain", "draw", str(file), "-o", str(picture), "--watch"]
    told = tmp_path / "told.txt"
    with told.open("w") as out:
        process = subprocess.Popen(words, stdout=out, stderr=subprocess.STDOUT)
    try:
        wait_for(lambda: str(picture) in told.read_text())
        first = picture.read_bytes()
        file.write_text(text.replace("teeth = 45", "teeth = many"))
        wait_for(lambda: "error: " in told.read_text())
        assert picture.read_bytes() == first and process.poll() is None
        file.write_text(text.replace("teeth = 14", "teeth = 15"))
        wait_for(lambda: told.read_text().count(str(picture) + "\n") == 2)
        assert picture.read_bytes() != first
        assert told.read_text().count(" fit: ") == 2
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0 and "Traceback" not in told.read_text()
    finally:
        process.kill()


def test_the_title_of_a_narrow_drive_is_whole():
    # two stages, one above the other: a figure half as wide as the line on what was run
    drive = two_stages()
    upright = {f"sprockets.{s.name}.center": (s.center[1], s.center[0]) for s in drive.sprockets}
    upright |= {"sprockets.crank.name": "crankshaft sprocket with a long name"}
    figure = drive_figure(drive.with_values(upright))
    figure.canvas.draw()
    title = figure.axes[0].title.get_window_extent()
    assert figure.axes[0].get_title().count("\n") > 1
    assert title.x0 > 0.0 and title.x1 < figure.bbox.width
