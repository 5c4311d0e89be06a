"""Bounds of a run from its initial state: how far rollers can go, and tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly
from warpchain.assembly.path import MAX_STRAIN
from warpchain.drive.body_ties import nearest_sprocket
from warpchain.drive.sprocket import ElasticMount, Load, SliderMount
from warpchain.drive.stack_math import Number, power
from warpchain.model import ChainModel
from warpchain.model.trains import body_speed_ratio, free_body_loads

ESCAPE_PITCHES = 10.0
"""Least distance of an escaped roller outside the drive's box, in pitches."""

SHARE = 0.1
"""Bin width of tension counts over the working tension."""

LEAST = 1e-6
"""Least working tension over the force that doubles a link's length."""


def escape_distance(model: ChainModel, assembly: Assembly) -> NDArray[np.float64]:
    """Farthest that a roller on its drive goes from its place, () or (V,) [m]."""
    if model.chain.is_open:
        return np.broadcast_to(2.0 * model.chain.links * model.chain.pitch, np.shape(assembly.strain))
    chord = assembly.path.strand_end - assembly.path.strand_start
    chords = np.hypot(chord[..., 0], chord[..., 1])
    # a strand of chord C, longer by s, lies within the ellipse about its ends of axis C + s (docs/solving.md)
    spare = chords.sum(axis=-1) * ((1.0 + MAX_STRAIN) / (1.0 + np.minimum(assembly.strain, 0.0)) - 1.0)
    off = 0.5 * np.sqrt(spare * (2.0 * chords.max(axis=-1) + spare))
    return np.maximum(ESCAPE_PITCHES * model.chain.pitch, off)


def _largest_load_moment(load: Load, speed: float) -> float:
    """Largest moment of a load up to a speed, harmonics aside [N m]."""
    table = 0.0 if load.table is None else load.table.factor * float(np.abs(load.table.torque).max())
    return abs(load.torque) + abs(table) + load.viscous * speed + load.quadratic * speed * speed


def _tension_with_loads(model: ChainModel, tension: Number, speed: Number) -> Number:
    """Chain tension with the pulls of loads and mounts' preloads [N]."""
    for s, sprocket in enumerate(model.sprockets):
        radius = model.pitch_radius(s)
        if sprocket.load is not None:
            tension = tension + _largest_load_moment(sprocket.load, speed / radius) / radius
        for b, load in free_body_loads(model) if model.shafts else ():
            if b >= len(model.sprockets) and nearest_sprocket(model, b) == s:
                beside = body_speed_ratio(model, b, s)
                tension = tension + beside * _largest_load_moment(load, beside * speed / radius) / radius
        if isinstance(sprocket.mount, ElasticMount | SliderMount):
            preload = sprocket.mount.preload
            tension = tension + np.hypot(*(preload if isinstance(preload, tuple) else (preload, preload)))
    return tension


def tension_scale(model: ChainModel, assembly: Assembly) -> NDArray[np.float64]:
    """Scale of a chain's tensions, a tenth of the pulls of loads, preloads and speed, () or (V,) [N]."""
    chain, speed = model.chain, model.chain_speed
    assembled = np.maximum(0.0, chain.stiffness * assembly.path.pitch * assembly.strain)
    tension = assembled + chain.mass / chain.pitch * power(speed, 2)
    return SHARE * np.maximum(_tension_with_loads(model, tension, speed), LEAST * chain.stiffness * chain.pitch)
