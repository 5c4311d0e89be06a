"""Set-up help: where a sprocket must stand, or how many links a chain must have, for a wanted strain, preload or sag.

A strand of n links hangs under gravity between two end rollers that are C' apart. If it sags by h at its middle it
carries T = mu g C'^2 / (8 h) there (mu = m / p, g the part of gravity across the strand), and its length, elastic under
T, is that of the parabola: n p (1 + T / (k p)) = C' (1 + 8 h^2 / (3 C'^2)). Between the seats that the assembly puts
them on, C apart, the end rollers give way by the clearance c in each seat, C' = C - 2 c. So the assembly's strain,
C / (n p) - 1, is to first order

    strain = mu g C^2 / (8 h k p) - 8 h^2 / (3 C^2) + 2 c / C.                                      (a)

It falls as h grows: every sag has one strain. Measured on settled strands, end rollers give way by 0.8 to 1.1 c.
A preload T0, at assembly, has the strain T0 / (k p).

Where arms carry guides the strain follows from what pushes them. The number of links is then the one that leaves the
least strain with the arms in balance, or with which an arm stands nearest to a wanted angle; and a sprocket can be
moved until an arm stands there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly, assemble, assembled_strain
from warpchain.assembly.path import MAX_STRAIN, ChainPath, path_at
from warpchain.assembly.route import chain_path
from warpchain.errors import DriveError

if TYPE_CHECKING:
    from warpchain.drive import Drive

_PLACES = 4000  # most places tried along the line
_ENOUGH = 1e-10  # strain that the secant method may miss
_DIGITS = 10  # centers are rounded to 1e-10 m, which files can show
_UPRIGHT = 1e-6  # part of gravity across a strand below which it cannot sag
_ANGLE = 0.01  # strain that a radian of an arm counts as, in what a search may miss
_EXACT = 1e-7  # strain that a solution may miss; more is a jump where a roller changes seats


@dataclass(frozen=True)
class _Goal:
    """What is wanted: the strain that it takes, and what a strain amounts to, at a strand's chord.

    Or with `arm` an angle of it [rad]. `sags` where the chord counts.
    """

    text: str
    unit: str
    strain: Callable[[Drive, NDArray[np.float64]], float]
    amount: Callable[[Drive, NDArray[np.float64], float], float]
    strand: int
    arm: int | None = None
    angle: float = 0.0
    sags: bool = False


def fit_position(
    drive: Drive,
    sprocket: str,
    direction: Sequence[float],
    *,
    strain: float | None = None,
    preload: float | None = None,
    sag: float | None = None,
    strand: str | None = None,
    travel: float | None = None,
) -> Drive:
    """Moves a sprocket along a line, either way, to the nearest place that gives what is wanted; one of the three.

    Args:
        drive: its chain need not fit as it stands.
        sprocket: name of the sprocket to move.
        direction: of the line through its center, (2,), of any length.
        strain: of the strands at assembly [-], within 0.05; what `warpchain check` calls strain.
        preload: tension of all strands at assembly [N], >= 0.
        sag: of one strand at rest, from its chord to its middle [m], > 0; eq. (a).
        strand: which strand's sag, "FROM->TO"; None is the longest, as the drive stands, that lies on no guide.
        travel: farthest that the sprocket moves either way [m]; None is wherever the chain could go round.

    Returns:
        The drive with the sprocket's center moved; rounded to 1e-10 m.

    Raises:
        DriveError: unknown names, values that are not allowed, or no such place: the message has the range that can be
            reached.
    """
    index = _sprocket_index(drive, sprocket)
    line = _unit(direction)
    return _moved(_Search(drive, index, line, _goal(drive, strain, preload, sag, strand), travel))


def fit_angle(
    drive: Drive, sprocket: str, direction: Sequence[float], angle: Mapping[str, float], travel: float | None = None
) -> Drive:
    """Moves a sprocket along a line, either way, to the nearest place at which an arm stands at an angle.

    Args:
        drive, sprocket, direction, travel: as of `fit_position`.
        angle: of one arm at assembly, by its name [degrees].

    Returns:
        The drive with the sprocket's center moved; rounded to 1e-10 m.

    Raises:
        DriveError: as `fit_position`; an angle beyond the arm's stops.
    """
    index, line = _sprocket_index(drive, sprocket), _unit(direction)
    return _moved(_Search(drive, index, line, _angle_goal(drive, angle), travel))


def _moved(search: _Search) -> Drive:
    for place in search.roots():
        exact = search.refined(place)
        if exact is not None:
            center = [round(float(x), _DIGITS) for x in search.center(exact)]
            return search.drive.with_values({f"sprockets.{search.index}.center": center})
    raise DriveError(search.failure())


def fit_links(drive: Drive, odd: bool = False, angle: Mapping[str, float] | None = None) -> Drive:
    """Gives the chain the number of links whose strain is smallest, taut or slack, with the sprockets where they are.

    With arms, the smallest strain with the arms in balance; or where they stand nearest to wanted angles.

    Args:
        drive: its chain need not fit as it stands.
        odd: whether an odd number, which needs an offset link, will do.
        angle: wanted angles of arms by name [degrees]; None wants none.

    Raises:
        DriveError: no such number gives a strain within 0.05, or none assembles; an unknown arm.
    """
    wanted = _wanted_angles(drive, angle or {})
    path, found = path_at(drive, wanted), []
    for links in nearest_links(path, 0.0, odd):
        if abs(path.strain(links)) > MAX_STRAIN:
            continue
        try:
            assembly = assemble(_with_links(drive, links))
        except DriveError:
            continue
        off = [abs(assembly.arm_angle[a] - wanted[a]) for a, arm in enumerate(drive.arms) if arm.name in (angle or {})]
        found.append((float(sum(off)) if off else abs(assembly.strain), links))
        if not wanted:
            break
    if found:
        return drive.with_values({"chain.links": min(found)[1]})
    exact = path.wrapped_pitches + float(path.strand_length.sum()) / path.pitch
    around = range(max(3, math.floor(exact) - 1), math.ceil(exact) + 2)
    strains = ", ".join(f"{n}: {100.0 * path.strain(n):+.2f} %" for n in around if math.isfinite(path.strain(n)))
    kind = "" if odd else "even "
    raise DriveError(
        f"chain.links: no {kind}number of links fits the path, which is {exact:.3f} pitches long (strain by links: "
        f"{strains}); allowed is {-100.0 * MAX_STRAIN:g} % to {100.0 * MAX_STRAIN:+g} %"
    )


def drawn_path(drive: Drive) -> ChainPath:
    """The path of the chain with its arms as drawn, or on the stop that is nearest to that.

    Raises:
        DriveError: as `path_at`.
    """
    return path_at(drive, _wanted_angles(drive, {}))


def nearest_links(path: ChainPath, strain: float, odd: bool = False) -> list[int]:
    """Numbers of links, those of nominal strain nearest to the wanted one first.

    They are the two that enclose it, and all whose strain is within `MAX_STRAIN`; none where no chain goes round.

    Args:
        path: the chain's path.
        strain: the wanted one [-].
        odd: whether odd numbers, which need an offset link, will do.
    """
    step = 1 if odd else 2
    exact = path.wrapped_pitches + float(path.strand_length.sum()) / path.pitch / (1.0 + strain)
    below = math.floor(exact / step) * step
    counts = {below, below + step, *(links for links in path.fitting_links() if links % step == 0)}
    around = [links for links in counts if math.isfinite(path.strain(links))]
    return sorted(around, key=lambda links: (abs(path.strain(links) - strain), links))


def strand_sag(drive: Drive, assembly: Assembly, strand: int) -> float:
    """Sag of a strand at rest from its chord to its middle [m], the h of eq. (a); 0 where gravity does not act across.

    Args:
        drive: the drive.
        assembly: its assembly.
        strand: strand k leaves sprocket k.
    """
    return _sag(drive, _chord(assembly, strand), assembly.strain)


# ----------------------------------------------------------------------------------------------------------- what


def _sprocket_index(drive: Drive, name: str) -> int:
    names = [sprocket.name for sprocket in drive.sprockets]
    if name not in names:
        raise DriveError(f'sprocket "{name}": there is none of that name; allowed are {", ".join(names)}')
    return names.index(name)


def _unit(direction: Sequence[float]) -> NDArray[np.float64]:
    line = np.asarray(direction, dtype=float)
    if line.shape != (2,) or not np.isfinite(line).all() or not line.any():
        raise DriveError(f"direction {direction}: must be two finite numbers, not both 0")
    return line / np.hypot(*line)


def _wanted_angles(drive: Drive, wanted: Mapping[str, float]) -> list[float]:
    """Angles of all arms [rad]: those wanted by name [degrees], the others as drawn or on the nearest stop."""
    for name, angle in wanted.items():
        a = drive.arm_index(name)
        if a is None:
            known = ", ".join(arm.name for arm in drive.arms) or "none"
            raise DriveError(f'arm "{name}": there is none of that name; allowed are {known}')
        low, high = drive.arms[a].stops or (-360.0, 360.0)
        if not low <= angle <= high:
            raise DriveError(f"angle = {angle:g}: must be from {low:g} to {high:g} degrees, the stops of arms.{name}")
    angles = [math.radians(wanted.get(arm.name, 0.0)) for arm in drive.arms]
    return [min(max(angle, arm.stops_rad[0]), arm.stops_rad[1]) for angle, arm in zip(angles, drive.arms, strict=True)]


def _goal(drive: Drive, strain: float | None, preload: float | None, sag: float | None, strand: str | None) -> _Goal:
    given = [name for name, x in (("strain", strain), ("preload", preload), ("sag", sag)) if x is not None]
    if len(given) != 1:
        raise DriveError(f"one of strain, preload and sag must be given, not {' and '.join(given) or 'none'}")
    if strand is not None and sag is None:
        raise DriveError("strand: only together with sag")
    tension = drive.chain.mean_stiffness * drive.chain.pitch
    if strain is not None:
        if not abs(strain) <= MAX_STRAIN:
            raise DriveError(f"strain = {strain:g}: must be within {MAX_STRAIN:g}")
        return _Goal(f"strain {strain:g}", "", lambda _, chord: strain, lambda _, chord, reached: reached, 0)
    if preload is not None:
        if not 0.0 <= preload <= MAX_STRAIN * tension:
            raise DriveError(f"preload = {preload:g}: must be at least 0 and at most {MAX_STRAIN * tension:.4g} N")
        return _Goal(
            f"preload {preload:g} N",
            " N",
            lambda _, chord: preload / tension,
            lambda _, chord, reached: tension * reached,
            0,
        )
    assert sag is not None
    if not (math.isfinite(sag) and sag > 0.0):
        raise DriveError(f"sag = {sag:g}: must be a finite number above 0")
    names = drive.strand_names
    if strand is not None and strand not in names:
        raise DriveError(f'strand "{strand}": there is none of that name; allowed are {", ".join(names)}')
    path = chain_path(drive)
    straight = [string is None for string in path.strings]
    k = int(np.argmax(np.where(straight, path.strand_length, 0.0))) if strand is None else names.index(strand)
    if not straight[k]:
        raise DriveError(f'strand "{names[k]}": lies on a guide, so that it has no sag')
    if _across(drive, path.strand_end[k] - path.strand_start[k]) <= 0.0:
        raise DriveError(f'strand "{names[k]}": gravity does not act across it, so that it has no sag')
    text = f'sag {sag:g} m of strand "{names[k]}"'
    return _Goal(text, " m", lambda moved, chord: _sag_strain(moved, chord, sag), _sag, k, sags=True)


def _angle_goal(drive: Drive, angle: Mapping[str, float]) -> _Goal:
    if len(angle) != 1:
        raise DriveError("angle: one arm at a time")
    ((name, degrees),) = angle.items()
    angles, a = _wanted_angles(drive, angle), drive.arm_index(name)
    assert a is not None  # as `_wanted_angles` has checked
    text = f'{degrees:g} degrees of arm "{name}"'
    return _Goal(text, " degrees", lambda _, chord: 0.0, lambda _, chord, reached: reached, 0, a, angles[a])


def _across(drive: Drive, chord: NDArray[np.float64]) -> float:
    """Gravity across a chord [m/s^2]; 0 for a strand that hangs upright."""
    gravity = np.asarray(drive.run.gravity, dtype=float)
    part = abs(float(chord[0] * gravity[1] - chord[1] * gravity[0])) / float(np.hypot(*chord))
    return part if part > _UPRIGHT * float(np.hypot(*gravity)) else 0.0


def _coefficients(drive: Drive, chord: NDArray[np.float64]) -> tuple[float, float, float]:
    """A, B and D of eq. (a) as strain = A / h - B h^2 + D."""
    square = float(chord @ chord)
    weight = drive.chain.mass / drive.chain.pitch * _across(drive, chord)
    given_way = 2.0 * (drive.contact.sprocket.clearance or 0.0) / math.sqrt(square)
    return weight * square / (8.0 * drive.chain.mean_stiffness * drive.chain.pitch), 8.0 / (3.0 * square), given_way


def _sag_strain(drive: Drive, chord: NDArray[np.float64], sag: float) -> float:
    elastic, geometric, given_way = _coefficients(drive, chord)
    return elastic / sag - geometric * sag * sag + given_way


def _sag(drive: Drive, chord: NDArray[np.float64], strain: float) -> float:
    """The sag at a strain, eq. (a): the one positive root of B h^3 + (strain - D) h - A."""
    elastic, geometric, given_way = _coefficients(drive, chord)
    if elastic == 0.0:
        return 0.0
    roots = np.roots([geometric, 0.0, strain - given_way, -elastic])
    return float(roots[np.isreal(roots)].real.max())


def _chord(assembly: Assembly, strand: int) -> NDArray[np.float64]:
    first = int(assembly.strand_first[strand])
    last = (first + int(assembly.strand_links[strand])) % len(assembly.position)
    chord: NDArray[np.float64] = assembly.position[last] - assembly.position[first]
    return chord


# ---------------------------------------------------------------------------------------------------------- where


def _with_links(drive: Drive, links: int) -> Drive:
    return drive.model_copy(update={"chain": drive.chain.model_copy(update={"links": links})})


class _Search:
    """Looks for places along the line: first on the path of pitch circles, then on the assembly."""

    def __init__(
        self, drive: Drive, index: int, line: NDArray[np.float64], goal: _Goal, travel: float | None = None
    ) -> None:
        self.drive, self.index, self.line, self.goal = drive, index, line, goal
        self.origin = np.asarray(drive.sprockets[index].center, dtype=float)
        others = [s.center for i, s in enumerate(drive.sprockets) if i != index]
        nearest = min(math.dist(self.origin, center) for center in others)
        around = nearest + 0.5 * drive.chain.links * drive.chain.pitch  # beyond it no chain of that length goes round
        self.travel = travel
        self.reach = around if travel is None else travel
        self.step = max(0.25 * drive.chain.pitch, 2.0 * self.reach / _PLACES)
        self.amounts: list[tuple[float, float]] = []
        self.jumped = False  # over what is wanted, where rollers find other seats

    def center(self, place: float) -> NDArray[np.float64]:
        """The sprocket's center at a place [m]."""
        return self.origin + place * self.line

    def moved(self, place: float) -> Drive:
        """The drive with the sprocket at a place, unchecked."""
        center = self.center(place)
        sprockets = list(self.drive.sprockets)
        sprockets[self.index] = sprockets[self.index].model_copy(
            update={"center": (float(center[0]), float(center[1]))}
        )
        return self.drive.model_copy(update={"sprockets": tuple(sprockets)})

    def nominal(self, place: float) -> float:
        """Strain in excess of the wanted one on pitch circles and tangents; NaN where there is no path."""
        drive = self.moved(place)
        try:
            path = chain_path(drive)
        except DriveError:
            return math.nan
        if not math.isfinite(path.nominal_strain):
            return math.nan
        if self.goal.arm is not None:
            self.amounts.append((place, math.degrees(path.arm_angle[self.goal.arm])))
            return _ANGLE * (float(path.arm_angle[self.goal.arm]) - self.goal.angle)
        chord = self._tangent(path)
        if abs(path.nominal_strain) <= MAX_STRAIN:
            self.amounts.append((place, self.goal.amount(drive, chord, path.nominal_strain)))
        return path.nominal_strain - self.goal.strain(drive, chord)

    def assembled(self, place: float) -> float:
        """Strain in excess of the wanted one of the assembled drive; NaN where it does not assemble."""
        drive = self.moved(place)
        try:
            if not self.goal.sags:  # where rollers stand does not matter
                path, strain = assembled_strain(drive)
                if self.goal.arm is not None:
                    return _ANGLE * (float(path.arm_angle[self.goal.arm]) - self.goal.angle)
                return strain - self.goal.strain(drive, self._tangent(path))
            assembly = assemble(drive)
        except DriveError:
            return math.nan
        return assembly.strain - self.goal.strain(drive, _chord(assembly, self.goal.strand))

    def roots(self) -> Iterator[float]:
        """Places where the path has the wanted strain, the nearest first: sought from the middle outwards."""
        ends = dict.fromkeys((-1.0, 1.0), (0.0, self.nominal(0.0)))
        for ring in range(math.ceil(self.reach / self.step)):
            found = []
            for side, (inner, before) in ends.items():
                outer = side * min((ring + 1) * self.step, self.reach)
                after = self.nominal(outer)
                if before * after <= 0.0:
                    found.append(_root(self.nominal, inner, outer, 1e-4 * self.step))
                ends[side] = outer, after
            yield from sorted((place for place in found if math.isfinite(place)), key=abs)

    def refined(self, place: float) -> float | None:
        """The place nearby where the assembly has the wanted strain; None where there is none."""
        exact = self._secant(place)
        half = self.step / 32.0
        while exact is None and half <= 2.0 * self.drive.chain.pitch:
            low, high = place - half, place + half
            if self.assembled(low) * self.assembled(high) <= 0.0:
                exact = _root(self.assembled, low, high)
                if not abs(self.assembled(exact)) <= _EXACT:
                    self.jumped = True
                    return None
            half *= 2.0
        return exact if exact is not None and abs(exact) <= self.reach else None

    def _secant(self, place: float) -> float | None:
        """The place nearby by the secant method; None where it does not come to one, as at a jump."""
        first, step = place, 1e-5 * self.drive.chain.pitch
        before = self.assembled(place)
        for _ in range(12):
            if abs(before) <= _ENOUGH:
                return place
            after = self.assembled(place + step)
            if not math.isfinite(after - before) or after == before:
                return None
            place, step, before = place + step, -after * step / (after - before), after
            if abs(place + step - first) > 2.0 * self.drive.chain.pitch:
                return None
        return None

    def failure(self) -> str:
        """The message when nothing was found: what can be reached, and where."""
        name, direction = self.drive.sprockets[self.index].name, [round(float(x), 6) for x in self.line]
        within = "" if self.travel is None else f" within {self.travel:g} m"
        text = f'sprocket "{name}": no place along {direction}{within} gives {self.goal.text}'
        if not self.amounts:
            links, size = self.drive.chain.links, 100.0 * MAX_STRAIN
            return f"{text}; nowhere on the line does a chain of {links} links fit within {size:g} % strain"
        places, values = zip(*sorted(self.amounts), strict=True)
        unit, jump = self.goal.unit, ", but jumps over that" if self.jumped else ""
        return (
            f"{text}; it can have {min(values):.4g} to {max(values):.4g}{unit}, moved by {places[0]:+.4g} to "
            f"{places[-1]:+.4g} m{jump}"
        )

    def _tangent(self, path: ChainPath) -> NDArray[np.float64]:
        chord: NDArray[np.float64] = path.strand_end[self.goal.strand] - path.strand_start[self.goal.strand]
        return chord


def _root(function: Callable[[float], float], low: float, high: float, enough: float = 1e-15) -> float:
    """A place in (low, high) where the function changes sign, to `enough`; NaN where it has no value in between."""
    from scipy.optimize import brentq

    try:
        return float(brentq(function, low, high, xtol=enough))
    except ValueError:
        return math.nan
