"""The README's picture: the marine drive in the headless Rerun viewer, without a screen.

    python scripts/render_picture.py docs/images/marine.png [SECONDS]

Needs a Vulkan driver; in software, Debian's mesa-vulkan-drivers and libvulkan1.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

SOFTWARE = Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json")


def screenshot(recording: Path, picture: Path, seconds: float, port: int = 9899) -> None:
    """Opens a recording in the headless viewer, goes to a simulated time and saves what it shows."""
    if "VK_ICD_FILENAMES" not in os.environ and SOFTWARE.exists():
        os.environ["VK_ICD_FILENAMES"] = str(SOFTWARE)
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    from rerun.experimental import ViewerClient

    viewer = ViewerClient.spawn(headless=True, port=port, hide_welcome_screen=True, detach_process=False)
    viewer.open(str(recording))
    time.sleep(2.0)
    viewer.set_time("sim_time", duration=seconds, play_state="paused")
    time.sleep(2.5)
    viewer.save_screenshot(str(picture))


def main() -> None:
    """Runs the marine drive and takes its picture."""
    from warpchain import load_drive, simulate
    from warpchain.examples import drive_path
    from warpchain.playback import view

    picture = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/marine.png")
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 1.5
    picture.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "marine.rrd"
        view(simulate(load_drive(drive_path("marine"))), save=recording)
        screenshot(recording, picture, seconds)
    print(picture)


if __name__ == "__main__":
    main()
