"""Prepares a study to run: reads and checks its file, makes its rows, makes or grows its folder."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive, load_drive
from warpchain.drive.drive_text import self_contained_text
from warpchain.drive.examples import drive_path
from warpchain.drive.schema import nearest_key_text, node_list, valid_part
from warpchain.drive.toml import value_text
from warpchain.engine.simulation import available_cores
from warpchain.errors import DriveError, StudyError
from warpchain.files import read_text_file, refusals_as_errors, whole_file
from warpchain.model import Model
from warpchain.results.fatigue import rainflow_counter
from warpchain.study.design import make_design
from warpchain.study.run.shard_plan import RunBlock
from warpchain.study.run.study_folder import (
    DRIVE_TEXT_FILE,
    REPLICATES_FILE,
    StudyFolder,
    differing_tables,
    make_folder,
    open_folder,
    plan_file_name,
    write_plan,
)
from warpchain.study.run.today import design_with_today
from warpchain.study.spec import Study, check_base_drive, dumps_study, load_study
from warpchain.study.spec.calibration_tables import Calibrate, Measurement
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.key_path_names import key_path_namer
from warpchain.study.spec.noise_table import statistic_from_name
from warpchain.study.spec.study_file import Subject, factor_count_complaint
from warpchain.study.spec.study_tables import (
    SAMPLED_DESIGNS,
    Adjust,
    Bound,
    Keep,
    Objective,
    Recording,
    RunOptions,
    adjustment_columns,
    fields_from_file,
)
from warpchain.study.store import write_study_text, write_table

if TYPE_CHECKING:
    import pyarrow as pa

SHARD_SECONDS = 30.0
CORE_RATE, GPU_RATE = 1e8, 2e10
"""Assumed roller-steps a second."""
SETTLE_STEPS = 30_000
HOST_SECONDS, MODES_SECONDS = 2e-3, 0.15
"""Core time of a row, and of modes [s]."""
CORE_VARIANTS, GPU_VARIANTS = 8, 4224
ROLLER_BYTES, VARIANT_BYTES = 500, 100_000


def prepare_folder(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    parts: int,
    workers: int | None,
    memory: int,
    grow: bool = False,
) -> StudyFolder:
    """Study folder made, grown or opened; arguments as of `run_study`."""
    begun = (Path(out) / "plan.json").exists()
    if begun:
        open_folder(Path(out)).check_plugins()
    study, drive, design = read_study(source)
    runs = design.num_rows * study.design.copies
    size = study.run.shard or preferred_shard_size(study, drive, runs, parts, workers or available_cores(), memory)
    if not grow or not begun:
        folder = make_folder(Path(out), study, drive, design, size)
        write_study_text(folder.path / DRIVE_TEXT_FILE, self_contained_text(base_drive_file(study, source)), keep=True)
        return folder
    folder = open_folder(Path(out))
    fixed = study.model_copy(update={"study": folder.study.study.model_copy(update={"name": study.study.name})})
    if folder.base_drive == drive and differing_tables(folder.study, fixed) and is_growable(folder.study, fixed):
        return grow_folder(folder, study, Path(source), size)
    return make_folder(Path(out), study, drive, design, size)


def read_study(
    source: str | os.PathLike[str], base: str | os.PathLike[str] | None = None
) -> tuple[Study, Drive, pa.Table]:
    """Study, base drive and design table, read and checked.

    Args:
        base: another base drive's file or example.

    Raises:
        StudyError: a line for each error.
    """
    try:
        study, wrong = load_study(source), ""
    except StudyError as error:
        readable, wrong = _readable_study(source), str(error)
        if readable is None:
            raise
        study = readable
    try:
        drive = load_drive(base_drive_file(study, source, base))
    except DriveError as error:
        lines = [
            f'{source}: study.drive = "{study.study.drive if base is None else base}": {line}' for line in error.errors
        ]
        raise StudyError("\n".join([*wrong.splitlines(), *lines])) from None
    if study.run.start is not None:
        drive = drive.with_values({"run.start": study.run.start})
    lines = [*wrong.splitlines(), *_drive_mistakes(study, drive, source)]
    if lines:
        raise StudyError("\n".join(dict.fromkeys(lines)))
    if study.fatigue is not None:
        rainflow_counter()  # refused now, not when all variants have run
    design = design_with_today(study, drive, make_design(study, Path(source)), source)
    for variant in study.record.variants:
        if variant >= design.num_rows:
            lines.append(f"{source}: record.variants = {variant}: must be below the number of rows, {design.num_rows}")
    if lines:
        raise StudyError("\n".join(lines))
    return study, drive, design


def base_drive_file(study: Study, source: str | os.PathLike[str], base: str | os.PathLike[str] | None = None) -> Path:
    """Path of a study's base drive; arguments as of `read_study`."""
    word = study.study.drive if base is None else os.fspath(base)
    beside = Path(source).parent / word if base is None else Path(word)
    return beside if beside.exists() or beside.suffix == ".toml" else drive_path(word)


def _drive_mistakes(study: Study, drive: Drive, source: str | os.PathLike[str]) -> list[str]:
    """Lines on a study's errors against its drive."""
    lines: list[str] = []
    for check in (check_base_drive, check_metric_names):
        try:
            check(study, drive, str(source))
        except StudyError as error:
            lines += str(error).splitlines()
    return lines


def _readable_study(source: str | os.PathLike[str]) -> Study | None:
    """Study of a faulty file's valid parts, or None."""
    import tomllib

    try:
        values = fields_from_file(tomllib.loads(read_text_file(source, "TOML", ValueError)))
    except (OSError, ValueError, RecursionError):
        return None
    subject = valid_part(Subject, values.get("study"))
    if subject is None or factor_count_complaint(values):
        return None
    factors = [
        valid_part(Factor, factor) or valid_part(Factor, _factor_without_values(factor))
        for factor in node_list(values, "factors")
    ]
    adjusts = [valid_part(Adjust, adjust) for adjust in node_list(values, "adjust")]
    held: dict[str, Any] = {
        "run": valid_part(RunOptions, values.get("run")) or RunOptions(),
        "metrics": valid_part(Keep, values.get("metrics")) or Keep(),
        "record": valid_part(Recording, values.get("record")) or Recording(),
        "adjust": tuple(adjusts) if all(adjusts) else (),  # all, as lines have their places
        "objectives": tuple(
            o for o in (valid_part(Objective, e) for e in node_list(values, "objectives")) if o is not None
        ),
        "bounds": tuple(b for b in (valid_part(Bound, e) for e in node_list(values, "bounds")) if b is not None),
        "measured": tuple(
            m for m in (valid_part(Measurement, e) for e in node_list(values, "measured")) if m is not None
        ),
        "calibrate": valid_part(Calibrate, values.get("calibrate")),
    }
    return Study.model_construct(study=subject, factors=tuple(f for f in factors if f is not None), **held)


def _factor_without_values(factor: Any) -> dict[str, Any]:
    """Keys of a faulty factor's targets, with some range."""
    keys = ("name", "path", "paths", "shift", "along", "relative", "offset")
    held = {key: factor[key] for key in keys if key in factor} if isinstance(factor, dict) else {}
    return {**held, "range": [0.0, 1.0]}


def preferred_shard_size(study: Study, drive: Drive, rows: int, parts: int, cores: int, memory: int) -> int:
    """Number of runs for a shard of some 30 s."""
    links = drive.links
    fits = memory // (ROLLER_BYTES * links + VARIANT_BYTES)
    try:
        step = resolve_step(drive, study.run.step)
    except DriveError:
        step = 1e-5
    gpus = gpu_count(study.run.device)
    work = links * (study.run.duration or drive.run.duration) / step
    seconds = work / stored_step_rate(gpus, cores) + overhead_seconds(study, drive, gpus, cores)
    wanted = max(int(SHARD_SECONDS / seconds), GPU_VARIANTS * gpus or CORE_VARIANTS * cores)
    return max(1, min(wanted, fits, -(-rows // parts)))


def stored_step_rate(gpus: int, cores: int) -> float:
    """Assumed roller-steps a second of GPUs or cores."""
    return GPU_RATE * gpus or CORE_RATE * cores


def overhead_seconds(study: Study, drive: Drive, gpus: int, cores: int) -> float:
    """Approximate time [s] of a run beside its steps."""
    settling = drive.links * SETTLE_STEPS / stored_step_rate(gpus, cores) if drive.run.settle else 0.0
    return settling + (HOST_SECONDS + (MODES_SECONDS if study.metrics.modes is not None else 0.0)) / cores


def gpu_count(device: str | None) -> int:
    """Number of GPUs in a study's device name."""
    if device in (None, "cuda"):
        import warp as wp

        return int(wp.get_cuda_device_count())
    return int(str(device).startswith("cuda:"))


def check_metric_names(study: Study, drive: Drive, source: str | os.PathLike[str]) -> None:
    """Raises StudyError for a study's metrics that its drive lacks."""
    from warpchain.results.metric_columns import MODE_METRICS, metric_names

    names, lines = metric_names(drive), []
    if study.metrics.modes is not None:
        from warpchain.modal.campbell import METRIC_PREFIX, base_drive_modes

        modes = base_drive_modes(drive, study.metrics.modes).names
        followed = [f"{METRIC_PREFIX}{name}.{column.name}" for name in modes for column in MODE_METRICS]
        names += followed
        if not any(fnmatchcase(name, one) for name in followed for one in (*study.metrics.keep, *study.named_metrics)):
            lines.append(f'metrics.modes = {study.metrics.modes}: metrics.keep keeps none; add "{METRIC_PREFIX}*"')
    place = key_path_namer(study)
    for i, pattern in enumerate(study.metrics.keep):
        if not any(fnmatchcase(name, pattern) for name in names):
            lines.append(
                f'{place(("metrics", "keep", i))} = "{pattern}": no such metric; {nearest_key_text(pattern, names, 8)}'
            )
    worst = study.record.worst
    if worst is not None and worst.metric not in names:
        lines.append(
            f'record.worst.metric = "{worst.metric}": no such metric; {nearest_key_text(worst.metric, names, 8)}'
        )
    lines += _unknown_metric_lines(study, drive, names)
    for factor in study.factors:
        if factor.name in names:
            lines.append(f'factors.{factor.name}.name = "{factor.name}": must not be the name of a metric')
    if lines:
        raise StudyError("\n".join(f"{source}: {line}" for line in lines))


def _unknown_metric_lines(study: Study, drive: Drive, names: Sequence[str]) -> Iterator[str]:
    """Lines on names of metrics that a drive lacks."""
    from warpchain.results.measured import signal_units
    from warpchain.results.metric_columns import RECORDED_METRICS, groups_of_drive

    recorded = {
        prefix + c.name
        for chain in Model(drive).chains
        for prefix, _, group in groups_of_drive(chain, tuple((group,) for group in RECORDED_METRICS))
        for c in group.columns
    }
    factors, adjusted = [factor.name for factor in study.factors], adjustment_columns(study.adjust)
    place = key_path_namer(study)
    for key in ("objectives", "bounds"):
        for i, name in enumerate(entry.metric for entry in getattr(study, key)):
            where = place((key, i, "metric"))
            of = statistic_from_name(name)
            metric, known = (name, factors) if of is None else (of.metric, [])
            if metric in recorded:
                if study.record.every != 1:
                    yield f'{where} = "{name}": is of recorded variants; it needs record.every = 1'
            elif metric not in (*names, *known, *adjusted):
                near = nearest_key_text(metric, [*known, *adjusted, *names, *recorded], 8)
                yield f'{where} = "{name}": no such metric; {near}'
    for i, measured in enumerate(study.measured):
        where = place(("measured", i, "signal" if measured.metric is None else "metric"))
        if measured.metric is not None and measured.metric not in names:
            yield f'{where} = "{measured.metric}": no such metric; {nearest_key_text(measured.metric, names, 8)}'
        elif measured.signal is not None and measured.signal not in (signals := signal_units(drive)):
            yield f'{where} = "{measured.signal}": no such signal; {nearest_key_text(measured.signal, signals, 8)}'
    for i, name in enumerate(study.calibrate.predict if study.calibrate is not None else ()):
        if name not in names:
            yield f'{place(("calibrate", "predict", i))} = "{name}": no such metric; {nearest_key_text(name, names, 8)}'


def is_growable(known: Study, other: Study) -> bool:
    """Whether a study's folder can grow to another study."""
    if not set(differing_tables(known, other)) <= {"design", "run"}:
        return False
    design, run = known.design, known.run
    alike = design.model_copy(update={"count": other.design.count, "replicates": other.design.replicates,
                                      "replicate_by": other.design.replicate_by})  # fmt: skip
    ways = design.copies == 1 or design.replicate_way == other.design.replicate_way
    free = ("duration", "window", "shard", "keep_states")
    same = {name: getattr(other.run, name) for name in free}
    counts = design.count == other.design.count or (
        design.kind in SAMPLED_DESIGNS and (design.count or 0) < (other.design.count or 0)
    )
    return (
        alike == other.design
        and ways
        and counts
        and design.copies <= other.design.copies
        and run.model_copy(update=same) == other.run
    )


def grow_folder(folder: StudyFolder, study: Study, source: Path, shard: int) -> StudyFolder:
    """Study folder grown by a plan: more points or replicates, another duration or window.

    Args:
        study: for which `is_growable` is true.
        shard: runs of a new shard.
    """
    path, number = folder.path, folder.plan_count
    files = [folder.path / plan_file_name("study.toml", earlier) for earlier in range(folder.plan_count)]
    before = tuple(dict.fromkeys(load_study(file).design.count or 0 for file in files))  # points, at each growth
    points = make_design(study, source, before if study.design.kind == "latin-hypercube" else ())
    design = design_with_today(study, folder.base_drive, points, source)
    names = [factor.name for factor in study.factors]
    if not design.select(names).slice(0, folder.rows).equals(folder.read_design().select(names)):
        raise StudyError(
            f"{source}: design.count = {value_text(study.design.count)}: the first {folder.rows} rows would be others; "
            "give another folder"
        )
    rows, copies = design.num_rows, study.design.copies
    same = {name: getattr(folder.study.run, name) for name in ("shard", "keep_states")}
    restart = study.run.model_copy(update=same) != folder.study.run
    blocks = [RunBlock((0, rows), (0, copies))] if restart else [
        RunBlock((0, folder.rows), (folder.copies, copies)), RunBlock((folder.rows, rows), (0, copies))]  # fmt: skip
    facts: dict[str, Any] = {
        "rows": rows,
        "shard": shard,
        "blocks": [[*block.rows, *block.copies] for block in blocks if len(block)],
        "after": folder.identity,
    }
    fixed = study.model_copy(update={"study": study.study.model_copy(update={"drive": "drive.toml"})})
    if restart:
        for table in (folder.results_path, folder.path / REPLICATES_FILE):
            other = table.with_name(f"{table.stem}.before-{number}.parquet")  # a name that nothing writes to
            if table.exists() and not other.exists():
                with refusals_as_errors(other, StudyError), whole_file(other) as file:
                    file.write(table.read_bytes())
    write_study_text(path / plan_file_name("study.toml", number), dumps_study(fixed))
    write_table(path / plan_file_name("design.parquet", number), design)
    write_plan(path, number, {**facts, "restart": True} if restart else facts)
    return open_folder(path)
