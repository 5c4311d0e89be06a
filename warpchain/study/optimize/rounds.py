"""The rounds of a folder, and their rows as one table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.results.replaced import with_column
from warpchain.study.store import read_table

if TYPE_CHECKING:
    import pyarrow as pa

ROUND = "round"
"""Column of the number of a row's round."""


def round_name(number: int) -> str:
    """A round's folder in the search's."""
    return f"rounds/{number:04d}"


def round_file(folder: Path, number: int) -> Path:
    """The rows of a round; it is done when this is there."""
    return folder / round_name(number) / "rows.parquet"


def rounds_done(folder: Path) -> int:
    """How many rounds are done, from the first one on."""
    number = 0
    while round_file(folder, number).exists():
        number += 1
    return number


def together(folder: Path, rounds: int) -> pa.Table:
    """The rows of the first rounds, numbered through, with the number of their round.

    Raises:
        StudyError: a round is missing or damaged.
    """
    import pyarrow as pa

    tables = []
    for number in range(rounds):
        table = read_table(round_file(folder, number))
        tables.append(table.append_column(ROUND, pa.array([number] * table.num_rows, pa.int64())))
    table = pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    facts: dict[str, dict[bytes, bytes]] = {}
    for part in tables:
        for field in part.schema:
            facts[field.name] = facts.get(field.name) or dict(field.metadata or {})
    fields = [field.with_metadata(facts[field.name] or None) for field in table.schema]
    table = pa.Table.from_arrays(table.columns, schema=pa.schema(fields))
    return with_column(table, "variant", range(table.num_rows))
