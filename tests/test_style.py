"""House rules that a machine can hold: a light command line, functions that a reader holds in the head."""

import ast
import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import warpchain

HEAVY = ("warp", "rerun", "matplotlib", "pyarrow", "numpy", "pydantic", "mcap", "scipy")
ROOT = Path(__file__).resolve().parent.parent
SOURCES = [
    path for folder in ("warpchain", "kernels", "scripts") for path in sorted((ROOT / folder).glob("**/*.py"))
    if not path.is_relative_to(ROOT / "warpchain" / "kernels")
]  # fmt: skip
MOST_LINES, MOST_ARGUMENTS = 80, 8
LARGE = {
    # public calls whose arguments are named: each is an option that users set, and is described there
    ("warpchain/engine/simulation.py", "simulate"),
    ("warpchain/engine/stepping.py", "stepping"),
    ("warpchain/study/run/runner.py", "run_study"),
    ("warpchain/view/rerun/run_playback.py", "view"),
}
MOST_WITH_NESTED = 200
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
BANNED = [
    "abreast", "courses", "crewed", "foresee", "heft", "hefts", "hurry", "look_around", "looks", "meet", "meets",
    "nudge", "roomy", "soon", "spin", "spins", "stood", "tell", "told", "touched", "used_up", "weigh",
]  # fmt: skip
"""Words that say less than the field's own terms do."""


def children_time():
    """Processor time of the processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_help_is_quick_and_loads_nothing_heavy():
    command = [sys.executable, "-X", "importtime", "-m", "warpchain", "--help"]
    took = []
    for _ in range(3):  # the first may have to compile what it imports
        begin = children_time()
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        took.append(children_time() - begin)
    assert min(took) < 0.5  # 0.1 s here; of the processor's time, as the machine may be busy
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


def lines(node: ast.AST) -> int:
    """Lines from a definition's first decorator to its end."""
    return node.end_lineno - min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)]) + 1


def within(node: ast.AST) -> Iterator[ast.AST]:
    """The functions and classes defined in a node, but not those in them."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (*FUNCTIONS, ast.ClassDef)):
            yield child
        else:
            yield from within(child)


def large(source: str) -> Iterator[tuple[str, int, int]]:
    """Functions with too many lines of their own or too many arguments beside self: name, lines, arguments."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, FUNCTIONS):
            own = lines(node) - sum(map(lines, within(node)))
            taken = node.args
            named = [argument.arg for argument in (*taken.posonlyargs, *taken.args, *taken.kwonlyargs)]
            count = len([name for name in named if name not in ("self", "cls")])
            count += sum(rest is not None for rest in (taken.vararg, taken.kwarg))
            if own > MOST_LINES or count > MOST_ARGUMENTS:
                yield node.name, own, count


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_functions_are_short(path):
    name = str(path.relative_to(ROOT))
    assert not [found for found in large(path.read_text()) if (name, found[0]) not in LARGE]


def test_what_is_excused_is_large():
    for name, function in LARGE:
        assert function in [found[0] for found in large((ROOT / name).read_text())]


def test_large_functions_would_be_found():
    body = "\n".join(f"    x{k} = {k}" for k in range(79))
    assert not list(large(f"def f():\n{body}"))
    assert list(large(f"def f():\n{body}\n    y = 1")) == [("f", 81, 0)]
    assert list(large(f"@g\ndef f():\n{body}")) == [("f", 81, 0)]
    inner = "\n".join(f"    {line}" for line in f"def g():\n{body}".splitlines())
    assert not list(large(f"def f():\n{inner}\n    return g"))
    assert list(large(f"class A:\n{inner}\n        y = 1")) == [("g", 81, 0)]
    assert not list(large("def f(self, a, b, c, d, e, f, g, h): pass"))
    assert list(large("def f(a, b, /, c, d, e, f, *g, h, i): pass")) == [("f", 1, 9)]
    assert list(large("async def f(a, b, c, d, e, f, g, h, **i): pass")) == [("f", 1, 9)]


def with_nested(source: str) -> Iterator[tuple[str, int]]:
    """Functions with too many lines, nested functions counted in: name, lines."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, FUNCTIONS) and lines(node) > MOST_WITH_NESTED:
            yield node.name, lines(node)


def test_functions_are_short_with_those_in_them():
    assert not [(path, name) for path in SOURCES for name, _ in with_nested(path.read_text())]


def test_functions_long_by_nested_ones_would_be_found():
    inner = "\n".join(f"    def g{k}():\n        return {k}\n" for k in range(67))
    assert list(with_nested(f"def f():\n{inner}")) == [("f", 201)]
    assert not list(with_nested(f"class A:\n{inner}"))


def named(tree: ast.AST) -> Iterator[str]:
    """The names that a module gives: to functions, classes, arguments, variables and fields."""
    for node in ast.walk(tree):
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def first_lines(tree: ast.AST) -> Iterator[str]:
    """The first line of each docstring."""
    for node in ast.walk(tree):
        if isinstance(node, (*FUNCTIONS, ast.ClassDef, ast.Module)) and (text := ast.get_docstring(node)):
            yield text.split("\n")[0]


def banned(text: str) -> bool:
    """Whether a name or a line has a banned word, whole or as a part of a name."""
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+", text)
    return not {part.lower() for part in (*parts, *re.findall(r"\w+", text))}.isdisjoint(BANNED)


def words_left(source: str) -> tuple[int, int, int]:
    """Names of a module with banned words, first lines of docstrings with them, and such lines that are questions."""
    tree = ast.parse(source)
    openings = list(first_lines(tree))
    questions = sum(line.startswith(("What ", "How ")) for line in openings)
    return sum(map(banned, named(tree))), sum(map(banned, openings)), questions


def test_plain_words():
    assert not [path for path in SOURCES if any(words_left(path.read_text()))]


def test_banned_words_would_be_found():
    assert all(map(banned, ("heft", "SpinSums", "heft_of", "used_up", "They meet here.", "Tell.")))
    assert not any(map(banned, ("theft", "spinner", "meeting", "used", "up", "A course.")))
    source = '"""How far.\n\nWhat."""\nclass Heft:\n    """What looks."""\n    soon: int\n    x: int = meet\n'
    assert words_left(source + "def f(told): f.stood = told.spin") == (4, 1, 2)
