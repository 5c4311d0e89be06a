"""Rarer garbage collection while modules load and drives are made."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

RARE_THRESHOLD = 50_000
"""New objects that begin a garbage collection, in place of 700."""


@contextmanager
def rare_collections() -> Iterator[None]:
    """Context with rarer garbage collections."""
    usual = gc.get_threshold()
    if usual[0] == 0 or usual[0] >= RARE_THRESHOLD:  # the caller's wish, or of a call that this one is inside
        yield
        return
    gc.set_threshold(RARE_THRESHOLD, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)
