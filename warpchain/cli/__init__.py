"""The command line."""

from warpchain.cli.parser import main

__all__ = ["main"]
