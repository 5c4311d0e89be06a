"""HTML tables of a run's engineering report: metrics, hub forces, phase errors, guides, friction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from warpchain.drive import Drive
from warpchain.model import ChainModel
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.losses import loss_shares
from warpchain.results.metric_columns import (
    COLUMN_BY_NAME,
    PART_LISTS,
    SHAFT_SPEED_NAMES,
    column_of_metric,
    part_prefixes,
)
from warpchain.results.signals import opening_events, range_and_path
from warpchain.results.units import display_unit_word
from warpchain.results.window_statistics import ERROR_SUFFIX
from warpchain.view.html import engineering_number, paragraph_html, table_html

TABLE_DIGITS = 4


def quantity_cells(value: float, unit: str, largest: float | None = None) -> tuple[str, str]:
    """Cells of a report's table for a value [SI]: number, unit fit for `largest`."""
    word, factor = display_unit_word(unit, value if largest is None else largest)
    return engineering_number(factor * value, TABLE_DIGITS), word


def quantity_text(value: float, unit: str) -> str:
    """Text of a value [SI] in a report, with a fitting unit."""
    return " ".join(quantity_cells(value, unit)).strip()


def climb_share_text(margin: float) -> str:
    """Text of a margin to tooth jump in percent of the climb."""
    return f"{100.0 * min(1.0, margin):.3g} %"


def _metric_rows(row: Mapping[str, Any], prefix: str) -> Iterable[list[str]]:
    """Rows of a report's metrics with a prefix: name, value, error, unit, title."""
    for name, value in row.items():
        own = name.removeprefix(prefix)
        column = column_of_metric(name)
        if not name.startswith(prefix) or own not in COLUMN_BY_NAME or column is None or own.endswith(ERROR_SUFFIX):
            continue
        if value is None or isinstance(value, str) or own in ("variant", "diverged"):
            continue
        error = row.get(name + ERROR_SUFFIX)
        if column.kind is not float:
            yield [name, str(value).lower() if isinstance(value, bool) else str(value), "", "", column.title]
            continue
        shown, unit = quantity_cells(float(value), column.unit)
        spread = "unknown" if own + ERROR_SUFFIX in COLUMN_BY_NAME else ""
        if error is not None:
            spread = "\u00b1 " + quantity_cells(float(error), column.unit, float(value))[0]
        yield [name, shown, spread, unit, column.title]


def metric_tables(model: ChainModel, row: Mapping[str, Any], alike: Mapping[str, str]) -> dict[str, str]:
    """HTML tables of all metrics by part."""
    prefixes = [prefix for part in ("chain", "strand", *PART_LISTS) for prefix in part_prefixes(model, part)]
    found = {}
    for prefix in dict.fromkeys(prefixes):
        name = prefix.removesuffix(".")
        rows = [
            of
            for of in _metric_rows(row, prefix)
            if name not in alike or of[0].removeprefix(prefix) not in SHAFT_SPEED_NAMES
        ]
        if rows:
            line = paragraph_html(f"Its speed is that of {alike[name]}.", muted=True) if name in alike else ""
            head = ("metric", "value", "standard error", "unit", "what it is")
            found[name or "The whole drive"] = line + table_html(head, rows)
    return found


def hub_force_table(found: EngineeringReport, row: Mapping[str, Any]) -> str:
    """HTML table of mean and largest force on each shaft."""
    rows: list[list[Any]] = []
    for s, sprocket in enumerate(found.model.sprockets):
        frames = found.hub_forces[:, s]
        x, y, most = (row.get(f"{sprocket.name}.hub_force_{end}") for end in ("x_mean", "y_mean", "max"))
        exact = x is not None and y is not None and most is not None
        mean = np.array([x, y], dtype=float) if exact else frames.mean(axis=0)
        top = float(most) if exact and most is not None else float(np.hypot(*frames.T).max())
        values = [mean[0], mean[1], float(np.hypot(*mean)), top]
        heading = math.degrees(math.atan2(mean[1], mean[0]))
        rows.append([sprocket.name, *(quantity_text(value, "N") for value in values), round(heading, 1)])
    head = ["mean to the right", "mean upward", "size of the mean", "largest"]
    return table_html(["shaft", *head, "direction of the mean [degrees]"], rows)


def phase_error_table(found: EngineeringReport) -> str:
    """HTML table of shafts' phase errors: mean shift, range and orders."""
    if not found.phase_errors:
        return ""
    of = {found.model.sprockets[s].name: phase for s, phase in found.phase_errors.items()}
    rows: list[list[Any]] = [
        [words, *(round(math.degrees(getattr(phase, field)), 4) for phase in of.values())]
        for words, field in (("mean shift", "shift"), ("least", "low"), ("most", "high"))
    ]
    if all(phase.amplitude is not None for phase in of.values()):
        amplitudes = [np.degrees(phase.amplitude) for phase in of.values() if phase.amplitude is not None]
        for k, order in enumerate(next(iter(of.values())).orders):
            rows.append([f"amplitude of order {order:g}", *(round(float(each[k]), 4) for each in amplitudes)])
    driver = found.model.sprockets[found.model.driver].name
    return table_html([f"degrees of {driver}", *of], rows)


def guide_load_table(found: EngineeringReport, metrics: Mapping[str, float], row: Mapping[str, Any]) -> str:
    """HTML table of each guide's load and pressure."""
    rows = []
    for g, guide in enumerate(found.model.guides):
        load, width = found.guide_loads[g], found.model.guide_contact(g).width
        mean = float(found.guide_contacts[g].force.sum()) / len(found.part.time)
        peak = row.get(f"{guide.name}.force_max")
        pv = metrics.get(f"{guide.name}.pv_max", math.nan)
        pressure = "\u2013" if width is None else f"{engineering_number(1e-6 * float(load.mean.max()) / width, 3)} MPa"
        heat = "\u2013" if width is None else f"{engineering_number(1e-6 * pv / width, 3)} MPa m/s"
        rows.append([
            guide.name,
            quantity_text(mean, "N"),
            quantity_text(float(load.peak.max()) if peak is None else float(peak), "N"),
            f"{engineering_number(1e-3 * float(load.mean.max()), 3)} N/mm",
            quantity_text(metrics.get(f"{guide.name}.sliding_speed", math.nan), "m/s"),
            f"{engineering_number(1e-3 * pv, 3)} W/mm",
            pressure,
            heat,
            f"{100.0 * (1.0 - load.touching):.1f} %",
        ])  # fmt: skip
    head = ["guide", "mean force", "largest force of a roller or pin", "largest mean load", "sliding speed",
            "largest p v", "mean pressure over the width", "p v over the width", "time untouched"]  # fmt: skip
    return table_html(head, rows)


def body_motion_table(found: EngineeringReport, channels: Mapping[str, tuple[str, Any]], k: int) -> str:
    """HTML table of body k's channels: extremes, mean, range, distance."""
    rows = []
    for title, (unit, values) in channels.items():
        moved = range_and_path(found.part.time, values[:, k])
        largest = max(abs(moved.low), abs(moved.high))
        cells = [
            quantity_cells(value, unit, largest)
            for value in (moved.low, moved.mean, moved.high, moved.range_width, moved.path)
        ]
        cells[-1] = cells[-1] if unit in ("m", "rad") else ("\u2013", "")  # only motions cover a distance
        rows.append([title, *(value for value, _ in cells), cells[0][1]])
    return table_html(["what", "least", "mean", "most", "range", "distance in a second", "unit"], rows)


def check_valve_text(found: EngineeringReport, k: int) -> str:
    """Sentence on the openings of tensioner k's check valve, or ""."""
    tensioner, pressure = found.model.tensioners[k], found.part.chamber_pressure
    if pressure is None or tensioner.valve is None or tensioner.oil is None or tensioner.oil.supply_table is not None:
        return ""
    below = tensioner.oil.supply - np.asarray(pressure[:, k], dtype=float)
    opened = opening_events(found.part.time, below, tensioner.valve.cracking_pressure)
    return (
        f"Check valve: {opened.openings} openings, {opened.rate:.4g} a second; open for {100.0 * opened.share:.1f} % "
        f"of the time, at most {quantity_text(opened.longest, 's')} at once."
    )


def friction_power_table(found: EngineeringReport, row: Mapping[str, Any]) -> str:
    """HTML table of mean friction powers, from steps and from frames."""
    seconds = found.end - found.start
    inside = found.whole.time >= found.start - 1e-12
    means = {name: float(values[inside].mean()) for name, values in found.friction_power.items()}
    whole = {name: row.get(f"{name}.friction") for name in means}
    steps = {name: means[name] if work is None else float(work) / seconds for name, work in whole.items()}
    total = sum(steps.values())
    rows: list[list[Any]] = [
        [name, quantity_text(steps[name], "W"), quantity_text(means[name], "W"), round(100.0 * steps[name] / total, 1)]
        for name in means
        if total > 0.0
    ]
    rows.append(["all", quantity_text(total, "W"), quantity_text(sum(means.values()), "W"), 100.0])
    return table_html(["what rubs", "mean power", "from the frames", "share [%]"], rows)


def chains_table(
    chains: Mapping[str, tuple[EngineeringReport, Mapping[str, Any]]], margins: Mapping[str, float]
) -> str:
    """HTML table of a drive's chains in a report, and of their sums."""
    rows, links, mass, power = [], 0, 0.0, 0.0
    for name, (found, row) in chains.items():
        own = float(sum(float(values.mean()) for values in found.friction_power.values()))
        chain = found.model.chain
        links, mass, power = links + chain.links, mass + chain.links * chain.mass, power + own
        tensions = [row.get(metric) for metric in ("tension_mean", "tension_max")]
        cells = ["\u2013" if value is None else quantity_text(float(value), "N") for value in tensions]
        margin = climb_share_text(margins[name]) if name in margins else "\u2013"
        weight = quantity_text(chain.links * chain.mass, "kg")
        rows.append([name, str(chain.links), weight, *cells, margin, quantity_text(own, "W")])
    largest = [row.get("tension_max") for _, row in chains.values()]
    most = "\u2013" if None in largest else quantity_text(max(float(value) for value in largest if value), "N")
    least = climb_share_text(min(margins.values())) if margins else "\u2013"
    rows.append(["all", str(links), quantity_text(mass, "kg"), "\u2013", most, least, quantity_text(power, "W")])
    head = ("chain", "links", "mass", "mean tension", "largest tension", "least margin to tooth jump", "friction power")
    return table_html(head, rows)


def losses_table(drive: Drive, row: Mapping[str, Any]) -> str:
    """HTML table of a drive's mean losses by group and their sum, or ""."""
    found = {group: loss for group, loss in loss_shares(drive, row).items() if loss.energy != 0.0}
    if not found:
        return ""
    rows = [
        [
            group,
            quantity_text(loss.power, "W"),
            "\u2013" if loss.input_share is None else f"{100 * loss.input_share:.2g} %",
        ]
        for group, loss in found.items()
    ]
    shares = [loss.input_share for loss in found.values() if loss.input_share is not None]
    whole = f"{100.0 * sum(shares):.3g} %" if len(shares) == len(found) else "\u2013"
    rows.append(["all", quantity_text(sum(loss.power for loss in found.values()), "W"), whole])
    return table_html(("losses", "mean power", "of the input"), rows)
