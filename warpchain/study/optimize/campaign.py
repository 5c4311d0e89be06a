"""`warpchain optimize`: rounds of rows in a folder up to the count, then designs to recommend.

    study.toml  drive.toml    the study and its base drive, as they were when the folder was made
    drive-text.toml           text of the drive's file, with its comments, which drive files of designs are made of
    rounds/NNNN/              a round: a study's folder of the rows whose drives were not run yet
    rounds/NNNN/rows.parquet  all rows of the round; it is done when this is there
    results.parquet           the rows of all rounds that are done
    recommended/NNNN/         the designs to recommend after so many rows: design-K.toml, and their recordings

Which rows come next follows from the study and the rows before. So a folder can be gone on with after any end of any
process, `optimize.count` can be raised, and the same study gives the same rows, bit by bit.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpchain.argument_checks import Count, Workers, check_arguments
from warpchain.drive import dumps_drive, load_drive
from warpchain.drive.drive_text import drive_text
from warpchain.engine.simulation import MEMORY
from warpchain.errors import StudyError
from warpchain.extras import require_extra
from warpchain.files import leftover_files, remove_leftovers
from warpchain.progress import Progress, interruptible_work, raise_if_stopped
from warpchain.results.arrow_tables import with_column
from warpchain.study.analysis.over_noise import Designs, designs_of
from warpchain.study.analysis.pareto import Goals
from warpchain.study.design.design_table import design_table_of_rows
from warpchain.study.optimize.bench import Bench, round_file, together
from warpchain.study.optimize.recommend import Recommended, recommend, rows_of
from warpchain.study.results import ARCHIVE_COLUMNS, Results, read_results
from warpchain.study.run.study_folder import DRIVE_TEXT_FILE
from warpchain.study.spec import Study, dumps_study, load_study
from warpchain.study.spec.study_tables import Recording, Search
from warpchain.study.store import read_table, write_study_text, write_table


@dataclass(frozen=True)
class Found:
    """Result of a search.

    Attributes:
        folder: its folder.
        goals: what was wanted.
        results: all rows.
        designs: what was compared: the rows, or with noise the designs over it (`analysis.over_noise`).
        rounds: how many there were.
        recommended: designs, the best compromise first.
        drives: their drive files.
        archives: archive and number in it of each one's recording; None where it has none.
    """

    folder: Path
    goals: Goals
    results: Results
    designs: Results
    rounds: int
    recommended: tuple[Recommended, ...]
    drives: tuple[Path, ...]
    archives: tuple[tuple[Path, int] | None, ...]


@check_arguments(StudyError)
@interruptible_work()
def optimize(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: Workers | None = None,
    memory: Count = MEMORY,
    progress: Progress = False,
    report: Callable[[str], object] | None = None,
    known: Sequence[str | os.PathLike[str]] = (),
) -> Found:
    """Searches for the designs that a study file wants, or goes on with a search.

    Args:
        source: the study file, with `[[objectives]]`.
        out: the folder; made if there is none.
        workers: CPU threads; None takes all cores.
        memory: budget of a shard [bytes].
        progress: True shows a bar for each round; see `Bench.evaluate`.
        report: called with a line after each round.
        known: folders of studies and searches whose rows are not run again where they are asked for.

    Raises:
        StudyError: an error of the study, a folder of another one, a package that is missing, or no row that is ok.
        KeyboardInterrupt: the user stopped it; what is done stays.
    """
    bench = Bench(source, out, workers=workers, memory=memory)
    search = bench.study.optimize or Search()
    require_extra("optimize" if search.engine == "population" else "surrogate", "optimize", StudyError)
    optimizer = bench.optimizer
    for other in known:
        bench.learn(other)
    folder = made_folder(Path(out), bench)
    rounds = 0
    while optimizer.observed < search.count:
        raise_if_stopped()
        done = round_file(folder, rounds)
        if rounds and search.engine == "bayes" and done.exists():
            table = read_table(done)  # what was asked for follows from the rows before: it need not be found again
            bench.remember(table)
        else:
            rows = optimizer.ask()
            if not rows:
                break
            table = bench.round(rounds, rows, progress)
        optimizer.observe(table)
        rounds += 1
        gathered = together(folder, rounds)
        write_table(folder / "results.parquet", gathered)
        results = read_results(gathered, bench.shown)
        if report is not None:
            report(f"round {rounds}: {_line(results, optimizer.goals)}")
    results = read_results(folder / "results.parquet", bench.shown)
    designs, over = designs_of(results, optimizer.goals)
    chosen = tuple(recommend(designs, over, search.recommend))
    drives, archives = _recorded(folder, bench, results, rows_of(bench.study, bench.drive, designs, chosen), chosen)
    return Found(folder, optimizer.goals, results, designs, rounds, chosen, drives, archives)


def made_folder(path: Path, bench: Bench) -> Path:
    """The folder, with the study in it, and without what killed processes have left of their writing.

    Raises:
        StudyError: it holds another study, or cannot be written.
    """
    try:
        (path / "rounds").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{path}: cannot be made ({error.strerror or error})") from None
    if (path / "plan.json").exists():
        raise StudyError(f"{path}: holds a study that was run; give another folder")
    remove_leftovers(leftover_files(path))
    fixed = bench.study.model_copy(update={"study": bench.study.study.model_copy(update={"drive": "drive.toml"})})
    write_study_text(path / "drive.toml", dumps_drive(bench.drive), keep=True)
    write_study_text(path / DRIVE_TEXT_FILE, bench.drive_text, keep=True)
    write_study_text(path / "study.toml", dumps_study(fixed), keep=True)
    held, drive = load_study(path / "study.toml"), load_drive(path / "drive.toml")
    differing = [name for name in Study.model_fields if _fixed(held, name) != _fixed(fixed, name)]
    differing += ["its base drive"] if drive != bench.drive else []
    if differing:
        raise StudyError(f"{path}: holds another study, which differs in {', '.join(differing)}; give another folder")
    return path


def _fixed(study: Study, name: str) -> object:
    """A field of a study that may not change: of the search all but its length, and of runs all but shards."""
    if name == "optimize":
        return (study.optimize or Search()).model_copy(update={"count": 1, "recommend": 1})
    if name in ("measured", "calibrate"):
        return None  # runs do not depend on them
    return study.run.model_copy(update={"shard": None, "keep_states": False}) if name == "run" else getattr(study, name)


def _line(results: Results, goals: Goals) -> str:
    """Status of a search in one line."""
    from warpchain.results.units import quantity

    runs = len(results.status)
    results, goals = designs_of(results, goals)
    measured = goals.goal_values(results)
    over = f" of {len(results.status)} designs" if isinstance(results, Designs) else ""
    words = f"{runs} variants{over}, {int(results.ok.sum())} ok"
    if goals.bounds:
        words += f", {int(measured.limits_kept.sum())} keep the limits"
    rows = measured.limits_kept if measured.limits_kept.any() else measured.ok
    for k, objective in enumerate(goals.objectives):
        if rows.any():
            best = float(measured.costs[rows, k].min() * goals.cost_signs[k])
            words += f"; {objective.sense} {objective.metric} {quantity(best, results.column_unit(objective.metric))}"
    return words


def _recorded(
    folder: Path, bench: Bench, results: Results, rows: list[dict[str, Any]], chosen: tuple[Recommended, ...]
) -> tuple[tuple[Path, ...], tuple[tuple[Path, int] | None, ...]]:
    """Writes the recommended designs as drive files, and records a run of each."""
    place = folder / "recommended" / f"{len(results.status):04d}"
    study = bench.study.model_copy(update={"record": Recording(every=1, rate=bench.study.record.rate)})
    design = with_column(design_table_of_rows(study, rows), "variant", [one.variant for one in chosen])
    table = bench.run_table(bench.run_folder_of(study, place, design))
    files = []
    for k, drive in enumerate(bench.drives(rows), 1):
        files.append(place / f"design-{k}.toml")
        write_study_text(files[-1], drive_text(bench.drive_text, drive))
    names, numbers = (table[name].to_pylist() for name in ARCHIVE_COLUMNS)
    archives = [None if name is None else (place / name, number) for name, number in zip(names, numbers, strict=True)]
    return tuple(files), tuple(archives)
