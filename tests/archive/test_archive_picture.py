"""What a person sees who opens an archive in Rerun with no set-up: colored rollers that move along the chain."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

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
        time.sleep(3.0)
        for k, seconds in enumerate((0.0, 0.005)):  # in 5 ms the chain travels half a pitch
            viewer.set_time("message_log_time", duration=seconds, play_state="paused")
            time.sleep(1.5)
            viewer.save_screenshot(str(tmp_path / f"{k}.png"))
            seen.append(colored(tmp_path / f"{k}.png"))
    columns, rows = np.array(list(seen[0])).T
    assert len(columns) > 300
    assert np.ptp(columns) > 80
    assert np.ptp(rows) > 60
    assert len(seen[0] ^ seen[1]) > 100  # other pixels half a pitch later
