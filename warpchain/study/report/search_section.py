"""Section of a study's report on a search: best values over evaluations, and sampled places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from warpchain.results.units import quantity_words
from warpchain.study.analysis.pareto import GoalValues
from warpchain.study.optimize.recommend import RecommendedDesign
from warpchain.study.report.decision_sections import ReportGoals
from warpchain.study.report.panels import ACCENT, INK, MARK, PALE, Panel, ShownColumn, panels_html, rounded_numbers
from warpchain.study.results import ROUND_COLUMN, Results
from warpchain.view import html

MOST_DRAWN_FACTORS = 12

KEEPING_NOTE = " and keep the limits as they were measured; pale dots do not."


def search_section(
    results: Results, wanted: ReportGoals, recommended: Sequence[RecommendedDesign]
) -> html.PageSection | None:
    """HTML section on the course of a search."""
    if not wanted.objectives or ROUND_COLUMN not in results.table.column_names:
        return None
    measured, rounds = wanted.goals.goal_values(results), results.values(ROUND_COLUMN)
    kept = int(measured.limits_kept.sum())
    counts = f"{len(rounds)} variants in {int(rounds.max()) + 1} rounds, {int(results.ok.sum())} ok"
    lines = [counts + (f", {kept} of which keep the limits" if wanted.bounds else "")]
    lines += [_best_value_line(results, wanted, measured, rounds, k) for k in range(len(wanted.objectives)) if kept]
    chosen = np.array([one.row for one in recommended], dtype=np.intp)
    starts = np.flatnonzero(np.diff(rounds) > 0) + 1
    progress = [_progress_panel(results, wanted, measured, starts, k) for k in range(len(wanted.objectives))]
    return html.page_section(
        "search",
        "The search",
        html.paragraph_html(
            "Each variant in the order of its evaluation; a round ends at each dotted line, the study's design at the "
            "first. The red line is the best so far of the variants that are ok"
            + (KEEPING_NOTE if wanted.bounds else "."),
            muted=True,
        ),
        html.bullets_html(lines),
        panels_html(progress, "best values over the evaluations"),
        html.heading_html("Where it looked"),
        panels_html(
            [
                _factor_panel(results, name, rounds, chosen, k == 0)
                for k, name in enumerate(results.factors[:MOST_DRAWN_FACTORS])
            ],
            "values of the factors over the evaluations",
        ),
    )


def _best_costs(measured: GoalValues, k: int) -> np.ndarray:
    """Least cost (R,) of objective k up to each row."""
    return np.minimum.accumulate(np.where(measured.limits_kept, measured.costs[:, k], np.inf))


def _best_value_line(results: Results, wanted: ReportGoals, measured: GoalValues, rounds: np.ndarray, k: int) -> str:
    """Line on a search's best value of objective k."""
    objective, sign, best = wanted.objectives[k], wanted.goals.cost_signs[k], _best_costs(measured, k)
    unit, at = results.column_unit(objective.metric), int(np.argmin(best))
    design = best[rounds == rounds[0]][-1]
    before = f" ({quantity_words(sign * float(design), unit)} after the design)" if np.isfinite(design) else ""
    found = f"evaluation {at + 1} of {len(best)}, round {int(rounds[at]) + 1}"
    word = "lowest" if objective.sense == "min" else "highest"
    return f"{word} {objective.metric}: {quantity_words(sign * float(best[-1]), unit)}{before}, found at {found}"


def _progress_panel(results: Results, wanted: ReportGoals, measured: GoalValues, starts: np.ndarray, k: int) -> Panel:
    """Panel of an objective over a search's evaluations."""
    objective, sign, best = wanted.objectives[k], wanted.goals.cost_signs[k], _best_costs(measured, k)
    axis, count = ShownColumn(results, objective.metric), np.arange(1, len(best) + 1)
    values = np.where(measured.ok, sign * measured.costs[:, k], np.nan)
    reached = np.isfinite(best)
    steps = np.repeat(np.flatnonzero(reached), 2)
    x, y = count[steps[1:]], sign * best[steps[:-1]]
    named = k == 0
    series: list[dict[str, Any]] = [
        {"kind": "upright", "x": [start + 0.5], "color": PALE, "dash": "2 3"} for start in starts.tolist()
    ]
    for rows, color, label in (
        (~measured.limits_kept, PALE, "beyond a limit"),
        (measured.limits_kept, ACCENT, "keeps the limits"),
    ):
        label = label if wanted.bounds else "variants"
        if rows.any() and (wanted.bounds or color == ACCENT):
            series.append(_dots_series(count[rows], axis.shown_values(values[rows]), color, label if named else ""))
    today = results.row_of_today
    if today is not None and np.isfinite(values[today]):
        level = {"kind": "level", "x": [0], "y": axis.shown_values([values[today]]), "color": INK}
        series.append(level | ({"label": "today's design"} if named else {}))
    if len(steps):
        line = {"kind": "line", "x": x.tolist(), "y": axis.shown_values(y), "color": MARK}
        series.append(line | ({"label": "best so far"} if named else {}))
    x_axis = {"label": "evaluation", "range": [0, len(best) + 1]}
    return {"x": x_axis, "y": {"label": axis.name}, "series": series, "width": 540, "height": 270}


def _factor_panel(results: Results, name: str, rounds: np.ndarray, chosen: np.ndarray, named: bool) -> Panel:
    """Panel of a factor's values over a search's evaluations."""
    count = np.arange(1, len(rounds) + 1)
    y: dict[str, Any]
    if results.is_numeric(name):
        axis = ShownColumn(results, name)
        shown, y = np.array(axis.shown_values(results.values(name)), dtype=float), {"label": axis.name}
    else:
        words = sorted(set(results.text_values(name)))
        shown = np.array([words.index(word) for word in results.text_values(name)], dtype=float)
        y = {"label": name, "words": words}
    design, picked = rounds == rounds[0], np.isin(np.arange(len(rounds)), chosen)
    series = []
    for rows, color, label in (
        (design & ~picked, INK, "design"),
        (~design & ~picked, ACCENT, "proposed"),
        (picked, MARK, "recommended"),
    ):
        if rows.any():
            series.append(_dots_series(count[rows], rounded_numbers(shown[rows]), color, label if named else ""))
    return {"x": {"label": "evaluation", "range": [0, len(rounds) + 1]}, "y": y, "series": series, "height": 210}


def _dots_series(x: np.ndarray, y: list[float | None], color: str, label: str) -> dict[str, Any]:
    """Series of a search's dots in a panel."""
    size = 3.4 if color == MARK else 2.2
    return {"kind": "points", "x": x.tolist(), "y": y, "color": color, "size": size} | (
        {"label": label} if label else {}
    )
