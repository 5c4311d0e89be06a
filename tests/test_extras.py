"""Extras: which modules they bring, asked for before work begins, installed by the name of the package."""

import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from command import refused
from study_helpers import write_study

from warpchain import extras

ROOT = Path(__file__).resolve().parent.parent
OPTIONAL = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
WITHOUT_CODE = {"mcap", "fmu", "codes", "docs", "notebook", "release", "test", "dev"}
"""Extras that no code of the package imports: other programs' readers, checks, documents, development."""


def distributions(extra):
    """Names of the distributions that an extra brings, those of other extras of this package too."""
    for line in OPTIONAL[extra]:
        name, inner = re.fullmatch(r"([\w-]+)(?:\[(\w+)\])?[^\[]*", line).groups()
        yield from distributions(inner) if name == "warpchain" else [name.lower()]


def test_the_modules_of_each_extra_are_those_of_its_distributions():
    assert set(extras.EXTRA_MODULES) == set(OPTIONAL) - WITHOUT_CODE
    owners = packages_distributions()
    for extra, modules in extras.EXTRA_MODULES.items():
        assert {owners[module][0].lower() for module in modules} == set(distributions(extra)), extra


def test_the_page_on_installing_lists_all_extras():
    page = (ROOT / "docs" / "tutorials" / "install.md").read_text()
    rows = re.findall(r"^\| (`[^|]*`) \|", page, re.MULTILINE)
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(OPTIONAL) - {"test", "release"}


def test_an_extra_is_installed_by_the_package_s_name_wherever_it_came_from(monkeypatch):
    monkeypatch.setitem(extras.EXTRA_MODULES, "dxf", ("no_such_module",))
    with pytest.raises(ValueError, match=r"^a DXF file: needs no_such_module; .* pip install 'warpchain\[dxf\]'$"):
        extras.require_extra("dxf", "a DXF file", ValueError)


@pytest.mark.parametrize(
    ("command", "module", "more"),
    [
        ("calibrate", "emcee", ""),
        ("optimize", "sklearn", ""),
        ("optimize", "pymoo", '[optimize]\nengine = "population"\n'),
    ],
)
def test_a_search_asks_for_its_packages_before_it_runs_anything(capsys, tmp_path, monkeypatch, command, module, more):
    monkeypatch.setitem(sys.modules, module, None)
    study = write_study(tmp_path)
    study.write_text(study.read_text() + f'[[objectives]]\nmetric = "tension_max"\nsense = "min"\n{more}')
    assert f"{command}: needs {module}; install it with: pip" in refused(capsys, command, study, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
