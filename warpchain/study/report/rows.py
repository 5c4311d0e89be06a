"""The rows of a study as the page's script takes them: columns in the units that are shown, the commands' parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from warpchain.study.analysis.pareto import SENSES
from warpchain.study.columns import ARCHIVED
from warpchain.study.optimize.recommend import Recommended
from warpchain.study.report.decisions import LETTERS, Wanted
from warpchain.study.report.panels import Axis
from warpchain.study.results import Results

MOST_AXES, MATRIX = 12, 5
"""Columns that parallel coordinates show at first, and columns of the scatter matrix."""


def rows_data(
    results: Results,
    metrics: Sequence[str],
    telling: Sequence[str],
    objectives: Mapping[str, str],
    wanted: Wanted,
    recommended: Sequence[Recommended],
) -> dict[str, Any]:
    """All rows for the page.

    Args:
        results: the study's results.
        metrics: what is shown beside the factors.
        telling: the factors that matter most, first.
        objectives: "min" or "max" by metric.
        wanted: limits to begin with, and the study's folder for commands.
        recommended: designs to mark.
    """
    bounds = wanted.bounds
    names = tuple(dict.fromkeys((*results.factors, *objectives, *(b.metric for b in bounds), *metrics)))
    axes = {name: Axis(results, name) for name in names}
    place = {name: k for k, name in enumerate(names)}
    named = [m for m in objectives if m in place]
    crossed = tuple(dict.fromkeys((*named[:2], *telling, *metrics)))[:MATRIX]
    limits = []
    for bound in bounds:
        factor = axes[bound.metric].factor
        ends = [None if end is None else end * factor for end in (bound.min, bound.max)]
        limits.append([place[bound.metric], *ends])
    row_of = {one.row: LETTERS[k % len(LETTERS)] for k, one in enumerate(recommended)}
    return {
        "variant": results.variants.tolist(),
        "columns": [_column(results, name, axes[name]) for name in names],
        "shown": [place[n] for n in tuple(dict.fromkeys((*telling, *named, *names)))[:MOST_AXES]],
        "crossed": [place[name] for name in crossed],
        "tint": place[named[0] if named else names[-1]],
        "objectives": [[place[name], SENSES[objectives[name]]] for name in named],
        "limits": limits,
        "recommended": [[row, letter] for row, letter in row_of.items()],
        "folder": wanted.folder,
        "archives": _archives(results) if wanted.recorded else None,
    }


def _column(results: Results, name: str, axis: Axis) -> dict[str, Any]:
    if not results.numeric(name):
        labels = results.labels(name)
        words = sorted(set(labels))
        place = {word: k for k, word in enumerate(words)}
        return {"name": name, "unit": "", "words": words, "values": [place[word] for word in labels]}
    values = results.values(name)
    if name not in results.factors:
        values = np.where(results.ok, values, np.nan)  # a variant that did not end well has no metric to go by
    return {"name": name, "unit": axis.unit, "values": axis.of(values)}


def _archives(results: Results) -> list[list[Any] | None] | None:
    if not set(ARCHIVED) <= set(results.table.column_names):
        return None
    files, numbers = (results.table[name].to_pylist() for name in ARCHIVED)
    return [None if file is None else [file, int(number)] for file, number in zip(files, numbers, strict=True)]
