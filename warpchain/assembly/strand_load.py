"""Goods on a strand: the line on which they lie, and the part that pins carry."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import DriveError

if TYPE_CHECKING:
    from warpchain.assembly.path import ChainPath
    from warpchain.model import ChainModel

Array = NDArray[np.float64]


class LoadLine(NamedTuple):
    """Line on which goods lie; numbers () or (V,).

    Attributes:
        start: (..., 2) where they come on [m].
        direction: (..., 2).
        length: over which they lie [m].
        reach: distance within which pins carry them [m].
    """

    start: Array
    direction: Array
    length: Array
    reach: Array


def loaded_strand(model: ChainModel) -> int:
    """Index of the strand with the goods."""
    assert model.chain.load is not None
    return [sprocket.name for sprocket in model.sprockets].index(model.chain.load.between[0])


def load_line(model: ChainModel, path: ChainPath) -> LoadLine:
    """Line on which a chain's goods lie."""
    load, k = model.chain.load, loaded_strand(model)
    assert load is not None
    first, last = path.strand_start[..., k, :], path.strand_end[..., k, :]
    whole = np.hypot(*np.moveaxis(last - first, -1, 0))
    direction = (last - first) / whole[..., None]
    begin = np.zeros_like(whole) + load.begin
    end = whole if load.end is None else np.zeros_like(whole) + load.end
    ends = k, (k + 1) % len(model.sprockets)
    radii = [np.zeros_like(whole) + model.pitch_radius(s) for s in ends if not model.sprockets[s].is_end]
    reach = np.min(radii, axis=0) if radii else np.full_like(whole, np.inf)
    return LoadLine(first + begin[..., None] * direction, direction, end - begin, reach)


def carried_part(position: Array, line: LoadLine, pitch: float) -> Array:
    """Part (N,) of a pitch's goods that pins at `position` (N, 2) carry (`kernels.physics.strand_load`)."""
    away = position - line.start
    along, across = away @ line.direction, away[:, 0] * line.direction[1] - away[:, 1] * line.direction[0]
    part = np.clip(along / pitch + 0.5, 0.0, 1.0) - np.clip((along - line.length) / pitch + 0.5, 0.0, 1.0)
    return np.where(np.abs(across) < line.reach, part, 0.0)


def goods_on_pins(model: ChainModel, path: ChainPath, position: Array) -> Array:
    """Masses (N,) of the goods on pins at `position` (N, 2) [kg]."""
    load, pitch = model.chain.load, model.chain.pitch
    if load is None:
        return np.zeros(len(position))
    return load.load_per_length * pitch * carried_part(position, load_line(model, path), pitch)


def check_load_places(model: ChainModel, path: ChainPath) -> None:
    """Refuses goods that lie beyond their strand.

    Raises:
        DriveError: of the first such variant of a stack.
    """
    load = model.chain.load
    if load is None:
        return
    chord = (path.strand_end - path.strand_start)[:, loaded_strand(model)]
    longest = np.hypot(chord[:, 0], chord[:, 1])
    for key in ("begin", "end"):
        value = np.zeros_like(longest) + (0.0 if getattr(load, key) is None else getattr(load, key))
        beyond = np.flatnonzero(value > longest)
        if len(beyond):
            raise DriveError(
                f"chain.load.{key} = {value[beyond[0]]:g}: must be at most the length of the strand from "
                f"{load.between[0]} to {load.between[1]}, {longest[beyond[0]]:.4g} m"
            )
