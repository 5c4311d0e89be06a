"""Kernels are known again by what they are made of, and by nothing less."""

import ast
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import warp as wp

from warpchain.kernels import modules
from warpchain.kernels.cpu import advance
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import BlockKind, BlockShape, Parts
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.statistics import tally_sum_kernel
from warpchain.kernels.physics import impact
from warpchain.results.channels import DEFAULT_FRAME, FrameLayout, frame_with_channels

ROOT = Path(__file__).resolve().parents[2]
KERNELS = ROOT / "kernels"


digest = partial(modules.kernel_digest, advance.__file__)


def factories():
    """Every function that makes a kernel with a module of its own: where, its arguments, and what the module is for."""
    for path in sorted(KERNELS.rglob("*.py")):
        for made in ast.walk(ast.parse(path.read_text())):
            if not isinstance(made, ast.FunctionDef):
                continue
            for call in (node for inner in made.body for node in ast.walk(inner) if isinstance(node, ast.Call)):
                if isinstance(call.func, ast.Name) and call.func.id == "own_module":
                    file, name, *form = call.args
                    assert ast.unparse(file) == "__file__"
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
    kind = BlockKind(wp.float64, BlockShape(32, 4), Parts(2, 1))
    asked = frame_with_channels(["joint_friction_power"])
    forms = [
        ("advance", wp.float64, 264, DEFAULT_FRAME),
        ("relax", wp.float64, 264, DEFAULT_FRAME),
        ("advance", wp.float32, 264, DEFAULT_FRAME),
        ("advance", wp.float64, 1032, DEFAULT_FRAME),
        ("advance", wp.float64, 264, asked),
        ("advance", wp.float64, 264, DEFAULT_FRAME, True),
        ("advance", kind, 4, DEFAULT_FRAME),
        ("advance", kind, 8, DEFAULT_FRAME),
        ("advance", replace(kind, measuring=True), 4, DEFAULT_FRAME),
    ]
    assert len({digest(*form) for form in forms}) == len(forms)
    assert digest(*forms[0]) == digest("advance", wp.float64, 264, FrameLayout(DEFAULT_FRAME.channels))


def test_a_law_that_is_added_while_running_tells_it_apart(monkeypatch):
    before = digest("advance", wp.float64)
    monkeypatch.setattr(impact, "FORCES", (*impact.FORCES, impact.hysteretic_damper))
    assert digest("advance", wp.float64) != before


def test_another_version_of_warp_hashes_kernels_itself(monkeypatch):
    monkeypatch.setattr(wp, "__version__", "1.18.0")
    assert modules.own_module(advance.__file__, "advance", wp.float64) == "unique"


def test_no_compiler_contracts_the_kernels_of_gpus(monkeypatch):
    kind = BlockKind(wp.float64, BlockShape(32, 4), Parts(2, 1))
    kernels = [block_kernel(kind, 4, DEFAULT_FRAME), block_relax_kernel(kind, 4), tally_sum_kernel(wp.float64)]
    monkeypatch.setattr(wp, "__version__", "1.18.0")  # which hashes kernels itself
    kernels.append(tally_sum_kernel.__wrapped__(wp.float64))
    assert not any(kernel.module.options["fuse_fp"] for kernel in kernels)
    assert not isinstance(kernels[-1].module, modules._Module)


ELSEWHERE = """
import sys, types
import warp as wp
name, held = "warp._src.context", sys.modules["warp._src.context"]
sys.modules[name] = types.ModuleType(name)  # while warpchain looks for its names
wp.__version__ = "9.0.0"
from warpchain.engine import _is_warp_started, start_warp
from warpchain.kernels import modules
assert not _is_warp_started()
sys.modules[name] = held
start_warp()
assert _is_warp_started()
start_warp(precompiled=False)
from warpchain.kernels.cpu import advance, relax
assert modules.own_module(advance.__file__, "advance", wp.float64) == "unique"
print(wp.is_cpu_available())
"""


def test_a_version_of_warp_whose_insides_are_elsewhere_will_do():
    words, environment = [sys.executable, "-c", ELSEWHERE], os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[-2] == "True"


@pytest.mark.long
def test_runs_are_the_same_where_warp_hashes_kernels_itself():
    """To the last bit: by value or by reference, a struct holds the same numbers."""
    run = (
        "from drives import two_sprockets; from warpchain import simulate\n"
        "print(repr(simulate(two_sprockets(duration=0.002), device='cpu').metrics.to_pylist()[0]))"
    )
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}
    told = [
        subprocess.run(
            [sys.executable, "-c", before + run], env=environment, capture_output=True, text=True, check=True
        )
        for before in ("", ELSEWHERE)
    ]
    first, second = (done.stdout.split("\n")[-2] for done in told)
    assert first == second and "tension_max" in first


def test_this_version_of_warp_is_known():
    # else starts are slower by half a second: see whether `_Hasher` and `_Module` still fit, and add it to `KNOWN`
    assert wp.__version__.startswith(modules.KNOWN_VERSIONS)
    kernel = advance.advance_kernel(wp.float64, 264, DEFAULT_FRAME, several=False)
    assert isinstance(kernel.module, modules._Module)
    kernel.module.get_module_hash(1)
    assert kernel.module.hashers and all(isinstance(of, modules._Hasher) for of in kernel.module.hashers.values())


KERNEL_FILES = ("cpu/advance.py", "cpu/relax.py", "gpu/block.py", "gpu/relax.py")
IMPORTED = """
import sys
from importlib import import_module
for file in sys.argv[1:]:
    for name in [name for name in sys.modules if name.startswith("warpchain.kernels")]:
        del sys.modules[name]
    import_module("warpchain.kernels." + file.removesuffix(".py").replace("/", "."))
    files = (name for name, module in sys.modules.items() if not hasattr(module, "__path__"))
    print(*(name for name in files if name.startswith("warpchain.kernels.")))
"""


def test_a_kernel_reaches_what_python_imports_for_it():
    words = [sys.executable, "-c", IMPORTED, *KERNEL_FILES]
    done = subprocess.run(words, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True)
    for file, names in zip(KERNEL_FILES, done.stdout.splitlines()[-len(KERNEL_FILES) :], strict=True):
        found = {name.removeprefix("warpchain.kernels.") for name in names.split()}
        reached = modules.reached_files(modules.HERE / file)
        assert {".".join(path.relative_to(modules.HERE).with_suffix("").parts) for path in reached} == found, file


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A copy of the kernels' files, of which digests are made."""
    here = tmp_path / "kernels"
    shutil.copytree(KERNELS, here, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(modules, "HERE", here)
    return here


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("cpu/advance.py", ["cpu/advance.py"]),
        ("cpu/teeth.py", ["cpu/advance.py", "cpu/relax.py"]),
        ("relaxation.py", ["cpu/relax.py", "gpu/relax.py"]),
        ("gpu/contacts.py", ["gpu/block.py", "gpu/relax.py"]),
        ("physics/link.py", list(KERNEL_FILES)),
        ("by_reference.py", list(KERNEL_FILES)),
        ("cpu/rig.py", []),
    ],
)
def test_a_change_of_a_file_tells_the_kernels_that_reach_it_apart(file, changed, copied):
    def digests():
        modules.sources_digest.cache_clear()
        modules.reached_files.cache_clear()
        return {of: modules.kernel_digest(str(copied / of), "name", wp.float64) for of in KERNEL_FILES}

    before = digests()
    assert before == digests()
    (copied / file).write_text((copied / file).read_text() + "\n# changed\n")
    after = digests()
    assert [of for of in KERNEL_FILES if before[of] != after[of]] == changed


def test_headers_compiled_before_make_no_other_kernel(monkeypatch):
    # as the command line and calls from Python set it differently, and would compile each kernel twice
    hashes = []
    for value in (True, False):
        monkeypatch.setattr(wp.config, "use_precompiled_headers", value)
        hashes.append(modules._Module("kernels", b"made of this").get_module_hash(1))
    assert hashes[0] == hashes[1]
