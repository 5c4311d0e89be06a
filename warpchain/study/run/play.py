"""One variant of a study to look at: its recording, or a run of its own that is recorded now."""

from __future__ import annotations

from pathlib import Path

from warpchain.drive import load_drive
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.study.results import read_results
from warpchain.study.run.batch import Variant, build
from warpchain.study.run.recordings import places
from warpchain.study.spec import load_study
from warpchain.view.chosen import NEEDED


def recording_of(
    folder: str | Path, variant: int, *, workers: int | None = None, memory: int = MEMORY, progress: bool = False
) -> tuple[Path, int]:
    """The archive of a variant, and its number in it.

    A variant that was not recorded, or without what playback needs, is run again with the study's settings, into
    `played/` in the folder; what was run so before is not run again.

    Args:
        folder: of a study, or of a search.
        variant: its number in the table.
        workers, memory, progress: as in `warpchain.simulate`.

    Raises:
        StudyError: no such folder or variant, or one that gives no drive.
        SimulationError, DriveError, ArchiveError: as in `simulate`.
    """
    from warpchain.archive import read_archive
    from warpchain.archive.options import ArchiveOptions
    from warpchain.engine.simulation import simulate
    from warpchain.results.run import Record

    path = Path(folder)
    study, drive = load_study(path / "study.toml"), load_drive(path / "drive.toml")
    results = read_results(path / "results.parquet", [factor.name for factor in study.factors], ())
    rows = [i for i, number in enumerate(results.variants.tolist()) if number == variant]
    if not rows:
        raise StudyError(
            f"variant {variant}: not in {path / 'results.parquet'}, which has {len(results.status)} variants"
        )
    whole = set(NEEDED) <= set(study.record.channels)
    held = places(results) if whole and "archive" in results.table.column_names else {}
    if variant in held:
        name, number = held[variant]
        return path / name, number
    archive = path / "played" / f"variant-{variant:06d}.mcap"
    if archive.exists():
        return archive, read_archive(archive).numbers[0]  # 0 where an earlier version played it
    row = {factor.name: results.table[factor.name][rows[0]].as_py() for factor in study.factors}
    made = Variant(row)
    build(study, drive, [made])
    if made.drive is None:
        raise StudyError(f"variant {variant}: {made.reason}")
    archive.parent.mkdir(exist_ok=True)
    run, record = study.run, study.record
    simulate(
        made.drive,
        device=run.device,
        precision=run.precision,
        duration=run.duration,
        step=run.step,
        record=Record("all", record.rate),
        window=run.window,
        progress=progress,
        archive=archive,
        archive_options=ArchiveOptions(numbers=(variant,)),
        workers=workers,
        memory=memory,
        limits=study.limits,
    )
    return archive, variant
