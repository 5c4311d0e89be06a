"""Bounds of a run, from a drive and its initial state: how far rollers may go, and what tension its chain has.

Both are rather too large than too small.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly
from warpchain.assembly.path import MAX_STRAIN
from warpchain.drive import Drive
from warpchain.drive.batch_math import power
from warpchain.drive.sprocket import ElasticMount, Load, SliderMount
from warpchain.drive.trains import loads_of, nearest_sprocket, speed_ratio

ESCAPE_PITCHES = 10.0
"""A roller has left the drive (the variant diverged) beyond this many pitches outside its box, or `escape` if more."""

SHARE = 0.1
"""Scale of the bins over the working tension."""

LEAST = 1e-6
"""Least working tension, over what stretches a link by its own length."""


def escape(drive: Drive, assembly: Assembly) -> NDArray[np.float64]:
    """The farthest that a roller may go from its place with its chain still on its sprockets [m]; of a stack (V,).

    A strand of chord C whose links are longer by s in all lies within the ellipse about its ends whose axis is C + s:
    at most sqrt(s (2 C + s)) / 2 off its chord, and less beyond its ends. Here s is what all strands are slack by at
    assembly, and what their links may be stretched by: `MAX_STRAIN`, as no drive is assembled with more. Long strands
    sag by their own weight that far, wherever they are slack or not.
    """
    chord = assembly.path.strand_end - assembly.path.strand_start
    chords = np.hypot(chord[..., 0], chord[..., 1])
    spare = chords.sum(axis=-1) * ((1.0 + MAX_STRAIN) / (1.0 + np.minimum(assembly.strain, 0.0)) - 1.0)
    off = 0.5 * np.sqrt(spare * (2.0 * chords.max(axis=-1) + spare))
    return np.maximum(ESCAPE_PITCHES * drive.chain.pitch, off)


def _moment(load: Load, speed: float) -> float:
    """Most that a load asks for at an angular velocity, harmonics aside [N m]."""
    table = 0.0 if load.table is None else load.table.factor * float(np.abs(load.table.torque).max())
    return abs(load.torque) + abs(table) + load.viscous * speed + load.quadratic * speed * speed


def tension_scale(drive: Drive, assembly: Assembly) -> NDArray[np.float64]:
    """A tenth of the sum of what loads, preloads and the chain's speed pull with [N], positive.

    Loads and preloads of mounts are taken to act on the same strand, so that it is rather too large than too small.

    Args:
        drive: one, or a stack, and
        assembly: its states, (V, ...) of a stack.
    """
    chain = drive.chain
    speed = drive.chain_speed
    stretched = np.maximum(0.0, chain.stiffness * assembly.path.pitch * assembly.strain)
    tension = stretched + chain.mass / chain.pitch * power(speed, 2)
    for s, sprocket in enumerate(drive.sprockets):
        radius = drive.pitch_radius(s)
        if sprocket.load is not None:
            tension = tension + _moment(sprocket.load, speed / radius) / radius
        for b, load in loads_of(drive) if drive.shafts else ():
            if b >= len(drive.sprockets) and nearest_sprocket(drive, b) == s:
                beside = speed_ratio(drive, b, s)
                tension = tension + beside * _moment(load, beside * speed / radius) / radius
        if isinstance(sprocket.mount, ElasticMount | SliderMount):
            preload = sprocket.mount.preload
            tension = tension + np.hypot(*(preload if isinstance(preload, tuple) else (preload, preload)))
    return SHARE * np.maximum(tension, LEAST * chain.stiffness * chain.pitch)
