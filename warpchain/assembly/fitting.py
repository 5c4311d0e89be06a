"""Set-up help: a sprocket's place, or a link count, for a wanted strain, preload, sag, wrap or arm angle.

A strand of chord C that sags by h carries mu g C^2 / (8 h), mu = m / p, g the gravity across it. With the parabola's
length, and end rollers that give way by the clearance c, its strain at assembly is to first order

    strain = mu g C^2 / (8 h k p) - 8 h^2 / (3 C^2) + 2 c / C.                                      (a)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warpchain.argument_checks import FiniteNumber, check_arguments
from warpchain.assembly.arm_balance import chain_path, is_unloaded_arm, stop_name
from warpchain.assembly.assembly import Assembly, assemble_chain
from warpchain.assembly.path import MAX_STRAIN, ChainPath, PathPlan, allowed_results, path_at
from warpchain.assembly.place_search import PlacementGoal, PlaceSearch, run_searches
from warpchain.drive.catalogue import ELONGATION_AT_BREAKING_LOAD
from warpchain.drive.changed_copies import drive_with_numbers
from warpchain.drive.thermal import expansion_factor
from warpchain.errors import DriveError
from warpchain.model import Model
from warpchain.model.stacks import stacks_of_drives

if TYPE_CHECKING:
    from warpchain.drive import Drive
    from warpchain.model import ChainModel

_DIGITS = 10  # centers are rounded to 1e-10 m, which files can show
_ANGLE = 0.01  # strain that a radian of an arm counts as, in what a search may miss
_THERE = math.radians(0.1)  # off a wanted angle [rad] within which an arm on a stop stands there
_UPRIGHT = 1e-6  # part of gravity across a strand below which it cannot sag


@check_arguments(DriveError)
def fit_position(
    drive: Drive,
    sprocket: str,
    direction: Sequence[float],
    *,
    strain: float | None = None,
    preload: float | None = None,
    sag: float | None = None,
    strand: str | None = None,
    travel: FiniteNumber | None = None,
) -> Drive:
    """Moves a sprocket along a line to the nearest place with a wanted strain, preload or sag, one of the three.

    Args:
        drive: its chain need not fit as it stands.
        sprocket: name of the sprocket to move.
        direction: (2,) of the line, of any length.
        strain: of the strands at assembly [-], within 0.05.
        preload: tension of the strands at assembly [N], >= 0.
        sag: of one strand at rest at its middle [m], > 0; eq. (a).
        strand: whose sag, "FROM->TO"; None is the sprocket's chain's longest that lies on no guide.
        travel: farthest move either way [m]; None is wherever the chain could go round.

    Returns:
        The drive with the sprocket's center moved; rounded to 1e-10 m.

    Raises:
        DriveError: unknown names, values that are not allowed, or no such place, with the range within reach.
    """
    own, line = fitted_chain(drive, sprocket=sprocket), _unit_line(direction)
    goal = _strain_goal(own, strain, preload, sag, strand)
    return _only_result(
        _drives_at_places([drive], [PlaceSearch(own, _sprocket_index(own, sprocket), line, goal, travel)])
    )


def fit_positions(
    drives: Sequence[Drive],
    sprocket: str,
    direction: Sequence[float],
    strains: Sequence[float],
    travels: Sequence[float | None],
) -> list[Drive | DriveError]:
    """Moves one sprocket of each drive to a strain, as `fit_position`; gives a refused drive's DriveError.

    Raises:
        DriveError: a wrong name, direction or strain.
    """
    line, chains = _unit_line(direction), [fitted_chain(drive, sprocket=sprocket) for drive in drives]
    return _drives_at_places(
        drives,
        [
            PlaceSearch(own, _sprocket_index(own, sprocket), line, _strain_goal(own, strain, None, None, None), travel)
            for own, strain, travel in zip(chains, strains, travels, strict=True)
        ],
    )


@check_arguments(DriveError)
def fit_angle(
    drive: Drive,
    sprocket: str,
    direction: Sequence[float],
    angle: Mapping[str, float],
    travel: FiniteNumber | None = None,
) -> Drive:
    """Moves a sprocket along a line to the nearest place at which an arm stands at an angle.

    Args:
        drive, sprocket, direction, travel: as of `fit_position`.
        angle: of one arm at assembly, by its name [degrees].

    Returns:
        The drive moved, as `fit_position`.

    Raises:
        DriveError: as `fit_position`; an angle beyond the arm's stops.
    """
    own, line = fitted_chain(drive, sprocket=sprocket), _unit_line(direction)
    search = PlaceSearch(own, _sprocket_index(own, sprocket), line, _angle_goal(own, angle), travel)
    return _only_result(_drives_at_places([drive], [search]))


@check_arguments(DriveError)
def fit_wrap(
    drive: Drive,
    sprocket: str,
    direction: Sequence[float],
    wrap: float,
    around: str | None = None,
    travel: FiniteNumber | None = None,
) -> Drive:
    """Moves a sprocket along a line to the nearest place with a wanted wrap angle; links need not fit there.

    Args:
        drive, sprocket, direction, travel: as of `fit_position`.
        wrap: on pitch circles [degrees].
        around: name of the wrapped sprocket, of the same chain; None is the one that moves.

    Returns:
        The drive moved, as `fit_position`.

    Raises:
        DriveError: as `fit_position`; a wrap that is not above 0 and below 360.
    """
    own, line = fitted_chain(drive, sprocket=sprocket), _unit_line(direction)
    index = _sprocket_index(own, sprocket)
    goal = _wrap_goal(own, wrap, index if around is None else _sprocket_index(own, around))
    return _only_result(_drives_at_places([drive], [PlaceSearch(own, index, line, goal, travel)]))


def fitted_chain(drive: Drive, chain: str | None = None, sprocket: str | None = None) -> ChainModel:
    """Chain to fit, by its or a sprocket's name, or the only one.

    Raises:
        DriveError: an unknown name, or none where there are several chains.
    """
    chains = Model(drive).chains
    names = [model.name for model in chains if model.name]
    if chain is None and sprocket is not None and names:
        chain = drive.sprockets[_sprocket_index(drive, sprocket)].chain
    if chain is None and names:
        raise DriveError(f"chain: must be named, as there are several; allowed are {', '.join(names)}")
    if chain is not None and chain not in names:
        known = f"allowed are {', '.join(names)}" if names else "the drive has one, without a name"
        raise DriveError(f'chain "{chain}": no such name; {known}')
    return next(model for model in chains if model.name == (chain or ""))


def links_place(drive: Drive, model: ChainModel) -> tuple[str | int, ...]:
    """Key path of a chain's number of links in its drive."""
    if not model.name:
        return "chain", "links"
    return "chains", [chain.name for chain in drive.chains].index(model.name), "links"


def _drives_at_places(drives: Sequence[Drive], searches: Sequence[PlaceSearch]) -> list[Drive | DriveError]:
    """Drives with sprockets at the places found, or DriveErrors of searches in vain."""
    found: list[Drive | DriveError] = []
    for drive, search, place in zip(drives, searches, run_searches(searches), strict=True):
        if place is None:
            found.append(DriveError(search.failure()))
            continue
        x, y = (round(part / expansion_factor(drive, "block"), _DIGITS) for part in search.center(place))
        mine = search.model.sprockets[search.index]
        shaft = {of.name for of in drive.sprockets if of.shaft is not None and of.shaft == mine.shaft}
        together = [s for s, of in enumerate(drive.sprockets) if of.name in {mine.name, *shaft}]
        values: dict[tuple[str | int, ...], float] = {}
        for s in together:
            values |= {("sprockets", s, "center", 0): x, ("sprockets", s, "center", 1): y}
        found.append(drive_with_numbers(drive, values))
    return found


def _only_result(found: Sequence[Drive | DriveError]) -> Drive:
    """Drive of a single place search; raises its error."""
    (drive,) = found
    if isinstance(drive, DriveError):
        raise drive
    return drive


@check_arguments(DriveError)
def fit_links(
    drive: Drive, odd: bool = False, angle: Mapping[str, float] | None = None, chain: str | None = None
) -> Drive:
    """Gives a chain the number of links with the smallest strain, taut or slack, or with arms nearest to wanted angles.

    Arms are in balance, all pressing on the chain and off their stops if that can be.

    Args:
        drive: its chain need not fit as it stands.
        odd: whether an odd number will do, which needs an offset link.
        angle: wanted angles of arms by name [degrees].
        chain: its name, where there are several.

    Raises:
        DriveError: no such number gives a strain within 0.05, or assembles; a wanted arm on a stop or pressing on
            nothing; an unknown arm or chain.
    """
    model = fitted_chain(drive, chain)
    place = f"chains.{model.name}.links" if model.name else "chain.links"
    return drive.with_values({place: _best_links(model, odd, angle, place)})


def _best_links(model: ChainModel, odd: bool, angle: Mapping[str, float] | None, place: str) -> int:
    """Best number of links to fit a chain; rules and errors of `fit_links`."""
    wanted = _wanted_angles(model, angle or {})
    asked = [a for a, arm in enumerate(model.arms) if arm.name in (angle or {})]
    path, found = path_at(model, wanted), []
    for links in nearest_links(path, 0.0, odd):
        if abs(path.strain(links)) > MAX_STRAIN:
            continue
        try:
            assembly = assemble_chain(_model_with_links(model, links))
        except DriveError:
            continue
        off = [abs(assembly.arm_angle[a] - wanted[a]) for a in asked]
        idle = any(_is_idle_arm(model, assembly, a, wanted[a]) for a in asked or range(len(model.arms)))
        spoiled = idle or (not asked and abs(assembly.strain) > ELONGATION_AT_BREAKING_LOAD)
        found.append((spoiled, float(sum(off)) if off else abs(assembly.strain), links, assembly))
        if not wanted:
            break
    if found:
        spoiled, _, links, assembly = min(found, key=lambda one: one[:3])
        if spoiled and angle:
            raise DriveError(_missed_angles_text(model, angle, links, assembly, place))
        return links
    exact = path.wrapped_pitches + float(path.strand_length.sum()) / path.pitch
    around = range(max(3, math.floor(exact) - 1), math.ceil(exact) + 2)
    strains = ", ".join(f"{n}: {100.0 * path.strain(n):+.2f} %" for n in around if math.isfinite(path.strain(n)))
    kind = "" if odd else "even "
    raise DriveError(
        f"{place}: no {kind}number of links fits the path, which is {exact:.3f} pitches long (strain by links: "
        f"{strains}); allowed is {-100.0 * MAX_STRAIN:g} % to {100.0 * MAX_STRAIN:+g} %"
    )


def _is_idle_arm(model: ChainModel, assembly: Assembly, a: int, wanted: float) -> bool:
    """Whether an arm stands on a stop or at its free angle, but not as wanted."""
    angle = float(assembly.arm_angle[a])
    idle = stop_name(model, a, angle) is not None or is_unloaded_arm(model, a, angle)
    return idle and abs(angle - wanted) > _THERE


def _missed_angles_text(
    model: ChainModel, wanted: Mapping[str, float], links: int, assembly: Assembly, place: str
) -> str:
    """Error message that no number of links has the arms at wanted angles."""
    states = []
    for a in map(model.arm_index, wanted):
        assert a is not None  # as `_wanted_angles` has checked
        reached = float(assembly.arm_angle[a])
        stop = stop_name(model, a, reached)
        where = f"on its {stop} stop" if stop else "where it presses on nothing"
        states.append(f'"{model.arms[a].name}" stands at {math.degrees(reached):.4g}, {where}')
    asked = " and ".join(f'{angle:g} degrees of arm "{name}"' for name, angle in wanted.items())
    return (
        f"{place}: no number of links gives {asked}: with {links} {' and '.join(states)}; move a sprocket (--sprocket "
        "with --angle), or look at stops, springs and tensioners"
    )


def paths_as_drawn(models: Sequence[ChainModel]) -> list[ChainPath | DriveError]:
    """Paths of chains with arms as drawn or on the nearest stop, or their DriveErrors."""
    found: list[ChainPath | None] = [None] * len(models)
    for stack in stacks_of_drives(models):
        members = stack.members.tolist()
        for places, path in allowed_results(stack.one, len(members), _stack_paths_as_drawn):
            alike = len(path.radius) == 1  # of drives that do not differ there is one path
            for row, v in enumerate(places.tolist()):
                found[members[v]] = path[0 if alike else row]
    return [_path_or_error(model) if path is None else path for model, path in zip(models, found, strict=True)]


def _stack_paths_as_drawn(model: ChainModel) -> ChainPath:
    """Paths of a stack's chains with arms as drawn."""
    return PathPlan(model).path(_wanted_angles(model, {}))


def _path_or_error(model: ChainModel) -> ChainPath | DriveError:
    """Path of a chain with arms as drawn, or its DriveError."""
    try:
        return _stack_paths_as_drawn(model)[0]
    except DriveError as error:
        return error


def nearest_links(path: ChainPath, strain: float, odd: bool = False) -> list[int]:
    """Numbers of links, the nearest to a wanted nominal strain first.

    Those within `MAX_STRAIN`, and the two next to it; none where no chain goes round.

    Args:
        strain: wanted [-].
        odd: whether odd numbers will do.
    """
    step = 1 if odd else 2
    exact = path.wrapped_pitches + float(path.strand_length.sum()) / path.pitch / (1.0 + strain)
    below = math.floor(exact / step) * step
    counts = {below, below + step, *(links for links in path.fitting_links() if links % step == 0)}
    around = [links for links in counts if math.isfinite(path.strain(links))]
    return sorted(around, key=lambda links: (abs(path.strain(links) - strain), links))


def strand_sag(model: ChainModel, assembly: Assembly, strand: int) -> float:
    """Sag of a strand at rest at its middle [m], (a); 0 where gravity does not act across."""
    first = int(assembly.strand_first[strand])
    last = (first + int(assembly.strand_links[strand])) % len(assembly.position)
    x, y = (assembly.position[last] - assembly.position[first]).tolist()
    return _sag_at_strain(model, (x, y), assembly.strain)


# ----------------------------------------------------------------------------------------------------------- what


def _sprocket_index(of: Drive | ChainModel, name: str) -> int:
    """Index of a sprocket to fit by name; raises a DriveError without one."""
    names = [sprocket.name for sprocket in of.sprockets]
    if name not in names:
        raise DriveError(f'sprocket "{name}": no such name; allowed are {", ".join(names)}')
    return names.index(name)


def _unit_line(direction: Sequence[float]) -> tuple[float, float]:
    """Unit vector of a fit's line; raises a DriveError for a zero one."""
    line = np.asarray(direction, dtype=float)
    if line.shape != (2,) or not np.isfinite(line).all() or not line.any():
        raise DriveError(f"direction {direction}: must be two finite numbers, not both 0")
    x, y = (line / np.hypot(*line)).tolist()
    return x, y


def _wanted_angles(model: ChainModel, wanted: Mapping[str, float]) -> list[float]:
    """Angles of all arms [rad]: wanted by name [degrees], else drawn or on the nearest stop."""
    for name, angle in wanted.items():
        a = model.arm_index(name)
        if a is None:
            known = ", ".join(arm.name for arm in model.arms) or "none"
            raise DriveError(f'arm "{name}": no such name; allowed are {known}')
        low, high = model.arms[a].stops or (-360.0, 360.0)
        if not low <= angle <= high:
            raise DriveError(f"angle = {angle:g}: must be from {low:g} to {high:g} degrees, the stops of arms.{name}")
    angles = [math.radians(wanted.get(arm.name, 0.0)) for arm in model.arms]
    return [min(max(angle, arm.stops_rad[0]), arm.stops_rad[1]) for angle, arm in zip(angles, model.arms, strict=True)]


def _strain_goal(
    model: ChainModel, strain: float | None, preload: float | None, sag: float | None, strand: str | None
) -> PlacementGoal:
    """Goal of a place search for a strain, preload or sag; DriveError for wrong values."""
    given = [name for name, x in (("strain", strain), ("preload", preload), ("sag", sag)) if x is not None]
    if len(given) != 1:
        raise DriveError(f"one of strain, preload and sag must be given, not {' and '.join(given) or 'none'}")
    if strand is not None and sag is None:
        raise DriveError("strand: only together with sag")
    tension = model.chain.mean_stiffness * model.chain.pitch
    if strain is not None:
        if not abs(strain) <= MAX_STRAIN:
            raise DriveError(f"strain = {strain:g}: must be within {MAX_STRAIN:g}")
        return PlacementGoal(
            f"strain {strain:g}", "", lambda reached: reached.strain - strain, lambda reached: reached.strain
        )
    if preload is not None:
        if not 0.0 <= preload <= MAX_STRAIN * tension:
            raise DriveError(f"preload = {preload:g}: must be at least 0 and at most {MAX_STRAIN * tension:.4g} N")
        return PlacementGoal(
            f"preload {preload:g} N",
            " N",
            lambda reached: reached.strain - preload / tension,
            lambda reached: tension * reached.strain,
        )
    assert sag is not None
    if not (math.isfinite(sag) and sag > 0.0):
        raise DriveError(f"sag = {sag:g}: must be a finite number above 0")
    names = model.strand_names
    if strand is not None and strand not in names:
        raise DriveError(f'strand "{strand}": no such name; allowed are {", ".join(names)}')
    path = chain_path(model)
    straight = [string is None for string in path.strings]
    k = int(np.argmax(np.where(straight, path.strand_length, 0.0))) if strand is None else names.index(strand)
    if not straight[k]:
        raise DriveError(f'strand "{names[k]}": lies on a guide, so that it has no sag')
    x, y = (path.strand_end[k] - path.strand_start[k]).tolist()
    if _gravity_across(model, (x, y)) <= 0.0:
        raise DriveError(f'strand "{names[k]}": gravity does not act across it, so that it has no sag')
    text = f'sag {sag:g} m of strand "{names[k]}"'
    return PlacementGoal(
        text,
        " m",
        lambda reached: reached.strain - _strain_at_sag(model, reached.chord, sag),
        lambda reached: _sag_at_strain(model, reached.chord, reached.strain),
        k,
        sags=True,
    )


def _angle_goal(model: ChainModel, angle: Mapping[str, float]) -> PlacementGoal:
    """Goal of a place search for an arm's angle by name [degrees]."""
    if len(angle) != 1:
        raise DriveError("angle: one arm at a time")
    ((name, degrees),) = angle.items()
    angles, a = _wanted_angles(model, angle), model.arm_index(name)
    assert a is not None  # as `_wanted_angles` has checked
    text = f'{degrees:g} degrees of arm "{name}"'
    return PlacementGoal(
        text,
        " degrees",
        lambda reached: _ANGLE * (reached.angle - angles[a]),
        lambda reached: math.degrees(reached.angle),
        arm=a,
    )


def _wrap_goal(model: ChainModel, degrees: float, s: int) -> PlacementGoal:
    """Goal of a place search for a wrap of sprocket s [degrees]; DriveError beyond 0 to 360."""
    if not 0.0 < degrees < 360.0:
        raise DriveError(f"wrap = {degrees:g}: must be above 0 and below 360 degrees")
    return PlacementGoal(
        f'{degrees:g} degrees of wrap around "{model.sprockets[s].name}"',
        " degrees",
        lambda reached: _ANGLE * (reached.wrap - math.radians(degrees)),
        lambda reached: math.degrees(reached.wrap),
        around=s,
    )


def _gravity_across(model: ChainModel, chord: tuple[float, float]) -> float:
    """Gravity across a strand's chord [m/s^2]; 0 for an upright one."""
    (x, y), (gx, gy) = chord, model.run.gravity
    part = abs(x * gy - y * gx) / math.hypot(x, y)
    return part if part > _UPRIGHT * math.hypot(gx, gy) else 0.0


def _sag_coefficients(model: ChainModel, chord: tuple[float, float]) -> tuple[float, float, float]:
    """Coefficients A, B, D of a strand's strain over sag, A / h - B h^2 + D, (a)."""
    square = chord[0] * chord[0] + chord[1] * chord[1]
    weight = model.chain.mass / model.chain.pitch * _gravity_across(model, chord)
    given_way = 2.0 * (model.contact.sprocket.clearance or 0.0) / math.sqrt(square)
    return weight * square / (8.0 * model.chain.mean_stiffness * model.chain.pitch), 8.0 / (3.0 * square), given_way


def _strain_at_sag(model: ChainModel, chord: tuple[float, float], sag: float) -> float:
    """Strain of a strand at a sag [m], (a)."""
    elastic, geometric, given_way = _sag_coefficients(model, chord)
    return elastic / sag - geometric * sag * sag + given_way


def _sag_at_strain(model: ChainModel, chord: tuple[float, float], strain: float) -> float:
    """Sag of a strand at a strain [m], (a)."""
    elastic, geometric, given_way = _sag_coefficients(model, chord)
    if elastic == 0.0:
        return 0.0
    roots = np.roots([geometric, 0.0, strain - given_way, -elastic])
    return float(roots[np.isreal(roots)].real.max())


def _model_with_links(model: ChainModel, links: int) -> ChainModel:
    """Chain model with another number of links."""
    return replace(model, chain=model.chain.model_copy(update={"links": links}))
