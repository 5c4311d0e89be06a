"""A drive out of each row: values applied to the base drive, parts shifted, then adjusted so that the chain fits.

A sprocket's place on a line, or the number of links, is adjusted for a strain. The strain is that of the strands' links
at assembly; a preload T is the strain T / (k p).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from warpchain.assembly.crossings import assemble_chains
from warpchain.assembly.fitting import drawn_paths, fit_positions, fitted_chain, links_place, nearest_links
from warpchain.assembly.path import MAX_STRAIN
from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive, Guide
from warpchain.drive.replace import Changes, with_numbers
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, StudyError, WarpchainError
from warpchain.progress import raise_if_stopped
from warpchain.study.design.factor_values import evaluate_expression
from warpchain.study.spec.study_tables import named_adjustments
from warpchain.study.store import reason_from_error

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.engine.checkpoint import Kept
    from warpchain.results.run import RunInfo, Trajectory
    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor
    from warpchain.study.spec.study_tables import Adjust

TRAVEL = 4.0
"""Farthest that a sprocket moves either way unless the study says, in pitches."""


Adjusted = tuple[Drive, dict[str, Any]]
"""A drive made to fit, and what was adjusted: number of links, travel [m], as far as asked for, by column."""


def placed(study: Study, base: Drive, row: Mapping[str, Any], changes: Changes | None = None) -> Drive:
    """The drive of a row, before anything is adjusted: values first, then shifts of parts from their places.

    Args:
        study: whose factors say where values go.
        base: the base drive.
        row: values of the factors.
        changes: of the base drive, where many rows are placed.

    Raises:
        DriveError: a value that the drive refuses.
        StudyError: a part that cannot be shifted.
    """
    values = {
        path: _set_value(factor, base.get_value(path) if factor.relative or factor.offset else None, row)
        for factor in study.factors
        for _, path in factor.target_paths()
    }
    drive = base.with_values(values) if changes is None else changes.drive(values)
    for factor in study.factors:
        if factor.shift is not None:
            drive = _shifted(drive, factor, factor.shift, float(row[factor.name]))
    return drive


def _set_value(factor: Factor, own: Any, row: Mapping[str, Any]) -> Any:
    """The value that a factor sets in the drive; whole numbers stay whole."""
    value = factor.value_from_cell(row[factor.name])
    if not (factor.relative or factor.offset):
        return value
    value = own * value if factor.relative else own + value
    return round(value) if isinstance(own, int) else value


def _shifted(drive: Drive, factor: Factor, path: str, by: float) -> Drive:
    """The drive with a guide-bar or a sprocket moved by a distance [m]."""
    part = drive.get_value(path)
    if factor.along is not None and factor.along != "normal":
        x, y = factor.along
    elif isinstance(part, Guide):
        x, y = _normal(drive, part)
    else:
        raise StudyError(f"factors.{factor.name}.along: missing; {path} has no normal")
    size = math.hypot(x, y)
    step = by * x / size, by * y / size
    moved = _guide_moved(part, step) if isinstance(part, Guide) else {"center": _moved_point(part.center, step)}
    return drive.with_values({f"{path}.{name}": value for name, value in moved.items()})


def _moved_point(point: Sequence[float], step: Sequence[float]) -> list[float]:
    """A point [m] by a step [m]."""
    return [point[0] + step[0], point[1] + step[1]]


def _guide_moved(guide: Guide, step: Sequence[float]) -> dict[str, Any]:
    """The values of a guide that change where it is shifted, whatever gives its face."""
    found: dict[str, Any] = {}
    for name in ("start", "end"):
        if (own := getattr(guide, name)) is not None:
            found[name] = _moved_point(own, step)
    for name in ("points", "profile"):
        if (line := getattr(guide, name)) is not None:
            found[name] = [_moved_point(own, step) for own in line]
    if guide.arcs:
        found["arcs"] = [arc.model_dump() | {"center": _moved_point(arc.center, step)} for arc in guide.arcs]
    return found


def _normal(drive: Drive, guide: Guide) -> tuple[float, float]:
    """From the middle of a guide's face towards the chain."""
    profile = drive.profile(drive.as_read.guides.index(guide))
    _, heading = profile.at(0.5 * profile.face_length)
    return -math.sin(heading), math.cos(heading)


def adjusted_all(
    drives: Sequence[Drive], adjusts: Sequence[Adjust], rows: Sequence[Mapping[str, Any]]
) -> list[Adjusted | WarpchainError]:
    """Drives of as many rows made to fit; where one is refused, why.

    A row is refused by a StudyError where no number of links or no place does it, or the wanted strain has no value, by
    a DriveError where the chain's path cannot be drawn.

    Args:
        drives: with the rows' factors in them.
        adjusts: what may move, and what is wanted; done one after the other.
        rows: values of the factors, for expressions.
    """
    found: list[Adjusted | WarpchainError] = [(drive, {}) for drive in drives]
    for key, before, adjust in named_adjustments(adjusts):
        going = [(v, *made) for v, made in enumerate(found) if isinstance(made, tuple)]
        outcomes = _adjusted([drive for _, drive, _ in going], key, adjust, [rows[v] for v, _, _ in going])
        for (v, _, done), outcome in zip(going, outcomes, strict=True):
            if isinstance(outcome, tuple):
                outcome = outcome[0], done | {before + name: value for name, value in outcome[1].items()}
            found[v] = outcome
    return found


def _adjusted(
    drives: Sequence[Drive], key: str, adjust: Adjust, rows: Sequence[Mapping[str, Any]]
) -> list[Adjusted | WarpchainError]:
    """Drives of as many rows made to fit by one adjustment, whose key in study files errors begin with."""
    found: dict[int, Adjusted | WarpchainError] = {}
    strains: dict[int, float] = {}
    for v, (drive, row) in enumerate(zip(drives, rows, strict=True)):
        try:
            strains[v] = _wanted_strain(drive, key, adjust, row)
        except StudyError as error:
            found[v] = error
    counts = _link_counts(drives, key, adjust, strains, found)
    for turn in range(2):
        trying: dict[int, Drive] = {}
        for v in [v for v in counts if turn < len(counts[v]) and not isinstance(found.get(v), tuple)]:
            try:
                trying[v] = _with_links(drives[v], adjust, counts[v][turn])
            except DriveError as error:
                found[v] = error
        moved = _moved(list(trying.values()), key, adjust, [strains[v] for v in trying])
        for v, outcome in zip(trying, moved, strict=True):
            if isinstance(outcome, StudyError):
                found.setdefault(v, outcome)
            else:
                links = counts[v][turn]
                found[v] = outcome[0], outcome[1] if links is None else {"adjusted_links": links, **outcome[1]}
    return [found[v] for v in range(len(drives))]


def _with_links(drive: Drive, adjust: Adjust, links: int | None) -> Drive:
    """The drive with a number of links of the chain that is adjusted; None is its own."""
    if links is None:
        return drive
    return with_numbers(drive, {links_place(drive, fitted_chain(drive, adjust.chain, adjust.sprocket)): links})


def _chain(drive: Drive, adjust: Adjust) -> Drive:
    """The chain that is adjusted, as a drive of its own."""
    own: Drive = fitted_chain(drive, adjust.chain, adjust.sprocket).drive
    return own


def _link_counts(
    drives: Sequence[Drive],
    key: str,
    adjust: Adjust,
    strains: Mapping[int, float],
    refused: dict[int, Any],
) -> dict[int, list[int | None]]:
    """The numbers of links to try, by row; None is the drive's own. Rows without any are refused."""
    if adjust.links is None:
        return {v: [None] for v in strains}
    found: dict[int, list[int | None]] = {}
    for v, path in zip(strains, drawn_paths([_chain(drives[v], adjust) for v in strains]), strict=True):
        if isinstance(path, DriveError):
            refused[v] = path
        elif counts := nearest_links(path, strains[v], odd=adjust.links == "any"):
            found[v] = [*counts[: 1 if adjust.sprocket is None else 2]]
        else:
            refused[v] = StudyError(f"{key}.links: no number of links goes round")
    return found


def _moved(drives: Sequence[Drive], key: str, adjust: Adjust, strains: Sequence[float]) -> list[Adjusted | StudyError]:
    """The drives with their sprockets moved, if one is to be."""
    if adjust.sprocket is None:
        return [(drive, {}) for drive in drives]
    assert adjust.direction is not None  # the table's own rule
    travels = [TRAVEL * _chain(of, adjust).chain.pitch if adjust.travel is None else adjust.travel for of in drives]
    found: list[Adjusted | StudyError] = []
    fitted = fit_positions(drives, adjust.sprocket, adjust.direction, strains, travels)
    for drive, moved in zip(drives, fitted, strict=True):
        if isinstance(moved, DriveError):
            found.append(StudyError(f"{key}: {moved}"))
            continue
        index = [sprocket.name for sprocket in drive.sprockets].index(adjust.sprocket)
        way = [
            there - here
            for here, there in zip(*(d.as_read.sprockets[index].center for d in (drive, moved)), strict=True)
        ]
        along = sum(x * d for x, d in zip(way, adjust.direction, strict=True)) / math.hypot(*adjust.direction)
        found.append((moved, {"adjusted_travel": along}))
    return found


def _wanted_strain(drive: Drive, key: str, adjust: Adjust, row: Mapping[str, Any]) -> float:
    """The wanted strain."""
    name, asked = ("strain", adjust.strain) if adjust.strain is not None else ("preload", adjust.preload)
    try:
        value = evaluate_expression(asked, row) if isinstance(asked, str) else asked
    except StudyError as error:
        raise StudyError(f"{key}.{name} = {value_text(asked)}: {error}") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise StudyError(f"{key}.{name} = {value_text(asked)}: {value_text(value)} is not a finite number")
    chain = _chain(drive, adjust).chain
    strain = float(value) if name == "strain" else value / (chain.mean_stiffness * chain.pitch)
    if abs(strain) > MAX_STRAIN or (name == "preload" and value < 0.0):
        raise StudyError(f"{key}.{name} = {value:g}: a strain of {strain:g}; allowed is within {MAX_STRAIN:g}")
    return strain


@dataclass
class Variant:
    """A row on its way: what it is made of, and what becomes of it.

    Its metrics are a row of the table that `simulate` gave, and those of the base drive's modes beside.
    """

    row: dict[str, Any]
    drive: Drive | None = None
    reason: str | None = None
    copy: int = 0
    adjusted: dict[str, Any] = field(default_factory=dict)
    measured: tuple[pa.Table, int] | None = None
    modes: dict[str, Any] = field(default_factory=dict)
    recorded: bool = False
    trajectory: Trajectory | None = None
    info: RunInfo | None = None
    archive: tuple[str, int] | None = None
    begin: Kept | None = None
    kept: Kept | None = None
    gone_on: bool = False

    def fail(self, error: WarpchainError) -> None:
        """Makes it infeasible."""
        self.drive, self.reason = None, reason_from_error(error)

    @property
    def status(self) -> str:
        """As it is judged, or "infeasible" where it gave no metrics."""
        return "infeasible" if self.measured is None else str(self._judged("status"))

    def outcome(self) -> str | None:
        """Why it is not ok, None where it is."""
        return self.reason if self.measured is None else self._judged("reason") or None

    def _judged(self, column: str) -> Any:
        assert self.measured is not None  # asked for only then
        table, row = self.measured
        return table[column][row].as_py()

    @property
    def metrics(self) -> dict[str, Any]:
        """Its metrics by name; none of a row that gave none."""
        if self.measured is None:
            return {}
        table, row = self.measured
        values = table.slice(row, 1).to_pylist()[0]
        return {name: value for name, value in values.items() if value is not None} | self.modes


def build(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Makes rows' drives, adjusted together; a row that gives none says why."""
    changes = Changes(base) if len(variants) > 1 else None
    for number, variant in enumerate(variants):
        if number % 64 == 0:
            raise_if_stopped()
        if variant.reason is not None:
            continue
        try:
            variant.drive = placed(study, base, variant.row, changes)
        except (DriveError, StudyError) as error:
            variant.fail(error)
    whole = [(variant, variant.drive) for variant in variants if variant.drive is not None]
    rows = [variant.row for variant, _ in whole]
    outcomes = adjusted_all([drive for _, drive in whole], study.adjust, rows)
    for (variant, _), outcome in zip(whole, outcomes, strict=True):
        if isinstance(outcome, WarpchainError):
            variant.fail(outcome)
        else:
            variant.drive, variant.adjusted = outcome


def try_out(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Makes rows' drives; one that cannot be assembled or stepped says why."""
    build(study, base, variants)
    for variant in variants:
        if variant.drive is not None:
            try_alone(study, variant)


def try_alone(study: Study, variant: Variant) -> None:
    """Finds out whether a drive can be assembled and stepped."""
    assert variant.drive is not None  # as chosen
    try:
        resolve_step(variant.drive, study.run.step)
        assemble_chains(variant.drive)
    except DriveError as error:
        variant.fail(error)
