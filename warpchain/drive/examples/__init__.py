"""Example drives that come with the package, by name."""

from __future__ import annotations

import difflib
from pathlib import Path

from warpchain.errors import DriveError

FOLDER = Path(__file__).parent


def example_names() -> tuple[str, ...]:
    """Names of the example drives, sorted."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def drive_path(word: str) -> Path:
    """Path of a drive file, given so or by an example's name.

    Raises:
        DriveError: neither; names the nearest example.
    """
    path = Path(word)
    if path.exists() or path.suffix == ".toml":
        return path
    if word in example_names():
        return FOLDER / f"{word}.toml"
    near = difflib.get_close_matches(word, example_names(), 1)
    hint = f'; did you mean "{near[0]}"?' if near else ""
    raise DriveError(f"{word}: neither a drive file nor an example drive ({', '.join(example_names())}){hint}")


def is_example(path: Path) -> bool:
    """Whether a file is an example drive of the package."""
    return path.parent.resolve() == FOLDER.resolve()
