"""One shard of a study: its rows become drives, the drives are simulated together, inputs and metrics become a table.

What a variant computes does not depend on the others (`warpchain.simulate`), so neither the cut into shards nor a
restart changes a bit of the results. A row that gives no drive, or a drive that cannot be assembled or stepped, is a
row with a reason.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.assembly import assemble
from warpchain.drive import Drive
from warpchain.errors import DriveError, SimulationError, StudyError, WarpchainError
from warpchain.study.adjust import adjusted
from warpchain.study.folder import WORST, Folder, open_folder
from warpchain.study.spec import Study
from warpchain.study.tables import write_table
from warpchain.timestep import resolve_step

if TYPE_CHECKING:
    import pyarrow as pa

BOOKKEEPING = ("diverged_time", "window_start", "window_end")
"""Columns of `simulate` that come along with the metrics and are none."""

Report = Callable[[float], None]
"""Called with the part of the shard's work that is done, 0 to 1."""


@dataclass
class Variant:
    """A row on its way: what it is made of, and what becomes of it."""

    row: dict[str, Any]
    drive: Drive | None = None
    reason: str | None = None
    adjusted: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, Any] | None = None
    archive: tuple[str, int] | None = None

    def fail(self, error: WarpchainError) -> None:
        """Makes it infeasible."""
        lines = re.sub(r"^variant \d+: ", "", str(error)).splitlines()
        self.drive, self.reason = None, "; ".join(lines)

    @property
    def status(self) -> str:
        """ "ok", "diverged" or "infeasible"."""
        if self.metrics is None:
            return "infeasible"
        return "diverged" if self.metrics["diverged"] else "ok"

    def told(self) -> str | None:
        """Why it is not ok."""
        if self.status == "diverged":
            assert self.metrics is not None  # its status
            time = self.metrics["diverged_time"]
            return f"diverged at {time:.4g} s: take a smaller step (run.step) or a higher impact_speed_floor"
        return self.reason


def run_shard(
    folder: str | Path, shard: int, options: Mapping[str, Any] | None = None, report: Report | None = None
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
        first = shard * opened.shard
        rows = opened.design().slice(first, opened.size(shard))
        recorded = opened.recorded()
        chosen = {i for i in range(rows.num_rows) if first + i in recorded}
        _write(opened, shard, rows, chosen, options or {}, report or (lambda part: None))
    return opened.size(shard)


def run_worst(
    folder: Path, variants: Sequence[int], options: Mapping[str, Any] | None = None, report: Report | None = None
) -> None:
    """Simulates variants a second time to record them; see `run_shard`."""
    import pyarrow as pa

    opened = open_folder(folder)
    rows = opened.design().take(pa.array(variants, pa.int64()))
    _write(opened, WORST, rows, set(range(len(variants))), options or {}, report or (lambda part: None))


def _write(
    folder: Folder, shard: int | str, rows: pa.Table, recorded: set[int], options: Mapping[str, Any], report: Report
) -> None:
    """Simulates rows; the archive lands first, then the table, which says that the shard is done."""
    study = folder.study
    variants = [Variant(row, reason=row["reason"]) for row in rows.to_pylist()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # thousands of offset links need no line each
        for variant in variants:
            _build(study, folder.drive, variant)
        kept = [variant for i, variant in enumerate(variants) if i in recorded]
        plain = [variant for i, variant in enumerate(variants) if i not in recorded]
        share = len(plain) / max(1, len(variants))
        _simulate(study, plain, None, options, lambda part: report(share * part))
        _simulate(study, kept, folder.archive_path(shard), options, lambda part: report(share + (1.0 - share) * part))
    write_table(folder.table_path(shard), results_table(study, rows, variants))


def _build(study: Study, base: Drive, variant: Variant) -> None:
    """Makes a row's drive."""
    if variant.reason is not None:
        return
    values = {path: variant.row[factor.name] for factor in study.factors for _, path in factor.targets()}
    try:
        drive = base.with_values(values)
        if study.adjust is not None:
            drive, variant.adjusted = adjusted(drive, study.adjust, variant.row)
        variant.drive = drive
    except (DriveError, StudyError) as error:
        variant.fail(error)


def _simulate(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: Report
) -> None:
    """Simulates the variants that have a drive; those that are refused fail alone.

    A drive that cannot be assembled or stepped ends the whole call, so then each is looked at. What else is refused is
    halved until it is known which variants are to blame; a refusal that meets every variant is the study's own.
    """
    feasible = [variant for variant in variants if variant.drive is not None]
    refused = _attempt(study, feasible, archive, options, report)
    if isinstance(refused, DriveError):
        for variant in feasible:
            _try_alone(study, variant)
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


def _try_alone(study: Study, variant: Variant) -> None:
    """Finds out whether a drive can be assembled and stepped."""
    assert variant.drive is not None  # as chosen
    try:
        resolve_step(variant.drive, study.run.step)
        assemble(variant.drive)
    except DriveError as error:
        variant.fail(error)


def _attempt(
    study: Study, variants: Sequence[Variant], archive: Path | None, options: Mapping[str, Any], report: Report
) -> WarpchainError | None:
    """Simulates variants in one call; returns a refusal of a drive, of the settings or of the machine's memory."""
    from warpchain.record import Record
    from warpchain.simulation import simulate

    def tell(phase: str, done: float, total: float) -> None:
        if phase == "simulating":
            report(done / total)

    wanted = study.record
    if not variants:
        return None
    try:
        run = simulate(
            [variant.drive for variant in variants if variant.drive is not None],
            device=study.run.device,
            precision=study.run.precision,
            duration=study.run.duration,
            step=study.run.step,
            record=Record("none" if archive is None else "all", wanted.rate, wanted.channels),
            window=study.run.window,
            progress=tell,
            archive=archive,
            overwrite=True,
            **options,
        )
    except (DriveError, SimulationError) as error:
        return error
    if run.info.ended != "complete":
        if archive is not None:
            archive.unlink(missing_ok=True)
        raise KeyboardInterrupt
    for i, (variant, row) in enumerate(zip(variants, run.metrics.to_pylist(), strict=True)):
        variant.metrics = {name: value for name, value in row.items() if value is not None}
        if archive is not None:
            variant.archive = (f"shards/{archive.name}", i)
    return None


def results_table(study: Study, rows: pa.Table, variants: Sequence[Variant]) -> pa.Table:
    """Inputs and metrics of variants: a row a variant, fields marked role = "factor" and "metric", with their units."""
    import pyarrow as pa

    from warpchain.metrics import table_of

    extra: dict[str, tuple[Any, list[Any], str]] = {
        "status": (pa.string(), [variant.status for variant in variants], ""),
        "reason": (pa.string(), [variant.told() for variant in variants], ""),
    }
    if study.adjust is not None and study.adjust.links is not None:
        links = [variant.adjusted.get("adjusted_links") for variant in variants]
        extra["adjusted_links"] = (pa.int64(), links, "")
    if study.adjust is not None and study.adjust.sprocket is not None:
        travel = [variant.adjusted.get("adjusted_travel") for variant in variants]
        extra["adjusted_travel"] = (pa.float64(), travel, "m")
    record = study.record
    if record.variants or record.every or record.worst:
        archives = [variant.archive or (None, None) for variant in variants]
        extra["archive"] = (pa.string(), [name for name, _ in archives], "")
        extra["archive_variant"] = (pa.int64(), [number for _, number in archives], "")
    columns = [rows[name].combine_chunks() for name in rows.column_names if name not in ("status", "reason")]
    fields = [field for field in rows.schema if field.name not in ("status", "reason")]
    for name, (kind, values, unit) in extra.items():
        columns.append(pa.array(values, kind))
        fields.append(pa.field(name, kind, metadata={"unit": unit} if unit else None))
    metrics = table_of(_kept(study, variants))
    for field_, column in zip(metrics.schema, metrics.columns, strict=True):
        if field_.name != "variant":
            role = {} if field_.name in BOOKKEEPING else {"role": "metric"}
            columns.append(column.combine_chunks())
            fields.append(field_.with_metadata({**role, "unit": field_.metadata[b"unit"]}))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _kept(study: Study, variants: Sequence[Variant]) -> list[dict[str, Any]]:
    """The metrics that the study keeps, of each variant."""
    patterns = kept_patterns(study)
    names = dict.fromkeys(name for variant in variants for name in variant.metrics or ())
    dropped = {"variant", "diverged"}
    kept = {name for name in names if name not in dropped and any(fnmatchcase(name, p) for p in patterns)}
    return [{n: value for n, value in (variant.metrics or {}).items() if n in kept} for variant in variants]


def kept_patterns(study: Study) -> tuple[str, ...]:
    """The patterns of the metrics that are kept: those asked for, and the one that tells the worst."""
    worst = study.record.worst
    return study.metrics.keep if worst is None else (*study.metrics.keep, worst.metric)
