"""Designs of experiments: the table of a study's rows, before anything is simulated.

Latin hypercube, Sobol' and Halton points come from `scipy.stats.qmc`, scrambled by the study's seed. A central
composite design of k dimensions has the 2^k corners, 2 k axial points and center points (Box and Wilson 1951); its
circumscribed and inscribed forms are rotatable, with axial points 2^(k/4) times as far out as the corners. A
Plackett-Burman design (1946) has the least multiple of four rows above k; its columns are orthogonal columns of a
Hadamard matrix.
"""

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
    Dimension,
    complete,
    dimensions,
    from_coded,
    from_unit,
    on_grid,
    tied,
)
from warpchain.study.design.noise import crossed, noise_rows
from warpchain.study.results import DISTRIBUTION_KEY, NOISE, TIED_NOISE
from warpchain.study.store import MOST_ROWS

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor


def make_design(study: Study, source: str | Path, before: Sequence[int] = ()) -> pa.Table:
    """The rows of a study.

    Args:
        study: what to vary.
        source: the study file: tables are relative to it, and errors name it.
        before: of a Latin hypercube that has grown, the numbers of points that it had.

    Returns:
        A row a variant: "variant", a column for each factor (its field says role = "factor" and its unit), "status"
        ("planned" or "infeasible") and "reason".

    Raises:
        StudyError: too many rows or dimensions, or a table that cannot be used.
    """
    columns = _columns(study, source, before)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    rows = [{}] if study.design.kind == NOISE else rows
    if set(columns) >= set(study.noise_names) - {factor.name for factor in tied(study)}:
        return _completed(study, rows)  # no noise, or a table that holds it
    noise = noise_rows(study)
    _check_count(len(rows) * len(noise), source)
    return _completed(study, crossed(rows, noise))


def table_of_rows(study: Study, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows as `make_design` gives them: tied factors filled in, those that miss a constraint infeasible.

    Args:
        rows: values by factor; what else they hold is left aside.

    Raises:
        StudyError: a factor without expression is missing, or its values make no column.
    """
    given = [factor.name for factor in study.factors if factor.value_source != "expression"]
    for i, values in enumerate(rows):
        for name in given:
            if values.get(name) is None:
                raise StudyError(f"rows: row {i}: factor {name!r} has no value")
    return _completed(study, ({name: values[name] for name in given} for values in rows))


def _completed(study: Study, rows: Iterable[dict[str, Any]]) -> pa.Table:
    """The table of rows without their tied factors, which are filled in."""
    order = tied(study)
    columns: dict[str, list[Any]] = {factor.name: [] for factor in study.factors}
    reasons: list[str | None] = []
    for row in rows:
        reasons.append(complete(study, order, row))
        for name, column in columns.items():
            column.append(row[name])
    return _table(study, columns, reasons)


def _columns(study: Study, source: str | Path, before: Sequence[int] = ()) -> dict[str, list[Any]]:
    """Values of the design factors that have no expression; of a table that holds them, of noise factors too."""
    if study.design.kind == NOISE:
        return {}
    whole, study = study, study.design_study
    design, axes = study.design, dimensions(study)
    if design.kind == "table":
        return _read(whole, source)
    if not axes and whole.noise_names:
        raise StudyError(
            f'{source}: factors: all are noise; give a design factor that varies, or design.kind = "noise"'
        )
    if not axes:
        raise StudyError(f"{source}: factors: all are expressions; at least one must vary by itself")
    if design.kind == "factorial":
        return _factorial(axes, source)
    if design.count is not None:
        points = _sampled(study, len(axes), source, before)
        return {f.name: from_unit(f, points[:, k]) for k, axis in enumerate(axes) for f in axis.factors}
    _check_count(design.center or 0, source)
    if design.kind == "central-composite":
        points = central_composite(len(axes), design.axial or "face", 1 if design.center is None else design.center)
    else:
        points = np.vstack([plackett_burman(len(axes)), np.zeros((design.center or 0, len(axes)))])
    _check_count(len(points), source)
    return {f.name: from_coded(f, points[:, k]) for k, axis in enumerate(axes) for f in axis.factors}


def _check_count(rows: int, source: str | Path) -> None:
    if rows > MOST_ROWS:
        raise StudyError(f"{source}: design: {rows} rows; allowed are at most {MOST_ROWS}")


def _factorial(axes: Iterable[Dimension], source: str | Path) -> dict[str, list[Any]]:
    """Every combination; the last factor varies fastest."""
    axes = tuple(axes)
    sizes = [axis.size or 1 for axis in axes]
    _check_count(math.prod(sizes), source)
    places = np.indices(sizes).reshape(len(sizes), -1)
    return {factor.name: on_grid(factor, places[k], sizes[k]) for k, axis in enumerate(axes) for factor in axis.factors}


def _sampled(study: Study, count: int, source: str | Path, before: Sequence[int] = ()) -> Array:
    """Points in the unit cube (rows, dimensions)."""
    from scipy.stats import qmc

    design = study.design
    assert design.count is not None  # the design's own rule
    _check_count(design.count, source)
    if before and before[0] != design.count:
        smaller = study.model_copy(update={"design": design.model_copy(update={"count": before[0]})})
        points = _sampled(smaller, count, source)
        for size in (*before[1:], design.count):
            points = extended(points, size, design.seed or 0, source) if size != len(points) else points
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


def extended(points: Array, count: int, seed: int, source: str | Path) -> Array:
    """A Latin hypercube (n, dimensions) with further points, to a multiple of n: again one of `count` strata.

    Raises:
        StudyError: another number of points.
    """
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


def central_composite(count: int, axial: str, center: int) -> Array:
    """Corners, axial points and center rows in coded units (2^count + 2 count + center, count)."""
    if count > 20:
        raise StudyError(f'design.kind = "central-composite": 2^{count} corners; allowed are at most 20 factors')
    reach = 2.0 ** (0.25 * count)
    corner, arm = {"face": (1.0, 1.0), "inscribed": (1.0 / reach, 1.0), "circumscribed": (1.0, reach)}[axial]
    corners = corner * np.array(list(itertools.product((-1.0, 1.0), repeat=count)))
    arms = arm * np.vstack([sign * row for row in np.eye(count) for sign in (-1.0, 1.0)])
    return np.vstack([corners, arms, np.zeros((center, count))])


def plackett_burman(count: int) -> Array:
    """Two-level rows in coded units (4 (count // 4 + 1), count) with orthogonal columns.

    Raises:
        StudyError: no Hadamard matrix of that size is known here.
    """
    size = 4 * (count // 4 + 1)
    matrix = hadamard(size)
    while matrix is None and size < 4 * count + 64:
        size += 4
        matrix = hadamard(size)
    if matrix is None:
        raise StudyError(f'design.kind = "plackett-burman": none is known for {count} factors')
    return matrix[:, 1 : count + 1]


def hadamard(size: int) -> Array | None:
    """A Hadamard matrix with a first column of ones: Paley's first construction, doubled (Sylvester); None if neither.

    For a prime q = size - 1 with q = 3 mod 4 the core has the Legendre symbol of j - i off its diagonal, -1 on it.
    """
    if size in (1, 2):
        return np.array([[1.0, 1.0], [1.0, -1.0]])[:size, :size]
    q = size - 1
    if q % 4 == 3 and all(q % d for d in range(3, math.isqrt(q) + 1, 2)):
        squares = {k * k % q for k in range(1, q)}
        symbol = np.array([-1.0] + [1.0 if k in squares else -1.0 for k in range(1, q)])
        core = np.array([np.roll(symbol, i) for i in range(q)])
        return np.block([[np.ones((1, 1)), np.ones((1, q))], [np.ones((q, 1)), core]])
    half = hadamard(size // 2) if size % 4 == 0 else None
    return None if half is None else np.block([[half, half], [half, -half]])


def _read(study: Study, source: str | Path) -> dict[str, list[Any]]:
    """The columns of a design table."""
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
    _check_count(table.num_rows, path)
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
        outside = next((i for i, v in enumerate(columns.get(factor.name, ())) if not _of_factor(factor, v)), None)
        if outside is not None:
            value, said = columns[factor.name][outside], "range" if factor.range else factor.value_source
            raise StudyError(
                f"{path}: column {factor.name}, row {outside}: {value_text(value)}; must be of the factor's "
                f"{said} = {value_text(getattr(factor, str(said)))}"
            )
    return columns


def _of_factor(factor: Factor, value: Any) -> bool:
    """Whether a value is one that a factor can take, as far as it says which."""
    if factor.listed_values is not None:
        return value in factor.cells_from_values(factor.listed_values)
    if factor.range is None:
        return True
    slack = 1e-9 * (factor.range[1] - factor.range[0])
    return isinstance(value, (int, float)) and factor.range[0] - slack <= value <= factor.range[1] + slack


def distribution(factor: Factor) -> dict[str, str]:
    """A factor's distribution as metadata of its column; empty for ranges and levels, which are as they ran."""
    if factor.distribution in (None, "uniform"):
        return {}
    keys = ("distribution", "range", "mean", "std", "sample", "integer")
    given = factor.model_dump(include=set(keys), exclude_none=True, exclude_defaults=True)
    return {DISTRIBUTION_KEY: json.dumps(given, sort_keys=True)}


def _table(study: Study, columns: dict[str, list[Any]], reasons: list[str | None]) -> pa.Table:
    import pyarrow as pa

    fields: list[pa.Field] = [pa.field("variant", pa.int64())]
    arrays: list[pa.Array] = [pa.array(range(len(reasons)), pa.int64())]
    noise = study.noise_names
    for factor in study.factors:
        column = factor.cells_from_values(columns[factor.name])
        try:
            arrays.append(pa.array(column, _kind(column)))
        except (TypeError, OverflowError, pa.ArrowException) as error:
            line = str(error).splitlines()[0]
            raise StudyError(f"factors.{factor.name}: its values make no column ({line})") from None
        facts = {"role": "hidden" if factor.hidden else "factor", "unit": factor.display_unit, **distribution(factor)}
        if factor.name in noise:
            facts["kind"] = TIED_NOISE if factor.value_source == "expression" else NOISE
        fields.append(pa.field(factor.name, arrays[-1].type, metadata=facts))
    statuses = ["planned" if reason is None else "infeasible" for reason in reasons]
    arrays += [pa.array(statuses, pa.string()), pa.array(reasons, pa.string())]
    fields += [pa.field("status", pa.string()), pa.field("reason", pa.string())]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _kind(column: list[Any]) -> Any:
    """The Arrow type of a column's values."""
    import pyarrow as pa

    types = {type(value) for value in column if value is not None}
    if len(types) > 1 and not types <= {int, float}:
        raise TypeError(f"values of several kinds: {', '.join(sorted(kind.__name__ for kind in types))}")
    if types <= {bool} and types:
        return pa.bool_()
    if types <= {str} and types:
        return pa.string()
    return pa.int64() if types <= {int} and types else pa.float64()
