"""Table of metrics: one row a variant, from the kernels' sums over the window."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.model import ChainModel
from warpchain.model.stacks import LARGEST_STACK, Of, Stack, pick_variants
from warpchain.model.trains import is_free_body
from warpchain.results.arrow_tables import table_with_units
from warpchain.results.judgement import Limits, judge_variants
from warpchain.results.metric_columns import (
    BALANCE_METRICS,
    CHAIN_BALANCE_NAMES,
    CHAIN_PARTS,
    DESIGN_METRICS,
    ENGAGED_METRICS,
    SETTLING_METRICS,
    STEADY_METRICS,
    WINDOW_METRICS,
    MetricGroup,
    columns_of_metrics,
    groups_of_drive,
    variants_by_columns,
)
from warpchain.results.metric_formulas import (
    STEP_KEY,
    BatchSums,
    ColumnValues,
    DesignInputs,
    DriftMeans,
    EnergyBalance,
    LazyFields,
    VariantSums,
    WindowSums,
    column_of_value,
    columns_of_formulas,
    mask_absent,
    number_of_each_drive,
)
from warpchain.results.ripple import slowest_ripple_periods
from warpchain.results.schedule import Schedule, Schedules, join_schedules, schedules_as_columns
from warpchain.results.window_statistics import LEAST_CHAIN_TURNS

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]
Columns = dict[str, ColumnValues]
ColumnBlocks = list[tuple[NDArray[np.int64], Columns]]
"""Numbers of variants with equal metric columns, and these."""


@dataclass(frozen=True)
class VariantEnds(Generic[Of]):
    """Ends of V variants or chains: steps, states, settling, causes."""

    drives: Sequence[Of]  # (V,)
    schedules: Sequence[Schedule]  # (V,) when they step and are measured
    steps: NDArray[np.integer]  # (V,) the step that each came to
    diverged: NDArray[np.bool_]  # (V,)
    settled: NDArray[Any]  # (V,) "steps" and "residual" of settling
    engaged: NDArray[np.float64] | None = None  # (V, S) share of each sprocket's wrap on its teeth at the end
    layouts: Sequence[Sequence[str]] | None = None  # (V,) faults of the drives' layouts
    settle_force: NDArray[np.float64] | None = None  # (V,) largest net force that settling left on a roller [N]
    causes: Sequence[str] | None = None  # (V,) of `judgement.DIVERGENCE_CAUSES`, "" for none
    stacks: Sequence[Stack[Of]] | None = None  # the drives, or models, sorted into kinds

    def select_variants(self, variants: NDArray[np.intp]) -> VariantEnds[Of]:
        """Ends of some of the variants."""
        places = variants.tolist()
        return VariantEnds(
            [self.drives[v] for v in places],
            self._schedule_columns[variants],
            self.steps[variants],
            self.diverged[variants],
            self.settled[variants],
            None if self.engaged is None else self.engaged[variants],
            None if self.layouts is None else [self.layouts[v] for v in places],
            None if self.settle_force is None else self.settle_force[variants],
            None if self.causes is None else [self.causes[v] for v in places],
            self._stacks_among(variants),
        )

    def number_of_each(self, value: Callable[[Of], Any]) -> NDArray[Any]:
        """Number (V,) of each drive, computed by stacks."""
        return number_of_each_drive(self.drives, self.stacks, value)

    def _stacks_among(self, variants: NDArray[np.intp]) -> list[Stack[Of]] | None:
        """Stacks of some ascending variants, which are numbered anew from 0."""
        if self.stacks is None:
            return None
        number, place = self._stack_places
        mine, found = number[variants], []
        for k in np.unique(mine).tolist():
            members, stack = np.flatnonzero(mine == k), self.stacks[k]
            whole = len(members) == len(stack.members)
            found.append(Stack(members, stack.one if whole else pick_variants(stack.one, place[variants[members]])))
        return found

    @cached_property
    def _stack_places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Stack (V,) of each variant, and place in it (V,)."""
        number, place = np.zeros((2, len(self.drives)), dtype=np.int64)
        for k, stack in enumerate(self.stacks or ()):
            number[stack.members], place[stack.members] = k, np.arange(len(stack.members))
        return number, place

    @cached_property
    def is_measured(self) -> NDArray[np.bool_]:
        """(V,) whether each variant ended its window."""
        return (self.steps > self.schedule_column("window_end")) & ~self.diverged

    def schedule_column(self, field: str) -> NDArray[Any]:
        """Field (V,) of the variants' schedules."""
        return self._schedule_columns.columns[field]

    @cached_property
    def _schedule_columns(self) -> Schedules:
        """Schedules of the variants as columns."""
        return schedules_as_columns(self.schedules)


def join_ends(ends: Sequence[VariantEnds[Drive]], numbers: Sequence[NDArray[np.int64]]) -> VariantEnds[Drive]:
    """Ends of a run's variants, joined from groups."""
    order = np.argsort(np.concatenate(numbers))

    def values_in_order(each: Sequence[Sequence[Any]]) -> list[Any]:
        """Values of groups' variants in the run's order."""
        values = [value for some in each for value in some]
        return [values[v] for v in order.tolist()]

    return VariantEnds(
        values_in_order([ended.drives for ended in ends]),
        join_schedules([ended.schedules for ended in ends])[order],
        np.concatenate([ended.steps for ended in ends])[order],
        np.concatenate([ended.diverged for ended in ends])[order],
        np.concatenate([ended.settled for ended in ends])[order],
        layouts=values_in_order([ended.layouts or () for ended in ends]),
        causes=values_in_order([ended.causes or () for ended in ends]),
        stacks=[
            Stack(mine[stack.members], stack.one)
            for ended, mine in zip(ends, numbers, strict=True)
            for stack in ended.stacks or ()
        ],
    )


def run_columns(ended: VariantEnds[Any]) -> Columns:
    """Metric columns on divergence and window [s]."""
    step = ended.schedule_column("step")
    return {
        "diverged": column_of_value(ended.diverged),
        "diverged_time": mask_absent(ended.diverged, ended.steps * step),
        "window_start": column_of_value(ended.schedule_column("window_start") * step),
        "window_end": column_of_value(ended.schedule_column("window_end") * step),
    }


def window_columns(ended: VariantEnds[ChainModel], sums: VariantSums) -> Columns:
    """Metric columns formed of sums over the window."""
    columns: Columns = {}
    duration = (ended.schedule_column("window_end") - ended.schedule_column("window_start")) * ended.schedule_column(
        "step"
    )
    links = ended.number_of_each(lambda model: model.chain.links)
    driver = ended.drives[0].driver
    teeth = ended.number_of_each(lambda model: model.sprockets[driver].teeth)
    turns = abs(sums.whole["sprocket"]["speed"][:, driver]) * teeth / (2.0 * np.pi * links)
    places = groups_of_drive(ended.drives[0], WINDOW_METRICS)
    found: dict[int, tuple[list[int], dict[str, ColumnValues]]] = {}
    for prefix, index, group in places:
        if id(group) not in found:
            parts = [other for _, other, of in places if of is group]
            found[id(group)] = parts, _group_columns(group, sums, parts, (duration, links, turns >= LEAST_CHAIN_TURNS))
        parts, of_group = found[id(group)]
        k = parts.index(index)
        columns |= {prefix + name: ColumnValues(*(table[:, k] for table in both)) for name, both in of_group.items()}
    return columns


def _group_columns(
    group: MetricGroup,
    sums: VariantSums,
    parts: list[int],
    each: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]],
) -> dict[str, ColumnValues]:
    """Metric columns (V, parts) of a group of parts.

    Args:
        parts: indices of the parts that have the group.
        each: (V,) length of the window [s], links, and whether errors can be given.
    """
    count = len(parts)
    duration, links, long = (np.repeat(values, count) for values in each)

    def rows_of(values: NDArray[Any]) -> NDArray[Any]:
        """Rows (R, ...) of the group's parts from values of all (V, all, ...)."""
        own = values if values.shape[1] == count else values[:, parts]
        return own.reshape(-1, *values.shape[2:])

    whole = group.part == "chain"
    rows = sums.whole[group.source] if whole else rows_of(sums.whole[group.source])
    batches = tension = None
    if group.source in sums.batches.sums and long.any():
        every = sums.batches.sums[group.source]
        mine = every if whole else LazyFields(lambda name: rows_of(every[name]))
        lengths = np.repeat(sums.batches.durations, count, axis=0)
        weight = group.weight(mine, lengths, links[:, None])
        known = long[:, None] & np.isfinite(lengths) & (weight > 0)
        batches = WindowSums(mine, np.where(known, weight, np.nan))
    if group.part in ("chain", "strand"):
        counts, edges = sums.tension
        tension = (counts.sum(axis=1) if whole else rows_of(counts)), edges
    summed = WindowSums(rows, group.weight(rows, duration, links), batches, tension)
    found = columns_of_formulas(group.columns, summed, summed.weight == 0)
    return {name: ColumnValues(*(of.reshape(-1, count) for of in both)) for name, both in found.items()}


def drift_means(ended: VariantEnds[ChainModel], batches: BatchSums) -> DriftMeans:
    """Batch means of tension and speeds over the window."""
    noted, durations = batches.sums, batches.durations
    links = ended.number_of_each(lambda model: model.chain.links)[:, None]
    weight = noted["chain"]["samples"] * links
    tension = np.where(np.isfinite(durations), noted["chain"]["tension"] / weight, np.nan)
    turned = noted["sprocket"]["speed"]
    turns = np.abs(np.nansum(turned, axis=-1)) / (2.0 * np.pi)
    waves = number_of_each_drive(
        ended.drives, ended.stacks, slowest_ripple_periods, turns, np.nansum(durations, axis=-1)
    )
    return DriftMeans(tension, list(np.moveaxis(turned / durations[:, None], 1, 0)), waves)


def energy_balance(model: ChainModel, sums: Mapping[str, Any]) -> EnergyBalance:
    """Energy balance (V,) over the window [J].

    What prescribes angles and centers, and what supplies oil, does the input work.
    """
    chain, sprockets, mounts = sums["chain"], sums["sprocket"], sums["mount"]
    driven = np.array([not is_free_body(model, s) for s in range(len(model.sprockets))])
    contact_work = np.compress(driven, sprockets["contact_work"], axis=1)
    load_work = np.compress(~driven, sprockets["load_work"], axis=1)
    dissipated = chain["dissipated"] + chain["friction"] + sums["contact"]["dissipated"].sum(axis=1)
    supplied, loaded = 0.0, load_work.sum(axis=1) + chain["goods_work"]
    if model.shafts or model.couplings:
        supplied = sums["shaft"]["motor_work"].sum(axis=1) - sums["coupling"]["led_work"].sum(axis=1)
        loaded = loaded + sums["shaft"]["load_work"].sum(axis=1)
        dissipated = dissipated + sums["coupling"]["dissipated"].sum(axis=1) + sums["coupling"]["slip_loss"].sum(axis=1)
    if model.arms or model.tensioners:
        flows = sums["tensioner"]["flows"]
        dissipated = dissipated + sums["arm"]["dissipated"].sum(axis=1) + sums["tensioner"]["dissipated"].sum(axis=1)
        dissipated = dissipated + flows["leak_loss"].sum(axis=1) + flows["valve_loss"].sum(axis=1)
        supplied = supplied + flows["supply_work"].sum(axis=1) + sums["arm"]["work"].sum(axis=1)
        supplied = supplied + sums["tensioner"]["suction_work"].sum(axis=1)
    return EnergyBalance(
        input=mounts["work"].sum(axis=1) - contact_work.sum(axis=1) + supplied,
        output=-loaded,
        links=chain["dissipated"],
        dissipated=dissipated
        + mounts["dissipated"].sum(axis=1)
        + sums["contact"]["friction"].sum(axis=1)
        + mounts["friction"].sum(axis=1),
        change=chain["energy_end"] - chain["energy_start"],
        stored=np.maximum(abs(chain["energy_end"]), abs(chain["energy_start"])),
    )


def design_metric_columns(
    models: Sequence[ChainModel], metrics: Columns, stacks: Sequence[Stack[ChainModel]] | None = None
) -> Columns:
    """Metric columns that follow from other metrics."""
    columns: Columns = {}
    with np.errstate(all="ignore"):
        for prefix, index, group in groups_of_drive(models[0], DESIGN_METRICS):
            judged = DesignInputs(models, stacks, metrics, prefix, index)
            columns |= {prefix + name: of for name, of in columns_of_formulas(group.columns, judged).items()}
    return columns


def engaged_columns(ended: VariantEnds[ChainModel]) -> Columns:
    """Metric columns on wraps' shares on teeth (V,)."""
    if ended.engaged is None:
        return {}
    groups = groups_of_drive(ended.drives[0], ((ENGAGED_METRICS,),))
    return {prefix + c.name: column_of_value(ended.engaged[:, s]) for prefix, s, group in groups for c in group.columns}


def metrics_of_variants(ended: VariantEnds[ChainModel], sums: VariantSums) -> Columns:
    """Metric columns of V variants of equal columns."""
    model = ended.drives[0]
    with np.errstate(all="ignore"):
        columns = window_columns(ended, sums)
        columns |= columns_of_formulas(STEADY_METRICS.columns, drift_means(ended, sums.long_batches))
        columns |= columns_of_formulas(BALANCE_METRICS.columns, energy_balance(model, sums.whole))
        known = run_columns(ended) | {STEP_KEY: column_of_value(ended.schedule_column("step"))} | columns
        columns |= design_metric_columns(ended.drives, known, ended.stacks)
    columns |= engaged_columns(ended)
    absent = ~ended.is_measured
    columns = {name: ColumnValues(of.values, of.missing | absent) for name, of in columns.items()}
    settled = {"settle_steps": ended.settled["steps"], "settle_residual": ended.settled["residual"]}
    if ended.settle_force is not None:
        settled["settle_force"] = ended.settle_force
    names = (column.name for _, _, group in groups_of_drive(model, ((SETTLING_METRICS,),)) for column in group.columns)
    return columns | {name: column_of_value(settled[name]) for name in names if name in settled}


ChainEnds = tuple[VariantEnds[ChainModel], VariantSums]
"""Ends of one chain of variants, and its sums."""


def metrics_of_chains(prefixes: Sequence[str], parts: Sequence[ChainEnds]) -> Columns:
    """Metric columns of V variants, of several chains each."""
    columns: Columns = {}
    balances, measured = [], parts[0][0].is_measured
    for prefix, (ended, sums) in zip(prefixes, parts, strict=True):
        own, model = metrics_of_variants(ended, sums), ended.drives[0]
        names = {p + c.name for p, _, g in groups_of_drive(model) if g.part in CHAIN_PARTS for c in g.columns}
        shared = {c.name for c in BALANCE_METRICS.columns if c.name not in CHAIN_BALANCE_NAMES}
        columns |= {prefix + n if n in names else n: v for n, v in own.items() if n not in shared}
        balances.append(energy_balance(model, sums.whole))
    with np.errstate(all="ignore"):
        whole = EnergyBalance(*(sum(getattr(b, field.name) for b in balances) for field in fields(EnergyBalance)))
        columns |= columns_of_formulas(BALANCE_METRICS.columns, whole, ~measured)
    steady = [columns[f"{prefix}steady"] for prefix in prefixes]
    unknown = np.any([of.missing for of in steady], axis=0)
    return columns | {"steady": mask_absent(~unknown, np.all([of.values for of in steady], axis=0))}


def metric_blocks(
    ended: VariantEnds[Drive], ends_of_chains: Callable[[NDArray[np.intp]], Sequence[ChainEnds]]
) -> ColumnBlocks:
    """Metric columns of all variants, in blocks of equal columns.

    Args:
        ends_of_chains: ends and sums of each chain of some variants.
    """
    found: ColumnBlocks = []
    for alike in variants_by_columns(ended.drives, ended.stacks):
        for variants in np.split(alike, range(LARGEST_STACK, len(alike), LARGEST_STACK)):
            parts, prefixes = ends_of_chains(variants), ended.drives[variants[0]].chain_prefixes
            alone = len(parts) == 1
            found.append((variants, metrics_of_variants(*parts[0]) if alone else metrics_of_chains(prefixes, parts)))
    return found


def metrics_table(ended: VariantEnds[Drive], blocks: ColumnBlocks, limits: Limits | None = None) -> pa.Table:
    """Metrics table of all variants, judged by limits."""
    count = len(ended.drives)
    known = {"variant": column_of_value(np.arange(count)), "status": column_of_value(np.zeros(count)),
             "reason": column_of_value(np.zeros(count)), **run_columns(ended)}  # fmt: skip
    columns = {name: (of.filled(0), of.missing) for name, of in known.items()}
    places = {name: (-1, place) for place, name in enumerate(columns)}
    for variants, found in blocks:
        kinds = columns_of_metrics(found)
        for place, (name, values) in enumerate(found.items()):
            having = ~values.missing
            if having.any():
                places[name] = min(places.get(name, (count, 0)), (int(variants[having.argmax()]), place))
                if name not in columns:
                    columns[name] = np.zeros(count, kinds[name].kind), np.ones(count, dtype=bool)
                numbers, missing = columns[name]
                numbers[variants[having]] = values.values[having]
                missing[variants[having]] = False
    judged = judge_variants(ended.drives, columns, ended.is_measured, limits, ended.layouts, ended.causes, ended.stacks)
    words = {"status": (judged.status, None), "reason": (judged.reason, None)}
    return _table_of_columns(
        {name: words.get(name) or columns[name] for name in sorted(columns, key=places.__getitem__)}
    )


def table_from_rows(rows: Sequence[Row]) -> pa.Table:
    """Metrics table of rows, with units."""
    names = dict.fromkeys(name for row in dict.fromkeys(map(tuple, rows)) for name in row)  # many have the same
    names.pop("variant", None)
    columns = {name: ([row.get(name) for row in rows], None) for name in names}
    return _table_of_columns({"variant": (range(len(rows)), None), **columns})


def select_metrics(table: pa.Table, rows: Sequence[int | None], wanted: Callable[[str], bool]) -> pa.Table:
    """Metrics table of some rows and columns.

    Columns stand in the order of the first rows that have them.
    """
    import pyarrow as pa

    names = [name for name in table.column_names if name != "variant" and wanted(name)]
    taken = table.select(names).take(pa.array(rows, pa.int64()))
    first: dict[str, int] = {}
    for name in names:
        column = taken[name]
        if column.null_count < len(column):
            first[name] = column.is_valid().index(True).as_py() if column.null_count else 0
    return taken.select(sorted(first, key=first.__getitem__))


def _arrow_column(kind: type, values: Any, missing: NDArray[np.bool_] | None) -> pa.Array:
    """Arrow column of metric values, null where missing."""
    import pyarrow as pa

    arrow = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), str: pa.string()}[kind]
    if kind is str and None not in values:
        words = [word.encode() for word in values]
        ends = np.cumsum([0, *map(len, words)], dtype=np.int32)
        return pa.StringArray.from_buffers(len(words), pa.py_buffer(ends), pa.py_buffer(b"".join(words)))
    if missing is None:
        return pa.array(values, arrow)
    numbers: NDArray[Any] = np.ascontiguousarray(values, dtype=kind)
    held = np.packbits(numbers, bitorder="little") if kind is bool else numbers
    valid = pa.py_buffer(np.packbits(~missing, bitorder="little")) if missing.any() else None
    return pa.Array.from_buffers(arrow, len(numbers), [valid, pa.py_buffer(held)])


def _table_of_columns(columns: Mapping[str, tuple[Any, NDArray[np.bool_] | None]]) -> pa.Table:
    """Metrics table of columns by name, with nulls."""
    known = columns_of_metrics(columns)
    arrays = {name: _arrow_column(known[name].kind, values, mask) for name, (values, mask) in columns.items()}
    return table_with_units(arrays, {name: column.unit for name, column in known.items()})
