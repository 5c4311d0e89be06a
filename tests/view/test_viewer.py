"""Playback as a person sees it: screenshots of the headless Rerun viewer and of the web viewer in headless Chromium."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from browsing import no_browser, web_screenshot
from drives import example, two_sprockets
from loading import load_script
from PIL import Image
from waiting import wait_for

from warpchain import simulate, write_archive
from warpchain.results.tension_colors import tension_colors
from warpchain.view.rerun.run_playback import view

render = load_script("drawings.pictures")

SCALE = np.unique(tension_colors(np.arange(256.0), 255.0)[:, :3], axis=0).astype(int)


@pytest.fixture(scope="module")
def run():
    """The marine drive, which looks the same neither upside down nor in a mirror."""
    drive = example("marine")
    return simulate(drive.with_values({"run.duration": 0.02, "run.sample_rate": 2500.0}))


def on_scale(picture, right):
    """Pixels (rows, columns) of the tension's color scale in the picture's part left of the share `right`."""
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    seen = np.zeros(pixels.shape[:2], dtype=bool)
    part = pixels[85:-60, : int(right * pixels.shape[1])]
    for k in range(0, len(SCALE), 4):
        seen[85:-60, : part.shape[1]] |= np.abs(part - SCALE[k]).max(axis=2) < 14
    return seen


def path_seen(picture, trajectory, right=0.39):
    """Likeness of the colored pixels to the chain: (share of rollers found, how unlike the scales of x and y are).

    The colored pixels' bounding box is laid on that of the rollers, y up; then each roller's place must be colored.
    """
    seen = on_scale(picture, right)
    rows, columns = np.nonzero(seen)
    if len(rows) < 500:
        return 0.0, np.inf
    x = trajectory.position.mean(axis=0)
    low, high = x.min(axis=0), x.max(axis=0)
    across, up = np.ptp(columns) / (high - low)[0], np.ptp(rows) / (high - low)[1]
    at_column = np.rint(columns.min() + (x[:, 0] - low[0]) * across).astype(int)
    at_row = np.rint(rows.min() + (high[1] - x[:, 1]) * up).astype(int)
    found = [seen[max(r - 3, 0) : r + 4, max(c - 3, 0) : c + 4].any() for r, c in zip(at_row, at_column, strict=True)]
    return float(np.mean(found)), abs(across / up - 1.0)


def is_chain(found, distortion):
    # rollers lie 20 pixels apart and are sought within 3; a chain upside down or mirrored would miss most. The box of
    # the pixels is one roller wider and higher than that of the centers: 0.07 m in 2 m against 0.07 in 6
    return found > 0.95 and distortion < 0.05


def assert_chain(picture, trajectory):
    seen = path_seen(picture, trajectory)
    assert is_chain(*seen), seen


@pytest.mark.viewer
@pytest.mark.skipif(render.missing_vulkan_reason() is not None, reason=str(render.missing_vulkan_reason()))
def test_the_viewer_shows_the_chain_along_its_path(run, tmp_path):
    view(run, save=tmp_path / "a.rrd")
    render.save_screenshot(tmp_path / "a.rrd", tmp_path / "a.png", 0.01)
    assert_chain(tmp_path / "a.png", run[0])


@pytest.mark.viewer
@pytest.mark.skipif(render.missing_vulkan_reason() is not None, reason=str(render.missing_vulkan_reason()))
def test_the_viewer_shows_tension_along_the_chain_as_an_image(run, tmp_path):
    view(run, save=tmp_path / "a.rrd", tab="tension")
    render.save_screenshot(tmp_path / "a.rrd", tmp_path / "a.png", 0.01)
    seen = on_scale(tmp_path / "a.png", 1.0)[: 1080 // 2]
    rows, columns = np.nonzero(seen)
    assert np.ptp(columns) > 0.5 * seen.shape[1]
    # the image is one block: nearly every pixel within it has a color of the scale
    left, right = np.quantile(columns, [0.02, 0.98]).astype(int)
    assert seen[rows.min() : rows.max() + 1, left:right].mean() > 0.8


def listening(port):
    """Addresses that this machine listens at on a port, as /proc/net/tcp has them."""
    rows = [Path(f"/proc/net/{name}").read_text().splitlines()[1:] for name in ("tcp", "tcp6")]
    lines = [line.split() for line in (*rows[0], *rows[1])]
    return [line[1].split(":")[0] for line in lines if line[3] == "0A" and int(line[1].split(":")[1], 16) == port]


def served(server):
    """The address that a server of the web viewer prints, and its two ports."""
    url = server.stdout.readline().strip()
    return url, int(url.split(":")[2].split("/")[0]), int(url.split("%3A")[-1].split("%2F")[0])


@pytest.mark.viewer
@pytest.mark.skipif(no_browser() is not None, reason=str(no_browser()))
def test_the_web_viewer_shows_the_chain_and_listens_on_this_machine_alone(run, tmp_path):
    archive = write_archive(run, tmp_path / "a.mcap")
    command = [sys.executable, "-m", "warpchain", "view", str(archive), "--web"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            url, page, data = served(server)
            assert url.startswith("http://127.0.0.1:")
            assert listening(page) == listening(data) == ["0100007F"]
            web_screenshot(url, tmp_path / "a.png", lambda picture: is_chain(*path_seen(picture, run[0])))
        finally:
            server.send_signal(signal.SIGINT)
        assert server.wait(20) == 0
    assert not listening(page) and not listening(data)
    assert_chain(tmp_path / "a.png", run[0])


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_the_web_viewer_ends_with_the_process_that_serves_it(tmp_path, end):
    """Whatever ends it: a service manager, a closed terminal, a kill."""
    run = simulate(two_sprockets(duration=0.001, settle="false"))
    command = [sys.executable, "-m", "warpchain", "view", str(write_archive(run, tmp_path / "a.mcap")), "--web"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        _, page, data = served(server)
        assert listening(page) and listening(data)
        server.send_signal(end)
        assert server.wait(20) == -end
    wait_for(lambda: not listening(page) and not listening(data), 20.0)


def colored(picture):
    """Columns and rows of the colored pixels of the 3D view, which is at the upper left."""
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    height, width, _ = pixels.shape
    view = pixels[int(0.06 * height) : int(0.39 * height), int(0.12 * width) : int(0.46 * width)]
    rows, columns = np.nonzero(np.ptp(view, axis=2) > 60)
    return {*zip(columns.tolist(), rows.tolist(), strict=True)}


@pytest.mark.viewer
@pytest.mark.skipif(render.missing_vulkan_reason() is not None, reason=str(render.missing_vulkan_reason()))
def test_an_archive_opened_with_no_set_up_shows_moving_colored_rollers(tmp_path, monkeypatch):
    from rerun.experimental import ViewerClient

    archive = tmp_path / "marine.mcap"
    simulate(example("marine").with_values({"run.settle": False}), duration=0.1, archive=archive)
    if render.SOFTWARE.exists():
        monkeypatch.setenv("VK_ICD_FILENAMES", str(render.SOFTWARE))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    seen = []
    with ViewerClient.spawn(headless=True, port=9897, hide_welcome_screen=True, detach_process=False) as viewer:
        viewer.open(str(archive))

        def shows(seconds):
            """The view at a time, once two pictures in turn are alike and colored, and not those of another time."""
            viewer.set_time("message_log_time", duration=seconds, play_state="paused")
            viewer.save_screenshot(str(tmp_path / "now.png"))
            pixels.append(colored(tmp_path / "now.png"))
            return len(pixels) > 1 and len(pixels[-1]) > 300 and pixels[-1] == pixels[-2] and pixels[-1] not in seen

        for seconds in (0.0, 0.005):  # in 5 ms the chain travels half a pitch
            pixels = []
            wait_for(lambda at=seconds: shows(at))
            seen.append(pixels[-1])
    columns, rows = np.array(list(seen[0])).T
    assert len(columns) > 300
    assert np.ptp(columns) > 80
    assert np.ptp(rows) > 60
    assert len(seen[0] ^ seen[1]) > 100  # other pixels half a pitch later
