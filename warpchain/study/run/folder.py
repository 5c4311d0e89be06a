"""A study's folder: what is to be done, decided once, and which part of it is done.

    study.toml  drive.toml   the study and its base drive, as they were when the folder was made
    design.parquet           a row a variant
    plan.json                how rows are cut into shards, and digests of the files above and of itself
    shards/NNNNN.parquet     inputs and metrics of a shard's rows: it is done when this is there
    shards/NNNNN.mcap        its recorded variants
    results.parquet          the whole table, once all shards are done

Every file appears whole, so that a folder can be gone on with after any end of any process. Several processes and
machines may work in one folder.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.drive import Drive, dumps_drive, load_drive
from warpchain.errors import StudyError
from warpchain.study.spec import Study, dumps_study, load_study
from warpchain.study.store import AGAIN, file_digest, read_table, write_table, write_text

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT = 1
FIXED = ("study.toml", "drive.toml", "design.parquet")
"""The files that a plan stands on."""
MARK = "study.json"
"""Name of the attachment that says which study and which shard an archive belongs to."""
WORST = "worst"
"""Name of the shard that records the worst variants in a second pass."""


@dataclass(frozen=True)
class Folder:
    """A study's folder.

    Attributes:
        path: where it is.
        study: the study.
        drive: its base drive.
        rows: number of rows of the design.
        shard: number of rows of a shard; the last one may have fewer.
        identity: the plan's digest, which the study's tables bear; "" in folders of earlier versions.
        digests: SHA-256 of the files that the plan stands on.
    """

    path: Path
    study: Study
    drive: Drive
    rows: int
    shard: int
    identity: str = ""
    digests: Mapping[str, str] = field(default_factory=dict)

    @property
    def shards(self) -> range:
        """Numbers of all shards."""
        return range(-(-self.rows // self.shard))

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

    def done(self, shard: int | str) -> bool:
        """Whether a shard is done."""
        return self.table_path(shard).exists()

    def size(self, shard: int) -> int:
        """Number of rows of a shard."""
        return min(self.shard, self.rows - shard * self.shard)

    def design(self) -> pa.Table:
        """The whole design.

        Raises:
            StudyError: it is missing, damaged, or has another number of rows.
        """
        _check(self.path, self.digests, "design.parquet")
        table = read_table(self.path / "design.parquet")
        if table.num_rows != self.rows:
            raise StudyError(f"{self.path / 'design.parquet'}: has {table.num_rows} rows, the plan {self.rows}")
        return table

    def table(self, shard: int | str, columns: list[str] | None = None) -> pa.Table:
        """A shard's table, or chosen columns of it.

        Raises:
            StudyError: it is missing, damaged, or another one's.
        """
        path = self.table_path(shard)
        table = read_table(path, columns, self.identity or None)
        if isinstance(shard, int) and table.num_rows != self.size(shard):
            raise StudyError(f"{path}: has {table.num_rows} rows, its shard {self.size(shard)}")
        return table

    def write(self, path: Path, table: pa.Table) -> None:
        """Writes one of the study's tables.

        Raises:
            StudyError: a folder or disk that refuses.
        """
        write_table(path, table, study=self.identity)

    def mark(self, shard: int | str) -> dict[str, bytes]:
        """Attachment of a shard's archive that says whose it is."""
        return {MARK: json.dumps({"study": self.identity, "shard": shard_name(shard)}).encode()}

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
        if MARK in archive.attachments and archive.attachment(MARK) != self.mark(path.stem)[MARK]:
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
    try:
        (path / "shards").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{path}: cannot be made ({error.strerror or error})") from None
    fixed = study.model_copy(update={"study": study.study.model_copy(update={"drive": "drive.toml"})})
    if not (path / "plan.json").exists():
        write_text(path / "study.toml", dumps_study(fixed), keep=True)
        write_text(path / "drive.toml", dumps_drive(drive), keep=True)
        write_table(path / "design.parquet", design, keep=True)
        digests = {name: file_digest(path / name) for name in FIXED}
        plan: dict[str, Any] = {"format": FORMAT, "rows": design.num_rows, "shard": shard, "digests": digests}
        plan["digest"] = _identity(plan)
        write_text(path / "plan.json", json.dumps(plan) + "\n", keep=True)
    folder = open_folder(path)
    differing = [name for name in Study.model_fields if getattr(folder.study, name) != getattr(fixed, name)]
    if "run" in differing and folder.study.run.model_copy(update={"shard": study.run.shard}) == study.run:
        differing.remove("run")  # the size of shards is decided already
    if folder.drive != drive:
        differing.append("its base drive")
    if study.design.kind == "table" and not differing and folder.design() != design:
        differing.append("its design table")
    if differing:
        raise StudyError(f"{path}: holds another study, which differs in {', '.join(differing)}; give another folder")
    return folder


def open_folder(path: Path) -> Folder:
    """Opens a study's folder.

    Raises:
        StudyError: there is none, or it is damaged.
    """
    try:
        plan = json.loads((path / "plan.json").read_text())
        known = plan["format"] == FORMAT
        rows, shard, digests = int(plan["rows"]), int(plan["shard"]), dict(plan.get("digests", {}))
        identity = plan.get("digest", "")
        if identity != (_identity(plan) if digests else "") or rows < 0 or shard < 1:
            raise ValueError("its digest is wrong")
    except OSError:
        raise StudyError(f"{path}: not a study's folder; make one with: warpchain study run") from None
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{path / 'plan.json'}: damaged") from None
    if not known:
        raise StudyError(f"{path / 'plan.json'}: format {plan['format']!r} is not known to this version ({FORMAT})")
    for name in ("study.toml", "drive.toml"):
        _check(path, digests, name)
    study, drive = load_study(path / "study.toml"), load_drive(path / "drive.toml")
    return Folder(path, study, drive, rows, shard, identity, digests)


def _identity(plan: Mapping[str, Any]) -> str:
    """Digest of a plan, which tells a study's tables from others'."""
    text = json.dumps({name: value for name, value in plan.items() if name != "digest"}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _check(path: Path, digests: Mapping[str, str], name: str) -> None:
    """Refuses a file of a folder that is not what the plan was made with."""
    if name in digests and file_digest(path / name) != digests[name]:
        raise StudyError(f"{path / name}: was changed or is damaged; give another folder")
