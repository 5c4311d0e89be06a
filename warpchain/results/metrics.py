"""The table of metrics: one row a variant, from what the kernels added up over the window.

Which columns there are, and how each is formed, stands in the registry (`results.metric_columns`). Variants whose
drives have the same columns are worked on at once, as arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.drive.batch import LARGEST, Stack, picked
from warpchain.drive.trains import is_free
from warpchain.results.arrow_tables import unit_table
from warpchain.results.batch_means import LEAST_TURNS
from warpchain.results.formulas import STEP, Balance, Drifts, Fields, Judged, Summed, each_of, where
from warpchain.results.judgement import Limits, judge
from warpchain.results.metric_columns import (
    BALANCE,
    DESIGN,
    ENGAGED,
    MEASURED,
    OF_A_CHAIN,
    OF_LINKS,
    SETTLING,
    STEADY,
    Group,
    column_of,
    of_drive,
    same_columns,
    unit_of,
)
from warpchain.results.ripple import slowest_ripple
from warpchain.results.schedule import Schedule, schedule_columns

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]
Columns = dict[str, np.ma.MaskedArray[Any, Any]]
"""Columns (V,) by name, masked where a variant has none."""
Blocks = list[tuple[NDArray[np.int64], Columns]]
"""Numbers of variants whose drives have the same columns, and these."""


@dataclass(frozen=True)
class Ended:
    """Ends of V variants.

    Attributes:
        drives: (V,) the variants.
        schedules: (V,) when they step and are measured.
        steps: (V,) the step that each came to.
        diverged: (V,) whether it was stopped as diverged.
        settled: (V,) "steps" and "residual" of its settling.
        engaged: (V, S) share of the rollers of each sprocket's wrap that are on its teeth at the end, S that of the
            drive with the most sprockets; None where it is not known.
        layouts: (V,) what is wrong with the drives' layouts; None where it is not known.
        settle_force: (V,) largest net force that settling left on a roller [N]; None where it is not known.
        causes: (V,) why it diverged, of `judgement.CAUSES`, "" where it did not; None where it is not known.
        stacks: the drives sorted into kinds, where they are.
    """

    drives: Sequence[Drive]
    schedules: Sequence[Schedule]
    steps: NDArray[np.integer]
    diverged: NDArray[np.bool_]
    settled: NDArray[Any]
    engaged: NDArray[np.float64] | None = None
    layouts: Sequence[Sequence[str]] | None = None
    settle_force: NDArray[np.float64] | None = None
    causes: Sequence[str] | None = None
    stacks: Sequence[Stack] | None = None

    def of(self, variants: NDArray[np.intp]) -> Ended:
        """Some of them."""
        drives, schedules = [self.drives[v] for v in variants], [self.schedules[v] for v in variants]
        return Ended(
            drives,
            schedules,
            self.steps[variants],
            self.diverged[variants],
            self.settled[variants],
            None if self.engaged is None else self.engaged[variants],
            None if self.layouts is None else [self.layouts[v] for v in variants],
            None if self.settle_force is None else self.settle_force[variants],
            None if self.causes is None else [self.causes[v] for v in variants],
            self._stacks_among(variants),
        )

    def each(self, value: Callable[[Drive], Any]) -> NDArray[Any]:
        """(V,) a number of each drive, worked out for all of a stack at once."""
        return each_of(self.drives, self.stacks, value)

    def _stacks_among(self, variants: NDArray[np.intp]) -> list[Stack] | None:
        """Some of the variants, ascending, sorted into kinds and numbered from 0, where kinds are known."""
        if self.stacks is None:
            return None
        number, place = self._places
        mine, found = number[variants], []
        for k in np.unique(mine).tolist():
            members, stack = np.flatnonzero(mine == k), self.stacks[k]
            whole = len(members) == len(stack.members)
            found.append(Stack(members, stack.drive if whole else picked(stack.drive, place[variants[members]])))
        return found

    @cached_property
    def _places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(V,) the stack of each variant, and its place there."""
        number, place = np.zeros((2, len(self.drives)), dtype=np.int64)
        for k, stack in enumerate(self.stacks or ()):
            number[stack.members], place[stack.members] = k, np.arange(len(stack.members))
        return number, place

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """(V,) whether it came to the end of its window."""
        return (self.steps > self.schedule("window_end")) & ~self.diverged

    def schedule(self, field: str) -> NDArray[Any]:
        """(V,) one field of the schedules."""
        return self._columns[field]

    @cached_property
    def _columns(self) -> Mapping[str, NDArray[Any]]:
        return schedule_columns(self.schedules)


def joined(ends: Sequence[Ended], numbers: Sequence[NDArray[np.int64]]) -> Ended:
    """Variants of several groups as all of a run, without what only the metrics of each group are formed of.

    Args:
        ends: groups of which `layouts`, `causes` and `stacks` are known.
        numbers: what the variants of each are called in the run.
    """
    order = np.argsort(np.concatenate(numbers))

    def in_order(each: Sequence[Sequence[Any]]) -> list[Any]:
        values = [value for some in each for value in some]
        return [values[v] for v in order.tolist()]

    return Ended(
        in_order([ended.drives for ended in ends]),
        in_order([ended.schedules for ended in ends]),
        np.concatenate([ended.steps for ended in ends])[order],
        np.concatenate([ended.diverged for ended in ends])[order],
        np.concatenate([ended.settled for ended in ends])[order],
        layouts=in_order([ended.layouts or () for ended in ends]),
        causes=in_order([ended.causes or () for ended in ends]),
        stacks=[
            Stack(mine[stack.members], stack.drive)
            for ended, mine in zip(ends, numbers, strict=True)
            for stack in ended.stacks or ()
        ],
    )


def run_columns(ended: Ended) -> Columns:
    """Columns on whether variants diverged and on the window [s]; every variant has these."""
    step = ended.schedule("step")
    return {
        "diverged": np.ma.asarray(ended.diverged),
        "diverged_time": where(ended.diverged, ended.steps * step),
        "window_start": np.ma.asarray(ended.schedule("window_start") * step),
        "window_end": np.ma.asarray(ended.schedule("window_end") * step),
    }


def measured_columns(ended: Ended, sums: Mapping[str, Any]) -> Columns:
    """Columns formed of the sums of variants of the same columns, as `metrics_of` takes them."""
    columns: Columns = {}
    duration = (ended.schedule("window_end") - ended.schedule("window_start")) * ended.schedule("step")
    links = ended.each(lambda drive: drive.chain.links)
    driver = ended.drives[0].driver
    teeth = ended.each(lambda drive: drive.sprockets[driver].teeth)
    turns = abs(sums["sprocket"]["speed"][:, driver]) * teeth / (2.0 * np.pi * links)
    for prefix, index, group in of_drive(ended.drives[0], MEASURED):
        rows = sums[group.source]
        mine = rows if rows.ndim == 1 else rows[:, index]
        batches = _batches(sums, group, index, links, turns >= LEAST_TURNS)
        summed = Summed(mine, group.weight(mine, duration, links), batches, _tensions(sums, group, index))
        for column in group.columns:
            if column.value:
                columns[prefix + column.name] = where(summed.weight != 0, column.value(summed))
    return columns


def _batches(
    sums: Mapping[str, Any], group: Group, index: int, links: NDArray[np.integer], long: NDArray[np.bool_]
) -> Summed | None:
    """The sums of a group's thing batch by batch, of no weight (nan) where the window is short or there is nothing of
    it; None where they are not noted so.
    """
    noted, durations = sums["batches"]
    if group.source not in noted:
        return None
    rows = noted[group.source]
    mine = rows if group.of == "chain" else Fields(lambda name: rows[name][:, index])
    weight = group.weight(mine, durations, links[:, None])
    return Summed(mine, np.where(long[:, None] & np.isfinite(durations) & (weight > 0), weight, np.nan))


def _tensions(sums: Mapping[str, Any], group: Group, index: int) -> tuple[NDArray[Any], NDArray[np.float64]] | None:
    """Counts of tensions of a group's thing in each bin, and the bins' edges; None where it has none."""
    counts, edges = sums["tension"]
    if group.of == "chain":
        return counts.sum(axis=1), edges
    return (counts[:, index], edges) if group.of == "strand" else None


def drifts_of(ended: Ended, sums: Mapping[str, Any]) -> Drifts:
    """Parts of the window by which variants of the same columns are found steady or not."""
    noted, durations = sums["parts"]
    links = ended.each(lambda drive: drive.chain.links)[:, None]
    weight = noted["chain"]["samples"] * links
    tension = np.where(np.isfinite(durations), noted["chain"]["tension"] / weight, np.nan)
    turned = noted["sprocket"]["speed"]
    turns = np.abs(np.nansum(turned, axis=-1)) / (2.0 * np.pi)
    waves = each_of(ended.drives, ended.stacks, slowest_ripple, turns, np.nansum(durations, axis=-1))
    return Drifts(tension, list(np.moveaxis(turned / durations[:, None], 1, 0)), waves)


def energy_balance(drive: Drive, sums: Mapping[str, Any]) -> Balance:
    """Work done and energy gone over the window, (V,) each; `drive` is any of the variants.

    What prescribes angles and centers, and what supplies oil, does the input work; the loads take the output work.
    """
    chain, sprockets, mounts = sums["chain"], sums["sprocket"], sums["mount"]
    driven = np.array([not is_free(drive, s) for s in range(len(drive.sprockets))])
    contact_work = np.compress(driven, sprockets["contact_work"], axis=1)
    load_work = np.compress(~driven, sprockets["load_work"], axis=1)
    dissipated = chain["dissipated"] + chain["friction"] + sums["contact"]["dissipated"].sum(axis=1)
    supplied, loaded = 0.0, load_work.sum(axis=1)
    if drive.shafts or drive.couplings:
        supplied = sums["shaft"]["motor_work"].sum(axis=1) - sums["coupling"]["led_work"].sum(axis=1)
        loaded = loaded + sums["shaft"]["load_work"].sum(axis=1)
        dissipated = dissipated + sums["coupling"]["dissipated"].sum(axis=1) + sums["coupling"]["slip_loss"].sum(axis=1)
    if drive.arms or drive.tensioners:
        flows = sums["tensioner"]["flows"]
        dissipated = dissipated + sums["arm"]["dissipated"].sum(axis=1) + sums["tensioner"]["dissipated"].sum(axis=1)
        dissipated = dissipated + flows["leak_loss"].sum(axis=1) + flows["valve_loss"].sum(axis=1)
        supplied = supplied + flows["supply_work"].sum(axis=1) + sums["arm"]["work"].sum(axis=1)
        supplied = supplied + sums["tensioner"]["suction_work"].sum(axis=1)
    return Balance(
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


def design_columns(drives: Sequence[Drive], metrics: Columns, stacks: Sequence[Stack] | None = None) -> Columns:
    """Columns that designs are judged by, from the other metrics of variants of the same columns.

    What needs turning sprockets is masked where they stand still. `stacks` are the drives sorted into kinds, where they
    are.
    """
    columns: Columns = {}
    with np.errstate(all="ignore"):
        for prefix, index, group in of_drive(drives[0], DESIGN):
            judged = Judged(drives, stacks, metrics, prefix, index)
            columns |= {prefix + c.name: np.ma.asarray(c.value(judged)) for c in group.columns if c.value}
    return columns


def engaged_columns(ended: Ended) -> Columns:
    """Share of each sprocket's wrap that is on its teeth at the end, of variants of the same columns."""
    if ended.engaged is None:
        return {}
    groups = of_drive(ended.drives[0], ((ENGAGED,),))
    return {prefix + c.name: np.ma.asarray(ended.engaged[:, s]) for prefix, s, group in groups for c in group.columns}


def metrics_of(ended: Ended, sums: Mapping[str, Any]) -> Columns:
    """The metrics of V variants whose drives have the same columns.

    Args:
        sums: "chain" (V,), "strand", "sprocket", "mount" and "slip" (V, S), "contact" (V, S + G), and where there are
            any "arm" (V, A) and "tensioner" (V, T) sums of these alone; "batches" and "parts", those of the first four
            by field with the batches or parts along a last axis, and how long each is (V, batches) [s]; "tension",
            counts in bins (V, S + 1, bins), those of links on no strand last, and the bins' edges (V, bins + 1) [N].
    """
    drive = ended.drives[0]
    with np.errstate(all="ignore"):
        columns = measured_columns(ended, sums)
        drifts = drifts_of(ended, sums)
        columns |= {c.name: np.ma.asarray(c.value(drifts)) for c in STEADY.columns if c.value}
        balance = energy_balance(drive, sums)
        columns |= {c.name: np.ma.asarray(c.value(balance)) for c in BALANCE.columns if c.value}
        known = run_columns(ended) | {STEP: np.ma.asarray(ended.schedule("step"))} | columns
        columns |= design_columns(ended.drives, known, ended.stacks)
    columns |= engaged_columns(ended)
    columns = {name: where(ended.measured, values) for name, values in columns.items()}
    settled = {"settle_steps": ended.settled["steps"], "settle_residual": ended.settled["residual"]}
    if ended.settle_force is not None:
        settled["settle_force"] = ended.settle_force
    names = (column.name for _, _, group in of_drive(drive, ((SETTLING,),)) for column in group.columns)
    return columns | {name: np.ma.asarray(settled[name]) for name in names if name in settled}


Part = tuple[Ended, Mapping[str, Any]]
"""Ends of one chain of some variants, which count as variants then, and their sums as `metrics_of` takes them."""


def metrics_of_chains(drives: Sequence[Drive], parts: Sequence[Part]) -> Columns:
    """The metrics of V variants of the same columns, from those of their chains.

    Those of a chain and of its strands begin with its name. The energy balance is of all chains together, as shafts
    pass on energy from one to another.
    """
    columns: Columns = {}
    balances, measured = [], parts[0][0].measured
    for chain, (ended, sums) in zip(drives[0].chains, parts, strict=True):
        own, drive = metrics_of(ended, sums), ended.drives[0]
        names = {p + c.name for p, _, g in of_drive(drive) if g.of in OF_A_CHAIN for c in g.columns}
        shared = {c.name for c in BALANCE.columns if c.name not in OF_LINKS}
        columns |= {f"{chain.name}.{n}" if n in names else n: v for n, v in own.items() if n not in shared}
        balances.append(energy_balance(drive, sums))
    with np.errstate(all="ignore"):
        whole = Balance(*(sum(getattr(b, field.name) for b in balances) for field in fields(Balance)))
        for c in BALANCE.columns:
            if c.value:
                columns[c.name] = where(measured, c.value(whole))
    steady = [columns[f"{chain.name}.steady"] for chain in drives[0].chains]
    unknown = np.any([np.ma.getmaskarray(of) for of in steady], axis=0)
    return columns | {"steady": where(~unknown, np.all([np.ma.getdata(of) for of in steady], axis=0))}


def metrics_blocks(ended: Ended, parts_of: Callable[[NDArray[np.intp]], Sequence[Part]]) -> Blocks:
    """The metrics of all variants, block by block.

    Args:
        parts_of: gives the chains of variants whose drives have the same columns, by their numbers.
    """
    found: Blocks = []
    for variants in _blocks(same_columns(ended.drives, ended.stacks)):
        parts, drives = parts_of(variants), [ended.drives[v] for v in variants]
        found.append((variants, metrics_of_chains(drives, parts) if len(parts) > 1 else metrics_of(*parts[0])))
    return found


def metrics_table(ended: Ended, blocks: Blocks, limits: Limits | None = None) -> pa.Table:
    """The metrics of all variants; a column stands where the first variant that has one has it among its own.

    Args:
        blocks: of all variants, in any order.
        limits: what the variants are judged by; None takes the defaults.
    """
    count = len(ended.drives)
    known = {"variant": np.ma.arange(count), "status": np.ma.zeros(count), "reason": np.ma.zeros(count)}
    known |= run_columns(ended)
    columns = {name: (values.filled(0), np.ma.getmaskarray(values)) for name, values in known.items()}
    places = {name: (-1, place) for place, name in enumerate(columns)}
    for variants, found in blocks:
        for place, (name, values) in enumerate(found.items()):
            having = ~np.ma.getmaskarray(values)
            if having.any():
                places[name] = min(places.get(name, (count, 0)), (int(variants[having.argmax()]), place))
                if name not in columns:
                    columns[name] = np.zeros(count, _kind(name)), np.ones(count, dtype=bool)
                numbers, missing = columns[name]
                numbers[variants[having]] = values.data[having]
                missing[variants[having]] = False
    judged = judge(ended.drives, columns, ended.measured, limits, ended.layouts, ended.causes, ended.stacks)
    words = {"status": (judged.status, None), "reason": (judged.reason, None)}
    return _table({name: words.get(name) or columns[name] for name in sorted(columns, key=places.__getitem__)})


def _blocks(kinds: Iterable[NDArray[np.int64]]) -> Iterator[NDArray[np.int64]]:
    """Variants of a kind, at most `LARGEST` at a time, so that what is worked on stays in the processor's caches."""
    for variants in kinds:
        yield from np.split(variants, range(LARGEST, len(variants), LARGEST))


def table_of(rows: Sequence[Row]) -> pa.Table:
    """A pyarrow table of rows; a column that a row lacks is null there, and its field says its unit."""
    names = dict.fromkeys(name for row in dict.fromkeys(map(tuple, rows)) for name in row)  # many have the same
    names.pop("variant", None)
    columns = {name: ([row.get(name) for row in rows], None) for name in names}
    return _table({"variant": (range(len(rows)), None), **columns})


def gathered(table: pa.Table, rows: Sequence[int | None], wanted: Callable[[str], bool]) -> pa.Table:
    """Some columns of some rows of a table, null where there is none: what `table_of` makes of these rows.

    A column in which none of them has a value is left out, and so is "variant"; the others stand in the order in which
    the rows come that have one first.
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


def _kind(name: str) -> type:
    """Type of a column's values."""
    known = column_of(name)
    return known.kind if known else float


def _column(kind: type, values: Any, missing: NDArray[np.bool_] | None) -> pa.Array:
    """Values of a kind as a column, null where they are missing.

    They go in as they lie in memory: `pyarrow.array` would load pandas, wherever that is installed.
    """
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


def _table(columns: Mapping[str, tuple[Any, NDArray[np.bool_] | None]]) -> pa.Table:
    """Columns, and where they are null, as a table."""
    arrays = {name: _column(_kind(name), values, mask) for name, (values, mask) in columns.items()}
    return unit_table(arrays, {name: unit_of(name) for name in columns})
