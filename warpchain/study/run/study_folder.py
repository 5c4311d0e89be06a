"""A study's folder: what is to be run, which shards are done, and how their rows ended.

docs/running-studies.md lists its files. Each appears whole, so that processes can end at any time, and several may work
in one folder.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.errors import StudyError
from warpchain.results.statuses import merge_alike_reasons, sort_by_frequency
from warpchain.study.run.shard_plan import Indices, ShardPlan, check_plan_file, plan_file_name, read_plan, write_plan
from warpchain.study.store import (
    REMEDY_RERUN,
    ROW_STATUSES,
    RowOutcomes,
    check_archive_name,
    read_row_outcomes,
    read_table,
    write_study_text,
    write_table,
)

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.drive import Drive
    from warpchain.study.spec import Study

ARCHIVE_MARK = "study.json"
DRIVE_TEXT_FILE = "drive-text.toml"
REPLICATES_FILE = "replicates.parquet"
RESUMED_COLUMN = "gone_on"
WORST_SHARD = "worst"
RATE_SHARDS = 20
STATUS_REASONS = 3


@dataclass(frozen=True)
class StudyFolder:
    """Folder of a study with its plans, files and shards."""

    path: Path
    rows: int
    plans: tuple[ShardPlan, ...]  # since the study last began anew
    plan_count: int = 1
    earlier_plans: tuple[ShardPlan, ...] = ()  # with another duration or window

    @cached_property
    def study(self) -> Study:
        """Study read from the folder."""
        from warpchain.study.spec import load_study

        return load_study(self.path / plan_file_name("study.toml", self.plan_count - 1))

    @cached_property
    def base_drive(self) -> Drive:
        """Base drive read from the folder."""
        from warpchain.drive import load_drive

        return load_drive(self.path / "drive.toml")

    @property
    def shard_size(self) -> int:
        """Number of runs a shard of the last plan."""
        return self.plans[-1].shard_size

    @property
    def identity(self) -> str:
        """Digest of the folder's last plan, which tables bear."""
        return self.plans[-1].identity

    def check_plugins(self) -> None:
        """Raises StudyError for plug-ins not loaded, or changed."""
        if self.plans[-1].plugins is None:
            return
        from warpchain.drive.plugins import missing_plugins

        missing = missing_plugins(self.plans[-1].plugins)
        if missing is not None:
            raise StudyError(f"{self.path}: was begun with a plug-in that is not here: {missing}; give it (--plugin)")

    @property
    def shard_numbers(self) -> Sequence[int]:
        """Numbers of the folder's shards."""
        return [shard for part in self.plans for shard in part.shard_numbers]

    @property
    def run_count(self) -> int:
        """Number of runs in the folder's shards."""
        return sum(part.run_count for part in self.plans)

    @property
    def copies(self) -> int:
        """Number of runs of each row in the folder."""
        return self.study.design.copies

    def plan_of_shard(self, shard: int) -> ShardPlan:
        """Plan to which a shard of the folder belongs."""
        return next(part for part in self.plans if shard in part.shard_numbers)

    @property
    def results_path(self) -> Path:
        """Path of the study's results table."""
        return self.path / "results.parquet"

    def table_path(self, shard: int | str) -> Path:
        """Path of a shard's table."""
        return self.path / "shards" / f"{shard_name(shard)}.parquet"

    def archive_path(self, shard: int | str) -> Path:
        """Path of a shard's archive."""
        return self.path / "shards" / f"{shard_name(shard)}.mcap"

    @property
    def worst_shard(self) -> str:
        """Name of the last plan's shard of worst variants."""
        return WORST_SHARD if self.plan_count == 1 else f"{WORST_SHARD}.{self.plan_count - 1}"

    @property
    def earlier_worst_shards(self) -> list[tuple[str, str]]:
        """Names and identities of earlier plans' worst-variant shards."""
        first = self.plan_count - len(self.plans)
        numbers = range(first, self.plan_count - 1)
        names = [f"{WORST_SHARD}.{number}" if number else WORST_SHARD for number in numbers]
        return [(name, part.identity) for name, part in zip(names, self.plans, strict=False)]

    def states_path(self, shard: int) -> Path:
        """Path of a shard's table of end states."""
        return self.path / "shards" / f"{shard_name(shard)}.states.parquet"

    def is_done(self, shard: int | str) -> bool:
        """Whether a shard is done: its table is there."""
        return self.table_path(shard).exists()

    def shard_run_count(self, shard: int) -> int:
        """Number of runs in a shard."""
        return self.plan_of_shard(shard).shard_run_count(shard)

    def shard_runs(self, shard: int) -> tuple[Indices, Indices]:
        """Rows and copies of a shard's runs, two arrays."""
        return self.plan_of_shard(shard).shard_runs(shard)

    def read_design(self) -> pa.Table:
        """Design table read from the study's folder."""
        name = plan_file_name("design.parquet", self.plan_count - 1)
        check_plan_file(self.path, self.plans[-1].digests, name)
        table = read_table(self.path / name)
        if table.num_rows != self.rows:
            raise StudyError(f"{self.path / name}: has {table.num_rows} rows, the plan {self.rows}")
        return table

    def read_shard(self, shard: int | str, columns: list[str] | None = None) -> pa.Table:
        """Table of a shard read from the study's folder."""
        path = self.table_path(shard)
        identity = self.plan_of_shard(shard).identity if isinstance(shard, int) else self.identity
        table = read_table(path, columns, identity or None)
        if isinstance(shard, int) and table.num_rows != self.shard_run_count(shard):
            raise StudyError(f"{path}: has {table.num_rows} rows, its shard {self.shard_run_count(shard)}")
        return table

    def read_outcomes(self, shard: int) -> RowOutcomes:
        """Statuses and reasons of a done shard's runs."""
        return read_row_outcomes(
            self.table_path(shard), self.plan_of_shard(shard).identity, self.shard_run_count(shard)
        )

    def write_table(self, path: Path, table: pa.Table, shard: int | None = None) -> None:
        """Writes a study's or a shard's table."""
        if shard is None:
            write_table(path, table, study=self.identity)
        else:
            write_table(
                path, table, study=self.plan_of_shard(shard).identity, note_outcomes=path == self.table_path(shard)
            )

    def archive_mark(self, shard: int | str) -> dict[str, bytes]:
        """Attachment of a shard's archive on study and shard."""
        identity = self.plan_of_shard(shard).identity if isinstance(shard, int) else self.identity
        return {ARCHIVE_MARK: json.dumps({"study": identity, "shard": shard_name(shard)}).encode()}

    def _expected_mark(self, stem: str) -> dict[str, str]:
        """Mark that an archive of this name must bear."""
        identities = dict(self.earlier_worst_shards) | {
            shard_name(shard): self.plan_of_shard(shard).identity for shard in self.shard_numbers
        }
        return {"study": identities.get(stem, self.identity), "shard": shard_name(stem)}

    def check_archive(self, name: str) -> None:
        """Raises StudyError for another study's archive."""
        from warpchain.archive import read_archive

        check_archive_name(name)
        path = self.path / name
        if not self.identity or not path.exists():
            return
        archive = read_archive(path)
        if ARCHIVE_MARK in archive.attachments and json.loads(archive.attachment(ARCHIVE_MARK)) != self._expected_mark(
            path.stem
        ):
            raise StudyError(
                f"{path}: is the archive of another shard, or of another study; {REMEDY_RERUN} without its table"
            )

    def directly_recorded(self) -> frozenset[int]:
        """Numbers of variants that are recorded when first simulated."""
        record = self.study.record
        every = range(0, self.rows, record.every) if record.every is not None else ()
        return frozenset(every) | frozenset(record.variants)


def shard_name(shard: int | str) -> str:
    """Name of a shard's files without ending."""
    return f"{shard:05d}" if isinstance(shard, int) else shard


def make_folder(path: Path, study: Study, drive: Drive, design: pa.Table, shard: int) -> StudyFolder:
    """Study folder made, or opened if there.

    Args:
        shard: runs of a shard in a new folder.

    Raises:
        StudyError: the folder holds another study, or cannot be written.
    """
    from warpchain.drive import dumps_drive
    from warpchain.study.spec import dumps_study

    try:
        (path / "shards").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{path}: cannot be made ({error.strerror or error})") from None
    fixed = study.model_copy(update={"study": study.study.model_copy(update={"drive": "drive.toml"})})
    if not (path / "plan.json").exists():
        write_study_text(path / "study.toml", dumps_study(fixed), keep=True)
        write_study_text(path / "drive.toml", dumps_drive(drive), keep=True)
        write_table(path / "design.parquet", design, keep=True)
        more = {"blocks": [[0, design.num_rows, 0, study.design.copies]]} if study.design.copies > 1 else {}
        write_plan(path, 0, {"rows": design.num_rows, "shard": shard, **more})
    folder = open_folder(path)
    differing = differing_tables(folder.study, fixed)
    if folder.base_drive != drive:
        differing.append("its base drive")
    if study.design.kind == "table" and not differing and folder.read_design() != design:
        differing.append("its design table")
    if differing:
        raise StudyError(f"{path}: holds another study, which differs in {', '.join(differing)}; give another folder, "
                         "or --grow where it is the same with more points, replicates or another window")  # fmt: skip
    return folder


def differing_tables(known: Study, other: Study) -> list[str]:
    """Names of the tables in which two studies differ."""
    differing = [name for name in type(known).model_fields if getattr(known, name) != getattr(other, name)]
    if "run" in differing and known.run.model_copy(update={"shard": other.run.shard}) == other.run:
        differing.remove("run")  # the size of shards is decided already
    return differing


def open_folder(path: Path) -> StudyFolder:
    """Study folder opened.

    Raises:
        StudyError: there is none, or it is damaged.
    """
    parts: list[ShardPlan] = []
    before: list[ShardPlan] = []
    number = 0
    while not number or (path / plan_file_name("plan.json", number)).exists():
        rows, part, restart = read_plan(path, number, parts)
        before = parts if restart else before
        parts = [part] if restart else [*parts, part]
        number += 1
    for name in (plan_file_name("study.toml", number - 1), "drive.toml"):
        check_plan_file(path, part.digests, name)
    return StudyFolder(path, rows, tuple(parts), number, tuple(before))


@dataclass(frozen=True)
class StudyStatus:
    """Status of a study's folder: runs, shards, rate."""

    folder: Path
    counts: Mapping[str, int]  # runs by status, of done shards
    reasons: tuple[tuple[str, int], ...]  # of runs not ok, with numbers, the most frequent
    shards: tuple[int, int]  # (done, all)
    left: int  # runs of the other shards
    rate: float | None  # runs a second of the latest shards; None if these are too few
    table: Path | None
    went_on: tuple[int, int] | None = None  # runs that went on from an earlier end, and that began anew; or None


def study_status(out: str | os.PathLike[str]) -> StudyStatus:
    """Status of a study's folder: runs, shards, rate.

    Raises:
        StudyError: no such folder, or a damaged one.
    """
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shard_numbers if folder.is_done(shard)]
    counts = Counter(dict.fromkeys(ROW_STATUSES, 0))
    reasons: list[tuple[str, str, int]] = []
    for shard in done:
        ended = folder.read_outcomes(shard)
        counts.update(ended.counts)
        reasons += ended.reasons
    table = folder.results_path if folder.results_path.exists() else None
    often = tuple(
        (reason, number) for _, reason, number in sort_by_frequency(merge_alike_reasons(reasons))[:STATUS_REASONS]
    )
    left = folder.run_count - sum(folder.shard_run_count(shard) for shard in done)
    shards = len(done), len(folder.shard_numbers)
    return StudyStatus(
        folder.path, dict(counts), often, shards, left, _variant_rate(folder, done), table, _resumed_counts(folder)
    )


def _variant_rate(folder: StudyFolder, done: Sequence[int]) -> float | None:
    """Runs a second of the latest shards, or None."""
    landed = sorted((folder.table_path(shard).stat().st_mtime, folder.shard_run_count(shard)) for shard in done)[
        -RATE_SHARDS:
    ]
    if len(landed) < 3 or landed[-1][0] <= landed[0][0]:
        return None
    return sum(size for _, size in landed[1:]) / (landed[-1][0] - landed[0][0])


def _resumed_counts(folder: StudyFolder) -> tuple[int, int] | None:
    """Numbers of runs resumed and begun anew, or None."""
    if not folder.earlier_plans:
        return None
    done = [shard for shard in folder.shard_numbers if folder.is_done(shard)]
    flags: list[bool | None] = []
    for shard in done:
        if folder.states_path(shard).exists():
            flags += read_table(folder.states_path(shard), [RESUMED_COLUMN]).column(0).to_pylist()
    runs = sum(folder.shard_run_count(shard) for shard in done)
    return sum(map(bool, flags)), runs - sum(map(bool, flags))
