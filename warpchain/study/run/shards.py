"""Simulates one shard of a study: rows become drives, drives are simulated together, results become a table.

Neither the cut into shards nor a restart changes a bit of them.
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

from warpchain.drive.plugins import load_plugin, plugin_words
from warpchain.drive.replicates import numbered_copies
from warpchain.engine.simulation import MEMORY, available_cores
from warpchain.errors import DriveError, SimulationError, WarpchainError
from warpchain.gc_tuning import rare_collections
from warpchain.progress import RUNNING, ProgressReport, ignore_progress, partial_report
from warpchain.results.metrics import select_metrics, table_from_rows
from warpchain.results.own_metrics import PLUGINS_KEY
from warpchain.results.replicate_metrics import COPY_COLUMN
from warpchain.study.results import ADJUSTMENT_COLUMNS, ARCHIVE_COLUMNS, RUN_COLUMNS
from warpchain.study.run.row_drives import Variant, build_drives, check_variant
from warpchain.study.run.run_states import assign_initial_states, write_run_states
from warpchain.study.run.study_folder import StudyFolder, open_folder
from warpchain.study.spec.study_tables import adjustment_columns
from warpchain.study.store import OUTCOME_COLUMNS, check_no_symlink

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.archive.options import ArchiveOptions
    from warpchain.drive import Drive
    from warpchain.study.run.shard_plan import Indices
    from warpchain.study.spec import Study


def simulate_variants(
    study: Study,
    base: Drive,
    variants: Sequence[Variant],
    archive: Path,
    options: Mapping[str, Any],
    report: ProgressReport,
) -> None:
    """Builds, simulates and archives variants of a study.

    Args:
        variants: whose results are filled in.
        options: `memory`, `workers` and `archive_options` of `simulate`.
    """
    on = [variant for variant in variants if variant.initial_state is not None]
    if on and len(on) < len(variants):  # a GPU takes those that go on by themselves
        anew = [variant for variant in variants if variant.initial_state is None]
        share = len(anew) / len(variants)
        simulate_variants(study, base, anew, archive, options, partial_report(report, RUNNING, 0.0, share))
        simulate_variants(study, base, on, archive, options, partial_report(report, RUNNING, share, 1.0))
        return
    _build_copies(study, base, variants)
    runs = 1.0 if study.metrics.modes is None else 0.5  # of the whole, roughly
    of_runs = partial_report(report, RUNNING, 0.0, runs)

    def add_modes() -> None:
        """Adds modes' metrics to the variants."""
        _add_mode_metrics(study, base, variants, options.get("workers"), partial_report(report, RUNNING, runs, 1.0))

    if _has_room_for_recordings(study, variants, options.get("memory", MEMORY)):
        _simulate_feasible(study, variants, None, options, of_runs)
        _archive_recordings(variants, archive, options.get("archive_options"))
        add_modes()
        return
    streamed = [variant for variant in variants if variant.recorded]
    plain = [variant for variant in variants if not variant.recorded]
    share = len(plain) / len(variants)
    _simulate_feasible(study, plain, None, options, partial_report(of_runs, RUNNING, 0.0, share))
    _simulate_feasible(study, streamed, archive, options, partial_report(of_runs, RUNNING, share, 1.0))
    add_modes()


def _add_mode_metrics(
    study: Study, base: Drive, variants: Sequence[Variant], workers: int | None, report: ProgressReport
) -> None:
    """Adds metrics of the base drive's modes to variants."""
    if study.metrics.modes is None:
        return
    from warpchain.engine.process_pool import map_in_processes
    from warpchain.modal.campbell import base_drive_modes, mode_metrics

    work = partial(mode_metrics, base_drive_modes(base, study.metrics.modes))
    settled = [variant for variant in variants if variant.drive is not None and variant.metrics_row is not None]
    drives = [variant.drive for variant in settled]
    answers = map_in_processes(work, drives, workers or available_cores(), "modes", report)
    for variant, found in zip(settled, answers, strict=True):
        if isinstance(found, Exception):
            raise found
        variant.modes = found


def _build_copies(study: Study, base: Drive, variants: Sequence[Variant]) -> None:
    """Builds each row's drive once, for all its replicates."""
    made: dict[int, Variant] = {}
    for variant in variants:
        made.setdefault(variant.row["variant"], variant)
    build_drives(study, base, list(made.values()))
    for variant in variants:
        first = made[variant.row["variant"]]
        variant.drive, variant.reason, variant.adjusted = first.drive, first.reason, first.adjusted
    feasible = [(variant, variant.drive) for variant in variants if variant.drive is not None]
    numbers = [variant.copy for variant, _ in feasible]
    copies = numbered_copies([drive for _, drive in feasible], numbers, study.design.replicate_way)
    for (variant, _), drive in zip(feasible, copies, strict=True):
        variant.drive = drive


def _simulate_feasible(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: ProgressReport
) -> None:
    """Simulates a shard's feasible variants; those refused become infeasible."""
    feasible = [variant for variant in variants if variant.drive is not None]
    refused = _attempt_simulation(study, feasible, archive, options, report)
    if isinstance(refused, DriveError):
        for variant in feasible:
            check_variant(study, variant)
        feasible = [variant for variant in feasible if variant.drive is not None]
        refused = _attempt_simulation(study, feasible, archive, options, report)
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
            again = _attempt_simulation(study, half, None, options, report)
            if again is not None:
                groups.append((half, again))
    if len(blamed) == len(feasible) and isinstance(refused, SimulationError):
        raise refused
    for variant, error in blamed:
        variant.mark_infeasible(error)


def _attempt_simulation(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: ProgressReport
) -> WarpchainError | None:
    """Simulates a shard's variants; returns a refusal or None."""
    from warpchain.engine.checkpoint import States
    from warpchain.engine.simulation import simulate
    from warpchain.results.run import Record

    def on_progress(phase: str, done: float, total: float) -> None:
        """Reports a shard's progress, but for settling."""
        if phase != "settling":  # simulating begins anew
            report(phase, done, total)

    if not variants:
        return None
    recorded = [i for i, variant in enumerate(variants) if variant.recorded]
    if archive is not None:
        options = {**options, "archive_options": _archive_options(variants, options.get("archive_options"))}
    states = None
    if study.run.keep_states or any(variant.initial_state is not None for variant in variants):
        states = States(study.run.keep_states, [variant.initial_state for variant in variants])
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
        variant.metrics_row = metrics, i
        if states is not None:
            variant.final_state, variant.resumed = states.kept[i], states.used[i]
        if archive is not None:
            variant.archive = (archive.name, variant.row["variant"])
        elif variant.recorded:
            variant.trajectory, variant.info = run[i], run.info
    return None


def _has_room_for_recordings(study: Study, variants: Sequence[Variant], memory: int) -> bool:
    """Whether a shard's recorded trajectories fit into memory."""
    from warpchain.engine.simulation import schedules_of
    from warpchain.results.channels import drive_frame_width, frame_with_channels
    from warpchain.results.run import Record

    record, frame, size = Record(rate=study.record.rate), frame_with_channels(study.record.channels), 0
    for variant in variants:
        if variant.recorded and variant.drive is not None:
            try:
                (schedule,) = schedules_of(
                    [variant.drive], study.run.duration, study.run.step, record, study.run.window
                )
            except (DriveError, SimulationError):
                continue  # it is said when it is simulated
            size += 8 * schedule.frames * drive_frame_width(variant.drive, frame)
    return 2 * size <= memory


def _archive_options(variants: Sequence[Variant], options: ArchiveOptions | None) -> ArchiveOptions:
    """Options of a shard's archive, numbered as the study."""
    from warpchain.archive.options import ArchiveOptions

    return replace(options or ArchiveOptions(), numbers=[variant.row["variant"] for variant in variants])


def _archive_recordings(variants: Sequence[Variant], path: Path, options: ArchiveOptions | None) -> None:
    """Writes recorded variants' trajectories into a shard's archive."""
    from warpchain.archive import write_archive
    from warpchain.results.metrics import table_from_rows
    from warpchain.results.run import Run

    held = [variant for variant in variants if variant.trajectory is not None]
    if not held:
        return
    drives = tuple(variant.drive for variant in held if variant.drive is not None)
    metrics = table_from_rows([variant.metrics for variant in held])
    trajectories = {i: v.trajectory for i, v in enumerate(held) if v.trajectory is not None}
    assert held[0].info is not None  # comes with the trajectory
    write_archive(Run(drives, metrics, trajectories, held[0].info), path, True, _archive_options(held, options))
    for variant in held:
        variant.archive, variant.trajectory = (path.name, variant.row["variant"]), None


@rare_collections()
def run_shard(
    folder: str | Path, shard: int, options: Mapping[str, Any] | None = None, report: ProgressReport = ignore_progress
) -> int:
    """Simulates a study's shard; returns its number of runs.

    Args:
        options: `memory` and `workers` of `simulate`; `plugins`, files to load.

    Raises:
        WarpchainError: an error that is not of single variants, such as a full disk.
        KeyboardInterrupt: nothing is written.
    """
    opened = _open_with_plugins(Path(folder), options)
    if not opened.is_done(shard):
        numbers, copies = opened.shard_runs(shard)
        recorded = opened.directly_recorded()
        tasks = zip(numbers.tolist(), copies.tolist(), strict=True)
        chosen = {i for i, (row, copy) in enumerate(tasks) if copy == 0 and row in recorded}
        _simulate_and_write(opened, shard, _rows_of_runs(opened, numbers, copies), chosen, options or {}, report)
    return opened.shard_run_count(shard)


def record_worst_variants(
    folder: Path,
    variants: Sequence[tuple[int, int]],
    options: Mapping[str, Any] | None = None,
    report: ProgressReport = ignore_progress,
) -> None:
    """Simulates a study's worst variants again, recorded."""
    opened = _open_with_plugins(folder, options)
    place = {variant: row for row, variant in enumerate(opened.read_design()["variant"].to_pylist())}
    numbers = np.array([place[variant] for variant, _ in variants], dtype=np.int64)
    copies = np.array([copy for _, copy in variants], dtype=np.int64)
    rows = _rows_of_runs(opened, numbers, copies)
    _simulate_and_write(opened, opened.worst_shard, rows, set(range(len(variants))), options or {}, report)


def _open_with_plugins(folder: Path, options: Mapping[str, Any] | None) -> StudyFolder:
    """Study folder, opened after its plug-ins were loaded."""
    for file in (options or {}).get("plugins", ()):
        load_plugin(file)
    opened = open_folder(folder)
    opened.check_plugins()
    return opened


def _rows_of_runs(folder: StudyFolder, numbers: Indices, copies: Indices) -> pa.Table:
    """Design rows of runs, with their copies."""
    import pyarrow as pa

    rows = folder.read_design().take(pa.array(numbers, pa.int64()))
    return rows.add_column(1, COPY_COLUMN, pa.array(copies, pa.int64())) if folder.copies > 1 else rows


def _simulate_and_write(
    folder: StudyFolder,
    shard: int | str,
    rows: pa.Table,
    recorded: set[int],
    options: Mapping[str, Any],
    report: ProgressReport,
) -> None:
    """Simulates a shard's rows; writes its archive and table."""
    from warpchain.archive.options import ArchiveOptions

    study = folder.study
    options = {name: value for name, value in options.items() if name != "plugins"}
    options["archive_options"] = ArchiveOptions(attachments=folder.archive_mark(shard))
    found = enumerate(rows.to_pylist())
    variants = [
        Variant(row, reason=row["reason"], recorded=i in recorded, copy=row.pop(COPY_COLUMN, 0)) for i, row in found
    ]
    if isinstance(shard, int):
        assign_initial_states(folder, variants)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # thousands of offset links need no line each
        check_no_symlink(folder.archive_path(shard))
        simulate_variants(study, folder.base_drive, variants, folder.archive_path(shard), options, report)
    table = shard_table(study, rows, variants)
    if isinstance(shard, int) and (study.run.keep_states or any(variant.resumed for variant in variants)):
        write_run_states(folder, shard, variants)
    folder.write_table(folder.table_path(shard), table, shard if isinstance(shard, int) else None)


def shard_table(study: Study, rows: pa.Table, variants: Sequence[Variant]) -> pa.Table:
    """Table of a shard's results: factors, status, metrics."""
    import pyarrow as pa

    status, reason = OUTCOME_COLUMNS
    extra: dict[str, tuple[Any, list[Any], str]] = {
        status: (pa.string(), [variant.status for variant in variants], ""),
        reason: (pa.string(), [variant.outcome_reason() for variant in variants], ""),
    }
    for name in adjustment_columns(study.adjust):
        unit = ADJUSTMENT_COLUMNS[name.rpartition(".")[2]]
        kind = pa.float64() if unit else pa.int64()
        extra[name] = (kind, [variant.adjusted.get(name) for variant in variants], unit)
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
    metrics = _kept_metrics(study, variants)
    for field_, column in zip(metrics.schema, metrics.columns, strict=True):
        if field_.name != "variant":
            role = {} if field_.name in RUN_COLUMNS else {"role": "metric"}
            columns.append(column.combine_chunks())
            fields.append(field_.with_metadata({**field_.metadata, **role}))
    words = plugin_words()
    return pa.Table.from_arrays(columns, schema=pa.schema(fields, metadata=words and {PLUGINS_KEY: words}))


def _kept_metrics(study: Study, variants: Sequence[Variant]) -> pa.Table:
    """Table of a shard's metrics that the study keeps."""
    patterns, dropped = kept_metric_patterns(study), {"variant", "diverged", *OUTCOME_COLUMNS}

    @cache
    def is_kept(name: str) -> bool:
        """Whether the study keeps a metric of this name."""
        return name not in dropped and any(fnmatchcase(name, pattern) for pattern in patterns)

    tables = {
        id(variant.metrics_row[0]): variant.metrics_row[0] for variant in variants if variant.metrics_row is not None
    }
    if len(tables) == 1 and not any(variant.modes for variant in variants):
        (table,) = tables.values()
        return select_metrics(table, [variant.metrics_row and variant.metrics_row[1] for variant in variants], is_kept)
    rows = [variant.metrics for variant in variants]
    return table_from_rows([{name: value for name, value in row.items() if is_kept(name)} for row in rows])


def kept_metric_patterns(study: Study) -> tuple[str, ...]:
    """Patterns of the metrics' names that a study keeps."""
    worst = study.record.worst
    wanted = [name for metric in study.named_metrics for name in (metric, f"{metric}_se")]
    return (*study.metrics.keep, *wanted, *(() if worst is None else (worst.metric,)))
