"""The table of metrics: one row a variant, from what the kernels added up over the window.

Which columns there are, and how each is formed, stands in the registry (`results.columns`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive import Drive
from warpchain.results.columns import BALANCE, DESIGN, MEASURED, column_of, of_drive, unit_of
from warpchain.results.formulas import Balance, Judged, Summed
from warpchain.results.schedule import Schedule

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]


def measured_row(drive: Drive, sums: dict[str, Any], duration: float) -> Row:
    """What the sums of one variant give; `duration` is the window's length [s]."""
    row: Row = {}
    for prefix, index, group in of_drive(drive, MEASURED):
        mine = np.atleast_1d(sums[group.source])[index]
        summed = Summed(mine, group.weight(mine, duration, drive.chain.links))
        if summed.weight:
            row |= {prefix + column.name: column.value(summed) for column in group.columns if column.value}
    return row


def energy_balance(drive: Drive, sums: dict[str, Any]) -> Balance:
    """Work done and energy gone over the window.

    What prescribes angles and centers does the input work; the loads take the output work.
    """
    chain, sprockets, mounts = sums["chain"], sums["sprocket"], sums["mount"]
    driven = np.array([s.prescribed is not None for s in drive.sprockets])
    dissipated = float(chain["dissipated"]) + float(sums["contact"]["dissipated"].sum())
    return Balance(
        input=float(mounts["work"].sum()) - float(sprockets["contact_work"][driven].sum()),
        output=-float(sprockets["load_work"][~driven].sum()),
        links=chain["dissipated"],
        dissipated=dissipated + float(mounts["dissipated"].sum()),
        change=float(chain["energy_end"] - chain["energy_start"]),
    )


def design_row(drive: Drive, metrics: Row) -> Row:
    """What designs are judged by, from the other metrics of a variant.

    What needs turning sprockets is left out where they stand still.
    """
    row: Row = {}
    for prefix, index, group in of_drive(drive, DESIGN):
        judged = Judged(drive, metrics, prefix, index)
        values = {prefix + column.name: column.value(judged) for column in group.columns if column.value}
        row |= {name: value for name, value in values.items() if value is not None}
    return row


def row_of(drive: Drive, schedule: Schedule, sums: dict[str, Any], steps: int, diverged: bool) -> Row:
    """One variant's metrics.

    Args:
        sums: "chain", "strand", "sprocket", "mount" and "contact" sums of this variant alone.
        steps: the step that the variant came to.
    """
    row: Row = {"diverged": diverged, "diverged_time": steps * schedule.step if diverged else None}
    row |= {"window_start": schedule.window_start * schedule.step, "window_end": schedule.window_end * schedule.step}
    if steps <= schedule.window_end or diverged:
        return row
    row |= measured_row(drive, sums, (schedule.window_end - schedule.window_start) * schedule.step)
    balance = energy_balance(drive, sums)
    row |= {column.name: column.value(balance) for column in BALANCE.columns if column.value}
    return row | design_row(drive, row)


def table_of(rows: Sequence[Row]) -> pa.Table:
    """A pyarrow table of rows; a column that a row lacks is null there, and its field says its unit."""
    import pyarrow as pa

    kinds = {float: pa.float64(), int: pa.int64(), bool: pa.bool_()}
    names: dict[str, None] = {"variant": None}
    for row in rows:
        names |= dict.fromkeys(row)
    columns, fields = [], []
    for name in names:
        values = range(len(rows)) if name == "variant" else [row.get(name) for row in rows]
        known = column_of(name)
        kind = kinds[known.kind if known else float]
        columns.append(pa.array(values, kind))
        fields.append(pa.field(name, kind, metadata={"unit": unit_of(name)}))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))
