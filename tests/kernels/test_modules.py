"""Kernels are known again by what they are made of, and by nothing less."""

import ast
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import warp as wp

from warpchain.kernels import modules
from warpchain.kernels.cpu.serial import advance_kernel
from warpchain.kernels.gpu.block_kind import BlockKind
from warpchain.kernels.physics import impact
from warpchain.results.channels import FRAME, FrameLayout, frame_of

ROOT = Path(__file__).resolve().parents[2]
KERNELS = ROOT / "kernels"


def factories():
    """Every function that makes a kernel with a module of its own: where, its arguments, and what the module is for."""
    for path in sorted(KERNELS.rglob("*.py")):
        for made in ast.walk(ast.parse(path.read_text())):
            if not isinstance(made, ast.FunctionDef):
                continue
            for call in (node for inner in made.body for node in ast.walk(inner) if isinstance(node, ast.Call)):
                if isinstance(call.func, ast.Name) and call.func.id == "own_module":
                    name, *form = call.args
                    yield path.name, name.value, [a.arg for a in made.args.args], [ast.unparse(word) for word in form]


def test_a_module_is_for_all_that_its_factory_is_asked_for():
    """What a factory took and its module left out would give two kernels one name in the cache."""
    found = list(factories())
    assert len(found) >= 4
    assert len({name for _, name, _, _ in found}) == len(found)
    for where, _, arguments, form in found:
        assert form == arguments, where


def test_no_kernel_is_hashed_by_warp():
    for path in sorted(KERNELS.rglob("*.py")):
        assert 'module="unique"' not in path.read_text(), path.name


def test_whatever_a_kernel_is_made_for_tells_it_apart():
    kind = BlockKind(wp.float64, 32, 4, 2, 1)
    asked = frame_of(["joint_friction_power"])
    forms = [
        ("advance", wp.float64, 264, FRAME),
        ("relax", wp.float64, 264, FRAME),
        ("advance", wp.float32, 264, FRAME),
        ("advance", wp.float64, 1032, FRAME),
        ("advance", wp.float64, 264, asked),
        ("advance", wp.float64, 264, FRAME, True),
        ("advance", kind, 4, FRAME),
        ("advance", kind, 8, FRAME),
        ("advance", replace(kind, measuring=True), 4, FRAME),
    ]
    assert len({modules.digest(*form) for form in forms}) == len(forms)
    assert modules.digest(*forms[0]) == modules.digest("advance", wp.float64, 264, FrameLayout(FRAME.channels))


def test_a_law_that_is_added_while_running_tells_it_apart(monkeypatch):
    before = modules.digest("advance", wp.float64)
    monkeypatch.setattr(impact, "FORCES", (*impact.FORCES, impact.hysteretic))
    assert modules.digest("advance", wp.float64) != before


def test_another_version_of_warp_hashes_kernels_itself(monkeypatch):
    monkeypatch.setattr(wp, "__version__", "1.18.0")
    assert modules.own_module("advance", wp.float64) == "unique"


def test_this_version_of_warp_is_known():
    # else starts are slower by half a second: see whether `_Hasher` and `_Module` still fit, and add it to `KNOWN`
    assert wp.__version__.startswith(modules.KNOWN)
    kernel = advance_kernel(wp.float64, 264, FRAME, plain=True)
    assert isinstance(kernel.module, modules._Module)
    kernel.module.get_module_hash(1)
    assert kernel.module.hashers and all(isinstance(of, modules._Hasher) for of in kernel.module.hashers.values())


NAME = """
import warp as wp
wp.config.log_level = wp.LOG_ERROR
from warpchain.kernels import modules
print(modules.digest("advance", wp.float64).hex())
"""


@pytest.mark.parametrize("file", ["cpu/serial.py", "physics/link.py"])
def test_any_change_of_a_source_tells_kernels_apart(file, tmp_path):
    shutil.copytree(KERNELS, tmp_path / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    skip = shutil.ignore_patterns("__pycache__", "kernels")
    shutil.copytree(ROOT / "warpchain", tmp_path / "warpchain", ignore=skip)
    (tmp_path / "warpchain" / "kernels").symlink_to("../kernels")

    def told():
        words = [sys.executable, "-c", NAME]
        done = subprocess.run(
            words,
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split()[-1]

    first = told()
    assert first == told()
    path = tmp_path / "kernels" / file
    path.write_text(path.read_text() + "\n# changed\n")
    assert told() != first
