"""The name that an archive is written to: taken by one writer, and another archive's until the new one is whole."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path

from warpchain.archive.mcap_write import McapFile, taken
from warpchain.archive.names import cut_files, editions, of_cut, part_name, part_path
from warpchain.errors import ArchiveError
from warpchain.files import Lock, refusals, target_of


class Target:
    """Where an archive goes. What has the name stays whole until `replace`, whose first step takes its place.

    Args:
        path: the archive's name.
        overwrite: replace an archive of that name.
        split: a set of files, rather than one.

    Raises:
        ArchiveError: an archive of that name and no `overwrite`, another writer, something that is not a file, or a
            folder that refuses.
    """

    def __init__(self, path: Path, overwrite: bool, split: bool) -> None:
        self.path, self.overwrite, self.split, self._edition = path, overwrite, split, 0
        if path.is_dir():
            raise ArchiveError(f"{path}: is a folder; give a file name such as {path / 'run.mcap'}")
        self.check_free()
        with refusals(path, ArchiveError):
            self._lock = Lock(target_of(path))
        try:
            self.check_free()
            begun = [part_name(of_cut(file)) for file in cut_files(path)]
            self._edition = max([0, *editions(path), *(named.edition for named in begun if named)]) + 1
        except BaseException:
            self.release()
            raise

    def file(self, number: int, library: str) -> McapFile:
        """Begins the archive's file of a number, from 0."""
        path = part_path(self.path, number, self._edition) if self.split else self.path
        return McapFile(path, library, self.overwrite, claimed=True)

    def check_free(self) -> None:
        """Refuses to go on where another archive has the name and must stay."""
        there = [file for edition, files in editions(self.path).items() if edition != self._edition for file in files]
        there = [self.path, *there] if self.path.exists() else there
        if there and not self.overwrite:
            raise taken(there[0])

    def replace(self, files: Iterable[Path]) -> None:
        """Removes what had the name before these whole files. A set takes a single file's place as that goes."""
        mine = {self.path} if not self.split else set(files)
        others = [file for edition in editions(self.path).values() for file in edition]
        with refusals(self.path, ArchiveError):
            for file in [self.path, *others]:
                if file not in mine and file.is_file():
                    file.unlink()

    def discard(self, files: Iterable[Path]) -> None:
        """Removes whole files of a set that will not become one. Raises nothing."""
        if self.split:
            for file in files:
                with contextlib.suppress(OSError):
                    file.unlink()

    def release(self) -> None:
        """Lets others write to the name."""
        self._lock.release()
