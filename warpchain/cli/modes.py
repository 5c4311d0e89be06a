"""What `warpchain modes` prints and writes."""

from __future__ import annotations

import argparse

from warpchain.drive import Drive


def mode_lines(drive: Drive, arguments: argparse.Namespace) -> list[str]:
    """Finds the modes, writes what was asked for, and returns the lines to print."""
    from warpchain.modal.modes import modes
    from warpchain.modal.text import lines

    found = modes(drive, arguments.count, arguments.speed[0])
    return lines(found)
