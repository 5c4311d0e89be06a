"""The window's sums batch by batch, from what the kernels noted of them (`kernels.batches`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.kernels.batches import BATCHES, NOTES
from warpchain.kernels.sums import WATCH_EVERY

Rows = Mapping[str, NDArray[Any]]


def note_steps(start: NDArray[Any] | int, end: NDArray[Any] | int, look_every: NDArray[Any] | int) -> NDArray[np.int64]:
    """(..., notes) steps at which a window's notes are taken, if it is long enough for batches (`kernels.batches`)."""
    first, last, every = (np.asarray(step, dtype=np.int64)[..., None] for step in (start, end, look_every))
    batches = int(BATCHES)
    reached = first - (first - last) * np.arange(1, batches) // batches  # rounded up
    return np.asarray(-(-reached // every) * every)


def has_batches(window: NDArray[Any] | int, look_every: NDArray[Any] | int) -> Any:
    """(...) whether a window of so many steps has a look for each batch, at the least."""
    return window >= int(BATCHES) * look_every


def batch_durations(drives: NDArray[Any]) -> NDArray[np.float64]:
    """(V, batches) time that each batch stands for [s], nan where the window is too short for batches.

    Args:
        drives: (V,) `kernels.structs.Drive`.
    """
    start, noted, end = _edges(drives)
    half = 0.5  # the first and the last step of a window stand for half a step
    steps = np.diff(np.concatenate([start + half, noted, end + half], axis=1), axis=1)
    steps[~has_batches((end - start)[:, 0], drives["look_every"].astype(np.int64))] = np.nan
    return steps * drives["step"][:, None]


def _edges(drives: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Steps at which windows begin (V, 1), notes are taken (V, notes) and windows end (V, 1)."""
    start, end = drives["window_start"].astype(np.int64)[:, None], drives["window_end"].astype(np.int64)[:, None]
    return start, note_steps(*(drives[name] for name in ("window_start", "window_end", "look_every"))), end


def watched_in_batches(drives: NDArray[Any]) -> NDArray[np.float64]:
    """(V, batches) how long each batch is, over the time that its watched steps stand for."""
    every = int(WATCH_EVERY)
    start, noted, end = _edges(drives)
    before = -(-np.concatenate([noted, end + 1], axis=1) // every)  # multiples of `every` before the batch's end
    watched = np.diff(np.concatenate([start // every, before], axis=1), axis=1)
    return np.asarray(batch_durations(drives) / (every * np.maximum(watched, 1) * drives["step"][:, None]))


def batch_sums(notes: NDArray[Any], totals: NDArray[Any]) -> Rows:
    """What was added in each batch, by field.

    Args:
        notes: (..., notes), a struct of sums as they were at the batches' ends.
        totals: (...) the sums at the window's end.
    """
    found = {}
    for name in notes.dtype.names or ():
        if not name.endswith(("_min", "_max")):
            noted, total = notes[name], totals[name]
            axis = totals.ndim
            whole = np.concatenate([np.zeros_like(noted).take([0], axis), noted, np.expand_dims(total, axis)], axis)
            found[name] = np.diff(whole, axis=axis)
    return found


def split_batches(
    sums: Mapping[str, Any], variants: NDArray[np.integer], sprocket: NDArray[np.integer]
) -> dict[str, Rows]:
    """Batches of V variants with S sprockets each: "chain" (V, batches), "strand", "sprocket", "mount" (V, S, batches).

    Args:
        sums: of the whole ensemble, by name.
        variants: (V,) their numbers.
        sprocket: (V, S) the numbers of their sprockets.
    """
    places = {"chain": variants, "strand": sprocket, "sprocket": sprocket, "mount": sprocket}
    notes = {name: sums[f"{name}_notes"].reshape(-1, int(NOTES)) for name in places}
    return {name: batch_sums(notes[name][at], sums[name][at]) for name, at in places.items()}
