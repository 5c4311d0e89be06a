"""A packed ensemble as Warp arrays on a device."""

from __future__ import annotations

from typing import Any

import warp as wp

from warpchain.ensemble import Packed
from warpchain.kernels import structs


def upload_ensemble(packed: Packed, device: str) -> Any:
    """What does not change during a run (`kernels.structs.types(...).Ensemble`), copied to `device`."""
    kinds = structs.types(packed.real)
    ensemble = kinds.Ensemble()
    for name, values, dtype in (
        ("drives", packed.drives, structs.Drive),
        ("chains", packed.chains, kinds.Chain),
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


def upload_state(packed: Packed, device: str) -> Any:
    """The initial state (`kernels.structs.types(...).State`), copied to `device`."""
    state = structs.types(packed.real).State()
    for name, values, dtype in (
        ("rollers", packed.rollers, packed.real),
        ("sprockets", packed.bodies, structs.SprocketState),
        ("strands", packed.strands, structs.Strand),
        ("seat", packed.seat, wp.int32),
    ):
        setattr(state, name, wp.array(values, dtype=dtype, device=device, copy=True))
    state.impact_speed = wp.zeros(len(packed.seat), dtype=packed.real, device=device)
    partners = len(packed.sprockets) + len(packed.guides)
    state.totals = wp.zeros(partners, dtype=structs.Totals, device=device)
    state.centers = wp.zeros(len(packed.sprockets), dtype=structs.CenterStages, device=device)
    state.progress = wp.zeros(packed.variants, dtype=structs.Progress, device=device)
    return state
