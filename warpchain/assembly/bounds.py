"""Bounds of a run from a drive and its initial state: how far rollers can go, and the scale of its tensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly
from warpchain.assembly.path import MAX_STRAIN
from warpchain.drive.body_ties import nearest_sprocket
from warpchain.drive.sprocket import ElasticMount, Load, SliderMount
from warpchain.drive.stack_math import power
from warpchain.model import ChainModel
from warpchain.model.trains import body_speed_ratio, free_body_loads

ESCAPE_PITCHES = 10.0
"""A roller has left the drive (the variant diverged) beyond this many pitches outside its box, or `escape` if more."""

SHARE = 0.1
"""Scale of the bins over the working tension."""

LEAST = 1e-6
"""Least working tension, over what stretches a link by its own length."""


def escape_distance(model: ChainModel, assembly: Assembly) -> NDArray[np.float64]:
    """The farthest that a roller can go from its place with its chain still on its sprockets [m]; of a stack (V,).

    A strand of chord C whose links are longer by s in all lies within the ellipse about its ends whose axis is C + s:
    at most sqrt(s (2 C + s)) / 2 off its chord, and less beyond its ends. Here s is the slack of all strands at
    assembly with the stretch of their links at `MAX_STRAIN`.
    """
    chord = assembly.path.strand_end - assembly.path.strand_start
    chords = np.hypot(chord[..., 0], chord[..., 1])
    spare = chords.sum(axis=-1) * ((1.0 + MAX_STRAIN) / (1.0 + np.minimum(assembly.strain, 0.0)) - 1.0)
    off = 0.5 * np.sqrt(spare * (2.0 * chords.max(axis=-1) + spare))
    return np.maximum(ESCAPE_PITCHES * model.chain.pitch, off)


def _largest_load_moment(load: Load, speed: float) -> float:
    """Largest moment of a load up to an angular speed, harmonics aside [N m]."""
    table = 0.0 if load.table is None else load.table.factor * float(np.abs(load.table.torque).max())
    return abs(load.torque) + abs(table) + load.viscous * speed + load.quadratic * speed * speed


def _tension_with_loads(model: ChainModel, tension: Any, speed: Any) -> Any:
    """`tension` with the pulls of loads and mounts' preloads at a speed of the chain [N]."""
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
    """A tenth of the sum of the pulls of loads, preloads and the chain's speed [N], positive.

    Loads and preloads of mounts are taken to act on the same strand, so that it is rather too large than too small.

    Args:
        model: one, or a stack, and
        assembly: its states, (V, ...) of a stack.
    """
    chain, speed = model.chain, model.chain_speed
    assembled = np.maximum(0.0, chain.stiffness * assembly.path.pitch * assembly.strain)
    tension = assembled + chain.mass / chain.pitch * power(speed, 2)
    return SHARE * np.maximum(_tension_with_loads(model, tension, speed), LEAST * chain.stiffness * chain.pitch)
