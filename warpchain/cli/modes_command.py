"""The command `warpchain modes`: modes and Campbell diagrams, printed and written."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpchain.cli.shared_options import drive_of_arguments
from warpchain.drive import Drive
from warpchain.errors import WarpchainError

if TYPE_CHECKING:
    from warpchain.modal.campbell import Campbell
    from warpchain.modal.eigenmodes import Modes

MODE_ENDINGS = (".html", ".png", ".svg", ".rrd", ".npz")


def modes_lines(arguments: argparse.Namespace) -> list[str]:
    """Finds a drive's modes, writes what was asked for; returns lines to print."""
    from warpchain.engine import start_warp
    from warpchain.modal.campbell import MOST_PHASES, MOST_POINTS
    from warpchain.modal.eigenmodes import modes
    from warpchain.modal.mode_page import campbell_lines, mode_lines

    start_warp(precompiled=False)
    drive, path, speeds = drive_of_arguments(arguments), arguments.output, arguments.speed
    if path is not None and path.suffix not in MODE_ENDINGS:
        raise WarpchainError(f"-o {path}: must end in {', '.join(MODE_ENDINGS)}")
    if len(speeds) > 2 or min(speeds) < 0.0 or speeds[:-1] >= speeds[1:] != []:
        given = " ".join(map("{:g}".format, speeds))
        raise WarpchainError(f"--speed {given}: must be one or two speeds of at least 0, the second above the first")
    if arguments.phases > 1 and len(speeds) < 2:
        raise WarpchainError(f"--phases {arguments.phases}: takes a diagram over two speeds, --speed FROM TO")
    for name, most in (("phases", MOST_PHASES), ("points", MOST_POINTS)):
        if getattr(arguments, name) > most:
            raise WarpchainError(f"--{name} {getattr(arguments, name)}: must be 1 to {most}")
    if arguments.valve != "shut" and len(speeds) == 2:
        raise WarpchainError(f"--valve {arguments.valve}: takes one speed; diagrams are with valves shut")
    found = None
    if len(speeds) == 2:
        found = _campbell_diagram(drive, speeds, arguments.points, arguments.count, arguments.phases)
        result = found.modes[0].first(arguments.count)
    else:
        result = modes(drive, arguments.count, speeds[0], arguments.valve)
    said = mode_lines(result) + (campbell_lines(found) if found is not None else [])
    if path is not None:
        _write_modes(path, result, found)
        said.append(str(path))
    return said


def _campbell_diagram(drive: Drive, speeds: list[float], points: int, count: int, phases: int) -> Campbell:
    """Campbell diagram of a drive's modes, found with a progress bar."""
    import numpy as np

    from warpchain.modal.campbell import campbell, pitch_averaged_campbell

    between = np.linspace(speeds[0], speeds[1], max(points, 2)).tolist()
    if phases > 1:
        return pitch_averaged_campbell(drive, between, count, phases, progress=True)[0]
    return campbell(drive, between, count, progress=True)


def _write_modes(path: Path, result: Modes, found: Campbell | None) -> None:
    """Writes modes or a Campbell diagram as page, figure, recording or arrays, by ending."""
    from warpchain.errors import ArchiveError
    from warpchain.files import refusals_as_errors, whole_file, write_text_file
    from warpchain.modal import mode_figures
    from warpchain.view.figures.figure_style import save_figure

    if path.suffix == ".html":
        from warpchain.modal.mode_page import modes_page

        with refusals_as_errors(path, ArchiveError):
            write_text_file(path, modes_page(result, found))
    elif path.suffix == ".rrd":
        from warpchain.modal.mode_recording import write_mode_recording

        write_mode_recording(result, path)
    elif path.suffix == ".npz":
        import numpy as np

        arrays: Any = result.arrays()
        with refusals_as_errors(path, ArchiveError), whole_file(path) as file:
            np.savez(file, **arrays)
    else:
        save_figure(
            mode_figures.mode_shapes_figure(result) if found is None else mode_figures.mode_campbell_figure(found), path
        )
