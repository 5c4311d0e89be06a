"""Today's design: the base drive as it is, as rows of a study, to be compared with other designs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from warpchain.drive import Drive
from warpchain.errors import StudyError, WarpchainError
from warpchain.study.design.design_table import design_table_of_rows
from warpchain.study.design.factor_values import fill_tied_values, tied_factors
from warpchain.study.design.noise_rows import Row, nominal_value
from warpchain.study.results import TODAY_COLUMN
from warpchain.study.run.row_drives import drive_of_row
from warpchain.study.spec import Study

if TYPE_CHECKING:
    import pyarrow as pa


def row_of_drive(study: Study, drive: Drive, name: object) -> dict[str, Any]:
    """Row of design factors' values as they are in a drive.

    Raises:
        StudyError: a factor has no such value.
    """
    study = study.design_study
    given = {
        factor.name: nominal_value(factor, drive) for factor in study.factors if factor.value_source != "expression"
    }
    row = dict(given)
    reason = fill_tied_values(study, tied_factors(study), row)
    for factor in study.factors if reason is None else ():
        if factor.value_source != "expression" and not any(factor.target_paths()) and factor.shift is None:
            reason = f"factor {factor.name} has no place in a drive file, which could not say its value"
        elif not _is_unchanged(study.model_copy(update={"factors": (factor,)}), drive, row):
            reason = reason or f"factor {factor.name} has no value that leaves this drive as it is"
    if reason is not None:
        raise StudyError(f"{name}: {reason}")
    return given


def _is_unchanged(study: Study, drive: Drive, row: dict[str, Any]) -> bool:
    """Whether a row leaves the drive as it is."""
    try:
        return drive_of_row(study, drive, row) == drive
    except WarpchainError:
        return False


def rows_with_today(study: Study, drive: Drive, rows: Sequence[Row], name: object) -> list[dict[str, Any]]:
    """Design rows with today's design marked, or added.

    Raises:
        StudyError: as of `row_of_drive`.
    """
    found = [dict(row) for row in rows]
    if not study.design.today:
        return found
    own = row_of_drive(study, drive, f"{name}: design.today")
    alike = [row for row in found if all(row[factor] == value for factor, value in own.items())]
    for row in alike:
        row[TODAY_COLUMN] = False
    if alike:
        return found
    names = [name for name in study.noise_names if all(name in row for row in found)]
    noise = {tuple(row[name] for name in names): {name: row[name] for name in names} for row in found}
    return [{**row, **own, TODAY_COLUMN: True} for row in noise.values()] + found


def design_with_today(study: Study, drive: Drive, design: pa.Table, name: object) -> pa.Table:
    """Design table with today's design marked, or added."""
    if not study.design.today:
        return design
    given = [factor.name for factor in study.factors if factor.value_source != "expression"]
    return design_table_of_rows(study, rows_with_today(study, drive, design.select(given).to_pylist(), name))
