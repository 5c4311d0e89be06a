"""The command `warpchain select`: sizes and strands that standards rate for a power, and the drive file of one."""

from __future__ import annotations

import math
from argparse import Namespace
from typing import NamedTuple

from warpchain.assembly.summary import table_lines
from warpchain.cli.new_command import DriveRequest, write_drive_request
from warpchain.drive.catalogue import CHAINS, CatalogueChain
from warpchain.errors import DriveError
from warpchain.model.power_rating import (
    LEFT_OUT,
    LUBRICATION,
    RATED_HOURS,
    RatedPower,
    elongation_limit,
    lubrication_class,
    rated_power,
    size_rating,
)

LEAST_TEETH, MOST_TEETH = 9, 150
MOST_RATIO = 10.0
CENTER_PITCHES, MOST_PITCHES = 40.0, 80.0
"""Distance of centers in pitches by default, and the largest (ISO 10823)."""
LEAST_WRAP = math.radians(120.0)
"""Least wrap of the smaller sprocket (ACA) [rad]."""
MOST_SURPLUS = 4.0
"""Rated over wanted power of a listed size, at most."""


class Selection(NamedTuple):
    """Chain size that does for a power.

    Attributes:
        chain: row of the catalog.
        rated: its rated power [W].
        links, centers: links, and distance of centers of the chain when taut [m].
        speed: of the chain [m/s].
        pull: of the power that is asked for, without a service factor [N].
    """

    chain: CatalogueChain
    rated: RatedPower
    links: int
    centers: float
    speed: float
    pull: float


class PowerRequest(NamedTuple):
    """Power that a chain is selected for.

    Attributes:
        power: to pass on [W].
        speed: of the driver [rad/s].
        teeth: of driver and driven.
        service: factor on the power [-].
        centers: distance of the centers [m]; None is `CENTER_PITCHES`.
    """

    power: float
    speed: float
    teeth: tuple[int, int]
    service: float
    centers: float | None


def select_lines(arguments: Namespace) -> list[str]:
    """Lines on chain sizes that do for a power; with an output, writes one's drive file.

    Raises:
        DriveError: values out of their range, no size that does, a size that does not, or a file that is there.
    """
    asked = _power_request(arguments)
    found = selections(asked)
    if not found:
        raise DriveError(
            f"--power {asked.power:g} W: no size does at {asked.speed:g} rad/s of {asked.teeth[0]} to {asked.teeth[1]} "
            "teeth with up to 3 strands and these centers"
        )
    lines = _selection_lines(asked, found)
    if arguments.output is None:
        if arguments.size is not None:
            raise DriveError("--size: only with -o, whose drive file it is of")
        return lines
    by_size = {selection.chain.size: selection for selection in found}
    size = arguments.size or next((one for one in by_size if CHAINS[one].strands == 1), found[0].chain.size)
    if size not in by_size:
        raise DriveError(f"--size {size}: does not; {', '.join(by_size)} do")
    return [*lines, "", f"taken: {size}", *_write_selection(asked, by_size[size], arguments)]


def _power_request(arguments: Namespace) -> PowerRequest:
    """Power that `warpchain select`'s arguments ask for."""
    for name in ("power", "speed", "ratio", "service", "centers"):
        value = getattr(arguments, name)
        if value is not None and not (0.0 < value < math.inf):
            raise DriveError(f"--{name} {value:g}: must be a finite number above 0")
    small, ratio = arguments.teeth, arguments.ratio
    if not 1.0 / MOST_RATIO <= ratio <= MOST_RATIO:
        raise DriveError(f"--ratio {ratio:g}: must be {1.0 / MOST_RATIO:g} to {MOST_RATIO:g}")
    large = round(small * max(ratio, 1.0 / ratio)) if small <= MOST_TEETH else small
    if small < LEAST_TEETH or large > MOST_TEETH:
        raise DriveError(
            f"--teeth {small}: must be from {LEAST_TEETH}, and with the ratio {ratio:g} to {MOST_TEETH} for the larger"
        )
    teeth = (small, large) if ratio >= 1.0 else (large, small)
    return PowerRequest(arguments.power, arguments.speed, teeth, arguments.service, arguments.centers)


def selections(asked: PowerRequest) -> list[Selection]:
    """Chain sizes that do for a power, by pitch, with the fewest strands."""
    found: dict[str, Selection] = {}
    for chain in CHAINS.values():
        series = chain.size.partition("-")[0]
        if size_rating(chain.size) is None or series.endswith("H") or series in found:
            continue
        one = _selection(asked, chain)
        if one is not None:
            found[series] = one
    return sorted(found.values(), key=lambda one: (one.chain.pitch, one.chain.size))


def _selection(asked: PowerRequest, chain: CatalogueChain) -> Selection | None:
    """Chain size as a selection, or None if it does not do."""
    pitch, small = chain.pitch, min(asked.teeth)
    speed = asked.speed * asked.teeth[0] * pitch / math.tau
    rated = rated_power(chain.size, small, asked.speed * asked.teeth[0] / small)
    if not 1.0 <= rated.least / (asked.service * asked.power) <= MOST_SURPLUS:
        return None
    wanted = CENTER_PITCHES * pitch if asked.centers is None else asked.centers
    radii = [0.5 * pitch / math.sin(math.pi / teeth) for teeth in asked.teeth]
    links = _even_links(wanted / pitch, asked.teeth)
    centers = pitch * _center_pitches(links, asked.teeth)
    apart = abs(radii[1] - radii[0])
    if (
        not (sum(radii) + pitch < centers <= MOST_PITCHES * pitch)
        or math.pi - 2.0 * math.asin(apart / centers) < LEAST_WRAP
    ):
        return None
    return Selection(chain, rated, links, centers, speed, asked.power / speed)


def _even_links(centers: float, teeth: tuple[int, int]) -> int:
    """Even number of links of a selected chain for a distance of centers in pitches (ISO 10823, f_3)."""
    a, b = teeth
    exact = 2.0 * centers + 0.5 * (a + b) + ((b - a) / math.tau) ** 2 / centers
    return 2 * round(0.5 * exact)


def _center_pitches(links: int, teeth: tuple[int, int]) -> float:
    """Distance of centers of a selected chain in pitches, by links, or nan."""
    a, b = teeth
    free, turned = links - 0.5 * (a + b), (b - a) / math.tau
    square = free * free - 8.0 * turned * turned
    return 0.25 * (free + math.sqrt(square)) if square >= 0.0 else math.nan


def _selection_lines(asked: PowerRequest, found: list[Selection]) -> list[str]:
    """Lines of a table of selected chain sizes, and what it means."""
    design = asked.service * asked.power
    rows: list[tuple[str, ...]] = []
    for one in found:
        rating = size_rating(one.chain.size)
        assert rating is not None
        rows.append(
            (
                one.chain.size,
                f"{1e-3 * one.rated.least:.3g} kW{'~' * ('ESTIMATE' in rating.standard)}",
                f"{design / one.rated.least:.2f}",
                one.rated.limited_by,
                f"{one.speed:.3g} m/s",
                str(one.links),
                f"{1e3 * one.centers:.1f} mm",
                f"{one.pull:.4g} N",
                f"{one.chain.breaking_load / one.pull:.3g}",
                lubrication_class(one.chain.pitch, one.speed),
            )
        )
    head = ("size", "rated", "used", "limited by", "chain", "links", "centers", "pull", "breaks at", "oil")
    rpm = [asked.speed * 30.0 / math.pi * asked.teeth[0] / teeth for teeth in asked.teeth]
    oils = sorted({row[-1] for row in rows})
    return [
        f"{1e-3 * asked.power:g} kW times {asked.service:g}, {asked.teeth[0]} teeth at {rpm[0]:.5g} rpm to "
        f"{asked.teeth[1]} at {rpm[1]:.5g} rpm; with up to 3 strands:",
        *table_lines(head, rows),
        f"rated: ASME B29.1 (ACA), for {RATED_HOURS:g} h until the chain is "
        f"{100.0 * elongation_limit(max(asked.teeth)):.3g} % longer; ~ ISO 10823 has charts only, an ESTIMATE",
        "links: the nearest even number, centers with a taut chain (DIN 8196 would round up)",
        f"breaks at: times the pull; oil: {', '.join(f'{oil} {LUBRICATION[oil]}' for oil in oils)}",
        f"left out: {LEFT_OUT}; sizes of more than {MOST_SURPLUS:g} times that power; silent chains, which these "
        "standards do not rate",
    ]


def _write_selection(asked: PowerRequest, one: Selection, arguments: Namespace) -> list[str]:
    """Writes a selection's drive file; returns lines to print."""
    torque = asked.power / (asked.speed * asked.teeth[0] / asked.teeth[1])
    wanted = one.centers if asked.centers is None else asked.centers
    request = DriveRequest(one.chain, asked.teeth, ((0.0, 0.0), (wanted, 0.0)), asked.speed, float(f"{torque:.6g}"))
    path = arguments.output
    lines = write_drive_request(request, path, arguments.overwrite)
    return [*lines, f"the dynamic run beside it: warpchain run {path} -o {path.stem}.mcap (docs/selection.md)"]
