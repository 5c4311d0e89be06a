"""Keeps a drive assembled while its values vary: a sprocket's place on a line, or the number of links, for a strain.

The strain is that of the strands' links at assembly; a preload T is the strain T / (k p).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from warpchain.assembly import assemble
from warpchain.drive import Drive
from warpchain.drive_toml import value_text
from warpchain.errors import DriveError, StudyError
from warpchain.geometry import MAX_STRAIN, chain_path
from warpchain.study.factors import evaluate
from warpchain.study.spec_parts import Adjust

TRAVEL = 4.0
"""Farthest that a sprocket moves either way unless the study says, in pitches."""
_PLACES = 129
"""Places looked at along the whole travel, to find where the strain crosses the wanted one."""
_STRAIN_TOLERANCE = 1e-9
"""Strain within which a solved place must come."""


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
        DriveError: the drive cannot be assembled at any place.
    """
    strain = _wanted(drive, adjust, row)
    if adjust.links is None:
        return _moved(drive, adjust, strain)
    counts = nearest_links(drive, strain, 2 if adjust.links == "even" else 1)
    refused = None
    for count in counts if adjust.sprocket is not None else counts[:1]:
        try:
            fitted, done = _moved(drive.with_values({"chain.links": count}), adjust, strain)
        except StudyError as error:
            refused = refused or error
        else:
            return fitted, {"adjusted_links": count, **done}
    assert refused is not None  # there is a count
    raise refused


def _moved(drive: Drive, adjust: Adjust, strain: float) -> tuple[Drive, dict[str, Any]]:
    """The drive with its sprocket moved, if one is to be."""
    if adjust.sprocket is None:
        return drive, {}
    assert adjust.direction is not None  # the table's own rule
    travel = adjust.travel if adjust.travel is not None else TRAVEL * drive.chain.pitch
    drive, moved = solve_position(drive, adjust.sprocket, adjust.direction, strain, travel)
    return drive, {"adjusted_travel": moved}


def _wanted(drive: Drive, adjust: Adjust, row: Mapping[str, Any]) -> float:
    """The wanted strain."""
    key, asked = ("strain", adjust.strain) if adjust.strain is not None else ("preload", adjust.preload)
    try:
        value = evaluate(asked, row) if isinstance(asked, str) else asked
    except StudyError as error:
        raise StudyError(f"adjust.{key} = {value_text(asked)}: {error}") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise StudyError(f"adjust.{key} = {value_text(asked)}: {value} is not a finite number")
    strain = float(value) if key == "strain" else value / (drive.chain.stiffness * drive.chain.pitch)
    if abs(strain) > MAX_STRAIN or (key == "preload" and value < 0.0):
        raise StudyError(f"adjust.{key} = {value:g}: a strain of {strain:g}; allowed is within {MAX_STRAIN:g}")
    return strain


def nearest_links(drive: Drive, strain: float, step: int) -> list[int]:
    """The two numbers of links, multiples of `step`, whose nominal strains enclose the wanted one, the nearer first.

    Raises:
        DriveError: the chain's path cannot be drawn.
        StudyError: no number of links goes round.
    """
    path = chain_path(drive)
    straight = float(path.strand_length.sum()) / path.pitch
    exact = path.wrapped_pitches + straight / (1.0 + strain)
    below = math.floor(exact / step) * step
    fitting = [n for n in (below, below + step) if math.isfinite(path.strain(n))]
    if not fitting:
        raise StudyError("adjust.links: no number of links goes round")
    return sorted(fitting, key=lambda n: abs(path.strain(n) - strain))


def solve_position(
    drive: Drive, sprocket: str, direction: Sequence[float], wanted_strain: float, travel: float
) -> tuple[Drive, float]:
    """Moves a sprocket along a line to a place where the assembled chain has the wanted strain.

    The place is found from where the sprocket stands, by the secant method, else on a scan of the whole travel.

    Args:
        drive: its chain need not fit as it stands.
        sprocket: name of the sprocket.
        direction: of the line through its center (2,), of any length.
        wanted_strain: of the strands' links at assembly [-].
        travel: farthest that it moves either way [m].

    Returns:
        The drive with the sprocket moved, and how far along the direction [m].

    Raises:
        StudyError: no such place within the travel; the message has the strains that can be reached.
    """
    from scipy.optimize import brentq

    index = [s.name for s in drive.sprockets].index(sprocket)
    center, line = np.array(drive.sprockets[index].center), np.array(direction) / math.hypot(*direction)

    def moved(offset: float) -> Drive:
        x, y = (center + offset * line).tolist()
        wheel = drive.sprockets[index].model_copy(update={"center": (x, y)})
        return drive.model_copy(update={"sprockets": (*drive.sprockets[:index], wheel, *drive.sprockets[index + 1 :])})

    def nominal(offset: float) -> float:
        try:
            return chain_path(moved(offset)).nominal_strain - wanted_strain
        except DriveError:
            return math.inf

    def assembled(offset: float) -> float:
        return assemble(moved(offset)).strain - wanted_strain

    step = 1e-3 * drive.chain.pitch
    near = _secant(nominal, 0.0, step, 1e-6)
    if near is not None and abs(near) <= travel:
        place = _secant(assembled, near, 0.01 * step, 0.1 * _STRAIN_TOLERANCE)
        if place is not None and abs(place) <= travel:
            return moved(place), place
    places = np.linspace(-travel, travel, _PLACES)
    errors = np.array([nominal(place) for place in places])
    for low, high in _crossings(places, errors):
        place = _refined(assembled, brentq(nominal, low, high, xtol=1e-12), high - low)
        if place is not None:
            return moved(place), place
    reached = errors[np.isfinite(errors)] + wanted_strain
    span = f"strains from {reached.min():.4g} to {reached.max():.4g} are" if len(reached) else "no place is"
    raise StudyError(
        f'adjust.sprocket: no place of "{sprocket}" within {travel:g} m gives the strain {wanted_strain:.4g}; '
        f"{span} within reach"
    )


def _crossings(places: Any, errors: Any) -> list[tuple[float, float]]:
    """Neighboring places between which the error changes sign, the nearest to where the sprocket stands first."""
    finite = np.isfinite(errors[:-1]) & np.isfinite(errors[1:])
    crossed = np.flatnonzero(finite & (np.sign(errors[:-1]) * np.sign(errors[1:]) <= 0.0))
    spans = [(float(places[i]), float(places[i + 1])) for i in crossed]
    return sorted(spans, key=lambda span: min(abs(span[0]), abs(span[1])))


def _secant(error: Callable[[float], float], place: float, step: float, enough: float) -> float | None:
    """A place where the error is small enough, by the secant method; None where it does not come to one."""
    try:
        before, there = error(place), error(place + step)
        place += step
        for _ in range(12):
            if abs(there) <= enough:
                return place
            if not math.isfinite(there - before):
                break
            step *= -there / (there - before)
            before, place = there, place + step
            there = error(place)
    except (DriveError, ArithmeticError):
        pass
    return None


def _refined(error: Callable[[float], float], near: float, width: float) -> float | None:
    """The root of the assembled strain's error near that of the nominal strain; None where there is none.

    The two strains differ by what the chords of seated links cut off; the assembled one can jump where a roller changes
    seats, and a jump is no root.
    """
    from scipy.optimize import brentq

    reach = 1e-3 * width
    while reach <= width:
        try:
            place = float(brentq(error, near - reach, near + reach, xtol=1e-13))
            return place if abs(error(place)) <= _STRAIN_TOLERANCE else None
        except (DriveError, ValueError):  # ValueError: both ends on one side
            reach *= 4.0
    return None
