"""The command `warpchain import`: a measured signal beside a run, as tables, figures, JSON and a Rerun recording."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.errors import WarpchainError

if TYPE_CHECKING:
    from warpchain.results.measured import SignalComparison

SIGNAL_ENDINGS = (".png", ".svg", ".rrd", ".json")


def import_lines(arguments: argparse.Namespace) -> list[str]:
    """Compares a measured signal with a run, writes what was asked for; returns lines to print."""
    from warpchain.results.measured import compare_signals, signal_source
    from warpchain.results.measured_columns import MeasuredColumns
    from warpchain.results.measured_file import read_signal
    from warpchain.view.recorded_variants import recorded_variant

    for path in arguments.output:
        if path.suffix not in SIGNAL_ENDINGS:
            raise WarpchainError(f"{path}: ending {path.suffix!r}: allowed are {', '.join(SIGNAL_ENDINGS)}")
    offset = _time_offset_from_word(arguments.offset)
    one = recorded_variant(arguments.archive, arguments.variant)
    unit = signal_source(one.trajectory, arguments.name, "--as ").unit
    words = ("column", "time", "unit", "time_unit", "decimal", "head")
    columns = MeasuredColumns(*(getattr(arguments, word) for word in words))
    found = compare_signals(one.trajectory, read_signal(arguments.signal, arguments.name, unit, columns), offset)
    lines = _comparison_lines(found)
    for path in arguments.output:
        _write_comparison(path, arguments, one, found)
        lines.append(str(path))
    return lines


def _time_offset_from_word(word: str) -> float | None:
    """Time offset [s] of a measured signal from a word of --offset, None for "auto"."""
    from warpchain.results.measured_file import LATEST_TIME

    if word == "auto":
        return None
    try:
        if abs(float(word)) <= LATEST_TIME:
            return float(word)
    except ValueError:
        pass
    raise WarpchainError(f"--offset {word}: must be a number of seconds within {LATEST_TIME:g}, or auto")


def _comparison_lines(found: SignalComparison) -> list[str]:
    """Lines of a table of a signal's simulated and measured statistics and orders."""
    from warpchain.results.units import display_unit

    measured = found.measured
    unit, factor = display_unit(measured.unit, max(map(abs, found.statistics.get("largest", (0.0,)))))
    span = f"{measured.time[0]:.4g} to {measured.time[-1]:.4g} s"
    lines = [f"{measured.name} [{unit}]: measured {span}, simulated in the latter half of the run"]
    rows = [(name, *pair) for name, pair in found.statistics.items()]
    rows += [(f"order {value:.4g}, {cause}", ours, theirs) for value, (cause, ours, theirs) in found.orders.items()]
    wide = max((len(name) for name, *_ in rows), default=0)
    lines.append(f"  {'':{wide}}  {'simulated':>10}  {'measured':>10}  {'off':>8}")
    for name, ours, theirs in rows:
        off = f"{100.0 * (ours / theirs - 1.0):+.1f} %" if theirs != 0.0 else "-"
        lines.append(f"  {name:{wide}}  {factor * ours:10.4g}  {factor * theirs:10.4g}  {off:>8}")
    return lines


def _write_comparison(path: Path, arguments: argparse.Namespace, one: Any, found: SignalComparison) -> None:
    """Writes a measured signal's comparison as figure, JSON or Rerun recording, by ending."""
    if path.suffix == ".rrd":
        from warpchain.view.rerun import view

        view(one.run, one.index, save=path, measured=[found])
    elif path.suffix == ".json":
        from warpchain.files import write_text_file

        write_text_file(path, json.dumps(_comparison_json(found), indent=2) + "\n")
    else:
        from warpchain.view.figures.figure_style import save_figures
        from warpchain.view.figures.rig_figures import measured_figure

        save_figures({path.stem: measured_figure(one.trajectory, found)}, path.parent, path.suffix[1:])


def _comparison_json(found: SignalComparison) -> dict[str, Any]:
    """Values of a measured signal's comparison for JSON, in SI units."""
    pair = ("simulated", "measured")
    return {
        "name": found.measured.name,
        "unit": found.measured.unit,
        "measured_from": float(found.measured.time[0]),
        "measured_to": float(found.measured.time[-1]),
        "statistics": {name: dict(zip(pair, both, strict=True)) for name, both in found.statistics.items()},
        "orders": [
            {"order": value, "cause": cause, "simulated": ours, "measured": theirs}
            for value, (cause, ours, theirs) in found.orders.items()
        ],
    }
