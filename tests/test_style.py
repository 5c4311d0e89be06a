"""House rules that a machine can hold: a light command line."""

import subprocess
import sys
import time

import warpchain

HEAVY = ("warp", "rerun", "matplotlib", "pyarrow", "numpy", "pydantic", "mcap", "scipy")


def test_help_is_quick_and_loads_nothing_heavy():
    begin = time.perf_counter()
    command = [sys.executable, "-X", "importtime", "-m", "warpchain", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert time.perf_counter() - begin < 2.0  # 0.1 s here; the limit is for a busy machine
    for heavy in HEAVY:
        assert f" {heavy}\n" not in done.stderr, heavy


def test_importing_the_package_loads_nothing_heavy():
    code = "import sys, warpchain; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "warpchain" in done.stdout.split()
    assert not set(HEAVY) & set(done.stdout.split())


def test_version_is_the_installed_one():
    done = subprocess.run([sys.executable, "-m", "warpchain", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"warpchain {warpchain.__version__}\n"
