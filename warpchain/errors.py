"""Errors and warnings of warpchain, each message one clear line."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable

MOST_ERROR_LINES = 100
"""Most lines of an error, beside one that counts the rest."""
_SKIPPED_PACKAGES = ("warpchain", "pydantic", "contextlib")
"""Packages whose frames a warning passes over."""


class WarpchainError(Exception):
    """Base of every error that a user can act on; the command line prints it and exits with status 2."""


class DriveError(WarpchainError):
    """A drive description is wrong, a line for each value, or its chain does not fit."""

    @property
    def errors(self) -> tuple[str, ...]:
        """Lines of the error: `key.path = value: what is allowed`."""
        return tuple(str(self).split("\n"))


def drive_error(lines: Iterable[str], source: str = "") -> DriveError:
    """A `DriveError` of these lines behind `source`, `MOST_ERROR_LINES` at most."""
    prefix = f"{source}: " if source else ""
    unlike = list(dict.fromkeys(prefix + line for line in lines))
    if len(unlike) > MOST_ERROR_LINES + 1:
        unlike[MOST_ERROR_LINES:] = [f"{prefix}{len(unlike) - MOST_ERROR_LINES} more like these"]
    return DriveError("\n".join(unlike))


class SimulationError(WarpchainError):
    """A run cannot start or go on: a step past its limit, an unknown device, too little memory."""


class DeviceError(SimulationError):
    """A GPU failed in the midst of a run."""


class ArchiveError(WarpchainError):
    """An archive cannot be written or read: it exists, is foreign or damaged, or the disk refuses."""


class StudyError(WarpchainError):
    """A study, or its table, cannot be used: a missing column, too few rows, a bad design."""


class PluginError(WarpchainError):
    """A plug-in cannot be loaded, or its code fails: file, line and reason in one line."""


class LayoutWarning(UserWarning):
    """Parts of a drive stand where no chain can run well, such as strands that cross."""


class SuspectWarning(UserWarning):
    """Variants of a run are suspect or diverged: do not rely on their results."""


def warn_caller(text: str, kind: type[Warning] = UserWarning) -> None:
    """Warns as from the line outside warpchain that called it."""
    # `warnings.warn` has `skip_file_prefixes` for this from Python 3.12 on
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _SKIPPED_PACKAGES:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, kind, stacklevel=level)
