"""Joins several studies' folders to one: the rows of all, each once, numbered through; the folders stay as they are."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.drive import Drive, dumps_drive, read_drive_text
from warpchain.drive.drive_text import drive_text
from warpchain.drive.toml import value_text
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.progress import interruptible_work
from warpchain.results.arrow_tables import table_with_column
from warpchain.results.replicate_metrics import COPY_COLUMN
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.study.design import make_design
from warpchain.study.results import ARCHIVE_COLUMNS, search_target_of
from warpchain.study.run.run_states import read_run_states, write_joined_states
from warpchain.study.run.runner import finish_study, read_runs
from warpchain.study.run.shard_plan import blocks_of_runs
from warpchain.study.run.study_folder import (
    DRIVE_TEXT_FILE,
    StudyFolder,
    StudyStatus,
    open_folder,
    plan_file_name,
    study_status,
    write_plan,
)
from warpchain.study.spec import Study, dumps_study
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.key_path_names import key_path_namer
from warpchain.study.spec.study_tables import Design, file_from_fields
from warpchain.study.store import write_study_text, write_table

if TYPE_CHECKING:
    import pyarrow as pa

START_DEFAULTS: Mapping[str, Any] = {"phase": 0.0}
FREE_RUN_KEYS = ("shard", "device", "keep_states")
GOAL_FIELDS = ("objectives", "bounds", "optimize")
SPREAD_KEYS = ("range", "levels", "choice", "points", "distribution", "mean", "std", "sample", "group")
ROWS_FILE, MERGED_FILE = "rows.parquet", "merged.parquet"
RowCopy = tuple[int, int]


def joined_study(opened: Sequence[StudyFolder], rows: str) -> Study:
    """Study that joins several folders, its design in `rows`.

    Raises:
        StudyError: a line for each key in which they differ.
    """
    first = opened[0]
    lines = [line for other in opened[1:] for line in _difference_lines(first, other)]
    if lines:
        raise StudyError("\n".join(dict.fromkeys(lines)))
    study = first.study
    wanted = {name: next((getattr(f.study, name) for f in opened if getattr(f.study, name)), getattr(study, name))
              for name in GOAL_FIELDS}  # fmt: skip
    factors = [_joined_factor([_factor_by_name(f.study, factor.name) for f in opened]) for factor in study.factors]
    copies = max(f.copies for f in opened)
    ways = [f.study.design.replicate_by for f in opened if f.copies > 1]
    replicates, way = (copies, next(iter(ways))) if copies > 1 else (None, None)
    changed = {
        "study": study.study.model_copy(update={"drive": "drive.toml"}),
        "design": Design(kind="table", file=rows, replicates=replicates, replicate_by=way),
        "factors": (*(factor for factor in factors if factor is not None), *_start_factors(opened)),
    }
    return study.model_copy(update={**changed, **wanted})


def _factor_by_name(study: Study, name: str) -> Factor:
    """Factor of a study by its name."""
    return next(factor for factor in study.factors if factor.name == name)


def _difference_lines(first: StudyFolder, other: StudyFolder) -> Iterator[str]:
    """Lines on differences that forbid to join two folders."""
    ours, theirs = _common_values(first), _common_values(other)
    if first.copies > 1 and other.copies > 1:
        for folder, fixed in ((first, ours), (other, theirs)):
            fixed["design"] = {"replicate_by": folder.study.design.replicate_way}
    place = key_path_namer(ours)
    for path, here, there in _differing_values(ours, theirs):
        where = ".".join(map(str, path)) if path[0] == "drive" else place(path)
        yield (
            f"{other.path}: {where} = {_short_value_text(there)}, but {_short_value_text(here)} in "
            f"{first.path}; only studies that run the "
            "same can be merged"
        )
    for name in GOAL_FIELDS:
        wanted = [getattr(folder.study, name) for folder in (first, other)]
        if all(wanted) and wanted[0] != wanted[1]:
            said = "limits" if name == "bounds" else name
            yield f"{other.path}: {said}: not those of {first.path}; only studies that want the same can be merged"
    names = {factor.name for factor in other.study.factors}
    for factor in first.study.factors:
        if factor.name in names and _joined_factor([factor, _factor_by_name(other.study, factor.name)]) is None:
            yield (
                f"{other.path}: factors.{factor.name}: not distributed as in {first.path}; only ranges, levels and "
                "choices can be put together"
            )


def _common_values(folder: StudyFolder) -> dict[str, Any]:
    """Values of a study that joined studies must share."""
    found = file_from_fields(folder.study.model_dump(mode="json", exclude={"study", "design", *GOAL_FIELDS}))
    found["factors"] = {f.name: f.model_dump(mode="json", exclude=set(SPREAD_KEYS)) for f in folder.study.factors}
    found["run"] = {key: value for key, value in found["run"].items() if key not in FREE_RUN_KEYS}
    found["record"].pop("variants")
    own = folder.base_drive
    found["drive"] = own.model_copy(
        update={"run": own.run.model_copy(update=dict.fromkeys(START_DEFAULTS))}
    ).model_dump(mode="json")
    return found


def _differing_values(ours: Any, theirs: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[Any, Any, Any]]:
    """Key paths and values in which studies differ."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in dict.fromkeys([*ours, *theirs]):
            yield from _differing_values(ours.get(key), theirs.get(key), (*path, key))
    elif isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        for k, (one, two) in enumerate(zip(ours, theirs, strict=True)):
            yield from _differing_values(one, two, (*path, one.get("name", k) if isinstance(one, dict) else k))
    elif ours != theirs:
        yield path, ours, theirs


def _short_value_text(value: Any) -> str:
    """Text of a differing value, shortened."""
    text = "nothing" if value is None else "a table" if isinstance(value, dict) else value_text(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _joined_factor(factors: Sequence[Factor]) -> Factor | None:
    """Factor with the values of all joined ones, or None."""
    first = factors[0].model_copy(update={"points": None})
    if all(factor.model_copy(update={"points": None}) == first for factor in factors):
        return first
    kinds, changed = {factor.value_source for factor in factors}, dict[str, Any]()
    if kinds in ({"uniform"}, {"log-uniform"}):
        ends = [end for factor in factors for end in factor.range or ()]
        changed["range"] = (min(ends), max(ends))
    elif kinds == {"levels"}:
        changed["levels"] = tuple(sorted({value for factor in factors for value in factor.levels or ()}))
    elif kinds == {"choice"}:
        changed["choice"] = tuple(dict.fromkeys(value for factor in factors for value in factor.choice or ()))
    return first.model_copy(update={"group": None, **changed}) if changed else None


def _start_factors(opened: Sequence[StudyFolder]) -> Iterator[Factor]:
    """Hidden factors for joined drives' start settings."""
    for name in START_DEFAULTS:
        if len({start_value(folder.base_drive, name) for folder in opened}) > 1:
            yield Factor(name=name, path=f"run.{name}", hidden=True)


def start_value(drive: Drive, name: str) -> Any:
    """Start setting of a drive by its key."""
    value = getattr(drive.run, name)
    return START_DEFAULTS[name] if value is None else value


@dataclass(frozen=True)
class JoinedStudies:
    """Result of joining studies' folders."""

    outcome: StudyStatus
    rows: tuple[int, ...]
    together: int  # rows of the joined study
    mapping: Path  # file of the rows' former numbers: `folder`, `before`, `variant`


@dataclass
class _JoinedRows:
    """Rows of joined studies, each once, and their runs."""

    rows: list[dict[str, Any]] = field(default_factory=list)  # values by factor
    place: dict[tuple[Any, ...], int] = field(default_factory=dict)  # joined number by values
    runs: dict[RowCopy, tuple[int, int]] = field(default_factory=dict)  # folder and row there of each joined run
    numbers: list[list[int]] = field(default_factory=list)  # joined number of each row, by folder


@interruptible_work()
def join_studies(
    folders: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    memory: int = MEMORY,
) -> JoinedStudies:
    """Joins studies' folders into a new one; returns its status.

    They must have one drive, the same factors in any range, and the same run settings.

    Args:
        folders: two or more, finished or not.
        out: the folder to make; it appears whole or not at all.
        workers, memory: for worst variants still to be recorded.

    Raises:
        StudyError: one folder, studies that do not run the same, an existing `out`, or a disk that refuses.
    """
    target = Path(out)
    if len(folders) < 2:
        raise StudyError("merge: needs at least two folders")
    opened = [open_folder(Path(folder)) for folder in folders]
    if target.exists():
        raise StudyError(f"{target}: is there already; give a new folder")
    for folder in opened:
        if aim := search_target_of(folder.read_design()):
            raise StudyError(
                f"{folder.path}: its rows look for {aim} and are no sample of the noise; they cannot be merged"
            )
    study = joined_study(opened, ROWS_FILE)
    pool = _joined_rows(opened, study)
    chosen = {pool.numbers[f][v] for f, folder in enumerate(opened) for v in folder.study.record.variants}
    study = study.model_copy(update={"record": study.record.model_copy(update={"variants": tuple(sorted(chosen))})})
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        place = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as error:
        raise StudyError(f"{target}: cannot be made ({error.strerror or error})") from None
    try:
        place.chmod(0o777 & ~_process_umask())
        _write_joined_folder(place, opened, study, pool)
        outcome = study_status(place)
        if not outcome.left:
            finish_study(open_folder(place), None, {"workers": workers, "memory": memory})
        place.rename(target)
    except OSError as error:
        raise StudyError(f"{target}: cannot be written ({error.strerror or error})") from None
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return JoinedStudies(study_status(target), tuple(f.rows for f in opened), len(pool.rows), target / MERGED_FILE)


def _process_umask() -> int:
    """File mode mask of this process."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _joined_rows(opened: Sequence[StudyFolder], study: Study) -> _JoinedRows:
    """Rows of joined folders, each once, and their runs."""
    pool = _JoinedRows()
    names = [factor.name for factor in study.factors]
    for f, folder in enumerate(opened):
        numbers = []
        for row in folder.read_design().to_pylist():
            values = {name: row[name] if name in row else start_value(folder.base_drive, name) for name in names}
            key = tuple(values[name] for name in names)
            if key not in pool.place:
                pool.place[key] = len(pool.rows)
                pool.rows.append(values)
            numbers.append(pool.place[key])
        pool.numbers.append(numbers)
        for shard in folder.shard_numbers:
            if folder.is_done(shard):
                for row, copy in zip(*(part.tolist() for part in folder.shard_runs(shard)), strict=True):
                    pool.runs.setdefault((numbers[row], copy), (f, row))
    return pool


def _write_joined_folder(place: Path, opened: Sequence[StudyFolder], study: Study, pool: _JoinedRows) -> None:
    """Writes a joined folder without its results table."""
    import pyarrow as pa

    (place / "shards").mkdir()
    given = [factor.name for factor in study.factors if factor.value_source != "expression"]
    columns = {name: [row[name] for row in pool.rows] for name in given}
    write_table(place / ROWS_FILE, pa.table(columns))
    copies = study.design.copies
    done = sorted(pool.runs)
    every = ((row, copy) for row in range(len(pool.rows)) for copy in range(copies))
    missing = [task for task in every if task not in pool.runs]
    write_study_text(place / "drive.toml", dumps_drive(opened[0].base_drive))
    if (text := opened[0].path / DRIVE_TEXT_FILE).exists():
        write_study_text(place / DRIVE_TEXT_FILE, drive_text(read_drive_text(text), opened[0].base_drive))
    write_study_text(place / "study.toml", dumps_study(study))
    design = make_design(study, place / "study.toml")
    size = max(folder.shard_size for folder in opened)
    parts = [blocks_of_runs(tasks, copies) for tasks in (done, missing) if tasks]
    after = ""
    for number, blocks in enumerate(parts):
        if number:
            write_study_text(place / plan_file_name("study.toml", number), dumps_study(study))
        write_table(place / plan_file_name("design.parquet", number), design)
        listed = [[*block.rows, *block.copies] for block in blocks]
        facts = {"rows": len(pool.rows), "shard": size, "blocks": listed, **({"after": after} if number else {})}
        write_plan(place, number, facts)
        after = open_folder(place).identity
    begun = [f for f, folder in enumerate(opened) if any(map(folder.is_done, folder.shard_numbers))]
    tables = {f: _renumbered_runs(opened[f], pool, f, design) for f in begun}
    joined = open_folder(place)
    for shard in joined.plans[0].shard_numbers if done else ():
        _write_joined_shard(joined, shard, opened, tables, pool)
    write_table(place / MERGED_FILE, _row_mapping(opened, pool))


def _row_mapping(opened: Sequence[StudyFolder], pool: _JoinedRows) -> pa.Table:
    """Table of joined rows' former folders and numbers."""
    import pyarrow as pa

    before = [v for folder in opened for v in folder.read_design()["variant"].to_pylist()]
    names = [str(folder.path) for folder in opened for _ in range(folder.rows)]
    return pa.table({"folder": names, "before": before, "variant": [v for part in pool.numbers for v in part]})


def _renumbered_runs(folder: StudyFolder, pool: _JoinedRows, f: int, design: pa.Table) -> pa.Table:
    """Table of a folder's runs with joined numbers."""
    import pyarrow as pa

    table = read_runs(folder)
    row_of = {variant: row for row, variant in enumerate(folder.read_design()["variant"].to_pylist())}
    rows = [row_of[variant] for variant in table["variant"].to_pylist()]
    numbers = pa.array([pool.numbers[f][row] for row in rows], pa.int64())
    table = table_with_column(table.append_column("before", pa.array(rows, pa.int64())), "variant", numbers.to_pylist())
    if COPY_COLUMN not in table.column_names:
        table = table.add_column(1, COPY_COLUMN, pa.array([0] * table.num_rows, pa.int64()))
    inputs = design.take(numbers)
    for name in inputs.column_names[1:-2]:
        field_, values = inputs.schema.field(name), inputs[name]
        if name in table.column_names:
            table = table.set_column(table.column_names.index(name), field_, values)
        else:
            table = table.add_column(table.column_names.index("status"), field_, values)
    return table


def _write_joined_shard(
    joined: StudyFolder, shard: int, opened: Sequence[StudyFolder], tables: Mapping[int, pa.Table], pool: _JoinedRows
) -> None:
    """Writes a joined shard: its recordings, then its table."""
    import pyarrow as pa

    wanted = list(zip(*(part.tolist() for part in joined.shard_runs(shard)), strict=True))
    pieces, order = [], []
    for f, table in tables.items():
        keys = zip(*(table[name].to_pylist() for name in ("before", COPY_COLUMN)), strict=True)
        mine = {key: i for i, key in enumerate(keys)}
        chosen = [(k, pool.runs[task]) for k, task in enumerate(wanted) if pool.runs[task][0] == f]
        pieces.append(table.take(pa.array([mine[row, wanted[k][1]] for k, (_, row) in chosen], pa.int64())))
        order += [(k, f) for k, _ in chosen]
    _copy_states(joined, shard, opened, [(*pool.runs[task], *task) for task in wanted])
    table = pa.concat_tables(pieces, promote_options="permissive").combine_chunks()
    place = sorted(range(len(order)), key=lambda i: order[i][0])
    table, owners = table.take(pa.array(place, pa.int64())), [order[i][1] for i in place]
    if set(ARCHIVE_COLUMNS) <= set(table.column_names):
        table = _table_with_recordings(joined, shard, table, [opened[f] for f in owners])
    table = table.drop_columns(["before"] if joined.copies > 1 else ["before", COPY_COLUMN])
    joined.write_table(joined.table_path(shard), table.replace_schema_metadata(None), shard)


def _copy_states(
    joined: StudyFolder, shard: int, opened: Sequence[StudyFolder], runs: Sequence[tuple[int, int, int, int]]
) -> None:
    """Copies runs' end states to a joined shard."""
    held = {
        f: read_run_states(opened[f], [(row, copy) for of, row, _, copy in runs if of == f])
        for f in {r[0] for r in runs}
    }
    write_joined_states(joined, shard, [(number, copy, held[f].get((row, copy))) for f, row, number, copy in runs])


class _SourceTrajectories(Mapping[int, Trajectory]):
    """Trajectories of a joined shard, read when asked for."""

    def __init__(self, places: Sequence[tuple[Path, int]]) -> None:
        self.places = places

    def __getitem__(self, k: int) -> Trajectory:
        from warpchain.archive import read_archive

        path, number = self.places[k]
        return read_archive(path)[number]

    def __iter__(self) -> Iterator[int]:
        return iter(range(len(self.places)))

    def __len__(self) -> int:
        return len(self.places)


def _table_with_recordings(joined: StudyFolder, shard: int, table: pa.Table, owners: Sequence[StudyFolder]) -> pa.Table:
    """Table of a joined shard whose recordings are archived."""
    import pyarrow as pa

    from warpchain.archive import read_archive, write_archive
    from warpchain.archive.options import ArchiveOptions

    names, places = (table[name].to_pylist() for name in ARCHIVE_COLUMNS)
    rows = [k for k, name in enumerate(names) if name is not None]
    path = joined.archive_path(shard)
    if rows:
        for k in rows:
            owners[k].check_archive(names[k])
        held = [(owners[k].path / names[k], places[k]) for k in rows]
        archives = [read_archive(file) for file, _ in held]
        drives = [archive.drives[archive.row_of(n)] for archive, (_, n) in zip(archives, held, strict=True)]
        lines = [archive.metrics.slice(archive.row_of(n), 1) for archive, (_, n) in zip(archives, held, strict=True)]
        metrics = pa.concat_tables(lines, promote_options="permissive").combine_chunks()
        numbers = [table["variant"][k].as_py() for k in rows]
        info: RunInfo = archives[0].info
        run = Run(drives, metrics, _SourceTrajectories(held), info)
        write_archive(run, path, True, ArchiveOptions(numbers=numbers, attachments=joined.archive_mark(shard)))
    files = [f"shards/{path.name}" if name is not None else None for name in names]
    numbers_ = [v if name is not None else None for v, name in zip(table["variant"].to_pylist(), names, strict=True)]
    for name, values in zip(ARCHIVE_COLUMNS, (files, numbers_), strict=True):
        table = table_with_column(table, name, values)
    return table
