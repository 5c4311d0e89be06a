"""The architecture as a test: who may import whom, read from every import in the tree, lazy and type-only ones too."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import warpchain

ROOT = Path(warpchain.__file__).resolve().parent
KERNELS = ROOT.parent / "kernels"

LEVELS = (
    (
        *("errors", "argument_checks", "extras", "version", "files"),
        *("progress", "python_process", "notebook_renderer", "gc_tuning"),
    ),
    ("drive",),
    ("model",),
    ("assembly",),
    ("results",),
    ("archive",),
    ("engine", "view"),
    ("modal",),
    ("study",),
    ("cli",),
    ("", "__main__", "examples", "fit"),
)
"""The package's folders and single modules from the lowest up; "" is the root, with the names that users see."""

KERNEL_LEVELS = (
    ("native",),
    ("number",),
    ("precision", "by_reference"),
    ("structs",),
    ("integrate",),
    ("physics",),
    ("sums", "statistics", "relaxation", "frames", "modules"),
    ("bodies",),
    ("cpu", "gpu"),
)
STUDY_LEVELS = (
    ("store",),
    ("results",),
    ("spec",),
    ("design",),
    ("run",),
    ("analysis",),
    ("surrogate",),
    ("optimize",),
    ("forecast",),
    ("report",),
    ("grow_until",),
)
WITHOUT_WARP = ("drive", "model", "assembly", "results", "archive", "view")


def modules(root: Path, prefix: str) -> dict[str, Path]:
    """Every module below `root` by its dotted name."""
    found = {}
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        if prefix == "warpchain" and parts[0] == "kernels":
            continue
        name = ".".join((prefix, *parts)).removesuffix(".__init__")
        found[name] = path
    return found


def named_modules(call: ast.Call, known: dict[str, Path]) -> list[str]:
    """The modules in `known` that a call of `import_module` may name, by a literal or by an f-string's first part.

    One that begins with the package alone may name any module, and counts for none.
    """
    called = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", None)
    if called not in ("import_module", "__import__") or not call.args:
        return []
    word = call.args[0]
    if isinstance(word, ast.JoinedStr):
        head = getattr(word.values[0], "value", None) if word.values else None
        below = isinstance(head, str) and head.count(".") > 1
        return [module for module in known if module.startswith(head)] if below else []
    return [word.value] if isinstance(word, ast.Constant) and isinstance(word.value, str) else []


def imports(name: str, path: Path, known: dict[str, Path]) -> Iterator[str]:
    """The modules in `known` that a module imports, wherever in it the import stands."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        wanted = []
        if isinstance(node, ast.Call):
            wanted = [(source, "") for source in named_modules(node, known)]
        if isinstance(node, ast.Import):
            wanted = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            wanted = [(source, alias.name) for alias in node.names]
        for source, member in wanted:
            if f"{source}.{member}" in known:
                yield f"{source}.{member}"
            elif source in known:
                yield source


def graph(known: dict[str, Path]) -> dict[str, set[str]]:
    """What each module imports of the others."""
    return {name: set(imports(name, path, known)) - {name} for name, path in known.items()}


PACKAGE = modules(ROOT, "warpchain")
KERNEL_MODULES = modules(KERNELS, "warpchain.kernels")


@cache
def package_arrows() -> dict[str, set[str]]:
    """What each module of the package and of the kernels imports of these."""
    return graph(PACKAGE | KERNEL_MODULES)


def circles(arrows: dict[str, set[str]]) -> list[tuple[str, ...]]:
    """Circles of imports, each by its modules in order."""
    found, done = [], set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        if name in path:
            found.append(path[path.index(name) :])
        elif name not in done:
            for other in sorted(arrows[name]):
                visit(other, (*path, name))
            done.add(name)

    for name in sorted(arrows):
        visit(name, ())
    return found


def level(name: str, prefix: str, levels: tuple[tuple[str, ...], ...]) -> int:
    """Place of a module among levels, by the first part of its name below `prefix`."""
    part = name.removeprefix(prefix).lstrip(".").split(".")[0]
    return next(k for k, parts in enumerate(levels) if part in parts)


def upward(prefix: str, levels: tuple[tuple[str, ...], ...], names: dict[str, Path]) -> list[str]:
    """Arrows from a module below `prefix` to one of a higher level, or of another folder of its own."""
    found = []
    for name in names:
        for other in package_arrows()[name] & set(names):
            mine, theirs = level(name, prefix, levels), level(other, prefix, levels)
            here, there = (n.removeprefix(prefix).lstrip(".").split(".")[0] for n in (name, other))
            if theirs > mine or (theirs == mine and here != there and "" not in (here, there)):
                found.append(f"{name} -> {other}")
    return found


def below(prefix: str) -> dict[str, Path]:
    """The modules of one folder, its own `__init__` aside."""
    return {name: path for name, path in PACKAGE.items() if name.startswith(prefix + ".")}


def test_eleven_levels_at_most():
    assert len(LEVELS) <= 11


def test_no_circles():
    assert not circles(package_arrows())


def test_a_circle_would_be_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == [("a", "b", "c")]


def test_an_import_by_a_string_is_an_arrow(tmp_path):
    path = tmp_path / "a.py"
    known = {name: path for name in ("p.a", "p.b", "p.c.d", "p.c.e")}
    path.write_text("import importlib\nimportlib.import_module('p.b')\nf = lambda: import_module(x, 'p.a')\n")
    assert list(imports("p.a", path, known)) == ["p.b"]
    calls = "import_module(f'p.c.{x}'), import_module(f'{x}.p.c'), import_module(f'p.{x}')"
    path.write_text(f"f = lambda: ({calls})\n")
    assert list(imports("p.a", path, known)) == ["p.c.d", "p.c.e"]


def test_arrows_point_down():
    assert not upward("warpchain", LEVELS, PACKAGE)


def test_arrows_point_down_among_the_kernels():
    names = {name: path for name, path in KERNEL_MODULES.items() if name != "warpchain.kernels"}
    assert not upward("warpchain.kernels", KERNEL_LEVELS, names)
    assert not [name for name in KERNEL_MODULES if package_arrows()[name] & set(PACKAGE)]


def test_arrows_point_down_in_a_study():
    assert not upward("warpchain.study", STUDY_LEVELS, below("warpchain.study"))


def test_only_the_engine_calls_kernels():
    users = {name.split(".")[1] for name in PACKAGE if package_arrows()[name] & set(KERNEL_MODULES)}
    assert users == {"engine"}


@pytest.mark.parametrize("path", [*PACKAGE.values(), *KERNEL_MODULES.values()], ids=lambda path: path.stem)
def test_kernels_are_imported_through_the_package(path):
    nodes = list(ast.walk(ast.parse(path.read_text())))
    named = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    named += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
    assert not [name for name in named if name.split(".")[0] == "kernels"]


@pytest.mark.parametrize("layer", WITHOUT_WARP)
def test_a_layer_loads_without_warp(layer):
    names = " ".join(below(f"warpchain.{layer}"))
    code = f"import sys, importlib\nfor name in {names!r}.split(): importlib.import_module(name)\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert f"warpchain.{layer}" in done.stdout.split()
    assert "warp" not in done.stdout.split()


def test_the_status_of_a_study_loads_without_warp(tmp_path):
    code = (
        "import sys\nfrom warpchain.cli import main\n"
        "sys.argv = ['warpchain', 'study', 'status', sys.argv[1]]\nstatus = main()\n"
        "print(status, 'warp' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "none")], capture_output=True, text=True)
    assert done.stdout.split() == ["2", "False"], done.stderr
