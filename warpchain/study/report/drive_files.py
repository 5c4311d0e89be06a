"""Recommended designs as drive files beside the report's page, to run and to sign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from warpchain.drive import dumps_drive, load_drive
from warpchain.errors import StudyError
from warpchain.study.optimize.recommend import Recommended, rows_of
from warpchain.study.report.decisions import LETTERS, factor_words
from warpchain.study.results import Results
from warpchain.study.run.row_drives import Variant, build
from warpchain.study.spec import load_study
from warpchain.study.store import write_text


def can_write(folder: str | None) -> bool:
    """Whether a study's folder holds what drive files of its rows are made from."""
    return folder is not None and all((Path(folder) / name).is_file() for name in ("study.toml", "drive.toml"))


def write_drives(folder: str | Path, page: Path, designs: Results, chosen: Sequence[Recommended]) -> list[Path]:
    """Writes recommended designs beside a page: `report-A.toml` of `report.html`; noise factors as in the base drive.

    Args:
        folder: of the study, with its study file and base drive.
        page: the report.
        designs: rows that were compared, or designs over their noise.
        chosen: of these.

    Raises:
        StudyError: a row that gives no drive, or a folder that cannot be written.
    """
    if not chosen:
        return []
    path = Path(folder)
    study, drive = load_study(path / "study.toml"), load_drive(path / "drive.toml")
    made = [Variant(row) for row in rows_of(study, drive, designs, chosen)]
    build(study, drive, made)
    files = []
    for letter, one, variant in zip(LETTERS, chosen, made, strict=False):
        if variant.drive is None:
            raise StudyError(f"design {letter}: {variant.reason}")
        words = ", ".join(factor_words(designs, name, one.row) for name in designs.factors)
        head = f"# Design {letter} of {page.name}, variant {one.variant} of {folder}: {words}\n"
        files.append(page.with_name(f"{page.stem}-{letter}.toml"))
        write_text(files[-1], head.replace("\r", " ") + dumps_drive(variant.drive))
    return files
