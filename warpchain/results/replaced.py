"""Tables of pyarrow with other values in a column."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyarrow as pa


def with_column(table: pa.Table, name: str, values: Iterable[Any]) -> pa.Table:
    """A table with other values, (rows,), in the column of a name; its place, type and facts stay."""
    import pyarrow as pa

    at = table.column_names.index(name)
    field = table.schema.field(at)
    return table.set_column(at, field, pa.array(values, field.type))
