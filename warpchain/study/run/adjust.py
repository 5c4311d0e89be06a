"""Keeps a drive assembled while its values vary: a sprocket's place on a line, or the number of links, for a strain.

The strain is that of the strands' links at assembly; a preload T is the strain T / (k p).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from warpchain.assembly.fit import drawn_path, fit_position, nearest_links
from warpchain.assembly.path import MAX_STRAIN
from warpchain.drive import Drive
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, StudyError
from warpchain.study.design.values import evaluate
from warpchain.study.spec.parts import Adjust

TRAVEL = 4.0
"""Farthest that a sprocket moves either way unless the study says, in pitches."""


def adjusted(drive: Drive, adjust: Adjust, row: Mapping[str, Any]) -> tuple[Drive, dict[str, Any]]:
    """A drive made to fit.

    Args:
        drive: with the row's factors in it.
        adjust: what may move, and what is wanted.
        row: values of the factors, for expressions.

    Returns:
        The drive, and what was adjusted: "adjusted_links", "adjusted_travel" [m], as far as asked for.

    Raises:
        StudyError: no number of links or no place does it, or the wanted strain has no value.
        DriveError: the chain's path cannot be drawn.
    """
    strain = _wanted(drive, adjust, row)
    if adjust.links is None:
        return _moved(drive, adjust, strain)
    counts = nearest_links(drawn_path(drive), strain, odd=adjust.links == "any")
    if not counts:
        raise StudyError("adjust.links: no number of links goes round")
    refused = None
    for count in counts[:2] if adjust.sprocket is not None else counts[:1]:
        try:
            fitted, done = _moved(drive.with_values({"chain.links": count}), adjust, strain)
        except StudyError as error:
            refused = refused or error
        else:
            return fitted, {"adjusted_links": count, **done}
    assert refused is not None
    raise refused


def _moved(drive: Drive, adjust: Adjust, strain: float) -> tuple[Drive, dict[str, Any]]:
    """The drive with its sprocket moved, if one is to be."""
    if adjust.sprocket is None:
        return drive, {}
    assert adjust.direction is not None  # the table's own rule
    travel = adjust.travel if adjust.travel is not None else TRAVEL * drive.chain.pitch
    try:
        moved = fit_position(drive, adjust.sprocket, adjust.direction, strain=strain, travel=travel)
    except DriveError as error:
        raise StudyError(f"adjust: {error}") from None
    index = [sprocket.name for sprocket in drive.sprockets].index(adjust.sprocket)
    way = [there - here for here, there in zip(*(d.sprockets[index].center for d in (drive, moved)), strict=True)]
    along = sum(x * d for x, d in zip(way, adjust.direction, strict=True)) / math.hypot(*adjust.direction)
    return moved, {"adjusted_travel": along}


def _wanted(drive: Drive, adjust: Adjust, row: Mapping[str, Any]) -> float:
    """The wanted strain."""
    key, asked = ("strain", adjust.strain) if adjust.strain is not None else ("preload", adjust.preload)
    try:
        value = evaluate(asked, row) if isinstance(asked, str) else asked
    except StudyError as error:
        raise StudyError(f"adjust.{key} = {value_text(asked)}: {error}") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise StudyError(f"adjust.{key} = {value_text(asked)}: {value} is not a finite number")
    strain = float(value) if key == "strain" else value / (drive.chain.mean_stiffness * drive.chain.pitch)
    if abs(strain) > MAX_STRAIN or (key == "preload" and value < 0.0):
        raise StudyError(f"adjust.{key} = {value:g}: a strain of {strain:g}; allowed is within {MAX_STRAIN:g}")
    return strain
