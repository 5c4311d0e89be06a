"""Tooth jump: load or wear at which a chain jumps, by bisection, many values at once, forward and in reverse."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from warpchain.argument_checks import AllowedRange, PositiveNumber, check_arguments
from warpchain.assembly import tooth_hold
from warpchain.assembly.assembly import assemble_chain
from warpchain.drive import Drive
from warpchain.drive.body_ties import nearest_sprocket
from warpchain.drive.catalogue import ELONGATION_AT_BREAKING_LOAD
from warpchain.drive.reversed_drive import reversed_drive
from warpchain.engine.simulation import simulate
from warpchain.errors import DriveError, LayoutWarning, SimulationError, SuspectWarning
from warpchain.model import Model
from warpchain.model.trains import free_body_loads
from warpchain.results.judgement import Limits
from warpchain.results.run import Record

JumpCause = Literal["torque", "wear"]
Direction = Literal["forward", "reverse"]
BOTH: tuple[Direction, ...] = ("forward", "reverse")
UNITS = {"torque": "N m", "wear": "1"}
MOST_WEAR = 0.1
"""Largest wear tried for a tooth jump."""
ESTIMATE_RATIO, ESTIMATE_HALVINGS, LEAST_ESTIMATE = 1.5, 3, 1e-3
"""Ratio, halvings and least part of the range, for estimates."""

Tolerance = Annotated[float, AllowedRange("a number from 1e-4 to 0.5", lambda x: 1e-4 <= x <= 0.5)]
Values = Annotated[int, AllowedRange("a whole number from 1 to 1000", lambda n: 1 <= n <= 1000)]


@dataclass(frozen=True)
class Jump:
    """Tooth jump of a drive in one direction.

    Attributes:
        direction: "forward" or "reverse".
        on: what carries the torque, or the chain that wears.
        own: the drive's own torque [N m] or wear [-].
        holds: largest value without a jump.
        jumps: smallest value with one, or None.
        sprocket: where, if seen.
        tension: largest of any link at `holds` [N].
        tight, slack: means of the strands beside at `holds` [N].
        estimate: where teeth cease to hold at rest, or None.
    """

    direction: Direction
    on: str
    own: float
    holds: float
    jumps: float | None
    sprocket: str | None
    tension: float
    tight: float
    slack: float
    estimate: float | None


@dataclass
class _JumpSearch:
    """Search for a tooth jump in one direction."""

    direction: Direction
    drive: Drive
    low: float
    values: list[float]
    high: float | None = None
    held: tuple[Drive, dict[str, Any]] | None = None
    sprocket: str | None = None
    over: bool = False


@check_arguments(SimulationError)
def find_jumps(
    drive: Drive,
    by: JumpCause = "torque",
    on: str | None = None,
    *,
    directions: Sequence[Direction] = BOTH,
    most: PositiveNumber | None = None,
    tolerance: Tolerance = 0.02,
    values: Values = 8,
    **options: Any,
) -> list[Jump]:
    """Tooth jumps of a drive, one a direction, by running.

    Every round runs `values` values a direction, first up to `most`, then between the last that holds and the first
    that jumps.

    Args:
        by: what grows: a load's constant torque, or a chain's elongation.
        on: sprocket or shaft with that load, by default of most power; or the chain.
        directions: in which the drive runs.
        most: largest value; None is the torque of the breaking load, or a wear of 0.1.
        tolerance: relative; of wear, of the range.
        values: runs of a round and direction.
        options: duration, device, precision, memory, workers, progress of `warpchain.simulate`, and report, called with
            a line after each round.

    Raises:
        DriveError: no such load or chain, or a drive that cannot run in reverse.
        SimulationError: an invalid argument.
    """
    report: Callable[[str], None] = options.pop("report", lambda line: None)
    on, own, limit = _own_and_limit_torque(drive, on) if by == "torque" else _own_and_limit_wear(drive, on)
    most = limit if most is None else most
    first = [most / 2.0**k for k in reversed(range(values))] if by == "torque" else _even_values(own, most, values)
    searches = [
        _JumpSearch(d, drive if d == "forward" else reversed_drive(drive), 0.0 if by == "torque" else own, first)
        for d in directions
    ]
    scale = 0.0 if by == "torque" else abs(most - own)
    while todo := [search for search in searches if not search.over]:
        _run_round(todo, lambda of, value: _changed_drive(of, by, on, value), options)
        for search in todo:
            report(_state_line(search, by))
            if search.high is None or search.high - search.low <= tolerance * max(scale, search.high):
                search.over = True
            search.values = _even_values(search.low, search.high or most, values + 1)[:-1]
    return [_jump_of_search(search, by, on, own, most) for search in searches]


def _even_values(low: float, high: float, count: int) -> list[float]:
    """Values that divide a jump search's range evenly."""
    return np.linspace(low, high, count + 1)[1:].tolist()


def _own_and_limit_torque(drive: Drive, on: str | None) -> tuple[str, float, float]:
    """Name of a load's body, own and chain-breaking torque [N m]."""
    bodies: Sequence[Any] = (*drive.sprockets, *drive.shafts)
    loads = {bodies[b].name: (b, load) for b, load in free_body_loads(drive)}
    if on is not None and on not in loads:
        raise DriveError(f"{on}: has no load; allowed is one of {', '.join(loads) or 'none, as the drive has no load'}")
    if not loads:
        raise DriveError("load: no sprocket or shaft of the drive has one; give one, or search by wear")
    model = Model(drive)
    if on is None:
        speed = model.driver_speed
        turning = {name: abs(_speed_ratio(model, b)) for name, (b, _) in loads.items()}
        on = max(loads, key=lambda name: loads[name][1].steady_moment(turning[name] * speed) * turning[name])
    b, load = loads[on]
    s = nearest_sprocket(drive, b)
    assert s is not None  # every load is tied to a chain
    around, k = model.chain_of_sprocket(s)
    chain = around.chain
    breaking = chain.breaking_load or chain.stiffness * chain.pitch * ELONGATION_AT_BREAKING_LOAD
    return on, load.torque, breaking * around.pitch_radius(k) / (1.0 if b == s else model.speed_ratio(b, s))


def _speed_ratio(model: Model, b: int) -> float:
    """Speed of body b over the driver's."""
    return 1.0 if nearest_sprocket(model.drive, b) is None else model.speed_ratio(b, model.drive.driver)


def _own_and_limit_wear(drive: Drive, on: str | None) -> tuple[str, float, float]:
    """Name of a chain, own elongation, largest that assembles."""
    chains = {chain.name: chain for chain in Model(drive).chains}
    if on is None:
        on = next(iter(chains))
    if on not in chains:
        allowed = (
            f"allowed is one of {', '.join(chains)}" if any(chains) else "the drive has one chain, which has no name"
        )
        raise DriveError(f"{on}: no such chain; {allowed}")
    own, most = float(chains[on].chain.elongation), MOST_WEAR
    while most > own and not _can_assemble(_changed_drive(drive, "wear", on, most)):
        most -= 0.05 * MOST_WEAR
    return on, own, max(most, own + 0.01 * MOST_WEAR)


def _can_assemble(drive: Drive) -> bool:
    """Whether each chain of a drive assembles."""
    try:
        for chain in Model(drive).chains:
            assemble_chain(chain)
    except DriveError:
        return False
    return True


def _changed_drive(drive: Drive, by: str, on: str, value: float) -> Drive:
    """Drive with another torque or wear, for a jump search."""
    if by == "wear":
        return drive.with_values({f"chains.{on}.elongation" if on else "chain.elongation": value})
    kind, place = next(
        (kind, i) for kind in ("shafts", "sprockets") for i, part in enumerate(getattr(drive, kind))
        if part.name == on and part.load is not None
    )  # fmt: skip
    path = f"{kind}.{place}.load.torque"
    return drive.with_values({path: -value if drive.get_value(path) < 0.0 else value})


def _run_round(todo: list[_JumpSearch], changed: Callable[[Drive, float], Drive], options: dict[str, Any]) -> None:
    """Runs a round's values; narrows jump searches."""
    drives = [changed(search.drive, value) for search in todo for value in search.values]
    with warnings.catch_warnings():
        for kind in (SuspectWarning, LayoutWarning):
            warnings.simplefilter("ignore", kind)
        length = options.get("duration") or drives[0].run.duration
        run = simulate(drives, record=Record(variants="none"), window=(0.0, length), **options)
    if run.info.ended != "complete":
        raise KeyboardInterrupt
    rows = iter(zip(drives, run.metrics.to_pylist(), strict=True))
    for search in todo:
        own = [next(rows) for _ in search.values]
        jumped = [jump_in_metrics(drive, row) for drive, row in own]
        first = next((k for k, (found, _) in enumerate(jumped) if found), len(own))
        if first:
            search.low, search.held = search.values[first - 1], own[first - 1]
        if first < len(own):
            search.high = search.values[first]
            search.sprocket = next((where for _, where in jumped[first:] if where is not None), search.sprocket)


def jump_in_metrics(drive: Drive, row: dict[str, Any]) -> tuple[bool, str | None]:
    """Whether the chain jumped, by metrics, and which sprocket."""
    if row["diverged"]:
        return True, None
    names = [sprocket.name for sprocket in drive.sprockets]
    slips, worst = max((row[f"{name}.slips"], name) for name in names)
    engaged, loosest = min((row[f"{name}.engaged"], name) for name in names)
    if slips > 0:
        return True, worst
    return (True, loosest) if engaged < Limits().engaged else (False, None)


def _state_line(search: _JumpSearch, by: str) -> str:
    """Line on the progress of a jump search."""
    unit, low = (" N m", search.low) if by == "torque" else (" %", 100.0 * search.low)
    if search.high is None:
        return f"{search.direction}: holds up to {low:.4g}{unit}"
    high = search.high if by == "torque" else 100.0 * search.high
    return f"{search.direction}: holds at {low:.4g}{unit}, jumps at {high:.4g}{unit}"


def _jump_of_search(search: _JumpSearch, by: str, on: str, own: float, most: float) -> Jump:
    """Tooth jump of a search that has ended."""
    tension = tight = slack = float("nan")
    if search.held is not None:
        drive, row = search.held
        tension = max(row[f"{before}tension_max"] for before in drive.chain_prefixes)
        if search.sprocket is not None:
            slack, tight = sorted(row[f"{name}.tension_mean"] for name in _strands_beside(drive, search.sprocket))
    estimate = None
    if search.high is not None and search.sprocket is not None:
        estimate = _estimated_jump(search, by, on, own, most)
    return Jump(search.direction, on, own, search.low, search.high, search.sprocket, tension, tight, slack, estimate)


def _strands_beside(drive: Drive, name: str) -> list[str]:
    """Names of the two strands beside a sprocket."""
    chain, k = Model(drive).chain_of_sprocket([sprocket.name for sprocket in drive.sprockets].index(name))
    before = f"{chain.name}." if chain.name else ""
    return [f"{before}{chain.strand_names[i]}" for i in (k - 1, k)]


def _estimated_jump(search: _JumpSearch, by: str, on: str, own: float, most: float) -> float | None:
    """Estimated value of the jump at rest, or None."""
    name = search.sprocket

    def has_jump_at_rest(value: float) -> bool:
        """Whether the chain jumps at rest, at this value."""
        for chain in Model(_changed_drive(search.drive, by, on, value)).loaded_chains:
            names = [sprocket.name for sprocket in chain.sprockets]
            if name in names:
                return tooth_hold.has_tooth_jump(chain, names.index(name))
        return False

    begin = 0.0 if by == "torque" else own
    assert search.high is not None
    high = search.high - begin
    if has_jump_at_rest(begin + high):
        while high > LEAST_ESTIMATE * (most - begin) and has_jump_at_rest(begin + high / ESTIMATE_RATIO):
            high /= ESTIMATE_RATIO
    else:
        while not has_jump_at_rest(begin + high):
            if begin + high >= most:
                return None
            high = min(ESTIMATE_RATIO * high, most - begin)
    low = high / ESTIMATE_RATIO
    for _ in range(ESTIMATE_HALVINGS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if has_jump_at_rest(begin + middle) else (middle, high)
    return begin + high
