"""A study to work with in Python: its rows as drives, its rows run in rounds, its surrogates and search."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from warpchain.argument_checks import Count, Index, Workers, check_arguments
from warpchain.drive import Drive, dumps_drive, load_drive
from warpchain.drive.drive_text import self_contained_text
from warpchain.drive.plugins import plugin_words
from warpchain.engine.simulation import MEMORY, available_cores
from warpchain.errors import StudyError
from warpchain.progress import Progress
from warpchain.results.arrow_tables import table_with_column
from warpchain.study.design import make_design
from warpchain.study.design.design_table import design_table_of_rows
from warpchain.study.optimize.optimizer import Optimizer
from warpchain.study.results import (
    ARCHIVE_COLUMNS,
    ROUND_COLUMN,
    SEARCH_TARGET_KEY,
    TODAY_COLUMN,
    Results,
    added_rows,
    read_results,
)
from warpchain.study.run.prepare import base_drive_file, preferred_shard_size, read_study
from warpchain.study.run.row_drives import Variant, build_drives
from warpchain.study.run.runner import run_folder
from warpchain.study.run.study_folder import StudyFolder, make_folder
from warpchain.study.run.today import rows_with_today
from warpchain.study.spec import Study, load_study
from warpchain.study.store import read_table, write_table
from warpchain.study.surrogate import Surrogate, fit_surrogate
from warpchain.version import installed_version

if TYPE_CHECKING:
    import pyarrow as pa

DIGEST_COLUMN = "digest"
Rows = Sequence[Mapping[str, Any]]


def round_folder_name(number: int) -> str:
    """Name of a round's folder in a session's."""
    return f"rounds/{number:04d}"


def round_table_path(folder: Path, number: int) -> Path:
    """Path of a finished round's table."""
    return folder / round_folder_name(number) / "rows.parquet"


def finished_round_count(folder: Path) -> int:
    """Number of finished rounds, from the first on."""
    number = 0
    while round_table_path(folder, number).exists():
        number += 1
    return number


def read_rounds(folder: Path, rounds: int) -> pa.Table:
    """Table of rows of the first `rounds` rounds."""
    import pyarrow as pa

    tables = []
    for number in range(rounds):
        table = read_table(round_table_path(folder, number))
        tables.append(table.append_column(ROUND_COLUMN, pa.array([number] * table.num_rows, pa.int64())))
    table = pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    facts: dict[str, dict[bytes, bytes]] = {}
    for part in tables:
        for field in part.schema:
            facts[field.name] = facts.get(field.name) or dict(field.metadata or {})
    fields = [field.with_metadata(facts[field.name] or None) for field in table.schema]
    table = pa.Table.from_arrays(table.columns, schema=pa.schema(fields))
    return table_with_column(table, "variant", range(table.num_rows))


class StudySession:
    """Session of a study in Python: drives, runs, surrogates, search.

    Args:
        folder: of rounds; None keeps rows in memory only.
        drive: another base drive's file or example.
        search_target: such as "failures", if rows are no sample of the noise.

    Raises:
        StudyError: a line for each error of the study or its drive.
    """

    def __init__(
        self,
        source: str | os.PathLike[str],
        folder: str | os.PathLike[str] | None = None,
        *,
        workers: int | None = None,
        memory: int = MEMORY,
        drive: str | os.PathLike[str] | None = None,
        search_target: str = "",
    ) -> None:
        self.source = Path(source)
        self.study, self.drive, _ = read_study(source, drive)
        self.drive_text = self_contained_text(base_drive_file(self.study, source, drive))
        self.folder = None if folder is None else Path(folder)
        self._workers, self._memory, self._search_target = workers, memory, search_target
        self._known: dict[str, tuple[pa.Table, int]] = {}
        self._optimizer: Optimizer | None = None

    # ------------------------------------------------------------------------------------------------ rows

    def design_rows(self) -> list[dict[str, Any]]:
        """Rows of the study's design, values by factor."""
        return self._rows_with_today(make_design(self.study, self.source).select(self.factor_names).to_pylist())

    def _rows_with_today(self, rows: Rows) -> list[dict[str, Any]]:
        """Rows of a study with today's design, if wanted."""
        return rows_with_today(self.study, self.drive, rows, self.source)

    @check_arguments(StudyError)
    def drives(self, rows: Rows) -> list[Drive]:
        """Drives of a study's rows, adjusted to fit.

        Raises:
            StudyError: a line for each row without a drive.
        """
        variants = self._built_variants(design_table_of_rows(self.study, rows))
        lines = [f"rows: row {i}: {variant.reason}" for i, variant in enumerate(variants) if variant.drive is None]
        if lines:
            raise StudyError("\n".join(lines))
        return [variant.drive for variant in variants if variant.drive is not None]

    def _built_variants(self, design: pa.Table) -> list[Variant]:
        """Variants of a design table with their drives."""
        variants = [Variant(row, reason=row["reason"]) for row in design.to_pylist()]
        build_drives(self.study, self.drive, variants)
        return variants

    @check_arguments(StudyError)
    def row_digests(self, design: pa.Table) -> list[str | None]:
        """Digest of each row's drive and settings, or None."""
        by = {"warpchain": installed_version()} | ({"plugins": words} if (words := plugin_words()) else {})
        common = json.dumps({**run_settings_of(self.study), **by}, sort_keys=True)
        texts = [None if v.drive is None else dumps_drive(v.drive) for v in self._built_variants(design)]
        return [text and hashlib.sha256(f"{common}\n{text}".encode()).hexdigest() for text in texts]

    @check_arguments(StudyError)
    def evaluate(self, rows: Rows, progress: Progress = False) -> pa.Table:
        """Table of results of study rows, run if new.

        Args:
            progress: True shows a bar; a function is called as that of `run_study`.

        Raises:
            StudyError: a factor is missing, or a folder or disk that refuses.
            KeyboardInterrupt: what is done stays in the folder.
        """
        if self.folder is not None:
            return self.run_round(finished_round_count(self.folder), rows, progress)
        with tempfile.TemporaryDirectory(prefix="warpchain-") as place:
            return self._run_new_rows(Path(place), "", design_table_of_rows(self.study, rows), progress)

    @check_arguments(StudyError)
    def run_round(self, number: Index, rows: Rows, progress: Progress = False) -> pa.Table:
        """Table of results of a round, run or read."""
        assert self.folder is not None  # who asks for rounds has one
        name, done = round_folder_name(number), round_table_path(self.folder, number)
        place, design = self.folder / name, self._design_with_target(design_table_of_rows(self.study, rows))
        if done.exists():
            table = read_table(done)
            if table.select(self.factor_names).to_pylist() != design.select(self.factor_names).to_pylist():
                raise StudyError(f"{done}: has other rows than this study asks for in that round; give another folder")
            self.remember_rows(table)
            return table
        before = sum(read_table(round_table_path(self.folder, k), ["variant"]).num_rows for k in range(number))
        table = self._run_new_rows(place, f"{name}/", design, progress, before)
        place.mkdir(parents=True, exist_ok=True)  # not there yet where all rows were known
        write_table(done, table)
        return table

    def _design_with_target(self, design: pa.Table) -> pa.Table:
        """Design table that states its search target."""
        import pyarrow as pa

        if not self._search_target:
            return design
        fields = [
            field.with_metadata(field.metadata | {SEARCH_TARGET_KEY.encode(): self._search_target.encode()})
            if field.name in self.study.noise_names
            else field
            for field in design.schema
        ]
        return pa.Table.from_arrays(design.columns, schema=pa.schema(fields))

    def _run_new_rows(
        self, place: Path, prefix: str, design: pa.Table, progress: Progress, before: int = 0
    ) -> pa.Table:
        """Table of results of a design, new rows run."""
        import pyarrow as pa

        digests = self.row_digests(design)
        new: list[int] = []
        asked: set[str] = set()
        for i, digest in enumerate(digests):
            if digest is None or (digest not in self._known and digest not in asked):
                new.append(i)
                asked.add(digest or "")
        chosen = table_with_column(design.take(pa.array(new, pa.int64())), "variant", [before + i for i in new])
        fresh = self._simulated_table(place, prefix, chosen, progress) if new else None
        if fresh is not None:
            fresh = fresh.append_column(DIGEST_COLUMN, pa.array([digests[i] for i in new], pa.string()))
            self.remember_rows(fresh)
        at = {} if fresh is None else {i: (fresh, k) for k, i in enumerate(new)}
        parts = [at[i] if digest is None else self._known[digest] for i, digest in enumerate(digests)]
        found = pa.concat_tables([table.slice(k, 1) for table, k in parts], promote_options="permissive")
        return _rows_with_factors(found, design, self.factor_names)

    def _simulated_table(self, place: Path, prefix: str, design: pa.Table, progress: Progress) -> pa.Table:
        """Table of results of a design, all rows simulated."""
        folder = self.make_run_folder(self.study, place, design)
        if folder.read_design().drop_columns(["variant"]) != design.drop_columns(["variant"]):
            raise StudyError(f"{place}: has other rows than this study asks for in that round; give another folder")
        table = self.run_and_read(folder, progress)
        if self.study.record.every == 1:
            table = self._table_with_objectives(table, place)
        archive = ARCHIVE_COLUMNS[0]
        if archive in table.column_names:
            table = table_with_column(table, archive, [name and prefix + name for name in table[archive].to_pylist()])
        return table

    @check_arguments(StudyError)
    def make_run_folder(self, study: Study, place: Path, design: pa.Table) -> StudyFolder:
        """Study folder made to run a design's rows."""
        runs, cores = design.num_rows * study.design.copies, self._workers or available_cores()
        size = study.run.shard or preferred_shard_size(study, self.drive, runs, 1, cores, self._memory)
        return make_folder(place, study, self.drive, design, size)

    @check_arguments(StudyError)
    def run_and_read(self, folder: StudyFolder, progress: Progress = False) -> pa.Table:
        """Results table of a study folder, run to its end."""
        outcome = run_folder(folder, workers=self._workers, memory=self._memory, progress=progress)
        assert outcome.table is not None  # all shards are done
        return read_table(outcome.table)

    def _table_with_objectives(self, table: pa.Table, place: Path) -> pa.Table:
        """Table with objectives of recorded variants, if wanted."""
        from warpchain.study.run.recordings import results_with_objectives

        if all(name in table.column_names or name in self.factor_names for name in self.study.named_metrics):
            return table
        results = read_results(table, self.factor_names)
        return results_with_objectives(results, place).table if results.ok.any() else table

    @check_arguments(StudyError)
    def learn_rows(self, folder: str | os.PathLike[str]) -> int:
        """Adds another study's rows to those known; returns their number."""
        import pyarrow as pa

        path = Path(folder)
        other = load_study(path / "study.toml")
        if load_drive(path / "drive.toml") != self.drive:
            raise StudyError(f"{path}: another drive than {self.source} has")
        mine, theirs = run_settings_of(self.study), run_settings_of(other)
        differing = [name for name in mine if mine[name] != theirs[name]]
        if differing:
            raise StudyError(f"{path}: its {', '.join(differing)} are not those of {self.source}")
        table = read_table(path / "results.parquet")
        missing = [name for name in (*self.factor_names, *self.study.named_metrics) if name not in table.column_names]
        if missing:
            raise StudyError(f"{path / 'results.parquet'}: has no column {missing[0]}, which {self.source} needs")
        design = design_table_of_rows(self.study, table.select(self.factor_names).to_pylist())
        if ARCHIVE_COLUMNS[0] in table.column_names:  # recordings stay where they are
            for name in ARCHIVE_COLUMNS:
                table = table_with_column(table, name, [None] * table.num_rows)
        if DIGEST_COLUMN in table.column_names:
            table = table.drop_columns([DIGEST_COLUMN])
        self.remember_rows(table.append_column(DIGEST_COLUMN, pa.array(self.row_digests(design), pa.string())))
        return int(table.num_rows)

    @property
    def factor_names(self) -> list[str]:
        """Names of the study's factors."""
        return [factor.name for factor in self.study.factors]

    @property
    def shown_factors(self) -> list[str]:
        """Names of the study's factors, hidden ones left out."""
        return [factor.name for factor in self.study.factors if not factor.hidden]

    @check_arguments(StudyError)
    def remember_rows(self, table: pa.Table) -> None:
        """Adds a table's rows to those known."""
        for k, digest in enumerate(table[DIGEST_COLUMN].to_pylist()):
            if digest is not None:
                self._known.setdefault(digest, (table, k))

    # ------------------------------------------------------------------------------- what follows from rows

    def results(self) -> Results:
        """Results of all rounds in the session's folder."""
        if self.folder is None:
            raise StudyError("results: this study was opened without a folder")
        rounds = finished_round_count(self.folder)
        return read_results(
            read_rounds(self.folder, rounds) if rounds else self.folder / "results.parquet", self.shown_factors
        )

    @check_arguments(StudyError)
    def surrogate(
        self, metric: str, kind: Literal["gaussian", "quadratic"] = "gaussian", logarithm: bool = False
    ) -> Surrogate:
        """Surrogate of a metric over known rows; see `fit_surrogate`."""
        return fit_surrogate(self.results(), metric, kind, logarithm=logarithm)

    @property
    def optimizer(self) -> Optimizer:
        """Optimizer of the study, made when first asked for."""
        if self._optimizer is None:
            self._optimizer = Optimizer(self.study, str(self.source))
        return self._optimizer

    @check_arguments(StudyError)
    def ask(self, count: Count | None = None) -> list[dict[str, Any]]:
        """Next rows to run, today's design first; see `Optimizer.ask`."""
        first, rows = self.optimizer.observed_count == 0, self.optimizer.ask(count)
        return self._rows_with_today(rows) if first else rows

    @check_arguments(StudyError)
    def observe(self, table: pa.Table) -> None:
        """Adds results to the optimizer, but today's; see `Optimizer.observe`."""
        self.optimizer.observe(table.filter(~added_rows(table)))


def _rows_with_factors(found: pa.Table, design: pa.Table, factors: Sequence[str]) -> pa.Table:
    """Table of known rows, with a design's factors and numbers."""
    found = found.combine_chunks()
    for name in ("variant", *factors):
        at = found.column_names.index(name)
        column = design["variant"] if name == "variant" else design[name]
        found = found.set_column(at, design.schema.field(name), column.combine_chunks())
    if TODAY_COLUMN in found.column_names:  # a known row may have been today's in another table
        found = found.drop_columns([TODAY_COLUMN])
    if TODAY_COLUMN in design.column_names:
        found = found.append_column(design.schema.field(TODAY_COLUMN), design[TODAY_COLUMN].combine_chunks())
    return table_with_column(found, "variant", range(found.num_rows))


def run_settings_of(study: Study) -> dict[str, Any]:
    """Settings of a study that decide a row's metrics."""
    settings = study.model_dump(mode="json", include={"limits", "metrics", "fatigue"})
    settings["run"] = study.run.model_dump(mode="json", exclude={"shard", "keep_states"})
    settings["copies"] = [study.design.copies, study.design.replicate_by]
    return settings


@check_arguments(StudyError)
def open_study(
    source: str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
) -> StudySession:
    """Study session opened from a study file.

    Raises:
        StudyError: a line for each error of the study or its drive.
    """
    return StudySession(source, folder, workers=workers, memory=memory)
