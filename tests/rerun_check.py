"""Asks Rerun's own checker about an MCAP file."""

import shutil
import subprocess
import sys
from pathlib import Path


def rerun_accepts(path):
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent)) or shutil.which("rerun")
    done = subprocess.run([rerun, "mcap", "check", "--full", str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return True
