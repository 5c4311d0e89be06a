"""A disk that is full, as far as this process can tell."""

from __future__ import annotations

import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def small_disk(size: int) -> Iterator[None]:
    """No file grows past `size` bytes: the system answers as a full disk does.

    Python keeps no compiled modules meanwhile: it takes a short write for a whole one, and whatever was imported here
    for the first time would be broken for every process after this one.
    """
    kept = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    compiled, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, kept[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, kept)
        sys.dont_write_bytecode = compiled
        signal.signal(signal.SIGXFSZ, handler)
