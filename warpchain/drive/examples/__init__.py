"""The example drives that come with the package, by name."""

from __future__ import annotations

import difflib
from pathlib import Path

from warpchain.errors import DriveError

FOLDER = Path(__file__).parent


def example_names() -> tuple[str, ...]:
    """Names of the example drives, sorted."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def drive_path(word: str) -> Path:
    """The file that `word` means: a path, or else the name of an example drive.

    Raises:
        DriveError: neither; the message names the nearest example.
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
    """True for a file among the example drives that come with the package."""
    return path.parent.resolve() == FOLDER.resolve()
