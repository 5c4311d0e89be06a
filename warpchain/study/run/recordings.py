"""Recorded variants of a study: trajectories, objectives, and a recording to play of any variant."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from warpchain.drive import Drive, dumps_drive, load_drive
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.progress import Progress
from warpchain.results.fatigue import Woehler
from warpchain.results.run import Trajectory
from warpchain.study.results import ARCHIVE_COLUMNS, Results, read_results
from warpchain.study.run.row_drives import Variant, build_drives
from warpchain.study.run.study_folder import open_folder
from warpchain.study.spec import Study, load_study
from warpchain.study.spec.study_tables import Worst
from warpchain.study.store import write_study_text
from warpchain.view.recorded_variants import DRIVE_CHANNELS

MOST_RECORDINGS = 4


def recording_places(results: Results) -> dict[int, tuple[str, int]]:
    """Archive and number of each recorded variant."""
    names = results.table.column_names
    if not set(ARCHIVE_COLUMNS) <= set(names):
        raise StudyError("the study recorded no variant: its table has no column 'archive'")
    archives, numbers = (results.table[name].to_pylist() for name in ARCHIVE_COLUMNS)
    rows = zip(results.variants.tolist(), archives, numbers, strict=True)
    return {variant: (archive, int(number)) for variant, archive, number in rows if archive is not None}


def recorded_trajectories(
    results: Results, folder: str | Path, variants: Sequence[int] | None = None, worst: Worst | None = None
) -> dict[int, Trajectory]:
    """Trajectories of recorded variants, by variant.

    Args:
        variants: None takes the first `MOST_RECORDINGS`, or the worst.

    Raises:
        StudyError: a variant that was not recorded, or another study's archive.
        ArchiveError: an archive that cannot be read.
    """
    from warpchain.archive import read_archive

    held = recording_places(results)
    chosen = worst_first_variants(results, list(held), worst)[:MOST_RECORDINGS] if variants is None else list(variants)
    for variant in chosen:
        if variant not in held:
            known = ", ".join(map(str, list(held)[:20])) or "none"
            raise StudyError(f"variant {variant} was not recorded (recorded: {known})")
    names = {held[variant][0] for variant in chosen}
    if (Path(folder) / "plan.json").exists():
        opened = open_folder(Path(folder))
        for name in names:
            opened.check_archive(name)
    archives = {name: read_archive(Path(folder) / name) for name in names}
    return {variant: archives[held[variant][0]][held[variant][1]] for variant in chosen}


def worst_first_variants(results: Results, variants: Sequence[int], worst: Worst | None) -> list[int]:
    """Recorded variants, the study's worst first."""
    if worst is None or worst.metric not in results.table.column_names:
        return list(variants)
    sign = -1.0 if worst.side == "largest" else 1.0
    values = sign * np.where(results.ok, results.values(worst.metric), np.nan)
    value = dict(zip(results.variants.tolist(), values.tolist(), strict=True))
    return sorted(variants, key=lambda variant: (np.isnan(value[variant]), value[variant]))


def results_with_objectives(results: Results, folder: str | Path, woehler: Woehler | None = None) -> Results:
    """Results with objectives of recorded variants as metrics.

    Args:
        woehler: curve of a link; None leaves fatigue out.

    Raises:
        StudyError: nothing was recorded.
        ArchiveError: an archive that cannot be read.
        SimulationError: fewer than three frames in the window.
    """
    import pyarrow as pa

    from warpchain.results.metric_columns import unit_of_metric
    from warpchain.results.objectives import trajectory_objectives

    starts, ends = results.values("window_start"), results.values("window_end")
    found: dict[int, dict[str, float]] = {}
    held = recording_places(results)
    for row, variant in enumerate(results.variants.tolist()):
        if variant in held and results.ok[row]:
            (trajectory,) = recorded_trajectories(results, folder, [variant]).values()
            found[row] = trajectory_objectives(trajectory, float(starts[row]), float(ends[row]), woehler)
    names = list(dict.fromkeys(name for values in found.values() for name in values))
    table = results.table.drop_columns([name for name in names if name in results.table.column_names])
    for name in names:
        column = pa.array([found.get(row, {}).get(name) for row in range(table.num_rows)], pa.float64())
        table = table.append_column(
            pa.field(name, pa.float64(), metadata={"role": "metric", "unit": unit_of_metric(name)}), column
        )
    return replace(results, table=table, metrics=tuple(dict.fromkeys((*results.metrics, *names))))


@dataclass(frozen=True)
class RepeatedRun:
    """Variant without a recording, to run again for one."""

    drive: Drive
    study: Study
    variant: int
    archive: Path

    def write_command(self) -> str:
        """Writes a variant's drive file; returns the run command."""
        file = self.archive.with_suffix(".toml")
        self.archive.parent.mkdir(exist_ok=True)
        write_study_text(file, dumps_drive(self.drive))
        run = self.study.run
        words = ["warpchain", "run", str(file), "-o", str(self.archive), "--overwrite", "--precision", run.precision]
        for option in ("device", "duration", "step"):
            if (value := getattr(run, option)) is not None:
                words += [f"--{option}", str(value)]
        words += [] if run.window is None else ["--window", *map(str, run.window)]
        words += [] if self.study.record.rate is None else ["--rate", str(self.study.record.rate)]
        limits = self.study.limits.model_dump(exclude_defaults=True)
        words += [word for key, value in limits.items() for word in ("--limit", f"{key}={value}")]
        return shlex.join(words)

    def run_again(self, *, workers: int | None = None, memory: int = MEMORY, progress: Progress = False) -> None:
        """Runs the variant again, recorded into its own archive."""
        from warpchain.archive.options import ArchiveOptions
        from warpchain.engine.simulation import simulate
        from warpchain.results.run import Record

        self.archive.parent.mkdir(exist_ok=True)
        run = self.study.run
        simulate(
            self.drive,
            device=run.device,
            precision=run.precision,
            duration=run.duration,
            step=run.step,
            record=Record("all", self.study.record.rate),
            window=run.window,
            progress=progress,
            archive=self.archive,
            archive_options=ArchiveOptions(numbers=(self.variant,)),
            workers=workers,
            memory=memory,
            limits=self.study.limits,
        )


def recording_of_variant(folder: str | Path, variant: int) -> tuple[Path, int] | RepeatedRun:
    """Archive and number of a variant's recording, or a `RepeatedRun`.

    Raises:
        StudyError: no such folder or variant, or one that gives no drive.
        ArchiveError: a recording that cannot be read.
    """
    from warpchain.archive import read_archive

    path = Path(folder)
    study, drive = load_study(path / "study.toml"), load_drive(path / "drive.toml")
    results = read_results(path / "results.parquet", [factor.name for factor in study.factors], ())
    rows = [i for i, number in enumerate(results.variants.tolist()) if number == variant]
    if not rows:
        raise StudyError(
            f"variant {variant}: not in {path / 'results.parquet'}, which has {len(results.status)} variants"
        )
    whole = set(DRIVE_CHANNELS) <= set(study.record.channels)
    held = recording_places(results) if whole and "archive" in results.table.column_names else {}
    if variant in held:
        name, number = held[variant]
        return path / name, number
    archive = path / "played" / f"variant-{variant:06d}.mcap"
    if archive.exists():
        return archive, read_archive(archive).numbers[0]  # 0 where an earlier version or the command played it
    row = {factor.name: results.table[factor.name][rows[0]].as_py() for factor in study.factors}
    made = Variant(row)
    build_drives(study, drive, [made])
    if made.drive is None:
        raise StudyError(f"variant {variant}: {made.reason}")
    return RepeatedRun(made.drive, study, variant, archive)
