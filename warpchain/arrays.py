"""A packed ensemble as Warp arrays on a device."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from warpchain.ensemble import Packed
from warpchain.kernels import structs, sum_structs


def upload_ensemble(packed: Packed, device: str) -> Any:
    """What does not change during a run (`kernels.structs.types(...).Ensemble`), copied to `device`."""
    kinds = structs.types(packed.real)
    ensemble = kinds.Ensemble()
    for name, values, dtype in (
        ("drives", packed.drives, structs.Drive),
        ("chains", packed.chains, kinds.Chain),
        ("lengths", packed.lengths, packed.real),
        ("sprockets", packed.sprockets, kinds.Sprocket),
        ("motions", packed.motions, structs.Motion),
        ("mounts", packed.mounts, structs.Mount),
        ("guides", packed.guides, kinds.Guide),
        ("harmonics", packed.harmonics, structs.vec3d),
        ("tables", packed.tables, wp.float64),
        ("seats", packed.seats, structs.vec2d),
    ):
        setattr(ensemble, name, wp.array(values, dtype=dtype, device=device, copy=True))
    return ensemble


def upload_state(packed: Packed, device: str, keeps: bool = False) -> Any:
    """The initial state (`kernels.structs.types(...).State`), copied to `device`.

    `keeps` is for block kernels whose threads keep in global memory what they add up.
    """
    kinds = structs.types(packed.real)
    state = kinds.State()
    kept = len(packed.lengths) if keeps else 1
    state.recent = wp.zeros(kept, dtype=kinds.Recent, device=device)
    state.extra = wp.zeros(kept, dtype=kinds.Extra, device=device)
    state.contact_sums = wp.zeros(kept, dtype=sum_structs.ContactSums, device=device)
    for name, values, dtype in (
        ("rollers", packed.rollers, packed.real),
        ("sprockets", packed.bodies, structs.SprocketState),
        ("strands", packed.strands, structs.Strand),
        ("seat", packed.seat, wp.int32),
    ):
        setattr(state, name, wp.array(values, dtype=dtype, device=device, copy=True))
    state.impact_speed = wp.zeros(len(packed.seat), dtype=packed.real, device=device)
    partners = len(packed.sprockets) + len(packed.guides)
    state.totals = wp.zeros(partners, dtype=sum_structs.Totals, device=device)
    state.centers = wp.zeros(len(packed.sprockets), dtype=structs.CenterStages, device=device)
    state.progress = wp.zeros(packed.variants, dtype=structs.Progress, device=device)
    return state


SUMS = ("chain", "strand", "sprocket", "mount", "contact")
"""The fields of `kernels.sum_structs.Sums`."""


def empty_sums(packed: Packed, device: str) -> sum_structs.Sums:
    """Sums to which nothing has been added: minima at +infinity, maxima at -infinity."""
    sums = sum_structs.Sums()
    for name, struct, count in (
        ("chain", sum_structs.ChainSums, packed.variants),
        ("strand", sum_structs.StrandSums, len(packed.sprockets)),
        ("sprocket", sum_structs.SprocketSums, len(packed.sprockets)),
        ("mount", sum_structs.MountSums, len(packed.sprockets)),
        ("contact", sum_structs.ContactSums, len(packed.sprockets) + len(packed.guides)),
    ):
        values = np.zeros(count, dtype=struct.numpy_dtype())
        for field in values.dtype.names or ():
            if field.endswith("_min"):
                values[field] = np.inf
            elif field.endswith("_max") and field != "force_max":
                values[field] = -np.inf
        setattr(sums, name, wp.array(values, dtype=struct, device=device))
    return sums


def empty_tallies(packed: Packed, device: str) -> sum_structs.Tallies:
    """Tallies to which nothing has been added, for the block kernels."""
    links, wheels = packed.drives["rollers"].astype(np.int64), packed.drives["sprockets"].astype(np.int64)
    tallies = sum_structs.Tallies()
    tallies.link = wp.zeros(int((links * (wheels + 1)).sum()), dtype=sum_structs.LinkTally, device=device)
    tallies.contact = wp.zeros(len(packed.seat), dtype=sum_structs.ContactSums, device=device)
    tallies.roller = wp.zeros(int(links.sum()), dtype=sum_structs.RollerTally, device=device)
    return tallies
