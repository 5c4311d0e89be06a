"""Tables of the documents made of the package's own."""

import argparse
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from common.cases import ROOT, Line, case, case_option

from warpchain.cli.output_schema import described_values, output_schema
from warpchain.drive.json_schema import drive_schema, schema_text
from warpchain.results.channels import BODY_CHANNELS, CHANNELS, Channel
from warpchain.results.judgement import LIMIT_RULES, Limits
from warpchain.results.metric_columns import (
    BALANCE_METRICS,
    DESIGN_METRICS,
    ENGAGED_METRICS,
    JOINT_METRICS,
    RECORDED_METRICS,
    REPORT_METRICS,
    RUN_METRICS,
    SETTLING_METRICS,
    STEADY_METRICS,
    WINDOW_METRICS,
    MetricGroup,
)
from warpchain.study.spec import study_schema

OF = {
    name: f"{name.upper()}."
    for name in ("strand", "sprocket", "arm", "tensioner", "shaft", "coupling", "gear", "valve", "probe")
} | {
    "chain": "",
    "partner": "PART.",
}
"""Beginning of the columns' names, by their group."""


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def with_unit(names: str, unit: str) -> str:
    """Names with their unit in brackets; ratios, counts and texts have none."""
    return names if unit in ("", "1") else f"{names} [{unit}]"


def archive_place(channel: Channel) -> str:
    """A channel's place in an archive."""
    if channel in BODY_CHANNELS:
        count = {"sprocket": "S", "arm": "A", "tensioner": "T", "shaft": "H", "coupling": "C", "valve": "V"}[
            channel.per
        ]
        count = f"2 {count}" if channel.components else count
        return f"`State.{channel.name}` ({BODY_CHANNELS.index(channel) + 2}), {count} doubles"
    return ", ".join(f"`{field}`" for field in channel.value_names) + " of a packed roller"


def channel_table() -> str:
    """The table of channels."""
    rows = [
        (with_unit(f"`{c.name}`", c.unit), c.per, archive_place(c), c.description + "; on request" * c.on_request)
        for c in CHANNELS
    ]
    return markdown_table(("channel [unit]", "of each", "where", "what it is"), rows)


EXTREMES = ("smallest", "mean", "largest")
"""First words of the titles of columns that stand in one row where there are all three of something."""


def metric_table(groups: Iterable[MetricGroup]) -> str:
    """The table of some metrics; what several kinds of things have stands once, a standard error beside its mean."""
    names: dict[tuple[str, str], list[str]] = {}
    for group in groups:
        titles = {column.name: column.title for column in group.columns}
        for column in group.columns:
            title = titles.get(column.name.removesuffix("_se"), column.title)
            names.setdefault((title, column.unit), []).append(f"`{OF[group.part]}{column.name}`")
    rows = [(with_unit(", ".join(held), unit), title) for title, unit, held in extremes_together(names)]
    return markdown_table(("column [unit]", "what it is"), rows)


def extremes_together(names: Mapping[tuple[str, str], Iterable[str]]) -> Iterator[tuple[str, str, list[str]]]:
    """Title, unit and names of each row; smallest, mean and largest of one quantity are one row."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for title, unit in names:
        first, _, rest = title.partition(" ")
        if first in EXTREMES:
            found.setdefault((rest.split(",")[0], unit), {})[first] = rest
    for (title, unit), held in names.items():
        first, _, rest = title.partition(" ")
        alike = found.get((rest.split(",")[0], unit), {}) if first in EXTREMES else {}
        if len(alike) < len(EXTREMES):
            yield title, unit, sorted(set(held), key=len)
        elif first == EXTREMES[0]:
            every = (sorted(set(names[f"{word} {alike[word]}", unit]), key=len) for word in EXTREMES)
            longest = max(alike.values(), key=len)
            yield f"smallest, mean and largest {longest}", unit, [name for part in every for name in part]


def limit_table() -> str:
    """The table of the limits that variants are judged by."""
    default = Limits()
    rows = []
    for rule in LIMIT_RULES:
        bound = f"{'at least' if rule.is_lower else 'at most'} {getattr(default, rule.key):g} {rule.unit}"
        rows.append((f"`{rule.key}`", bound, f"`{rule.column_name}`", rule.advice))
    layout = f"at most {default.layout:g} findings"
    rows.append(("`layout`", layout, "[the layout](#the-layout)", "what the finding says"))
    return markdown_table(("limit", "default", "of the metrics", "what to change"), rows)


STEADY = "; null without a steady state"
"""End of the descriptions of values at rest and at work, which the page says once."""


def without_repeats(rows: Iterable[tuple[str, str, str]]) -> list[tuple[str, str, str]]:
    """Key, unit and description of values without names of parts; what several objects hold stands once, of a KIND."""
    listed = [row for row in rows if not row[0].endswith("[].name")]
    holders: dict[tuple[str, ...], set[str]] = {}

    def common_values(key: str, unit: str, text: str) -> tuple[str, ...]:
        """Place, name, unit and text of a value without its holder's name."""
        holder, _, leaf = key.rpartition(".")
        return holder.rpartition(".")[0], leaf, unit, text

    for row in listed:
        holders.setdefault(common_values(*row), set()).add(row[0].rpartition(".")[0])
    found: dict[tuple[str, str, str], None] = {}
    for key, unit, text in listed:
        above, leaf, *_ = what = common_values(key, unit, text)
        repeated = above and len(holders[what]) > 1
        found[(f"{above}.KIND.{leaf}" if repeated else key, unit, text)] = None
    return list(found)


def output_tables() -> dict[str, str]:
    """The tables of the keys of `--json`: of each output, of several chains, and of a run."""
    schema = output_schema()
    rows = list(described_values(schema))
    of_run = [row for row in rows if re.split(r"[.\[]", row[0])[0] in schema["dependentRequired"]]
    one, several = (list(described_values(of)) for of in schema["anyOf"])
    parts = {
        "output_head": [row for row in rows if row not in of_run],
        "output_chains": [row for row in several if row not in one],
        "output_run": of_run,
    }
    return {name: output_table(found) for name, found in parts.items()}


def output_table(rows: Iterable[tuple[str, str, str]]) -> str:
    """A table of keys of `--json` from key, unit and description of each."""
    found = [(with_unit(f"`{key}`", unit), text.removesuffix(STEADY)) for key, unit, text in without_repeats(rows)]
    return markdown_table(("key [unit]", "what it is"), found)


def made_tables() -> dict[str, str]:
    """Every table by the name that its place in the documents has."""
    return {
        "channels": channel_table(),
        "run": metric_table((RUN_METRICS, SETTLING_METRICS, ENGAGED_METRICS)),
        "limits": limit_table(),
        "measured": metric_table(group for groups in WINDOW_METRICS for group in groups if group is not JOINT_METRICS),
        "steady": metric_table((STEADY_METRICS,)),
        "balance": metric_table((BALANCE_METRICS, JOINT_METRICS)),
        "design": metric_table(group for groups in DESIGN_METRICS for group in groups),
        "recorded": metric_table(RECORDED_METRICS),
        "engineering_report": metric_table(REPORT_METRICS),
        **output_tables(),
    }


def made_schemas() -> dict[Path, str]:
    """The JSON schemas beside the examples, whose first lines name them."""
    made = {"drive": drive_schema(), "study": study_schema()}
    return {ROOT / f"warpchain/{of}/examples/{of}.schema.json": schema_text(schema) for of, schema in made.items()}


def document_with_tables(text: str) -> str:
    """A document with its tables written anew."""
    made = made_tables()
    mark = r"(<!-- (\w+): scripts/docs.py tables -->\n).*?(\n<!-- end -->)"
    return re.sub(mark, lambda found: found[1] + made[found[2]] + found[3], text, flags=re.DOTALL)


@case(case_option("--check", action="store_true", help="write nothing, name the documents that are out of date"))
def tables(asked: argparse.Namespace) -> Iterator[Line]:
    """Writes what is made of the package: tables of channels, metrics and limits in the documents, examples' schemas.

    python scripts/docs.py tables            # writes docs/archive.md, metrics.md, scripts.md, ..., *.schema.json
    python scripts/docs.py tables --check    # only looks whether they are up to date; status 1 if not

    Each table stands between `<!-- NAME: scripts/docs.py tables -->` and `<!-- end -->`.
    """
    made = {
        path: document_with_tables(path.read_text()) for path in sorted((ROOT / "docs").glob("*.md"))
    } | made_schemas()
    stale = {path: text for path, text in made.items() if not path.exists() or path.read_text() != text}
    for path, text in stale.items():
        yield f"{path.relative_to(ROOT)}: {'out of date' if asked.check else 'written'}"
        if not asked.check:
            path.write_text(text)
    if asked.check and stale:
        raise SystemExit(1)
