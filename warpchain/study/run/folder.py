"""A study's folder: what is to be done, decided once, and which part of it is done.

    study.toml  drive.toml   the study and its base drive, as they were when the folder was made
    design.parquet           a row a variant
    plan.json                how rows are cut into shards
    shards/NNNNN.parquet     inputs and metrics of a shard's rows: it is done when this is there
    shards/NNNNN.mcap        its recorded variants
    results.parquet          the whole table, once all shards are done

Every file appears whole, so that a folder can be gone on with after any end of any process. Several processes and
machines may work in one folder.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.drive import Drive, dumps_drive, load_drive
from warpchain.errors import StudyError
from warpchain.study.spec import Study, dumps_study, load_study
from warpchain.study.store import read_table, write_table, write_text

if TYPE_CHECKING:
    import pyarrow as pa

FORMAT = 1
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
    """

    path: Path
    study: Study
    drive: Drive
    rows: int
    shard: int

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
        """The whole design."""
        return read_table(self.path / "design.parquet")

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
        plan = {"format": FORMAT, "rows": design.num_rows, "shard": shard}
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
        rows, shard = int(plan["rows"]), int(plan["shard"])
    except OSError:
        raise StudyError(f"{path}: not a study's folder; make one with: warpchain study run") from None
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{path / 'plan.json'}: damaged") from None
    if not known:
        raise StudyError(f"{path / 'plan.json'}: format {plan['format']!r} is not known to this version ({FORMAT})")
    return Folder(path, load_study(path / "study.toml"), load_drive(path / "drive.toml"), rows, shard)
