"""Sections of a study's report for decisions: recommended designs, Pareto front, statuses, rows to explore."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.assembly.summary import check_findings
from warpchain.drive import load_drive, read_drive_text
from warpchain.drive.drive_text import drive_text
from warpchain.errors import StudyError
from warpchain.results.units import quantity_words
from warpchain.study.analysis.left_out import LeftOut
from warpchain.study.analysis.over_noise import SHOWN_STATISTICS, Designs
from warpchain.study.analysis.pareto import SENSE_SIGNS, Goals, check_senses, pareto_front
from warpchain.study.optimize.recommend import (
    MetricChange,
    RecommendedDesign,
    design_of_today,
    judge_rows,
    recommend_rows,
    rows_of_recommended,
)
from warpchain.study.report import panels
from warpchain.study.report.panels import ShownColumn
from warpchain.study.results import ARCHIVE_COLUMNS, Results
from warpchain.study.run.row_drives import Variant, build_drives
from warpchain.study.run.study_folder import DRIVE_TEXT_FILE
from warpchain.study.spec import load_study
from warpchain.study.spec.noise_table import metric_from_name
from warpchain.study.spec.study_tables import Bound, Objective
from warpchain.study.store import write_study_text
from warpchain.view import html

DESIGN_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
STATISTIC_HEADS = ("mean", "deviation", "5 %", "median", "95 %")
MOST_FRONT_ROWS, MOST_LISTED_ROWS = 30, 60
MOST_AXES, MATRIX_COLUMNS = 12, 5
SURROGATE_NOTE = (
    "\N{PLUS-MINUS SIGN} is one standard deviation of the metric itself as a surrogate of all variants has it, or of "
    "the mean of several runs where that is known better: the best of many runs is the best partly by luck, and this "
    "takes that out."
)
TODAY = "today"
NO_TODAY_NOTE = (
    "The base drive as it is, today's design, was not run with these. With today = true in the study's [design] it is, "
    "and stands beside them."
)
CHANGE_HEADS = {
    True: "less today's, 95 % interval",
    False: "less today's, two standard deviations",
}
OVER_NOISE_NOTE = (
    "Designs are judged by their own runs, and compared in pairs of runs with the same noise. \N{PLUS-MINUS SIGN} is "
    "the standard error of a statistic over a design's runs."
)


@dataclass(frozen=True)
class ReportGoals:
    """Goals of a report, and the study's folder."""

    objectives: tuple[Objective, ...] = ()
    bounds: tuple[Bound, ...] = ()
    folder: str | None = None  # for commands that play variants
    most: int = 4
    recorded: bool = True  # whether the study's archives hold what playback needs
    keep: float = Goals.keep  # share of the noise in which limits must be kept
    page: str | None = None  # name of the page without ending, if drive files go beside it

    @property
    def goals(self) -> Goals:
        """Objectives and limits of the report as goals."""
        return Goals(self.objectives, self.bounds, self.keep)


def report_goals(results: Results, objectives: Mapping[str, str] | None, wanted: ReportGoals | None) -> ReportGoals:
    """Goals of a report that its table holds."""
    found = wanted or ReportGoals()
    if objectives is not None:
        check_senses(objectives)
        given = tuple(
            Objective.model_validate({"metric": metric, "sense": sense}) for metric, sense in objectives.items()
        )
        found = replace(found, objectives=given)
    held = results.table.column_names
    if objectives is None:  # of a study of which nothing ran, metrics have no columns
        objectives_held = tuple(o for o in found.objectives if metric_from_name(o.metric) in held)
        bounds_held = tuple(b for b in found.bounds if metric_from_name(b.metric) in held)
        found = replace(found, objectives=objectives_held, bounds=bounds_held)
    for metric in found.goals.named_metrics:
        results.values(metric_from_name(metric) if results.noise_factors else metric)
    return found


def variants_table_html(
    results: Results, rows: Sequence[int], columns: Sequence[str], first: Sequence[str] = ()
) -> str:
    """HTML table of rows' variants, columns in suitable units."""
    axes = {name: ShownColumn(results, name, rows) for name in columns if results.is_numeric(name)}
    heads = [*([""] if first else []), "variant", *(axes[name].name if name in axes else name for name in columns)]
    lines = []
    for k, row in enumerate(rows):
        cells: list[object] = [*([first[k]] if first else []), int(results.variants[row])]
        for name in columns:
            value = results.table[name][int(row)].as_py()
            whole = isinstance(value, int) and axes[name].factor == 1.0 if name in axes else True
            cells.append(value if value is None or whole else axes[name].value_text(float(value)))
        lines.append(cells)
    return html.table_html(heads, lines).replace(
        "<table>", '<table class="rows">', 1
    )  # each gets its command in the page


def recommended_section(
    results: Results, wanted: ReportGoals
) -> tuple[html.PageSection | None, list[RecommendedDesign]]:
    """HTML section on recommended designs, and these designs."""
    if not wanted.objectives:
        return None, []
    goals = wanted.goals
    try:
        judged = judge_rows(results, goals)
        found = recommend_rows(results, judged, wanted.most)
    except StudyError as error:
        return html.page_section("designs", "Recommended designs", html.paragraph_html(str(error))), []
    asked = [f"{o.metric} {'low' if o.sense == 'min' else 'high'}" for o in wanted.objectives]
    kept = [_limit_text(results, bound) for bound in wanted.bounds]
    over = isinstance(results, Designs)
    parts = [
        html.paragraph_html(f"Wanted: {'; '.join(asked)}." + (f" Limits: {'; '.join(kept)}." if kept else "")),
        html.paragraph_html(OVER_NOISE_NOTE if over else SURROGATE_NOTE, muted=True),
    ]
    if isinstance(results, Designs):
        parts.append(html.paragraph_html(noise_text(results, wanted.keep)))
    today = design_of_today(results, judged)
    shown = list(zip((DESIGN_LETTERS[k % len(DESIGN_LETTERS)] for k in range(len(found))), found, strict=True))
    if today is not None and today.row not in [one.row for one in found]:
        shown.append((TODAY, today))
    checked = _findings_of_designs(results, found, wanted)
    parts += [_design_html(results, goals, one, letter, wanted, checked.get(letter, ())) for letter, one in shown]
    if today is None and wanted.folder is not None:
        parts.append(html.paragraph_html(NO_TODAY_NOTE, muted=True))
    letters, rows = [letter for letter, _ in shown], [one.row for _, one in shown]
    if isinstance(results, Designs):
        parts.append(panels.panels_html(panels.noise_panels(results, rows, letters), "runs over the noise"))
    columns = tuple(dict.fromkeys((*goals.named_metrics, *results.factors, *results.adjustment_columns)))
    parts.append(variants_table_html(results, rows, columns, letters))
    return html.page_section("designs", "Recommended designs", *parts), found


def _limit_text(results: Results, bound: Bound) -> str:
    """Text of a limit: "tension_max at most 900 N"."""
    unit = results.column_unit(bound.metric)
    ends = (("at least", bound.min), ("at most", bound.max))
    return (
        f"{bound.metric} {' and '.join(f'{word} {quantity_words(end, unit)}' for word, end in ends if end is not None)}"
    )


def noise_text(designs: Designs, keep: float) -> str:
    """Sentences on the noise that designs are compared over."""
    names, count = ", ".join(designs.runs.noise_factors), max(len(rows) for rows in designs.rows)
    held = [_limit_text(designs.runs, bound) for bound in designs.bounds]
    limits = f" Each run is held to: {'; '.join(held)}; in {100.0 * keep:g} % of the noise at least." if held else ""
    return (
        f"Noise, which nobody can choose and no design names: {names}. Each design was run {count} times, all with the "
        f"same noise; a design's variant is its worst run.{limits}"
    )


def play_command(wanted: ReportGoals, results: Results, row: int) -> str:
    """Shell command that plays a row's variant."""
    names = results.table.column_names
    folder = wanted.folder
    if wanted.recorded and "archive" in names and (archive := results.table["archive"][row].as_py()) is not None:
        return f"warpchain view {folder}/{archive} --variant {results.table['archive_variant'][row].as_py()}"
    return f"warpchain study play {folder} {results.variants[row]}"


def _findings_of_designs(
    results: Results, found: Sequence[RecommendedDesign], wanted: ReportGoals
) -> dict[str, list[str]]:
    """Findings of `check` by recommended design's letter."""
    if wanted.folder is None or not has_study_files(wanted.folder):
        return {}
    made = _built_designs(wanted.folder, results, found)
    return {
        letter: check_findings(variant.drive)
        for letter, variant in zip(DESIGN_LETTERS, made, strict=False)
        if variant.drive is not None
    }


def _design_html(
    results: Results,
    goals: Goals,
    one: RecommendedDesign,
    letter: str,
    wanted: ReportGoals,
    findings: Sequence[str],
) -> str:
    """HTML of a recommended design, or today's, with findings of `check`."""
    lines = []
    for name in goals.named_metrics:
        mean, deviation = one.believed[name]
        unit, is_set = results.column_unit(name), name in results.factors
        words = [quantity_words(mean, unit) if is_set else quantity_words(mean, unit, deviation)]
        if not one.spreads:
            words.append("" if is_set else quantity_words(one.measured[name], unit))
        if one.changes:
            words += change_texts(one.changes.get(name), unit)
        lines.append((name, *words, "set" if is_set else ""))
    heads = ("simulated",) if one.spreads else ("model estimate", "simulated")
    beside = (CHANGE_HEADS[bool(one.spreads)], "") if one.changes else ()
    lines_table = html.table_html(("metric", *heads, *beside, ""), lines)
    if one.spreads:
        lines_table += html.table_html(
            ("over the noise", *(of.metric for of in one.spreads)), _statistic_lines(results, one)
        )
    command = "" if wanted.folder is None else escape(play_command(wanted, results, one.row))
    play = command and f"<p>Play {'its worst run' if one.spreads else 'it'}: <code>{command}</code></p>"
    if wanted.page is not None and letter != TODAY:
        play += f"<p>Drive file, beside this page: <code>{escape(f'{wanted.page}-{letter}.toml')}</code></p>"
    chosen = [factor_value_text(results, name, one.row) for name in results.factors] if one.spreads else []
    head = html.heading_html(f"{letter}: {', '.join(chosen) or f'variant {one.variant}'}")
    return f'<div class="design">{head}{html.bullets_html([*one.reasons, *findings])}{lines_table}{play}</div>'


def change_texts(change: MetricChange | None, unit: str) -> tuple[str, str]:
    """Texts of a change from today's design, and verdict."""
    if change is None:
        return "", ""
    sign = "+" if change.difference > 0.0 else ""
    half = None if change.sign and change.half > abs(change.difference) else change.half  # all pairs agree there
    pairs = "" if change.pairs is None else ", in {} of {} pairs".format(*change.pairs)
    return f"{sign}{quantity_words(change.difference, unit, half)}{pairs}", change.verdict


def factor_value_text(results: Results, name: str, row: int) -> str:
    """Text of a factor's value in a row."""
    value = results.table[name][row].as_py()
    words = quantity_words(value, results.column_unit(name)) if isinstance(value, float) else str(value)
    return f"{name} {words}"


def _statistic_lines(results: Results, one: RecommendedDesign) -> list[tuple[str, ...]]:
    """Table lines of a recommended design's statistics over noise."""
    lines = []
    for word, head in zip(SHOWN_STATISTICS, STATISTIC_HEADS, strict=True):
        held = [(of.statistics[word], results.column_unit(f"mean({of.metric})")) for of in one.spreads]
        lines.append((head, *(quantity_words(value, unit, error) for (value, error), unit in held)))
    return [*lines, ("spread comes from", *(of.parts_text() for of in one.spreads))]


def pareto_section(results: Results, objectives: Mapping[str, str], by_default: bool) -> html.PageSection | None:
    """HTML section on the Pareto front."""
    if len(objectives) < 2:
        return None
    front, today = pareto_front(results, objectives), results.row_of_today
    rows = front[:MOST_FRONT_ROWS].tolist()
    rows += [] if today is None or today in rows else [today]
    words = " and ".join(f"{metric} {'low' if sense == 'min' else 'high'}" for metric, sense in objectives.items())
    hint = " (taken for want of chosen objectives)" if by_default else ""
    columns = tuple(dict.fromkeys((*objectives, *results.factors)))
    return html.page_section(
        "front",
        "Pareto front",
        html.paragraph_html(
            f"Wanted: {words}{hint}. No other variant beats those on the front in one without losing in another; "
            "the table has those of all variants, the picture those of the ones that are kept below."
        ),
        panels.placeholder_html("front-view", f"Pareto front of {words}"),
        html.folded_html(
            "The variants on the front",
            variants_table_html(
                results, rows, columns, () if today is None else [TODAY if row == today else "" for row in rows]
            ),
            html.paragraph_html(f"{len(front) - MOST_FRONT_ROWS} further variants are on the front.")
            if len(front) > MOST_FRONT_ROWS
            else "",
        ),
    )


def statuses_section(results: Results, left_out: LeftOut) -> html.PageSection:
    """HTML section on how variants ended, and why."""
    reasons = results.reason_counts()
    if not reasons:
        return html.page_section("ends", "How the variants ended", html.paragraph_html("Every variant is ok."))
    status = results.status
    rank = {"suspect": 0, "diverged": 1}
    rows = sorted(np.flatnonzero(~results.ok).tolist(), key=lambda row: (rank.get(status[row], 2), row))
    listed = [(int(results.variants[row]), status[row], results.reason(row)) for row in rows[:MOST_LISTED_ROWS]]
    return html.page_section(
        "ends",
        "How the variants ended",
        html.paragraph_html(
            "Infeasible variants could not be run as drawn; diverged ones were stopped when their motion ran away; "
            "suspect ones are beyond a limit of the study. None of them takes part in what follows."
        ),
        html.table_html(
            ("status", "reason (of the first one, where only its numbers differ)", "variants"), reasons[:25]
        ),
        html.paragraph_html(f"{len(reasons) - 25} further reasons are in the table.") if len(reasons) > 25 else "",
        *_lost_range_tables(left_out),
        html.heading_html("Each of them"),
        html.table_html(("variant", "status", "reason"), listed),
        html.paragraph_html(f"The first {MOST_LISTED_ROWS} of {len(rows)}; all are in the table.")
        if len(rows) > MOST_LISTED_ROWS
        else "",
    )


def _lost_range_tables(left_out: LeftOut) -> list[str]:
    """HTML tables of ranges that lost rows."""
    found = []
    heads = ("factor", "most were lost", "there", "elsewhere", "")
    for parts, words in ((left_out.lost_parts, "left out by their results"), (left_out.unbuilt_parts, "not built")):
        lines = [
            (
                one.factor,
                one.part,
                f"{one.lost} of {one.rows}",
                f"{one.lost_elsewhere} of {one.rows_elsewhere}",
                "" if one.is_sure else "as chance may",
            )
            for one in parts
        ]
        if lines:
            found += [
                html.heading_html(f"Lost of each factor's range: variants {words}"),
                html.table_html(heads, lines),
            ]
    return found


def explorer_data(
    results: Results,
    metrics: Sequence[str],
    telling: Sequence[str],
    objectives: Mapping[str, str],
    wanted: ReportGoals,
    recommended: Sequence[RecommendedDesign],
) -> dict[str, Any]:
    """Data of rows for a report's interactive views, `telling` factors first."""
    bounds = wanted.bounds
    names = tuple(dict.fromkeys((*results.factors, *objectives, *(b.metric for b in bounds), *metrics)))
    axes = {name: ShownColumn(results, name) for name in names}
    place = {name: k for k, name in enumerate(names)}
    named = [m for m in objectives if m in place]
    crossed = tuple(dict.fromkeys((*named[:2], *telling, *metrics)))[:MATRIX_COLUMNS]
    limits = []
    for bound in bounds:
        factor = axes[bound.metric].factor
        ends = [None if end is None else end * factor for end in (bound.min, bound.max)]
        limits.append([place[bound.metric], *ends])
    row_of = {one.row: DESIGN_LETTERS[k % len(DESIGN_LETTERS)] for k, one in enumerate(recommended)}
    if results.row_of_today is not None:
        row_of[results.row_of_today] = ", ".join(filter(None, (row_of.get(results.row_of_today), TODAY)))
    return {
        "variant": results.variants.tolist(),
        "columns": [_explorer_column(results, name, axes[name]) for name in names],
        "shown": [place[n] for n in tuple(dict.fromkeys((*telling, *named, *names)))[:MOST_AXES]],
        "crossed": [place[name] for name in crossed],
        "tint": place[named[0] if named else names[-1]],
        "objectives": [[place[name], SENSE_SIGNS[objectives[name]]] for name in named],
        "limits": limits,
        "recommended": [[row, letter] for row, letter in row_of.items()],
        "folder": wanted.folder,
        "archives": _archive_cells(results) if wanted.recorded else None,
    }


def _explorer_column(results: Results, name: str, axis: ShownColumn) -> dict[str, Any]:
    """Data of a column for a report's interactive views."""
    if not results.is_numeric(name):
        labels = results.text_values(name)
        words = sorted(set(labels))
        place = {word: k for k, word in enumerate(words)}
        return {"name": name, "unit": "", "words": words, "values": [place[word] for word in labels]}
    values = results.values(name)
    if name not in results.factors:
        values = np.where(results.ok, values, np.nan)  # a variant that did not end well has no metric to go by
    return {"name": name, "unit": axis.unit, "decimals": axis.decimals, "values": axis.shown_values(values)}


def _archive_cells(results: Results) -> list[list[Any] | None] | None:
    """Archive and number of each row's recording, or None."""
    if not set(ARCHIVE_COLUMNS) <= set(results.table.column_names):
        return None
    files, numbers = (results.table[name].to_pylist() for name in ARCHIVE_COLUMNS)
    return [None if file is None else [file, int(number)] for file, number in zip(files, numbers, strict=True)]


def has_study_files(folder: str | None) -> bool:
    """Whether a folder holds what rows' drive files need."""
    return folder is not None and all((Path(folder) / name).is_file() for name in ("study.toml", "drive.toml"))


def _built_designs(folder: str | Path, designs: Results, chosen: Sequence[RecommendedDesign]) -> list[Variant]:
    """Variants of recommended designs with their drives."""
    study, drive = load_study(Path(folder) / "study.toml"), load_drive(Path(folder) / "drive.toml")
    made = [Variant(row) for row in rows_of_recommended(study, drive, designs, chosen)]
    build_drives(study, drive, made)
    return made


def write_recommended_drives(
    folder: str | Path, page: Path, designs: Results, chosen: Sequence[RecommendedDesign]
) -> list[Path]:
    """Writes drive files of recommended designs; returns their paths.

    Args:
        folder: the study's, with study file and base drive.
        designs: rows that were compared, or designs over noise.

    Raises:
        StudyError: a row without a drive, or a folder that refuses.
    """
    if not chosen:
        return []
    path, made = Path(folder), _built_designs(folder, designs, chosen)
    given = path / DRIVE_TEXT_FILE
    text = read_drive_text(given if given.exists() else path / "drive.toml")
    files = []
    for letter, one, variant in zip(DESIGN_LETTERS, chosen, made, strict=False):
        if variant.drive is None:
            raise StudyError(f"design {letter}: {variant.reason}")
        words = ", ".join(factor_value_text(designs, name, one.row) for name in designs.factors)
        head = f"# Design {letter} of {page.name}, variant {one.variant} of {folder}: {words}\n"
        files.append(page.with_name(f"{page.stem}-{letter}.toml"))
        write_study_text(files[-1], head.replace("\r", " ") + drive_text(text, variant.drive))
    return files
