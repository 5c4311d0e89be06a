"""Drives of a study's rows: values set in the base drive, parts shifted, then adjusted so that the chain fits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from warpchain.assembly.crossings import assemble_chains
from warpchain.assembly.fitting import fit_positions, fitted_chain, links_place, nearest_links, paths_as_drawn
from warpchain.assembly.path import MAX_STRAIN
from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive, Guide
from warpchain.drive.changed_copies import DriveChanges, drive_with_numbers
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, StudyError, WarpchainError
from warpchain.model import ChainModel, Model
from warpchain.progress import raise_if_stopped
from warpchain.study.design.factor_values import evaluate_expression
from warpchain.study.spec.study_tables import named_adjustments
from warpchain.study.store import reason_from_error

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.engine.checkpoint import VariantState
    from warpchain.results.run import RunInfo, Trajectory
    from warpchain.study.spec import Study
    from warpchain.study.spec.factor import Factor
    from warpchain.study.spec.study_tables import Adjust

DEFAULT_TRAVEL = 4.0
"""Default travel of an adjusted sprocket, in pitches."""


AdjustedDrive = tuple[Drive, dict[str, Any]]
"""Adjusted drive, and its adjustments by column."""


def drive_of_row(study: Study, base: Drive, row: Mapping[str, Any], changes: DriveChanges | None = None) -> Drive:
    """Drive of a study's row, not yet adjusted.

    Args:
        changes: of the base drive, for many rows.

    Raises:
        DriveError: a value that the drive refuses.
        StudyError: a part that cannot be shifted.
    """
    values = {
        path: _target_value(factor, base.get_value(path) if factor.relative or factor.offset else None, row)
        for factor in study.factors
        for _, path in factor.target_paths()
    }
    drive = base.with_values(values) if changes is None else changes.changed_drive(values)
    for factor in study.factors:
        if factor.shift is not None:
            drive = _drive_with_shift(drive, factor, factor.shift, float(row[factor.name]))
    return drive


def _target_value(factor: Factor, own: Any, row: Mapping[str, Any]) -> Any:
    """Value that a factor sets, from the drive's own."""
    value = factor.value_from_cell(row[factor.name])
    if not (factor.relative or factor.offset):
        return value
    value = own * value if factor.relative else own + value
    return round(value) if isinstance(own, int) else value


def _drive_with_shift(drive: Drive, factor: Factor, path: str, by: float) -> Drive:
    """Drive with a guide or sprocket shifted [m]."""
    part = drive.get_value(path)
    if factor.along is not None and factor.along != "normal":
        x, y = factor.along
    elif isinstance(part, Guide):
        x, y = _guide_normal(drive, part)
    else:
        raise StudyError(f"factors.{factor.name}.along: missing; {path} has no normal")
    size = math.hypot(x, y)
    step = by * x / size, by * y / size
    moved = (
        _shifted_guide_values(part, step) if isinstance(part, Guide) else {"center": _shifted_point(part.center, step)}
    )
    return drive.with_values({f"{path}.{name}": value for name, value in moved.items()})


def _shifted_point(point: Sequence[float], step: Sequence[float]) -> list[float]:
    """Point [m] of a shifted part."""
    return [point[0] + step[0], point[1] + step[1]]


def _shifted_guide_values(guide: Guide, step: Sequence[float]) -> dict[str, Any]:
    """Values of a shifted guide's keys."""
    found: dict[str, Any] = {}
    for name in ("start", "end"):
        if (own := getattr(guide, name)) is not None:
            found[name] = _shifted_point(own, step)
    for name in ("points", "profile"):
        if (line := getattr(guide, name)) is not None:
            found[name] = [_shifted_point(own, step) for own in line]
    if guide.arcs:
        found["arcs"] = [arc.model_dump() | {"center": _shifted_point(arc.center, step)} for arc in guide.arcs]
    return found


def _guide_normal(drive: Drive, guide: Guide) -> tuple[float, float]:
    """Unit vector from a guide's face towards the chain."""
    place = drive.as_read.guides.index(guide)
    models = ((model, model.places["guides"]) for model in Model(drive).chains)
    profile = next(model.profile(places.index(place)) for model, places in models if place in places)
    _, heading = profile.at(0.5 * profile.face_length)
    return -math.sin(heading), math.cos(heading)


def adjusted_drives(
    drives: Sequence[Drive], adjusts: Sequence[Adjust], rows: Sequence[Mapping[str, Any]]
) -> list[AdjustedDrive | WarpchainError]:
    """Drives of rows, adjusted so that chains fit, or errors."""
    found: list[AdjustedDrive | WarpchainError] = [(drive, {}) for drive in drives]
    for key, before, adjust in named_adjustments(adjusts):
        going = [(v, *made) for v, made in enumerate(found) if isinstance(made, tuple)]
        outcomes = _drives_with_adjustment(
            [drive for _, drive, _ in going], key, adjust, [rows[v] for v, _, _ in going]
        )
        for (v, _, done), outcome in zip(going, outcomes, strict=True):
            if isinstance(outcome, tuple):
                outcome = outcome[0], done | {before + name: value for name, value in outcome[1].items()}
            found[v] = outcome
    return found


def _drives_with_adjustment(
    drives: Sequence[Drive], key: str, adjust: Adjust, rows: Sequence[Mapping[str, Any]]
) -> list[AdjustedDrive | WarpchainError]:
    """Drives of rows after one adjustment, or errors."""
    found: dict[int, AdjustedDrive | WarpchainError] = {}
    strains: dict[int, float] = {}
    for v, (drive, row) in enumerate(zip(drives, rows, strict=True)):
        try:
            strains[v] = _assembly_strain(drive, key, adjust, row)
        except StudyError as error:
            found[v] = error
    counts = _link_counts_to_try(drives, key, adjust, strains, found)
    for turn in range(2):
        trying: dict[int, Drive] = {}
        for v in [v for v in counts if turn < len(counts[v]) and not isinstance(found.get(v), tuple)]:
            try:
                trying[v] = _drive_with_links(drives[v], adjust, counts[v][turn])
            except DriveError as error:
                found[v] = error
        moved = _drives_with_moved_sprocket(list(trying.values()), key, adjust, [strains[v] for v in trying])
        for v, outcome in zip(trying, moved, strict=True):
            if isinstance(outcome, StudyError):
                found.setdefault(v, outcome)
            else:
                links = counts[v][turn]
                found[v] = outcome[0], outcome[1] if links is None else {"adjusted_links": links, **outcome[1]}
    return [found[v] for v in range(len(drives))]


def _drive_with_links(drive: Drive, adjust: Adjust, links: int | None) -> Drive:
    """Drive whose adjusted chain has `links`, if given."""
    if links is None:
        return drive
    return drive_with_numbers(drive, {links_place(drive, fitted_chain(drive, adjust.chain, adjust.sprocket)): links})


def _adjusted_chain(drive: Drive, adjust: Adjust) -> ChainModel:
    """Model of the chain that is adjusted."""
    return fitted_chain(drive, adjust.chain, adjust.sprocket)


def _link_counts_to_try(
    drives: Sequence[Drive],
    key: str,
    adjust: Adjust,
    strains: Mapping[int, float],
    refused: dict[int, Any],
) -> dict[int, list[int | None]]:
    """Numbers of links to try, by row."""
    if adjust.links is None:
        return {v: [None] for v in strains}
    found: dict[int, list[int | None]] = {}
    for v, path in zip(strains, paths_as_drawn([_adjusted_chain(drives[v], adjust) for v in strains]), strict=True):
        if isinstance(path, DriveError):
            refused[v] = path
        elif counts := nearest_links(path, strains[v], odd=adjust.links == "any"):
            found[v] = [*counts[: 1 if adjust.sprocket is None else 2]]
        else:
            refused[v] = StudyError(f"{key}.links: no number of links goes round")
    return found


def _drives_with_moved_sprocket(
    drives: Sequence[Drive], key: str, adjust: Adjust, strains: Sequence[float]
) -> list[AdjustedDrive | StudyError]:
    """Drives with a moved sprocket, and travel [m], or errors."""
    if adjust.sprocket is None:
        return [(drive, {}) for drive in drives]
    assert adjust.direction is not None  # the table's own rule
    travels = [
        DEFAULT_TRAVEL * _adjusted_chain(of, adjust).chain.pitch if adjust.travel is None else adjust.travel
        for of in drives
    ]
    found: list[AdjustedDrive | StudyError] = []
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


def _assembly_strain(drive: Drive, key: str, adjust: Adjust, row: Mapping[str, Any]) -> float:
    """Strain at assembly [-] that a row wants, or that of its preload."""
    name, asked = ("strain", adjust.strain) if adjust.strain is not None else ("preload", adjust.preload)
    try:
        value = evaluate_expression(asked, row) if isinstance(asked, str) else asked
    except StudyError as error:
        raise StudyError(f"{key}.{name} = {value_text(asked)}: {error}") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise StudyError(f"{key}.{name} = {value_text(asked)}: {value_text(value)} is not a finite number")
    chain = _adjusted_chain(drive, adjust).chain
    strain = float(value) if name == "strain" else value / (chain.mean_stiffness * chain.pitch)
    if abs(strain) > MAX_STRAIN or (name == "preload" and value < 0.0):
        raise StudyError(f"{key}.{name} = {value:g}: a strain of {strain:g}; allowed is within {MAX_STRAIN:g}")
    return strain


@dataclass
class Variant:
    """Variant of a study: row, copy, drive, results."""

    row: dict[str, Any]
    drive: Drive | None = None
    reason: str | None = None
    copy: int = 0
    adjusted: dict[str, Any] = field(default_factory=dict)
    metrics_row: tuple[pa.Table, int] | None = None
    modes: dict[str, Any] = field(default_factory=dict)
    recorded: bool = False
    trajectory: Trajectory | None = None
    info: RunInfo | None = None
    archive: tuple[str, int] | None = None
    initial_state: VariantState | None = None
    final_state: VariantState | None = None
    resumed: bool = False

    def mark_infeasible(self, error: WarpchainError) -> None:
        """Removes the variant's drive, an error as the reason."""
        self.drive, self.reason = None, reason_from_error(error)

    @property
    def status(self) -> str:
        """Status of the variant: as judged, or "infeasible"."""
        return "infeasible" if self.metrics_row is None else str(self._metrics_cell("status"))

    def outcome_reason(self) -> str | None:
        """Reason for which the variant is not ok, or None."""
        return self.reason if self.metrics_row is None else self._metrics_cell("reason") or None

    def _metrics_cell(self, column: str) -> Any:
        """Cell of the variant's row of metrics."""
        assert self.metrics_row is not None  # asked for only then
        table, row = self.metrics_row
        return table[column][row].as_py()

    @property
    def metrics(self) -> dict[str, Any]:
        """Metrics of the variant by name, modes among them."""
        if self.metrics_row is None:
            return {}
        table, row = self.metrics_row
        values = table.slice(row, 1).to_pylist()[0]
        return {name: value for name, value in values.items() if value is not None} | self.modes


def build_drives(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Builds variants' adjusted drives, or notes reasons."""
    changes = DriveChanges(base) if len(variants) > 1 else None
    for number, variant in enumerate(variants):
        if number % 64 == 0:
            raise_if_stopped()
        if variant.reason is not None:
            continue
        try:
            variant.drive = drive_of_row(study, base, variant.row, changes)
        except (DriveError, StudyError) as error:
            variant.mark_infeasible(error)
    whole = [(variant, variant.drive) for variant in variants if variant.drive is not None]
    rows = [variant.row for variant, _ in whole]
    outcomes = adjusted_drives([drive for _, drive in whole], study.adjust, rows)
    for (variant, _), outcome in zip(whole, outcomes, strict=True):
        if isinstance(outcome, WarpchainError):
            variant.mark_infeasible(outcome)
        else:
            variant.drive, variant.adjusted = outcome


def build_and_check_drives(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Builds variants' drives, and checks that they assemble."""
    build_drives(study, base, variants)
    for variant in variants:
        if variant.drive is not None:
            check_variant(study, variant)


def check_variant(study: Study, variant: Variant) -> None:
    """Marks a variant infeasible if its drive cannot run."""
    assert variant.drive is not None  # as chosen
    try:
        resolve_step(variant.drive, study.run.step)
        assemble_chains(Model(variant.drive))
    except DriveError as error:
        variant.mark_infeasible(error)
