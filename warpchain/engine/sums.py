"""The sums that the kernels hand back, variant by variant."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine.batches import batch_durations, split_batches, watched_in_batches
from warpchain.engine.packed import Packed
from warpchain.kernels.sums import WATCH_EVERY
from warpchain.kernels.tension_bins import BINS, STEP, ZERO

WATCHED = ("speed", "speed_square", "force")
"""Sums of sprockets that are of watched steps."""


def tension_edges(scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """(V, bins + 1) edges of the bins of tension for V scales (`kernels.tension_bins`) [N]."""
    return scale[:, None] * np.sinh(STEP * (np.arange(int(BINS) + 1) - int(ZERO)))


def watched_time(drives: NDArray[Any]) -> NDArray[np.float64]:
    """(V,) how long a window is, over the time that its watched steps stand for (`kernels.sums.watch_weight`)."""
    every, start, end = int(WATCH_EVERY), drives["window_start"].astype(int), drives["window_end"].astype(int)
    watched = end // every - start // every + 1  # the multiples of `every`, and the window's first step
    return np.asarray((end - start) / (every * np.maximum(watched, 1)))


def split_sums(sums: dict[str, Any], packed: Packed, variants: NDArray[np.integer]) -> dict[str, Any]:
    """The sums of V variants that have S sprockets, G guides, A arms and T tensioners each.

    Returns:
        "chain" (V,), "strand", "sprocket", "mount" and "slip" (V, S), "contact" (V, S + G), "arm"
        (V, A), "tensioner" (V, T), a row a variant;
        "batches", the same fields but for contacts and slips batch by batch along a last axis, and how long each
        batch is (V, batches) [s]; "tension", how many link tensions were seen in each bin of each strand and of no
        strand (V, S + 1, bins), and the bins' edges (V, bins + 1) [N].
    """
    drives = packed.drives[variants]
    sprockets, guides = int(drives["sprockets"][0]), int(drives["guides"][0])
    first = drives["first_sprocket"][:, None].astype(np.int64)
    sprocket = first + np.arange(sprockets)
    arms, tensioners = int(drives["arms"][0]), int(drives["tensioners"][0])
    arm = drives["first_arm"][:, None].astype(np.int64) + np.arange(arms)
    tensioner = drives["first_tensioner"][:, None].astype(np.int64) + np.arange(tensioners)
    partner = first + drives["first_guide"][:, None] + np.arange(sprockets + guides)
    histograms = (first + variants[:, None]) + np.arange(sprockets + 1)
    watched = watched_time(drives)
    contact, turned = sums["contact"][partner], sums["sprocket"][sprocket]
    contact["impulse"] *= watched[:, None]
    batches = split_batches(sums, variants, sprocket)
    of_batches = watched_in_batches(drives)
    for name in WATCHED:
        of_all, of_each = turned[name], batches["sprocket"][name]
        of_all *= watched.reshape(-1, *[1] * (of_all.ndim - 1))
        of_each *= of_batches.reshape(len(drives), 1, -1, *[1] * (of_each.ndim - 3))
    counts = sums["tension_counts"].reshape(-1, int(BINS))[histograms]
    return {
        "chain": sums["chain"][variants],
        "strand": sums["strand"][sprocket],
        "sprocket": turned,
        "mount": sums["mount"][sprocket],
        "contact": contact,
        "slip": sums["slip"][sprocket],
        "arm": sums["arm"][arm],
        "tensioner": sums["tensioner"][tensioner],
        "batches": (batches, batch_durations(drives)),
        "tension": (counts, tension_edges(drives["tension_scale"])),
    }
