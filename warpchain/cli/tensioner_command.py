"""The command `warpchain tensioner`: a tensioner on its test rig, printed, drawn and written."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.shared_options import drive_of_arguments
from warpchain.drive import Drive
from warpchain.errors import ArchiveError, WarpchainError

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.engine.tensioner_bench import PlungerMotion, RideTables

FIGURE_ENDINGS, TABLE_ENDINGS = (".png", ".svg"), (".csv", ".parquet")
SWEEP_RANGES = {"frequency": (1.0, 500.0), "temperature": (20.0, 140.0)}
"""Default ranges of sweeps [Hz], [degrees C]."""
MOST_POINTS = 1000
COLDEST, HOTTEST = -60.0, 300.0
"""Temperatures [degrees C] for which the law of viscosity holds."""


def tensioner_lines(arguments: argparse.Namespace) -> list[str]:
    """Rides a tensioner as asked, writes what was asked for; returns lines to print."""
    from warpchain.engine import start_warp

    start_warp(precompiled=False)
    drive = drive_of_arguments(arguments)
    path: Path | None = arguments.output
    if path is not None and path.suffix not in FIGURE_ENDINGS + TABLE_ENDINGS:
        raise WarpchainError(f"-o {path}: must end in {', '.join(FIGURE_ENDINGS + TABLE_ENDINGS)}")
    if arguments.sweep is None and arguments.range is not None:
        raise WarpchainError("--range: only with --sweep")
    if arguments.sweep != "temperature" and arguments.at is not None:
        raise WarpchainError("--at: only with --sweep temperature")
    arguments.frequency, arguments.viscosity = (
        list(dict.fromkeys(values)) for values in (arguments.frequency, arguments.viscosity)
    )
    return _ride_sweep(drive, arguments) if arguments.sweep is not None else _ride_sines(drive, arguments)


def _ride_sines(drive: Drive, arguments: argparse.Namespace) -> list[str]:
    """Rides a tensioner at each frequency and viscosity; returns lines on last cycles."""
    shakes = _asked_shakes(arguments, arguments.frequency, arguments.viscosity or [None])
    path = arguments.output
    if path is not None and path.suffix in TABLE_ENDINGS and len(shakes) > 1:
        raise WarpchainError(f"-o {path}: holds one ride, not {len(shakes)}; give one frequency and one viscosity")
    done = _ride_tensioner(drive, arguments, shakes, samples=True)
    said = [line for row in done.rides.to_pylist() for line in _ride_lines(row, arguments.cycles)]
    if path is None:
        return said
    if path.suffix in TABLE_ENDINGS:
        from warpchain.study.results import export_table

        export_table(done.samples[0], path, ArchiveError)
    else:
        from warpchain.view.figures.figure_style import save_figure
        from warpchain.view.figures.rig_figures import tensioner_loop_figure

        labels = [_ride_label(row, shakes) for row in done.rides.to_pylist()]
        title = f"{_figure_title(arguments)}{_common_conditions_text(done.rides)}"
        save_figure(tensioner_loop_figure(dict(zip(labels, done.samples, strict=True)), arguments.cycles, title), path)
    return [*said, str(path)]


def _ride_sweep(drive: Drive, arguments: argparse.Namespace) -> list[str]:
    """Rides a tensioner over frequency or temperature; returns a line a ride."""
    import numpy as np

    over_temperature = arguments.sweep == "temperature"
    low, high = _sweep_range(arguments)
    if over_temperature:
        if arguments.viscosity:
            raise WarpchainError("--viscosity: not with --sweep temperature, which finds it from the drive's own")
        x = np.linspace(low, high, arguments.points).tolist()
        oils = _oil_viscosities(drive, arguments, x)
        curves = [
            (f"{frequency:g} Hz", _asked_shakes(arguments, [frequency], oils)) for frequency in arguments.frequency
        ]
        axis = "oil temperature [\N{DEGREE SIGN}C]"
    else:
        x = np.geomspace(low, high, arguments.points).tolist()
        curves = [(_oil_text(oil), _asked_shakes(arguments, x, [oil])) for oil in arguments.viscosity or [None]]
        axis = "frequency [Hz]"
    done = _ride_tensioner(drive, arguments, [shake for _, shakes in curves for shake in shakes], samples=False)
    parts = {label: done.rides.slice(k * len(x), len(x)) for k, (label, _) in enumerate(curves)}
    said = [line for label, table in parts.items() for line in _sweep_lines(label, x, axis, table, len(parts) > 1)]
    path = arguments.output
    if path is None:
        return said
    if path.suffix in TABLE_ENDINGS:
        from warpchain.study.results import export_table

        export_table(
            _add_temperature_column(done.rides, x, len(parts)) if over_temperature else done.rides, path, ArchiveError
        )
    else:
        from warpchain.view.figures.figure_style import save_figure
        from warpchain.view.figures.rig_figures import tensioner_sweep_figure

        title = _figure_title(arguments)
        if len(parts) == 1:
            title += f", {next(iter(parts))}" if over_temperature or arguments.viscosity else ""
        save_figure(tensioner_sweep_figure(parts, x, axis, title), path)
    return [*said, str(path)]


def _asked_shakes(
    arguments: argparse.Namespace, frequencies: Sequence[float], viscosities: Sequence[float | None]
) -> list[PlungerMotion]:
    """Motions of a tensioner's plunger: every frequency with every viscosity."""
    from warpchain.engine.tensioner_bench import PlungerMotion

    return [
        PlungerMotion(arguments.amplitude, frequency, arguments.extension, viscosity)
        for frequency in frequencies
        for viscosity in viscosities
    ]


def _sweep_range(arguments: argparse.Namespace) -> tuple[float, float]:
    """Range of a tensioner's sweep [Hz], [degrees C], asked for or default."""
    low, high = arguments.range or SWEEP_RANGES[arguments.sweep]
    bottom, top = (0.0, math.inf) if arguments.sweep == "frequency" else (COLDEST, HOTTEST)
    if not bottom < low < high < top:
        allowed = "two frequencies above 0" if math.isinf(top) else f"two temperatures from {bottom:g} to {top:g} C"
        raise WarpchainError(f"--range {low:g} {high:g}: must be {allowed}, the lower first")
    if arguments.at is not None and not COLDEST <= arguments.at <= HOTTEST:
        raise WarpchainError(f"--at {arguments.at:g}: must be a temperature from {COLDEST:g} to {HOTTEST:g} C")
    if not 2 <= arguments.points <= MOST_POINTS:
        raise WarpchainError(f"--points {arguments.points}: must be 2 to {MOST_POINTS}")
    return low, high


def _oil_viscosities(drive: Drive, arguments: argparse.Namespace, temperatures: Sequence[float]) -> list[float]:
    """Viscosities [m^2/s] of a drive's tensioner oil at temperatures."""
    from warpchain.drive.viscosity import SWEPT_FROM, THICKEST, THINNEST, walther_from_slope
    from warpchain.engine.tensioner_bench import tensioner_by_name

    oil = tensioner_by_name(drive.as_read, arguments.name).oil
    if oil is None:
        raise WarpchainError(f"--sweep temperature: tensioner {arguments.name!r} has no oil")
    law = oil.walther
    if law is None and not THINNEST <= oil.viscosity <= THICKEST:
        key = f"tensioners.{arguments.name}.oil.viscosity = {oil.viscosity:g}"
        raise WarpchainError(f"--sweep temperature: {key}: must be from {THINNEST:g} to {THICKEST:g} m^2/s")
    law = (
        walther_from_slope(oil.viscosity, SWEPT_FROM if arguments.at is None else arguments.at) if law is None else law
    )
    return [law.viscosity(t) for t in temperatures]


def _ride_tensioner(
    drive: Drive, arguments: argparse.Namespace, shakes: list[PlungerMotion], samples: bool
) -> RideTables:
    """Tables of a tensioner's rides through sines, with a bar for many."""
    from warpchain.engine.tensioner_bench import shake_tensioner

    return shake_tensioner(drive, arguments.name, shakes, arguments.cycles, samples, progress=len(shakes) > 4)


def _oil_text(viscosity: float | None) -> str:
    """Text of a tensioner oil's viscosity, None the drive's."""
    return "the drive's oil" if viscosity is None else f"{1e6 * viscosity:.4g} mm\N{SUPERSCRIPT TWO}/s"


def _ride_label(row: dict[str, Any], shakes: Sequence[PlungerMotion]) -> str:
    """Label of a tensioner's ride: frequency and oil."""
    words = []
    if len({one.frequency for one in shakes}) > 1:
        words.append(f"{row['frequency']:g} Hz")
    if len({one.viscosity for one in shakes}) > 1:
        words.append(_oil_text(row["viscosity"]))
    return ", ".join(words) or "ride"


def _figure_title(arguments: argparse.Namespace) -> str:
    """Title of a tensioner's figure."""
    name = arguments.name.replace("$", r"\$")
    return f"{name}: \N{PLUS-MINUS SIGN}{1e3 * arguments.amplitude:g} mm"


def _common_conditions_text(rides: pa.Table) -> str:
    """Text of frequency and oil that all rides of a tensioner share."""
    found = {name: set(rides[name].to_pylist()) for name in ("frequency", "viscosity")}
    said = f" at {found['frequency'].pop():g} Hz" if len(found["frequency"]) == 1 else ""
    viscosity = found["viscosity"].pop() if len(found["viscosity"]) == 1 else math.nan
    return said if math.isnan(viscosity) else f"{said}, oil of {_oil_text(viscosity)}"


def _ride_lines(row: dict[str, Any], cycles: int) -> list[str]:
    """Lines on the last cycle of a tensioner's ride: force, pressure, valve."""
    head = f"{row['frequency']:g} Hz, {1e3 * row['amplitude']:g} mm about {1e3 * row['extension']:g} mm"
    oil = not math.isnan(row["viscosity"])
    lines = [
        f"{head}{', oil of ' + _oil_text(row['viscosity']) if oil else ''}; cycle {cycles}:",
        f"  force     {row['force_min']:10.4g} to {row['force_max']:.4g} N; work on the plunger {row['work']:.4g} J",
    ]
    if oil:
        lines += [
            f"  pressure  {1e-5 * row['pressure_min']:10.4g} to {1e-5 * row['pressure_max']:.4g} bar"
            + (f", boiling {100.0 * row['vapor']:.2g} % of the time" if row["vapor"] > 0.0 else ""),
            f"  valve     opens {row['openings']} times, lifts {1e3 * row['lift_max']:.3g} mm; "
            f"in {1e9 * row['supplied']:.4g} mm^3, leaked {1e9 * row['leaked']:.4g} mm^3"
            + "".join(f", {name} {1e9 * row[name]:.4g} mm^3" for name in ("relieved", "vented") if row[name] > 0.0),
        ]
    return lines


def _sweep_lines(label: str, x: Sequence[float], axis: str, table: pa.Table, named: bool) -> list[str]:
    """Lines of a table of a tensioner's sweep."""
    head = "       Hz" if "Hz" in axis else "        C"
    lines = [label] if named else []
    lines.append(f"{head}   mm^2/s   force [N]           pressure [bar]    work [J]  leaked [mm^3]")
    for at, row in zip(x, table.to_pylist(), strict=True):
        lines.append(
            f"{at:9.4g} {1e6 * row['viscosity']:8.4g} {row['force_min']:9.4g} {row['force_max']:9.4g} "
            f"{1e-5 * row['pressure_min']:8.3g} {1e-5 * row['pressure_max']:8.4g} {row['work']:10.4g} "
            f"{1e9 * row['leaked']:9.4g}"
        )
    return lines


def _add_temperature_column(rides: pa.Table, temperatures: Sequence[float], curves: int) -> pa.Table:
    """Table of a tensioner's rides with temperatures as first column."""
    import numpy as np
    import pyarrow as pa

    column = pa.array(np.tile(np.asarray(temperatures, dtype=float), curves))
    return rides.add_column(0, pa.field("temperature", column.type, metadata={"unit": "degC"}), column)
