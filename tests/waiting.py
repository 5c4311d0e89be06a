"""Waits for what other threads and processes do."""

import time


def wait_for(condition, limit=60.0):
    """Returns as soon as `condition()` holds; fails where it does not within `limit` seconds."""
    end = time.monotonic() + limit
    while not condition():
        assert time.monotonic() < end, f"not within {limit:g} s"
        time.sleep(0.005)
