"""The command `warpchain draw`: the picture of a drive and what `check` finds, once or at every save."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.cli.shared_options import drive_of_arguments
from warpchain.errors import WarpchainError

if TYPE_CHECKING:
    from warpchain.drive import Drive

WATCH_INTERVAL = 0.25
"""Time between looks at a watched drive file [s]."""


def draw_drive(drive: Drive, path: Path) -> None:
    """Writes a drive's picture, also if its number of links does not fit.

    Raises:
        WarpchainError: another ending than .png or .svg, a chain without a path, or a file that cannot be written.
    """
    from warpchain.view.figures.drive_figure import drive_figure
    from warpchain.view.figures.figure_style import save_figure

    check_picture_ending(path)
    save_figure(drive_figure(drive), path)


def check_picture_ending(path: Path) -> None:
    """Raises WarpchainError for a picture to draw without .png or .svg."""
    from warpchain.view.figures.figure_style import FIGURE_KINDS

    if path.suffix[1:] not in FIGURE_KINDS:
        raise WarpchainError(f"-o {path}: must end in {', '.join(f'.{kind}' for kind in FIGURE_KINDS)}")


def draw_lines(arguments: Namespace) -> Iterable[str]:
    """Draws a drive, with --watch at every save until Ctrl-C; lines on its fit, findings and the picture.

    Raises:
        WarpchainError: a drive that cannot be drawn or, with --watch, a picture's ending that is not allowed.
    """
    return _lines_at_saves(arguments) if arguments.watch else _picture_lines(arguments)


def _picture_lines(arguments: Namespace) -> list[str]:
    """Draws a drive; returns lines on its fit, what `check` finds, and the picture's name."""
    from warpchain.assembly.summary import derived_quantities, fit_and_findings

    drive = drive_of_arguments(arguments)
    draw_drive(drive, arguments.output)
    return [*fit_and_findings(derived_quantities(drive)), str(arguments.output)]


def _lines_at_saves(arguments: Namespace) -> Iterator[str]:
    """Lines on a drive drawn whenever its file changes, until Ctrl-C, and on what is wrong."""
    from warpchain.drive.examples import drive_path

    check_picture_ending(arguments.output)
    file, known = drive_path(arguments.drive), None
    try:
        while True:
            now = _file_state(file)
            if now != known:
                known = now
                for line in _draw_lines_or_errors(arguments):
                    yield f"{time.strftime('%H:%M:%S')} {line}"
            time.sleep(WATCH_INTERVAL)
    except KeyboardInterrupt:
        return


def _draw_lines_or_errors(arguments: Namespace) -> list[str]:
    """Lines on a drive that is drawn, or its error's."""
    try:
        return _picture_lines(arguments)
    except WarpchainError as error:
        return [f"error: {line}" for line in str(error).splitlines()]


def _file_state(file: Path) -> tuple[int, int, int] | None:
    """State of a drive file watched to be drawn, new after each save, or None."""
    try:
        now = file.stat()
    except OSError:
        return None
    return now.st_mtime_ns, now.st_size, now.st_ino
