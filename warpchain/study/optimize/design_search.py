"""`warpchain optimize`: rounds of rows in a folder up to the count, then recommended designs (docs/optimization.md).

The next rows follow from those before, bit by bit, so that a search can be resumed.
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
from warpchain.results.arrow_tables import table_with_column
from warpchain.study.analysis.over_noise import Designs, designs_over_noise
from warpchain.study.analysis.pareto import Goals
from warpchain.study.design.design_table import design_table_of_rows
from warpchain.study.optimize.recommend import (
    RecommendedDesign,
    design_of_today,
    judge_rows,
    recommend_rows,
    rows_of_recommended,
)
from warpchain.study.optimize.study_session import StudySession, read_rounds, round_table_path
from warpchain.study.results import ARCHIVE_COLUMNS, Results, read_results
from warpchain.study.run.study_folder import DRIVE_TEXT_FILE
from warpchain.study.spec import Study, dumps_study, load_study
from warpchain.study.spec.study_tables import Recording, Search
from warpchain.study.store import read_table, write_study_text, write_table


@dataclass(frozen=True)
class SearchResult:
    """Result of a search for designs."""

    folder: Path
    goals: Goals
    results: Results
    designs: Results  # the rows, or with noise the designs over it (`analysis.over_noise`)
    rounds: int
    recommended: tuple[RecommendedDesign, ...]  # the best compromise first
    today: RecommendedDesign | None  # today's design, if the study asked for it
    drives: tuple[Path, ...]
    archives: tuple[tuple[Path, int] | None, ...]  # archive and number in it of each design's recording, or None


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
) -> SearchResult:
    """Search for a study's best designs, begun or resumed.

    Args:
        source: the study file, with `[[objectives]]`.
        out: the folder; made if there is none.
        progress: True shows a bar; see `StudySession.evaluate`.
        report: called with a line after each round.
        known: folders of studies whose rows are not run again.

    Raises:
        StudyError: an error of the study, another study's folder, a missing package, or no row that is ok.
        KeyboardInterrupt: what is done stays.
    """
    bench = StudySession(source, out, workers=workers, memory=memory)
    search = bench.study.optimize or Search()
    require_extra("optimize" if search.engine == "population" else "surrogate", "optimize", StudyError)
    optimizer = bench.optimizer
    for other in known:
        bench.learn_rows(other)
    folder = make_search_folder(Path(out), bench)
    rounds = 0
    while optimizer.observed_count < search.count:
        raise_if_stopped()
        done = round_table_path(folder, rounds)
        if rounds and search.engine == "bayes" and done.exists():
            table = read_table(done)  # what was asked for follows from the rows before: it need not be found again
            bench.remember_rows(table)
        else:
            rows = bench.ask()
            if not rows:
                break
            table = bench.run_round(rounds, rows, progress)
        bench.observe(table)
        rounds += 1
        gathered = read_rounds(folder, rounds)
        write_table(folder / "results.parquet", gathered)
        results = read_results(gathered, bench.shown_factors)
        if report is not None:
            report(f"round {rounds}: {_search_status_line(results, optimizer.goals)}")
    results = read_results(folder / "results.parquet", bench.shown_factors)
    designs, over = designs_over_noise(results, optimizer.goals)
    judged = judge_rows(designs, over)
    chosen = tuple(recommend_rows(designs, judged, search.recommend))
    drives, archives = _write_recommended(
        folder, bench, results, rows_of_recommended(bench.study, bench.drive, designs, chosen), chosen
    )
    today = design_of_today(designs, judged)
    return SearchResult(folder, optimizer.goals, results, designs, rounds, chosen, today, drives, archives)


def make_search_folder(path: Path, bench: StudySession) -> Path:
    """Makes or opens a search's folder; returns its path."""
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
    differing = [name for name in Study.model_fields if _fixed_field(held, name) != _fixed_field(fixed, name)]
    differing += ["its base drive"] if drive != bench.drive else []
    if differing:
        raise StudyError(f"{path}: holds another study, which differs in {', '.join(differing)}; give another folder")
    return path


def _fixed_field(study: Study, name: str) -> object:
    """Study's field as far as a search fixes it."""
    if name == "optimize":
        return (study.optimize or Search()).model_copy(update={"count": 1, "recommend": 1})
    if name in ("measured", "calibrate"):
        return None  # runs do not depend on them
    return study.run.model_copy(update={"shard": None, "keep_states": False}) if name == "run" else getattr(study, name)


def _search_status_line(results: Results, goals: Goals) -> str:
    """Line on a search's rows and best values."""
    from warpchain.results.units import quantity_words

    runs = len(results.status)
    results, goals = designs_over_noise(results, goals)
    measured = goals.goal_values(results)
    over = f" of {len(results.status)} designs" if isinstance(results, Designs) else ""
    words = f"{runs} variants{over}, {int(results.ok.sum())} ok"
    if goals.bounds:
        words += f", {int(measured.limits_kept.sum())} keep the limits"
    rows = measured.limits_kept if measured.limits_kept.any() else measured.ok
    for k, objective in enumerate(goals.objectives):
        if rows.any():
            best = float(measured.costs[rows, k].min() * goals.cost_signs[k])
            words += (
                f"; {objective.sense} {objective.metric} {quantity_words(best, results.column_unit(objective.metric))}"
            )
    return words


def _write_recommended(
    folder: Path,
    bench: StudySession,
    results: Results,
    rows: list[dict[str, Any]],
    chosen: tuple[RecommendedDesign, ...],
) -> tuple[tuple[Path, ...], tuple[tuple[Path, int] | None, ...]]:
    """Writes recommended designs; returns drive files, and recordings' places."""
    place = folder / "recommended" / f"{len(results.status):04d}"
    study = bench.study.model_copy(update={"record": Recording(every=1, rate=bench.study.record.rate)})
    design = table_with_column(design_table_of_rows(study, rows), "variant", [one.variant for one in chosen])
    table = bench.run_and_read(bench.make_run_folder(study, place, design))
    files = []
    for k, drive in enumerate(bench.drives(rows), 1):
        files.append(place / f"design-{k}.toml")
        write_study_text(files[-1], drive_text(bench.drive_text, drive))
    names, numbers = (table[name].to_pylist() for name in ARCHIVE_COLUMNS)
    archives = [None if name is None else (place / name, number) for name, number in zip(names, numbers, strict=True)]
    return tuple(files), tuple(archives)
