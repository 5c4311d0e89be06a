"""Outcomes of variants: the window's sums, batch by batch too, where chains lie at the end, and why variants diverged.

Kernels hand sums back for all variants, and note some of them at the ends of batches (`kernels.statistics`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.stack_assembly import Assemblies
from warpchain.drive import Drive
from warpchain.drive.stacks import Stack, pick_variants, stacks_of_drives
from warpchain.engine.arrays import KINDS, TABLE, Engine, starts
from warpchain.engine.packed import Packed, coordinates, spread
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.statistics import BATCHES, BINS, STEP, ZERO
from warpchain.results.metric_formulas import LazyFields

Rows = Mapping[str, NDArray[Any]]

PARTS = 20
"""Of a window, as many batches each: by few that are long a drift is told, by many the standard errors."""

ON_TOP = 0.5
"""A roller has left the teeth where its center is this share of its radius beyond their tips; on top of one it is 1."""


TORN = 2.0
"""A chain with a link longer than this many times its length is none any more."""


def tension_edges(scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """(V, bins + 1) edges of the bins of tension for V scales (`kernels.statistics`) [N]."""
    return scale[:, None] * np.sinh(STEP * (np.arange(int(BINS) + 1) - int(ZERO)))


def split_sums(sums: dict[str, Any], packed: Packed, variants: NDArray[np.integer]) -> dict[str, Any]:
    """The sums of V variants that have S sprockets, G guides, A arms and T tensioners each.

    Returns:
        "chain" (V,), "strand", "sprocket", "mount" and "slip" (V, S), "contact" (V, S + G), "arm"
        (V, A), "tensioner" (V, T), a row a variant;
        "batches" and "parts", those of which notes were taken batch by batch or part by part along a last axis, and
        how long each is (V, batches) or (V, parts) [s]; "tension", how many link tensions were seen in each bin of
        each strand and of no strand (V, S + 1, bins), and the bins' edges (V, bins + 1) [N].
    """
    drives, first = packed.drives[variants], starts(packed.drives)
    found = {}
    for name, row in TABLE["sums"].items():
        begin, count = first[row.kind][variants], int(KINDS[row.kind].count(drives)[0])
        values = sums[name] if row.width == 1 else sums[name].reshape(-1, row.width)
        found[name] = values[begin] if row.kind == "variant" else _rows_from(values, begin, count)
    _add_late_work(found, packed, drives[0])
    batches, parts = _batched(found, drives, int(BATCHES)), _batched(found, drives, PARTS)
    tension = found["tension_counts"], tension_edges(drives["tension_scale"])
    return found | {"batches": batches, "parts": parts, "tension": tension}


def _rows_from(values: NDArray[Any], begin: NDArray[np.integer], count: int) -> NDArray[Any]:
    """(V, count, ...) rows of each variant, the first of them at `begin`; a view where no others lie between."""
    if (np.diff(begin) == count).all():
        return values[begin[0] : begin[0] + len(begin) * count].reshape(len(begin), count, *values.shape[1:])
    return values[spread(begin, count)]


def _add_late_work(found: dict[str, Any], packed: Packed, drive: Any) -> None:
    """Takes from what contacts have taken what bodies had of it (`kernels.physics.body.late_power`).

    Of an arm all goes to the first guide, else sprocket, that it carries; `drive` is one of the variants', all alike.
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


def _batched(
    found: Mapping[str, Any], drives: NDArray[Any], batches: int
) -> tuple[dict[str, Rows], NDArray[np.float64]]:
    """Sums over each of so many batches of the window, by name and field, and their lengths (V, batches) [s]."""
    kept = slice(int(BATCHES) // batches - 1, None, int(BATCHES) // batches)  # the notes that end one
    noted = [name for name in found if f"{name}_notes" in found]
    sums = {name: batch_sums(found[f"{name}_notes"][..., kept], found[name]) for name in noted}
    return sums, batch_durations(drives, batches)


def note_steps(
    start: NDArray[Any] | int, end: NDArray[Any] | int, look_every: NDArray[Any] | int, batches: int = int(BATCHES)
) -> NDArray[np.int64]:
    """(..., batches - 1) steps at which batches of a window end, if it is long enough (`kernels.statistics`)."""
    first, last, every = (np.asarray(step, dtype=np.int64)[..., None] for step in (start, end, look_every))
    reached = first - (first - last) * np.arange(1, batches) // batches  # rounded up
    return np.asarray(-(-reached // every) * every)


def has_batches(window: NDArray[Any] | int, look_every: NDArray[Any] | int, batches: int = PARTS) -> Any:
    """(...) whether a window of so many steps has a look for each batch, at the least."""
    return window >= batches * look_every


def batch_durations(drives: NDArray[Any], batches: int = int(BATCHES)) -> NDArray[np.float64]:
    """(V, batches) time that each batch stands for [s], nan where the window is too short for so many.

    Args:
        drives: (V,) `kernels.structs.Drive`.
    """
    start, noted, end = _edges(drives, batches)
    half = 0.5  # the first and the last step of a window stand for half a step
    steps = np.diff(np.concatenate([start + half, noted, end + half], axis=1), axis=1)
    steps[~has_batches((end - start)[:, 0], drives["look_every"].astype(np.int64), batches)] = np.nan
    return steps * drives["step"][:, None]


def _edges(drives: NDArray[Any], batches: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Steps at which windows begin (V, 1), batches but the last end (V, batches - 1) and windows end (V, 1)."""
    start, end, every = (drives[name].astype(np.int64) for name in ("window_start", "window_end", "look_every"))
    return start[:, None], note_steps(start, end, every, batches), end[:, None]


def batch_sums(notes: NDArray[Any], totals: NDArray[Any]) -> Rows:
    """The sums over each batch, by field.

    Args:
        notes: (..., notes), a struct of sums as they were at the batches' ends.
        totals: (...) the sums at the window's end.
    """

    def batches(name: str) -> NDArray[Any]:
        noted, total = np.moveaxis(notes[name], totals.ndim, 0), totals[name]
        found = np.empty((*totals.shape, len(noted) + 1, *total.shape[totals.ndim :]), dtype=total.dtype)
        each = np.moveaxis(found, totals.ndim, 0)
        each[0], each[-1] = noted[0], total - noted[-1]
        np.subtract(noted[1:], noted[:-1], out=each[1:-1])
        return found

    return LazyFields(batches)


def engaged(engine: Engine, drives: Sequence[Drive], stacks: Sequence[Stack] | None = None) -> NDArray[np.float64]:
    """Share of the rollers of each sprocket's wrap that are on its teeth now (V, S), NaN beyond a drive's sprockets.

    On its teeth is a roller whose center is nearer than half a pitch to the pitch circle inward, and less than
    `ON_TOP` of its radius beyond the tips outward. A share is taken over the rollers that the assembled wrap held and
    may exceed 1, as a strand's first rollers are near the teeth, too.
    """
    packed = engine.packed
    counts = packed.drives["sprockets"].astype(np.int64)
    sorted_ = stacks_of_drives(drives) if stacks is None else stacks
    inner, outer, held = _reach(sorted_, packed.assemblies, (len(drives), int(counts.max())))
    centers, rows = engine.bodies()["center"], engine.rollers()
    found = np.full(held.shape, np.nan)
    for alike, first, count in packed.alike():
        x, y = coordinates(rows, first, count)
        for s in range(int(counts[alike].max())):
            body = np.where(counts[alike] > s, packed.drives["first_body"][alike] + s, 0)
            center = centers[body][:, :, None]
            with np.errstate(all="ignore"):  # what diverged may be anywhere
                square = (x - center[:, 0]) ** 2 + (y - center[:, 1]) ** 2
            on = (square > inner[alike, s, None] ** 2) & (square < outer[alike, s, None] ** 2)
            found[alike, s] = on.sum(axis=1)
    return found / held


def causes_of(engine: Engine, drives: Sequence[Drive], diverged: NDArray[np.bool_]) -> list[str]:
    """Why each variant diverged (V,): a key of `results.judgement.DIVERGENCE_CAUSES`, "" where it did not.

    Told by where its rollers and bodies are, if they are anywhere, and whether links are as long as they should be.
    """
    packed, causes = engine.packed, [""] * len(drives)
    if not diverged.any():
        return causes
    bodies, rows, steps = engine.bodies(), engine.rollers(), engine.progress()["step"]
    for v in np.flatnonzero(diverged).tolist():
        row, first = packed.drives[v], STATE_ROWS * int(packed.drives["first_roller"][v])
        count = int(row["rollers"])
        place = rows[first : first + 2 * count].reshape(2, count).T.astype(float)
        mine = bodies[int(row["first_body"]) :][: int(row["bodies"])]
        with np.errstate(all="ignore"):
            span = np.hypot(*(np.roll(place, -1, axis=0) - place).T)
        sound = np.isfinite(mine["angle"] + mine["speed"] + mine["center"].sum(axis=1) + mine["velocity"].sum(axis=1))
        if not sound.all() or not (span < TORN * drives[v].chain.link_lengths).all():
            causes[v] = "settling" if steps[v] == 0 and drives[v].run.settle else "torn"
        elif not _inside(row, place):
            causes[v] = "left"
        else:
            causes[v] = "torn" if _inside(row, mine["center"]) else "center"
    return causes


def _inside(row: Any, places: NDArray[np.float64]) -> bool:
    """Whether all places (N, 2) are in a drive's box."""
    return bool(((places > row["low"]) & (places < row["high"])).all())


def _reach(
    stacks: Sequence[Stack], assemblies: Assemblies, shape: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Between which distances from its center a roller is on a sprocket's teeth [m], and how many were at assembly.

    (V, S) each, NaN beyond a drive's sprockets.
    """
    inner, outer, held = (np.full(shape, np.nan) for _ in range(3))
    for stack in stacks:
        for places, assembly in assemblies.states_by_block(stack.members):
            drive, v = pick_variants(stack.drive, places), stack.members[places]
            for s in range(len(drive.sprockets)):
                inner[v, s] = assembly.path.radius[:, s] - 0.5 * drive.chain.pitch
                outer[v, s] = drive.tip_radius(s) + ON_TOP * drive.chain.roller_radius
                held[v, s] = (assembly.seat_sprocket == s).sum(axis=1)
    return inner, outer, held
