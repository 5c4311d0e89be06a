"""Designs of experiments: the table of a study's rows, before anything is simulated."""

from __future__ import annotations

import itertools
import json
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive.toml import value_text
from warpchain.errors import StudyError, warn_caller
from warpchain.study.design.factor_values import (
    Array,
    DesignDimension,
    design_dimensions,
    fill_tied_values,
    tied_factors,
    values_from_coded,
    values_from_grid,
    values_from_probabilities,
)
from warpchain.study.design.noise_rows import crossed_rows, noise_rows
from warpchain.study.results import DISTRIBUTION_KEY, EXPRESSION_KEY, NOISE, TIED_NOISE, TODAY_COLUMN
from warpchain.study.spec.expression import parse_expression
from warpchain.study.store import MOST_ROWS

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor


def make_design(study: Study, source: str | Path, before: Sequence[int] = ()) -> pa.Table:
    """Design table of a study: variant, factors, status, reason.

    Args:
        source: the study file, to which tables are relative.
        before: numbers of points of a Latin hypercube before it grew.

    Raises:
        StudyError: too many rows or dimensions, or a table that cannot be used.
    """
    columns = _factor_columns(study, source, before)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    rows = [{}] if study.design.kind == NOISE else rows
    if set(columns) >= set(study.noise_names) - {factor.name for factor in tied_factors(study)}:
        return _completed_table(study, rows)  # no noise, or a table that holds it
    noise = noise_rows(study)
    _check_row_count(len(rows) * len(noise), source)
    return _completed_table(study, crossed_rows(rows, noise))


def design_table_of_rows(study: Study, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Design table of rows, tied factors filled in, today's marked."""
    given = [factor.name for factor in study.factors if factor.value_source != "expression"]
    for i, values in enumerate(rows):
        for name in given:
            if values.get(name) is None:
                raise StudyError(f"rows: row {i}: factor {name!r} has no value")
    kept = (*given, TODAY_COLUMN)
    return _completed_table(study, ({name: values[name] for name in kept if name in values} for values in rows))


def _completed_table(study: Study, rows: Iterable[dict[str, Any]]) -> pa.Table:
    """Design table of rows, tied factors filled in."""
    import pyarrow as pa

    order = tied_factors(study)
    columns: dict[str, list[Any]] = {factor.name: [] for factor in study.factors}
    reasons: list[str | None] = []
    today: list[bool | None] = []
    for row in rows:
        today.append(row.pop(TODAY_COLUMN, None))
        reasons.append(fill_tied_values(study, order, row))
        for name, column in columns.items():
            column.append(row[name])
    table = _arrow_table(study, columns, reasons)
    if all(mark is None for mark in today):
        return table
    return table.add_column(1 + len(columns), pa.field(TODAY_COLUMN, pa.bool_()), pa.array(today, pa.bool_()))


def _factor_columns(study: Study, source: str | Path, before: Sequence[int] = ()) -> dict[str, list[Any]]:
    """Design values by factor, expressions left out."""
    if study.design.kind == NOISE:
        return {}
    whole, study = study, study.design_study
    design, axes = study.design, design_dimensions(study)
    if design.kind == "table":
        return _read_design_columns(whole, source)
    if not axes and whole.noise_names:
        raise StudyError(
            f'{source}: factors: all are noise; give a design factor that varies, or design.kind = "noise"'
        )
    if not axes:
        raise StudyError(f"{source}: factors: all are expressions; at least one must vary by itself")
    if design.kind == "factorial":
        return _factorial_columns(axes, source)
    if design.count is not None:
        points = _sampled_points(study, len(axes), source, before)
        return {f.name: values_from_probabilities(f, points[:, k]) for k, axis in enumerate(axes) for f in axis.factors}
    _check_row_count(design.center or 0, source)
    if design.kind == "central-composite":
        points = central_composite_points(
            len(axes), design.axial or "face", 1 if design.center is None else design.center
        )
    else:
        points = np.vstack([plackett_burman_points(len(axes)), np.zeros((design.center or 0, len(axes)))])
    _check_row_count(len(points), source)
    return {f.name: values_from_coded(f, points[:, k]) for k, axis in enumerate(axes) for f in axis.factors}


def _check_row_count(rows: int, source: str | Path) -> None:
    """Raises StudyError for a design of too many rows."""
    if rows > MOST_ROWS:
        raise StudyError(f"{source}: design: {rows} rows; allowed are at most {MOST_ROWS}")


def _factorial_columns(axes: Iterable[DesignDimension], source: str | Path) -> dict[str, list[Any]]:
    """Values by factor of a full factorial design."""
    axes = tuple(axes)
    sizes = [axis.grid_size or 1 for axis in axes]
    _check_row_count(math.prod(sizes), source)
    places = np.indices(sizes).reshape(len(sizes), -1)
    return {
        factor.name: values_from_grid(factor, places[k], sizes[k])
        for k, axis in enumerate(axes)
        for factor in axis.factors
    }


def _sampled_points(study: Study, count: int, source: str | Path, before: Sequence[int] = ()) -> Array:
    """Points (rows, dimensions) of a sampled design."""
    from scipy.stats import qmc

    design = study.design
    assert design.count is not None  # the design's own rule
    _check_row_count(design.count, source)
    if before and before[0] != design.count:
        smaller = study.model_copy(update={"design": design.model_copy(update={"count": before[0]})})
        points = _sampled_points(smaller, count, source)
        for size in (*before[1:], design.count):
            points = extended_latin_hypercube(points, size, design.seed or 0, source) if size != len(points) else points
        return points
    samplers = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}
    try:
        sampler = samplers[design.kind](count, rng=design.seed or 0)
    except ValueError as error:
        raise StudyError(f'{source}: design.kind = "{design.kind}": {error}') from None
    if design.kind == "sobol" and design.count & (design.count - 1):
        near = 2 ** round(math.log2(design.count))
        warn_caller(f"design.count = {design.count}: Sobol' points are balanced at powers of 2: {near}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(sampler.random(design.count), dtype=float)


def extended_latin_hypercube(points: Array, count: int, seed: int, source: str | Path) -> Array:
    """Points (count, dimensions) of a grown Latin hypercube."""
    if count % len(points):
        raise StudyError(
            f"{source}: design.count = {count}: a Latin hypercube of {len(points)} points grows to multiples of that"
        )
    random = np.random.default_rng([seed, count])
    more = np.empty((count - len(points), points.shape[1]))
    for k, column in enumerate(points.T):
        free = np.setdiff1d(np.arange(count), np.minimum((column * count).astype(int), count - 1))
        more[:, k] = (random.permutation(free) + random.random(len(free))) / count
    return np.vstack([points, more])


def central_composite_points(count: int, axial: str, center: int) -> Array:
    """Coded points (rows, count) of a central composite design."""
    if count > 20:
        raise StudyError(f'design.kind = "central-composite": 2^{count} corners; allowed are at most 20 factors')
    reach = 2.0 ** (0.25 * count)
    corner, arm = {"face": (1.0, 1.0), "inscribed": (1.0 / reach, 1.0), "circumscribed": (1.0, reach)}[axial]
    corners = corner * np.array(list(itertools.product((-1.0, 1.0), repeat=count)))
    arms = arm * np.vstack([sign * row for row in np.eye(count) for sign in (-1.0, 1.0)])
    return np.vstack([corners, arms, np.zeros((center, count))])


def plackett_burman_points(count: int) -> Array:
    """Coded points (rows, count) of a Plackett-Burman design."""
    size = 4 * (count // 4 + 1)
    matrix = hadamard_matrix(size)
    while matrix is None and size < 4 * count + 64:
        size += 4
        matrix = hadamard_matrix(size)
    if matrix is None:
        raise StudyError(f'design.kind = "plackett-burman": none is known for {count} factors')
    return matrix[:, 1 : count + 1]


def hadamard_matrix(size: int) -> Array | None:
    """Hadamard matrix (size, size) by Paley and Sylvester, or None."""
    if size in (1, 2):
        return np.array([[1.0, 1.0], [1.0, -1.0]])[:size, :size]
    q = size - 1
    if q % 4 == 3 and all(q % d for d in range(3, math.isqrt(q) + 1, 2)):
        squares = {k * k % q for k in range(1, q)}
        symbol = np.array([-1.0] + [1.0 if k in squares else -1.0 for k in range(1, q)])
        core = np.array([np.roll(symbol, i) for i in range(q)])
        return np.block([[np.ones((1, 1)), np.ones((1, q))], [np.ones((q, 1)), core]])
    half = hadamard_matrix(size // 2) if size % 4 == 0 else None
    return None if half is None else np.block([[half, half], [half, -half]])


def _read_design_columns(study: Study, source: str | Path) -> dict[str, list[Any]]:
    """Values by factor from a design table's file."""
    from warpchain.study.store import read_table

    assert study.design.file is not None  # the design's own rule
    path = Path(source).parent / study.design.file
    table = read_table(path, bounded=True)
    wanted = [factor.name for factor in study.factors if factor.value_source != "expression"]
    if not any(factor.name in table.column_names for factor in study.noise_study.factors):
        wanted = [name for name in wanted if name not in study.noise_names]
    missing = [name for name in wanted if name not in table.column_names]
    extra = [name for name in table.column_names if name not in wanted]
    if missing:
        raise StudyError(f"{path}: no column for factor {missing[0]}; it has {', '.join(table.column_names)}")
    if extra:
        raise StudyError(f"{path}: column {extra[0]}: no factor of that name; factors are {', '.join(wanted)}")
    if not table.num_rows:
        raise StudyError(f"{path}: no rows")
    _check_row_count(table.num_rows, path)
    columns = {name: table[name].to_pylist() for name in wanted}
    for name, values in columns.items():
        kind = table.schema.field(name).type
        if values and not {type(value) for value in values} <= {bool, int, float, str, type(None)}:
            raise StudyError(f"{path}: column {name}: holds {kind}; allowed are numbers, texts and switches")
        for i, value in enumerate(values):
            if value is None or (isinstance(value, float) and not math.isfinite(value)):
                shown = "empty" if value is None else value
                raise StudyError(
                    f"{path}: column {name}, row {i}: {shown}; must be a finite number, a text or a switch"
                )
    for factor in study.factors:
        outside = next((i for i, v in enumerate(columns.get(factor.name, ())) if not _is_factor_value(factor, v)), None)
        if outside is not None:
            value, said = columns[factor.name][outside], "range" if factor.range else factor.value_source
            raise StudyError(
                f"{path}: column {factor.name}, row {outside}: {value_text(value)}; must be of the factor's "
                f"{said} = {value_text(getattr(factor, str(said)))}"
            )
    return columns


def _is_factor_value(factor: Factor, value: Any) -> bool:
    """Whether a design table's value is the factor's."""
    if factor.listed_values is not None:
        return value in factor.cells_from_values(factor.listed_values)
    if factor.range is None:
        return True
    slack = 1e-9 * (factor.range[1] - factor.range[0])
    return isinstance(value, (int, float)) and factor.range[0] - slack <= value <= factor.range[1] + slack


def distribution_metadata(factor: Factor) -> dict[str, str]:
    """Metadata of a design column: its factor's distribution."""
    if factor.distribution in (None, "uniform"):
        return {}
    keys = ("distribution", "range", "mean", "std", "sample", "integer")
    given = factor.model_dump(include=set(keys), exclude_none=True, exclude_defaults=True)
    return {DISTRIBUTION_KEY: json.dumps(given, sort_keys=True)}


def _arrow_table(study: Study, columns: dict[str, list[Any]], reasons: list[str | None]) -> pa.Table:
    """Design table from values by factor and rows' reasons."""
    import pyarrow as pa

    fields: list[pa.Field] = [pa.field("variant", pa.int64())]
    arrays: list[pa.Array] = [pa.array(range(len(reasons)), pa.int64())]
    noise = study.noise_names
    for factor in study.factors:
        column = factor.cells_from_values(columns[factor.name])
        try:
            arrays.append(pa.array(column, _arrow_type(column)))
        except (TypeError, OverflowError, pa.ArrowException) as error:
            line = str(error).splitlines()[0]
            raise StudyError(f"factors.{factor.name}: its values make no column ({line})") from None
        facts = {
            "role": "hidden" if factor.hidden else "factor",
            "unit": factor.display_unit,
            **distribution_metadata(factor),
        }
        if factor.expression is not None:
            facts[EXPRESSION_KEY] = json.dumps(parse_expression(factor.expression).names)
        if factor.name in noise:
            facts["kind"] = TIED_NOISE if factor.value_source == "expression" else NOISE
        fields.append(pa.field(factor.name, arrays[-1].type, metadata=facts))
    statuses = ["planned" if reason is None else "infeasible" for reason in reasons]
    arrays += [pa.array(statuses, pa.string()), pa.array(reasons, pa.string())]
    fields += [pa.field("status", pa.string()), pa.field("reason", pa.string())]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _arrow_type(column: list[Any]) -> Any:
    """Arrow type of a design column."""
    import pyarrow as pa

    types = {type(value) for value in column if value is not None}
    if len(types) > 1 and not types <= {int, float}:
        raise TypeError(f"values of several kinds: {', '.join(sorted(kind.__name__ for kind in types))}")
    if types <= {bool} and types:
        return pa.bool_()
    if types <= {str} and types:
        return pa.string()
    return pa.int64() if types <= {int} and types else pa.float64()
