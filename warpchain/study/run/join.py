"""Several studies' folders as one: the rows of all, each once, numbered through; the folders stay as they are.

Studies can be joined that run the same: one drive, the same factors with whatever ranges, the same run settings. A row
whose factors have the values of one before it is the same drive and run, so it is taken once, with the copies that
either has. Drives that differ in nothing but how they begin (`run.phase`) get a hidden factor for that: rows
whose other factors are equal then count as runs of one design.

The joined folder is a study's whose design is a table (`rows.parquet`): a first plan holds what was run, a second what
was not. `merged.parquet` says which row was which, and recordings are written anew under the new numbers.
"""

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
from warpchain.results.arrow_tables import with_column
from warpchain.results.replicate_metrics import COPY
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.study.design import make_design
from warpchain.study.results import ARCHIVE_COLUMNS, search_target_of
from warpchain.study.run.checkpoints import states_of, write_joined
from warpchain.study.run.folder import DRIVE_TEXT, Folder, Outcome, open_folder, plan_file, study_status, write_plan
from warpchain.study.run.runner import finish, runs_of
from warpchain.study.run.shard_plan import blocks_of
from warpchain.study.spec import Study, dumps_study
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.key_path_names import key_path_namer
from warpchain.study.spec.study_tables import Design, file_from_fields
from warpchain.study.store import write_study_text, write_table

if TYPE_CHECKING:
    import pyarrow as pa

BEGINNINGS: Mapping[str, Any] = {"phase": 0.0}
"""Keys of `run` that say how a drive begins, and their defaults; they become hidden factors."""
FREE = ("shard", "device", "keep_states")
"""Run settings that may differ."""
WANTED = ("objectives", "bounds", "optimize")
"""Fields of a study that no run depends on."""
SPREAD = ("range", "levels", "choice", "points", "distribution", "mean", "std", "sample", "group")
"""Keys of a factor that say how its values are spread, not what they do."""
ROWS, MERGED = "rows.parquet", "merged.parquet"
"""The joined design's table, and what its rows were before."""
Task = tuple[int, int]
"""Row and copy."""


def joined_study(opened: Sequence[Folder], rows: str) -> Study:
    """The joined study, without what follows from its rows.

    Args:
        rows: file of its design.

    Raises:
        StudyError: one line for each key in which they differ.
    """
    first = opened[0]
    lines = [line for other in opened[1:] for line in _differences(first, other)]
    if lines:
        raise StudyError("\n".join(dict.fromkeys(lines)))
    study = first.study
    wanted = {name: next((getattr(f.study, name) for f in opened if getattr(f.study, name)), getattr(study, name))
              for name in WANTED}  # fmt: skip
    factors = [_widened([_factor(f.study, factor.name) for f in opened]) for factor in study.factors]
    copies = max(f.copies for f in opened)
    ways = [f.study.design.replicate_by for f in opened if f.copies > 1]
    replicates, way = (copies, next(iter(ways))) if copies > 1 else (None, None)
    changed = {
        "study": study.study.model_copy(update={"drive": "drive.toml"}),
        "design": Design(kind="table", file=rows, replicates=replicates, replicate_by=way),
        "factors": (*(factor for factor in factors if factor is not None), *_beginnings(opened)),
    }
    return study.model_copy(update={**changed, **wanted})


def _factor(study: Study, name: str) -> Factor:
    return next(factor for factor in study.factors if factor.name == name)


def _differences(first: Folder, other: Folder) -> Iterator[str]:
    """Differences that keep two folders from being joined, a line each."""
    ours, theirs = _fixed(first), _fixed(other)
    if first.copies > 1 and other.copies > 1:
        for folder, fixed in ((first, ours), (other, theirs)):
            fixed["design"] = {"replicate_by": folder.study.design.replicate_way}
    place = key_path_namer(ours)
    for path, here, there in _unlike(ours, theirs):
        where = ".".join(map(str, path)) if path[0] == "drive" else place(path)
        yield (
            f"{other.path}: {where} = {_shown(there)}, but {_shown(here)} in {first.path}; only studies that run the "
            "same can be merged"
        )
    for name in WANTED:
        wanted = [getattr(folder.study, name) for folder in (first, other)]
        if all(wanted) and wanted[0] != wanted[1]:
            said = "limits" if name == "bounds" else name
            yield f"{other.path}: {said}: not those of {first.path}; only studies that want the same can be merged"
    names = {factor.name for factor in other.study.factors}
    for factor in first.study.factors:
        if factor.name in names and _widened([factor, _factor(other.study, factor.name)]) is None:
            yield (
                f"{other.path}: factors.{factor.name}: not distributed as in {first.path}; only ranges, levels and "
                "choices can be put together"
            )


def _fixed(folder: Folder) -> dict[str, Any]:
    """Values of a study that must be the same, by key."""
    found = file_from_fields(folder.study.model_dump(mode="json", exclude={"study", "design", *WANTED}))
    found["factors"] = {f.name: f.model_dump(mode="json", exclude=set(SPREAD)) for f in folder.study.factors}
    found["run"] = {key: value for key, value in found["run"].items() if key not in FREE}
    found["record"].pop("variants")
    own = folder.drive
    found["drive"] = own.model_copy(update={"run": own.run.model_copy(update=dict.fromkeys(BEGINNINGS))}).model_dump(
        mode="json"
    )
    return found


def _unlike(ours: Any, theirs: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[Any, Any, Any]]:
    """Key paths in which two nested values differ, and both values."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in dict.fromkeys([*ours, *theirs]):
            yield from _unlike(ours.get(key), theirs.get(key), (*path, key))
    elif isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        for k, (one, two) in enumerate(zip(ours, theirs, strict=True)):
            yield from _unlike(one, two, (*path, one.get("name", k) if isinstance(one, dict) else k))
    elif ours != theirs:
        yield path, ours, theirs


def _shown(value: Any) -> str:
    """A value for a message."""
    text = "nothing" if value is None else "a table" if isinstance(value, dict) else value_text(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _widened(factors: Sequence[Factor]) -> Factor | None:
    """A factor whose range, levels or choice take in those of all; None if there is none."""
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


def _beginnings(opened: Sequence[Folder]) -> Iterator[Factor]:
    """Hidden factors for what the drives differ in of how they begin."""
    for name in BEGINNINGS:
        if len({start_of(folder.drive, name) for folder in opened}) > 1:
            yield Factor(name=name, path=f"run.{name}", hidden=True)


def start_of(drive: Drive, name: str) -> Any:
    """A drive's value of a key of `BEGINNINGS`."""
    value = getattr(drive.run, name)
    return BEGINNINGS[name] if value is None else value


@dataclass(frozen=True)
class Joined:
    """Result of joining folders.

    Attributes:
        outcome: status of the joined study.
        rows: number of rows of each folder.
        together: number of rows of the joined study.
        mapping: file that says which row was which: columns `folder`, `before`, `variant`.
    """

    outcome: Outcome
    rows: tuple[int, ...]
    together: int
    mapping: Path


@dataclass
class _Pool:
    """Rows of several folders.

    Attributes:
        rows: values by factor of each joined row.
        place: number of the joined row with these values.
        runs: folder and row there that a joined run is taken from.
        numbers: (joined row of each row) of each folder.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    place: dict[tuple[Any, ...], int] = field(default_factory=dict)
    runs: dict[Task, tuple[int, int]] = field(default_factory=dict)
    numbers: list[list[int]] = field(default_factory=list)


@interruptible_work()
def join_studies(
    folders: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    memory: int = MEMORY,
) -> Joined:
    """Makes one study's folder of several; none of them is changed.

    What none of them has run yet is left to `run_study(OUT/study.toml, OUT)`.

    Args:
        folders: two or more, finished or not.
        out: the folder to make; it appears whole or not at all.
        workers, memory: for the worst variants, where they are still to be recorded; see `run_study`.

    Raises:
        StudyError: fewer than two folders, studies that do not run the same (one line for each key that differs), an
            existing `out`, or a folder or disk that refuses.
    """
    target = Path(out)
    if len(folders) < 2:
        raise StudyError("merge: needs at least two folders")
    opened = [open_folder(Path(folder)) for folder in folders]
    if target.exists():
        raise StudyError(f"{target}: is there already; give a new folder")
    for folder in opened:
        if aim := search_target_of(folder.design()):
            raise StudyError(
                f"{folder.path}: its rows look for {aim} and are no sample of the noise; they cannot be merged"
            )
    study = joined_study(opened, ROWS)
    pool = _pooled(opened, study)
    chosen = {pool.numbers[f][v] for f, folder in enumerate(opened) for v in folder.study.record.variants}
    study = study.model_copy(update={"record": study.record.model_copy(update={"variants": tuple(sorted(chosen))})})
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        place = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
    except OSError as error:
        raise StudyError(f"{target}: cannot be made ({error.strerror or error})") from None
    try:
        place.chmod(0o777 & ~_umask())
        _write(place, opened, study, pool)
        outcome = study_status(place)
        if not outcome.left:
            finish(open_folder(place), None, {"workers": workers, "memory": memory})
        place.rename(target)
    except OSError as error:
        raise StudyError(f"{target}: cannot be written ({error.strerror or error})") from None
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return Joined(study_status(target), tuple(f.rows for f in opened), len(pool.rows), target / MERGED)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _pooled(opened: Sequence[Folder], study: Study) -> _Pool:
    """The rows of all folders, each once, and where its runs are."""
    pool = _Pool()
    names = [factor.name for factor in study.factors]
    for f, folder in enumerate(opened):
        numbers = []
        for row in folder.design().to_pylist():
            values = {name: row[name] if name in row else start_of(folder.drive, name) for name in names}
            key = tuple(values[name] for name in names)
            if key not in pool.place:
                pool.place[key] = len(pool.rows)
                pool.rows.append(values)
            numbers.append(pool.place[key])
        pool.numbers.append(numbers)
        for shard in folder.shards:
            if folder.done(shard):
                for row, copy in zip(*(part.tolist() for part in folder.tasks(shard)), strict=True):
                    pool.runs.setdefault((numbers[row], copy), (f, row))
    return pool


def _write(place: Path, opened: Sequence[Folder], study: Study, pool: _Pool) -> None:
    """Writes the joined folder, but for the whole table."""
    import pyarrow as pa

    (place / "shards").mkdir()
    given = [factor.name for factor in study.factors if factor.value_source != "expression"]
    columns = {name: [row[name] for row in pool.rows] for name in given}
    write_table(place / ROWS, pa.table(columns))
    copies = study.design.copies
    done = sorted(pool.runs)
    every = ((row, copy) for row in range(len(pool.rows)) for copy in range(copies))
    missing = [task for task in every if task not in pool.runs]
    write_study_text(place / "drive.toml", dumps_drive(opened[0].drive))
    if (text := opened[0].path / DRIVE_TEXT).exists():
        write_study_text(place / DRIVE_TEXT, drive_text(read_drive_text(text), opened[0].drive))
    write_study_text(place / "study.toml", dumps_study(study))
    design = make_design(study, place / "study.toml")
    size = max(folder.shard for folder in opened)
    parts = [blocks_of(tasks, copies) for tasks in (done, missing) if tasks]
    after = ""
    for number, blocks in enumerate(parts):
        if number:
            write_study_text(place / plan_file("study.toml", number), dumps_study(study))
        write_table(place / plan_file("design.parquet", number), design)
        listed = [[*block.rows, *block.copies] for block in blocks]
        facts = {"rows": len(pool.rows), "shard": size, "blocks": listed, **({"after": after} if number else {})}
        write_plan(place, number, facts)
        after = open_folder(place).identity
    begun = [f for f, folder in enumerate(opened) if any(map(folder.done, folder.shards))]
    tables = {f: _renumbered(opened[f], pool, f, design) for f in begun}
    joined = open_folder(place)
    for shard in joined.parts[0].shards if done else ():
        _write_shard(joined, shard, opened, tables, pool)
    write_table(place / MERGED, _mapping(opened, pool))


def _mapping(opened: Sequence[Folder], pool: _Pool) -> pa.Table:
    """Which row was which."""
    import pyarrow as pa

    before = [v for folder in opened for v in folder.design()["variant"].to_pylist()]
    names = [str(folder.path) for folder in opened for _ in range(folder.rows)]
    return pa.table({"folder": names, "before": before, "variant": [v for part in pool.numbers for v in part]})


def _renumbered(folder: Folder, pool: _Pool, f: int, design: pa.Table) -> pa.Table:
    """A folder's runs with their joined numbers and factors, and their rows there in `before`."""
    import pyarrow as pa

    table = runs_of(folder)
    row_of = {variant: row for row, variant in enumerate(folder.design()["variant"].to_pylist())}
    rows = [row_of[variant] for variant in table["variant"].to_pylist()]
    numbers = pa.array([pool.numbers[f][row] for row in rows], pa.int64())
    table = with_column(table.append_column("before", pa.array(rows, pa.int64())), "variant", numbers.to_pylist())
    if COPY not in table.column_names:
        table = table.add_column(1, COPY, pa.array([0] * table.num_rows, pa.int64()))
    inputs = design.take(numbers)
    for name in inputs.column_names[1:-2]:
        field_, values = inputs.schema.field(name), inputs[name]
        if name in table.column_names:
            table = table.set_column(table.column_names.index(name), field_, values)
        else:
            table = table.add_column(table.column_names.index("status"), field_, values)
    return table


def _write_shard(
    joined: Folder, shard: int, opened: Sequence[Folder], tables: Mapping[int, pa.Table], pool: _Pool
) -> None:
    """Writes a shard of what was run: its recordings under their new numbers, then its table."""
    import pyarrow as pa

    wanted = list(zip(*(part.tolist() for part in joined.tasks(shard)), strict=True))
    pieces, order = [], []
    for f, table in tables.items():
        keys = zip(*(table[name].to_pylist() for name in ("before", COPY)), strict=True)
        mine = {key: i for i, key in enumerate(keys)}
        chosen = [(k, pool.runs[task]) for k, task in enumerate(wanted) if pool.runs[task][0] == f]
        pieces.append(table.take(pa.array([mine[row, wanted[k][1]] for k, (_, row) in chosen], pa.int64())))
        order += [(k, f) for k, _ in chosen]
    _keep_states(joined, shard, opened, [(*pool.runs[task], *task) for task in wanted])
    table = pa.concat_tables(pieces, promote_options="permissive").combine_chunks()
    place = sorted(range(len(order)), key=lambda i: order[i][0])
    table, owners = table.take(pa.array(place, pa.int64())), [order[i][1] for i in place]
    if set(ARCHIVE_COLUMNS) <= set(table.column_names):
        table = _with_recordings(joined, shard, table, [opened[f] for f in owners])
    table = table.drop_columns(["before"] if joined.copies > 1 else ["before", COPY])
    joined.write(joined.table_path(shard), table.replace_schema_metadata(None), shard)


def _keep_states(
    joined: Folder, shard: int, opened: Sequence[Folder], runs: Sequence[tuple[int, int, int, int]]
) -> None:
    """Carries over the states of runs; `runs` has folder, row there, joined row and copy of each."""
    held = {
        f: states_of(opened[f], [(row, copy) for of, row, _, copy in runs if of == f]) for f in {r[0] for r in runs}
    }
    write_joined(joined, shard, [(number, copy, held[f].get((row, copy))) for f, row, number, copy in runs])


class _Recordings(Mapping[int, Trajectory]):
    """Trajectories of a shard's recorded rows, read when they are asked for."""

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


def _with_recordings(joined: Folder, shard: int, table: pa.Table, owners: Sequence[Folder]) -> pa.Table:
    """The shard's table with its own archive, which is written from those of the folders."""
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
        run = Run(drives, metrics, _Recordings(held), info)
        write_archive(run, path, True, ArchiveOptions(numbers=numbers, attachments=joined.mark(shard)))
    files = [f"shards/{path.name}" if name is not None else None for name in names]
    numbers_ = [v if name is not None else None for v, name in zip(table["variant"].to_pylist(), names, strict=True)]
    for name, values in zip(ARCHIVE_COLUMNS, (files, numbers_), strict=True):
        table = with_column(table, name, values)
    return table
