"""What a report says for a decision: designs to build, the Pareto front, and which variants not to trust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape

import numpy as np

from warpchain.errors import StudyError
from warpchain.results.quantities import quantity
from warpchain.study.analysis.pareto import SENSES, pareto_front
from warpchain.study.optimize.goals import Goals
from warpchain.study.optimize.recommend import Recommended, recommend
from warpchain.study.report import page
from warpchain.study.report.panels import Axis
from warpchain.study.results import Results
from warpchain.study.spec.objectives import Bound, Objective

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
FRONT, LISTED = 30, 60
"""Most variants in the tables of the front, and of those that are not ok."""


@dataclass(frozen=True)
class Wanted:
    """What a study wants, and where it is.

    Attributes:
        objectives, bounds: of the study file.
        folder: of the study, for the commands that play variants; None gives none.
        most: designs to recommend.
        recorded: whether the study's archives hold what playback needs.
    """

    objectives: tuple[Objective, ...] = ()
    bounds: tuple[Bound, ...] = ()
    folder: str | None = None
    most: int = 4
    recorded: bool = True

    @property
    def senses(self) -> dict[str, str]:
        """ "min" or "max" by objective."""
        return {objective.metric: objective.sense for objective in self.objectives}

    @property
    def metrics(self) -> tuple[str, ...]:
        """What objectives and limits name."""
        return Goals(self.objectives, self.bounds).metrics


def wanted_of(results: Results, objectives: Mapping[str, str] | None, wanted: Wanted | None) -> Wanted:
    """What is wanted, with other objectives if some are given.

    Raises:
        StudyError: a metric that the table lacks, or an unknown sense.
    """
    found = wanted or Wanted()
    if objectives is not None:
        for metric, sense in objectives.items():
            if sense not in SENSES:
                raise StudyError(f'objectives: {metric} = {sense!r}: allowed are "min" and "max"')
        given = tuple(
            Objective.model_validate({"metric": metric, "sense": sense}) for metric, sense in objectives.items()
        )
        found = replace(found, objectives=given)
    held = results.table.column_names
    if objectives is None:  # of a study of which nothing ran, metrics have no columns
        objectives_held = tuple(o for o in found.objectives if o.metric in held)
        found = replace(found, objectives=objectives_held, bounds=tuple(b for b in found.bounds if b.metric in held))
    for metric in found.metrics:
        results.values(metric)
    return found


def rows_table(results: Results, rows: Sequence[int], columns: Sequence[str], first: Sequence[str] = ()) -> str:
    """Variants of rows with columns in the units that are shown.

    Args:
        first: a word for each row, before its number; none has no such column.
    """
    axes = {name: Axis(results, name) for name in columns if results.numeric(name)}
    heads = [*([""] if first else []), "variant", *(axes[name].name if name in axes else name for name in columns)]
    lines = []
    for k, row in enumerate(rows):
        cells: list[object] = [*([first[k]] if first else []), int(results.variants[row])]
        for name in columns:
            value = results.table[name][int(row)].as_py()
            whole = isinstance(value, int) and axes[name].factor == 1.0 if name in axes else True
            cells.append(value if value is None or whole else float(value) * axes[name].factor)
        lines.append(cells)
    return page.table(heads, lines)


def designs_section(results: Results, wanted: Wanted) -> tuple[page.Section | None, list[Recommended]]:
    """The designs to build: why, what is believed of them, how to play them; none without objectives."""
    if not wanted.objectives:
        return None, []
    goals = Goals(wanted.objectives, wanted.bounds)
    try:
        found = recommend(results, goals, wanted.most)
    except StudyError as error:
        return page.section("designs", "Recommended designs", page.text(str(error))), []
    asked = [f"{o.metric} {'low' if o.sense == 'min' else 'high'}" for o in wanted.objectives]
    kept = []
    for bound in wanted.bounds:
        unit = results.unit(bound.metric)
        ends = [
            f"{word} {quantity(end, unit)}"
            for word, end in (("at least", bound.min), ("at most", bound.max))
            if end is not None
        ]
        kept.append(f"{bound.metric} {' and '.join(ends)}")
    parts = [
        page.text(f"Wanted: {'; '.join(asked)}." + (f" Limits: {'; '.join(kept)}." if kept else "")),
        page.text(
            "\N{PLUS-MINUS SIGN} is one standard deviation of the metric itself as a surrogate of all variants has it: "
            "the best of many runs is the best partly by luck, and this takes that out.",
            muted=True,
        ),
    ]
    for k, one in enumerate(found):
        parts.append(_design(results, goals, one, LETTERS[k % len(LETTERS)], wanted))
    parts.append(rows_table(results, [one.row for one in found], results.factors, LETTERS[: len(found)]))
    return page.section("designs", "Recommended designs", *parts), found


def play_command(wanted: Wanted, results: Results, row: int) -> str:
    """The command that plays a variant: its recording, or a run of it that is recorded."""
    names = results.table.column_names
    folder = wanted.folder
    if wanted.recorded and "archive" in names and (archive := results.table["archive"][row].as_py()) is not None:
        return f"warpchain view {folder}/{archive} --variant {results.table['archive_variant'][row].as_py()}"
    return f"warpchain study play {folder} {results.variants[row]}"


def _design(results: Results, goals: Goals, one: Recommended, letter: str, wanted: Wanted) -> str:
    lines = []
    for name in goals.metrics:
        mean, deviation = one.believed[name]
        unit = results.unit(name)
        if name in results.factors:
            lines.append((name, quantity(mean, unit), "", "set"))
            continue
        lines.append((name, quantity(mean, unit, deviation), quantity(one.measured[name], unit), ""))
    told = page.table(("metric", "believed", "its run gave", ""), lines)
    command = "" if wanted.folder is None else escape(play_command(wanted, results, one.row))
    play = command and f"<p>Play it: <code>{command}</code></p>"
    head = page.heading(f"{letter}: variant {one.variant}")
    return f'<div class="design">{head}{page.bullets(one.reasons)}{told}{play}</div>'


def front_section(results: Results, objectives: Mapping[str, str], by_default: bool) -> page.Section | None:
    """The Pareto front as a view that can be brushed, and as a table with units."""
    if len(objectives) < 2:
        return None
    front = pareto_front(results, objectives)
    words = " and ".join(f"{metric} {'low' if sense == 'min' else 'high'}" for metric, sense in objectives.items())
    hint = " (taken for want of chosen objectives)" if by_default else ""
    columns = tuple(dict.fromkeys((*objectives, *results.factors)))
    return page.section(
        "front",
        "Pareto front",
        page.text(
            f"Wanted: {words}{hint}. No other variant beats those on the front in one without losing in another; "
            "the table has those of all variants, the picture those of the ones that are kept below."
        ),
        page.place("front-view", f"Pareto front of {words}"),
        rows_table(results, front[:FRONT].tolist(), columns),
        page.text(f"{len(front) - FRONT} further variants are on the front.") if len(front) > FRONT else "",
    )


def ends_section(results: Results) -> page.Section:
    """How the variants ended, why, and which ones are not to be trusted."""
    reasons = results.reasons()
    if not reasons:
        return page.section("ends", "How the variants ended", page.text("Every variant is ok."))
    status = results.status
    rank = {"suspect": 0, "diverged": 1}
    rows = sorted(np.flatnonzero(~results.ok).tolist(), key=lambda row: (rank.get(status[row], 2), row))
    held = results.table["reason"].to_pylist() if "reason" in results.table.column_names else [None] * len(status)
    listed = [(int(results.variants[row]), status[row], held[row] or "no reason given") for row in rows[:LISTED]]
    return page.section(
        "ends",
        "How the variants ended",
        page.text(
            "Infeasible variants could not be run as drawn; diverged ones were stopped when their motion ran away; "
            "suspect ones are beyond a limit of the study. None of them takes part in what follows."
        ),
        page.table(("status", "reason (of the first one, where only its numbers differ)", "variants"), reasons[:25]),
        page.text(f"{len(reasons) - 25} further reasons are in the table.") if len(reasons) > 25 else "",
        page.heading("Each of them"),
        page.table(("variant", "status", "reason"), listed),
        page.text(f"The first {LISTED} of {len(rows)}; all are in the table.") if len(rows) > LISTED else "",
    )
