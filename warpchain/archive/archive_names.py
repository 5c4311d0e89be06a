"""File names of an archive: one or a set, what a killed run left of them, and the writer's lock.

A set `run.part0000.mcap` and so on that replaces another is an edition, `run.part0000-2.mcap`, and is the archive once
its last part has its name.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from warpchain.archive import archive_format
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.mcap_write import McapWriter, name_taken_error
from warpchain.errors import ArchiveError
from warpchain.files import PARTIAL_PATTERN, WriteLock, refusals_as_errors, target_of_path

PART_STEM = re.compile(r"(.*)\.part(\d{4,9})(?:-(\d{1,9}))?")


class PartName(NamedTuple):
    """Archive, number and edition in a part's file name."""

    archive: Path
    number: int
    edition: int


def part_path(path: Path, number: int, edition: int = 1) -> Path:
    """Path of a part of an archive: `run.mcap`, 3 -> `run.part0003.mcap`."""
    mark = f"-{edition}" if edition > 1 else ""
    return path.with_name(f"{path.stem}.part{number:04d}{mark}{path.suffix}")


def parse_part_name(path: Path) -> PartName | None:
    """Archive, number and edition in a part's file name, or None."""
    found = PART_STEM.fullmatch(path.stem)
    return found and PartName(path.with_name(found[1] + path.suffix), int(found[2]), int(found[3] or 1))


def files_by_edition(path: Path) -> dict[int, list[Path]]:
    """Files of an archive's sets in order, by edition."""
    found: dict[int, dict[int, Path]] = {}
    if path.parent.is_dir():
        for file in path.parent.iterdir():
            named = parse_part_name(file)
            if named and named.archive == path:
                found.setdefault(named.edition, {})[named.number] = file
    return {edition: [found[edition][k] for k in sorted(found[edition])] for edition in sorted(found)}


def part_files(path: Path) -> list[Path]:
    """Files of an archive's latest whole edition in order, if any."""
    found = files_by_edition(path)
    if not found:
        return []
    whole = [files for files in found.values() if len(found) > 1 and is_whole_set(files)]
    return whole[-1] if whole else list(found.values())[-1]


def is_whole_set(files: list[Path]) -> bool:
    """Whether a set of archive files is whole."""
    try:
        end = McapIndex(files[-1]).read_metadata(archive_format.END_METADATA) or {}
    except ArchiveError:
        return False
    return end.get("parts") == str(len(files))


def unfinished_files(path: Path) -> list[Path]:
    """Unfinished files of an archive's name, left or in use."""
    if not path.parent.is_dir():
        return []
    left = re.compile(rf"({re.escape(path.stem)}(\.part\d+(-\d+)?)?{re.escape(path.suffix)}){PARTIAL_PATTERN}")
    return sorted(file for file in path.parent.iterdir() if left.fullmatch(file.name))


def finished_path(file: Path) -> Path:
    """Path of an unfinished archive file once finished."""
    return file.with_name(re.sub(PARTIAL_PATTERN + "$", "", file.name))


def archive_files(path: Path) -> list[Path]:
    """Files of an archive in order, by its name or a part's."""
    named = parse_part_name(path)
    is_file = os.path.isfile(path)  # False also of a name too long, where a path's own method raises
    if named and is_file:
        return files_by_edition(named.archive)[named.edition]
    return [path] if is_file else part_files(path) or [path]


class ArchiveTarget:
    """Name of an archive to write, locked; `split` makes a set of files.

    Raises:
        ArchiveError: an archive of that name and no `overwrite`, another writer, a folder, or a disk that refuses.
    """

    def __init__(self, path: Path, overwrite: bool, split: bool) -> None:
        self.path, self.overwrite, self.split, self._edition = path, overwrite, split, 0
        with refusals_as_errors(path, ArchiveError):
            if path.is_dir():
                raise ArchiveError(f"{path}: is a folder; give a file name such as {path / 'run.mcap'}")
            self.check_free()
            self._lock = WriteLock(target_of_path(path))
        try:
            self.check_free()
            begun = [parse_part_name(finished_path(file)) for file in unfinished_files(path)]
            self._edition = max([0, *files_by_edition(path), *(named.edition for named in begun if named)]) + 1
        except BaseException:
            self.release_lock()
            raise

    def begin_file(self, number: int, library: str) -> McapWriter:
        """Writer of the archive's file `number`, from 0."""
        path = part_path(self.path, number, self._edition) if self.split else self.path
        return McapWriter(path, library, self.overwrite, claimed=True)

    def check_free(self) -> None:
        """Raises ArchiveError where another archive must keep the name."""
        there = [
            file for edition, files in files_by_edition(self.path).items() if edition != self._edition for file in files
        ]
        there = [self.path, *there] if self.path.exists() else there
        if there and not self.overwrite:
            raise name_taken_error(there[0])

    def remove_replaced(self, files: Iterable[Path]) -> None:
        """Removes the archive that these whole files replace."""
        mine = {self.path} if not self.split else set(files)
        others = [file for edition in files_by_edition(self.path).values() for file in edition]
        with refusals_as_errors(self.path, ArchiveError):
            for file in [self.path, *others]:
                if file not in mine and file.is_file():
                    file.unlink()

    def discard_files(self, files: Iterable[Path]) -> None:
        """Removes files of an archive's incomplete set; raises nothing."""
        if self.split:
            for file in files:
                with contextlib.suppress(OSError):
                    file.unlink()

    def release_lock(self) -> None:
        """Releases the lock of the archive's name."""
        self._lock.release()
