"""One shard of a study: its rows become drives, the drives are simulated together, inputs and metrics become a table.

What a variant computes does not depend on the others (`warpchain.simulate`), so neither the cut into shards nor a
restart changes a bit of the results. A row that gives no drive, or a drive that cannot be assembled or stepped, is a
row with a reason.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.garbage import rare_collections
from warpchain.results.metrics import gathered, table_of
from warpchain.results.replicates import COPY
from warpchain.study.columns import ADJUSTED, ARCHIVED, OUTCOME, RUN_COLUMNS
from warpchain.study.run.batch import Report, Variant, simulate_variants
from warpchain.study.run.folder import Folder, open_folder
from warpchain.study.run.stood import begin_with, write_states
from warpchain.study.run.tasks import Numbers
from warpchain.study.spec import Study

if TYPE_CHECKING:
    import pyarrow as pa


@rare_collections()
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
        numbers, copies = opened.tasks(shard)
        recorded = opened.recorded()
        tasks = zip(numbers.tolist(), copies.tolist(), strict=True)
        chosen = {i for i, (row, copy) in enumerate(tasks) if copy == 0 and row in recorded}
        _write(opened, shard, _rows(opened, numbers, copies), chosen, options or {}, report or (lambda part: None))
    return opened.size(shard)


def run_worst(
    folder: Path,
    variants: Sequence[tuple[int, int]],
    options: Mapping[str, Any] | None = None,
    report: Report | None = None,
) -> None:
    """Simulates variants (number, copy) a second time to record them; see `run_shard`."""
    opened = open_folder(folder)
    place = {variant: row for row, variant in enumerate(opened.design()["variant"].to_pylist())}
    numbers = np.array([place[variant] for variant, _ in variants], dtype=np.int64)
    copies = np.array([copy for _, copy in variants], dtype=np.int64)
    rows = _rows(opened, numbers, copies)
    _write(opened, opened.worst, rows, set(range(len(variants))), options or {}, report or (lambda part: None))


def _rows(folder: Folder, numbers: Numbers, copies: Numbers) -> pa.Table:
    """Rows of the design, with the number of the copy where rows are run several times."""
    import pyarrow as pa

    rows = folder.design().take(pa.array(numbers, pa.int64()))
    return rows.add_column(1, COPY, pa.array(copies, pa.int64())) if folder.copies > 1 else rows


def _write(
    folder: Folder, shard: int | str, rows: pa.Table, recorded: set[int], options: Mapping[str, Any], report: Report
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
        simulate_variants(study, folder.drive, variants, folder.archive_path(shard), options, report)
    table = results_table(study, rows, variants)
    if isinstance(shard, int) and (study.run.keep_states or any(variant.gone_on for variant in variants)):
        write_states(folder, shard, variants)
    folder.write(folder.table_path(shard), table, shard if isinstance(shard, int) else None)


def results_table(study: Study, rows: pa.Table, variants: Sequence[Variant]) -> pa.Table:
    """Inputs and metrics of variants: a row a variant, fields marked role = "factor" and "metric", with their units."""
    import pyarrow as pa

    status, reason = OUTCOME
    extra: dict[str, tuple[Any, list[Any], str]] = {
        status: (pa.string(), [variant.status for variant in variants], ""),
        reason: (pa.string(), [variant.outcome() for variant in variants], ""),
    }
    count, travel = ADJUSTED
    if study.adjust is not None and study.adjust.links is not None:
        extra[count] = (pa.int64(), [variant.adjusted.get(count) for variant in variants], "")
    if study.adjust is not None and study.adjust.sprocket is not None:
        extra[travel] = (pa.float64(), [variant.adjusted.get(travel) for variant in variants], "m")
    record = study.record
    if record.variants or record.every or record.worst:
        archives = [variant.archive or (None, None) for variant in variants]
        file, place = ARCHIVED
        extra[file] = (pa.string(), [name and f"shards/{name}" for name, _ in archives], "")
        extra[place] = (pa.int64(), [number for _, number in archives], "")
    columns = [rows[name].combine_chunks() for name in rows.column_names if name not in OUTCOME]
    fields = [field for field in rows.schema if field.name not in OUTCOME]
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
    patterns, dropped = kept_patterns(study), {"variant", "diverged", *OUTCOME}

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
    """The patterns of the metrics that are kept: those asked for, the one that tells the worst, and those wanted."""
    worst = study.record.worst
    wanted = [name for metric in study.wanted for name in (metric, f"{metric}_se")]
    return (*study.metrics.keep, *wanted, *(() if worst is None else (worst.metric,)))
