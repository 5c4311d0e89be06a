"""Figures and playback: they are drawn, they show the chain, and they refuse in one line."""

import numpy as np
import pytest
from PIL import Image
from test_drive_physics import two_sprockets

from warpchain import Record, simulate, write_archive
from warpchain.errors import ArchiveError, SimulationError
from warpchain.playback import FRAMES, view
from warpchain.playback_drive import shown_frames
from warpchain.plots import plot_figures


@pytest.fixture(scope="module")
def run():
    return simulate(two_sprockets(duration=0.05, gravity=-9.81))


def colored(picture, least=60):
    """Share of pixels with a color (not gray)."""
    rgb = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    return (np.ptp(rgb, axis=2) > least).mean()


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_figures_are_drawn(run, tmp_path, kind):
    paths = plot_figures(run, tmp_path / "plots", kind=kind)
    names = ["drive", "strand-displacement", "link-tension", "contact-forces"]
    assert [path.name for path in paths] == [f"{name}.{kind}" for name in names]
    assert sorted(path.name for path in (tmp_path / "plots").iterdir()) == sorted(path.name for path in paths)
    if kind == "png":
        for path in paths:
            assert Image.open(path).size[0] > 600
            assert colored(path) > 0.001, path
    else:
        assert "link tension" in paths[2].read_text() or "<svg" in paths[2].read_text()


def test_figures_from_an_archive(run, tmp_path):
    archive = write_archive(run, tmp_path / "a.mcap")
    assert len(plot_figures(archive, tmp_path / "plots", variant=0)) == 4


def test_refusals(run, tmp_path):
    with pytest.raises(SimulationError, match="variant 3 was not recorded"):
        plot_figures(run, tmp_path, variant=3)
    part = simulate(two_sprockets(duration=0.001, settle="false"), record=Record(channels=("tension",)))
    with pytest.raises(SimulationError, match="recorded without position"):
        plot_figures(part, tmp_path)
    bare = simulate(two_sprockets(duration=0.001, settle="false"), record=Record("none"))
    with pytest.raises(SimulationError, match="nothing to draw"):
        view(bare, save=tmp_path / "a.rrd")
    with pytest.raises(ArchiveError, match="cannot be written"):
        view(run, save=tmp_path / "absent" / "a.rrd")
    (tmp_path / "file").write_text("")
    with pytest.raises(ArchiveError, match="cannot be written"):
        plot_figures(run, tmp_path / "file")


def test_recording_is_whole_and_alone(run, tmp_path):
    view(run, save=tmp_path / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]
    assert (tmp_path / "a.rrd").stat().st_size > 100_000


def test_long_recordings_are_drawn_within_the_frame_budget(run):
    assert len(run[0].time) == 1001
    shown = shown_frames(run[0], FRAMES)
    assert len(shown.time) == FRAMES
    assert (shown.time[0], shown.time[-1]) == (0.0, run[0].time[-1])
