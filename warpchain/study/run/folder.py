"""A study's folder: what is to be run, decided once, which part of it is done, and how its rows ended.

    study.toml  drive.toml   the study and its base drive, as they were when the folder was made
    drive-text.toml          text of the drive's file, with its comments, which drive files of designs are made of
    design.parquet           a row a variant
    plan.json                how rows are cut into shards, and digests of the files above and of itself
    shards/NNNNN.parquet     inputs and metrics of a shard's rows: it is done when this is there
    shards/NNNNN.mcap        its recorded variants
    shards/NNNNN.states.parquet  states of its runs at the end of their windows, if these are kept
    results.parquet          the whole table, once all shards are done
    replicates.parquet       the same with a row for each run, of a study that runs rows several times

A study that is grown adds study.K.toml, design.K.parquet and plan.K.json, K = 1, 2, ..., and shards with the numbers
that follow; what was there stays as it is.

Every file appears whole, so that a folder can be gone on with after any end of any process. Several processes and
machines may work in one folder. A status is asked for often, so nothing here loads drives or tables without need.
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
from warpchain.results.statuses import alike_reasons, by_frequency
from warpchain.study.run.shard_plan import Numbers, Part, check_file, plan_file, read_plan, write_plan
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

MARK = "study.json"
"""Name of the attachment that says which study and which shard an archive belongs to."""
DRIVE_TEXT = "drive-text.toml"
"""Text of the base drive's file as the user has written it; the drive that is run is drive.toml."""
REPLICATES = "replicates.parquet"
"""The table of all runs, of a study that runs rows several times."""
GONE_ON = "gone_on"
"""Column of a shard's table of states: whether a run went on from the state of one before."""
WORST = "worst"
"""Name of the shard that records the worst variants in a second pass."""
LATEST = 20
"""Shards that the rate of a study is taken from."""
REASONS = 3
"""Most reasons of an outcome."""


@dataclass(frozen=True)
class Folder:
    """A study's folder.

    Attributes:
        path: where it is.
        rows: number of rows of the design.
        parts: what the plans run.
        plans: number of plans.
        before: what ran before the study began anew, with another duration or window.
    """

    path: Path
    rows: int
    parts: tuple[Part, ...]
    plans: int = 1
    before: tuple[Part, ...] = ()

    @cached_property
    def study(self) -> Study:
        """The study.

        Raises:
            StudyError: its file is damaged.
        """
        from warpchain.study.spec import load_study

        return load_study(self.path / plan_file("study.toml", self.plans - 1))

    @cached_property
    def drive(self) -> Drive:
        """Its base drive.

        Raises:
            DriveError: its file is damaged.
        """
        from warpchain.drive import load_drive

        return load_drive(self.path / "drive.toml")

    @property
    def shard(self) -> int:
        """Number of runs of a shard of the last plan; the last one may have fewer."""
        return self.parts[-1].shard

    @property
    def identity(self) -> str:
        """The last plan's digest, which the study's tables bear; "" in folders of earlier versions."""
        return self.parts[-1].identity

    @property
    def shards(self) -> Sequence[int]:
        """Numbers of all shards."""
        return [shard for part in self.parts for shard in part.shards]

    @property
    def runs(self) -> int:
        """Number of runs of all shards: rows, or copies of rows."""
        return sum(part.count for part in self.parts)

    @property
    def copies(self) -> int:
        """Number of runs of each row."""
        return self.study.design.copies

    def part(self, shard: int) -> Part:
        """The part that a shard is of."""
        return next(part for part in self.parts if shard in part.shards)

    @property
    def results(self) -> Path:
        """The whole table's file."""
        return self.path / "results.parquet"

    def table_path(self, shard: int | str) -> Path:
        """A shard's table; it is done when this is there."""
        return self.path / "shards" / f"{shard_name(shard)}.parquet"

    def archive_path(self, shard: int | str) -> Path:
        """The archive of a shard's recorded variants."""
        return self.path / "shards" / f"{shard_name(shard)}.mcap"

    @property
    def worst(self) -> str:
        """Name of the shard that records the worst variants, of the last plan."""
        return WORST if self.plans == 1 else f"{WORST}.{self.plans - 1}"

    @property
    def worst_before(self) -> list[tuple[str, str]]:
        """Names and identities of such shards of the plans before, since it last began anew."""
        first = self.plans - len(self.parts)
        numbers = range(first, self.plans - 1)
        names = [f"{WORST}.{number}" if number else WORST for number in numbers]
        return [(name, part.identity) for name, part in zip(names, self.parts, strict=False)]

    def states_path(self, shard: int) -> Path:
        """States of a shard's runs at the end of their windows, of a study that keeps them."""
        return self.path / "shards" / f"{shard_name(shard)}.states.parquet"

    def done(self, shard: int | str) -> bool:
        """Whether a shard is done."""
        return self.table_path(shard).exists()

    def size(self, shard: int) -> int:
        """Number of runs of a shard."""
        return self.part(shard).size(shard)

    def tasks(self, shard: int) -> tuple[Numbers, Numbers]:
        """Row and copy of each run of a shard."""
        return self.part(shard).tasks(shard)

    def design(self) -> pa.Table:
        """The whole design.

        Raises:
            StudyError: it is missing, damaged, or has another number of rows.
        """
        name = plan_file("design.parquet", self.plans - 1)
        check_file(self.path, self.parts[-1].digests, name)
        table = read_table(self.path / name)
        if table.num_rows != self.rows:
            raise StudyError(f"{self.path / name}: has {table.num_rows} rows, the plan {self.rows}")
        return table

    def table(self, shard: int | str, columns: list[str] | None = None) -> pa.Table:
        """A shard's table, or chosen columns of it.

        Raises:
            StudyError: it is missing, damaged, or another one's.
        """
        path = self.table_path(shard)
        identity = self.part(shard).identity if isinstance(shard, int) else self.identity
        table = read_table(path, columns, identity or None)
        if isinstance(shard, int) and table.num_rows != self.size(shard):
            raise StudyError(f"{path}: has {table.num_rows} rows, its shard {self.size(shard)}")
        return table

    def ended(self, shard: int) -> RowOutcomes:
        """Statuses and reasons of the runs of a shard that is done.

        Raises:
            StudyError: its table is missing, damaged, or another one's.
        """
        return read_row_outcomes(self.table_path(shard), self.part(shard).identity, self.size(shard))

    def write(self, path: Path, table: pa.Table, shard: int | None = None) -> None:
        """Writes one of the study's tables, or a shard's.

        Raises:
            StudyError: a symbolic link in its place, or a folder or disk that refuses.
        """
        if shard is None:
            write_table(path, table, study=self.identity)
        else:
            write_table(path, table, study=self.part(shard).identity, note_outcomes=path == self.table_path(shard))

    def mark(self, shard: int | str) -> dict[str, bytes]:
        """Attachment of a shard's archive that says whose it is."""
        identity = self.part(shard).identity if isinstance(shard, int) else self.identity
        return {MARK: json.dumps({"study": identity, "shard": shard_name(shard)}).encode()}

    def _owner(self, stem: str) -> dict[str, str]:
        """The mark of an archive of this name, of whichever plan its shard is."""
        identities = dict(self.worst_before) | {shard_name(shard): self.part(shard).identity for shard in self.shards}
        return {"study": identities.get(stem, self.identity), "shard": shard_name(stem)}

    def check_archive(self, name: str) -> None:
        """Checks the mark of an archive of recorded variants, if it is there; earlier versions set none.

        Args:
            name: its place in the folder, as the column `archive` has it.

        Raises:
            StudyError: it lies elsewhere, or is another shard's or another study's.
            ArchiveError: it cannot be read.
        """
        from warpchain.archive import read_archive

        check_archive_name(name)
        path = self.path / name
        if not self.identity or not path.exists():
            return
        archive = read_archive(path)
        if MARK in archive.attachments and json.loads(archive.attachment(MARK)) != self._owner(path.stem):
            raise StudyError(
                f"{path}: is the archive of another shard, or of another study; {REMEDY_RERUN} without its table"
            )

    def recorded(self) -> frozenset[int]:
        """Variants that are recorded when they are first simulated."""
        record = self.study.record
        every = range(0, self.rows, record.every) if record.every is not None else ()
        return frozenset(every) | frozenset(record.variants)


def shard_name(shard: int | str) -> str:
    """A shard's name in the folder."""
    return f"{shard:05d}" if isinstance(shard, int) else shard


def make_folder(path: Path, study: Study, drive: Drive, design: pa.Table, shard: int) -> Folder:
    """Makes a study's folder, or opens the one that holds the same study.

    Of several processes that do so at once, the first decides the size of shards.

    Args:
        path: the folder.
        shard: number of rows of a shard, in a new folder.

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
    differing = differences(folder.study, fixed)
    if folder.drive != drive:
        differing.append("its base drive")
    if study.design.kind == "table" and not differing and folder.design() != design:
        differing.append("its design table")
    if differing:
        raise StudyError(f"{path}: holds another study, which differs in {', '.join(differing)}; give another folder, "
                         "or --grow where it is the same with more points, replicates or another window")  # fmt: skip
    return folder


def differences(known: Study, other: Study) -> list[str]:
    """In which of its tables a study differs from one that a folder holds, but for the size of shards."""
    differing = [name for name in type(known).model_fields if getattr(known, name) != getattr(other, name)]
    if "run" in differing and known.run.model_copy(update={"shard": other.run.shard}) == other.run:
        differing.remove("run")  # the size of shards is decided already
    return differing


def open_folder(path: Path) -> Folder:
    """Opens a study's folder.

    Raises:
        StudyError: there is none, or it is damaged.
    """
    parts: list[Part] = []
    before: list[Part] = []
    number = 0
    while not number or (path / plan_file("plan.json", number)).exists():
        rows, part, restart = read_plan(path, number, parts)
        before = parts if restart else before
        parts = [part] if restart else [*parts, part]
        number += 1
    for name in (plan_file("study.toml", number - 1), "drive.toml"):
        check_file(path, part.digests, name)
    return Folder(path, rows, tuple(parts), number, tuple(before))


@dataclass(frozen=True)
class Outcome:
    """Status of a study.

    Attributes:
        folder: its folder.
        counts: number of variants by status, of the shards that are done.
        reasons: the most frequent (reason, how many) of variants that are not ok; alike in all but numbers is one.
        shards: (done, all).
        left: number of variants of the shards that are not done.
        rate: variants a second, as the latest shards came in; None where these are too few.
        table: the whole table's file, once there is one.
        went_on: of a study with another duration or window than before, (runs that went on from the ends of those
            before, runs that began anew); None of others.
    """

    folder: Path
    counts: Mapping[str, int]
    reasons: tuple[tuple[str, int], ...]
    shards: tuple[int, int]
    left: int
    rate: float | None
    table: Path | None
    went_on: tuple[int, int] | None = None


def study_status(out: str | os.PathLike[str]) -> Outcome:
    """Status of a study's folder.

    Raises:
        StudyError: no such folder, or a damaged one.
    """
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shards if folder.done(shard)]
    counts = Counter(dict.fromkeys(ROW_STATUSES, 0))
    reasons: list[tuple[str, str, int]] = []
    for shard in done:
        ended = folder.ended(shard)
        counts.update(ended.counts)
        reasons += ended.reasons
    table = folder.results if folder.results.exists() else None
    often = tuple((reason, number) for _, reason, number in by_frequency(alike_reasons(reasons))[:REASONS])
    left = folder.runs - sum(folder.size(shard) for shard in done)
    shards = len(done), len(folder.shards)
    return Outcome(folder.path, dict(counts), often, shards, left, _rate(folder, done), table, _went_on(folder))


def _rate(folder: Folder, done: Sequence[int]) -> float | None:
    """Variants a second of the shards that came in last, by the times of their files."""
    landed = sorted((folder.table_path(shard).stat().st_mtime, folder.size(shard)) for shard in done)[-LATEST:]
    if len(landed) < 3 or landed[-1][0] <= landed[0][0]:
        return None
    return sum(size for _, size in landed[1:]) / (landed[-1][0] - landed[0][0])


def _went_on(folder: Folder) -> tuple[int, int] | None:
    """(runs that went on from a state, runs that began anew) of the shards that are done; None where none could."""
    if not folder.before:
        return None
    done = [shard for shard in folder.shards if folder.done(shard)]
    flags: list[bool | None] = []
    for shard in done:
        if folder.states_path(shard).exists():
            flags += read_table(folder.states_path(shard), [GONE_ON]).column(0).to_pylist()
    runs = sum(folder.size(shard) for shard in done)
    return sum(map(bool, flags)), runs - sum(map(bool, flags))
