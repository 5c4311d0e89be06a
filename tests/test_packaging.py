"""What gets installed: the same files from the tree and from a source archive, and no import that is not declared."""

import ast
import pydoc
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import warpchain

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
# what a build reads; the link to the kernels is copied as a link
SOURCES = ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "warpchain", "kernels", "tests")


def names(requirements):
    """Distribution names of requirements, in the spelling that compares equal."""
    return {re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", word).group()).lower() for word in requirements}


def build(kind, source, out):
    """Runs the build backend of `source` as a front end would, without a network; returns the file that it made."""
    backend = pytest.importorskip("setuptools")
    if int(backend.__version__.split(".")[0]) < 77:
        pytest.skip("setuptools is older than the build needs")
    code = "import sys; from setuptools import build_meta; print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"
    command = [sys.executable, "-c", code, f"build_{kind}", str(out)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of what a build reads."""
    tree = tmp_path_factory.mktemp("packaging") / "tree"
    tree.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, tree / name)
    return tree


@pytest.fixture(scope="module")
def wheels(tree):
    """A wheel of the tree, and one of the source archive."""
    home, out = tree.parent, tree.parent / "out"
    out.mkdir()
    archive = build("sdist", tree, out)
    with tarfile.open(archive) as packed:
        packed.extractall(home / "unpacked")
    (unpacked,) = (home / "unpacked").iterdir()
    (home / "again").mkdir()
    return build("wheel", tree, out), build("wheel", unpacked, home / "again")


def installed_files(wheel):
    """Content of each file that the wheel installs beside its metadata."""
    with zipfile.ZipFile(wheel) as packed:
        return {name: packed.read(name) for name in packed.namelist() if ".dist-info/" not in name}


def test_wheels_hold_the_sources_and_nothing_else(wheels):
    sources = {
        f"warpchain/{path.relative_to(ROOT / 'warpchain')}": path.read_bytes()
        for folder in (ROOT / "warpchain", ROOT / "warpchain" / "kernels")
        for path in folder.rglob("*")
        if path.suffix in (".py", ".c", ".toml", ".typed", ".css", ".js", ".json")
    }
    for name in ("py.typed", "files.py", "kernels/physics/link.py", "drive/examples/marine.toml"):
        assert f"warpchain/{name}" in sources
    assert any(name.startswith("warpchain/study/examples/") for name in sources)
    for wheel in wheels:
        assert installed_files(wheel) == sources


def test_the_source_archive_has_no_tests(wheels, tree):
    """setuptools would take those named `test_*`, without the modules that they import."""
    (unpacked,) = (tree.parent / "unpacked").iterdir()
    assert (unpacked / "warpchain").is_dir() and not (unpacked / "tests").exists()


@pytest.mark.long
def test_kernels_import_from_an_unpacked_wheel(wheels, tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import warpchain.kernels.cpu.advance as s, warpchain.cli as c; "
        "assert s.__file__.startswith(sys.argv[1]), s.__file__; sys.exit(c.main(['check', 'marine']))"
    )
    for n, wheel in enumerate(wheels):
        home = tmp_path / str(n)
        with zipfile.ZipFile(wheel) as packed:
            packed.extractall(home)
        done = subprocess.run([sys.executable, "-c", code, str(home)], cwd="/", capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert "162 links" in done.stdout


def test_an_editable_install_is_a_path_that_type_checkers_follow(tree, tmp_path):
    """They read `.pth` files, but run no finder that setuptools would put there otherwise."""
    with zipfile.ZipFile(build("editable", tree, tmp_path)) as packed:
        beside = [name for name in packed.namelist() if ".dist-info/" not in name]
        assert [packed.read(name).decode().strip() for name in beside] == [str(tree)]


def test_public_names_are_listed_documented_and_typed():
    assert dir(warpchain) == sorted(warpchain.__all__)
    assert re.search(r"simulate\(\s*drives", pydoc.render_doc(warpchain, renderer=pydoc.plaintext))
    (typed,) = (node for node in ast.parse(Path(warpchain.__file__).read_text()).body if isinstance(node, ast.If))
    homes = {alias.asname or alias.name: (node.module, alias.name) for node in typed.body for alias in node.names}
    assert homes == {name: (f"warpchain.{home}", name) for name, home in warpchain._HOME.items()}


def test_link_to_the_kernels_is_relative():
    link = ROOT / "warpchain" / "kernels"
    assert link.is_symlink()
    assert str(link.readlink()) == "../kernels"


def imported_modules():
    """Top-level names of all that the package imports, at the top of files and inside functions."""
    for path in [*(ROOT / "warpchain").rglob("*.py"), *(ROOT / "kernels").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from (alias.name.split(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                yield node.module.split(".")[0]


def test_every_import_is_declared_and_every_dependency_imported():
    declared, homes = names(PROJECT["project"]["dependencies"]), packages_distributions()
    extras = PROJECT["project"]["optional-dependencies"]
    offered = declared | {name for extra in extras.keys() - {"test", "dev"} for name in names(extras[extra])}
    foreign = set(imported_modules()) - set(sys.stdlib_module_names) - {"warpchain"}
    undeclared = {module for module in foreign if not names(homes.get(module, [])) & offered}
    assert undeclared <= {"pydantic_core"}  # comes with pydantic, which fixes its version
    assert not declared - {name for module in foreign for name in names(homes.get(module, []))}


def test_extras_add_what_the_tests_and_checks_need():
    extras = PROJECT["project"]["optional-dependencies"]
    assert {"pytest", "hypothesis", "setuptools"} <= names(extras["test"])
    assert {"warpchain", "ruff", "mypy"} <= names(extras["dev"])
    assert {"build", "twine"} <= names(extras["release"])
