"""Files written whole or not at all, by one writer at a time, and text read.

A file is written under a temporary name in its own folder, flushed, and then given its name. A writer locks
`.NAME.lock` and the temporary file, until the process ends; file systems without flock do without.
"""

from __future__ import annotations

import contextlib
import datetime
import errno
import hashlib
import json
import os
import re
import secrets
import socket
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
except ImportError:  # a system without flock
    fcntl = None  # type: ignore[assignment]

WRITER_PATIENCE = 10.0
"""Time that writers of small files wait for one another [s]."""
MOST_BYTES = 64 << 20
"""Most bytes of a text or drawing that is read."""
LONGEST_NAME = 255
"""Most bytes of a file's name."""


class WriteLock:
    """Lock on writing a file's name, until `release` or the end of the process.

    `patience` is how long to wait for another writer [s].

    Raises:
        OSError: another one writes it, or a folder that refuses.
    """

    def __init__(self, path: Path, patience: float = 0.0) -> None:
        name = f".{path.name}.lock"
        if len(os.fsencode(name)) > LONGEST_NAME:
            name = f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()}.lock"
        self.path = path.with_name(name)
        self._handle: int | None = None
        end = time.monotonic() + patience
        while self._handle is None:
            handle = _open_lock_file(self.path)
            try:
                if not _lock_open_file(handle):
                    if time.monotonic() >= end:
                        who = os.pread(handle, 200, 0).decode(errors="replace")
                        raise OSError(errno.EBUSY, who or "another process is writing it")
                    time.sleep(0.01)
                elif _has_name(handle, self.path):
                    self._handle = handle
                    with contextlib.suppress(OSError):
                        os.ftruncate(handle, 0)
                        os.pwrite(handle, _writer_text().encode(), 0)
            finally:
                if self._handle != handle:
                    os.close(handle)

    def release(self) -> None:
        """Releases the lock on a file's name; raises nothing."""
        handle, self._handle = self._handle, None
        if handle is not None:
            try:
                os.unlink(self.path)
            except OSError:  # a file system that has become read-only
                pass
            finally:
                os.close(handle)


def _writer_text() -> str:
    """Text on the process that writes a file, for other writers."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return f"process {os.getpid()} on {socket.gethostname()} is writing it, since {now}"


def _open_lock_file(path: Path) -> int:
    """Opens a lock file, made if missing; returns its descriptor."""
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except PermissionError:
        if not path.exists():
            raise
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)


def _lock_open_file(handle: int) -> bool:
    """Locks an open file; returns False if another process holds it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _has_name(handle: int, path: Path) -> bool:
    """Whether an open file still has its name."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def is_being_written(path: Path) -> bool:
    """Whether a running process holds a temporary or lock file."""
    if fcntl is None:
        return True
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # held, or on a file system that cannot tell
        return True
    finally:
        os.close(handle)
    return False


def remove_leftovers(paths: Iterable[Path]) -> None:
    """Removes temporary files and locks that no process holds; raises nothing."""
    for path in paths:
        with contextlib.suppress(OSError):
            handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            try:
                if fcntl is not None:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    path.unlink()
            finally:
                os.close(handle)


def leftover_files(folder: Path) -> list[Path]:
    """Temporary files and locks below a folder, left or in use."""
    return [path for path in sorted(folder.rglob("*")) if LEFTOVER_PATTERN.fullmatch(path.name) and path.is_file()]


def target_of_path(path: Path) -> Path:
    """Regular file that writing to a path makes or replaces, by links too; raises OSError for others."""
    try:
        kind = path.lstat().st_mode
        if stat.S_ISLNK(kind):
            path = path.resolve(strict=True)
            kind = path.stat().st_mode
    except FileNotFoundError:
        if path.is_symlink():
            raise OSError(errno.ENOENT, "it is a symbolic link to nothing") from None
        return path
    _check_regular(kind)
    return path


def _check_regular(kind: int) -> None:
    """Raises OSError for the mode of no regular file."""
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(kind):
        raise OSError(errno.EINVAL, "it is a device or a pipe, not a file")


def open_regular_file(path: str | os.PathLike[str]) -> int:
    """Opens a regular file; returns its descriptor, raises OSError for others."""
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_NONBLOCK", 0))
    try:
        _check_regular(os.fstat(handle).st_mode)
    except OSError:
        os.close(handle)
        raise
    return handle


def temporary_name(path: Path, hidden: bool = True) -> Path:
    """Temporary name beside a path that no other writer has; see `PARTIAL_PATTERN`."""
    token = f"{os.getpid()}-{secrets.token_hex(8)}"
    return path.with_name(f".{path.name[:40]}.{token}.partial" if hidden else f"{path.name}.{token}.partial")


PARTIAL_PATTERN = r"\.\d+(-[0-9a-f]{16})?\.partial"
"""Regular expression of a visible temporary name's end."""
LEFTOVER_PATTERN = re.compile(rf"\..*\.lock|\..*\.partial|.*\.mcap{PARTIAL_PATTERN}")
"""Pattern of names of temporary files and locks."""


class WholeFile:
    """File written under a temporary name, which `finish` turns into its own and `drop` removes.

    Args:
        hidden: whether the temporary name begins with a dot.
        patience: how long to wait for another writer [s]; None if the caller holds the lock.

    Attributes:
        partial: the temporary name.
        stream: the open binary file.
        finished: whether it has its own name.

    Raises:
        FileExistsError: in `finish`, a file of its own name and no `overwrite`.
        OSError: here and in `finish`, another writer, or a folder or disk that refuses.
    """

    def __init__(self, path: Path, overwrite: bool = True, hidden: bool = True, patience: float | None = 0.0) -> None:
        self.path, self.overwrite, self.finished = target_of_path(path), overwrite, False
        self._lock = None if patience is None else WriteLock(self.path, patience)
        try:
            self.partial, self.stream = self._open_temporary(hidden)
        except BaseException:
            self._release_lock()
            raise

    def _open_temporary(self, hidden: bool) -> tuple[Path, IO[bytes]]:
        """Opens a temporary file, locked; returns its path and stream."""
        while True:
            partial = temporary_name(self.path, hidden)
            stream = partial.open("xb")
            if _lock_open_file(stream.fileno()) and _has_name(stream.fileno(), partial):
                return partial, stream
            stream.close()

    def _release_lock(self) -> None:
        """Releases the file's lock."""
        if self._lock is not None:
            self._lock.release()

    def finish(self) -> None:
        """Flushes the file to disk and gives it its name."""
        self.stream.flush()
        os.fsync(self.stream.fileno())
        if self.overwrite:
            os.replace(self.partial, self.path)
        else:
            _rename_unless_taken(self.partial, self.path)
        self.finished = True
        self.stream.close()
        _sync_folder(self.path.parent)
        self._release_lock()

    def drop(self, keep: bool = False) -> None:
        """Removes an unfinished file, or keeps it; raises nothing."""
        with contextlib.suppress(OSError):  # a full disk, which was said already
            self.stream.close()
        if not (keep or self.finished):
            with contextlib.suppress(OSError):
                self.partial.unlink()
        self._release_lock()


def _rename_unless_taken(partial: Path, path: Path) -> None:
    """Renames a file unless the new name is taken, at once if possible."""
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
    """Flushes a folder's entries to disk, where possible."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def whole_file(path: Path, overwrite: bool = True, patience: float = 0.0) -> Iterator[IO[bytes]]:
    """Context with a binary file to write, named at its end; see `WholeFile`."""
    file = WholeFile(path, overwrite, patience=patience)
    try:
        yield file.stream
        file.finish()
    finally:
        file.drop()


def write_text_file(path: Path, text: str, overwrite: bool = True) -> None:
    """Writes a text file (UTF-8) whole; errors as of `WholeFile`."""
    with whole_file(path, overwrite, WRITER_PATIENCE) as file:
        file.write(text.encode())


@contextlib.contextmanager
def refusals_as_errors(path: str | Path, error: type[Exception]) -> Iterator[None]:
    """Context that turns a system's refusal to write into an `error` of one line."""
    try:
        yield
    except OSError as refused:
        raise error(f"{path}: cannot be written ({refusal_reason(refused)})") from None
    except ValueError as refused:
        if "null byte" not in str(refused):
            raise
        raise error(f"{str(path)!r}: cannot be written (its name has a zero byte)") from None


def refusal_reason(error: Exception) -> str:
    """Reason, in a few words, why the system or a library refused."""
    return getattr(error, "strerror", None) or (str(error).splitlines() or [type(error).__name__])[0]


def read_regular_file(path: str | os.PathLike[str]) -> bytes:
    """Bytes of a regular file, `MOST_BYTES` at most; raises OSError for others."""
    with open(open_regular_file(path), "rb") as file:
        data = file.read(MOST_BYTES + 1)
    _check_byte_count(len(data))
    return data


def check_file_size(path: str | os.PathLike[str]) -> None:
    """Raises OSError for a file that `read_regular_file` refuses, without reading it."""
    with open(open_regular_file(path), "rb") as file:
        _check_byte_count(os.fstat(file.fileno()).st_size)


def _check_byte_count(length: int) -> None:
    """Raises OSError for a file of more than `MOST_BYTES`."""
    if length > MOST_BYTES:
        raise OSError(errno.EFBIG, f"it is larger than {MOST_BYTES} bytes")


def parse_json(text: str | bytes) -> Any:
    """Value of a JSON text; raises ValueError, also if nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_text_file(path: str | os.PathLike[str], kind: str, error: Callable[[str], Exception]) -> str:
    """Text of a regular UTF-8 file, line ends as they are.

    `kind` is what it should be, such as "TOML"; `error` makes the error from a line.
    """
    try:
        return read_regular_file(path).decode("utf-8-sig")
    except (OSError, ValueError) as refused:  # a name with a zero byte is a ValueError
        if isinstance(refused, UnicodeDecodeError):
            raise error(f"not {kind}: byte {refused.start} is not UTF-8") from None
        raise error(f"cannot be read: {refusal_reason(refused).lower()}") from None
