"""What variants are judged by that no sum over the window holds: their layouts, and where their chains end up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assemble_batch import Assemblies
from warpchain.assembly.layout_checks import findings, suspects
from warpchain.drive import Drive
from warpchain.drive.batch import Stack, picked, stacks_of
from warpchain.engine.devices import Engine
from warpchain.engine.packed import Packed, taken
from warpchain.kernels.relaxation import LEAST_STRETCH
from warpchain.kernels.rows import STATE_ROWS

ON_TOP = 0.5
"""A roller has left the teeth where its center is this share of its radius beyond their tips; on top of one it is 1."""

TORN = 2.0
"""A chain with a link longer than this many times its length is none any more."""


def layouts_of(
    drives: Sequence[Drive], assemblies: Assemblies, stacks: Sequence[Stack] | None = None
) -> list[tuple[str, ...]]:
    """What is wrong with each drive's layout; drives that share their state and guide-bars are looked at once.

    Args:
        drives: the drives.
        assemblies: their initial states.
        stacks: the drives sorted into kinds, where they are.
    """
    found: list[tuple[str, ...]] = [()] * len(drives)
    known: dict[tuple[int, ...], tuple[str, ...]] = {}
    for stack in stacks_of(drives) if stacks is None else stacks:
        for places, assembly in assemblies.among(stack.members):
            members = stack.members[places]
            for v in members[suspects(picked(stack.drive, places), assembly.path)].tolist():
                key = (int(assemblies.block[v]), int(assemblies.row[v]), *map(id, drives[v].guides))
                if key not in known:
                    known[key] = findings(drives[v], assemblies[v].path)
                found[v] = known[key]
    return found


def layout_line(layouts: Sequence[Sequence[str]]) -> str | None:
    """What to tell of the layouts in one line, None where nothing is wrong."""
    wrong = [v for v, found in enumerate(layouts) if found]
    if not wrong:
        return None
    first = "; ".join(layouts[wrong[0]])
    if len(layouts) == 1:
        return first
    more = f", and of {len(wrong) - 1} further variants alike" if len(wrong) > 1 else ""
    return f"variant {wrong[0]}{more}: {first}"


def net_force(packed: Packed, residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest net force that settling left on a roller [N] (V,), from its residuals (`kernels.relaxation`).

    Args:
        packed: the settled ensemble in float64.
        residual: (V,) over the largest link force, or if that is larger a roller's weight, or the least that counts.
    """
    largest = np.zeros(packed.variants)
    for alike, first, count in packed.alike():
        x, y = _places(packed.rollers, first, count)
        span = np.hypot(np.roll(x, -1, axis=1) - x, np.roll(y, -1, axis=1) - y)
        span -= taken(packed.lengths, first, count)
        largest[alike] = packed.chains["stiffness"][alike] * np.abs(span).max(axis=1)
    weight = packed.chains["mass"] * np.hypot(*packed.chains["gravity"].T)
    least = float(LEAST_STRETCH) * packed.chains["stiffness"]
    return residual * np.maximum(np.maximum(largest, weight), least)


def _places(
    rows: NDArray[np.floating], first: NDArray[np.int64], count: int
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """x and y (K, N) of the rollers of K variants with `count` each, which begin at `first` (K,)."""
    both = taken(rows, STATE_ROWS * first, 2 * count)
    return both[:, :count], both[:, count:]


def engaged(engine: Engine, drives: Sequence[Drive], stacks: Sequence[Stack] | None = None) -> NDArray[np.float64]:
    """Share of the rollers of each sprocket's wrap that are on its teeth now (V, S), NaN beyond a drive's sprockets.

    On its teeth is a roller whose center is nearer than half a pitch to the pitch circle inward, and less than
    `ON_TOP` of its radius beyond the tips outward. A share is taken over the rollers that the assembled wrap held and
    may exceed 1, as a strand's first rollers are near the teeth, too.
    """
    packed = engine.packed
    counts = packed.drives["sprockets"].astype(np.int64)
    sorted_ = stacks_of(drives) if stacks is None else stacks
    inner, outer, held = _reach(sorted_, packed.assemblies, (len(drives), int(counts.max())))
    centers, rows = engine.bodies()["center"], engine.rollers()
    found = np.full(held.shape, np.nan)
    for alike, first, count in packed.alike():
        x, y = _places(rows, first, count)
        for s in range(int(counts[alike].max())):
            body = np.where(counts[alike] > s, packed.drives["first_body"][alike] + s, 0)
            center = centers[body][:, :, None]
            with np.errstate(all="ignore"):  # what diverged may be anywhere
                square = (x - center[:, 0]) ** 2 + (y - center[:, 1]) ** 2
            on = (square > inner[alike, s, None] ** 2) & (square < outer[alike, s, None] ** 2)
            found[alike, s] = on.sum(axis=1)
    return found / held


def causes_of(engine: Engine, drives: Sequence[Drive], diverged: NDArray[np.bool_]) -> list[str]:
    """Why each variant diverged (V,): a key of `results.judgement.CAUSES`, "" where it did not.

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
        for places, assembly in assemblies.among(stack.members):
            drive, v = picked(stack.drive, places), stack.members[places]
            for s in range(len(drive.sprockets)):
                inner[v, s] = assembly.path.radius[:, s] - 0.5 * drive.chain.pitch
                outer[v, s] = drive.tip_radius(s) + ON_TOP * drive.chain.roller_radius
                held[v, s] = (assembly.seat_sprocket == s).sum(axis=1)
    return inner, outer, held
