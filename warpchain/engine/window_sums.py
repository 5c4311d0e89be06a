"""Sums of the window by variant, whole and batch by batch, from engines' arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.engine.arrays import ARRAYS, first_places
from warpchain.engine.packed_ensemble import PackedEnsemble, consecutive_places
from warpchain.kernels.statistics import BATCHES, BINS, STEP, ZERO
from warpchain.results.metric_formulas import BatchSums, LazyFields, VariantSums

LONG_BATCHES = 20
"""Parts of a window, each several batches, for drifts."""


def tension_edges(scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges (V, bins + 1) [N] of the histogram of tension."""
    return scale[:, None] * np.sinh(STEP * (np.arange(int(BINS) + 1) - int(ZERO)))


def split_sums(sums: Mapping[str, Any], packed: PackedEnsemble, variants: NDArray[np.integer]) -> VariantSums:
    """Sums of the window of V rows of an engine's, with as many of each part."""
    drives, places = packed.drives[variants], first_places(packed.drives)
    found: dict[str, NDArray[Any]] = {}
    for name, row in ARRAYS["sums"].items():
        first, v = places[row.dimension], variants[0]
        begin, count = first[variants], int(first[v + 1] - first[v])
        values = sums[name] if row.width == 1 else sums[name].reshape(-1, row.width)
        found[name] = values[begin] if row.dimension == "variant" else _rows_by_variant(values, begin, count)
    _add_late_work(found, packed, drives[0])
    if drives[0]["points"] > 1:
        found["contact"] = _contacts_with_backs(found["contact"], int(drives[0]["sprockets"]))
    batches, long = (_batch_sums_by_name(found, drives, count) for count in (int(BATCHES), LONG_BATCHES))
    return VariantSums(found, batches, long, (found["tension_counts"], tension_edges(drives["tension_scale"])))


def _rows_by_variant(values: NDArray[Any], begin: NDArray[np.integer], count: int) -> NDArray[Any]:
    """Rows (V, count, ...) of each variant's sums from `begin`."""
    if (np.diff(begin) == count).all():
        return values[begin[0] : begin[0] + len(begin) * count].reshape(len(begin), count, *values.shape[1:])
    return values[consecutive_places(begin, count)]


def _add_late_work(found: dict[str, Any], packed: PackedEnsemble, drive: Any) -> None:
    """Subtracts bodies' late work (`physics.body.late_contact_power`) from contacts' dissipation.

    An arm's goes to its first guide, else sprocket.
    """
    found["contact"] = found["contact"].copy()  # not the engine's own
    taken, sprockets = found["contact"]["dissipated"], int(drive["sprockets"])
    taken[:, :sprockets] -= found["sprocket"]["late_work"]
    guides = packed.guides["body"][drive["first_guide"] :][: drive["guides"]]
    hubs = packed.hubs["arm"][drive["first_sprocket"] :][:sprockets]
    for a in range(int(drive["arms"])):
        body = drive["bodies"] - drive["arms"] + a
        partners = [*(sprockets + np.flatnonzero(guides == body)), *np.flatnonzero(hubs == body)]
        taken[:, partners[0] if partners else 0] -= found["arm"]["late_work"][:, a]


def _contacts_with_backs(contact: NDArray[Any], sprockets: int) -> NDArray[Any]:
    """Contact sums (V, S + G) of a silent chain's partners from those with rows of backs (V, S + 2 G)."""
    guides = (contact.shape[1] - sprockets) // 2
    found = np.delete(contact, np.s_[sprockets : sprockets + guides], axis=1)
    backs, pins = contact[:, sprockets : sprockets + guides], found[:, sprockets:]
    for name in contact.dtype.names or ():
        join = np.maximum if name == "force_max" else np.add
        pins[name] = join(pins[name], backs[name])
    return found


def _batch_sums_by_name(found: Mapping[str, NDArray[Any]], drives: NDArray[Any], batches: int) -> BatchSums:
    """Sums over so many batches of the window."""
    kept = slice(int(BATCHES) // batches - 1, None, int(BATCHES) // batches)  # the notes that end one
    noted = [name for name in found if f"{name}_notes" in found]
    sums = {name: batch_sums(found[f"{name}_notes"][..., kept], found[name]) for name in noted}
    return BatchSums(sums, batch_durations(drives, batches))


def note_steps(
    start: NDArray[Any] | int, end: NDArray[Any] | int, sample_interval: NDArray[Any] | int, batches: int = int(BATCHES)
) -> NDArray[np.int64]:
    """Steps (..., batches - 1) where window batches end."""
    first, last, every = (np.asarray(step, dtype=np.int64)[..., None] for step in (start, end, sample_interval))
    reached = first - (first - last) * np.arange(1, batches) // batches  # rounded up
    return np.asarray(-(-reached // every) * every)


def has_batches(window: NDArray[Any] | int, sample_interval: NDArray[Any] | int, batches: int = LONG_BATCHES) -> Any:
    """Whether windows (...) have a sample a batch."""
    return window >= batches * sample_interval


def batch_durations(drives: NDArray[Any], batches: int = int(BATCHES)) -> NDArray[np.float64]:
    """Durations (V, batches) [s] of window batches, or nan."""
    start, end, every = (drives[name].astype(np.int64) for name in ("window_start", "window_end", "sample_interval"))
    half = 0.5  # the first and the last step of a window stand for half a step
    edges = [start[:, None] + half, note_steps(start, end, every, batches), end[:, None] + half]
    steps = np.diff(np.concatenate(edges, axis=1), axis=1)
    steps[~has_batches(end - start, every, batches)] = np.nan
    return steps * drives["step"][:, None]


def batch_sums(notes: NDArray[Any], totals: NDArray[Any]) -> Mapping[str, NDArray[Any]]:
    """Sums over each batch, by field.

    `notes` (..., notes) are at the batches' ends, `totals` (...) at the window's.
    """

    def batches(name: str) -> NDArray[Any]:
        """Sums (..., batches) of a field over each batch."""
        noted, total = np.moveaxis(notes[name], totals.ndim, 0), totals[name]
        found = np.empty((*totals.shape, len(noted) + 1, *total.shape[totals.ndim :]), dtype=total.dtype)
        each = np.moveaxis(found, totals.ndim, 0)
        each[0], each[-1] = noted[0], total - noted[-1]
        np.subtract(noted[1:], noted[:-1], out=each[1:-1])
        return found

    return LazyFields(batches)
