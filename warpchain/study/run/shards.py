"""One shard of a study: its rows become drives, the drives are simulated together, inputs and metrics become a table.

A variant's results do not depend on the others (`warpchain.simulate`), so neither the cut into shards nor a restart
changes a bit of them. A row that gives no drive, or a drive that cannot be assembled or stepped, is a row with its
reason.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.drive.replicates import copies_of
from warpchain.engine.simulation import MEMORY, available_cores
from warpchain.errors import DriveError, SimulationError, WarpchainError
from warpchain.gc_tuning import rare_collections
from warpchain.progress import RUNNING, ProgressReport, ignore_progress, partial_report
from warpchain.results.metrics import gathered, table_of
from warpchain.results.replicate_metrics import COPY
from warpchain.study.results import ADJUSTMENT_COLUMNS, ARCHIVE_COLUMNS, RUN_COLUMNS
from warpchain.study.run.checkpoints import begin_with, write_states
from warpchain.study.run.folder import Folder, open_folder
from warpchain.study.run.row_drives import Variant, build, try_alone
from warpchain.study.spec.study_tables import named_adjustments
from warpchain.study.store import OUTCOME_COLUMNS, check_no_symlink

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.archive.options import ArchiveOptions
    from warpchain.drive import Drive
    from warpchain.study.run.shard_plan import Numbers
    from warpchain.study.spec import Study


def simulate_variants(
    study: Study,
    base: Drive,
    variants: Sequence[Variant],
    archive: Path,
    options: Mapping[str, Any],
    report: ProgressReport,
) -> None:
    """Makes the variants' drives, simulates them, and archives those to be recorded.

    Recorded variants are simulated with the others and held until the end, if they find room in half of the memory;
    else in a call of their own, which writes while it runs.

    Args:
        study: what to do.
        base: the base drive.
        variants: the rows; they are filled.
        archive: file of the recorded variants.
        options: `memory`, `workers` and `archive_options` of `simulate`.
        report: called as the work goes on.

    Raises:
        SimulationError: a refusal of every variant.
        ArchiveError: the archive cannot be written.
        KeyboardInterrupt: the user stopped it.
    """
    on = [variant for variant in variants if variant.begin is not None]
    if on and len(on) < len(variants):  # a GPU takes those that go on by themselves
        anew = [variant for variant in variants if variant.begin is None]
        share = len(anew) / len(variants)
        simulate_variants(study, base, anew, archive, options, partial_report(report, RUNNING, 0.0, share))
        simulate_variants(study, base, on, archive, options, partial_report(report, RUNNING, share, 1.0))
        return
    _build_all(study, base, variants)
    runs = 1.0 if study.metrics.modes is None else 0.5  # of the whole, roughly
    of_runs = partial_report(report, RUNNING, 0.0, runs)

    def follow() -> None:
        _follow_modes(study, base, variants, options.get("workers"), partial_report(report, RUNNING, runs, 1.0))

    if _held(study, variants, options.get("memory", MEMORY)):
        _simulate(study, variants, None, options, of_runs)
        _archive(variants, archive, options.get("archive_options"))
        follow()
        return
    streamed = [variant for variant in variants if variant.recorded]
    plain = [variant for variant in variants if not variant.recorded]
    share = len(plain) / len(variants)
    _simulate(study, plain, None, options, partial_report(of_runs, RUNNING, 0.0, share))
    _simulate(study, streamed, archive, options, partial_report(of_runs, RUNNING, share, 1.0))
    follow()


def _follow_modes(
    study: Study, base: Drive, variants: Sequence[Variant], workers: int | None, report: ProgressReport
) -> None:
    """Adds the base drive's modes to the metrics of the variants, where the study asks for them."""
    if study.metrics.modes is None:
        return
    from warpchain.engine.processes import each
    from warpchain.modal.campbell import base_drive_modes, mode_metrics

    work = partial(mode_metrics, base_drive_modes(base, study.metrics.modes))
    settled = [variant for variant in variants if variant.drive is not None and variant.measured is not None]
    drives = [variant.drive for variant in settled]
    answers = each(work, drives, workers or available_cores(), "modes", report)
    for variant, found in zip(settled, answers, strict=True):
        if isinstance(found, Exception):
            raise found
        variant.modes = found


def _build_all(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Makes the drives of all rows, each once, and the copies that are run of them."""
    made: dict[int, Variant] = {}
    for variant in variants:
        made.setdefault(variant.row["variant"], variant)
    build(study, base, list(made.values()))
    for variant in variants:
        first = made[variant.row["variant"]]
        variant.drive, variant.reason, variant.adjusted = first.drive, first.reason, first.adjusted
    feasible = [(variant, variant.drive) for variant in variants if variant.drive is not None]
    numbers = [variant.copy for variant, _ in feasible]
    copies = copies_of([drive for _, drive in feasible], numbers, study.design.replicate_way)
    for (variant, _), drive in zip(feasible, copies, strict=True):
        variant.drive = drive


def _simulate(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: ProgressReport
) -> None:
    """Simulates the variants that have a drive; those that are refused fail alone.

    A drive that cannot be assembled or stepped ends the whole call, so then each is tried alone. What else is refused
    is halved until it is known which variants are to blame; a refusal of every variant is the study's own.
    """
    feasible = [variant for variant in variants if variant.drive is not None]
    refused = _attempt(study, feasible, archive, options, report)
    if isinstance(refused, DriveError):
        for variant in feasible:
            try_alone(study, variant)
        feasible = [variant for variant in feasible if variant.drive is not None]
        refused = _attempt(study, feasible, archive, options, report)
    if refused is None:
        return
    if archive is not None:
        raise refused
    blamed: list[tuple[Variant, WarpchainError]] = []
    groups = [(feasible, refused)]
    while groups:
        group, error = groups.pop()
        if len(group) == 1:
            blamed.append((group[0], error))
            continue
        for half in (group[: len(group) // 2], group[len(group) // 2 :]):
            again = _attempt(study, half, None, options, report)
            if again is not None:
                groups.append((half, again))
    if len(blamed) == len(feasible) and isinstance(refused, SimulationError):
        raise refused
    for variant, error in blamed:
        variant.fail(error)


def _attempt(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: ProgressReport
) -> WarpchainError | None:
    """Simulates variants in one call; returns a refusal of a drive, of the settings or of the machine's memory."""
    from warpchain.engine.checkpoint import States
    from warpchain.engine.simulation import simulate
    from warpchain.results.run import Record

    def on_progress(phase: str, done: float, total: float) -> None:
        if phase != "settling":  # simulating begins anew
            report(phase, done, total)

    if not variants:
        return None
    recorded = [i for i, variant in enumerate(variants) if variant.recorded]
    if archive is not None:
        options = {**options, "archive_options": _numbered(variants, options.get("archive_options"))}
    states = None
    if study.run.keep_states or any(variant.begin is not None for variant in variants):
        states = States(study.run.keep_states, [variant.begin for variant in variants])
    try:
        run = simulate(
            [variant.drive for variant in variants if variant.drive is not None],
            device=study.run.device,
            precision=study.run.precision,
            duration=study.run.duration,
            step=study.run.step,
            record=Record(recorded, study.record.rate, study.record.channels),
            window=study.run.window,
            progress=on_progress,
            archive=archive,
            overwrite=True,
            limits=study.limits,
            states=states,
            **options,
        )
    except (DriveError, SimulationError) as error:
        return error
    if run.info.ended != "complete":
        if archive is not None:
            archive.unlink(missing_ok=True)
        raise KeyboardInterrupt
    metrics = run.metrics.combine_chunks()
    for i, variant in enumerate(variants):
        variant.measured = metrics, i
        if states is not None:
            variant.kept, variant.gone_on = states.kept[i], states.used[i]
        if archive is not None:
            variant.archive = (archive.name, variant.row["variant"])
        elif variant.recorded:
            variant.trajectory, variant.info = run[i], run.info
    return None


def _held(study: Study, variants: Sequence[Variant], memory: int) -> bool:
    """Whether the trajectories of the recorded variants find room in half of the memory."""
    from warpchain.engine.simulation import schedules_of
    from warpchain.results.channels import frame_of, frame_width
    from warpchain.results.run import Record

    record, frame, size = Record(rate=study.record.rate), frame_of(study.record.channels), 0
    for variant in variants:
        if variant.recorded and variant.drive is not None:
            try:
                (schedule,) = schedules_of(
                    [variant.drive], study.run.duration, study.run.step, record, study.run.window
                )
            except (DriveError, SimulationError):
                continue  # it is said when it is simulated
            size += 8 * schedule.frames * frame_width(variant.drive, frame)
    return 2 * size <= memory


def _numbered(variants: Sequence[Variant], options: ArchiveOptions | None) -> ArchiveOptions:
    """Options of an archive that calls its variants by their numbers in the study."""
    from warpchain.archive.options import ArchiveOptions

    return replace(options or ArchiveOptions(), numbers=[variant.row["variant"] for variant in variants])


def _archive(variants: Sequence[Variant], path: Path, options: ArchiveOptions | None) -> None:
    """Writes the trajectories that are held, as an archive of their variants alone, by their numbers in the study."""
    from warpchain.archive import write_archive
    from warpchain.results.metrics import table_of
    from warpchain.results.run import Run

    held = [variant for variant in variants if variant.trajectory is not None]
    if not held:
        return
    drives = tuple(variant.drive for variant in held if variant.drive is not None)
    metrics = table_of([variant.metrics for variant in held])
    trajectories = {i: v.trajectory for i, v in enumerate(held) if v.trajectory is not None}
    assert held[0].info is not None  # comes with the trajectory
    write_archive(Run(drives, metrics, trajectories, held[0].info), path, True, _numbered(held, options))
    for variant in held:
        variant.archive, variant.trajectory = (path.name, variant.row["variant"]), None


@rare_collections()
def run_shard(
    folder: str | Path, shard: int, options: Mapping[str, Any] | None = None, report: ProgressReport = ignore_progress
) -> int:
    """Simulates one shard and writes its results; does nothing if they are there.

    Args:
        folder: the study's folder, on a disk that the caller shares.
        shard: its number.
        options: `memory` and `workers` of `simulate`.
        report: called as the work goes on.

    Returns:
        The number of its rows.

    Raises:
        WarpchainError: what no single variant is to blame for, such as an unknown device or a full disk.
        KeyboardInterrupt: the user stopped it; nothing is written.
    """
    opened = open_folder(Path(folder))
    if not opened.done(shard):
        numbers, copies = opened.tasks(shard)
        recorded = opened.recorded()
        tasks = zip(numbers.tolist(), copies.tolist(), strict=True)
        chosen = {i for i, (row, copy) in enumerate(tasks) if copy == 0 and row in recorded}
        _write(opened, shard, _rows(opened, numbers, copies), chosen, options or {}, report)
    return opened.size(shard)


def run_worst(
    folder: Path,
    variants: Sequence[tuple[int, int]],
    options: Mapping[str, Any] | None = None,
    report: ProgressReport = ignore_progress,
) -> None:
    """Simulates variants (number, copy) a second time to record them; see `run_shard`."""
    opened = open_folder(folder)
    place = {variant: row for row, variant in enumerate(opened.design()["variant"].to_pylist())}
    numbers = np.array([place[variant] for variant, _ in variants], dtype=np.int64)
    copies = np.array([copy for _, copy in variants], dtype=np.int64)
    rows = _rows(opened, numbers, copies)
    _write(opened, opened.worst, rows, set(range(len(variants))), options or {}, report)


def _rows(folder: Folder, numbers: Numbers, copies: Numbers) -> pa.Table:
    """Rows of the design, with the number of the copy where rows are run several times."""
    import pyarrow as pa

    rows = folder.design().take(pa.array(numbers, pa.int64()))
    return rows.add_column(1, COPY, pa.array(copies, pa.int64())) if folder.copies > 1 else rows


def _write(
    folder: Folder,
    shard: int | str,
    rows: pa.Table,
    recorded: set[int],
    options: Mapping[str, Any],
    report: ProgressReport,
) -> None:
    """Simulates rows; the archive lands first, then the table, which says that the shard is done."""
    from warpchain.archive.options import ArchiveOptions

    study = folder.study
    options = {**options, "archive_options": ArchiveOptions(attachments=folder.mark(shard))}
    found = enumerate(rows.to_pylist())
    variants = [Variant(row, reason=row["reason"], recorded=i in recorded, copy=row.pop(COPY, 0)) for i, row in found]
    if isinstance(shard, int):
        begin_with(folder, variants)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # thousands of offset links need no line each
        check_no_symlink(folder.archive_path(shard))
        simulate_variants(study, folder.drive, variants, folder.archive_path(shard), options, report)
    table = results_table(study, rows, variants)
    if isinstance(shard, int) and (study.run.keep_states or any(variant.gone_on for variant in variants)):
        write_states(folder, shard, variants)
    folder.write(folder.table_path(shard), table, shard if isinstance(shard, int) else None)


def results_table(study: Study, rows: pa.Table, variants: Sequence[Variant]) -> pa.Table:
    """Inputs and metrics of variants: a row a variant, fields marked role = "factor" and "metric", with their units."""
    import pyarrow as pa

    status, reason = OUTCOME_COLUMNS
    extra: dict[str, tuple[Any, list[Any], str]] = {
        status: (pa.string(), [variant.status for variant in variants], ""),
        reason: (pa.string(), [variant.outcome() for variant in variants], ""),
    }
    for _, before, adjust in named_adjustments(study.adjust):
        count, travel = (before + name for name in ADJUSTMENT_COLUMNS)
        if adjust.links is not None:
            extra[count] = (pa.int64(), [variant.adjusted.get(count) for variant in variants], "")
        if adjust.sprocket is not None:
            extra[travel] = (pa.float64(), [variant.adjusted.get(travel) for variant in variants], "m")
    record = study.record
    if record.variants or record.every or record.worst:
        archives = [variant.archive or (None, None) for variant in variants]
        file, place = ARCHIVE_COLUMNS
        extra[file] = (pa.string(), [name and f"shards/{name}" for name, _ in archives], "")
        extra[place] = (pa.int64(), [number for _, number in archives], "")
    columns = [rows[name].combine_chunks() for name in rows.column_names if name not in OUTCOME_COLUMNS]
    fields = [field for field in rows.schema if field.name not in OUTCOME_COLUMNS]
    for name, (kind, values, unit) in extra.items():
        columns.append(pa.array(values, kind))
        fields.append(pa.field(name, kind, metadata={"unit": unit} if unit else None))
    metrics = _metrics(study, variants)
    for field_, column in zip(metrics.schema, metrics.columns, strict=True):
        if field_.name != "variant":
            role = {} if field_.name in RUN_COLUMNS else {"role": "metric"}
            columns.append(column.combine_chunks())
            fields.append(field_.with_metadata({**role, "unit": field_.metadata[b"unit"]}))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _metrics(study: Study, variants: Sequence[Variant]) -> pa.Table:
    """The metrics that the study keeps, a row a variant; as they came, where all came of one run."""
    patterns, dropped = kept_patterns(study), {"variant", "diverged", *OUTCOME_COLUMNS}

    @cache
    def kept(name: str) -> bool:
        return name not in dropped and any(fnmatchcase(name, pattern) for pattern in patterns)

    tables = {id(variant.measured[0]): variant.measured[0] for variant in variants if variant.measured is not None}
    if len(tables) == 1 and not any(variant.modes for variant in variants):
        (table,) = tables.values()
        return gathered(table, [variant.measured and variant.measured[1] for variant in variants], kept)
    rows = [variant.metrics for variant in variants]
    return table_of([{name: value for name, value in row.items() if kept(name)} for row in rows])


def kept_patterns(study: Study) -> tuple[str, ...]:
    """The patterns of the metrics that are kept: those asked for, the one of `record.worst`, and those wanted."""
    worst = study.record.worst
    wanted = [name for metric in study.named_metrics for name in (metric, f"{metric}_se")]
    return (*study.metrics.keep, *wanted, *(() if worst is None else (worst.metric,)))
