"""Which variants to believe: limits that a run is held against, and what becomes of each variant.

A variant is "diverged" where it was stopped as such, "suspect" where something of it is beyond its limit, else "ok". A
new limit is a row of `RULES` and a field of `Limits`; the table in `docs/judged-runs.md` goes by the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from warpchain.drive.batch import Stack
from warpchain.drive.batch_math import largest
from warpchain.drive.schema import Part, Value
from warpchain.results.formulas import each_of
from warpchain.results.statuses import DIVERGED, OK, SUSPECT, common_reasons, reason_words

if TYPE_CHECKING:
    from warpchain.drive import Chain, Drive

WELL = 0.5
"""Of the step that just keeps a limit: what a reason asks for."""
NAMED = 6
"""Most variants that a warning names."""
MOST_REASONS = 3
"""Most reasons that a warning gives."""

Limit = Annotated[
    float, Field(strict=True, ge=0.0, allow_inf_nan=True), Value("must be a number of at least 0, or inf")
]
STARTS = 0.5
"""Change of energy over the losses beyond which a window is one of a start."""
Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0), Value("must be a number from 0 to 1")]


class Limits(Part):
    """Limits within which a variant is ok. An upper limit of inf, and a lower one of 0, judges nothing.

    Attributes:
        energy_residual: what the energy balance misses, over the energy turned over.
        energy_change: what the drive's energy changes by over the window, over the losses: they are those of a start.
        settle_residual: net force that settling left on a roller, over the largest link force of the window.
        breaking_load: largest link tension, over the breaking load of the catalogue's chain (`chain.size`).
        compression: largest force with which a link of a strand pushes, over the largest link tension.
        mean_compression: mean force with which a strand pushes, over the largest link tension.
        resolution: least number of steps in the shortest time of friction and ramps (`results.resolution`).
        joint_give: tension that the give of joints that stick stands for, over a strand's 99.9 % tension, in a start.
        start: change of the mean tension over a window after a ramp of the driver, over that mean: swings of the start.
        slips: teeth that the chain jumped on a sprocket.
        missed: rollers that came at a guide-bar other than through its face.
        engaged: least number of rollers on a sprocket at the end, over those of the wrap it was assembled with.
        valve_float: share of time for which a valve's follower would lift off its cam.
        layout: strands that cross, guide-bars that cut through the chain or dent it by more than a pitch.
    """

    energy_residual: Limit = 0.01
    energy_change: Limit = STARTS
    settle_residual: Limit = 0.01
    breaking_load: Limit = 1.0
    compression: Limit = 1.0
    mean_compression: Limit = 0.01
    resolution: Limit = 45.0
    joint_give: Limit = 0.05
    start: Limit = 0.07
    slips: Limit = 0.0
    missed: Limit = 0.0
    engaged: Share = 0.5
    valve_float: Limit = 0.0
    layout: Limit = 0.0

    @classmethod
    def _source(cls) -> str:
        return "limits"

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        return "-"  # also in %


Each = Callable[..., NDArray[np.float64]]
"""Gives (V,) a number of each drive, of a function of a drive or a stack and of what else there is (`each_of`)."""
Given = tuple[NDArray[Any], NDArray[np.bool_]]
"""Values of a column (V,), and where it is null."""


@dataclass(frozen=True)
class Rule:
    """A limit's column, scale and words.

    Attributes:
        key: field of `Limits`.
        column: what is held against it, a column of the metrics by its own name; "" for the drive itself.
        unit: what the limit is in, for documents.
        text: a reason, from the name of what it is of ("" for the chain) and the value.
        advice: what to change.
        of: whose column it is: "STRAND", "SPROCKET", "GUIDE", "PART", or "" for the chain.
        least: whether the limit is a lower one.
        size: what of a value an upper limit is for.
        over: what a column is taken over, from what gives numbers of the drives, columns (V,) and what stands before
            its name, NaN where there is nothing; left out for 1.
        after_start: whether it is for windows after a start, so that drives with `run.start` are not judged by it.
        order: power of the step that the column goes by, 0 where reasons name no step.
    """

    key: str
    column: str
    unit: str
    text: Callable[[str, float], str]
    advice: str
    of: str = ""
    least: bool = False
    size: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.abs
    over: Callable[[Each, Mapping[str, Given], str], NDArray[np.float64]] | None = None
    after_start: bool = False
    order: int = 0

    def reason(self, of: str, value: float, limit: float) -> str:
        """A reason: what is beyond the limit, the step that keeps it well where that is known, what to change."""
        step = ""
        if self.order and limit > 0.0:
            step = f" at this step, but little at {WELL * (limit / abs(value)) ** (1.0 / self.order):.2g} of it"
        return f"{self.text(of, value)}{step}: {self.advice}"

    @property
    def where(self) -> str:
        """The column's name, for documents."""
        return f"{self.of}.{self.column}" if self.of else self.column


def _of_chain(each: Each, of: str, value: Callable[[Chain], Any]) -> NDArray[np.float64]:
    """(V,) a number of each drive's chain that a column's prefix is of; NaN where there is none."""
    name = of.partition(".")[0]

    def of_drive(drive: Drive) -> Any:
        chains = [chain for chain in drive.chains if chain.name == name] if drive.chains else [drive.chain]
        found = value(chains[0]) if chains else None
        return np.nan if found is None else found

    return each(of_drive)


def breaking_load(each: Each, columns: Mapping[str, Given], of: str) -> NDArray[np.float64]:
    """Breaking load of each drive's chain [N], NaN where it names no size."""
    return _of_chain(each, of, lambda chain: chain.breaking_load)


LEAST_STRETCH = 1e-9
"""Of a link [m]: a force that stretches it by less is none, as in settling (`kernels/integrate.py`)."""


def least_force(each: Each, of: str) -> NDArray[np.float64]:
    """Least that counts as a force of a link [N], NaN where a drive has no such chain."""
    return LEAST_STRETCH * _of_chain(each, of, lambda chain: chain.stiffness)


def largest_pull(each: Each, columns: Mapping[str, Given], of: str) -> NDArray[np.float64]:
    """Largest link tension of the window [N], at least what counts."""
    chain, several, _ = of.rpartition(".")
    least, name = least_force(each, of), f"{chain}.tension_max" if several else "tension_max"
    return np.maximum(columns[name][0], least) if name in columns else np.full_like(least, np.nan)


def largest_tension(each: Each, columns: Mapping[str, Given], of: str) -> NDArray[np.float64]:
    """Largest link force of the window [N], pulling or pushing, at least what counts; NaN where there is none."""
    names = (f"{of}.{name}" if of else name for name in ("tension_min", "tension_max"))
    ends, least = [np.abs(columns[name][0]) for name in names if name in columns], least_force(each, of)
    largest = np.max(ends, axis=0) if ends else np.zeros_like(least)
    return np.where(largest > 0.0, np.maximum(largest, least), np.nan)


def changes_within(drive: Drive, begin: Any, end: Any) -> Any:
    """Whether a table over time changes a motion, load, motor, ratio, clutch, oil supply or place between two times
    [s], which are numbers or (V,) those of a stack's variants.
    """
    changes = [_changes(*table, begin, end) for table in _tables(drive)]
    return np.any(changes, axis=0) if changes else False


def _tables(drive: Drive) -> Iterator[tuple[Any, Any]]:
    """Times [s] and values of all tables over time."""
    parts: list[Any] = [*drive.sprockets, *drive.shafts]
    held = [_of(of, "table") for part in parts for of in (part.load, part.prescribed, _of(part, "motor"))]
    held += [_of(coupling.clutch, "table") for coupling in drive.couplings]
    held += [_of(tensioner.oil, "supply_table") for tensioner in drive.tensioners]
    yield from ((table.over, table.values) for table in held if table is not None and table.time is not None)
    ratios = (coupling.ratios for coupling in drive.couplings)
    yield from ((of.time, of.ratio) for of in ratios if of is not None)
    places = [*(_of(sprocket.mount, "table") for sprocket in drive.sprockets), *(arm.pivot_table for arm in drive.arms)]
    for table in (table for table in places if table is not None):
        yield from ((table.time, column) for column in (table.x, table.y) if column is not None)


def _of(part: Any, name: str) -> Any:
    return getattr(part, name, None)


def _changes(over: Any, values: Any, begin: Any, end: Any) -> Any:
    """Whether a quantity over time, as at its ends beyond them, changes from `begin` to `end`."""
    time, value = np.asarray(over, dtype=float), np.asarray(values, dtype=float)
    changes = np.append(0, np.cumsum(value[1:] != value[:-1]))
    first, last = np.searchsorted(time, begin, side="right") - 1, np.searchsorted(time, end)
    return changes[np.maximum(first, 0)] != changes[np.minimum(last, len(value) - 1)]


def _ramp_time(drive: Drive) -> Any:
    """Time of the longest ramp of a motion [s], 0 of none."""
    motions = [*(of.prescribed for of in drive.sprockets), *(of.prescribed for of in drive.shafts)]
    return largest(0.0, *(motion.ramp_time for motion in motions if motion))


def tension_after_ramp(each: Each, columns: Mapping[str, Given], of: str) -> NDArray[np.float64]:
    """Mean tension of the window of a chain [N], at least what counts; NaN where there is none, where no ramp is
    over before it begins, or where a table over time changes what the drive does within it.
    """
    ramps, name = each(_ramp_time), f"{of}.tension_mean" if of else "tension_mean"
    if name not in columns:
        return np.full_like(ramps, np.nan)
    mean, begin, end = columns[name][0], columns["window_start"][0], columns["window_end"][0]
    ramped = (ramps > 0.0) & (begin >= ramps) & (each(changes_within, begin, end) == 0.0)
    return np.where(ramped, np.maximum(np.abs(mean), least_force(each, of)), np.nan)


def ones_of_starts(each: Each, columns: Mapping[str, Given], of: str) -> NDArray[np.float64]:
    """1 where the window is one of a start, of which each extreme is a single event, NaN elsewhere."""
    change, null = columns.get("energy_change_relative", (np.zeros_like(columns["diverged_time"][0]), False))
    return np.where((np.abs(change) > STARTS) & ~np.asarray(null), 1.0, np.nan)


RULES = (
    Rule(
        "energy_residual",
        "energy_residual_relative",
        "of the energy turned over",
        lambda of, value: f"energy residual {100.0 * value:+.2g} % of the energy turned over",
        "take a smaller step (run.step), a higher impact_speed_floor, or float64",
    ),
    Rule(
        "energy_change",
        "energy_change_relative",
        "of the losses",
        lambda of, value: (
            f"the drive's energy changes by {100.0 * value:+{'.2g' if abs(value) < 1.0 else '.0f'}} % of the losses"
        ),
        "take a longer run or a later window, after the start, or for a start itself run.start = true",
        after_start=True,
    ),
    Rule(
        "settle_residual",
        "settle_force",
        "of the largest link force",
        lambda of, value: f"settling left a net force of {value:.2g} of the largest link force",
        "make the chain fit more closely (warpchain fit), or take run.settle = false and a later window",
        over=largest_tension,
    ),
    Rule(
        "breaking_load",
        "tension_max",
        "of the chain's breaking load",
        lambda of, value: f"largest tension {value:.2g} of the chain's breaking load",
        "take a stronger chain.size, less load, a longer ramp_time, or a smaller step (run.step)",
        over=breaking_load,
    ),
    Rule(
        "compression",
        "tension_min",
        "of the largest tension",
        lambda of, value: f"{of}: a link pushes with {-value:.2g} of the largest tension",
        "take more preload (warpchain fit), a longer ramp_time, or a smaller step (run.step)",
        of="STRAND",
        size=np.negative,
        over=largest_pull,
    ),
    Rule(
        "mean_compression",
        "tension_mean",
        "of the largest tension",
        lambda of, value: f"{of}: pushes in the mean, with {-value:.2g} of the largest tension, which no chain does",
        "take more preload (warpchain fit), less load, or a later window",
        of="STRAND",
        size=np.negative,
        over=largest_pull,
    ),
    Rule(
        "resolution",
        "resolution",
        "steps",
        lambda of, value: f"{of}: only {value:.2g} steps in the shortest time of its friction or ramp",
        "take a smaller step (run.step), less friction, or a longer ramp_time",
        least=True,
        of="PART",
    ),
    Rule(
        "joint_give",
        "joint_give",
        "of the 99.9 % tension, in a start",
        lambda of, value: f"{of}: joints that stick give way by {100.0 * value:.2g} % of its tension_q999",
        "take a smaller step (run.step), or less friction in the joints",
        of="STRAND",
        over=ones_of_starts,
        order=2,
    ),
    Rule(
        "start",
        "tension_drift",
        "of the mean tension, after a ramp",
        lambda of, value: f"the mean tension changes by {100.0 * value:+.2g} % in the window: the start still swings",
        "take a longer ramp_time, or a longer run and a later window, or for a start itself run.start = true",
        over=tension_after_ramp,
        after_start=True,
    ),
    Rule(
        "slips",
        "slips",
        "teeth",
        lambda of, value: f"{of}: slipped by {abs(value):g} teeth",
        "take more preload (warpchain fit), more wrap, less load, or a longer ramp_time",
        of="SPROCKET",
    ),
    Rule(
        "missed",
        "missed",
        "rollers",
        lambda of, value: f"{of}: missed by {value:g} rollers",
        "move or lengthen the guide-bar, or take more preload or a smaller step (run.step)",
        of="GUIDE",
    ),
    Rule(
        "engaged",
        "engaged",
        "of the rollers of the assembled wrap",
        lambda of, value: f"{of}: only {100.0 * value:.0f} % of its wrap is on its teeth at the end",
        "take more preload (warpchain fit), less load, or a longer ramp_time",
        least=True,
        of="SPROCKET",
    ),
    Rule(
        "valve_float",
        "valve_float",
        "of the time",
        lambda of, value: f"{of}: followers would lift off their cams for {100.0 * value:.2g} % of the time",
        "take more spring.preload or stiffness, less mass, a profile with longer flanks, or less speed",
        of="VALVES",
    ),
)
"""Rules on metrics, in the order of reasons."""

TORN = "torn"
CAUSES = {
    TORN: "take a smaller step (run.step) or a higher impact_speed_floor",
    "left": "its chain came off and left the drive, whole: take more preload (warpchain fit), more wrap, less load, or "
    "a longer ramp_time",
    "center": "the center of a sprocket left the drive: take a stiffer mount, less preload of it, or less load",
    "settling": "settling found no equilibrium: make the chain fit more closely (warpchain fit), or take "
    "run.settle = false and a later window",
}
"""Causes for a variant to diverge, where it is not its step alone, and what to do about it."""
UNMEASURED = "ended before its window for metrics was over"


@dataclass(frozen=True)
class Judgement:
    """Statuses of V variants, and why.

    Attributes:
        status: (V,) of `statuses.STATUSES`.
        reason: (V,) why, "" where ok.
    """

    status: list[str]
    reason: list[str]


def judge(
    drives: Sequence[Drive],
    columns: Mapping[str, Given],
    measured: NDArray[np.bool_],
    limits: Limits | None = None,
    layouts: Sequence[Sequence[str]] | None = None,
    causes: Sequence[str] | None = None,
    stacks: Sequence[Stack] | None = None,
) -> Judgement:
    """Judges V variants by their metrics.

    Args:
        drives: the variants.
        columns: their metrics by name; those that a rule does not find are not judged by it. Of `diverged` variants
            "diverged" and "diverged_time" [s] say when.
        measured: (V,) which came to the end of their window.
        limits: None takes the defaults.
        layouts: (V,) what is wrong with each drive's layout (`assembly.layout.findings`); None judges none.
        causes: (V,) which of `CAUSES` made it diverge, "" where it did not; None takes the step for it.
        stacks: the drives sorted into kinds, where they are.
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
        end = "" if v in found else f": {CAUSES[causes[v] if causes else TORN]}"
        found.setdefault(v, []).insert(0, f"diverged at {times[v]:.4g} s{end}")
    for v in np.flatnonzero(~measured & ~diverged.astype(bool)).tolist():
        found.setdefault(v, []).append(UNMEASURED)
    for v, name in _not_finite(drives, columns).items():
        if not diverged[v]:
            found.setdefault(v, []).append(f"{name} is not finite: {CAUSES[TORN]}, or less load")
    for v, reasons in _beyond(drives, stacks, columns, limits).items():
        if not diverged[v]:
            found.setdefault(v, []).extend(reasons)
    status, reason = [OK] * len(drives), [""] * len(drives)
    for v, reasons in found.items():
        status[v] = DIVERGED if diverged[v] else SUSPECT
        reason[v] = "; ".join(reasons)
    return Judgement(status, reason)


def _beyond(
    drives: Sequence[Drive], stacks: Sequence[Stack] | None, columns: Mapping[str, Given], limits: Limits
) -> dict[int, list[str]]:
    """Reasons of each variant, by its number: rule by rule, and in the order of its drive's own columns."""
    found: dict[int, list[tuple[int, str, str]]] = {}
    chains = {chain.name for drive in drives for chain in drive.chains}
    each = partial(each_of, drives, stacks)
    starts = each(lambda drive: drive.run.start) != 0.0
    for r, rule in enumerate(RULES):
        limit = float(getattr(limits, rule.key))
        if limit == (0.0 if rule.least else np.inf):
            continue
        for name in columns:
            of, _, column = name.rpartition(".")
            if column != rule.column:
                continue
            mine = _has_rule(drives, of, rule, chains) & ~(rule.after_start & starts)
            if not mine.any():
                continue
            scale = np.ones(len(drives)) if rule.over is None else rule.over(each, columns, of)
            values, null = columns[name]
            shares = values / scale
            within = shares >= limit if rule.least else rule.size(shares) <= limit
            for v in np.flatnonzero(mine & ~(within | null | np.isnan(scale)) & np.isfinite(values)).tolist():
                named = f"{of}: " if drives[v].chains and not rule.of and of else ""
                text = f"{named}{rule.reason(of, float(shares[v]), limit)}"
                found.setdefault(v, []).append((r, name, text))
    return {v: [text for _, _, text in _in_own_order(drives[v], of)] for v, of in found.items()}


def _in_own_order(drive: Drive, reasons: list[tuple[int, str, str]]) -> list[tuple[int, str, str]]:
    """Reasons (rule, column, text) rule by rule; of one rule in the order of the drive's own columns."""
    if len({rule for rule, _, _ in reasons}) == len(reasons):
        return reasons
    places = _places(drive)
    return sorted(reasons, key=lambda of: (of[0], places.get(of[1], -1), of[1]))


def _places(drive: Drive) -> dict[str, int]:
    """Place of each column among those of the drive's own table."""
    from warpchain.results.metric_columns import metric_names  # which imports what this module judges

    return {name: place for place, name in enumerate(metric_names(drive))}


def _has_rule(drives: Sequence[Drive], of: str, rule: Rule, chains: set[str]) -> NDArray[np.bool_]:
    """(V,) whether a rule's column of this prefix is held against its limit.

    Args:
        of: what stands before the column's name; "" for a drive's only chain.
        chains: names of the chains of all drives that have several.
    """
    own: bool | NDArray[np.bool_] = of == ""
    if of in chains:
        own = np.array([any(chain.name == of for chain in drive.chains) for drive in drives])
    return np.broadcast_to(np.logical_not(own) if rule.of else own, len(drives))


def _not_finite(drives: Sequence[Drive], columns: Mapping[str, Given]) -> dict[int, str]:
    """The first of each variant's own columns, by its number, that has a value which is not finite."""
    found: dict[int, list[str]] = {}
    for name, (values, null) in columns.items():
        if values.dtype.kind == "f":
            for v in np.flatnonzero(~np.isfinite(values) & ~null).tolist():
                found.setdefault(v, []).append(name)
    first = {}
    for v, names in found.items():
        places = _places(drives[v]) if len(names) > 1 else {}
        first[v] = min(names, key=lambda name: (places.get(name, -1), name))
    return first


def warning_text(status: Sequence[str], reason: Sequence[str]) -> str | None:
    """One line on V variants: which are not ok, why, and what to change; None where all are ok.

    A variant whose run was interrupted, and that has nothing else, is left out: who did it knows.
    """
    bad = [v for v, word in enumerate(status) if word != OK and reason[v] != UNMEASURED]
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
    names = ", ".join(map(str, bad[:NAMED])) + (f" and {len(bad) - NAMED} more" if len(bad) > NAMED else "")
    common = common_reasons((status[v], reason[v]) for v in bad)
    lines = [reason_words(count, text) for _, text, count in common[:MOST_REASONS]]
    if len(common) == 1:
        lines = [common[0][1] if len(bad) == 1 else f"e.g. {common[0][1]}"]
    more = [f"{len(common) - MOST_REASONS} further reasons"] if len(common) > MOST_REASONS else []
    return f"{head} ({names}): " + "; ".join(lines + more)
