"""A study's folder: what is to be done, decided once, and which part of it is done.

    study.toml  drive.toml   the study and its base drive, as they were when the folder was made
    design.parquet           a row a variant
    plan.json                how rows are cut into shards, and digests of the files above and of itself
    shards/NNNNN.parquet     inputs and metrics of a shard's rows: it is done when this is there
    shards/NNNNN.mcap        its recorded variants
    shards/NNNNN.states.parquet  where its runs stood at the end of their windows, if that is kept
    results.parquet          the whole table, once all shards are done
    replicates.parquet       the same with a row for each run, of a study that runs rows several times

A study that is grown adds study.K.toml, design.K.parquet and plan.K.json, K = 1, 2, ..., and shards with the numbers
that follow; what was there stays as it is.

Every file appears whole, so that a folder can be gone on with after any end of any process. Several processes and
machines may work in one folder.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.errors import StudyError
from warpchain.study.run.tasks import Block, Numbers, Part
from warpchain.study.store import AGAIN, Ended, file_digest, read_ended, read_table, write_table, write_text

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.drive import Drive
    from warpchain.study.spec import Study

FORMAT = 1
FIXED = ("study.toml", "drive.toml", "design.parquet")
"""The files that a plan stands on."""
MARK = "study.json"
"""Name of the attachment that says which study and which shard an archive belongs to."""
REPLICATES = "replicates.parquet"
"""The table of all runs, of a study that runs rows several times."""
WORST = "worst"
"""Name of the shard that records the worst variants in a second pass."""


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
        """How often each row is run."""
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
        """Where a shard's runs stood at the end of their windows, of a study that keeps that."""
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
        _check(self.path, self.parts[-1].digests, name)
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

    def ended(self, shard: int) -> Ended:
        """How the runs of a shard that is done ended.

        Raises:
            StudyError: its table is missing, damaged, or another one's.
        """
        return read_ended(self.table_path(shard), self.part(shard).identity, self.size(shard))

    def write(self, path: Path, table: pa.Table, shard: int | None = None) -> None:
        """Writes one of the study's tables, or a shard's.

        Raises:
            StudyError: a folder or disk that refuses.
        """
        if shard is None:
            write_table(path, table, study=self.identity)
        else:
            write_table(path, table, study=self.part(shard).identity, ended=path == self.table_path(shard))

    def mark(self, shard: int | str) -> dict[str, bytes]:
        """Attachment of a shard's archive that says whose it is."""
        identity = self.part(shard).identity if isinstance(shard, int) else self.identity
        return {MARK: json.dumps({"study": identity, "shard": shard_name(shard)}).encode()}

    def _owner(self, stem: str) -> dict[str, str]:
        """What the mark of an archive of this name says, of whichever plan its shard is."""
        identities = dict(self.worst_before) | {shard_name(shard): self.part(shard).identity for shard in self.shards}
        return {"study": identities.get(stem, self.identity), "shard": shard_name(stem)}

    def check_archive(self, name: str) -> None:
        """Holds an archive of recorded variants, if it is there, against its mark; earlier versions set none.

        Args:
            name: its place in the folder, as the column `archive` has it.

        Raises:
            StudyError: it is another shard's, or another study's.
            ArchiveError: it cannot be read.
        """
        from warpchain.archive import read_archive

        path = self.path / name
        if not self.identity or not path.exists():
            return
        archive = read_archive(path)
        if MARK in archive.attachments and json.loads(archive.attachment(MARK)) != self._owner(path.stem):
            raise StudyError(f"{path}: is the archive of another shard, or of another study; {AGAIN} without its table")

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
        write_text(path / "study.toml", dumps_study(fixed), keep=True)
        write_text(path / "drive.toml", dumps_drive(drive), keep=True)
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


def plan_file(name: str, number: int) -> str:
    """A file's name in the plan of this number: study.toml, study.1.toml, study.2.toml, ..."""
    stem, _, ending = name.rpartition(".")
    return f"{stem}.{number}.{ending}" if number else name


def write_plan(path: Path, number: int, facts: Mapping[str, Any]) -> None:
    """Writes a plan, whose other files are there, if there is none of this number."""
    names = FIXED if not number else [name if name == "drive.toml" else plan_file(name, number) for name in FIXED]
    plan: dict[str, Any] = {"format": FORMAT, **facts, "digests": {name: file_digest(path / name) for name in names}}
    plan["digest"] = _identity(plan)
    write_text(path / plan_file("plan.json", number), json.dumps(plan) + "\n", keep=True)


def open_folder(path: Path) -> Folder:
    """Opens a study's folder.

    Raises:
        StudyError: there is none, or it is damaged.
    """
    parts: list[Part] = []
    before: list[Part] = []
    number = 0
    while not number or (path / plan_file("plan.json", number)).exists():
        rows, part, restart = _read_plan(path, number, parts)
        before = parts if restart else before
        parts = [part] if restart else [*parts, part]
        number += 1
    for name in (plan_file("study.toml", number - 1), "drive.toml"):
        _check(path, part.digests, name)
    return Folder(path, rows, tuple(parts), number, tuple(before))


def _read_plan(path: Path, number: int, before: Sequence[Part]) -> tuple[int, Part, bool]:
    """Rows of the design, what a plan adds, and whether it begins anew."""
    file = path / plan_file("plan.json", number)
    try:
        plan = json.loads(file.read_text())
        known = plan["format"] == FORMAT
        rows, shard, digests = int(plan["rows"]), int(plan["shard"]), dict(plan.get("digests", {}))
        identity = plan.get("digest", "")
        if identity != (_identity(plan) if digests else "") or rows < 0 or shard < 1:
            raise ValueError("its digest is wrong")
        if number and plan["after"] != before[-1].identity:
            raise ValueError("it follows another plan")
        blocks = [Block((a, b), (c, d)) for a, b, c, d in plan.get("blocks", [(0, rows, 0, 1)])]
        restart = bool(plan.get("restart", False))
    except OSError:
        raise StudyError(f"{path}: not a study's folder; make one with: warpchain study run") from None
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{file}: damaged") from None
    if not known:
        raise StudyError(f"{file}: format {plan['format']!r} is not known to this version ({FORMAT})")
    first = before[-1].shards.stop if before else 0
    return rows, Part(tuple(blocks), shard, first, identity, digests), restart


def _identity(plan: Mapping[str, Any]) -> str:
    """Digest of a plan, which tells a study's tables from others'."""
    text = json.dumps({name: value for name, value in plan.items() if name != "digest"}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _check(path: Path, digests: Mapping[str, str], name: str) -> None:
    """Refuses a file of a folder that is not what the plan was made with."""
    if name in digests and file_digest(path / name) != digests[name]:
        raise StudyError(f"{path / name}: was changed or is damaged; give another folder")
