"""Which files are an archive's: one of its name, or the parts of a set, and what a killed run left of them.

The parts of `run.mcap` are `run.part0000.mcap`, `run.part0001.mcap` and so on. A set that replaces another one is
written beside it as a further edition, `run.part0000-2.mcap` and so on: it is the archive from the moment that its last
part, which alone tells how many there are, has its name.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from warpchain.archive import schema
from warpchain.archive.mcap_read import McapIndex
from warpchain.errors import ArchiveError
from warpchain.files import PARTIAL

PART = re.compile(r"(.*)\.part(\d{4,9})(?:-(\d{1,9}))?")
"""Stem of a part's name: the archive's stem, the part's number, the set's edition where it is not the first."""


class PartName(NamedTuple):
    """What a part's name says: the archive's path, the part's number, the set's edition."""

    archive: Path
    number: int
    edition: int


def part_path(path: Path, number: int, edition: int = 1) -> Path:
    """Name of a part: `run.mcap`, 3 -> `run.part0003.mcap`."""
    mark = f"-{edition}" if edition > 1 else ""
    return path.with_name(f"{path.stem}.part{number:04d}{mark}{path.suffix}")


def part_name(path: Path) -> PartName | None:
    """What a file's name says, None if it is not a part's."""
    found = PART.fullmatch(path.stem)
    return found and PartName(path.with_name(found[1] + path.suffix), int(found[2]), int(found[3] or 1))


def editions(path: Path) -> dict[int, list[Path]]:
    """The sets that have the name `path`, by edition: their files in order."""
    found: dict[int, dict[int, Path]] = {}
    if path.parent.is_dir():
        for file in path.parent.iterdir():
            named = part_name(file)
            if named and named.archive == path:
                found.setdefault(named.edition, {})[named.number] = file
    return {edition: [found[edition][k] for k in sorted(found[edition])] for edition in sorted(found)}


def part_files(path: Path) -> list[Path]:
    """Files of the set that `path` names, in order; empty if there are none.

    Of several editions it is the latest whole one.
    """
    found = editions(path)
    if not found:
        return []
    whole = [files for files in found.values() if len(found) > 1 and is_whole(files)]
    return whole[-1] if whole else list(found.values())[-1]


def is_whole(files: list[Path]) -> bool:
    """Whether a set has its last part and all before it."""
    try:
        end = McapIndex(files[-1]).values(schema.END_METADATA) or {}
    except ArchiveError:
        return False
    return end.get("parts") == str(len(files))


def cut_files(path: Path) -> list[Path]:
    """Unfinished files of the archive that `path` names: a killed run left them, or they are being written."""
    if not path.parent.is_dir():
        return []
    left = re.compile(rf"({re.escape(path.stem)}(\.part\d+(-\d+)?)?{re.escape(path.suffix)}){PARTIAL}")
    return sorted(file for file in path.parent.iterdir() if left.fullmatch(file.name))


def of_cut(file: Path) -> Path:
    """The name that an unfinished file was to have."""
    return file.with_name(re.sub(PARTIAL + "$", "", file.name))


def archive_files(path: Path) -> list[Path]:
    """Files of the archive that `path` names: the file itself, or the set that it names or is a part of."""
    named = part_name(path)
    if named and path.is_file():
        return editions(named.archive)[named.edition]
    return [path] if path.is_file() else part_files(path) or [path]
