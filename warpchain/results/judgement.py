"""Limits that a run's metrics are held against, and the status and reason of each variant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from warpchain.assembly.strength import YIELD
from warpchain.drive.schema import Part, Value
from warpchain.drive.stack_math import maximum
from warpchain.model.stacks import Stack
from warpchain.results.metric_formulas import number_of_each_drive
from warpchain.results.statuses import DIVERGED, OK, SUSPECT, common_reasons, reason_of_count

if TYPE_CHECKING:
    from warpchain.drive import Chain, Drive

WELL_KEPT_SHARE = 0.5
MOST_NAMED = 6
MOST_REASONS = 3

Limit = Annotated[
    float, Field(strict=True, ge=0.0, allow_inf_nan=True), Value("must be a number of at least 0, or inf")
]
START_ENERGY_CHANGE = 0.5
"""Energy change over losses in a start's window."""
LimitShare = Annotated[float, Field(strict=True, ge=0.0, le=1.0), Value("must be a number from 0 to 1")]


class Limits(Part):
    """Limits within which a variant is ok. An upper limit of inf, and a lower one of 0, judges nothing.

    Attributes:
        energy_residual: what the energy balance misses, over the energy turned over.
        energy_change: change of the drive's energy over the window, over the losses: large in a start.
        settle_residual: net force that settling left on a roller, over the largest link force of the window.
        breaking_load: largest link tension, over the breaking load of the catalogue's chain (`chain.size`); from 0.7 on
            links yield and stay longer.
        compression: largest force with which a link of a strand pushes, over the largest link tension.
        mean_compression: mean force with which a strand pushes, over the largest link tension.
        resolution: least number of steps in the shortest time of friction and ramps (`results.step_resolution`).
        joint_give: tension that the give of joints that stick stands for, over a strand's 99.9 % tension, in a start.
        start: change of the mean tension over a window after a ramp of the driver, over that mean: swings of the start.
        slips: teeth that the chain jumped on a sprocket.
        missed: rollers that came at a guide-bar other than through its face.
        engaged: least number of rollers on a sprocket at the end, over those of the wrap it was assembled with.
        valve_float: share of time for which a valve's follower would lift off its cam.
        layout: strands that cross, guide-bars that cut through the chain or dent it by more than a pitch.
    """

    energy_residual: Limit = 0.01
    energy_change: Limit = START_ENERGY_CHANGE
    settle_residual: Limit = 0.01
    breaking_load: Limit = YIELD
    compression: Limit = 1.0
    mean_compression: Limit = 0.01
    resolution: Limit = 45.0
    joint_give: Limit = 0.05
    start: Limit = 0.07
    slips: Limit = 0.0
    missed: Limit = 0.0
    engaged: LimitShare = 0.5
    valve_float: Limit = 0.0
    layout: Limit = 0.0

    @classmethod
    def _source(cls) -> str:
        return "limits"

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        return "-"  # also in %


NumberOfEach = Callable[..., NDArray[np.float64]]
"""Function that gives a number of each drive (V,)."""
ColumnValues = tuple[NDArray[Any], NDArray[np.bool_]]
"""Values of a metric column (V,), and nulls."""


@dataclass(frozen=True)
class LimitRule:
    """Rule of a limit: metric column, scale and words."""

    key: str  # field of `Limits`
    column: str  # metric held against the limit
    unit: str  # of the limit, for documents
    text: Callable[[str, float], str]  # reason, from the part's name ("" for the chain) and the value
    advice: str  # what to change
    part: str = ""  # "STRAND", "SPROCKET", "GUIDE", "PART", or "" for the chain
    is_lower: bool = False  # whether the limit is a lower one
    size: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.abs
    scale: Callable[[NumberOfEach, Mapping[str, ColumnValues], str], NDArray[np.float64]] | None = None
    after_start: bool = False  # whether drives with `run.start` are exempt
    order: int = 0  # power of the step that the column goes by, or 0

    def reason_text(self, of: str, value: float, limit: float) -> str:
        """Reason of a variant whose value is beyond the limit."""
        step = ""
        if self.order and limit > 0.0:
            step = (
                f" at this step, but little at {WELL_KEPT_SHARE * (limit / abs(value)) ** (1.0 / self.order):.2g} of it"
            )
        return f"{self.text(of, value)}{step}: {self.advice}"

    @property
    def column_name(self) -> str:
        """Name of the limit's metric column in documents."""
        return f"{self.part}.{self.column}" if self.part else self.column


def _number_of_prefix_chain(each: NumberOfEach, of: str, value: Callable[[Chain], Any]) -> NDArray[np.float64]:
    """Number (V,) of the chain that a metric column names."""
    name = of.partition(".")[0]

    def number_of_drive(drive: Drive) -> Any:
        """Value of a drive's chain, nan without one."""
        chains = dict(zip(drive.chain_prefixes, drive.each_chain, strict=True))
        chain = chains.get("", chains.get(f"{name}."))
        found = None if chain is None else value(chain)
        return np.nan if found is None else found

    return each(number_of_drive)


def breaking_loads(each: NumberOfEach, columns: Mapping[str, ColumnValues], of: str) -> NDArray[np.float64]:
    """Breaking load (V,) [N] of a column's chain."""
    return _number_of_prefix_chain(each, of, lambda chain: chain.breaking_load)


LEAST_STRETCH = 1e-9
"""Stretch of a link without force [m]."""


def least_link_forces(each: NumberOfEach, of: str) -> NDArray[np.float64]:
    """Least force (V,) [N] that counts as a link's."""
    return LEAST_STRETCH * _number_of_prefix_chain(each, of, lambda chain: chain.stiffness)


def largest_link_tensions(each: NumberOfEach, columns: Mapping[str, ColumnValues], of: str) -> NDArray[np.float64]:
    """Largest link tension (V,) [N] in the window."""
    before = "".join(of.rpartition(".")[:2])  # the chain's, of a strand
    least, name = least_link_forces(each, of), f"{before}tension_max"
    return np.maximum(columns[name][0], least) if name in columns else np.full_like(least, np.nan)


def largest_link_forces(each: NumberOfEach, columns: Mapping[str, ColumnValues], of: str) -> NDArray[np.float64]:
    """Largest link force (V,) [N] in the window, pull or push."""
    names = (f"{of}.{name}" if of else name for name in ("tension_min", "tension_max"))
    ends, least = [np.abs(columns[name][0]) for name in names if name in columns], least_link_forces(each, of)
    largest = np.max(ends, axis=0) if ends else np.zeros_like(least)
    return np.where(largest > 0.0, np.maximum(largest, least), np.nan)


def has_table_change(drive: Drive, begin: Any, end: Any) -> Any:
    """Whether a drive's tables change between two times [s]."""
    changes = [_has_change_between(*table, begin, end) for table in _tables_over_time(drive)]
    return np.any(changes, axis=0) if changes else False


def _tables_over_time(drive: Drive) -> Iterator[tuple[Any, Any]]:
    """Times [s] and values of each table in a drive."""
    parts: list[Any] = [*drive.sprockets, *drive.shafts]
    held = [
        _attribute_or_none(of, "table")
        for part in parts
        for of in (part.load, part.prescribed, _attribute_or_none(part, "motor"))
    ]
    held += [_attribute_or_none(coupling.clutch, "table") for coupling in drive.couplings]
    held += [_attribute_or_none(tensioner.oil, "supply_table") for tensioner in drive.tensioners]
    yield from ((table.over, table.values) for table in held if table is not None and table.time is not None)
    ratios = (coupling.ratios for coupling in drive.couplings)
    yield from ((of.time, of.ratio) for of in ratios if of is not None)
    places = [
        *(_attribute_or_none(sprocket.mount, "table") for sprocket in drive.sprockets),
        *(arm.pivot_table for arm in drive.arms),
    ]
    for table in (table for table in places if table is not None):
        yield from ((table.time, column) for column in (table.x, table.y) if column is not None)


def _attribute_or_none(part: Any, name: str) -> Any:
    """Attribute of a drive's part, or None."""
    return getattr(part, name, None)


def _has_change_between(over: Any, values: Any, begin: Any, end: Any) -> Any:
    """Whether a table changes between two times [s]."""
    time, value = np.asarray(over, dtype=float), np.asarray(values, dtype=float)
    changes = np.append(0, np.cumsum(value[1:] != value[:-1]))
    first, last = np.searchsorted(time, begin, side="right") - 1, np.searchsorted(time, end)
    return changes[np.maximum(first, 0)] != changes[np.minimum(last, len(value) - 1)]


def _longest_ramp_time(drive: Drive) -> Any:
    """Longest ramp time [s] of a drive's motions, or 0."""
    motions = [*(of.prescribed for of in drive.sprockets), *(of.prescribed for of in drive.shafts)]
    return maximum(0.0, *(motion.ramp_time for motion in motions if motion))


def mean_tensions_after_ramp(each: NumberOfEach, columns: Mapping[str, ColumnValues], of: str) -> NDArray[np.float64]:
    """Mean tension (V,) [N] after a ramp, else nan."""
    ramps, name = each(_longest_ramp_time), f"{of}.tension_mean" if of else "tension_mean"
    if name not in columns:
        return np.full_like(ramps, np.nan)
    mean, begin, end = columns[name][0], columns["window_start"][0], columns["window_end"][0]
    ramped = (ramps > 0.0) & (begin >= ramps) & (each(has_table_change, begin, end) == 0.0)
    return np.where(ramped, np.maximum(np.abs(mean), least_link_forces(each, of)), np.nan)


def start_window_ones(each: NumberOfEach, columns: Mapping[str, ColumnValues], of: str) -> NDArray[np.float64]:
    """Ones (V,) for windows of a start, else nan."""
    change, null = columns.get("energy_change_relative", (np.zeros_like(columns["diverged_time"][0]), False))
    return np.where((np.abs(change) > START_ENERGY_CHANGE) & ~np.asarray(null), 1.0, np.nan)


LIMIT_RULES = (
    LimitRule(
        "energy_residual",
        "energy_residual_relative",
        "of the energy turned over",
        lambda of, value: f"energy residual {100.0 * value:+.2g} % of the energy turned over",
        "take a smaller step (run.step), a higher impact_speed_floor, or float64",
    ),
    LimitRule(
        "energy_change",
        "energy_change_relative",
        "of the losses",
        lambda of, value: (
            f"the drive's energy changes by {100.0 * value:+{'.2g' if abs(value) < 1.0 else '.0f'}} % of the losses"
        ),
        "take a longer run or a later window, after the start, or for a start itself run.start = true",
        after_start=True,
    ),
    LimitRule(
        "settle_residual",
        "settle_force",
        "of the largest link force",
        lambda of, value: f"settling left a net force of {value:.2g} of the largest link force",
        "make the chain fit more closely (warpchain fit), or take run.settle = false and a later window",
        scale=largest_link_forces,
    ),
    LimitRule(
        "breaking_load",
        "tension_max",
        "of the chain's breaking load",
        lambda of, value: (
            f"largest tension {value:.2g} of the chain's breaking load, "
            + ("at which it breaks" if value >= 1.0 else f"of which links yield from {YIELD:g} on and stay longer")
        ),
        "take a stronger chain.size, less load, a longer ramp_time, or a smaller step (run.step)",
        scale=breaking_loads,
    ),
    LimitRule(
        "compression",
        "tension_min",
        "of the largest tension",
        lambda of, value: f"{of}: a link pushes with {-value:.2g} of the largest tension",
        "take more preload (warpchain fit), a longer ramp_time, or a smaller step (run.step)",
        part="STRAND",
        size=np.negative,
        scale=largest_link_tensions,
    ),
    LimitRule(
        "mean_compression",
        "tension_mean",
        "of the largest tension",
        lambda of, value: f"{of}: pushes in the mean, with {-value:.2g} of the largest tension, which no chain does",
        "take more preload (warpchain fit), less load, or a later window",
        part="STRAND",
        size=np.negative,
        scale=largest_link_tensions,
    ),
    LimitRule(
        "resolution",
        "resolution",
        "steps",
        lambda of, value: f"{of}: only {value:.2g} steps in the shortest time of its friction or ramp",
        "take a smaller step (run.step), less friction, or a longer ramp_time",
        is_lower=True,
        part="PART",
    ),
    LimitRule(
        "joint_give",
        "joint_give",
        "of the 99.9 % tension, in a start",
        lambda of, value: f"{of}: joints that stick give way by {100.0 * value:.2g} % of its tension_q999",
        "take a smaller step (run.step), or less friction in the joints",
        part="STRAND",
        scale=start_window_ones,
        order=2,
    ),
    LimitRule(
        "start",
        "tension_drift",
        "of the mean tension, after a ramp",
        lambda of, value: f"the mean tension changes by {100.0 * value:+.2g} % in the window: the start still swings",
        "take a longer ramp_time, or a longer run and a later window, or for a start itself run.start = true",
        scale=mean_tensions_after_ramp,
        after_start=True,
    ),
    LimitRule(
        "slips",
        "slips",
        "teeth",
        lambda of, value: f"{of}: slipped by {abs(value):g} teeth",
        "take more preload (warpchain fit), more wrap, less load, or a longer ramp_time",
        part="SPROCKET",
    ),
    LimitRule(
        "missed",
        "missed",
        "rollers",
        lambda of, value: f"{of}: missed by {value:g} rollers",
        "move or lengthen the guide-bar, or take more preload or a smaller step (run.step)",
        part="GUIDE",
    ),
    LimitRule(
        "engaged",
        "engaged",
        "of the rollers of the assembled wrap",
        lambda of, value: f"{of}: only {100.0 * value:.0f} % of its wrap is on its teeth at the end",
        "take more preload (warpchain fit), less load, or a longer ramp_time",
        is_lower=True,
        part="SPROCKET",
    ),
    LimitRule(
        "valve_float",
        "valve_float",
        "of the time",
        lambda of, value: f"{of}: followers would lift off their cams for {100.0 * value:.2g} % of the time",
        "take more spring.preload or stiffness, less mass, a profile with longer flanks, or less speed",
        part="VALVES",
    ),
)

TORN_CAUSE = "torn"
DIVERGENCE_CAUSES = {
    TORN_CAUSE: "take a smaller step (run.step) or a higher impact_speed_floor",
    "left": "its chain came off and left the drive, whole: take more preload (warpchain fit), more wrap, less load, or "
    "a longer ramp_time",
    "center": "the center of a sprocket left the drive: take a stiffer mount, less preload of it, or less load",
    "settling": "settling found no equilibrium: make the chain fit more closely (warpchain fit), or take "
    "run.settle = false and a later window",
}
UNMEASURED_REASON = "ended before its window for metrics was over"


@dataclass(frozen=True)
class Judgement:
    """Judgement of V variants: status and reason.

    Attributes:
        status: (V,) of `statuses.STATUSES`.
        reason: (V,) why, "" where ok.
    """

    status: list[str]
    reason: list[str]


def judge_variants(
    drives: Sequence[Drive],
    columns: Mapping[str, ColumnValues],
    measured: NDArray[np.bool_],
    limits: Limits | None = None,
    layouts: Sequence[Sequence[str]] | None = None,
    causes: Sequence[str] | None = None,
    stacks: Sequence[Stack[Drive]] | None = None,
) -> Judgement:
    """Judgement of V variants by their metrics.

    Args:
        columns: metrics by name, "diverged" and "diverged_time" [s] among them.
        measured: (V,) which came to the end of their window.
        layouts: (V,) faults of each drive's layout.
        causes: (V,) of `DIVERGENCE_CAUSES`, or "".
    """
    limits = limits or Limits()
    found: dict[int, list[str]] = {}
    if layouts is not None:
        for v, layout in enumerate(layouts):
            if layout and len(layout) > limits.layout:
                found[v] = list(layout)
    diverged, _ = columns["diverged"]
    times, _ = columns["diverged_time"]
    for v in np.flatnonzero(diverged).tolist():
        end = "" if v in found else f": {DIVERGENCE_CAUSES[causes[v] if causes else TORN_CAUSE]}"
        found.setdefault(v, []).insert(0, f"diverged at {times[v]:.4g} s{end}")
    for v in np.flatnonzero(~measured & ~diverged.astype(bool)).tolist():
        found.setdefault(v, []).append(UNMEASURED_REASON)
    for v, name in _first_nonfinite_columns(drives, columns).items():
        if not diverged[v]:
            found.setdefault(v, []).append(f"{name} is not finite: {DIVERGENCE_CAUSES[TORN_CAUSE]}, or less load")
    for v, reasons in _reasons_beyond_limits(drives, stacks, columns, limits).items():
        if not diverged[v]:
            found.setdefault(v, []).extend(reasons)
    status, reason = [OK] * len(drives), [""] * len(drives)
    for v, reasons in found.items():
        status[v] = DIVERGED if diverged[v] else SUSPECT
        reason[v] = "; ".join(reasons)
    return Judgement(status, reason)


def _reasons_beyond_limits(
    drives: Sequence[Drive], stacks: Sequence[Stack[Drive]] | None, columns: Mapping[str, ColumnValues], limits: Limits
) -> dict[int, list[str]]:
    """Reasons (rule, column, text) of metrics beyond limits, by variant."""
    found: dict[int, list[tuple[int, str, str]]] = {}
    prefixes = {prefix for drive in drives for prefix in drive.chain_prefixes}
    each = partial(number_of_each_drive, drives, stacks)
    starts = each(lambda drive: drive.run.start) != 0.0
    parts_by_column: dict[str, list[str]] = {}
    for name in columns:
        of, _, column = name.rpartition(".")
        parts_by_column.setdefault(column, []).append(of)
    for r, rule in enumerate(LIMIT_RULES):
        limit = float(getattr(limits, rule.key))
        if limit == (0.0 if rule.is_lower else np.inf):
            continue
        for of in parts_by_column.get(rule.column, ()):
            name = f"{of}.{rule.column}" if of else rule.column
            mine = _is_judged_by_rule(drives, of, rule, prefixes) & ~(rule.after_start & starts)
            if not mine.any():
                continue
            scale = np.ones(len(drives)) if rule.scale is None else rule.scale(each, columns, of)
            values, null = columns[name]
            shares = values / scale
            within = shares >= limit if rule.is_lower else rule.size(shares) <= limit
            for v in np.flatnonzero(mine & ~(within | null | np.isnan(scale)) & np.isfinite(values)).tolist():
                named = f"{of}: " if drives[v].chains and not rule.part and of else ""
                text = f"{named}{rule.reason_text(of, float(shares[v]), limit)}"
                found.setdefault(v, []).append((r, name, text))
    return {v: [text for _, _, text in _reasons_in_column_order(drives[v], of)] for v, of in found.items()}


def _reasons_in_column_order(drive: Drive, reasons: list[tuple[int, str, str]]) -> list[tuple[int, str, str]]:
    """Reasons (rule, column, text) in a drive's order of columns."""
    if len({rule for rule, _, _ in reasons}) == len(reasons):
        return reasons
    places = _column_places(drive)
    return sorted(reasons, key=lambda of: (of[0], places.get(of[1], -1), of[1]))


def _column_places(drive: Drive) -> dict[str, int]:
    """Place of each metric in a drive's table."""
    from warpchain.results.metric_columns import metric_names  # which imports what this module judges

    return {name: place for place, name in enumerate(metric_names(drive))}


def _is_judged_by_rule(drives: Sequence[Drive], of: str, rule: LimitRule, prefixes: set[str]) -> NDArray[np.bool_]:
    """(V,) whether a limit's rule applies to a column."""
    own: bool | NDArray[np.bool_] = of == ""
    if f"{of}." in prefixes:
        own = np.array([f"{of}." in drive.chain_prefixes for drive in drives])
    return np.broadcast_to(np.logical_not(own) if rule.part else own, len(drives))


def _first_nonfinite_columns(drives: Sequence[Drive], columns: Mapping[str, ColumnValues]) -> dict[int, str]:
    """First metric that is not finite, by variant."""
    found: dict[int, list[str]] = {}
    for name, (values, null) in columns.items():
        if values.dtype.kind == "f":
            for v in np.flatnonzero(~np.isfinite(values) & ~null).tolist():
                found.setdefault(v, []).append(name)
    first = {}
    for v, names in found.items():
        places = _column_places(drives[v]) if len(names) > 1 else {}
        first[v] = min(names, key=lambda name: (places.get(name, -1), name))
    return first


def judgement_warning(status: Sequence[str], reason: Sequence[str]) -> str | None:
    """Warning on variants that are neither ok nor merely interrupted, or None."""
    bad = [v for v, word in enumerate(status) if word != OK and reason[v] != UNMEASURED_REASON]
    if not bad:
        return None
    if len(status) == 1:
        return reason[0] if status[0] == DIVERGED else f"suspect: {reason[0]}"
    suspect = sum(status[v] == SUSPECT for v in bad)
    diverged = len(bad) - suspect
    head = f"{suspect or diverged} of {len(status)} variants"
    if suspect:
        head += f" {'is' if suspect == 1 else 'are'} suspect" + (f" and {diverged} diverged" if diverged else "")
    else:
        head += " diverged"
    names = ", ".join(map(str, bad[:MOST_NAMED])) + (
        f" and {len(bad) - MOST_NAMED} more" if len(bad) > MOST_NAMED else ""
    )
    common = common_reasons((status[v], reason[v]) for v in bad)
    lines = [reason_of_count(count, text) for _, text, count in common[:MOST_REASONS]]
    if len(common) == 1:
        lines = [common[0][1] if len(bad) == 1 else f"e.g. {common[0][1]}"]
    more = [f"{len(common) - MOST_REASONS} further reasons"] if len(common) > MOST_REASONS else []
    return f"{head} ({names}): " + "; ".join(lines + more)
