"""Results of the example studies, and of a search."""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import Line, case, case_option
from common.drives import example_drive
from matplotlib.figure import Figure

from warpchain import Drive, Record, load_drive, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.drive.viscosity import walther_from_two_points
from warpchain.model import Model
from warpchain.results.objectives import add_objectives
from warpchain.results.units import display_unit_word, quantity_words
from warpchain.study.analysis.pareto import Goals, goals_of_study, is_non_dominated
from warpchain.study.optimize.recommend import RecommendedDesign, recommend
from warpchain.study.results import Results, read_results
from warpchain.study.spec import Study, load_study
from warpchain.view.figures.figure_style import panel_column, strand_label

BLUE, RED, GREEN, GRAY, ORANGE = "#1f77b4", "#d1495b", "#2e8b57", "#b4bcc4", "#e08a00"
STRAND, GUIDE = "camshaft->crankshaft", "tight strand"


def guide_indentation(results: Results) -> Figure:
    """Displacement of the strand and load of the bar over the bar's indentation."""
    x = 1e3 * results.values("indentation")
    mean, std, low, high = (1e3 * results.values(f"{STRAND}.displacement_{w}") for w in ("mean", "std", "min", "max"))
    seconds = results.values("window_end") - results.values("window_start")
    load, force = 1e-3 * results.values(f"{GUIDE}.impulse") / seconds, 1e-3 * results.values(f"{GUIDE}.force_max")
    free = float(mean[0])  # the bar stands farthest back
    figure, axes = panel_column(3, 7.5, "Tight strand of the marine drive against its guide-bar", None)
    above, middle, below = axes
    above.fill_between(x, low, high, color=BLUE, alpha=0.15, lw=0, label="least to largest")
    above.fill_between(x, mean - std, mean + std, color=BLUE, alpha=0.35, lw=0, label="mean and standard deviation")
    above.plot(x, mean, color=BLUE)
    above.plot(x, x, color="0.4", lw=0.9, ls="--", label="face of the bar")
    above.set(ylabel="mid-strand\ndisplacement [mm]")
    middle.plot(x, std, "o-", ms=3, color=BLUE, label="standard deviation of the displacement")
    middle.set(ylabel="vibration [mm]", ylim=(0.0, None))
    below.plot(x, load, "o-", ms=3, color=RED, label="mean load of the bar")
    below.plot(x, force, "o-", ms=3, color=GREEN, label="largest force on a roller")
    below.set(ylabel="force [kN]", xlabel="indentation of the bar into the straight strand [mm]")
    for axis in axes:
        axis.axvline(free, color="black", lw=0.9, ls=":", label=f"mean without contact: {free:.1f} mm")
        axis.legend(fontsize=8)
    return figure


def speed_sweep(results: Results) -> Figure:
    """Vibration of each strand over the crankshaft's speed, with the speeds at which its sixth order excites a mode."""
    drive = example_drive("marine")
    path, speed = chain_path(Model(drive).chain), results.values("speed")
    turns = speed / (2.0 * np.pi)
    travel = turns * drive.sprockets[0].teeth * drive.chain.pitch
    mass = drive.chain.mass / drive.chain.pitch
    title = "dashed: the sixth order of the crankshaft has the frequency of mode n"
    figure, axes = panel_column(len(drive.strand_names), 7.5, title, None)
    for k, (axis, name) in enumerate(zip(axes, drive.strand_names, strict=True)):
        axis.plot(speed, 1e3 * results.values(f"{name}.displacement_std"), "o-", ms=3, color=BLUE)
        length = float(np.hypot(*(path.strand_end[k] - path.strand_start[k])))
        wave_square = results.values(f"{name}.tension_mean") / mass  # centrifugal tension is part of it
        for n in range(1, 9):
            apart = n * (wave_square - travel**2) / (2.0 * length * np.sqrt(wave_square)) - 6.0 * turns
            for i in np.flatnonzero(apart[:-1] * apart[1:] < 0.0)[:1]:
                at = speed[i] - apart[i] * (speed[i + 1] - speed[i]) / (apart[i + 1] - apart[i])
                axis.axvline(at, color=RED, lw=0.9, ls="--")
                axis.text(at, 0.96, f"{n}", transform=axis.get_xaxis_transform(), color=RED, va="top", ha="right")
        axis.set(ylabel="vibration [mm]", ylim=(0.0, None))
        axis.set_title(strand_label(name), loc="left", fontsize=10)
    axes[-1].set_xlabel("crankshaft speed [rad/s]")
    return figure


def pitch_elongation(results: Results) -> Figure:
    """Tension and contact forces over the chain's elongation, colored by the camshaft's torque."""
    ok = results.ok
    x, torque = 100.0 * results.values("elongation")[ok], 1e-3 * results.values("torque")[ok]
    title = f"Marine drive, tightener set to 48 kN at assembly; {int(ok.sum())} of {len(ok)} variants can be set"
    figure, axes = panel_column(3, 7.5, title, None)
    figure.set_layout_engine("constrained")  # around the color bar of all panels
    group = np.clip(np.digitize(x, np.quantile(x, np.linspace(0.0, 1.0, 9))) - 1, 0, 7)
    columns = {
        "mean tension [kN]": 1e-3 * results.values("tension_mean"),
        "largest contact force\nat the crankshaft [kN]": 1e-3 * results.values("crankshaft.force_max"),
        "contact energy\na revolution [J]": results.values("contact_energy_per_revolution"),
    }
    for axis, (label, values) in zip(axes, columns.items(), strict=True):
        y = values[ok]
        dots = axis.scatter(x, y, c=torque, s=14, cmap="viridis")
        groups = np.unique(group)
        axis.plot([x[group == g].mean() for g in groups], [y[group == g].mean() for g in groups], color=RED, lw=1.5)
        axis.set_ylabel(label)
    axes[-1].set_xlabel("elongation of the chain's pitch [%]")
    figure.colorbar(dots, ax=axes, label="camshaft torque [kN m]", shrink=0.5)
    return figure


def cold_to_hot(results: Results) -> Figure:
    """Plunger, tensions, tensioner's force and forces on the guides over the temperature."""
    x = results.values("temperature")
    figure, axes = panel_column(4, 9.0, "Timing drive of a car at 3000 rpm from cold to hot", None)
    plunger, tension, push, guides = axes
    low, mean, high = (1e3 * results.values(f"tensioner.extension_{of}") for of in ("min", "mean", "max"))
    plunger.fill_between(x, low, high, color=BLUE, alpha=0.3, lw=0, label="least to largest")
    plunger.plot(x, mean, "o-", ms=3, color=BLUE, label="mean")
    plunger.set(ylabel="plunger, out of\nas drawn [mm]")
    for (strand, name), color in zip(ENDS.items(), (BLUE, RED), strict=True):
        tension.plot(x, results.values(f"{strand}.tension_mean"), "o-", ms=3, color=color, label=f"mean, {name} strand")
    tension.plot(x, results.values("tension_max"), "o--", ms=3, color="0.3", label="largest of all")
    tension.set(ylabel="tension [N]", ylim=(0.0, None))
    for of, style in (("min", ":"), ("mean", "o-"), ("max", "--")):
        push.plot(x, results.values(f"tensioner.force_{of}"), style, ms=3, color=GREEN, label=of)
    push.set(ylabel="tensioner's\nforce [N]", ylim=(0.0, None))
    for guide, color in (("blade", BLUE), ("fixed guide", RED)):
        guides.plot(x, results.values(f"{guide}.force_max"), "o-", ms=3, color=color, label=guide)
    guides.set(
        ylabel="largest force of a\nlink on a guide [N]", ylim=(0.0, None), xlabel="temperature [\N{DEGREE SIGN}C]"
    )
    for axis in axes:
        axis.legend(fontsize=8)
    return figure


ENDS = {"crank->intake cam": "slack", "exhaust cam->crank": "tight"}
"""The strands of the car's drive beside the crankshaft, and what they are."""


def cold_to_hot_table(results: Results) -> Iterator[Line]:
    """The table over temperature."""
    means = (f"{name} strand, mean [N]" for name in ENDS.values())
    force = ("tensioner: mean, most [N]", "pressure [bar]")
    yield (
        "degrees C",
        "oil [mm^2/s]",
        "plunger [mm]",
        "its travel [mm]",
        *force,
        *means,
        "largest tension [N]",
        "friction [W]",
    )
    law = walther_from_two_points(
        *(float(results.table[name][0].as_py()) for name in ("viscosity_40", "viscosity_100"))
    )
    for row in results.table.to_pylist():
        of = {key: row[f"tensioner.{key}"] for key in ("extension_min", "extension_mean", "extension_max")}
        yield (
            f"{row['temperature']:.0f}",
            f"{1e6 * law.viscosity(row['temperature']):.3g}",
            f"{1e3 * of['extension_mean']:+.2f}",
            f"{1e3 * (of['extension_max'] - of['extension_min']):.3f}",
            f"{row['tensioner.force_mean']:.0f}, {row['tensioner.force_max']:.0f}",
            f"{1e-5 * row['tensioner.pressure_max']:.1f}",
            *(f"{row[f'{strand}.tension_mean']:.0f}" for strand in ENDS),
            f"{row['tension_max']:.0f}",
            f"{row['friction_power']:.0f}",
        )


FIGURES = {
    "guide-indentation": guide_indentation,
    "speed-sweep": speed_sweep,
    "pitch-elongation": pitch_elongation,
    "cold-to-hot": cold_to_hot,
}
TABLES = {"cold-to-hot": cold_to_hot_table}


@case(case_option("study", choices=FIGURES), case_option("table", type=Path, help="the study's results.parquet"))
def study(asked: argparse.Namespace) -> Iterator[Line]:
    """Figures of the example studies, from their results.

    warpchain study run warpchain/study/examples/speed-sweep.toml -o out/speed-sweep
    python scripts/figures.py study speed-sweep out/speed-sweep/results.parquet

    and the same for guide-indentation, pitch-elongation and cold-to-hot, which has a table, too.
    """
    if asked.study in TABLES:
        yield from TABLES[asked.study](read_results(asked.table))
    yield {asked.study: FIGURES[asked.study](read_results(asked.table))}


LETTERS = "ABCDEFGH"
COPIES = 4
"""Runs of each recommended design that its scatter is taken from."""


def run_as_study_row(study: Study, drives: Sequence[Drive], copies: int = 1) -> list[dict[str, float]]:
    """Metrics of drives that are run as the study runs its rows, a row a copy."""
    settings = {name: getattr(study.run, name) for name in ("duration", "step", "window", "precision", "device")}
    record = Record("all", study.record.rate, study.record.channels)
    return list(add_objectives(simulate(drives, record=record, replicates=copies, **settings)).to_pylist())


def scatter_of_designs(folder: Path, study: Study, goals: Goals) -> list[dict[str, float]]:
    """Standard deviations of what is wanted between copies of each recommended design that begin at other phases."""
    place = sorted((folder / "recommended").iterdir())[-1]
    drives = [load_drive(file) for file in sorted(place.glob("design-*.toml"))]
    rows = run_as_study_row(study, drives, COPIES)
    each = [rows[k : k + COPIES] for k in range(0, len(rows), COPIES)]
    return [{name: float(np.std([row[name] for row in mine], ddof=1)) for name in goals.named_metrics} for mine in each]


def front_figure(results: Results, goals: Goals, chosen: list[RecommendedDesign], drawn: Mapping[str, float]) -> Figure:
    """The rows over two objectives, and the factors along the front."""
    first, second = (objective.metric for objective in goals.objectives[:2])
    measured = goals.goal_values(results)
    kept = np.flatnonzero(measured.limits_kept)
    front = kept[is_non_dominated(measured.costs[kept])]
    front = front[np.argsort(results.values(first)[front])]
    values, labels, star = {}, {}, {}
    for name in (first, second, *results.factors):
        unit, factor = display_unit_word(results.column_unit(name), float(np.nanmax(results.values(name))))
        values[name], labels[name] = factor * results.values(name), f"{name} [{unit}]"
        star[name] = factor * drawn.get(name, np.nan)
    x, y = values[first], values[second]
    drawing = Figure(figsize=(11.0, 4.6), layout="constrained")
    grid = drawing.add_gridspec(len(results.factors), 2, width_ratios=(1.6, 1.0))
    left = drawing.add_subplot(grid[:, 0])
    left.plot(x[~measured.limits_kept], y[~measured.limits_kept], "o", ms=4, color=GRAY, label="beyond a limit")
    left.plot(x[measured.limits_kept], y[measured.limits_kept], "o", ms=4, color=BLUE, label="keeps the limits")
    left.plot(x[front], y[front], "o-", ms=5, lw=1, color=RED, label="front")
    left.plot(star[first], star[second], "*", ms=14, color="black", label="as drawn")
    for letter, one in zip(LETTERS, chosen, strict=False):
        left.plot(x[one.row], y[one.row], "o", ms=13, mfc="none", mec=ORANGE, mew=2)
        left.annotate(letter, (x[one.row], y[one.row]), (8, 8), textcoords="offset points", weight="bold")
    left.set(xlabel=labels[first], ylabel=labels[second])
    left.legend(fontsize=8)
    below: Any = None
    for k, name in enumerate(results.factors):
        below = drawing.add_subplot(grid[k, 1], sharex=below)
        below.plot(x[front], values[name][front], "o-", ms=4, lw=1, color=RED)
        below.set(ylabel=labels[name], ylim=(0.95 * np.nanmin(values[name]), 1.05 * np.nanmax(values[name])))
        below.tick_params(labelbottom=k + 1 == len(results.factors))
    below.set(xlabel=f"along the front:\n{labels[first]}")
    for axis in drawing.axes:
        axis.grid(alpha=0.3)
    return drawing


@case(case_option("folder", type=Path, help="of a search with two objectives or more"))
def search(asked: argparse.Namespace) -> Iterator[Line]:
    """The designs that a search recommends beside the drive as it is drawn, as a table and a figure with the front.

    warpchain optimize warpchain/study/examples/car-tensioner.toml -o out/car-tensioner
    python scripts/figures.py search out/car-tensioner

    Prints the table of docs/optimization.md. The drive as drawn is run once more with the study's settings. The figure
    has the folder's name.
    """
    study = load_study(asked.folder / "study.toml")
    results = read_results(asked.folder / "results.parquet", [f.name for f in study.factors if not f.hidden])
    goals = goals_of_study(study)
    chosen = recommend(results, goals, 4 if study.optimize is None else study.optimize.recommend)
    drive = load_drive(asked.folder / "drive.toml")
    drawn = {factor.name: drive.get_value(factor.path) for factor in study.factors if factor.path is not None}
    drawn |= run_as_study_row(study, [drive])[0]
    copies = scatter_of_designs(asked.folder, study, goals)
    yield ("", "as drawn", *(f"{letter}: variant {one.variant}" for letter, one in zip(LETTERS, chosen, strict=False)))
    for name in results.factors:
        unit = results.column_unit(name)
        own = quantity_words(drawn[name], unit) if name in drawn else ""
        yield (name, own, *(quantity_words(float(results.table[name][one.row].as_py()), unit) for one in chosen))
    for metric in goals.named_metrics:
        unit = results.column_unit(metric)
        values = [quantity_words(one.believed[metric][0], unit, one.believed[metric][1]) for one in chosen]
        yield (metric, quantity_words(drawn[metric], unit), *values)
        yield (f"between {COPIES} copies of it", "", *(quantity_words(mine[metric], unit, digits=2) for mine in copies))
    yield {asked.folder.name: front_figure(results, goals, chosen, drawn)}
