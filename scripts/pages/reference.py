"""Pages of reference, made of the code's own tables and docstrings: keys of files, command line, Python."""

import argparse
import re
from collections.abc import Iterator
from typing import Any, get_args

import warpchain
from pages.tables import markdown_table, output_table
from warpchain.cli.output_schema import described_values, output_schema
from warpchain.cli.parser import command_line_parser as command_line
from warpchain.drive import Drive
from warpchain.drive.json_schema import drive_schema, schema_text
from warpchain.drive.quantities import attribute_descriptions
from warpchain.drive.schema import Part, allowed_text
from warpchain.study.spec.study_file import Study, study_schema

MODULES = {
    "drives and files": "drive: drive chain sprocket run_settings contact_settings",
    "before a run": "assembly: summary layout_checks statics fitting frequencies",
    "results": "results: run signals losses objectives judgement measured measured_file measured_columns units",
    "archives": "archive: read writer export",
    "pictures": "view: rerun.run_playback figures.plot figures.sweep figures.rig_figures palette",
    "modes": "modal: eigenmodes campbell",
    "studies": "study: run.runner results analysis.effects analysis.sensitivity analysis.pareto analysis.surface",
}
"""Packages and their modules that users call beyond `warpchain` itself, by page."""


def annotation_parts(annotation: Any) -> Iterator[type[Part]]:
    """The parts that a field's annotation holds, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, Part):
        yield annotation
    for inner in get_args(annotation):
        yield from annotation_parts(inner)


def file_sections(top: type[Part]) -> dict[type[Part], list[str]]:
    """Every part of a file with the places at which it stands, such as `[[sprockets]]`, in the file's order."""
    found: dict[type[Part], list[str]] = {top: [""]}

    def add_parts(kind: type[Part], path: str) -> None:
        """Adds the parts in a part's fields, and those within."""
        for key, field in kind.model_fields.items():
            many = "tuple[" in str(field.annotation)
            place = f"{path}.{key}" if path else key
            for inner in dict.fromkeys(annotation_parts(field.annotation)):
                word = f"[[{place}]]" if many else f"[{place}]"
                fresh = inner not in found
                if word not in found.setdefault(inner, []):
                    found[inner].append(word)
                if fresh:
                    add_parts(inner, place)

    add_parts(top, "")
    return found


def key_rows(kind: type[Part]) -> list[tuple[str, str, str, str]]:
    """Name, allowed values, default and description of each key of a part."""
    said = {"kind": "which one of these it is."} | attribute_descriptions(kind)
    rows = []
    for key, field in kind.model_fields.items():
        default = "needed" if field.is_required() else default_text(field.get_default(call_default_factory=True))
        if key in getattr(kind, "_filled", ()):
            default = "needed without `size`"
        rows.append((f"`{key}`", allowed_text(kind, key).removeprefix("must be "), default, said.get(key, "")))
    return rows


def default_text(value: Any) -> str:
    """Words for a default; none for None and empty lists."""
    if value is None or value == ():
        return ""
    if isinstance(value, Part):
        return f"a `{type(value).__name__}`"
    return f"`{str(value).lower()}`" if isinstance(value, bool) else f"`{value}`"


def escaped_cell(cell: str) -> str:
    """A cell whose signs mean nothing in a table."""
    return cell.replace("|", "\\|").replace("<", "&lt;").replace("->", "-&gt;")


def keys_page(top: type[Part], title: str, more: str) -> str:
    """The reference of a file's keys."""
    lines = [f"# {title}", "", more, ""]
    for kind, places in file_sections(top).items():
        head = (kind.__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
        lines += [f"## {kind.__name__}", "", re.sub(r"\s+", " ", head), ""]
        if any(places):
            lines += ["At " + ", ".join(f"`{place}`" for place in places if place) + ".", ""]
        rows = [tuple(map(escaped_cell, row)) for row in key_rows(kind)]
        lines += [markdown_table(("key", "allowed", "default", "what it is"), rows) if rows else "No keys.", ""]
    return "\n".join(lines)


def commands_page() -> str:
    """The command line's own help."""
    lines = ["# The command line", "", "The text of `warpchain COMMAND --help`.", ""]

    def add_help(parser: argparse.ArgumentParser, level: int) -> None:
        """Adds a command's help, and that of the commands below it."""
        parser.formatter_class = lambda prog: argparse.RawDescriptionHelpFormatter(prog, width=100)
        lines.extend([f"{'#' * level} {parser.prog}", "", "```text", parser.format_help().rstrip(), "```", ""])
        for action in parser._actions:
            if isinstance(action.choices, dict):
                for inner in action.choices.values():
                    add_help(inner, level + 1)

    add_help(command_line(), 2)
    return "\n".join(lines)


def output_page() -> str:
    """The keys that `check` and `run` print of a chain with `--json`."""
    one, _ = output_schema()["anyOf"]
    about = (
        "Of a chain, in SI units, as `warpchain check DRIVE --json` prints them; KIND stands for each of the objects "
        "beside it. [JSON for scripts](../scripts.md) has the others; for programs, "
        "[output.schema.json](output.schema.json)."
    )
    return "\n".join(["# Keys of JSON output", "", about, "", output_table(described_values(one))])


def python_pages() -> dict[str, str]:
    """Pages that mkdocstrings fills from the docstrings: `warpchain` itself, and the modules of `MODULES`."""
    things = [getattr(warpchain, name) for name in warpchain.__all__ if not name.startswith("__")]
    held = {"warpchain": [f"{thing.__module__}.{thing.__qualname__}" for thing in things]}
    for title, words in MODULES.items():
        package, _, names = words.partition(": ")
        held[title] = [f"warpchain.{package}.{name}" for name in names.split()]
    return {
        f"python/{title.replace(' ', '-')}.md": "\n\n".join([f"# {title}", *(f"::: {name}" for name in names)])
        for title, names in held.items()
    }


def reference_pages() -> dict[str, str]:
    """Every page of reference, and the schemas, by their paths below `reference`."""
    more = (
        "The classes that hold a [{0} file](../{1}.md), with their fields, from the code itself; for editors as a JSON "
        "schema, [{0}.schema.json]({0}.schema.json)."
    )
    return {
        "drive-keys.md": keys_page(Drive, "Python classes of drive files", more.format("drive", "drive-file")),
        "study-keys.md": keys_page(Study, "Python classes of study files", more.format("study", "studies")),
        "drive.schema.json": schema_text(drive_schema()),
        "study.schema.json": schema_text(study_schema()),
        "output.schema.json": schema_text(output_schema()),
        "output-keys.md": output_page(),
        "commands.md": commands_page(),
        **python_pages(),
    }
