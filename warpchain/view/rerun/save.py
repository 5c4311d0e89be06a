"""A Rerun recording as a file (.rrd), whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.files import refusals, whole_file

if TYPE_CHECKING:
    import rerun as rr


@contextmanager
def saved(stream: rr.RecordingStream, target: Path, error: type[Exception]) -> Iterator[None]:
    """Writes what is logged to a stream in a `with` block.

    Rerun's own writer tells nobody but the log that a disk is full; so the recording's bytes are written here.

    Raises:
        error: another writer, or a folder or disk that refuses, in one line.
    """
    import rerun as rr

    with refusals(target, error), whole_file(target) as file:
        sink = rr.binary_stream(stream)
        yield
        stream.flush()
        file.write(sink.read() or b"")
        stream.disconnect()
