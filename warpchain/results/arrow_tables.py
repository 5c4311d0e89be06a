"""Trajectories and metrics as pyarrow tables and xarray datasets, and tables as files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.errors import StudyError, WarpchainError
from warpchain.extras import require_extra
from warpchain.files import refusals_as_errors, whole_file
from warpchain.model import ChainModel
from warpchain.results.channels import AXIS_LABELS, CHANNEL_BY_NAME, CHANNEL_UNITS

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr

Array = NDArray[np.floating]


def trajectory_table(time: Array, channels: Mapping[str, Array]) -> pa.Table:
    """Pyarrow table of a trajectory, a row a frame."""
    import pyarrow as pa

    columns = {}
    for name, values in {"time": time, **channels}.items():
        column: Any = pa.array(np.ascontiguousarray(values).reshape(-1))
        for size in reversed(values.shape[1:]):
            column = pa.FixedSizeListArray.from_arrays(column, size)
        columns[name] = column
    return table_with_units(columns, CHANNEL_UNITS)


def table_with_units(columns: Mapping[str, pa.Array], units: Mapping[str, str]) -> pa.Table:
    """Pyarrow table of columns, with units in metadata."""
    import pyarrow as pa

    fields = [pa.field(name, column.type, metadata={"unit": units[name]}) for name, column in columns.items()]
    return pa.Table.from_arrays(list(columns.values()), schema=pa.schema(fields))


def trajectory_dataset(time: Array, channels: Mapping[str, Array], parts: Drive | ChainModel) -> xr.Dataset:
    """Xarray dataset of a trajectory, without a copy.

    Raises:
        WarpchainError: xarray is not installed.
    """
    require_extra("xarray", "to_xarray", WarpchainError)
    import xarray as xr

    variables = {}
    for name, values in channels.items():
        facts = {"units": CHANNEL_UNITS[name], "long_name": CHANNEL_BY_NAME[name].description}
        variables[name] = (CHANNEL_BY_NAME[name].dimensions, values, facts)
    labels: dict[str, Any] = {
        "roller": np.arange(parts.links),
        "link": np.arange(parts.links),
        "sprocket": [sprocket.name for sprocket in parts.sprockets],
        "arm": [arm.name for arm in parts.arms],
        "tensioner": [tensioner.name for tensioner in parts.tensioners],
        "shaft": [shaft.name for shaft in parts.shafts],
        "coupling": [coupling.name for coupling in parts.couplings],
        "valve": [valves.name for valves in parts.valves],
        "axis": list(AXIS_LABELS),
    }
    used = {dimension for dimensions, *_ in variables.values() for dimension in dimensions}
    held = {name: values for name, values in labels.items() if name in used}
    return xr.Dataset(variables, {"time": ("time", time, {"units": CHANNEL_UNITS["time"]}), **held})


def table_with_unit_heads(table: pa.Table) -> pa.Table:
    """Pyarrow table with units in column heads: `tension_max [N]`."""
    units = ((field.name, (field.metadata or {}).get(b"unit", b"").decode()) for field in table.schema)
    return table.rename_columns([name if unit in ("", "1") else f"{name} [{unit}]" for name, unit in units])


def table_without_unit_heads(table: pa.Table) -> pa.Table:
    """Pyarrow table with units moved from column heads to metadata."""
    import pyarrow as pa

    fields = []
    for field in table.schema:
        found = re.fullmatch(r"(.+) \[([^\[\]]+)\]", field.name)
        fields.append(field.with_name(found[1]).with_metadata({"unit": found[2]}) if found else field)
    return pa.Table.from_arrays(table.columns, schema=pa.schema(fields))


def table_with_column(table: pa.Table, name: str, values: Iterable[Any]) -> pa.Table:
    """Pyarrow table with one column's values replaced."""
    import pyarrow as pa

    at = table.column_names.index(name)
    field = table.schema.field(at)
    return table.set_column(at, field, pa.array(values, field.type))


def export_table(table: pa.Table, path: str | Path, error: type[WarpchainError] = StudyError) -> Path:
    """Writes a pyarrow table as Parquet or CSV; returns its path.

    Raises:
        error: another ending, or a folder or disk that refuses.
    """
    target = Path(path)
    if target.suffix not in (".parquet", ".csv"):
        raise error(f"{target}: allowed endings are .parquet and .csv")
    with refusals_as_errors(target, error), whole_file(target) as file:
        if target.suffix == ".csv":
            from pyarrow import csv

            csv.write_csv(table_with_unit_heads(table), file)
        else:
            from pyarrow import parquet

            parquet.write_table(table, file)
    return target
