"""Warp's debug build looks at every index: both kernels over the test drives, and that it does look (`checked.py`)."""

import subprocess
import sys
from pathlib import Path

import pytest

CHECKED = Path(__file__).with_name("checked.py")


def checked(*words):
    return subprocess.run([sys.executable, CHECKED, *words], capture_output=True, text=True, timeout=900)


@pytest.mark.long
def test_no_kernel_reads_or_writes_out_of_bounds():
    done = checked()
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) >= 9 and all("within bounds" in line for line in lines)
    assert sum(line.startswith("blocks") for line in lines) >= 6


@pytest.mark.parametrize("how", ["array", *(pytest.param(how, marks=pytest.mark.long) for how in ("row", "view"))])
def test_what_is_out_of_bounds_ends_the_process(how):
    """The eighth value is the last of 8, and the last that is read."""
    done = checked("beyond", how)
    assert done.returncode not in (0, 1)
    assert done.stdout.splitlines() == ["read value 7 of 8"]
    assert "Assertion failed" in done.stderr
