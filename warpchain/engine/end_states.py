"""End states of variants: rollers on teeth, and causes of divergence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.stack_assembly import Assemblies
from warpchain.engine.arrays import Engine
from warpchain.engine.packed_ensemble import roller_coordinates
from warpchain.kernels.native import STATE_ROWS
from warpchain.model import ChainModel
from warpchain.model.stacks import Stack, stacks_of_drives

ON_TOP = 0.5
"""Height above tips, in radii, of rollers off the teeth."""

TORN = 2.0
"""Length of a torn chain's link over its own."""


def engaged_fractions(
    engine: Engine, models: Sequence[ChainModel], stacks: Sequence[Stack[ChainModel]] | None = None
) -> NDArray[np.float64]:
    """Engaged rollers (V, S) on sprockets over assembled ones, or NaN.

    Engaged: within half a pitch inside the pitch circle, `ON_TOP` outside the tips.
    """
    packed = engine.packed
    counts = packed.drives["sprockets"].astype(np.int64)
    sorted_ = stacks_of_drives(models) if stacks is None else stacks
    inner, outer, held = _tooth_reach(sorted_, packed.assemblies, (len(models), int(counts.max())))
    centers, rows = engine.bodies()["center"], engine.rollers()
    found = np.full(held.shape, np.nan)
    for alike, first, count in packed.groups_by_rollers():
        x, y = roller_coordinates(rows, first, count)
        for s in range(int(counts[alike].max())):
            body = np.where(counts[alike] > s, packed.drives["first_body"][alike] + s, 0)
            center = centers[body][:, :, None]
            with np.errstate(all="ignore"):  # what diverged may be anywhere
                square = (x - center[:, 0]) ** 2 + (y - center[:, 1]) ** 2
            on = (square > inner[alike, s, None] ** 2) & (square < outer[alike, s, None] ** 2)
            found[alike, s] = on.sum(axis=1)
    return found / held


def divergence_causes(engine: Engine, models: Sequence[ChainModel], diverged: NDArray[np.bool_]) -> list[str]:
    """Causes (V,) of divergence (`results.judgement.DIVERGENCE_CAUSES`), "" for none."""
    packed, causes = engine.packed, [""] * len(models)
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
        if not sound.all() or not (span < TORN * models[v].chain.link_lengths).all():
            causes[v] = "settling" if steps[v] == 0 and models[v].run.settle else "torn"
        elif not _is_inside(row, place):
            causes[v] = "left"
        else:
            causes[v] = "torn" if _is_inside(row, mine["center"]) else "center"
    return causes


def _is_inside(row: Any, places: NDArray[np.float64]) -> bool:
    """Whether all places (N, 2) are in a variant's box."""
    return bool(((places > row["low"]) & (places < row["high"])).all())


def _tooth_reach(
    stacks: Sequence[Stack[ChainModel]], assemblies: Assemblies, shape: tuple[int, int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Least and largest radius (V, S) [m] of engaged rollers, and number as assembled."""
    inner, outer, held = (np.full(shape, np.nan) for _ in range(3))
    for part, assembly in assemblies.parts_of_stacks(stacks):
        model, v = part.one, part.members
        for s in range(len(model.sprockets)):
            inner[v, s] = assembly.path.radius[:, s] - 0.5 * model.chain.pitch
            outer[v, s] = model.tip_radius(s) + ON_TOP * model.chain.roller_radius
            held[v, s] = (assembly.seat_sprocket == s).sum(axis=1)
    return inner, outer, held
