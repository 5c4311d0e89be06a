"""The command `warpchain draw`: the picture of a drive and what `check` finds, once or at every save."""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

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


def draw_lines(drive: Drive, path: Path) -> list[str]:
    """Draws a drive; returns lines on its fit, what `check` finds, and the picture's name.

    Raises:
        WarpchainError: as `draw_drive` and `warpchain.assembly.summary.derived_quantities`.
    """
    from warpchain.assembly.summary import derived_quantities, fit_and_findings

    draw_drive(drive, path)
    return [*fit_and_findings(derived_quantities(drive)), str(path)]


def watch_drive_file(load: Callable[[], Drive], arguments: Namespace) -> None:
    """Draws a drive whenever its file changes, until Ctrl-C; prints what is wrong and goes on.

    Args:
        load: reads the drive.
        arguments: with "drive" and "output", as the parser has them.

    Raises:
        WarpchainError: a picture's ending that is not allowed.
    """
    from warpchain.drive.examples import drive_path

    check_picture_ending(arguments.output)
    file, known = drive_path(arguments.drive), None
    try:
        while True:
            now = _file_state(file)
            if now != known:
                known = now
                for line in _draw_lines_or_errors(load, arguments.output):
                    print(f"{time.strftime('%H:%M:%S')} {line}", flush=True)
            time.sleep(WATCH_INTERVAL)
    except KeyboardInterrupt:
        return


def _draw_lines_or_errors(load: Callable[[], Drive], path: Path) -> list[str]:
    """Lines on a drive that is drawn, or its error's."""
    try:
        return draw_lines(load(), path)
    except WarpchainError as error:
        return [f"error: {line}" for line in str(error).splitlines()]


def _file_state(file: Path) -> tuple[int, int, int] | None:
    """State of a drive file watched to be drawn, new after each save, or None."""
    try:
        now = file.stat()
    except OSError:
        return None
    return now.st_mtime_ns, now.st_size, now.st_ino
