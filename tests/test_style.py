"""House rules that a machine can hold: file lengths, imports that point one way, a light command line."""

import ast
import subprocess
import sys
import time
from pathlib import Path

import pytest

import warpchain

ROOT = Path(warpchain.__file__).resolve().parent.parent
PACKAGE = [path for folder in ("warpchain", "warpchain/study") for path in (ROOT / folder).glob("*.py")]
KERNELS = [path for path in (ROOT / "warpchain" / "kernels").glob("*.py")]
OTHERS = [path for folder in ("tests", "scripts") for path in (ROOT / folder).glob("*.py")]
HEAVY = ("warp", "rerun", "matplotlib", "pyarrow", "numpy", "pydantic", "mcap", "scipy")
LAYERS = ("cli", "simulation", "ensemble", "assembly", "drive")


def imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module or ""
        elif isinstance(node, ast.ImportFrom) and node.level > 1:
            yield "warpchain"  # all packages lie one level deep: two dots from the kernels lead to the package


@pytest.mark.parametrize("path", [*PACKAGE, *KERNELS, *OTHERS], ids=lambda path: path.name)
def test_files_are_under_400_lines(path):
    assert len(path.read_text().splitlines()) < 400


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_kernels_know_nothing_of_the_package(path):
    assert not [name for name in imported(path) if name.startswith("warpchain")]


@pytest.mark.parametrize("path", [*PACKAGE, *KERNELS, *OTHERS], ids=lambda path: path.name)
def test_kernels_are_imported_through_the_package(path):
    assert not [name for name in imported(path) if name.split(".")[0] == "kernels"]


@pytest.mark.parametrize("layer", range(len(LAYERS)), ids=lambda layer: LAYERS[layer])
def test_arrows_point_down(layer):
    above = {f"warpchain.{name}" for name in LAYERS[:layer]}
    assert not above & set(imported(ROOT / "warpchain" / f"{LAYERS[layer]}.py"))


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
