"""Waits for what other threads and processes do."""

import contextlib
import time


def wait_for(condition, limit=60.0):
    """Returns as soon as `condition()` holds; fails where it does not within `limit` seconds."""
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, f"not within {limit:g} s"
        time.sleep(0.005)


def bytes_in(folder):
    """Bytes of the files of a folder, some of which may be given other names meanwhile."""
    total = 0
    for file in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):
            total += file.stat().st_size
    return total
