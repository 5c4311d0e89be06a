"""What a person sees who opens an archive in Rerun with no set-up: colored rollers that move along the chain."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from waiting import wait_for

from warpchain import load_drive, simulate
from warpchain.drive.examples import drive_path

DRIVERS = Path("/usr/share/vulkan/icd.d")
SOFTWARE = DRIVERS / "lvp_icd.x86_64.json"


def colored(picture):
    """Columns and rows of the colored pixels of the 3D view, which is at the upper left."""
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    height, width, _ = pixels.shape
    view = pixels[int(0.06 * height) : int(0.39 * height), int(0.12 * width) : int(0.46 * width)]
    rows, columns = np.nonzero(np.ptp(view, axis=2) > 60)
    return {*zip(columns.tolist(), rows.tolist(), strict=True)}


@pytest.mark.viewer
@pytest.mark.skipif(not any(DRIVERS.glob("*.json")), reason="no Vulkan driver (mesa-vulkan-drivers, libvulkan1)")
def test_rerun_shows_moving_colored_rollers(tmp_path, monkeypatch):
    from rerun.experimental import ViewerClient

    archive = tmp_path / "marine.mcap"
    simulate(load_drive(drive_path("marine")).with_values({"run.settle": False}), duration=0.1, archive=archive)
    if SOFTWARE.exists():
        monkeypatch.setenv("VK_ICD_FILENAMES", str(SOFTWARE))
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
