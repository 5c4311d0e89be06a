"""Writes the tables of channels, of metrics and of limits into the documents, from the tables in the package.

    python scripts/docs_tables.py            # writes docs/archive.md, metrics.md, judged-runs.md anew
    python scripts/docs_tables.py --check    # only looks whether they are up to date; status 1 if not

Each stands between `<!-- NAME: scripts/docs_tables.py -->` and `<!-- end -->`.
"""

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from warpchain.results.channels import CHANNELS, OF_BODIES, Channel
from warpchain.results.judgement import RULES, Limits
from warpchain.results.metric_columns import (
    BALANCE,
    DESIGN,
    ENGAGED,
    JOINTS,
    MEASURED,
    RECORDED,
    REPORTED,
    RUN,
    SETTLING,
    STEADY,
    Group,
)

DOCS = Path(__file__).resolve().parents[1] / "docs"
OF = {
    "chain": "",
    "strand": "STRAND.",
    "sprocket": "SPROCKET.",
    "partner": "PART.",
    "arm": "ARM.",
    "tensioner": "TENSIONER.",
    "probe": "PROBE.",
}


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def place(channel: Channel) -> str:
    """Where an archive has a channel."""
    if channel in OF_BODIES:
        count = {"sprocket": "S", "arm": "A", "tensioner": "T"}[channel.per]
        count = f"2 {count}" if channel.components else count
        return f"`State.{channel.name}` ({OF_BODIES.index(channel) + 2}), {count} doubles"
    return ", ".join(f"`{field}`" for field in channel.fields) + " of a packed roller"


def channels() -> str:
    """The table of channels."""
    rows = [(f"`{c.name}`", c.unit, c.per, place(c), c.description + "; on request" * c.on_request) for c in CHANNELS]
    return table(("channel", "unit", "of each", "where", "what it is"), rows)


def metrics(groups: Iterable[Group]) -> str:
    """The table of some metrics; what several kinds of things have stands once."""
    names: dict[tuple[str, str], list[str]] = {}
    for group in groups:
        for column in group.columns:
            names.setdefault((column.title, column.unit), []).append(f"`{OF[group.of]}{column.name}`")
    rows = [(", ".join(sorted(set(held), key=len)), unit, title) for (title, unit), held in names.items()]
    return table(("column", "unit", "what it is"), rows)


def limits() -> str:
    """The table of what variants are judged by."""
    default = Limits()
    rows = [
        (
            f"`{rule.key}`",
            f"{'at least' if rule.least else 'at most'} {getattr(default, rule.key):g} {rule.unit}",
            f"`{rule.where}`",
            rule.advice,
        )
        for rule in RULES
    ]
    layout = f"at most {default.layout:g} findings"
    rows.append(("`layout`", layout, "[the layout](#the-layout)", "what the finding says"))
    return table(("limit", "default", "of the metrics", "what to change"), rows)


def tables() -> dict[str, str]:
    """Every table by the name that its place in the documents has."""
    return {
        "channels": channels(),
        "run": metrics((RUN, SETTLING, ENGAGED)),
        "limits": limits(),
        "measured": metrics(group for groups in MEASURED for group in groups if group is not JOINTS),
        "steady": metrics((STEADY,)),
        "balance": metrics((BALANCE, JOINTS)),
        "design": metrics(group for groups in DESIGN for group in groups),
        "recorded": metrics(RECORDED),
        "handed_in": metrics(REPORTED),
    }


def renewed(text: str) -> str:
    """A document with its tables written anew."""
    for name, lines in tables().items():
        begin = f"<!-- {name}: scripts/docs_tables.py -->"
        text = re.sub(rf"{re.escape(begin)}\n.*?<!-- end -->", f"{begin}\n{lines}\n<!-- end -->", text, flags=re.S)
    return text


def parser() -> argparse.ArgumentParser:
    """The command line."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--check", action="store_true", help="write nothing, tell which documents are out of date")
    return words


def main(words: Sequence[str] | None = None) -> int:
    """Writes or checks the documents; returns the exit status."""
    check = parser().parse_args(words).check
    stale = 0
    for path in (DOCS / "archive.md", DOCS / "metrics.md", DOCS / "judged-runs.md"):
        text = path.read_text()
        if renewed(text) != text:
            stale += 1
            print(f"{path.relative_to(DOCS.parent)}: {'out of date' if check else 'written'}")
            if not check:
                path.write_text(renewed(text))
    return int(check and stale > 0)


if __name__ == "__main__":
    sys.exit(main())
