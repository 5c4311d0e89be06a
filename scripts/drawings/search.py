"""The result of a search."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from common.cases import case, option
from matplotlib.figure import Figure

from warpchain import Drive, Record, load_drive, simulate
from warpchain.results.objectives import add_objectives
from warpchain.results.units import quantity, shown_unit
from warpchain.study.analysis.pareto import Goals, goals_of, non_dominated
from warpchain.study.optimize.recommend import Recommended, recommend
from warpchain.study.results import Results, read_results
from warpchain.study.spec import Study, load_study

BLUE, RED, GRAY, ORANGE = "#1f77b4", "#d1495b", "#b4bcc4", "#e08a00"
LETTERS = "ABCDEFGH"
COPIES = 4
"""Runs of each recommended design that its scatter is taken from."""


def run_as(study: Study, drives: Sequence[Drive], copies: int = 1) -> list[dict[str, float]]:
    """Metrics of drives that are run as the study runs its rows, a row a copy."""
    run, record = study.run, Record("all", study.record.rate, study.record.channels)
    done = simulate(
        drives,
        duration=run.duration,
        step=run.step,
        window=run.window,
        precision=run.precision,
        device=run.device,
        record=record,
        replicates=copies,
    )
    return list(add_objectives(done).to_pylist())


def as_drawn(folder: Path, study: Study) -> dict[str, float]:
    """The base drive: values of factors that have a place in it, and its metrics."""
    drive = load_drive(folder / "drive.toml")
    own = {factor.name: drive.get_value(factor.path) for factor in study.factors if factor.path is not None}
    return {**own, **run_as(study, [drive])[0]}


def scatter(folder: Path, study: Study, goals: Goals) -> list[dict[str, float]]:
    """Standard deviations of what is wanted between copies of each recommended design that begin at other phases."""
    place = sorted((folder / "recommended").iterdir())[-1]
    drives = [load_drive(file) for file in sorted(place.glob("design-*.toml"))]
    rows = run_as(study, drives, COPIES)
    each = [rows[k : k + COPIES] for k in range(0, len(rows), COPIES)]
    return [{name: float(np.std([row[name] for row in mine], ddof=1)) for name in goals.metrics} for mine in each]


def table(results: Results, goals: Goals, chosen: list[Recommended], drawn: dict[str, float],
          copies: Sequence[Mapping[str, float]]) -> None:  # fmt: skip
    """Prints the designs, a column each, beside the drive as it is drawn."""
    names = [f"{LETTERS[k]}: variant {one.variant}" for k, one in enumerate(chosen)]
    print("| | as drawn | " + " | ".join(names) + " |\n" + "|---" * (2 + len(names)) + "|")
    for name in results.factors:
        unit = results.unit(name)
        values = [quantity(float(results.table[name][one.row].as_py()), unit) for one in chosen]
        own = quantity(drawn[name], unit) if name in drawn else "\N{EN DASH}"
        print(f"| {name} | {own} | {' | '.join(values)} |")
    for metric in goals.metrics:
        unit = results.unit(metric)
        values = [quantity(one.believed[metric][0], unit, one.believed[metric][1]) for one in chosen]
        print(f"| {metric} | {quantity(drawn[metric], unit)} | {' | '.join(values)} |")
        between = [quantity(mine[metric], unit, digits=2) for mine in copies]
        print(f"| between {COPIES} copies of it | | {' | '.join(between)} |")


def figure(results: Results, goals: Goals, chosen: list[Recommended], drawn: dict[str, float]) -> Figure:
    """The rows over two objectives, and the factors along the front."""
    first, second = (objective.metric for objective in goals.objectives[:2])
    measured = goals.measured(results)
    kept = np.flatnonzero(measured.kept)
    front = kept[non_dominated(measured.costs[kept])]
    front = front[np.argsort(results.values(first)[front])]
    axis = {name: shown_unit(results.unit(name), float(np.nanmax(results.values(name)))) for name in
            (first, second, *results.factors)}  # fmt: skip
    x, y = (axis[name][1] * results.values(name) for name in (first, second))
    drawing = Figure(figsize=(11.0, 4.6), layout="constrained")
    grid = drawing.add_gridspec(len(results.factors), 2, width_ratios=(1.6, 1.0))
    left = drawing.add_subplot(grid[:, 0])
    left.plot(x[~measured.kept], y[~measured.kept], "o", ms=4, color=GRAY, label="beyond a limit")
    left.plot(x[measured.kept], y[measured.kept], "o", ms=4, color=BLUE, label="keeps the limits")
    left.plot(x[front], y[front], "o-", ms=5, lw=1, color=RED, label="front")
    place = [axis[name][1] * drawn[name] for name in (first, second)]
    left.plot(*place, "*", ms=14, color="black", label="as drawn")
    for k, one in enumerate(chosen):
        left.plot(x[one.row], y[one.row], "o", ms=13, mfc="none", mec=ORANGE, mew=2)
        left.annotate(LETTERS[k], (x[one.row], y[one.row]), (8, 8), textcoords="offset points", weight="bold")
    left.set(xlabel=f"{first} [{axis[first][0]}]", ylabel=f"{second} [{axis[second][0]}]")
    left.legend(fontsize=8)
    below = None
    for k, name in enumerate(results.factors):
        below = drawing.add_subplot(grid[k, 1], sharex=below)
        below.plot(x[front], axis[name][1] * results.values(name)[front], "o-", ms=4, lw=1, color=RED)
        values = axis[name][1] * results.values(name)
        below.set(ylabel=f"{name} [{axis[name][0]}]", ylim=(0.95 * np.nanmin(values), 1.05 * np.nanmax(values)))
        below.tick_params(labelbottom=k == len(results.factors) - 1)
    assert below is not None  # a study has a factor
    below.set(xlabel=f"along the front [{axis[first][0]}]")
    for one_axis in drawing.axes:
        one_axis.grid(alpha=0.3)
    return drawing


@case(
    option("folder", type=Path, help="of a search with two objectives or more"),
    option("figure", type=Path, help="file of the figure"),
)
def search(asked: argparse.Namespace) -> None:
    """What a search found, as a table and a figure: the front, the designs to recommend, and the drive as it is drawn.

    warpchain optimize warpchain/study/examples/car-tensioner.toml -o out/car
    python scripts/figures.py search out/car docs/images/car-tensioner.png

    Prints the table of docs/optimization.md. The drive as drawn is run once more with the study's settings.
    """
    study = load_study(asked.folder / "study.toml")
    results = read_results(asked.folder / "results.parquet", [f.name for f in study.factors if not f.hidden])
    goals = goals_of(study)
    chosen = recommend(results, goals, 4 if study.optimize is None else study.optimize.recommend)
    drawn = as_drawn(asked.folder, study)
    table(results, goals, chosen, drawn, scatter(asked.folder, study, goals))
    figure(results, goals, chosen, drawn).savefig(asked.figure, dpi=100)
