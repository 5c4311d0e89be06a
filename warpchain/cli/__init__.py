"""The command line `warpchain`."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main(argv: list[str] | None = None) -> int:
    """Runs the command line; returns the exit status. Ctrl-C leaves no traceback."""
    if sys.platform == "win32":
        print("warpchain: error: runs on Linux and macOS; on Windows in WSL 2 (docs/devices.md)", file=sys.stderr)
        return 2
    try:
        from warpchain.cli import parser
    except KeyboardInterrupt:
        print("warpchain: interrupted", file=sys.stderr)
        return 1
    return parser.run_command_line(argv)
