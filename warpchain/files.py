"""Files written whole or not at all, and text read; what the file system refuses becomes one line.

A file is written under a temporary name in its own folder, flushed to the disk, and only then given its name, which the
folder's flush makes last. Whoever looks at that name, at any moment and after any end of the writing process, finds
the old file whole, or the new one.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO


class WholeFile:
    """A file being written under a temporary name, which `finish` turns into its own and `drop` removes.

    Args:
        path: its name when whole.
        overwrite: replace a file of that name; without it, of several processes the first one to finish decides.
        partial: the temporary name, in the same folder; None makes one that no other writer has.

    Attributes:
        partial: the temporary name.
        stream: the open binary file.
        finished: whether it has its own name.

    Raises:
        FileExistsError: a file of the temporary name; in `finish`, one of its own name and no `overwrite`.
        OSError: here and in `finish`, a folder or disk that refuses.
    """

    def __init__(self, path: Path, overwrite: bool = True, partial: Path | None = None) -> None:
        self.path, self.overwrite, self.finished = path, overwrite, False
        self.partial = partial or path.with_name(f".{path.name[:40]}.{os.getpid()}.{secrets.token_hex(8)}.partial")
        self.stream: IO[bytes] = self.partial.open("xb")

    def finish(self) -> None:
        """Flushes the file to the disk and gives it its name."""
        self.stream.flush()
        os.fsync(self.stream.fileno())
        self.stream.close()
        if self.overwrite:
            os.replace(self.partial, self.path)
        else:
            _claim(self.partial, self.path)
        self.finished = True
        _sync_folder(self.path.parent)

    def drop(self, keep: bool = False) -> None:
        """Ends an unfinished file: removes it, or keeps it under its temporary name. Raises nothing."""
        with contextlib.suppress(OSError):  # a full disk, which was said already
            self.stream.close()
        if not (keep or self.finished):
            with contextlib.suppress(OSError):
                self.partial.unlink()


def _claim(partial: Path, path: Path) -> None:
    """Renames a file unless the new name is taken, in one step of the file system where it knows links."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # without links, the last of those that finish at the same moment decides
        if path.exists():
            raise FileExistsError(f"{path} exists") from None
        os.replace(partial, path)
    else:
        os.unlink(partial)


def _sync_folder(folder: Path) -> None:
    """Flushes a folder's entries, where the system lets one open it."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def whole_file(path: Path, overwrite: bool = True) -> Iterator[IO[bytes]]:
    """A file to be written in a `with` block, whose end gives it its name; an error leaves what was there before.

    Its `name` is the temporary one, for those that write by path. See `WholeFile` for arguments and errors.
    """
    file = WholeFile(path, overwrite)
    try:
        yield file.stream
        file.finish()
    finally:
        file.drop()


def write_text(path: Path, text: str, overwrite: bool = True) -> None:
    """Writes a text file (UTF-8, lines as they stand); see `WholeFile`."""
    with whole_file(path, overwrite) as file:
        file.write(text.encode())


@contextlib.contextmanager
def refusals(path: str | Path, error: type[Exception]) -> Iterator[None]:
    """Turns a file system's refusal to write into an error of one line: `PATH: cannot be written (File too large)`."""
    try:
        yield
    except OSError as refused:
        raise error(f"{path}: cannot be written ({reason(refused)})") from None


def reason(error: OSError) -> str:
    """Why the system refused, in a few words on one line."""
    return error.strerror or (str(error).splitlines() or [type(error).__name__])[0]


def read_text(path: str | os.PathLike[str], kind: str, error: Callable[[str], Exception]) -> str:
    """A text file's content (UTF-8, with or without a byte order mark), line ends as they stand.

    Args:
        path: the file.
        kind: what it should be, such as "TOML", for the error's line.
        error: makes the error from `cannot be read: REASON` or `not KIND: byte N is not UTF-8`.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except OSError as refused:
        raise error(f"cannot be read: {reason(refused).lower()}") from None
    except UnicodeDecodeError as wrong:
        raise error(f"not {kind}: byte {wrong.start} is not UTF-8") from None
