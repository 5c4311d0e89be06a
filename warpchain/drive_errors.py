"""One error out of any number of lines."""

from __future__ import annotations

from collections.abc import Iterable

from warpchain.errors import DriveError


def drive_error(lines: Iterable[str], source: str = "") -> DriveError:
    """One error out of its lines, each behind `source`, without repetitions."""
    prefix = f"{source}: " if source else ""
    return DriveError("\n".join(dict.fromkeys(prefix + line for line in lines)))
