"""The command `warpchain explain`: what metrics, columns, keys of files, limits and findings of `check` mean."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterator
from functools import cache
from typing import Any

from warpchain.errors import WarpchainError

COLUMNS = {
    "adjusted_links": "number of links that a study's [adjust] chose for the row",
    "adjusted_travel": "way [m] that a study's [adjust] moved its sprocket along its direction",
}
"""Meanings of study tables' columns that are no metrics."""
FINDINGS = {
    "LOOK AT": "a rule of thumb that the drive breaks; it runs, but look at what the line says (docs/check.md)",
    "LAYOUT": "a fault of the layout; it runs, but the run is suspect, as no step is small enough for it",
    "degrees of wrap": "with less wrap fewer teeth bear the moment, and the chain jumps sooner",
    "teeth in mesh": "on fewer than 3 teeth rollers hammer an idler one by one: noise and wear",
    "misses the chain": "a bar more than half a pitch off its strand guides nothing unless the strand swings",
    ": dents": "a bar far inside its strand's line bends the chain sharply at its ends, which bear hard",
    "the chain runs off": "the rounded end of a face has a small radius, and the load on it is the tension over that",
    "never touches the chain": "a face that the chain never reaches guides nothing unless the strand swings",
    "as it would without a chain": "an arm at its free angle presses on nothing and takes up no slack",
    "stands open at rest": "a relief valve that is open at rest lets oil out all the time",
    "and the pressure falls from": "a vent this wide takes most of the pressure that the supply gives",
    "oil does not carry the plunger": "a drained chamber is still filling when the run ends",
    "the pressure jumps as the run begins": "the drive is put at rest with `supply`, and the table begins elsewhere",
    "is a safety of": "the chain's strength over its tension, vibration left out; links that yield stay longer",
    "that it is rated for": "beyond the rated power a chain wears out or tires in less than its rated life",
    "so that it can be moved by": "a strand this slack swings, wraps badly and jumps teeth",
    "chains break at about": "an elongation of about 1 % is that at the breaking load",
    "the largest step that keeps 1 %": "a larger step is stable up to its limit, but less accurate (docs/steps.md)",
    "it does not start": "the motors' moment at rest is below that of the loads at rest",
    "no load balances it": "without a load that grows, or a moment that falls with speed, the motor speeds up for ever",
    "nothing ties this shaft": "valves on a shaft of its own are moved by nothing",
}
"""Meanings of lines of `check`, by words that only they have."""


def explain_lines(arguments: Namespace) -> list[str]:
    """Lines on what a text names: a metric, column, key or limit, or those in a line of an error or of `check`.

    Raises:
        WarpchainError: a text that names none.
    """
    from warpchain.drive.schema import nearest_key_text
    from warpchain.results.judgement import LIMIT_RULES
    from warpchain.results.metric_columns import COLUMN_BY_NAME

    text = arguments.text
    names = list(dict.fromkeys(re.findall(r"\w[\w.]*\w|\w", text)))
    if len(names) > 1:  # of a sentence, only what cannot be a word of it
        names = [name for name in names if re.search(r"\w[._]\w", name)]
    lines = [line for name in names for line in _name_lines(name)]
    found = [(words, meaning) for words, meaning in FINDINGS.items() if words in text]
    lines += [f"finding {words.strip(': ')!r}: {meaning}" for words, meaning in found]
    lines += [f"limit {rule.key}: {rule.advice}" for rule in LIMIT_RULES if rule.key in names or (rule.advice in text)]
    if not lines:
        nearest = nearest_key_text(text, COLUMN_BY_NAME, 12)
        raise WarpchainError(f"explain: {text!r} names no metric, key of a file, limit or finding; {nearest}")
    return lines


def _name_lines(name: str) -> Iterator[str]:
    """Lines that explain a name as metric, column and key."""
    from warpchain.results.metric_columns import column_of_metric

    if column := column_of_metric(name):
        yield f"metric {name} [{column.unit}]: {column.title}"
    key = name.rsplit(".", 1)[-1]
    if key in COLUMNS:
        yield f"column {name}: {COLUMNS[key]}"
    for text, tables in _tables_by_description(key).items():
        yield f"key {key} of {', '.join(tables)}: {text}"


def _tables_by_description(key: str) -> dict[str, list[str]]:
    """Tables of drive and study files that have a key to explain, by its description."""
    found: dict[str, list[str]] = {}
    for kind, table in _table_schemas().items():
        if key in table.get("properties", {}):
            found.setdefault(table["properties"][key]["description"], []).append(kind)
    return found


@cache
def _table_schemas() -> dict[str, Any]:
    """JSON schemas of drive and study files' tables to explain, by kind."""
    from warpchain.drive.json_schema import drive_schema
    from warpchain.study.spec import study_schema

    return {kind: table for schema in (drive_schema(), study_schema()) for kind, table in schema["$defs"].items()}
