"""Keeps a drive assembled while its values vary: a sprocket's place on a line, or the number of links, for a strain.

The strain is that of the strands' links at assembly; a preload T is the strain T / (k p).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from warpchain.assembly.fit import drawn_paths, fit_positions, nearest_links
from warpchain.assembly.path import MAX_STRAIN
from warpchain.drive import Drive
from warpchain.drive.changes import with_numbers
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, StudyError, WarpchainError
from warpchain.study.design.values import evaluate
from warpchain.study.spec.parts import Adjust

TRAVEL = 4.0
"""Farthest that a sprocket moves either way unless the study says, in pitches."""


Adjusted = tuple[Drive, dict[str, Any]]
"""A drive made to fit, and what was adjusted: "adjusted_links", "adjusted_travel" [m], as far as asked for."""


def adjusted(drive: Drive, adjust: Adjust, row: Mapping[str, Any]) -> Adjusted:
    """A drive made to fit.

    Args:
        drive: with the row's factors in it.
        adjust: what may move, and what is wanted.
        row: values of the factors, for expressions.

    Raises:
        StudyError: no number of links or no place does it, or the wanted strain has no value.
        DriveError: the chain's path cannot be drawn.
    """
    (found,) = adjusted_all([drive], adjust, [row])
    if isinstance(found, WarpchainError):
        raise found
    return found


def adjusted_all(
    drives: Sequence[Drive], adjust: Adjust, rows: Sequence[Mapping[str, Any]]
) -> list[Adjusted | WarpchainError]:
    """Drives of as many rows made to fit, as by `adjusted`; where one is refused, why.

    Args:
        drives: with the rows' factors in them.
        adjust: what may move, and what is wanted.
        rows: values of the factors, for expressions.
    """
    found: dict[int, Adjusted | WarpchainError] = {}
    strains: dict[int, float] = {}
    for v, (drive, row) in enumerate(zip(drives, rows, strict=True)):
        try:
            strains[v] = _wanted(drive, adjust, row)
        except StudyError as error:
            found[v] = error
    counts = _counts(drives, adjust, strains, found)
    for turn in range(2):
        trying: dict[int, Drive] = {}
        for v in [v for v in counts if turn < len(counts[v]) and not isinstance(found.get(v), tuple)]:
            try:
                trying[v] = _with_links(drives[v], counts[v][turn])
            except DriveError as error:
                found[v] = error
        moved = _moved(list(trying.values()), adjust, [strains[v] for v in trying])
        for v, outcome in zip(trying, moved, strict=True):
            if isinstance(outcome, StudyError):
                found.setdefault(v, outcome)
            else:
                links = counts[v][turn]
                found[v] = outcome[0], outcome[1] if links is None else {"adjusted_links": links, **outcome[1]}
    return [found[v] for v in range(len(drives))]


def _with_links(drive: Drive, links: int | None) -> Drive:
    """The drive with a number of links; None is its own."""
    return drive if links is None else with_numbers(drive, {("chain", "links"): links})


def _counts(
    drives: Sequence[Drive],
    adjust: Adjust,
    strains: Mapping[int, float],
    refused: dict[int, Any],
) -> dict[int, list[int | None]]:
    """The numbers of links to try, by row; None is the drive's own. Rows without any are refused."""
    if adjust.links is None:
        return {v: [None] for v in strains}
    found: dict[int, list[int | None]] = {}
    for v, path in zip(strains, drawn_paths([drives[v] for v in strains]), strict=True):
        if isinstance(path, DriveError):
            refused[v] = path
        elif counts := nearest_links(path, strains[v], odd=adjust.links == "any"):
            found[v] = [*counts[: 1 if adjust.sprocket is None else 2]]
        else:
            refused[v] = StudyError("adjust.links: no number of links goes round")
    return found


def _moved(drives: Sequence[Drive], adjust: Adjust, strains: Sequence[float]) -> list[Adjusted | StudyError]:
    """The drives with their sprockets moved, if one is to be."""
    if adjust.sprocket is None:
        return [(drive, {}) for drive in drives]
    assert adjust.direction is not None  # the table's own rule
    travels = [TRAVEL * drive.chain.pitch if adjust.travel is None else adjust.travel for drive in drives]
    found: list[Adjusted | StudyError] = []
    fitted = fit_positions(drives, adjust.sprocket, adjust.direction, strains, travels)
    for drive, moved in zip(drives, fitted, strict=True):
        if isinstance(moved, DriveError):
            found.append(StudyError(f"adjust: {moved}"))
            continue
        index = [sprocket.name for sprocket in drive.sprockets].index(adjust.sprocket)
        way = [there - here for here, there in zip(*(d.sprockets[index].center for d in (drive, moved)), strict=True)]
        along = sum(x * d for x, d in zip(way, adjust.direction, strict=True)) / math.hypot(*adjust.direction)
        found.append((moved, {"adjusted_travel": along}))
    return found


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
