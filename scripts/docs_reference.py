"""Pages of reference, made of the code's own tables and docstrings: keys of files, metrics, command line, Python.

`build_docs.py` puts them on the site; the others of the documents are written by hand.

    python scripts/docs_reference.py [FOLDER]      # writes the pages as Markdown
"""

import argparse
import inspect
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

from docs_tables import OF, table

import warpchain
from warpchain.cli.parser import parser as command_line
from warpchain.drive import Drive
from warpchain.drive.contact_settings import GuideContact, GuideOverrides
from warpchain.drive.schema import Part, allowed
from warpchain.results.channels import CHANNELS
from warpchain.results.metric_columns import COLUMNS, METRICS, RECORDED, RUN
from warpchain.results.units import DISPLAYED
from warpchain.study.spec.study_file import Study

MODULES = {
    "drives and files": (
        "warpchain.drive.drive",
        "warpchain.drive.chain",
        "warpchain.drive.sprocket",
        "warpchain.drive.run_settings",
        "warpchain.drive.contact_settings",
    ),
    "before a run": (
        "warpchain.assembly.summary",
        "warpchain.assembly.layout_checks",
        "warpchain.assembly.statics",
        "warpchain.assembly.fitting",
        "warpchain.assembly.frequencies",
    ),
    "results": (
        "warpchain.results.run",
        "warpchain.results.signals",
        "warpchain.results.losses",
        "warpchain.results.objectives",
        "warpchain.results.judgement",
        "warpchain.results.measured",
        "warpchain.results.measured_file",
        "warpchain.results.units",
    ),
    "archives": ("warpchain.archive.read", "warpchain.archive.writer", "warpchain.archive.export"),
    "pictures": (
        "warpchain.view.rerun.run_playback",
        "warpchain.view.figures.plot",
        "warpchain.view.figures.sweep",
        "warpchain.view.figures.rig_figures",
        "warpchain.view.palette",
    ),
    "modes": ("warpchain.modal.eigenmodes", "warpchain.modal.campbell"),
    "studies": (
        "warpchain.study.run.runner",
        "warpchain.study.results",
        "warpchain.study.analysis.effects",
        "warpchain.study.analysis.sensitivity",
        "warpchain.study.analysis.pareto",
        "warpchain.study.analysis.surface",
    ),
}
"""Modules that users call beyond `warpchain` itself, by page."""


def attributes(kind: type) -> dict[str, str]:
    """What the docstrings of a class and its bases say of its attributes, by name."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__doc__ or "")
        head = re.search(r"^Attributes:\n", text, re.MULTILINE)
        if head is None:
            continue
        indent = "    "
        names: list[str] = []
        for line in text[head.end() :].splitlines():
            if line.strip() and not line.startswith(indent):
                break
            entry = re.match(rf"{indent}([A-Za-z_][\w, ]*): (.*)", line)
            if entry and not line.startswith(indent + " "):
                names = [name.strip() for name in entry[1].split(",")]
                found |= dict.fromkeys(names, entry[2].strip())
            elif line.strip():
                for name in names:
                    found[name] += " " + line.strip()
    return found


def parts_in(annotation: Any) -> Iterator[type[Part]]:
    """The parts that a field's annotation holds, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, Part):
        yield annotation
    for inner in get_args(annotation):
        yield from parts_in(inner)


def sections(top: type[Part]) -> dict[type[Part], list[str]]:
    """Every part of a file with the places at which it stands, such as `[[sprockets]]`, in the file's order."""
    found: dict[type[Part], list[str]] = {top: [""]}

    def visit(kind: type[Part], path: str) -> None:
        for key, field in kind.model_fields.items():
            many = "tuple[" in str(field.annotation)
            place = f"{path}.{key}" if path else key
            for inner in dict.fromkeys(parts_in(field.annotation)):
                word = f"[[{place}]]" if many else f"[{place}]"
                fresh = inner not in found
                if word not in found.setdefault(inner, []):
                    found[inner].append(word)
                if fresh:
                    visit(inner, place)

    visit(top, "")
    return found


def key_rows(kind: type[Part]) -> list[tuple[str, str, str, str]]:
    """Of each key of a part: name, what is allowed, default, what it is."""
    said = {"kind": "which one of these it is."}
    if kind is GuideOverrides:  # its keys are those of what it overrides
        said |= attributes(GuideContact)
    said |= attributes(kind)
    rows = []
    for key, field in kind.model_fields.items():
        default = "needed" if field.is_required() else _default(field.get_default(call_default_factory=True))
        rows.append((f"`{key}`", allowed(kind, key).removeprefix("must be "), default, said.get(key, "")))
    return rows


def _default(value: Any) -> str:
    if value is None or value == ():
        return ""
    if isinstance(value, Part):
        return f"a `{type(value).__name__}`"
    return f"`{str(value).lower()}`" if isinstance(value, bool) else f"`{value}`"


def escaped(cell: str) -> str:
    """A cell whose signs mean nothing in a table."""
    return cell.replace("|", "\\|").replace("<", "&lt;").replace("->", "-&gt;")


def keys_page(top: type[Part], title: str, more: str) -> str:
    """The reference of a file's keys."""
    lines = [f"# {title}", "", more, ""]
    for kind, places in sections(top).items():
        head = (kind.__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
        lines += [f"## {kind.__name__}", "", re.sub(r"\s+", " ", head), ""]
        if any(places):
            lines += ["At " + ", ".join(f"`{place}`" for place in places if place) + ".", ""]
        rows = [tuple(map(escaped, row)) for row in key_rows(kind)]
        lines += [table(("key", "allowed", "default", "what it is"), rows) if rows else "No keys.", ""]
    return "\n".join(lines)


def metrics_page() -> str:
    """Every metric, channel and unit, in the order of their names."""
    owners: dict[str, set[str]] = {}
    for group in (group for groups in (*METRICS, (RUN,), RECORDED) for group in groups):
        for column in group.columns:
            owners.setdefault(column.name, set()).add(OF[group.of])
    rows = [
        (
            ", ".join(f"`{of}{name}`" for of in sorted(owners.get(name, {"modes.NAME."}))),
            column.unit,
            column.title + ("; studies analyze it where it is named" if column.aside else ""),
        )
        for name, column in sorted(COLUMNS.items())
    ]
    held = [(f"`{c.name}`", c.unit, c.per, c.description) for c in CHANNELS]
    shown = [(unit, ", ".join(word for _, word, _ in steps)) for unit, steps in DISPLAYED.items()]
    return "\n\n".join(
        [
            "# Every metric and channel",
            "By name; [the metrics](../metrics.md) tells how they come about. STRAND, SPROCKET, PART are names.",
            "## Metrics",
            table(("column", "unit", "what it is"), [tuple(map(escaped, row)) for row in rows]),
            "## Channels",
            table(("channel", "unit", "of each", "what it is"), held),
            "## Units that figures show",
            table(("SI", "shown, by size"), shown),
        ]
    )


def commands_page() -> str:
    """The command line's own help."""
    lines = ["# The command line", "", "What `warpchain COMMAND --help` prints.", ""]

    def visit(parser: argparse.ArgumentParser, level: int) -> None:
        parser.formatter_class = lambda prog: argparse.RawDescriptionHelpFormatter(prog, width=100)
        lines.extend([f"{'#' * level} {parser.prog}", "", "```text", parser.format_help().rstrip(), "```", ""])
        for action in parser._actions:
            if isinstance(action.choices, dict):
                for inner in action.choices.values():
                    visit(inner, level + 1)

    visit(command_line(), 2)
    return "\n".join(lines)


def home(name: str) -> str:
    """The full name of one of `warpchain`'s own."""
    thing = getattr(warpchain, name)
    return f"{thing.__module__}.{thing.__qualname__}"


def python_pages() -> dict[str, str]:
    """Pages that mkdocstrings fills from the docstrings: `warpchain` itself, and the modules of `MODULES`."""
    names = [name for name in warpchain.__all__ if not name.startswith("__")]
    first = ["# warpchain", "", "What `import warpchain` gives.", ""]
    first += [f"::: {home(name)}\n" for name in names]
    found = {"warpchain": "\n".join(first)}
    for title, modules in MODULES.items():
        lines = [f"# {title.capitalize()}", ""]
        found[title.replace(" ", "-")] = "\n".join([*lines, *(f"::: {module}\n" for module in modules)])
    return found


def pages() -> dict[str, str]:
    """Every page of reference by its path below `reference`."""
    held = {
        "drive-keys.md": keys_page(
            Drive,
            "Keys of drive files",
            "Every table and key of a [drive file](../drive-file.md), from the code itself.",
        ),
        "study-keys.md": keys_page(
            Study, "Keys of study files", "Every table and key of a [study file](../studies.md), from the code itself."
        ),
        "metrics.md": metrics_page(),
        "commands.md": commands_page(),
    }
    return held | {f"python/{name}.md": text for name, text in python_pages().items()}


def undescribed() -> Iterable[str]:
    """Keys that no docstring describes; there should be none."""
    for top in (Drive, Study):
        for kind in sections(top):
            yield from (f"{kind.__name__}.{row[0].strip('`')}" for row in key_rows(kind) if not row[3])


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("folder", nargs="?", type=Path, default=Path("out/reference"), help="default out/reference")
    return made


def main() -> None:
    """Writes the pages."""
    folder = parser().parse_args().folder
    for name, text in pages().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
        print(path)


if __name__ == "__main__":
    main()
