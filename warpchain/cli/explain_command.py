"""The command `warpchain explain`: what metrics, keys of files and limits mean."""

from __future__ import annotations

import re
from collections.abc import Iterator

from warpchain.errors import WarpchainError


def explanation_lines(text: str) -> list[str]:
    """Lines on what a text names: one metric, key or limit, or those in an error's line.

    Raises:
        WarpchainError: a text that names none.
    """
    from warpchain.drive.schema import nearest_key_text
    from warpchain.results.judgement import LIMIT_RULES
    from warpchain.results.metric_columns import COLUMN_BY_NAME

    names = list(dict.fromkeys(re.findall(r"\w[\w.]*\w|\w", text)))
    if len(names) > 1:  # of a sentence, only what cannot be a word of it
        names = [name for name in names if re.search(r"\w[._]\w", name)]
    lines = [line for name in names for line in _name_lines(name)]
    lines += [f"limit {rule.key}: {rule.advice}" for rule in LIMIT_RULES if rule.key in names or (rule.advice in text)]
    if not lines:
        nearest = nearest_key_text(text, COLUMN_BY_NAME, 12)
        raise WarpchainError(f"explain: {text!r} names no metric, key of a file or limit; {nearest}")
    return lines


def _name_lines(name: str) -> Iterator[str]:
    """Lines on a name as a metric, and as a key, bare or after those of the tables above it."""
    from warpchain.results.metric_columns import column_of_metric

    if column := column_of_metric(name):
        yield f"metric {name} [{column.unit}]: {column.title}"
    key = name.rsplit(".", 1)[-1]
    for text, tables in _tables_by_description(key).items():
        yield f"key {key} of {', '.join(tables)}: {text}"


def _tables_by_description(key: str) -> dict[str, list[str]]:
    """Descriptions of a key of drive and study files, each with the kinds of tables that it is for."""
    from warpchain.drive.json_schema import drive_schema
    from warpchain.study.spec import study_schema

    found: dict[str, list[str]] = {}
    kinds = {kind: table for schema in (drive_schema(), study_schema()) for kind, table in schema["$defs"].items()}
    for kind, table in kinds.items():
        if key in table.get("properties", {}):
            found.setdefault(table["properties"][key]["description"], []).append(kind)
    return found
